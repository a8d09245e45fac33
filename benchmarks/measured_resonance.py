"""Tests at phase resonance and response curves as laboratories record them: errors of law and damping, their intervals.

Run `python benchmarks/measured_resonance.py`; in parts `--worlds sound,turned --seeds 5 --levels 12`. Seeds count from
0 and none is dropped. Noise is 1 % of the rms of each channel in each level, and of each value of the four response
curves, which stand alone but in "joint". In every world but "sound", "curves" and "joint" one assumption fails: the
loop misses quadrature, the force has a phase that nobody knows, a sensor is clipped, a neighbouring mode is not among
the shapes, the polarity of the force is wrong, the amplitudes of curves are in another unit, or their frequency is
stepped too fast.
"""

import argparse
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from harness import read_names, table_head, table_row
from made_resonance import (
    C2,
    K3,
    MODE,
    curves_study,
    held_study,
    hurried_study,
    with_amplitudes_in_g,
    with_force_turned,
    with_mode_unknown,
    with_phases_turned,
    with_polarity_reversed,
    with_sensor_clipped,
)

from opid.errors import InputError
from opid.modal.resonance.identification import identify_resonance
from opid.modal.resonance.law import ResonanceLaw
from opid.modal.resonance.result import Resonance
from opid.modal.study import ModalStudy

HEAD = ("world", "k3 error [%]", "k3 inside", "damping error [%]", "damping inside", "levels' damping [%]", "warned")

WORLDS: dict[str, tuple[str, Callable[[int, int], ModalStudy]]] = {
    "sound": ("all assumptions hold", held_study),
    "off": ("loop 5 degrees off", lambda seed, n: held_study(seed, n, phase_error_deg=-5.0)),
    "turned": ("force turned by 5 degrees", lambda seed, n: with_force_turned(held_study(seed, n), 5.0)),
    "clipped": ("a sensor clipped at 60 %", lambda seed, n: with_sensor_clipped(held_study(seed, n))),
    "unknown": ("a neighbour not among the shapes", lambda seed, n: with_mode_unknown(held_study(seed, n))),
    "curves": ("response curves alone", lambda seed, n: curves_study(seed)),
    "joint": ("levels and response curves", lambda seed, n: held_study(seed, n, n_curves=4)),
    "curves_turned": ("curves, force turned", lambda seed, n: with_phases_turned(curves_study(seed), 5.0)),
    "curves_in_g": ("curves in g for m/s^2", lambda seed, n: with_amplitudes_in_g(curves_study(seed))),
    "hurried": ("curves, 0.3 time constants a step", lambda seed, n: hurried_study(seed)),
    "hasty": ("curves, 1 time constant a step", lambda seed, n: hurried_study(seed, settling=1.0)),
    "reversed": ("force of wrong polarity", lambda seed, n: with_polarity_reversed(held_study(seed, n))),
}


def true_damping(modes_hz: float, zeta: float, amplitude: np.ndarray) -> np.ndarray:
    """Return the true damping ratio at some amplitudes, by harmonic linearisation."""
    k0 = (2 * np.pi * modes_hz) ** 2
    omega = np.sqrt(k0 + 0.75 * K3 * amplitude**2)
    return (2 * zeta * np.sqrt(k0) + C2 * 8 / (3 * np.pi) * omega * amplitude) / (2 * omega)


def judge(result: Resonance, law: ResonanceLaw) -> tuple[float, bool, float, float, float]:
    """Return errors of k3, damping and single levels in percent, and whether the intervals hold the truth."""
    k3 = law.stiffness.get(3)
    error = 100 * abs((k3.value or 0.0) / K3 - 1) if k3 else 100.0
    truth = true_damping(120.0, 0.004, law.amplitude)
    inside = float(np.mean(np.abs(law.damping_ratio - truth) <= 1.96 * law.damping_std))
    of_levels = 100 * np.abs(result.damping_ratio / true_damping(120.0, 0.004, result.amplitude) - 1)
    worst = 100 * float(np.abs(law.damping_ratio / truth - 1).max())
    rms = float(np.sqrt(np.mean(of_levels**2))) if of_levels.size else float("nan")
    return error, bool(k3 and k3.holds(K3)), worst, inside, rms


def run(name: str, n_seeds: int, n_levels: int) -> None:
    """Print the row of one world: median and largest errors over the seeds, and how often the intervals hold."""
    words, make = WORLDS[name]
    found, refused, warned = [], 0, 0
    for seed in range(n_seeds):
        try:
            result = identify_resonance(replace(make(seed, n_levels), gain_tolerance=0.01))
        except InputError:
            refused += 1
            continue
        if result.law is None:
            refused += 1
            continue
        found.append(judge(result, result.law))
        warned += bool(result.warnings)
        held_study.cache_clear()
    if not found:
        print(table_row(words, *["refused"] * 5, f"{refused} of {n_seeds} refused"), flush=True)
        return
    k3, k3_in, damping, damping_in, levels = (np.array(each, dtype=float) for each in zip(*found, strict=True))
    cells = [
        words,
        f"{np.median(k3):.3f}, at most {k3.max():.3f}",
        f"{int(k3_in.sum())} of {k3_in.size}",
        f"{np.median(damping):.2f}, at most {damping.max():.2f}",
        f"{100 * damping_in.mean():.0f} %",
        f"{np.median(levels):.2f}, at most {levels.max():.2f}" if np.isfinite(levels).all() else "-",
        f"{warned} of {k3_in.size}",
    ]
    print(table_row(*cells), flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", help="some of the worlds, joined by commas")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--levels", type=int, default=70)
    given = parser.parse_args()
    print(f"{given.seeds} seeds, {given.levels} levels, mode {MODE}, noise 1 %")
    print(table_head(*HEAD))
    for name in read_names(parser, given.worlds, WORLDS, "world"):
        run(name, given.seeds, given.levels)


if __name__ == "__main__":
    main()
