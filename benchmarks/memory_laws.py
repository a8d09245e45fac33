"""Gears whose friction remembers: which law is found, and how far the mass is off, as a Markdown table.

Run `python benchmarks/memory_laws.py --seeds 80 --jobs 2`. The gears, roads, rates and sensors are those of the row
"random" of `model_figures.py`. Their friction is Dahl's, LuGre with Stribeck, Bouc-Wen or an Iwan joint of 40 sliders,
one after the other; forces are 100 to 2000 N, presliding travels from a fiftieth of the rms travel to twice it. The law
is searched, by the paper's chain as well. No seed is dropped.
"""

import os
import time
from dataclasses import dataclass, replace

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from drawn_laws import Motion, log_uniform, typical_motion
from harness import Answer, compare, quantiles, run_all, seeds_parser, share, table_head, table_row
from paper_chain import CHAIN_HEAD, ChainErrors, chain_cells, chain_errors
from scenarios import random_case
from trials import Case, simulated, study_of

from opid import identify
from opid.mechanics.laws.law import LINEAR, law
from opid.mechanics.structure import iwan
from opid.virtual.taxi_tests.airframe import LandingGear

KINDS = ("dahl_friction", "lugre_friction", "bouc_wen", "iwan_friction")
# what is asked, and what is aimed at, in the columns of the table
ASKED = (
    "| asked (aim) | | 95 % (99 %) | | 0.1 / - / 0.6 (0.05 / - / 0.3) | 92 to 98 % (94 to 96 %) | | "
    "92 to 98 % (94 to 96 %) | | | 3 (1.5) | | |"
)


@dataclass(frozen=True)
class Job:
    """One gear."""

    seed: int

    @property
    def kind(self) -> str:
        return KINDS[self.seed % len(KINDS)]


@dataclass(frozen=True)
class Outcome:
    """What was found, in % of the truth.

    Args:
        job: the gear.
        law_name: that was found.
        mass: beside the truth.
        stiffness: K2, likewise.
        damping: C2, likewise.
        seconds: processor time.
        chain: errors of the mass by the paper's chain.
    """

    job: Job
    law_name: str
    mass: Answer
    stiffness: Answer
    damping: Answer
    seconds: float
    chain: ChainErrors


def with_memory(kind: str, gear: LandingGear, motion: Motion, rng: np.random.Generator) -> LandingGear:
    """Return the gear with friction of a kind, drawn."""
    force_n, travel_m = log_uniform(rng, 100, 2000), motion.travel_m
    if kind == "dahl_friction":
        friction = law(kind, amplitude_n=force_n, scale_m=travel_m * log_uniform(rng, 0.02, 0.5))
    elif kind == "lugre_friction":
        friction = law(
            kind,
            amplitude_n=force_n,
            scale_m=travel_m * log_uniform(rng, 0.02, 0.5),
            breakaway_ratio=rng.uniform(1.1, 1.6),
            stribeck_m_per_s=motion.rate_m_per_s * log_uniform(rng, 0.05, 0.5),
            bristle_lag_s=log_uniform(rng, 1e-4, 3e-3),
        )
    elif kind == "bouc_wen":
        friction = law(
            kind,
            amplitude_n=force_n,
            scale_m=travel_m * log_uniform(rng, 0.1, 1.0),
            exponent=rng.uniform(1.0, 4.0),
            shape=rng.uniform(0.3, 0.7),
        )
    else:
        chi, beta = rng.uniform(-0.7, 0.0), rng.uniform(0.0, 1.0)
        slip_m = travel_m * log_uniform(rng, 0.3, 2.0)
        stiffness = force_n * (1 + beta) / (slip_m * (beta + (chi + 1) / (chi + 2)))
        sliders = iwan(stiffness_n_per_m=stiffness, slip_force_n=force_n, chi=chi, beta=beta)
        return replace(gear, law=LINEAR, sliders=sliders)
    return replace(gear, law=friction)


def memory_case(seed: int) -> Case:
    """Return the gear of a seed."""
    case = random_case(seed, draw_law=lambda rng: LINEAR, stream=5)
    motion = typical_motion(case.gear, road_class=case.run["road_class"])
    gear = with_memory(KINDS[seed % len(KINDS)], case.gear, motion, np.random.default_rng([seed, 6]))
    # the presliding of the shortest travels needs steps shorter than usual
    return replace(case, gear=gear, run={**case.run, "lowest_step_rate_hz": 32768.0})


def run(job: Job) -> Outcome:
    """Simulate and identify."""
    case = memory_case(job.seed)
    study = study_of(simulated(case, job.seed))
    began = time.process_time()
    found = identify(study)
    seconds = time.process_time() - began
    told, gear = found.parameters, case.gear
    return Outcome(
        job,
        found.law.name,
        compare(told.sprung_mass_kg, gear.sprung_mass_kg),
        compare(told.suspension_stiffness_n_per_m, gear.suspension_stiffness_n_per_m),
        compare(told.suspension_damping_n_s_per_m, gear.suspension_damping_n_s_per_m),
        seconds,
        chain_errors(gear, study),
    )


def describe(each: Outcome) -> str:
    """Return what is printed of one gear."""
    return (
        f"{each.job.seed} {each.job.kind}: {each.law_name}, mass {each.mass.error:+.3f} +- {each.mass.std:.3f} %, "
        f"K2 {each.stiffness.error:+.2f} %, C2 {each.damping.error:+.2f} %, {each.seconds:.1f} s; "
        f"the paper's chain {each.chain.mended:+.2f} %"
    )


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each kind, and one for all."""
    titles = ("friction", "gears", "answered", "kind found", "mass, median / 95th percentile / worst, %")
    titles += ("intervals that hold", "K2, median / worst, %", "intervals that hold", "C2, median / worst, %")
    print("\n" + table_head(*titles, "intervals that hold", "s, median", CHAIN_HEAD))
    print(ASKED)
    for kind in (*KINDS, "all"):
        own = [each for each in outcomes if kind in (each.job.kind, "all")]
        if not own:
            continue
        cells = [
            kind,
            len(own),
            sum(np.isfinite(each.mass.error) for each in own),
            sum(each.job.kind in each.law_name.split("+") for each in own),
        ]
        for name, fractions in (("mass", (0.5, 0.95, 1.0)), ("stiffness", (0.5, 1.0)), ("damping", (0.5, 1.0))):
            answers = [getattr(each, name) for each in own]
            cells += [quantiles([each.error for each in answers], *fractions), share(each.holds for each in answers)]
        cells += [f"{np.median([each.seconds for each in own]):.1f}", chain_cells([each.chain for each in own])]
        print(table_row(*cells))


def main() -> None:
    parser = seeds_parser(__doc__, seeds=80, what="gears")
    parser.add_argument("--kind", choices=KINDS, help="the gears of one kind alone")
    given = parser.parse_args()
    jobs = [job for job in map(Job, range(given.first, given.seeds)) if given.kind in (None, job.kind)]
    print_table(run_all(run, jobs, describe, processes=given.jobs))


if __name__ == "__main__":
    main()
