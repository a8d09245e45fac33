"""Plans against what came of them: predicted against obtained standard deviations of random gears, as Markdown tables.

Run `python benchmarks/plan.py --seeds 200`, some 5 s a seed. Each gear of `scenarios.random_case` is guessed as it is,
`opid.planning.plan` predicts the standard deviations of two runs of 40 s, and such runs over other roads are identified
with the law given. An error over its predicted standard deviation has an rms of 1 if the plan is right. `--duration`
scales the plan instead of simulating it anew: the prediction always rests on virtual runs of 80 s.

`--repeatability 0.01` draws springs, damping and friction of each run, which the study states. `--wrong` guesses mass
and stiffness 20 % too high or too low and the road one class too rough or too smooth, at random: the obtained standard
deviation should lie in the range that the plan gives for a guess that may be wrong.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from harness import quantiles, run_all, seeds_parser, share, table_head, table_row
from scenarios import random_case
from trials import Case, study_of

from opid.errors import NotDeterminedError
from opid.mechanics.repeatability import Departure
from opid.planning import Guess, GuessedGear, GuessedRoad, GuessedSensors, plan
from opid.suspensions.identification import identify
from opid.suspensions.planning.result import PlannedRun, PlanResult
from opid.suspensions.planning.search import SearchSpace
from opid.virtual.taxi_tests.taxiing import taxi_test

PLAN_SEED = 10_000
"""Added to the seed of a gear for the roads of its plan, so that plan and runs have different ones."""

CLASSES = "ABCDEF"


@dataclass(frozen=True)
class Outcome:
    """What was predicted for one gear, and what was obtained.

    Args:
        seed: of the gear.
        law: name of its law.
        error: {name: estimate less truth}.
        obtained: {name: standard deviation that the identification states}; NaN where it states none.
        predicted: {name: standard deviation of the plan}; NaN where it predicts none.
        range: of the standard deviation of the mass for a wrong guess.
    """

    seed: int
    law: str
    error: dict[str, float]
    obtained: dict[str, float]
    predicted: dict[str, float]
    range: tuple[float, float] | None


def guess_of(case: Case, duration_s: float, repeatability: float, wrong: np.random.Generator | None) -> Guess:
    """Return the guess of a gear: the truth, or one that is wrong by 20 % and a class."""
    gear, road, sensor = case.gear, case.run["road_class"], case.run["lower_sensor"]
    mass, stiffness = gear.sprung_mass_kg, gear.suspension_stiffness_n_per_m
    if wrong is not None:
        signs = wrong.choice([-1, 1], 3)
        mass, stiffness = mass * (1 + 0.2 * signs[0]), stiffness * (1 + 0.2 * signs[1])
        road = CLASSES[max(0, CLASSES.index(road) + int(signs[2]))]
    change_kg = -case.mass_removed_kg
    return Guess(
        gear=GuessedGear(
            sprung_mass_kg=mass,
            suspension_stiffness_n_per_m=stiffness,
            suspension_damping_n_s_per_m=gear.suspension_damping_n_s_per_m,
            law=gear.law.parameters,
            unsprung_mass_kg=gear.unsprung_mass_kg,
            tyre_stiffness_n_per_m=gear.tyre_stiffness_n_per_m,
            tyre_damping_n_s_per_m=gear.tyre_damping_n_s_per_m,
        ),
        runs=(PlannedRun(duration_s), PlannedRun(duration_s, change_kg)),
        road=GuessedRoad(road_class=road),
        sensors=GuessedSensors(noise_m_per_s2=sensor.noise_m_per_s2, fs_hz=case.run["fs"]),
        repeatability=repeatability,
        # the plan that is looked for is the planned one, so that its range is told
        search=SearchSpace((duration_s,), (change_kg,), (1,)),
    )


def as_number(value: float | None) -> float:
    """Return a number, NaN in the place of None."""
    return np.nan if value is None else value


def outcome_of(seed: int, *, duration_s: float, repeatability: float, is_wrong: bool) -> Outcome:
    """Plan, make and identify the runs of one gear."""
    case = random_case(seed)
    gear = case.gear
    guess = guess_of(case, duration_s, repeatability, np.random.default_rng([seed, 7]) if is_wrong else None)
    try:
        predicted: PlanResult | None = plan(guess, ["sprung_mass=100%"], seed=PLAN_SEED + seed)
    except NotDeterminedError:
        predicted = None
    rng = np.random.default_rng([seed, 8])
    departures = [Departure(*(repeatability * rng.standard_normal(3))) for _ in range(2)] if repeatability else None
    test = taxi_test(
        gear,
        rng=np.random.default_rng(seed),
        mass_removed_kg=case.mass_removed_kg,
        departures=departures,
        duration_s=duration_s,
        **case.run,
    )
    study = replace(study_of(test), repeatability=repeatability)
    found = identify(study, law=gear.law.name)
    truth = {
        name: getattr(gear, name)
        for name in ("sprung_mass_kg", "suspension_stiffness_n_per_m", "suspension_damping_n_s_per_m")
    }
    kind, parameters = next(iter(gear.law.parameters.items()))
    first = next(iter(parameters))
    estimates = {row.name: row for row in found.summary()}
    truth["law"] = parameters[first]
    estimates["law"] = estimates.get(f"law.{kind}.{first}", estimates["sprung_mass_kg"])
    expected = {} if predicted is None else {each.name: each.std for each in predicted.planned.numbers}
    expected["law"] = expected.get(f"law.{kind}.{first}")
    return Outcome(
        seed,
        gear.law.name,
        {
            name: (np.nan if estimates[name].value is None else estimates[name].value) - true
            for name, true in truth.items()
        },
        {name: np.nan if estimates[name].std is None else estimates[name].std for name in truth},
        {name: as_number(expected.get(name)) for name in truth},
        None if predicted is None else predicted.ranges[0],
    )


def describe(each: Outcome) -> str:
    """Return an outcome in one line."""
    name = "sprung_mass_kg"
    return (
        f"{each.seed} {each.law}: mass off by {each.error[name]:.3g} kg, predicted {each.predicted[name]:.3g}, stated "
        f"{each.obtained[name]:.3g}, range {each.range and [round(end, 3) for end in each.range]}"
    )


def main() -> None:
    parser = seeds_parser(__doc__, seeds=200, what="gears")
    parser.add_argument("--duration", type=float, default=40.0, help="of each run, s")
    parser.add_argument("--repeatability", type=float, default=0.0, help="of springs, damping and friction, and stated")
    parser.add_argument("--wrong", action=argparse.BooleanOptionalAction, default=False, help="guess wrong by 20 %%")
    options = parser.parse_args()
    run = partial(outcome_of, duration_s=options.duration, repeatability=options.repeatability, is_wrong=options.wrong)
    seeds = range(options.first, options.first + options.seeds)
    found = run_all(run, seeds, describe, processes=options.jobs)
    print()
    print(table_head("", "gears", "rms of error over predicted", "stated over predicted, median", "10 %", "90 %"))
    for name in found[0].error:
        both = [each for each in found if np.isfinite(each.error[name] + each.predicted[name] + each.obtained[name])]
        score = np.array([each.error[name] / each.predicted[name] for each in both])
        ratio = np.array([each.obtained[name] / each.predicted[name] for each in both])
        ends = [f"{np.quantile(ratio, at):.2f}" for at in (0.5, 0.1, 0.9)] if both else ["-"] * 3
        rms = f"{np.sqrt(np.mean(score**2)):.2f} +- {np.sqrt(0.5 / len(both)):.2f}" if both else "-"
        print(table_row(name, len(both), rms, *ends))
    name = "sprung_mass_kg"
    inside = [
        each.range[0] <= each.obtained[name] <= each.range[1]
        for each in found
        if each.range and each.obtained[name] > 0
    ]
    print(f"\nstated standard deviation of the mass inside the range for a wrong guess: {share(inside)}")
    widths = [each.range[1] / each.range[0] for each in found if each.range]
    print(f"upper over lower end of that range, median / worst: {quantiles(widths, 0.5, 1.0)}")


if __name__ == "__main__":
    main()
