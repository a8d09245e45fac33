"""Run the flights of a campaign on Dask, and write their dataset."""

from __future__ import annotations

import logging
import os
import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from opid.campaigns.campaign_file import CampaignPlan, PlannedFlight
from opid.campaigns.flight_task import Done, FlightTask, TaskSettings, run_task
from opid.errors import FileError, InputError, require
from opid.json_values import read_json
from opid.progress import Say, Step
from opid.signals.files import make_directory, reserve_directory
from opid.suspensions.flights.campaign import DATASET, INDEX_FILE, Campaign, Outcome, Verdict
from opid.suspensions.flights.dataset import RESERVED_TAILS, columns, require_dataset, write_part

if TYPE_CHECKING:
    from distributed import Client

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class EngineSettings:
    """How the tasks are handed out.

    Args:
        flights_per_part: flights in one file of the dataset: some thousand rows, which is small enough to be written
            while the campaign runs, and large enough for the readers of Parquet.
        tasks_per_worker: tasks that wait at each worker, so that none is idle while the next is sent.
        most_deaths: workers that may die under a task before Dask gives it up. `TaskSettings.most_attempts` decides
            earlier, and knows the reason.
        connection_s: a scheduler that does not answer within this time is not there.
        kept_bytes: a worker keeps freed memory up to this size. Dask tells the C library to give back all above 64 KiB.
        largest_kept_bytes: a worker takes arrays up to this size from what it keeps, and asks the system for larger
            ones. With the settings of Dask it asks for each array of more than 128 KiB: a tenth of the processor time
            of a flight. With 256 MiB for both, workers grew to 650 MB.
    """

    flights_per_part: int = 1000
    tasks_per_worker: int = 4
    most_deaths: int = 100
    connection_s: float = 20.0
    kept_bytes: int = 1 << 26
    largest_kept_bytes: int = 1 << 24


DEFAULTS = EngineSettings()


def refuse_another(title: str, directory: Path) -> None:
    """Refuse a folder that holds another campaign, whose dataset would be replaced.

    Args:
        title: of the campaign; it stays where a campaign is moved.
        directory: of the results.

    Raises:
        InputError: it holds a campaign of another title.
    """
    other = title
    with suppress(OSError, ValueError, KeyError, TypeError):
        other = read_json(directory / INDEX_FILE)["title"]
    if other != title:
        raise FileError(
            f"{directory} holds the campaign {other!r}, and this one is {title!r}: choose another folder, or overwrite "
            "with --force"
        )


def run_campaign(
    plan: CampaignPlan,
    directory: str | os.PathLike[str],
    *,
    source: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    task_settings: TaskSettings | None = None,
    engine: EngineSettings = DEFAULTS,
    is_forced: bool = False,
    announce: Callable[[str], None] | None = None,
    progress: Say | None = None,
) -> Campaign:
    """Identify the flights of a campaign, each as one task of Dask, and write the dataset of their values.

    Each flight has a folder `flights/TAIL/FLIGHT` with its result.json. A flight that an earlier run has left there is
    taken as it is if its study, its logs, the options and the version of opid are the same. The dataset is written
    part by part while the campaign runs, and does not depend on the order in which flights end.

    Args:
        plan: the flights.
        directory: of the results; workers elsewhere must reach it, and the logs, by the same path.
        source: what the plan was read from.
        workers: processes on this machine; as many as it has processors if left out.
        scheduler: address of a running scheduler, like "tcp://10.0.0.1:8786", in the place of processes here.
        task_settings: time limit and pages.
        engine: the tuned numbers.
        is_forced: whether flights are identified again although an earlier run has done it.
        announce: called with the address of the dashboard, as soon as there is one.
        progress: called with a `Step` that says how many flights are done, at first that none is.

    Raises:
        InputError: no flight, a covariate with the name of another column, a directory that cannot be written to, a
            scheduler that does not answer, another process that runs a campaign there, or a missing library.
    """
    require("distributed", "a campaign", "distributed", "campaign")
    require_dataset()
    if not plan.flights:
        raise InputError("the campaign has no flight: give one or more")
    say, target = progress or (lambda step: None), make_directory(directory).absolute()
    tasks = _plan_tasks(plan, target, task_settings or TaskSettings(), is_forced)
    parts = _Parts(target / DATASET, tasks, engine.flights_per_part)
    began, n_before = time.monotonic(), 0
    with reserve_directory(directory), connect(workers, scheduler, engine) as client:
        if announce is not None:
            announce(client.dashboard_link)
        say(_count_flights(0, len(tasks), 0))
        for number, (index, done) in enumerate(_run_tasks(client, tasks, engine), start=1):
            parts.add(index, done.outcome)
            n_before += not done.is_new
            if done.outcome.verdict is Verdict.FAILED:
                logger.info("flight %s: %s", done.outcome.folder, done.outcome.reason)
            say(_count_flights(number, len(tasks), n_before))
        parts.remove_older()
    outcomes = tuple(each for each in parts.outcomes if each is not None)
    return Campaign(plan.title, source or Path(plan.title), outcomes, n_before, time.monotonic() - began)


