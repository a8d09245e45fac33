"""Campaigns on virtual flights: how the workers scale, what the engine costs, what a killed worker loses.

Run `python benchmarks/campaigns.py --flights 2000`. Flights are short (15 s at 256 Hz), three of four those of one gear
with its law given, the fourth that of a whole aircraft. Some logs of each are simulated, and each flight reads one of
them. Times are those of the clock, from the first flight to the last, with the workers there; the machine should be
idle. `--kill 60` kills a worker every 60 s in a further campaign, whose dataset is compared with that before.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import numpy as np
import psutil

from opid.campaigns.campaign_file import CampaignPlan, read_campaign
from opid.campaigns.engine import run_campaign
from opid.campaigns.flight_task import FlightTask, run_task
from opid.studies.study_file import write_study
from opid.suspensions.flights.dataset import find_dataset
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.airframe import LandingGear, Loading
from opid.virtual.taxi_tests.study import taxi_study
from opid.virtual.taxi_tests.taxiing import taxi_test

N_LOGS = 8  # of each kind
DURATION_S, FS = 15.0, 256.0


def write_fleet(directory: Path, n_flights: int) -> CampaignPlan:
    """Simulate the logs, write a campaign file for so many flights, and return its plan."""
    for number in range(N_LOGS):
        for kind, airframe, change in (
            ("gear", LandingGear(), {"mass_removed_kg": 220.0}),
            ("aircraft", default_aircraft(), {"loadings": [[Loading(500.0, -1.0, 0.2)]]}),
        ):
            folder = directory / f"{kind}_{number}"
            folder.mkdir(parents=True)
            rng = np.random.default_rng(number)
            test = taxi_test(airframe, rng=rng, duration_s=DURATION_S, fs=FS, **change)
            write_study(taxi_study(test, title=f"{kind} {number}"), folder / "study.toml")
    rows = [
        f"f{k:05},D-{k % 50:02},{np.datetime64('2026-01-01') + k // 50},{'aircraft' if k % 4 == 3 else 'gear'}_"
        f"{(k // 4) % N_LOGS}/study.toml"
        for k in range(n_flights)
    ]
    (directory / "flights.csv").write_text("\n".join(["flight,tail,date,study", *rows]) + "\n")
    (directory / "fleet.toml").write_text(
        'title = "A virtual fleet"\nflights = "flights.csv"\n[identify]\nlaw = "arctan_velocity"\n'
    )
    return read_campaign(directory / "fleet.toml")


def time_loop(plan: CampaignPlan, directory: Path) -> float:
    """Return the seconds that a plain loop takes, after one flight of each kind has compiled what is needed."""
    tasks = [FlightTask(flight, plan.options, directory) for flight in plan.flights]
    for task in tasks[:4]:
        run_task(FlightTask(task.flight, plan.options, directory / "first"))
    start = time.perf_counter()
    for task in tasks:
        run_task(task)
    return time.perf_counter() - start


@contextmanager
def watch_workers(memory: list[list[float]], kill_every_s: float | None) -> Iterator[None]:
    """Note the memory of the worker processes every second, MB, and kill one of them now and then."""
    ended, chance = Event(), random.Random(1)

    def watch() -> None:
        last = time.monotonic()
        while not ended.wait(1.0):
            below = psutil.Process().children(recursive=True)
            workers = [each for each in below if any("spawn_main" in word for word in _list_words(each))]
            memory.append([each.memory_info().rss / 2**20 for each in workers if each.is_running()])
            if kill_every_s and workers and time.monotonic() - last > kill_every_s:
                last = time.monotonic()
                os.kill(chance.choice(workers).pid, signal.SIGKILL)

    thread = Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _list_words(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def time_campaign(
    plan: CampaignPlan, directory: Path, workers: int, kill_every_s: float | None = None
) -> tuple[float, list[float]]:
    """Return the seconds from the first flight to the last, and the largest memory of a worker in each tenth of it."""
    moments: list[float] = []
    memory: list[list[float]] = []
    with watch_workers(memory, kill_every_s):
        run_campaign(plan, directory, workers=workers, progress=lambda step: moments.append(time.perf_counter()))
    largest = [max(each, default=0.0) for each in memory]
    tenths = [max(part) for part in np.array_split(largest, 10) if len(part)]
    return moments[-1] - moments[0], tenths


def read_rows(directory: Path) -> list[dict[str, object]]:
    """Return the rows of a dataset, without the paths that differ from campaign to campaign."""
    import pyarrow.dataset

    table = pyarrow.dataset.dataset(find_dataset(directory), partitioning="hive").to_table()
    return sorted(table.to_pylist(), key=str)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--kill", type=float, metavar="S", help="kill a worker so often, s, in a further campaign")
    options = parser.parse_args()
    base = Path(tempfile.mkdtemp())
    try:
        plan = write_fleet(base / "logs", options.flights)
        loop = time_loop(plan, base / "loop")
        one, memory_of_one = time_campaign(plan, base / "one", 1)
        two, memory_of_two = time_campaign(plan, base / "two", 2)
        print("| what | seconds | a flight, s | beside |\n|---|---|---|---|")
        n = len(plan.flights)
        print(f"| plain loop | {loop:.1f} | {loop / n:.3f} | |")
        print(f"| one worker | {one:.1f} | {one / n:.3f} | {100 * (one / loop - 1):+.1f} % of the loop |")
        print(f"| two workers | {two:.1f} | {two / n:.3f} | {one / two:.2f} times as fast as one |")
        for name, tenths in (("one", memory_of_one), ("two", memory_of_two)):
            listed = ", ".join(f"{each:.0f}" for each in tenths)
            print(f"\nMemory of a worker of {name}, MB, the largest in each tenth of the campaign: {listed}.")
        if options.kill:
            killed, _ = time_campaign(plan, base / "killed", 2, options.kill)
            words = "equal" if read_rows(base / "killed") == read_rows(base / "two") else "NOT EQUAL"
            print(f"\nA worker killed every {options.kill:g} s: {killed:.1f} s; the dataset is {words}.")
    finally:
        shutil.rmtree(base)


if __name__ == "__main__":
    main()
