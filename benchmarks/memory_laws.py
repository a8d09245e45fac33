"""Gears whose friction remembers: which law is found, and how far the mass is off, as a Markdown table.

Run `python benchmarks/memory_laws.py --seeds 80 --jobs 2`. The gears, roads, rates and sensors are those of the row
"random" of `model_figures.py`. Their friction is Dahl's, LuGre with Stribeck, Bouc-Wen or an Iwan joint of 40 sliders,
one after the other; forces are 100 to 2000 N, presliding travels from a fiftieth of the rms travel to twice it. The law
is searched, by the paper's chain as well. No seed is dropped.
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from drawn_laws import Motion, log_uniform, typical_motion
from model_figures import short
from paper_chain import CHAIN_HEAD, ChainErrors, chain_cells, chain_errors
from scenarios import random_case
from trials import Case, simulated, study_of

from opid import Estimate, identify
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
    """What was found: errors and standard deviations in %, NaN where none was given.

    Args:
        job: the gear.
        law_name: that was found.
        error: of the mass.
        std: of the mass.
        holds: whether the interval of the mass holds the truth; None where there is none.
        stiffness: error of K2.
        stiffness_holds: whether its interval holds the truth; None where there is none.
        damping: error of C2.
        damping_holds: whether its interval holds the truth; None where there is none.
        seconds: processor time.
        chain: errors of the mass by the paper's chain.
    """

    job: Job
    law_name: str
    error: float
    std: float
    holds: bool | None
    stiffness: float
    stiffness_holds: bool | None
    damping: float
    damping_holds: bool | None
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
    mass, mass_holds = _error(told.sprung_mass_kg, gear.sprung_mass_kg)
    std = np.nan if told.sprung_mass_kg.std is None else 100 * told.sprung_mass_kg.std / gear.sprung_mass_kg
    stiffness = _error(told.suspension_stiffness_n_per_m, gear.suspension_stiffness_n_per_m)
    damping = _error(told.suspension_damping_n_s_per_m, gear.suspension_damping_n_s_per_m)
    chain = chain_errors(gear, study)
    return Outcome(job, found.law.name, mass, std, mass_holds, *stiffness, *damping, seconds, chain)


def _error(estimate: Estimate, true: float) -> tuple[float, bool | None]:
    """Error in %, NaN where nothing was told, and whether the interval holds the truth; None where there is none."""
    error = np.nan if estimate.value is None else 100 * (estimate.value / true - 1)
    return error, None if estimate.interval95 is None else estimate.holds(true)


def _cells(errors: list[float], holds: list[bool | None]) -> str:
    """Median and worst error, and how many intervals hold."""
    off = np.abs([each for each in errors if np.isfinite(each)] or [np.nan])
    told = [each for each in holds if each is not None]
    return f"{short(float(np.median(off)))} / {short(float(off.max()))} | {sum(told)} of {len(told)}"


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each kind, and one for all."""
    print(
        "\n| friction | gears | answered | kind found | mass, median / 95th percentile / worst, % | "
        "intervals that hold | K2, median / worst, % | intervals that hold | C2, median / worst, % | "
        f"intervals that hold | s, median | {CHAIN_HEAD} |"
    )
    print("|---" * 13 + "|")
    print(ASKED)
    for kind in (*KINDS, "all"):
        own = [each for each in outcomes if kind in (each.job.kind, "all")]
        if not own:
            continue
        given = [each for each in own if np.isfinite(each.error)]
        right = sum(each.job.kind in each.law_name.split("+") for each in own)
        off = np.abs([each.error for each in given]) if given else np.array([np.nan])
        quantiles = " / ".join(short(float(np.quantile(off, each))) for each in (0.5, 0.95, 1.0))
        told = [each.holds for each in own if each.holds is not None]
        stiffness = _cells([each.stiffness for each in own], [each.stiffness_holds for each in own])
        damping = _cells([each.damping for each in own], [each.damping_holds for each in own])
        print(
            f"| {kind} | {len(own)} | {len(given)} | {right} | {quantiles} | {sum(told)} of {len(told)} | "
            f"{stiffness} | {damping} | "
            f"{np.median([each.seconds for each in own]):.1f} | {chain_cells([each.chain for each in own])} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=80, help="gears, counted from 0")
    parser.add_argument("--first", type=int, default=0, help="the first of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--kind", choices=KINDS, help="the gears of one kind alone")
    given = parser.parse_args()
    jobs = [job for job in map(Job, range(given.first, given.seeds)) if given.kind in (None, job.kind)]
    outcomes = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for each in pool.map(run, jobs):
            outcomes.append(each)
            print(
                f"{each.job.seed} {each.job.kind}: {each.law_name}, mass {each.error:+.3f} +- {each.std:.3f} %, "
                f"K2 {each.stiffness:+.2f} %, C2 {each.damping:+.2f} %, {each.seconds:.1f} s; "
                f"the paper's chain {each.chain.mended:+.2f} %",
                flush=True,
            )
    print_table(outcomes)


if __name__ == "__main__":
    main()
