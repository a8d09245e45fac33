"""One flight as a task: a worker reads its logs, identifies it, and leaves its folder whole, or the reason why not."""

from __future__ import annotations

import faulthandler
import hashlib
import json
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Any

from opid.campaigns.campaign_file import IdentifyOptions, PlannedFlight
from opid.errors import InputError, NotDeterminedError
from opid.json_values import json_text, plain, read_json
from opid.provenance import ReadFile, read_file, traced
from opid.result import RESULT_FILE
from opid.signals.files import make_directory, write_together, write_whole
from opid.suspensions.flights.campaign import Outcome, Verdict
from opid.suspensions.flights.result_file import read_flight

OUTCOME_FILE = "outcome.json"
_BEGUN_FILE = "begun.json"
_TRACE_FILE = "where_it_hung.txt"

_ALONE = Lock()
"""A process identifies one flight at a time: it has one timer, and compiled functions gain nothing from threads."""


@dataclass(frozen=True)
class TaskSettings:
    """How the flights of a campaign are worked on.

    Args:
        time_limit_s: a flight that takes longer has failed. An ordinary one takes seconds, and a refusal on long
            records of a whole aircraft takes minutes.
        most_attempts: a flight has failed if its worker died this often. A worker that is killed for other reasons
            (a node that is taken back) seldom meets the same flight twice.
        with_pages: whether each flight gets a report page; a page takes 1 s and 3 MB.
        with_figures: whether these pages have figures.
    """

    time_limit_s: float = 600.0
    most_attempts: int = 5
    with_pages: bool = False
    with_figures: bool = True


@dataclass(frozen=True)
class FlightTask:
    """A flight, how it is identified, and where its results go.

    Args:
        flight: the flight.
        options: how it is identified.
        directory: of the campaign; the flight has a folder in it.
        settings: how it is worked on.
        run: of the campaign, by a word of its own: attempts of an earlier run, which somebody may have stopped, do
            not count.
        is_forced: whether it is identified again although an earlier run has done it.
    """

    flight: PlannedFlight
    options: IdentifyOptions
    directory: Path
    settings: TaskSettings = TaskSettings()
    run: str = ""
    is_forced: bool = False

    @property
    def folder(self) -> Path:
        """The folder of the results of the flight."""
        return self.directory / "flights" / self.flight.folder

    @property
    def digest(self) -> str:
        """The hash of all that decides on the result but the logs: study, options, version of opid."""
        from opid import __version__

        said = {"study": self.flight.document, "options": asdict(self.options), "opid": __version__}
        return hashlib.sha256(json.dumps(said, sort_keys=True, default=str).encode()).hexdigest()


@dataclass(frozen=True)
class Done:
    """What a task returns.

    Args:
        outcome: of the flight.
        is_new: whether it was identified by this task, and not by an earlier run.
        cpu_s: processor time, s.
    """

    outcome: Outcome
    is_new: bool
    cpu_s: float


def run_task(task: FlightTask) -> Done:
    """Identify a flight, unless an earlier run has done it with the same files and options; it never raises.

    A worker that dies leaves `begun.json`, from which the next one knows how often that happened. A flight that takes
    longer than the time limit ends the process, for compiled code listens to nothing else; the next attempt finds the
    trace that the timer has left, and reports it.

    Args:
        task: the flight, and where its results go.
    """
    start = time.process_time()
    with _ALONE:
        earlier = None if task.is_forced else _find_outcome(task)
        outcome = earlier or _identify_whole(task)
    return Done(outcome, earlier is None, time.process_time() - start)


def _find_outcome(task: FlightTask) -> Outcome | None:
    """Return what an earlier run has left, if it is that of the same task and its files are as they were.

    A flight that failed because of its files is tried again: they may have been mended.
    """
    try:
        said = read_json(task.folder / OUTCOME_FILE)
        files = tuple(ReadFile(**each) for each in said["files"])
        is_same = said["task_sha256"] == task.digest and not said["is_to_be_repeated"]
        if said["result_sha256"] is not None:
            is_same = is_same and read_file(task.folder / RESULT_FILE).sha256 == said["result_sha256"]
        has_more_time = said["time_limit_s"] is not None and said["time_limit_s"] < task.settings.time_limit_s
        # A log that is no longer there, because it was archived or its disk is not mounted, has not changed.
        there = [each for each in files if Path(each.name).exists()]
        if is_same and not has_more_time and all(read_file(Path(each.name)) == each for each in there):
            return _build_outcome(task, Verdict(said["verdict"]), said["reason"], files)
    except (OSError, ValueError, KeyError, TypeError):
        pass  # there is none, or it is not whole
    return None


