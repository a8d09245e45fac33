"""`opid law` on simulated records of a test bench: how often the true law is found, and its parameters in their range.

    python benchmarks/bench_laws.py [--seeds 2] [--samples 2500] [--noise 0.01] [--out rows.json]

Every searched kind of the library and sums of two are drawn, under a sine with a sweep and under random motion, with
noise of 1 % of the force. A term is drawn so that the motion shows it: its scale is comparable with the motion, and
its force is a good part of that of the spring and the damper beside it.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from opid.errors import NotDeterminedError
from opid.mechanics.laws.law import LAWS, Law, Term
from opid.mechanics.memory import force_along
from opid.suspensions.bench.law import BenchLaw, law_of_bench
from opid.suspensions.bench.record import Bench, BenchTolerances

FS = 500.0
STIFFNESS, DAMPING, OFFSET = 2e5, 2e3, 12.0
MOTIONS = ("sine and sweep", "random")
PAIRS = (
    ("coulomb_friction", "cubic_stiffness"),
    ("arctan_velocity", "quadratic_damping"),
    ("blow_off_damping", "gas_column"),
    ("asymmetric_damping", "dead_zone_stiffness"),
    ("quadratic_damping", "gas_column"),
    ("arctan_displacement", "arctan_velocity"),
    ("asymmetric_damping", "quadratic_stiffness"),
    ("signed_power_damping", "asymmetric_stiffness"),
    ("cubic_stiffness", "dahl_friction"),
    ("quadratic_damping", "bouc_wen"),
    ("dead_zone_stiffness", "iwan_friction"),
    ("quadratic_stiffness", "maxwell_arm"),
)
# a scale is drawn between these, in rms motions; the rms of z + c z' is that of the mixed arctangent
SCALES = {
    "arctan_velocity": (0.1, 0.8),
    "coulomb_friction": (0.1, 0.8),
    "arctan_displacement": (0.1, 0.8),
    "arctan_mixed": (0.1, 0.8),
    "blow_off_damping": (0.5, 1.2),
    "dead_zone_stiffness": (0.5, 1.2),
    "bump_stop": (0.7, 1.2),
    "rebound_stop": (0.7, 1.2),
    "gas_column": (3.5, 8.0),
    "dahl_friction": (0.03, 0.5),
    "bouc_wen": (0.1, 0.5),
    "lugre_friction": (0.03, 0.5),
    "iwan_friction": (0.3, 1.0),
    "maxwell_arm": (0.2, 2.0),
}
# away from 1, 2 and 3, which are other kinds
EXPONENTS = ((0.4, 0.7), (1.35, 1.65), (2.35, 2.65))
# rms of the force of a term over that of spring and damper
FORCES = (0.2, 0.6)


@dataclass(frozen=True)
class Row:
    """What came of one record: laws, whether each of the estimates holds its truth, and what was paid."""

    truth: str
    motion: str
    seed: int
    found: str
    held: tuple[bool, ...]
    without_interval: int
    r2_left_out: float
    seconds: float

    @property
    def is_right(self) -> bool:
        """Whether the terms are the true ones."""
        return set(self.truth.split("+")) == set(self.found.split("+"))


def motion_of(name: str, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return travel (m) and velocity (m/s) of a sine with a sweep, or of band-limited noise, of 15 mm rms."""
    t = np.arange(n) / FS
    if name == "random":
        sections = signal.butter(3, 4.0, fs=FS, output="sos")
        z = signal.sosfiltfilt(sections, rng.standard_normal(n + 2000))[1000:-1000]
    else:
        first, second = rng.uniform(0, 2 * np.pi, 2)
        sweep = 2 * np.pi * (0.3 * t + 3.7 * t**2 * FS / n / 2)
        z = 0.6 * np.sin(2 * np.pi * 0.7 * t + first) + 0.4 * np.sin(sweep + second)
    z *= 0.015 / z.std()
    return z, np.gradient(z, 1 / FS)


def term_of(kind: str, z: np.ndarray, v: np.ndarray, rng: np.random.Generator) -> Law:
    """Draw a term that the motion shows."""
    inner, lag = [], 0.0
    for parameter in LAWS[kind].parameters[:0:-1]:
        if parameter.role == "lag":
            lag = float(z.std() / v.std() * np.exp(rng.uniform(np.log(0.3), np.log(3.0))))
            inner.append(lag)
        elif (LAWS[kind].memory is not None and parameter.role != "scale") or parameter.known:
            inner.append(parameter.default)
        elif parameter.role == "exponent":
            inner.append(float(rng.uniform(*EXPONENTS[rng.integers(len(EXPONENTS))])))
        else:
            references = {"m/s": np.std(v), "s": np.std(z) / np.std(v), "m": np.std(z + lag * v)}
            reference = float(references[parameter.unit])
            if kind == "gas_column":
                # no column is shorter than the stroke
                reference = max(reference, float(-z.min()) / 2.5)
            inner.append(reference * float(np.exp(rng.uniform(*np.log(SCALES[kind])))))
    unit = Law((Term(kind, (1.0, *inner[::-1])),))
    sign = -1.0 if kind == "blow_off_damping" else 1.0
    beside = float(np.std(STIFFNESS * z + DAMPING * v))
    size = float(np.std(force_along(unit, z, v, FS)))
    return unit.scaled(sign * float(np.exp(rng.uniform(*np.log(FORCES)))) * beside / size)


