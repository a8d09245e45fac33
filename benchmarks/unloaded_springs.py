"""Springs about their unloaded length: which law is found, and how far the mass is off, as a Markdown table.

Run `python benchmarks/unloaded_springs.py --seeds 40`. Each seed draws a strut that carries its body on a straight
spring and a cubic or softening one beside it, both about the unloaded length: the static deflection is 20 to 50 mm, of
which the law carries 20 to 60 %. Two runs of 40 s at 512 Hz, 12 % less mass in the second, 5 mm/s^2 of noise.
"""

import argparse
import os
import time
from dataclasses import replace

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np

from opid import identify
from opid.mechanics.landing_gear import LandingGear, taxi_test
from opid.mechanics.laws import law
from opid.mechanics.weight import GRAVITY_M_PER_S2
from opid.suspensions.study import Run, study_of_gear

KINDS = ("cubic_stiffness", "arctan_displacement")


def random_strut(seed: int) -> LandingGear:
    """Return a gear whose springs are about their unloaded length."""
    rng, usual = np.random.default_rng([77, seed]), LandingGear()
    mass = usual.sprung_mass_kg * float(np.exp(rng.uniform(-0.3, 0.3)))
    deflection, fraction = rng.uniform(0.02, 0.05), rng.uniform(0.2, 0.6)
    carried = fraction * mass * GRAVITY_M_PER_S2
    if KINDS[seed % len(KINDS)] == "cubic_stiffness":
        spring = law("cubic_stiffness", stiffness_n_per_m3=carried / deflection**3)
    else:
        scale = deflection * rng.uniform(0.3, 1.0)
        amplitude = carried / (2 / np.pi * np.arctan(deflection / scale))
        spring = law("arctan_displacement", amplitude_n=amplitude, scale_m=scale)
    return replace(
        usual,
        sprung_mass_kg=mass,
        suspension_stiffness_n_per_m=(1 - fraction) * mass * GRAVITY_M_PER_S2 / deflection,
        law=spring.resting_at(-deflection),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40, help="struts, counted from 0")
    seeds = range(parser.parse_args().seeds)
    rows: dict[str, list[tuple[bool, float, float, float, float]]] = {kind: [] for kind in KINDS}
    for seed in seeds:
        gear = random_strut(seed)
        test = taxi_test(gear, rng=np.random.default_rng([78, seed]), mass_removed_kg=0.12 * gear.sprung_mass_kg)
        runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
        began = time.process_time()
        found = identify(study_of_gear("strut", sprung="upper_z", unsprung="lower_z", runs=runs))
        spent, mass = time.process_time() - began, found.parameters.sprung_mass_kg
        stiffness = found.interfaces[0].at_rest[0].stiffness
        true = gear.suspension_stiffness_n_per_m + float(gear.law.gradient(0.0, 0.0)[0])
        error = np.nan if mass.value is None else 100 * (mass.value / gear.sprung_mass_kg - 1)
        std = np.nan if mass.std is None else 100 * mass.std / gear.sprung_mass_kg
        tangent = np.nan if stiffness.value is None else 100 * (stiffness.value / true - 1)
        rows[KINDS[seed % len(KINDS)]].append((found.law.name == gear.law.name, error, std, tangent, spent))
        print(f"{seed} {gear.law.name}: {found.law.name}, mass {error:+.3f} +- {std:.3f} %", flush=True)
    print("\n| law | right | mass, median / worst | in units of its std, rms | tangent stiffness, median / worst | s |")
    print("|---|---|---|---|---|---|")
    for kind, row in rows.items():
        right, error, std, tangent, spent = (np.array(column) for column in zip(*row, strict=True))
        given = np.isfinite(error)
        normal = np.sqrt(np.mean((error / std)[given] ** 2))
        off, stiff = np.abs(error[given]), np.abs(tangent[given])
        print(
            f"| {kind} | {right.sum():.0f} of {right.size} | {np.median(off):.2f} / {off.max():.2f} % of {off.size} | "
            f"{normal:.2f} | {np.median(stiff):.2f} / {stiff.max():.2f} % | {np.median(spent):.1f} |"
        )


if __name__ == "__main__":
    main()
