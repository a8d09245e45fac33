"""A campaign: the outcome of each of many flights, whether it was identified or not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from enum import StrEnum
from pathlib import Path
from typing import Any

from opid.json_values import plain
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.suspensions.flights.result_file import Flight

SCHEMA = "opid.campaign/1"

INDEX_FILE = "campaign.json"
DATASET = "dataset"
"""Folder of the Parquet files, beside `INDEX_FILE`."""


class Verdict(StrEnum):
    """What became of a flight: its values are determined, they are not, or it could not be identified at all."""

    IDENTIFIED = "identified"
    NOT_DETERMINED = "not determined"
    FAILED = "failed"


@dataclass(frozen=True)
class Outcome:
    """What became of one flight.

    Args:
        name: of the flight.
        tail: tail number of the aircraft; empty where none is stated.
        date: of the flight, or None.
        covariates: {name: value} of what may act on the suspensions.
        verdict: whether it was identified.
        reason: why not; empty if it was.
        flight: its values; None if it failed.
        folder: path of its results beside `INDEX_FILE`.
        task_sha256: hash of its study, of the options, and of the version of opid.
        files: the study and the logs, as they were when they were read.
        opid: version that identified it.
    """

    name: str
    tail: str
    date: date | None
    covariates: Mapping[str, float]
    verdict: Verdict
    reason: str
    flight: Flight | None
    folder: str
    task_sha256: str
    files: tuple[ReadFile, ...] = ()
    opid: str = ""


@dataclass(frozen=True, repr=False)
class Campaign(Result):
    """The outcomes of a campaign.

    Args:
        title: of the campaign.
        source: the campaign file, or the folder of studies.
        outcomes: one for each flight, by tail, in the order of the table.
        n_done_before: how many of them an earlier run had left.
        seconds: duration of this run, s.
    """

    title: str
    source: Path
    outcomes: tuple[Outcome, ...]
    n_done_before: int = field(default=0, compare=False)
    seconds: float = field(default=0.0, compare=False)

    @property
    def counts(self) -> Mapping[Verdict, int]:
        """The number of flights of each verdict."""
        counted = Counter(each.verdict for each in self.outcomes)
        return {verdict: counted[verdict] for verdict in Verdict}

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the number of flights of each verdict."""
        rows = {"flights": len(self.outcomes)} | {verdict.value: n for verdict, n in self.counts.items()}
        return tuple(SummaryRow(name, float(n), None, None, "1") for name, n in rows.items())

    def to_dict(self) -> dict[str, Any]:
        """Return the content of campaign.json, as `docs/schemas/campaign-1.schema.json` describes it."""
        return plain(
            {
                "schema": SCHEMA,
                "title": self.title,
                "source": str(self.source),
                "counts": {verdict.value: n for verdict, n in self.counts.items()},
                "flights": [
                    {
                        "name": each.name,
                        "tail": each.tail,
                        "date": None if each.date is None else each.date.isoformat(),
                        "verdict": each.verdict.value,
                        "reason": each.reason,
                        "folder": each.folder,
                        "covariates": dict(each.covariates),
                    }
                    for each in self.outcomes
                ],
            }
        )

    def _write_headline(self) -> str:
        said = ", ".join(f"{n} {verdict.value}" for verdict, n in self.counts.items() if n)
        return f"{len(self.outcomes)} flights: {said}"
