"""Virtual control-based continuation of the wing-engine structure against harmonic balance, as Markdown tables.

Run `python benchmarks/virtual_continuation.py`; in parts `--modes 8 --sensors 9,10 --seeds 2`. Seeds count from 0 and
none is dropped. 29 modes, cubic joints (class 2, theta = 1.58), E factors 0.88 and 0.31, one force at sensor 7, noise
on all readings and on the control. Each curve is compared with harmonic balance of the same damped, forced structure
with the same sensor in quadrature ("like for like"), and with the backbone of the conservative structure, whose
difference is what single-point forcing does, not an error of the measurement. A curve counts when at least 90 % of its
levels converge.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from time import perf_counter

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import table_head
from tqdm import tqdm

from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.quadrature_curves import MeasuredCurve, quadrature_curve
from opid.mechanics.backbones.specimen import Specimen
from opid.updating.model_class import PAPER_CLASSES, PAPER_THETA
from opid.updating.structure.reduction import reduce
from opid.virtual.backbone_tests.control_based_continuation import measured_curve
from opid.virtual.backbone_tests.measured import AMPLITUDE_M, BENCH_NOISE, BENDING_MODES
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure

TRUTH = PAPER_CLASSES[1]
CONTROLLED, DRIVE = "10", "7"
LEAST_SHARE, WANTED = 0.9, 1e-4
IN_PAPER = {7: 14, 8: 5}


def growing(curve: MeasuredCurve) -> np.ndarray:
    """Numbers of the levels that converged, without those whose amplitude is not above the last one's."""
    kept: list[int] = []
    for level in np.flatnonzero(curve.converged):
        if not kept or curve.controlled_amplitude[level] > curve.controlled_amplitude[kept[-1]]:
            kept.append(int(level))
    return np.array(kept, dtype=int)


def differences(specimen: Specimen, curve: MeasuredCurve) -> tuple[np.ndarray, np.ndarray]:
    """Relative differences of frequency: like for like, as far as harmonic balance goes, and to the backbone."""
    kept = growing(curve)
    if not kept.size:
        return np.array([]), np.array([])
    held, found = curve.controlled_amplitude[kept], curve.frequency_hz[kept]
    asked = {"mode": curve.mode, "amplitude": held}
    exact = quadrature_curve(specimen, sensor=curve.sensor, controlled_sensor=CONTROLLED, **asked)
    true = backbone(specimen.system, specimen.laws, sensor=CONTROLLED, harmonics=(1, 3, 5, 7), **asked)
    n = int(exact.converged.sum())
    return found[:n] / exact.frequency_hz[:n] - 1, found / true.frequency_hz - 1


def shown(values: np.ndarray) -> str:
    return f"{np.abs(values).max():.1e}" if values.size else "-"


def of_mode(specimen: Specimen, mode: int, sensors: list[str], seed: int, n_points: int) -> Iterator[str]:
    least, most = AMPLITUDE_M[BENDING_MODES.index(mode)]
    rng = np.random.default_rng(seed)
    reached, within, off = 0, 0, []
    begun = perf_counter()
    for sensor in tqdm(sensors, f"mode {mode}, seed {seed}", disable=not sys.stderr.isatty()):
        start = perf_counter()
        curve = measured_curve(
            specimen, mode=mode, sensor=sensor, controlled_sensor=CONTROLLED, rng=rng, noise=BENCH_NOISE,
            amplitude=np.linspace(least, most, n_points),
        )  # fmt: skip
        taken = perf_counter() - start
        like, conservative = differences(specimen, curve)
        counts = curve.converged.sum() >= LEAST_SHARE * n_points
        reached += counts
        within += bool(counts and like.size == growing(curve).size and np.abs(like).max() <= WANTED)
        off += [float(np.abs(like).max())] if counts else []
        cells = (
            f"{mode} | {sensor} | {seed}",
            f"{int(curve.converged.sum())} of {n_points}",
            f"{shown(like)} ({like.size} levels)" if like.size else "-",
            shown(conservative),
            str(sum(level.periods for level in curve.levels)),
            f"{taken:.1f}",
            curve.reason,
        )
        yield f"| {' | '.join(cells)} |"
    paper = f"paper {IN_PAPER.get(mode, '-')}"
    largest = f"{max(off):.1e}; {within} of {reached} within {WANTED:g}" if off else "-"
    taken = perf_counter() - begun
    yield f"| {mode} | **all** | {seed} | {reached} curves ({paper}) | {largest} | | | {taken:.0f} | |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modes", default="7,8", help="with commas; 7 and 8 are the paper's first and second")
    parser.add_argument("--sensors", default="", help="with commas; all where left out")
    parser.add_argument("--seeds", type=int, default=1, help="how many, from 0")
    parser.add_argument("--points", type=int, default=20, help="levels of a curve")
    parser.add_argument("--damping", type=float, default=0.3, help="of each mode, %%")
    args = parser.parse_args()
    system = reduce(wing_engine_structure(), UPDATED)
    laws = tuple(TRUTH.laws(system.joints, PAPER_THETA[TRUTH.name]).values())
    specimen = Specimen(system, laws, args.damping / 100, DRIVE)
    sensors = [part for part in args.sensors.split(",") if part] or list(system.sensors)
    titles = ("mode", "sensor", "seed", "levels converged", "like for like", "to the conservative backbone")
    print(table_head(*titles, "periods", "s", "why"), flush=True)
    for seed in range(args.seeds):
        for mode in (int(part) for part in args.modes.split(",")):
            for line in of_mode(specimen, mode, sensors, seed, args.points):
                print(line, flush=True)


if __name__ == "__main__":
    main()
