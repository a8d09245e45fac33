"""A weighed mass as prior knowledge: how much it narrows the interval, whether that holds, and what a wrong scale does.

Run `python benchmarks/weighed_masses.py --seeds 20`. Each seed draws the mass of a gear within 20 % of the nominal one;
two runs of 20 s at 256 Hz, 5 mm/s^2 of noise, 220 kg removed, the law given, the struts alike. The heavy run is weighed
with a tolerance of 5 kg. In some worlds the scale is wrong by more than it states: the wheels were on it (6 %), or it
was not calibrated (1 %, which is four of its tolerances).
"""

import os
from dataclasses import dataclass, replace

# before numpy is loaded
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from harness import run_all, seeds_parser, share, table_head, table_row

from opid import identify
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

TOLERANCE_KG = 5.0
# name of a world: relative error of the scale beside its tolerance, None where nothing is weighed, and number of runs
WORLDS: dict[str, tuple[float | None, int]] = {
    "not weighed": (None, 2),
    "weighed": (0.0, 2),
    "weighed, one run alone": (0.0, 1),
    "scale 1 % wrong": (0.01, 2),
    "scale 6 % wrong": (0.06, 2),
}


@dataclass(frozen=True)
class Outcome:
    """The mass of one seed of each world: its error and half of its 95 % interval, kg, and what was concluded."""

    seed: int
    error_kg: dict[str, float]
    half_width_kg: dict[str, float]
    is_prior: dict[str, bool]
    is_warned: dict[str, bool]


def main() -> None:
    args = seeds_parser(__doc__, seeds=20, what="gears").parse_args()
    seeds = range(args.first, args.first + args.seeds)
    outcomes = run_all(weigh, seeds, lambda each: f"seed {each.seed}", processes=args.jobs)
    print()
    print(table_head("world", "error, kg, median / worst", "half width, kg", "intervals that hold", "used", "warned"))
    for name in WORLDS:
        errors = np.abs([each.error_kg[name] for each in outcomes])
        widths = np.array([each.half_width_kg[name] for each in outcomes])
        print(
            table_row(
                name,
                f"{np.median(errors):.1f} / {errors.max():.1f}",
                f"{np.median(widths):.1f}",
                share(bool(held) for held in errors <= widths),
                share(each.is_prior[name] for each in outcomes),
                share(each.is_warned[name] for each in outcomes),
            )
        )


def weigh(seed: int) -> Outcome:
    """Simulate a seed and identify it in every world."""
    rng = np.random.default_rng([19, seed])
    gear = replace(LandingGear(), sprung_mass_kg=1850.0 * float(rng.uniform(0.8, 1.2)))
    test = taxi_test(gear, rng=np.random.default_rng(seed), mass_removed_kg=220.0, duration_s=20, fs=256)
    reading_kg = gear.sprung_mass_kg + TOLERANCE_KG * float(rng.standard_normal())
    found = Outcome(seed, {}, {}, {}, {})
    for name, (wrong, n_runs) in WORLDS.items():
        heavy = Run("heavy", test.heavy.recording, 0.0)
        if wrong is not None:
            weighed_kg = reading_kg + wrong * gear.sprung_mass_kg
            heavy = replace(heavy, weighed_mass_kg=weighed_kg, weighed_tolerance_kg=TOLERANCE_KG)
        runs = (heavy, Run("light", test.light.recording, test.mass_change_kg))[:n_runs]
        study = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)
        result = identify(study, law=gear.law.name)
        mass = result.parameters.sprung_mass_kg
        low, high = mass.interval95 or (np.nan, np.nan)
        found.error_kg[name] = (np.nan if mass.value is None else mass.value) - gear.sprung_mass_kg
        found.half_width_kg[name] = (high - low) / 2
        found.is_prior[name] = any(each.is_prior for each in result.weighed)
        found.is_warned[name] = any("contradicts the runs" in each for each in result.warnings)
    return found


if __name__ == "__main__":
    main()
