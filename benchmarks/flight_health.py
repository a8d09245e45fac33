"""Health over time: real identifications of many flights of one aircraft, and what `opid compare` makes of them.

Run `python benchmarks/flight_health.py`. For each seed a random aircraft taxies 50 times unharmed, on a runway of its
own each time and in two loadings, then twice with 5 % less stiffness in its left strut. Every flight is identified as a
rigid body (coordinates off by 1 cm, 5 mm/s2 of noise, laws given) and written as result.json; then the flights are
compared. Printed: false flags among the first 50, and at which of the two last flights the loss is flagged; and the
same where the loss comes after 3, 5, 10 and 20 of these flights.
"""

import argparse
import os
import sys
from dataclasses import replace
from datetime import date, timedelta
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

# before numpy is loaded, here and in every process that this one starts
os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
from aircraft_figures import NOISE, TOLERANCE_M
from estimator import aircraft_study, identify
from tqdm import tqdm

from opid.json_values import json_text
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.results import read_flights
from opid.suspensions.study import MeasuredInterface, PointMass, StructureSettings
from opid.virtual.taxi_tests.aircraft import random_aircraft
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_test

LOSS, HARMED = 0.05, 2
SOONER = (3, 5, 10, 20)
"""Flights before the loss for which the same results are compared again."""
FIRST = date(2026, 1, 1)


def flight(job: tuple[int, int, bool, str]) -> None:
    """Simulate, identify and write one flight."""
    seed, number, harmed, directory = job
    rng = np.random.default_rng([seed, 11])
    aircraft = random_aircraft(rng)
    # the drawing is as wrong in every flight
    off = TOLERANCE_M * rng.standard_normal((len(aircraft.gears), 2))
    loading = PointMass(0.1 * aircraft.mass_kg, rng.uniform(-0.5, 2.0), rng.uniform(-0.3, 0.3))
    if harmed:
        gears = tuple(
            replace(gear, suspension_stiffness_n_per_m=(1 - LOSS) * gear.suspension_stiffness_n_per_m)
            if gear.name == "left"
            else gear
            for gear in aircraft.gears
        )
        aircraft = replace(aircraft, gears=gears)
    test = taxi_test(
        aircraft,
        rng=np.random.default_rng([seed, 12, number]),
        loadings=[[loading]],
        duration_s=20.0,
        lower_sensor=Sensor(noise_m_per_s2=NOISE),
        upper_sensor=Sensor(noise_m_per_s2=NOISE),
    )
    interfaces = tuple(
        MeasuredInterface(gear.name, f"{gear.name}_upper_z", f"{gear.name}_lower_z", gear.x_m + dx, gear.y_m + dy)
        for gear, (dx, dy) in zip(aircraft.gears, off.tolist(), strict=True)
    )
    runs = [
        (name, run.recording, loads)
        for name, run, loads in zip(("light", "heavy"), test.runs, test.loadings, strict=True)
    ]
    settings = StructureSettings("rigid_body", position_tolerance_m=TOLERANCE_M, noise_m_per_s2=NOISE)
    day = FIRST + timedelta(days=number)
    study = aircraft_study(f"flight {number}", interfaces, runs, settings, date=day)
    found = identify(study, law=aircraft.gears[1].law.name)
    target = Path(directory) / f"flight_{number:03d}"
    target.mkdir()
    (target / "result.json").write_text(json_text(found.to_dict()), encoding="utf-8")


def main() -> None:
    """Print what is flagged."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--flights", type=int, default=50)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    for seed in range(args.seeds):
        with TemporaryDirectory() as directory:
            jobs = [(seed, k, k >= args.flights, directory) for k in range(args.flights + HARMED)]
            with get_context("spawn").Pool(args.jobs) as pool:
                done = pool.imap_unordered(flight, jobs)
                for _ in tqdm(done, total=len(jobs), desc=f"aircraft {seed}", disable=not sys.stderr.isatty()):
                    pass
            folders = sorted(Path(directory).iterdir())
            for before in (*(n for n in SOONER if n < args.flights), args.flights):
                told(seed, before, [*folders[:before], *folders[args.flights :]])


def told(seed: int, before: int, folders: list[Path]) -> None:
    """Print what is flagged where the loss comes after so many flights."""
    result = compare(read_flights(folders))
    false = [change for change in result.changes if change.first < before]
    # beyond the loss, only the left strut's stiffness has changed
    right = [
        change
        for change in result.changes
        if change.first >= before and (change.quantity.gear, change.quantity.name) == ("left", "stiffness")
    ]
    others = len(result.changes) - len(false) - len(right)
    scatter = sum(series.scatter > 0 for series in result.series)
    print(
        f"aircraft {seed}: {before} flights unharmed, {len(false)} false flags, {scatter} of {len(result.series)} "
        f"quantities judged with scatter; then {100 * LOSS:g} % loss, and {others} false flags:"
    )
    for change in (*false, *right):
        print(f"- {change.statement}")
    if not right:
        print("- not flagged")


if __name__ == "__main__":
    main()
