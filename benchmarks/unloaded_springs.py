"""Springs about their unloaded length: which law is found, and how far the mass is off, as a Markdown table.

Run `python benchmarks/unloaded_springs.py --seeds 60 --repeatability 0`. Each seed draws a strut that carries its body
on a straight spring and a cubic or softening one beside it, both about the unloaded length: the static deflection is 20
to 50 mm, of which the law carries 20 to 60 %. Two runs of 40 s at 512 Hz, 12 % less mass in the second, 5 mm/s^2 of
noise. The strut is the same in both; with the usual repeatability the answer does not rely on that. Gas, a third kind
of such a spring, has the strut of `oleo_struts.py`.
"""

import os
import time
from dataclasses import dataclass, replace

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import Answer, compare, run_all, seeds_parser, share, table_head, table_row
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
    """What was found, in % of the truth; the tangent stiffness is that at rest in the first run."""

    job: Job
    law_name: str
    is_right: bool
    mass: Answer
    tangent: Answer
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
    true = gear.suspension_stiffness_n_per_m + float(gear.law.gradient(0.0, 0.0)[0])
    return Outcome(
        job,
        found.law.name,
        found.law.name == gear.law.name,
        compare(found.parameters.sprung_mass_kg, gear.sprung_mass_kg),
        compare(found.interfaces[0].at_rest[0].stiffness, true),
        seconds,
        chain_errors(gear, study),
    )


def describe(each: Outcome) -> str:
    """Return what is printed of one strut."""
    return (
        f"{each.job.seed} {each.job.kind}: {each.law_name}, mass {each.mass.error:+.3f} +- {each.mass.std:.3f} %, "
        f"tangent {each.tangent.error:+.3f} %, {each.seconds:.1f} s; "
        f"the paper's chain {each.chain.mended:+.2f} %"
    )


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each kind."""
    titles = ("law", "right", "mass, median / worst", "in units of its std, rms", "intervals that hold")
    print("\n" + table_head(*titles, "tangent stiffness, median / worst", "s, median", CHAIN_HEAD))
    print(ASKED)
    for kind in KINDS:
        own = [each for each in outcomes if each.job.kind == kind]
        if not own:
            continue
        error, std, tangent = np.array([(each.mass.error, each.mass.std, each.tangent.error) for each in own]).T
        given = np.isfinite(error)
        off, stiff = np.abs(error[given]), np.abs(tangent[given])
        cells = (
            kind,
            share(each.is_right for each in own),
            f"{np.median(off):.2f} / {off.max():.2f} % of {off.size}",
            f"{np.sqrt(np.mean((error / std)[given] ** 2)):.2f}",
            share(each.mass.holds for each in own),
            f"{np.median(stiff):.2f} / {stiff.max():.2f} %",
            f"{np.median([each.seconds for each in own]):.1f}",
            chain_cells([each.chain for each in own]),
        )
        print(table_row(*cells))


def main() -> None:
    parser = seeds_parser(__doc__, seeds=60, what="struts")
    parser.add_argument("--repeatability", type=float, help="that is stated; what is usual where left out")
    given = parser.parse_args()
    jobs = [Job(seed, given.repeatability) for seed in range(given.first, given.seeds)]
    print_table(run_all(run, jobs, describe, processes=given.jobs))


if __name__ == "__main__":
    main()
