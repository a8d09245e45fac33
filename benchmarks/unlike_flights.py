"""Two flights that are not alike: how far the mass is off, and how many intervals hold, as a Markdown table.

Run `python benchmarks/unlike_flights.py --seeds 200 --jobs 2`. The gears are those of the row "random"
of `model_figures.py`; the strut of each run departs from the drawn one as the row says: springs, damping and friction
each by a normal factor of its own. The law is searched, or given with `--law given`; the repeatability is left to its
usual value, or taken for zero whatever the runs say ("same strut"), as the package did before. No seed is dropped.
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from model_figures import short
from scenarios import random_case

from opid import identify
from opid.mechanics.repeatability import Departure
from opid.suspensions.settings import RepeatabilitySettings, Settings
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.taxiing import taxi_test

# relative standard deviations of springs, damping and friction of each run
WORLDS = {
    "alike": (0.0, 0.0, 0.0),
    "each 1 %": (0.01, 0.01, 0.01),
    "each 2 %": (0.02, 0.02, 0.02),
    "springs 1 %": (0.01, 0.0, 0.0),
    "damping 1 %": (0.0, 0.01, 0.0),
    "friction 1 %": (0.0, 0.0, 0.01),
    "each 0.1 %": (0.001, 0.001, 0.001),
}


@dataclass(frozen=True)
class Job:
    """One gear in one world."""

    world: str
    seed: int
    law_is_given: bool


@dataclass(frozen=True)
class Outcome:
    """What was found: errors and half widths of the intervals in % of the mass, NaN where none was given."""

    job: Job
    error: float
    half_width: float
    holds: bool | None
    error_if_same: float
    half_width_if_same: float
    holds_if_same: bool | None
    n_forces: int


def run(job: Job) -> Outcome:
    """Simulate and identify."""
    case, rng = random_case(job.seed), np.random.default_rng([91, job.seed])
    drawn = np.array(WORLDS[job.world]) * rng.standard_normal((2, 3))
    departures = Departure(*drawn[0].tolist()), Departure(*drawn[1].tolist())
    settings = dict(case.run)
    test = taxi_test(
        case.gear,
        rng=np.random.default_rng([92, job.seed]),
        mass_removed_kg=case.mass_removed_kg,
        departures=departures,
        **settings,
    )
    runs = (Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))
    law, found = case.gear.law.name if job.law_is_given else None, []
    # the same strut is taken for granted whatever the runs say of it
    granted = Settings(repeatability=RepeatabilitySettings(bic_margin=np.inf))
    for repeatability, settings_of in ((None, None), (0.0, granted)):
        study = study_of_gear("gear", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=repeatability)
        result = identify(study, law=law, settings=settings_of)
        mass, true = result.parameters.sprung_mass_kg, case.gear.sprung_mass_kg
        error = np.nan if mass.value is None else 100 * (mass.value / true - 1)
        ends = mass.interval95
        half_width = np.nan if ends is None else 50 * (ends[1] - ends[0]) / true
        found.append((error, half_width, None if ends is None else mass.holds(true)))
    (error, wide, holds), (error_same, wide_same, holds_same) = found
    n_forces = 2 + any(term.kind.is_friction for term in case.gear.law.terms)
    return Outcome(job, error, wide, holds, error_same, wide_same, holds_same, n_forces)


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each world."""
    print(
        "| flights | gears | mass, median / 95th percentile / worst, % | intervals that hold | half width, median, % | "
        "same strut taken for granted: mass | intervals that hold | half width |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for world in WORLDS:
        for n_forces, words in ((0, "all"), (3, "with friction"), (2, "without")):
            own = [each for each in outcomes if each.job.world == world and n_forces in (0, each.n_forces)]
            if not own:
                continue
            usual = _told([(each.error, each.half_width, each.holds) for each in own])
            same = _told([(each.error_if_same, each.half_width_if_same, each.holds_if_same) for each in own])
            print(f"| {world} | {words}, {len(own)} | {usual} | {same} |")


def _told(found: list[tuple[float, float, bool | None]]) -> str:
    error, wide, holds = zip(*found, strict=True)
    given, told = np.abs([each for each in error if np.isfinite(each)]), [each for each in holds if each is not None]
    if not given.size:
        return "- | - | -"
    quantiles = " / ".join(short(float(np.quantile(given, each))) for each in (0.5, 0.95, 1.0))
    missing = f" ({len(error) - given.size} without)" if given.size < len(error) else ""
    held = f"{sum(told)} of {len(told)}" + (f" ({100 * np.mean(told):.1f} %)" if told else "")
    return f"{quantiles}{missing} | {held} | {short(float(np.nanmedian(wide)))}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=40, help="gears, counted from 0")
    parser.add_argument("--worlds", default=",".join(WORLDS), help="names joined by commas")
    parser.add_argument("--law", choices=("given", "searched"), default="searched")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    worlds = options.worlds.split(",")
    unknown = set(worlds) - set(WORLDS)
    if unknown:
        parser.error(f"there is no world {', '.join(sorted(unknown))}: give some of {', '.join(WORLDS)}")
    jobs = [Job(world, seed, options.law == "given") for world in worlds for seed in range(options.seeds)]
    with ProcessPoolExecutor(options.jobs) as pool:
        print_table(list(pool.map(run, jobs)))


if __name__ == "__main__":
    main()
