"""Errors of `method = "classical"` (or another) against the truth of the virtual taxi run, as Markdown tables.

Run `python benchmarks/accuracy.py`; `--quick` takes one seed of a coarse grid, `--seeds N` another number of seeds
(they count from 0, none is dropped), `--method NAME` another method, `--each FILE` also writes one line for each trial.

Beside it stand, on the same runs, the chain of Iwaniec & Uhl (2007) as printed and a middle road: complex least
squares of each run's transmissibility, and the mass from the two ratios K2/M2.
"""

import argparse
import csv
from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from math import sqrt

import numpy as np
from harness import share, table_head, table_row
from tqdm import tqdm
from trials import Case, Trial, trial

from opid.mechanics.laws.law import LINEAR, default_law, law
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Sensor

ZETA = (0.05, 0.1, 0.2, 0.3)
NOISE_MM_PER_S2 = (0.0, 5.0, 20.0)
FRICTION_N = (0.0, 400.0, 1500.0)
INTERVALS = ("M2", "K2", "C2", "K3")
OTHER_LAWS = (
    "arctan_displacement",
    "quadratic_damping",
    "cubic_stiffness",
    "arctan_velocity+cubic_stiffness",
)


def friction_law(amplitude_n: float):
    return law("arctan_velocity", amplitude_n=amplitude_n, scale_m_per_s=0.02) if amplitude_n else LINEAR


def grid_case(zeta: float, noise_mm_per_s2: float, friction_n: float) -> Case:
    gear = LandingGear(law=friction_law(friction_n))
    damping = 2 * zeta * sqrt(gear.suspension_stiffness_n_per_m * gear.sprung_mass_kg)
    sensor = Sensor(noise_m_per_s2=1e-3 * noise_mm_per_s2)
    gear = replace(gear, suspension_damping_n_s_per_m=damping)
    return Case(gear, run={"lower_sensor": sensor, "upper_sensor": sensor})


def sensors(lower: dict, upper: dict | None = None) -> dict:
    """Settings of `taxi_run` for faults of the lower and the upper sensor (the same where left out)."""
    return {"lower_sensor": Sensor(**lower), "upper_sensor": Sensor(**(lower if upper is None else upper))}


def other_cases() -> dict[str, Case]:
    """Conditions away from the grid, each one a single change of the nominal run (friction 400 N, 5 mm/s2)."""
    gear = LandingGear()
    coarse = {"bits": 16, "range_m_per_s2": 50 * 9.80665}
    return {
        "nominal": Case(gear),
        "ground spring 1.67e5 N/m": Case(replace(gear, ground_stiffness_n_per_m=1.67e5)),
        "road class A": Case(gear, run={"road_class": "A"}),
        "road class C": Case(gear, run={"road_class": "C"}),
        "constant 6 m/s": Case(gear, run={"speed_m_per_s": (6.0, 6.0)}),
        "25 to 0 m/s in 20 s": Case(gear, run={"speed_m_per_s": (25.0, 0.0), "duration_s": 20.0}),
        **{name.replace("_", " "): Case(replace(gear, law=default_law(name))) for name in OTHER_LAWS},
        "AC corners 0.33, 0.33 Hz": Case(gear, run=sensors({"corner_hz": 0.33})),
        "AC corners 0.33, 0.363 Hz": Case(gear, run=sensors({"corner_hz": 0.33}, {"corner_hz": 0.363})),
        "AC corners 0.33, 0.462 Hz": Case(gear, run=sensors({"corner_hz": 0.33}, {"corner_hz": 0.462})),
        "gain of the upper sensor 1.01": Case(gear, run=sensors({}, {"gain": 1.01})),
        "cross-axis 3 %": Case(gear, run=sensors({"cross_axis": 0.03})),
        "16 bit, +-50 g": Case(gear, run=sensors(coarse)),
    }


def worst(values: Iterable[float]) -> str:
    """Median and largest of the absolute values that are there, "-" where none is."""
    there = np.abs([value for value in values if np.isfinite(value)])
    return f"{short(np.median(there))} / {short(there.max())}" if there.size else "-"


def median(values: Iterable[float]) -> str:
    there = np.abs([value for value in values if np.isfinite(value)])
    return short(np.median(there)) if there.size else "-"


def short(percent: float) -> str:
    if percent < 0.01:
        return "<0.01"
    return f"{percent:.2f}" if percent < 1 else f"{percent:.1f}" if percent < 10 else f"{percent:.0f}"