def _plan_tasks(plan: CampaignPlan, target: Path, settings: TaskSettings, is_forced: bool) -> list[FlightTask]:
    """Return a task for each flight, those of one tail together: they share a file of the dataset."""
    taken = {*columns(), "tail"}
    for name in sorted({name for flight in plan.flights for name in flight.covariates} & taken):
        raise InputError(f"the table of flights has a column {name!r}, which is one of the dataset: call it otherwise")
    folders = Counter(flight.folder for flight in plan.flights)
    for folder, n in folders.items():
        if n > 1:
            raise InputError(f"{n} flights would write into flights/{folder}: give each a name of its own")
    above = {flight.tail for flight in plan.flights} & folders.keys()
    for name in sorted(above - {""}):
        raise InputError(f"{name!r} is the name of a flight without a tail number, and a tail number: rename one")
    for name in sorted({flight.tail for flight in plan.flights} & RESERVED_TAILS):
        raise InputError(f"{name!r} cannot be a tail number: readers of the dataset take it for none")
    order: dict[str, list[PlannedFlight]] = {}
    for flight in plan.flights:
        order.setdefault(flight.tail, []).append(flight)
    run = secrets.token_hex(8)
    return [
        FlightTask(flight, plan.options, target, settings, run, is_forced)
        for flights in order.values()
        for flight in flights
    ]


def _count_flights(n_done: int, n_all: int, n_before: int) -> Step:
    """Return what is done; the fraction is one of the flights that are new to this run, for the others take no time.

    >>> step = _count_flights(31, 40, 30)
    >>> step.name, step.fraction
    ('31 of 40 flights, 30 by an earlier run', 0.1)
    """
    before = f", {n_before} by an earlier run" if n_before else ""
    return Step(f"{n_done} of {n_all} flights{before}", (n_done - n_before) / max(n_all - n_before, 1))


# ---- Dask --------------------------------------------------------------------------------------------


