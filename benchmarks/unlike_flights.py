"""Flights that are not alike: how far the mass is off, and how many intervals hold, as a Markdown table.

Run `python benchmarks/unlike_flights.py --seeds 200 --jobs 2`. The gears are those of the row "random"
of `model_figures.py`; the strut of each run departs from the drawn one as the row says: springs, damping and friction
each by a normal factor of its own. The law is searched, or given with `--law given`; the repeatability is left to its
usual value, or taken for zero whatever the runs say ("same strut"), as the package did before. No seed is dropped.

Two runs fly two masses; with `--runs 3` the first mass is flown again, with 4 the second, too. Runs of a seed that are
there with fewer, too, are the same. "Inferred" is the median repeatability of the runs as they tell it, beside the
stated one. "Times as wide" is the half width of the interval over that where the same strut is taken for granted, gear
by gear: what the honesty costs where the flights are alike (`--worlds alike`).
"""

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from model_figures import short
from paper_chain import CHAIN_HEAD, ChainErrors, chain_cells, chain_errors
from scenarios import random_case

from opid import identify
from opid.mechanics.repeatability import Departure
from opid.suspensions.settings import RepeatabilitySettings, Settings
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import Loading
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
# what is asked, and what is aimed at, in the columns of the table
ASKED = "| asked (aim) | | | 92 to 98 % (94 to 96 %) | | as drawn | | | | alike, with friction: 2 (1.3) | | |"


@dataclass(frozen=True)
class Job:
    """One gear in one world."""

    world: str
    seed: int
    law_is_given: bool
    n_runs: int = 2


@dataclass(frozen=True)
class Outcome:
    """What was found: errors and half widths of the intervals in % of the mass, NaN where none was given.

    Args:
        job: the gear and its world.
        error: of the mass.
        half_width: of its interval.
        holds: whether the interval holds the truth; None where there is none.
        error_if_same: as `error`, the same strut taken for granted; so are the two after it.
        half_width_if_same: as `half_width`.
        holds_if_same: as `holds`.
        n_forces: parts of the strut that may differ: springs and damping, and friction where it has some.
        stated: repeatability beforehand, %.
        inferred: as the runs tell it, %; NaN where they were fitted as alike.
        chain: errors of the mass by the paper's chain.
    """

    job: Job
    error: float
    half_width: float
    holds: bool | None
    error_if_same: float
    half_width_if_same: float
    holds_if_same: bool | None
    n_forces: int
    stated: float
    inferred: float
    chain: ChainErrors


def run(job: Job) -> Outcome:
    """Simulate and identify."""
    case, rng = random_case(job.seed), np.random.default_rng([91, job.seed])
    drawn = np.array(WORLDS[job.world]) * rng.standard_normal((job.n_runs, 3))
    departures = [Departure(*each) for each in drawn.tolist()]
    airframe = case.gear.airframe
    off = [Loading(-case.mass_removed_kg, airframe.x_cg_m, airframe.y_cg_m)]
    test = taxi_test(
        case.gear,
        rng=np.random.default_rng([92, job.seed]),
        # the first mass is that of the gear; then the other one, and the two in turn
        loadings=[off if index % 2 else [] for index in range(1, job.n_runs)],
        departures=departures,
        **dict(case.run),
    )
    runs = tuple(
        Run(f"{'light' if index % 2 else 'heavy'} {index}", each.recording, test.mass_change_kg if index % 2 else 0.0)
        for index, each in enumerate(test.runs)
    )
    law, found = case.gear.law.name if job.law_is_given else None, []
    levels = []
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
        levels.append(result.evidence[0].repeatability)
    (error, wide, holds), (error_same, wide_same, holds_same) = found
    n_forces = 2 + any(term.kind.is_friction for term in case.gear.law.terms)
    usual = levels[0]
    inferred = np.nan if usual.estimated is None else 100 * usual.estimated
    chain = chain_errors(case.gear, study, law=law)
    return Outcome(
        job,
        error,
        wide,
        holds,
        error_same,
        wide_same,
        holds_same,
        n_forces,
        100 * usual.stated,
        inferred,
        chain,
    )


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each world."""
    print(
        "\n| flights | gears | mass, median / 95th percentile / worst, % | intervals that hold | "
        "half width, median, % | repeatability inferred, median (10 to 90 % of gears), % | "
        "same strut taken for granted: mass | "
        f"intervals that hold | half width | times as wide, median / worst | {CHAIN_HEAD} |"
    )
    print("|---" * 12 + "|")
    print(ASKED)
    for world in WORLDS:
        for n_forces, words in ((0, "all"), (3, "with friction"), (2, "without")):
            own = [each for each in outcomes if each.job.world == world and n_forces in (0, each.n_forces)]
            if not own:
                continue
            usual = _told([(each.error, each.half_width, each.holds) for each in own])
            same = _told([(each.error_if_same, each.half_width_if_same, each.holds_if_same) for each in own])
            ratios = np.array([each.half_width / each.half_width_if_same for each in own])
            ratios = ratios[np.isfinite(ratios)]
            times = f"{np.median(ratios):.1f} / {ratios.max():.1f} of {ratios.size}" if ratios.size else "-"
            chain = chain_cells([each.chain for each in own])
            cells = (f"{words}, {len(own)}", usual, _inferred(own), same, times, chain)
            print(f"| {world} | {' | '.join(cells)} |")


def _inferred(own: list[Outcome]) -> str:
    """The repeatability that the runs tell, beside the stated one."""
    told, (stated,) = [each.inferred for each in own if np.isfinite(each.inferred)], {each.stated for each in own}
    if not told:
        return f"- (stated {stated:g})"
    low, middle, high = (short(float(each)) for each in np.quantile(told, (0.1, 0.5, 0.9)))
    return f"{middle} ({low} to {high}) of {len(told)}, stated {stated:g}"


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
    parser.add_argument("--runs", type=int, choices=(2, 3, 4), default=2, help="of each gear, two masses in turn")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    worlds = options.worlds.split(",")
    unknown = set(worlds) - set(WORLDS)
    if unknown:
        parser.error(f"there is no world {', '.join(sorted(unknown))}: give some of {', '.join(WORLDS)}")
    law_is_given = options.law == "given"
    jobs = [Job(world, seed, law_is_given, options.runs) for world in worlds for seed in range(options.seeds)]
    outcomes = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for each in pool.map(run, jobs):
            outcomes.append(each)
            print(
                f"{each.job.world}, {each.job.seed}: mass {each.error:+.3f} % (half of its 95 % interval: "
                f"{each.half_width:.3f} %), repeatability {each.inferred:.3g} % (stated {each.stated:g}); "
                f"same strut {each.error_if_same:+.3f} % ({each.half_width_if_same:.3f} %); "
                f"the paper's chain {each.chain.mended:+.2f} %",
                flush=True,
            )
    print_table(outcomes)


if __name__ == "__main__":
    main()
