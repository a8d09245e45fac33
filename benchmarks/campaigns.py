"""Campaigns on virtual flights: how the workers scale, what the engine costs, what a killed worker loses.

Run `python benchmarks/campaigns.py --flights 2000 --kill 60`. Flights are short (15 s at 256 Hz), three of four those
of one gear with its law given, the fourth that of a whole aircraft. Some logs of each are simulated, and each flight
reads one of them. Each line is printed as soon as it is known. Seconds are those of the clock, from the first flight to
the last, with the workers there: they need an idle machine. Processor time does not; it is that of the command and of
all workers, with their start. MB is the memory of the largest worker in each tenth of a campaign. `--kill 60` kills a
worker every 60 s in a further campaign, whose dataset is compared with that before. `--parts loop one` measures only
some parts.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread

import numpy as np
import psutil

from opid.campaigns.campaign_file import CampaignPlan, read_campaign
from opid.campaigns.engine import run_campaign
from opid.campaigns.flight_task import FlightTask, run_task
from opid.studies.study_file import write_study
from opid.suspensions.flights.dataset import find_dataset
from opid.suspensions.study import PointMass
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test

N_LOGS = 8  # of each kind
DURATION_S, FS = 15.0, 256.0
PARTS = {
    "loop": "plain loop in one process",
    "one": "campaign with one worker",
    "two": "campaign with two workers",
    "killed": "the same, workers killed",
}


def write_fleet(directory: Path, n_flights: int) -> CampaignPlan:
    """Simulate the logs, write a campaign file for so many flights, and return its plan."""
    for number in range(N_LOGS):
        for kind, airframe, change in (
            ("gear", LandingGear(), {"mass_removed_kg": 220.0}),
            ("aircraft", default_aircraft(), {"loadings": [[PointMass(500.0, -1.0, 0.2)]]}),
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


@dataclass
class Times:
    """What a part took.

    Args:
        seconds: of the clock, from the first flight to the last.
        cpu_s: processor time of the command and of all workers.
        worker_s: processor time of each worker.
        memory_mb: the largest memory of a worker in each tenth of the campaign; empty for the loop.
    """

    seconds: float
    cpu_s: float
    worker_s: tuple[float, ...] = ()
    memory_mb: tuple[float, ...] = ()


def time_loop(plan: CampaignPlan, directory: Path) -> Times:
    """Time a plain loop, after one flight of each kind has compiled what is needed."""
    tasks = [FlightTask(flight, plan.options, directory) for flight in plan.flights]
    for task in tasks[:4]:
        run_task(FlightTask(task.flight, plan.options, directory / "first"))
    start, start_cpu = time.perf_counter(), time.process_time()
    for task in tasks:
        run_task(task)
    return Times(time.perf_counter() - start, time.process_time() - start_cpu)


class Watch:
    """Notes memory and processor time of the worker processes every second, and kills one of them now and then."""

    def __init__(self, kill_every_s: float | None) -> None:
        self.kill_every_s, self.chance = kill_every_s, random.Random(1)
        self.memory_mb: list[float] = []
        self.cpu_s: dict[int, float] = {}
        self.has_begun = False  # A worker that dies before it is there ends the campaign.
        self.ended = Event()
        self.thread = Thread(target=self.run, daemon=True)

    def __enter__(self) -> Watch:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        self.thread.join()

    def run(self) -> None:
        """Look every second until the campaign has ended."""
        last = time.monotonic()
        while not self.ended.wait(1.0):
            alive = self.look()
            if self.kill_every_s and self.has_begun and alive and time.monotonic() - last > self.kill_every_s:
                last = time.monotonic()
                os.kill(self.chance.choice(alive), signal.SIGKILL)

    def look(self) -> list[int]:
        """Note what the workers have taken until now, and return the numbers of their processes."""
        alive, sizes = [], [0.0]
        for process in psutil.Process().children(recursive=True):
            with suppress(psutil.Error):
                if any("spawn_main" in word for word in process.cmdline()):
                    sizes.append(process.memory_info().rss / 2**20)
                    self.cpu_s[process.pid] = sum(process.cpu_times()[:2])
                    alive.append(process.pid)
        self.memory_mb.append(max(sizes))
        return alive


def time_campaign(plan: CampaignPlan, directory: Path, workers: int, kill_every_s: float | None = None) -> Times:
    """Time a campaign; of its results only the dataset is kept."""
    moments: list[float] = []

    def note(step: str) -> None:
        # The first call says that no flight is done yet.
        moments.append(time.perf_counter())
        watch.has_begun = len(moments) > 1
        if len(moments) == len(plan.flights) + 1:
            watch.look()

    start_cpu = time.process_time()
    with Watch(kill_every_s) as watch:
        run_campaign(plan, directory, workers=workers, progress=note)
    shutil.rmtree(directory / "flights")
    tenths = tuple(float(part.max()) for part in np.array_split(watch.memory_mb, 10) if part.size)
    by_workers = tuple(watch.cpu_s.values())
    cpu_s = time.process_time() - start_cpu + sum(by_workers)
    return Times(moments[-1] - moments[1], cpu_s, by_workers, tenths)


def read_rows(directory: Path) -> list[dict[str, object]]:
    """Return the rows of a dataset, without the paths that differ from campaign to campaign."""
    import pyarrow.dataset

    table = pyarrow.dataset.dataset(find_dataset(directory), partitioning="hive").to_table()
    return sorted(table.to_pylist(), key=str)


def compare_with_others(part: str, found: dict[str, Times]) -> str:
    """Return what a part says beside the parts before it."""
    own, loop, one = found[part], found.get("loop"), found.get("one")
    if part == "one" and loop is not None:
        more = 100 * (own.seconds / loop.seconds - 1), 100 * (own.cpu_s / loop.cpu_s - 1)
        return f"{more[0]:+.1f} % of the loop, {more[1]:+.1f} % of its processor time"
    if part == "two" and one is not None:
        evenly = sum(one.worker_s) / max(own.worker_s)
        return f"{one.seconds / own.seconds:.2f} times as fast as one, {evenly:.2f} by processor time of the busier one"
    return ""


def main() -> None:
    """Print the table, a line after each part."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=200)
    parser.add_argument("--kill", type=float, metavar="S", help="kill a worker so often, s, in a further campaign")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, help="parts to be measured; all by default")
    options = parser.parse_args()
    base = Path(tempfile.mkdtemp())
    found: dict[str, Times] = {}
    try:
        plan = write_fleet(base / "logs", options.flights)
        n = len(plan.flights)
        print(f"| what | seconds for {n} flights | processor time, s | for a flight, s | MB | beside |")
        print("|---|---|---|---|---|---|", flush=True)
        for part in [each for each in PARTS if each in options.parts and (each != "killed" or options.kill)]:
            if part == "loop":
                found[part] = time_loop(plan, base / part)
                shutil.rmtree(base / part)
            else:
                found[part] = time_campaign(
                    plan, base / part, 1 if part == "one" else 2, options.kill if part == "killed" else None
                )
            own, beside = found[part], compare_with_others(part, found)
            undisturbed = next((each for each in ("two", "one") if each in found), None)
            if part == "killed":
                rows = read_rows(base / part)
                done = len({row["flight"] for row in rows if row["verdict"] != "failed"})
                beside = f"{len(own.worker_s) - 2} killed, {done} of {n} flights done"
                if undisturbed is not None:
                    words = "equal" if rows == read_rows(base / undisturbed) else "NOT EQUAL"
                    beside += f", dataset {words} to that of the undisturbed run"
            memory = ", ".join(f"{each:.0f}" for each in own.memory_mb)
            row = (PARTS[part], f"{own.seconds:.1f}", f"{own.cpu_s:.1f}", f"{own.cpu_s / n:.3f}", memory, beside)
            print(f"| {' | '.join(row)} |", flush=True)
    finally:
        shutil.rmtree(base)


if __name__ == "__main__":
    main()