def record_of(kinds: tuple[str, ...], motion: str, seed: int, n: int, noise: float) -> tuple[Bench, Law]:
    """Return a simulated record and its law."""
    rng = np.random.default_rng([seed, MOTIONS.index(motion), *(list(LAWS).index(kind) for kind in kinds)])
    z, v = motion_of(motion, n, rng)
    law = Law(tuple(term for kind in kinds for term in term_of(kind, z, v, rng).terms))
    force = OFFSET + STIFFNESS * z + DAMPING * v + force_along(law, z, v, FS)
    force = force + noise * force.std() * rng.standard_normal(n)
    channels: dict[str, str | None] = {"force": "F", "travel": "z", "velocity": "v"}
    exact = BenchTolerances(0.0, 0.0, 0.0)
    return Bench(z, v, force, FS, 0.0, "recorded", None, channels, (), tolerances=exact), law


def row_of(kinds: tuple[str, ...], motion: str, seed: int, n: int, noise: float) -> Row:
    """Search the law of a record and compare it with the truth."""
    bench, truth = record_of(kinds, motion, seed, n, noise)
    begun = time.process_time()
    try:
        found = law_of_bench(bench)
    except NotDeterminedError:
        return Row("+".join(kinds), motion, seed, "refused", (), 0, np.nan, time.process_time() - begun)
    seconds = time.process_time() - begun
    held, n_without = held_by(found, truth)
    name = found.law.name
    return Row("+".join(kinds), motion, seed, name, held, n_without, found.r2_left_out, seconds)


def held_by(found: BenchLaw, truth: Law) -> tuple[tuple[bool, ...], int]:
    """Say of each parameter of a right law whether its interval holds the truth; count those without an interval."""
    if {term.name for term in truth.terms} != set(found.law_estimates):
        return (), 0
    straight = zip(dict(found.parameters.items()).values(), (STIFFNESS, DAMPING, OFFSET), strict=True)
    own = (
        pair for term in truth.terms for pair in zip(found.law_estimates[term.name].values(), term.values, strict=True)
    )
    pairs = [*straight, *own]
    return (
        tuple(bool(each.holds(value)) for each, value in pairs if each.interval95 is not None),
        sum(each.interval95 is None for each, _ in pairs),
    )


def table(rows: list[Row]) -> str:
    """Return the table, a line for each kind and the sums of all."""
    lines = [
        f"{'truth':44s} {'right':>9s} {'in interval':>13s} {'none':>5s} {'R2 left out':>12s} {'s':>6s}  also found"
    ]
    groups = {name: [row for row in rows if row.truth == name] for name in dict.fromkeys(row.truth for row in rows)}
    single = [row for row in rows if "+" not in row.truth]
    groups |= {"one kind": single, "sums of two": [row for row in rows if "+" in row.truth]}
    groups |= {name: [row for row in rows if row.motion == name] for name in MOTIONS}
    for name, group in {**groups, "all": rows}.items():
        if not group:
            continue
        held = [each for row in group for each in row.held]
        wrong = sorted({row.found for row in group if not row.is_right}) if name in group[0].truth else []
        lines.append(
            f"{name:44s} {sum(row.is_right for row in group):4d}/{len(group):<4d} {sum(held):6d}/{len(held):<6d} "
            f"{sum(row.without_interval for row in group):5d} {np.nanmin([row.r2_left_out for row in group]):12.6f} "
            f"{np.mean([row.seconds for row in group]):6.2f}  {', '.join(wrong)}"
        )
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--samples", type=int, default=2500)
    parser.add_argument("--noise", type=float, default=0.01, help="rms over that of the force")
    parser.add_argument("--out", type=Path, help="rows as JSON")
    options = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)
    kinds = [(name,) for name, kind in LAWS.items() if kind.searched]
    rows = []
    for truth in [*kinds, *PAIRS]:
        for motion in MOTIONS:
            for seed in range(options.seeds):
                rows.append(row_of(truth, motion, seed, options.samples, options.noise))
                if options.out is not None:
                    options.out.write_text(json.dumps([asdict(row) for row in rows]))
    print(table(rows))


if __name__ == "__main__":
    main()
