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

import os
from dataclasses import dataclass

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import Answer, compare, quantiles, read_names, run_all, seeds_parser, share, short, table_head, table_row
from paper_chain import CHAIN_HEAD, ChainErrors, chain_cells, chain_errors
from scenarios import random_case

from opid import identify
from opid.mechanics.repeatability import Departure
from opid.suspensions.settings import RepeatabilitySettings, Settings
from opid.suspensions.study import PointMass, Run, study_of_gear
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
    """What was found, in % of the mass.

    Args:
        job: the gear and its world.
        mass: beside the truth.
        mass_if_same: likewise, the same strut taken for granted.
        n_forces: parts of the strut that may differ: springs and damping, and friction where it has some.
        stated: repeatability beforehand, %.
        inferred: as the runs tell it, %; NaN where they were fitted as alike.
        chain: errors of the mass by the paper's chain.
    """

    job: Job
    mass: Answer
    mass_if_same: Answer
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
    off = [PointMass(-case.mass_removed_kg, airframe.x_cg_m, airframe.y_cg_m)]
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
        found.append(compare(result.parameters.sprung_mass_kg, case.gear.sprung_mass_kg))
        levels.append(result.evidence[0].repeatability)
    n_forces = 2 + any(term.kind.is_friction for term in case.gear.law.terms)
    usual = levels[0]
    inferred = np.nan if usual.estimated is None else 100 * usual.estimated
    chain = chain_errors(case.gear, study, law=law)
    return Outcome(job, *found, n_forces, 100 * usual.stated, inferred, chain)


def describe(each: Outcome) -> str:
    """Return what is printed of one gear."""
    return (
        f"{each.job.world}, {each.job.seed}: mass {each.mass.error:+.3f} % (half of its 95 % interval: "
        f"{each.mass.half_width:.3f} %), repeatability {each.inferred:.3g} % (stated {each.stated:g}); "
        f"same strut {each.mass_if_same.error:+.3f} % ({each.mass_if_same.half_width:.3f} %); "
        f"the paper's chain {each.chain.mended:+.2f} %"
    )


def print_table(outcomes: list[Outcome]) -> None:
    """Print a row for each world."""
    titles = ("flights", "gears", "mass, median / 95th percentile / worst, %", "intervals that hold")
    titles += ("half width, median, %", "repeatability inferred, median (10 to 90 % of gears), %")
    titles += ("same strut taken for granted: mass", "intervals that hold", "half width")
    print("\n" + table_head(*titles, "times as wide, median / worst", CHAIN_HEAD))
    print(ASKED)
    for world in WORLDS:
        for n_forces, words in ((0, "all"), (3, "with friction"), (2, "without")):
            own = [each for each in outcomes if each.job.world == world and n_forces in (0, each.n_forces)]
            if not own:
                continue
            usual, same = _told([each.mass for each in own]), _told([each.mass_if_same for each in own])
            ratios = np.array([each.mass.half_width / each.mass_if_same.half_width for each in own])
            ratios = ratios[np.isfinite(ratios)]
            times = f"{np.median(ratios):.1f} / {ratios.max():.1f} of {ratios.size}" if ratios.size else "-"
            chain = chain_cells([each.chain for each in own])
            cells = (f"{words}, {len(own)}", usual, _inferred(own), same, times, chain)
            print(table_row(world, *cells))


def _inferred(own: list[Outcome]) -> str:
    """The repeatability that the runs tell, beside the stated one."""
    told, (stated,) = [each.inferred for each in own if np.isfinite(each.inferred)], {each.stated for each in own}
    if not told:
        return f"- (stated {stated:g})"
    low, middle, high = (short(float(each)) for each in np.quantile(told, (0.1, 0.5, 0.9)))
    return f"{middle} ({low} to {high}) of {len(told)}, stated {stated:g}"


def _told(answers: list[Answer]) -> str:
    given = [each.error for each in answers if np.isfinite(each.error)]
    if not given:
        return "- | - | -"
    holds = [each.holds for each in answers if each.holds is not None]
    missing = f" ({len(answers) - len(given)} without)" if len(given) < len(answers) else ""
    held = share(holds) + (f" ({100 * np.mean(holds):.1f} %)" if holds else "")
    wide = short(float(np.nanmedian([each.half_width for each in answers])))
    return f"{quantiles(given, 0.5, 0.95, 1.0)}{missing} | {held} | {wide}"


def main() -> None:
    parser = seeds_parser(__doc__, seeds=40, what="gears")
    names = ", ".join(WORLDS).replace("%", "%%")
    parser.add_argument("--worlds", help=f"names joined by commas, of {names}; all where left out")
    parser.add_argument("--law", choices=("given", "searched"), default="searched")
    parser.add_argument("--runs", type=int, choices=(2, 3, 4), default=2, help="of each gear, two masses in turn")
    options = parser.parse_args()
    worlds = read_names(parser, options.worlds, WORLDS, "world")
    law_is_given = options.law == "given"
    seeds = range(options.first, options.seeds)
    jobs = [Job(world, seed, law_is_given, options.runs) for world in worlds for seed in seeds]
    print_table(run_all(run, jobs, describe, processes=options.jobs))


if __name__ == "__main__":
    main()
