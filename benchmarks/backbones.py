"""Speed of backbones condensed on the joints against the plain Newton's method, their accuracy, and memory.

Run `OMP_NUM_THREADS=1 python benchmarks/backbones.py`. One evaluation is 2 modes at 20 amplitudes each, of the
wing-engine structure of Song et al. (2021) reduced to 29 degrees of freedom; 1000 samples of the law are taken at once,
and one by one. Accuracy is that of the frequency against shooting in time.
"""

import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from plain_backbones import plain_backbone
from shooting import shoot

from opid.mechanics.backbones.continuation import continued_backbone
from opid.mechanics.backbones.family import backbone, family_evaluator
from opid.mechanics.laws.law import Law, Term
from opid.updating.structure.reduction import craig_bampton, find_couplings, modes_of
from opid.virtual.backbone_tests.wing_engine import UPDATED, WingEngine, wing_engine_structure

SENSOR = "10"
# the two modes of the paper, after six in which the structure swings on its springs
MODES = {7: np.linspace(0.2e-3, 4e-3, 20), 8: np.linspace(0.2e-3, 2.5e-3, 20)}
COEFFICIENTS = {"cubic_stiffness": 1.58 * 6.8e7, "quadratic_stiffness": 2.16e5, "quintic_stiffness": 3e12}
N_SAMPLES, N_PLAIN, N_REPEATS = 1000, 10, 5
# enough that a cubic with three harmonics is exact
N_TIMES = 16


def law_of(kind, factor=1.0):
    return Law((Term(kind, (factor * COEFFICIENTS[kind],)),))


def cpu_seconds(function):
    begin = time.process_time()
    result = function()
    return time.process_time() - begin, result


def best_of(n, function):
    return min((cpu_seconds(function) for _ in range(n)), key=lambda pair: pair[0])


def peak_mib():
    # kibibytes on Linux, bytes on macOS
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)


def plain(reduced, kind, factors, harmonics):
    def curve(mode, factor):
        return plain_backbone(
            reduced.mass,
            reduced.stiffness,
            law_of(kind, factor),
            joint_rows=reduced.joint_rows,
            sensor_row=reduced.sensor_rows[reduced.sensors.index(SENSOR)],
            mode=mode,
            amplitude=MODES[mode],
            harmonics=harmonics,
            n_times=N_TIMES,
        )[0]

    return np.array([[curve(mode, factor) for mode in MODES] for factor in factors])


def speed(reduced, system, harmonics):
    kind = "cubic_stiffness"
    factors = np.linspace(0.5, 1.5, N_SAMPLES)
    evaluators = [
        family_evaluator(system, (kind,), mode=mode, sensor=SENSOR, amplitude=amplitude, harmonics=harmonics)
        for mode, amplitude in MODES.items()
    ]
    coefficients = factors[:, np.newaxis] * COEFFICIENTS[kind]

    def together():
        return [evaluate(coefficients) for evaluate in evaluators]

    def one_by_one():
        return [[evaluate(row[np.newaxis]) for evaluate in evaluators] for row in coefficients]

    together()
    picked = np.linspace(0, N_SAMPLES - 1, N_PLAIN).astype(int)
    plain_s, reference = best_of(2, lambda: plain(reduced, kind, factors[picked], harmonics))
    before_mib = peak_mib()
    fast_s, families = best_of(N_REPEATS, together)
    single_s, _ = best_of(N_REPEATS, one_by_one)
    found = np.stack([family.frequency_hz[picked] for family in families], axis=1)
    plain_ms, fast_ms, single_ms = (
        1e3 * s / n for s, n in ((plain_s, N_PLAIN), (fast_s, N_SAMPLES), (single_s, N_SAMPLES))
    )
    print(
        f"harmonics {harmonics}: plain {plain_ms:.2f} ms an evaluation, condensed {fast_ms:.4f} ms "
        f"({plain_ms / fast_ms:.0f} times faster), one by one {single_ms:.4f} ms ({plain_ms / single_ms:.0f} times); "
        f"frequencies differ by {np.abs(found / reference - 1).max():.1e}; "
        f"converged {np.mean([family.converged.mean() for family in families]):.4f}; "
        f"{peak_mib() - before_mib:.0f} MiB more"
    )