def inside(trials: list[Trial]) -> str:
    """How many 95 % intervals of M2, K2, C2 and K3 hold the truth, of those that were given."""
    held = [each.holds[name] for each in trials for name in INTERVALS]
    return share(held)


def law_errors(trials: list[Trial]) -> str:
    """Errors of the law's first amplitude; 100 % where the law that was found lacks the term."""
    names = [name for name in trials[0].truth if name.endswith(("_n", "_m2", "_m3"))]
    if not names:
        return "-"
    given = [each for each in trials if each.reason is None]
    return worst(100.0 if np.isnan(each.error[names[0]]) else each.percent(names[0]) for each in given)


def columns(trials: list[Trial]) -> list[str]:
    return [
        worst(each.percent("M2") for each in trials),
        worst(each.percent("K2") for each in trials),
        worst(each.percent("C2") for each in trials),
        worst(each.percent("K3") for each in trials),
        law_errors(trials),
        inside(trials),
        share(each.law_right for each in trials),
        str(sum(each.reason is not None for each in trials)),
        median(100 * each.two_ratios / each.truth["M2"] for each in trials),
        median(100 * each.printed / each.truth["M2"] for each in trials),
    ]


COLUMNS = [
    "M2, %",
    "K2, %",
    "C2, %",
    "K3, % of K2",
    "law's force, %",
    "95 % intervals that hold",
    "law right",
    "not determined",
    "two ratios: M2, %",
    "paper: M2, %",
]


def print_table(header: list[str], rows: list[list[str]]) -> None:
    print(table_head(*header))
    for row in rows:
        print(table_row(*row))
    print()


def write_each(path: str, trials: dict[str, list[Trial]]) -> None:
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["case", "seed", "law", "law_right", "unexplained", "parameter", "percent", "score", "reason"])
        for label, each in ((label, each) for label, cell in trials.items() for each in cell):
            for name in each.truth:
                percent = each.percent(name)
                figures = [f"{value:.4g}" for value in (each.unexplained, percent, each.score(name))]
                law_found = [each.law_name, each.law_right, figures[0], name]
                writer.writerow([label, each.seed, *law_found, *figures[1:], each.reason or ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one seed of a coarse grid")
    parser.add_argument("--seeds", type=int, default=5, help="seeds a cell")
    parser.add_argument("--method", default="classical", help="classical (the default) or model")
    parser.add_argument("--each", metavar="FILE", help="write one line for each trial and parameter")
    options = parser.parse_args()
    seeds = range(1 if options.quick else options.seeds)
    zetas, noises, frictions = (
        ((0.1, 0.3), (5.0,), (0.0, 400.0)) if options.quick else (ZETA, NOISE_MM_PER_S2, FRICTION_N)
    )

    cells = {(f, n, z): grid_case(z, n, f) for f, n, z in product(frictions, noises, zetas)}
    others = other_cases()
    if options.quick:
        others = dict(list(others.items())[:2])
    jobs = [(label, case, seed) for label, case in (cells | others).items() for seed in seeds]
    trials: dict = {label: [] for label in cells | others}
    for label, case, seed in tqdm(jobs, unit="trial", disable=None):
        trials[label].append(trial(case, seed, method=options.method))
    if options.each:
        write_each(options.each, {str(label): each for label, each in trials.items()})

    setting = "two 40 s runs at 512 Hz, 220 kg removed"
    print(f"Method {options.method}, law searched, {setting}, {len(seeds)} seed(s) a cell.\n")
    print("Sprung mass M2, absolute error in %: median / worst.\n")
    table = []
    for f, n in product(frictions, noises):
        table.append([f"{f:.0f} N", f"{n:.0f}", *(worst(t.percent("M2") for t in trials[f, n, z]) for z in zetas)])
    print_table(["friction", "noise, mm/s2", *(f"zeta {z:g}" for z in zetas)], table)

    print("The other parameters, all damping ratios together: median / worst.\n")
    table = []
    for f, n in product(frictions, noises):
        table.append([f"{f:.0f} N", f"{n:.0f}", *columns([each for z in zetas for each in trials[f, n, z]])])
    print_table(["friction", "noise, mm/s2", *COLUMNS], table)

    print("Other conditions, each one change of the nominal run (zeta 0.11, friction 400 N, noise 5 mm/s2).\n")
    print_table(["condition", *COLUMNS], [[label, *columns(trials[label])] for label in others])


if __name__ == "__main__":
    main()
