"""The report of a campaign: what became of each flight, its main numbers, and the way to its results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from opid.estimate import rounded
from opid.report.document import Block, Document, Remarks, Row, Table, columns, counted, sentence
from opid.suspensions.flights.campaign import DATASET, INDEX_FILE, Campaign, Outcome, Verdict


def document_of(result: Campaign) -> Document:
    """Return the report of a campaign: how many flights were identified, and why the others were not."""
    said = ", ".join(f"{n} {verdict.value}" for verdict, n in result.counts.items() if n)
    n_aircraft = len({each.tail for each in result.outcomes})
    reasons = Counter(each.reason for each in result.outcomes if each.reason)
    return Document(
        result.title,
        f"{counted(len(result.outcomes), 'flight')} of {n_aircraft} aircraft",
        sentence(said),
        None,
        (
            Remarks(
                "Reason", tuple(f"{n} x {sentence(reason)}" for reason, n in reasons.most_common()), is_warning=True
            ),
        ),
        lambda: _list_details(result),
        ["opid", "campaign", str(result.source)],
        source="results",
        data_file=INDEX_FILE,
    )


def _list_details(result: Campaign) -> Iterator[Block]:
    heads = columns(
        "flight", "tail", "date", "verdict", "quantity", "value", "std. dev.", "unit", left=(0, 1, 2, 3, 4, 7)
    )
    rows = tuple(row for each in result.outcomes for row in _list_rows(each))
    yield Table(heads, rows, "Flights", note=f"All values with their intervals stand in the folder {DATASET!r}.")


def _list_rows(outcome: Outcome) -> Iterator[Row]:
    head = (outcome.name, outcome.tail or "-", str(outcome.date or "-"), outcome.verdict.value)
    if outcome.flight is None or outcome.verdict is not Verdict.IDENTIFIED:
        yield (*head, "-", "-", "-", "-")
        return
    for what, estimate in outcome.flight.values.items():
        label = " ".join(filter(None, (what.gear, what.label)))
        std = estimate.std
        yield (*head, label, rounded(estimate.value, std), rounded(std, std), what.unit)