def _identify_whole(task: FlightTask) -> Outcome:
    make_directory(task.folder)
    if reason := _count_attempt(task):
        return _leave(task, Verdict.FAILED, reason, {}, time_limit_s=task.settings.time_limit_s)
    from opid.suspensions.identification import identify

    contents: dict[str, bytes] = {}
    try:
        with _limit_time(task):
            study = _read_logs(task.flight)
            result = identify(study, **asdict(task.options))
            contents[RESULT_FILE] = json_text(traced(result.to_dict(), result.files)).encode(
                "utf-8", "backslashreplace"
            )
            if task.settings.with_pages:
                from opid.report import write_report

                write_report(result, task.folder, figures=task.settings.with_figures)
    except (InputError, NotDeterminedError) as error:
        return _leave(task, Verdict.FAILED, str(error), {}, is_to_be_repeated=True)
    except Exception as error:  # a fault of opid must not end the campaign
        trace = "".join(traceback.format_exception(error)).encode("utf-8", "backslashreplace")
        reason = f"an error in opid itself, {type(error).__name__}: {error}; please report it with error.txt"
        return _leave(task, Verdict.FAILED, reason, {"error.txt": trace})
    reason = result.not_determined or ""
    verdict = Verdict.NOT_DETERMINED if reason else Verdict.IDENTIFIED
    return _leave(task, verdict, reason, contents, files=result.files)


def _read_logs(flight: PlannedFlight) -> Any:
    from opid.studies.suspension_study import build_study

    return build_study(flight.document, flight.source, lambda step: None)


def _leave(
    task: FlightTask,
    verdict: Verdict,
    reason: str,
    contents: dict[str, bytes],
    *,
    files: tuple[ReadFile, ...] = (),
    is_to_be_repeated: bool = False,
    time_limit_s: float | None = None,
) -> Outcome:
    """Write what a flight has given, its outcome as the last file, and return the outcome.

    One that was given up within a time limit is tried again where there is more time.
    """
    said = {
        "schema": "opid.outcome/1",
        "verdict": verdict.value,
        "reason": reason,
        "is_to_be_repeated": is_to_be_repeated,
        "time_limit_s": time_limit_s,
        "task_sha256": task.digest,
        "result_sha256": hashlib.sha256(contents[RESULT_FILE]).hexdigest() if RESULT_FILE in contents else None,
        "files": [asdict(each) for each in files],
    }
    # a result of an earlier run is no longer that of this task
    stale = [_BEGUN_FILE, _TRACE_FILE, "error.txt", *([] if RESULT_FILE in contents else [RESULT_FILE, "report.html"])]
    outcome = json_text(plain(said)).encode("utf-8", "backslashreplace")
    write_together(task.folder, contents | {OUTCOME_FILE: outcome}, stale=stale)
    return _build_outcome(task, verdict, reason, files)


def _build_outcome(task: FlightTask, verdict: Verdict, reason: str, files: tuple[ReadFile, ...]) -> Outcome:
    from opid import __version__

    path = task.folder / RESULT_FILE
    flight = None if verdict is Verdict.FAILED else replace(read_flight(path, task.flight.name), file=None)
    return Outcome(
        task.flight.name,
        task.flight.tail,
        task.flight.date,
        task.flight.covariates,
        verdict,
        reason,
        flight,
        task.folder.relative_to(task.directory).as_posix(),
        task.digest,
        files,
        __version__,
    )


# ---- flights that do not end -------------------------------------------------------------------------


def _count_attempt(task: FlightTask) -> str:
    """Return why a flight is not tried again, and count the attempt if it is."""
    begun, n_before = task.folder / _BEGUN_FILE, 0
    with suppress(OSError, ValueError, KeyError, TypeError):
        said = read_json(begun)
        n_before = int(said["attempts"]) if said["run"] == task.run else 0
    trace = task.folder / _TRACE_FILE
    if n_before and trace.exists() and trace.stat().st_size:
        return (
            f"it did not end within {task.settings.time_limit_s:g} s: shorten its runs, state the law, or give more "
            "time with --time-limit"
        )
    if n_before >= task.settings.most_attempts:
        return (
            f"its worker died {n_before} times while it was identified, probably for want of memory: shorten its runs"
        )
    with write_whole(begun) as file:
        file.write(json_text({"attempts": n_before + 1, "run": task.run}))
    return ""


@contextmanager
def _limit_time(task: FlightTask) -> Iterator[None]:
    """End the process if the block takes longer than the time limit, after its trace is written."""
    with (task.folder / _TRACE_FILE).open("w", encoding="utf-8") as trace:
        faulthandler.dump_traceback_later(task.settings.time_limit_s, exit=True, file=trace)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