@contextmanager
def connect(workers: int | None, scheduler: str | None, engine: EngineSettings = DEFAULTS) -> Iterator[Client]:
    """Start workers on this machine, or reach those of a running scheduler; the former end with the block.

    Args:
        workers: processes on this machine; as many as it has processors if None.
        scheduler: address of a running scheduler in their place, or None.
        engine: the tuned numbers.

    Raises:
        InputError: the scheduler does not answer, or fewer than one worker.
    """
    import dask
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=engine.connection_s)
        except (OSError, TimeoutError, ValueError) as error:
            raise InputError(
                f"there is no scheduler at {scheduler!r}: give the address that `dask scheduler` prints, like "
                "tcp://10.0.0.1:8786"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=engine.connection_s)
            except TimeoutError as error:
                raise InputError(
                    f"the scheduler at {scheduler!r} has no worker: start some with `dask worker {scheduler}`"
                ) from error
            yield client
        return
    if workers is not None and workers < 1:
        raise InputError(f"{workers} workers are given: give one or more")
    n_workers = workers or len(os.sched_getaffinity(0))
    # a worker that dies is replaced, and says so on its own; what a flight has met stands in the result
    with (
        dask.config.set(
            {
                "distributed.scheduler.allowed-failures": engine.most_deaths,
                "distributed.admin.log-format": "%(message)s",
                # Ctrl-C is for the campaign, which ends its workers; each of them would print where it was.
                "distributed.worker.preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
                "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": engine.kept_bytes,
                "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": engine.largest_kept_bytes,
                # Else each worker stops its flight a hundred times a second to note where it is, for a page of Dask.
                "distributed.worker.profile.enabled": False,
            }
        ),
        LocalCluster(
            n_workers=n_workers, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


def _run_tasks(client: Client, tasks: Sequence[FlightTask], engine: EngineSettings) -> Iterator[tuple[int, Done]]:
    """Yield what each task returns with its index, as they end; only some wait at the workers at a time."""
    from distributed import as_completed

    waiting = iter(range(len(tasks)))
    index_of: dict[Any, int] = {}

    def submit_next() -> Any:
        index = next(waiting, None)
        if index is None:
            return None
        future = client.submit(run_task, tasks[index], pure=False)
        index_of[future.key] = index
        return future

    n_first = engine.tasks_per_worker * max(1, len(client.scheduler_info(n_workers=-1)["workers"]))
    running = as_completed([future for _ in range(n_first) if (future := submit_next()) is not None])
    for future in running:
        index = index_of.pop(future.key)
        error = future.exception()
        yield index, future.result() if error is None else _give_up(tasks[index], error)
        following = submit_next()
        if following is not None:
            running.add(following)


def _give_up(task: FlightTask, error: BaseException) -> Done:
    """Return the outcome of a task that could not even say why it failed."""
    reason = f"its worker could not run it, {type(error).__name__}: {error}"
    flight = task.flight
    folder = task.folder.relative_to(task.directory).as_posix()
    outcome = Outcome(
        flight.name, flight.tail, flight.date, flight.covariates, Verdict.FAILED, reason, None, folder, task.digest
    )
    return Done(outcome, True, 0.0)


# ---- the dataset -------------------------------------------------------------------------------------


class _Parts:
    """The parts of the dataset, each written as soon as its last flight has ended."""

    def __init__(self, directory: Path, tasks: Sequence[FlightTask], flights_per_part: int) -> None:
        self.directory = directory
        self.outcomes: list[Outcome | None] = [None] * len(tasks)
        self.covariates = sorted({name for task in tasks for name in task.flight.covariates})
        self.members: dict[tuple[str, int], list[int]] = {}
        of_tail: Counter[str] = Counter()
        self.part_of = []
        for index, task in enumerate(tasks):
            part = task.flight.tail, of_tail[task.flight.tail] // flights_per_part
            of_tail[task.flight.tail] += 1
            self.members.setdefault(part, []).append(index)
            self.part_of.append(part)
        self.left = {part: len(members) for part, members in self.members.items()}
        self.written: set[Path] = set()

    def add(self, index: int, outcome: Outcome) -> None:
        """Take the outcome of a flight, and write its part if it is the last."""
        self.outcomes[index] = outcome
        part = self.part_of[index]
        self.left[part] -= 1
        if not self.left[part]:
            several = [each for each in map(self.outcomes.__getitem__, self.members[part]) if each is not None]
            self.written.add(write_part(self.directory, several, part[1], self.covariates))

    def remove_older(self) -> None:
        """Remove the parts of flights that the campaign no longer has."""
        for path in self.directory.glob("tail=*/part-*.parquet"):
            if path not in self.written:
                path.unlink()
                with suppress(OSError):  # another part is there
                    path.parent.rmdir()
