"""The Bouc-Wen benchmark: a law and a mass from the training record alone, then both test signals from the force alone.

Run `python benchmarks/bouc_wen.py bouc_wen.npz`. The file holds the records of Noël and Schoukens (4TU, doi
10.4121/12967592): force u in N and travel y in m at 750 Hz, a training multisine with noise, a multisine in its steady
state and a sine sweep from rest; it is not part of the project. The bench takes the travel, differentiates it, searches
the law over all kinds beside the unknown moving mass, and refines it by the motion simulated from the training force.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from harness import table_head, table_row

from opid.mechanics.laws.law import law
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Structure
from opid.signals.recording import Channel, Recording
from opid.suspensions.bench.law import BenchLaw, law_of_bench
from opid.suspensions.bench.record import BenchTolerances, bench_from_recording
from opid.suspensions.bench.simulation import MovingPart

FS = 750.0
TESTS = ("multisine", "sinesweep")
# of the law that is searched, and what is aimed at
ASKED = "| asked (aim) | 2e-05 (1e-05) | 2e-05 (1e-05) |"
# 2 y'' + 10 y' + 5e4 y + w = u, w' = 5e4 y' - 1e3 (0.8 |y'| w - 1.1 y' |w|), with h = w/A: h' = y'/s (1 - |h| (c +
# sgn(y' h)/2)), 1/s = 2 * 1e3 * 0.8 = A/5e4, c/s = -1.1e3
SCALE_M = 1 / 1.6e3
TRUE = law("bouc_wen", amplitude_n=5e4 * SCALE_M, scale_m=SCALE_M, exponent=1.0, shape=-1.1e3 * SCALE_M)
TRUE_STRAIGHT = np.array([5e4, 10.0, 0.0, 2.0])


def identified(records: dict[str, np.ndarray], candidates: tuple[str, ...] | None = None) -> BenchLaw:
    """Return the law of the training record, searched over all kinds or over some."""
    samples = np.stack([records["u_train"], records["y_train"]], axis=1)
    record = Recording(samples, fs=FS, channels=(Channel("u", "N"), Channel("y", "m")))
    bench = bench_from_recording(record, force="u", travel="y", moving_mass=True)
    bench = replace(bench, tolerances=BenchTolerances(0.0, 0.0, 0.0))  # the records were simulated
    return law_of_bench(bench, title="Bouc-Wen benchmark", candidates=candidates)


def errors_of(records: dict[str, np.ndarray], part: MovingPart) -> list[float]:
    """Return the rms error of the travel that a part makes of the force of each test, m."""
    multisine = part.at_rest().travel(np.tile(records["u_multisine"], 2), fs=FS, steps_per_sample=4)
    sweep = part.at_rest().travel(records["u_sinesweep"], fs=FS, steps_per_sample=4)
    period = records["y_multisine"].size
    return [_rms(multisine[period:] - records["y_multisine"]), _rms(sweep - records["y_sinesweep"])]


def plain_errors(records: dict[str, np.ndarray]) -> list[float]:
    """Return the same with the true constants, the force a straight line between its samples."""
    joint = Joint("specimen", np.ones(1), *TRUE_STRAIGHT[:2], TRUE)
    structure = Structure([[TRUE_STRAIGHT[3]]], [[0.0]], [[0.0]], joints=(joint,))
    errors = []
    for name, n_times in zip(TESTS, (2, 1), strict=True):
        force, travel = np.tile(records[f"u_{name}"], n_times), records[f"y_{name}"]
        half_steps = np.interp(np.arange(4 * (force.size - 1) + 1) / 4, np.arange(force.size), force)
        motion = time_response(
            structure, half_steps[:, np.newaxis], fs=FS, duration_s=force.size / FS, steps_per_sample=2
        )
        errors.append(_rms(motion.displacement[-travel.size :, 0] - travel))
    return errors


def part_of(found: BenchLaw) -> MovingPart:
    """Return the part that a bench law simulates."""
    if found.simulation is None:
        raise SystemExit("the law was not refined by a simulated motion")
    return found.simulation.part


def rows(path: Path) -> list[str]:
    """Return the table, line by line."""
    with np.load(path) as file:
        records = {name: np.asarray(file[name], dtype=np.float64) for name in file if name != "fs_hz"}
    found, linear = identified(records), identified(records, ())
    true = MovingPart(TRUE_STRAIGHT, TRUE, np.zeros(3))
    named: dict[str, list[float]] = {
        f"`{found.law.name}`, searched and refined": errors_of(records, part_of(found)),
        "linear, refined in the same way": errors_of(records, part_of(linear)),
        "true constants, plain Runge-Kutta": plain_errors(records),
        "true constants, force band-limited between samples": errors_of(records, true),
        "travel itself": [_rms(records[f"y_{name}"]) for name in TESTS],
    }
    lines = [table_head("model", "multisine, m rms", "sine sweep, m rms"), ASKED]
    lines += [table_row(name, *(f"{error:.2e}" for error in errors)) for name, errors in named.items()]
    return [*lines, "", *parameter_rows(found)]


def parameter_rows(found: BenchLaw) -> list[str]:
    """Return the parameters beside the true ones, where the law is the true one."""
    lines = [table_head("parameter", "found", "interval", "true")]
    estimates = dict(found.parameters.items()) | dict(found.law_estimates.get("bouc_wen", {}))
    true = [*TRUE_STRAIGHT, *TRUE.vector] if found.law.name == TRUE.name else []
    for k, (name, each) in enumerate(estimates.items()):
        ends = "-" if each.interval95 is None else f"{each.interval95[0]:.6g} to {each.interval95[1]:.6g}"
        lines.append(table_row(name, f"{each.value:.6g}", ends, f"{true[k]:.6g}" if true else "-"))
    return lines


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    print("\n".join(rows(Path(sys.argv[1]))))
