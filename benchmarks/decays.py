"""Free decays with dry friction, and repeats with scatter: errors and intervals that hold, as a Markdown table.

Run `python benchmarks/decays.py --seeds 20`, about 6 minutes. Friction: 60 Hz, damping ratio 0.004, friction of 0.2 %
of the elastic force at the first amplitude, 1 % noise; then of 0.4 and 0.7 %, with which the decay is over after nine
and seven windows. Repeats: 12 decays of such a mode without friction, whose stiffness scatters by 0.14 % (0.042 Hz) and
whose damping by 3 % from one to the next; one set for five seeds.
"""

import os
import sys
from pathlib import Path

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np
from harness import seeds_parser, share, table_head, table_row
from made_decays import decay_with_friction, noisy_after_rest

from opid.modal.decay.free_decay import Decay, free_decay, pool_decays

FS, OMEGA, LEVEL, ZETA = 2048.0, 2.0 * np.pi * 60.0, 1e-3, 0.004
K0, C0 = OMEGA**2, 2.0 * ZETA * OMEGA
FRICTION = 0.002 * K0 * LEVEL
REPEATS, OF_STIFFNESS, OF_DAMPING = 12, 0.0014, 0.03


def follow(rng: np.random.Generator, k0: float, c0: float, friction: float) -> Decay:
    """Return one decay with 1 % noise."""
    signal = decay_with_friction(fs=FS, duration_s=3.0, k0=k0, c0=c0, friction=friction, amplitude=LEVEL)
    return free_decay(noisy_after_rest(signal, rng, 0.01), fs=FS)


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


if __name__ == "__main__":
    main()
