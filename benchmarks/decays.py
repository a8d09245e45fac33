"""Free decays with friction or a named joint, and repeats: errors and intervals that hold, as a Markdown table.

Run `python benchmarks/decays.py --seeds 20`, about 15 minutes. Friction: 60 Hz, damping ratio 0.004, friction of 0.2 %
of the elastic force at the first amplitude, 1 % noise; then of 0.4 and 0.7 %, with which the decay is over after nine
and seven windows. Repeats: 12 decays of such a mode without friction, whose stiffness scatters by 0.14 % (0.042 Hz) and
whose damping by 3 % from one to the next; one set for five seeds. Named joints: force, travel, viscous damping and the
other values of the joint are drawn anew for each seed; the kind is named; what is withheld is not told.
"""

import os
import sys
from pathlib import Path

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from harness import seeds_parser, share, table_head, table_row
from made_decays import (
    RUNG_FS,
    RUNG_LEVEL,
    RUNG_OMEGA,
    bolt,
    bolt_values,
    decay_with_friction,
    noisy_after_rest,
    ring_with_sliders,
    ring_with_state,
)

from opid.estimate import Estimate
from opid.mechanics.structure import Sliders
from opid.modal.decay.free_decay import Decay, free_decay, pool_decays

FS, OMEGA, LEVEL, ZETA = 2048.0, 2.0 * np.pi * 60.0, 1e-3, 0.004
K0, C0 = OMEGA**2, 2.0 * ZETA * OMEGA
FRICTION = 0.002 * K0 * LEVEL
REPEATS, OF_STIFFNESS, OF_DAMPING = 12, 0.0014, 0.03
JOINTS = {"jenkins": "iwan_friction", "iwan": "iwan_friction", "dahl": "dahl_friction", "bouc_wen": "bouc_wen"}


def follow(rng: np.random.Generator, k0: float, c0: float, friction: float) -> Decay:
    """Return one decay with 1 % noise."""
    signal = decay_with_friction(fs=FS, duration_s=3.0, k0=k0, c0=c0, friction=friction, amplitude=LEVEL)
    return free_decay(noisy_after_rest(signal, rng, 0.01), fs=FS, gain_tolerance=0.0)


def ring_with_joint(world: str, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float], float]:
    """Return an acceleration whose joint is drawn, the values of the joint, and the viscous damping."""
    k0 = RUNG_OMEGA**2
    c0 = 2.0 * RUNG_OMEGA * float(np.exp(rng.uniform(*np.log((0.001, 0.01)))))
    force = k0 * RUNG_LEVEL * float(np.exp(rng.uniform(*np.log((0.005, 0.04)))))
    travel = RUNG_LEVEL * float(np.exp(rng.uniform(*np.log((0.1, 0.5)))))
    truth = {"amplitude": force, "scale": travel}
    if world == "jenkins":
        return ring_with_sliders(Sliders([force / travel], [force]), c0=c0), truth, c0
    if world == "iwan":
        chi, beta = rng.uniform(-0.6, 0.0), rng.uniform(0.2, 1.0)
        stiffness = force / travel * (1.0 + beta) / (beta + (chi + 1.0) / (chi + 2.0))
        values = force, stiffness, chi, beta
        return ring_with_sliders(bolt(*values), c0=c0), bolt_values(*values), c0
    exponent = float(rng.uniform(1.0, 4.0)) if world == "bouc_wen" else 1.0
    signal = ring_with_state(world, force, travel, c0=c0, exponent=exponent)
    return signal, truth | ({"exponent": exponent} if world == "bouc_wen" else {}), c0


def print_named_joints(seeds: range) -> None:
    """Print rows of decays whose joint is of a kind that is named; withheld ones are not told."""
    for world, kind in JOINTS.items():
        pairs: dict[str, list[tuple[Estimate, float]]] = {}
        for seed in seeds:
            rng = np.random.default_rng([4, seed])
            signal, truth, c0 = ring_with_joint(world, rng)
            noisy = noisy_after_rest(signal, rng, 0.01)
            law = free_decay(noisy, fs=RUNG_FS, memory=kind, gain_tolerance=0.0).fitted
            found: dict[str, Estimate] = {}
            if law is not None:
                values = law.joint_estimates.list_values("", "")
                found = {name.split(".")[1]: each for name, each, _ in values} | {"viscous damping": law.damping[1]}
            for name, true in (truth | {"viscous damping": c0}).items():
                estimate = found.get(name, Estimate())
                # without an interval the value is a description and no answer
                pairs.setdefault(name, []).append((estimate if estimate.std else Estimate(), true))
        for name, each in pairs.items():
            print_row(f"{world}: {name}", each)


def print_row(label: str, pairs: list[tuple]) -> None:
    """Print the errors of estimates about their truth, and how many of the intervals hold."""
    given = [(estimate, true) for estimate, true in pairs if estimate.value is not None]
    errors = 100 * np.abs([estimate.value / true - 1.0 for estimate, true in given])
    held = share([estimate.holds(true) for estimate, true in given])
    rms = float(np.sqrt(np.mean(errors**2)))
    print(table_row(label, len(pairs), len(given), f"{rms:.3g} %", f"{errors.max():.3g} %", held))


def main() -> None:
    """Print the table."""
    seeds = range(seeds_parser(__doc__, seeds=20, what="decays with friction").parse_args().seeds)
    print(table_head("value", "seeds", "told", "rms error", "largest", "intervals hold"))
    decays = [follow(np.random.default_rng([1, seed]), K0, C0, FRICTION) for seed in seeds]
    laws = [decay.fitted for decay in decays if decay.fitted is not None]
    print_row("friction force", [(law.joint_estimates.friction, FRICTION) for law in laws])
    print_row("viscous damping beside it", [(law.damping[1], C0) for law in laws])
    print_row("frequency at zero amplitude beside it", [(law.frequency_low_hz, OMEGA / (2 * np.pi)) for law in laws])
    for fraction in (0.004, 0.007):
        force = fraction * K0 * LEVEL
        short = [follow(np.random.default_rng([3, seed]), K0, C0, force).fitted for seed in seeds]
        given = [law for law in short if law is not None]
        print_row(f"friction force, {100 * fraction:g} %", [(law.joint_estimates.friction, force) for law in given])
        print_row("viscous damping beside it", [(law.damping[1], C0) for law in given])
    pooled = []
    for seed in seeds[: max(len(seeds) // 5, 1)]:
        rng = np.random.default_rng([2, seed])
        spread = rng.normal(size=(REPEATS, 2)) * (OF_STIFFNESS, OF_DAMPING)
        pooled.append(pool_decays([follow(rng, K0 * (1 + k), C0 * (1 + c), 0.0) for k, c in spread]))
    print_row("12 repeats: frequency at zero", [(each.frequency_low_hz, OMEGA / (2 * np.pi)) for each in pooled])
    print_row("12 repeats: damping at zero", [(each.damping_low, ZETA) for each in pooled])
    print_named_joints(seeds)


if __name__ == "__main__":
    main()