def accuracy(system):
    for kind in COEFFICIENTS:
        for harmonics in ((1,), (1, 3), (1, 3, 5, 7, 9)):
            worst = 0.0
            for mode, amplitude in MODES.items():
                curve = backbone(
                    system, law_of(kind), mode=mode, sensor=SENSOR, amplitude=amplitude, harmonics=harmonics
                )
                motion = shoot(system, law_of(kind), curve, point=19)
                worst = max(worst, abs(curve.frequency_hz[19] / motion.frequency_hz - 1.0))
            print(f"{kind}, harmonics {harmonics}: frequency at the largest amplitude off by {worst:.1e}")


def slopes(harmonics):
    """Print time and error of the derivatives by two stiffness factors and by cubic and quintic terms of two pylons."""
    structure = wing_engine_structure()
    reduced = craig_bampton(structure, UPDATED)
    system, couplings = modes_of(reduced), find_couplings(structure, reduced)
    half = len(system.joints) // 2
    groups = (system.joints[:half], system.joints[half:])
    kinds = ("cubic_stiffness", "quintic_stiffness") * 2
    joints = (groups[0], groups[0], groups[1], groups[1])
    base = np.array([COEFFICIENTS["cubic_stiffness"], 1e12, 0.8 * COEFFICIENTS["cubic_stiffness"], 1.5e12])
    coefficients = np.linspace(0.5, 1.5, N_SAMPLES)[:, np.newaxis] * base

    def evaluators_of(system):
        return [
            family_evaluator(
                system, kinds, mode=mode, sensor=SENSOR, amplitude=amplitude, harmonics=harmonics, joints=joints
            )
            for mode, amplitude in MODES.items()
        ]

    evaluators = evaluators_of(system)

    def with_slopes():
        return [each.find_slopes(coefficients, each(coefficients), couplings)[0] for each in evaluators]

    with_slopes()
    alone_s, _ = best_of(N_REPEATS, lambda: [evaluate(coefficients) for evaluate in evaluators])
    whole_s, by_parameters = best_of(N_REPEATS, with_slopes)
    rows = [0, N_SAMPLES // 2, -1]
    worst, picked = [], coefficients[rows]

    def compare(found, up, down, change):
        numeric = (up.eigenvalue - down.eigenvalue) / (2 * change)
        worst.append(np.abs(found[rows] - numeric).max() / np.abs(numeric).max())

    for column in range(base.size):
        change = 1e-6 * picked[:, [column]]
        moved = change * np.eye(base.size)[column]
        for evaluate, found in zip(evaluators, by_parameters, strict=True):
            compare(found[..., column], evaluate(picked + moved), evaluate(picked - moved), change)
    for number, part in enumerate(structure.parts.values()):
        stiffness = reduced.basis.T @ (part @ reduced.basis)
        up, down = (
            evaluators_of(modes_of(replace(reduced, stiffness=reduced.stiffness + side * 1e-6 * stiffness)))
            for side in (1, -1)
        )
        for above, below, found in zip(up, down, by_parameters, strict=True):
            compare(found[..., base.size + number], above(picked), below(picked), 1e-6)
    print(
        f"harmonics {harmonics}: derivatives by 4 coefficients of two groups of joints and 2 stiffness factors: "
        f"{1e3 * whole_s / N_SAMPLES:.3f} ms with and {1e3 * alone_s / N_SAMPLES:.3f} ms without them, "
        f"{whole_s / alone_s:.2f} times the time; error against differences {max(worst):.1e}"
    )


def interaction():
    system = modes_of(craig_bampton(wing_engine_structure(WingEngine(leaf_asymmetry=0.05)), UPDATED))
    seconds, curve = cpu_seconds(
        lambda: continued_backbone(
            system,
            law_of("cubic_stiffness"),
            mode=7,
            sensor=SENSOR,
            first_amplitude_m=0.2e-3,
            last_amplitude_m=4e-3,
            harmonics=(1, 3, 5),
        )
    )
    turns = ", ".join(
        f"{curve.frequency_hz[k]:.3f} Hz at {1e3 * curve.amplitude[k]:.3f} mm" for k in curve.turning_points
    )
    print(f"3:1 interaction: {curve.amplitude.size} points in {seconds:.2f} s, turning at {turns}; {curve.reason}")


def main():
    reduced = craig_bampton(wing_engine_structure(), UPDATED)
    system = modes_of(reduced)
    print(
        f"{reduced.n_dof} degrees of freedom, modes at {system.frequency_hz[6]:.3f} and {system.frequency_hz[7]:.3f} Hz"
    )
    for harmonics in ((1,), (1, 3)):
        speed(reduced, system, harmonics)
        slopes(harmonics)
    accuracy(system)
    interaction()
    print(f"peak memory {peak_mib():.0f} MiB")


if __name__ == "__main__":
    main()
