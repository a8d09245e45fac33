"""Many trials of the scenarios, on several processes, kept line by line so that a long run is not lost."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from bounds import linear_bound
from identification import Timing
from scenarios import SCENARIOS, LawMode
from tqdm import tqdm
from trials import PLAIN, Trial, compared, simulated, study_of


@dataclass(frozen=True)
class Record:
    """One trial with what it was a trial of.

    Args:
        scenario: name in `SCENARIOS`.
        method: one of `trials.METHODS`.
        law: "given" or "searched", which opid was told; the plain chains are the same for both.
        trial: what came of it.
        bound: Cramer-Rao bounds of the linear gear, SI; empty for others.
    """

    scenario: str
    method: str
    law: LawMode
    trial: Trial
    bound: dict[str, float]

    @property
    def key(self) -> tuple[str, int, str, str]:
        return self.scenario, self.trial.seed, self.method, _law_told(self.method, self.law)


@dataclass(frozen=True)
class Job:
    """One simulated test and the methods that are still to identify it."""

    scenario: str
    seed: int
    law: LawMode
    methods: tuple[str, ...]


def missing_jobs(
    wanted: dict[str, int], laws: dict[str, LawMode], methods: Sequence[str], done: Iterable[Record]
) -> list[Job]:
    """Return the jobs for {scenario: number of seeds} of which no record is there, or one of a crash."""
    there = {record.key for record in done if not record.trial.crashed}
    jobs = []
    for scenario, n_seeds in wanted.items():
        for seed in range(n_seeds):
            law = laws[scenario]
            left = tuple(m for m in methods if (scenario, seed, m, _law_told(m, law)) not in there)
            if left:
                jobs.append(Job(scenario, seed, law, left))
    return jobs


def _law_told(method: str, law: str) -> str:
    return "" if method in PLAIN else law


def run_job(job: Job) -> list[Record]:
    """Simulate one test and identify it by each method."""
    case = SCENARIOS[job.scenario].case(job.seed)
    case = replace(case, law=case.gear.law.name if job.law == "given" else None)
    bound = linear_bound(case, job.seed) if job.scenario == "linear" else {}
    study = study_of(simulated(case, job.seed), case.sensors)
    return [Record(job.scenario, m, job.law, compared(case, job.seed, study, m), bound) for m in job.methods]


def run_jobs(jobs: Sequence[Job], *, n_processes: int) -> Iterator[Record]:
    """Yield the records of all jobs as they come, with progress on stderr."""
    if n_processes < 2 or len(jobs) < 2:
        for job in tqdm(jobs, unit="test", disable=None):
            yield from run_job(job)
        return
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(n_processes, mp_context=fresh) as pool:
        for records in tqdm(pool.map(run_job, jobs), total=len(jobs), unit="test", disable=None):
            yield from records


def as_line(record: Record | Timing) -> str:
    """Return a record as one line of JSON, numbers that are not there as null."""

    def plain(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: plain(each) for name, each in value.items()}
        if isinstance(value, tuple):
            return [plain(each) for each in value]
        if isinstance(value, float | np.floating):
            return float(value) if np.isfinite(value) else None
        return bool(value) if isinstance(value, np.bool_) else value

    return json.dumps(plain(asdict(record)))


def read_records(paths: Iterable[str | Path]) -> list[Record]:
    """Return the records of files written by `as_line`; a later one replaces an earlier one of the same trial."""
    found: dict[tuple, Record] = {}
    for path in paths:
        for entry in _entries(path):
            if "trial" not in entry:
                continue
            # a file from before a field was added has no such number
            values = {field.name: entry["trial"].get(field.name) for field in fields(Trial)}
            for name in ("error", "std", "truth"):
                values[name] = {key: np.nan if v is None else v for key, v in values[name].items()}
            for name in ("unexplained", "seconds", "busy_s", "printed", "two_ratios"):
                values[name] = np.nan if values[name] is None else values[name]
            record = Record(entry["scenario"], entry["method"], entry["law"], Trial(**values), entry["bound"])
            found[record.key] = record
    return list(found.values())


def read_timings(paths: Iterable[str | Path]) -> list[Timing]:
    """Return the timings of such files, the last of each way."""
    found = {}
    for entry in (entry for path in paths for entry in _entries(path) if "peak_mib" in entry):
        percent = tuple(np.nan if v is None else v for v in entry["percent"])
        times = {name: np.nan if entry.get(name) is None else entry[name] for name in ("seconds", "busy_s")}
        found[entry["method"], entry["law"]] = Timing(**entry | {"percent": percent} | times)
    return list(found.values())


def _entries(path: str | Path) -> Iterator[dict[str, Any]]:
    yield from (json.loads(line) for line in Path(path).read_text().splitlines())
