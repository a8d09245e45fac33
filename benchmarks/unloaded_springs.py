"""Springs about their unloaded length: which law is found, and how far the mass is off, as a Markdown table.

Run `python benchmarks/unloaded_springs.py --seeds 60 --repeatability 0`. Each seed draws a strut that carries its body
on a straight spring and a cubic or softening one beside it, both about the unloaded length: the static deflection is 20
to 50 mm, of which the law carries 20 to 60 %. Two runs of 40 s at 512 Hz, 12 % less mass in the second, 5 mm/s^2 of
noise. The strut is the same in both; with the usual repeatability the answer does not rely on that. Gas, a third kind
of such a spring, has the strut of `oleo_struts.py`.
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from paper_chain import CHAIN_HEAD, ChainErrors, chain_cells, chain_errors

from opid import identify
from opid.mechanics.laws.law import law
from opid.mechanics.weight import GRAVITY_M_PER_S2
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

KINDS = ("cubic_stiffness", "arctan_displacement")
# what is asked, and what is aimed at, in the columns of the table
ASKED = "| asked (aim) | | 0.1 / 0.6 % (0.05 / 0.3 %) | | 92 to 98 % (94 to 96 %) | | | | |"


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


@dataclass(frozen=True)
class Job:
    """One strut, and the repeatability that is stated; None for what is usual."""

    seed: int
    repeatability: float | None

    @property
    def kind(self) -> str:
        return KINDS[self.seed % len(KINDS)]


@dataclass(frozen=True)
class Outcome:
    """What was found: errors and standard deviations in %, NaN where none was given."""

    job: Job
    law_name: str
    is_right: bool
    error: float
    std: float
    holds: bool | None
    tangent_error: float
    seconds: float
    chain: ChainErrors


def run(job: Job) -> Outcome:
    """Simulate and identify."""
    gear = random_strut(job.seed)
    test = taxi_test(gear, rng=np.random.default_rng([78, job.seed]), mass_removed_kg=0.12 * gear.sprung_mass_kg)
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    study = study_of_gear("strut", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=job.repeatability)
    began = time.process_time()
    found = identify(study)
    seconds = time.process_time() - began
    mass, stiffness = found.parameters.sprung_mass_kg, found.interfaces[0].at_rest[0].stiffness
    true = gear.suspension_stiffness_n_per_m + float(gear.law.gradient(0.0, 0.0)[0])
    error = np.nan if mass.value is None else 100 * (mass.value / gear.sprung_mass_kg - 1)
    std = np.nan if mass.std is None else 100 * mass.std / gear.sprung_mass_kg
    tangent = np.nan if stiffness.value is None else 100 * (stiffness.value / true - 1)
    holds = None if mass.interval95 is None else mass.holds(gear.sprung_mass_kg)
    is_right, chain = found.law.name == gear.law.name, chain_errors(gear, study)
    return Outcome(job, found.law.name, is_right, error, std, holds, tangent, seconds, chain)


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each kind."""
    print(
        "\n| law | right | mass, median / worst | in units of its std, rms | intervals that hold | "
        f"tangent stiffness, median / worst | s, median | {CHAIN_HEAD} |"
    )
    print("|---" * 9 + "|")
    print(ASKED)
    for kind in KINDS:
        own = [each for each in outcomes if each.job.kind == kind]
        if not own:
            continue
        error, std = np.array([each.error for each in own]), np.array([each.std for each in own])
        given = np.isfinite(error)
        normal = np.sqrt(np.mean((error / std)[given] ** 2))
        off, stiff = np.abs(error[given]), np.abs(np.array([each.tangent_error for each in own])[given])
        told = [each.holds for each in own if each.holds is not None]
        print(
            f"| {kind} | {sum(each.is_right for each in own)} of {len(own)} | "
            f"{np.median(off):.2f} / {off.max():.2f} % of {off.size} | {normal:.2f} | {sum(told)} of {len(told)} | "
            f"{np.median(stiff):.2f} / {stiff.max():.2f} % | {np.median([each.seconds for each in own]):.1f} | "
            f"{chain_cells([each.chain for each in own])} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=60, help="struts, counted from 0")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--repeatability", type=float, help="that is stated; what is usual where left out")
    given = parser.parse_args()
    jobs = [Job(seed, given.repeatability) for seed in range(given.first, given.seeds)]
    outcomes = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for each in pool.map(run, jobs):
            outcomes.append(each)
            print(
                f"{each.job.seed} {each.job.kind}: {each.law_name}, mass {each.error:+.3f} +- {each.std:.3f} %, "
                f"tangent {each.tangent_error:+.3f} %, {each.seconds:.1f} s; "
                f"the paper's chain {each.chain.mended:+.2f} %",
                flush=True,
            )
    print_table(outcomes)


if __name__ == "__main__":
    main()
