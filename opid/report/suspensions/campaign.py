"""The report of a campaign: what became of each flight, its main numbers, and the way to its results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from opid.estimate import rounded
from opid.report.document import (
    Block,
    Document,
    Figure,
    Remarks,
    Row,
    Table,
    build_columns,
    format_count,
    write_sentence,
)
from opid.suspensions.flights.campaign import DATASET, INDEX_FILE, Campaign, Outcome
from opid.suspensions.flights.result_file import Flight, Quantity

OVERLAY = "laws"
"""Name of the figure in which flights are overlaid."""

MOST_OVERLAID = 200
"""Flights whose laws a page holds, the latest; each takes 3 kB."""

_MOST_REASONS = 20
"""Reasons that are said; the table of flights has all of them."""


def build_document(result: Campaign) -> Document:
    """Return the report of a campaign: how many flights were identified, and why the others were not."""
    said = ", ".join(f"{n} {verdict.value}" for verdict, n in result.counts.items() if n)
    reasons = Counter(each.reason for each in result.outcomes if each.reason).most_common()
    sentences = [f"{format_count(n, 'flight')}: {reason}" for reason, n in reasons[:_MOST_REASONS]]
    more = [f"and {len(reasons) - _MOST_REASONS} more, in the table of flights"] if len(reasons) > _MOST_REASONS else []
    n_aircraft = len({each.tail for each in result.outcomes})
    return Document(
        result.title,
        f"{format_count(len(result.outcomes), 'flight')} of {n_aircraft} aircraft",
        write_sentence(said),
        None,
        (Remarks("Reason", (*sentences, *more), is_warning=True),),
        lambda: _list_details(result),
        ["opid", "campaign", str(result.source)],
        source="studies and logs",
        data_file=INDEX_FILE,
        numbers=f"Verdicts and reasons stand in {INDEX_FILE}, all numbers in the folder {DATASET} beside this page, in "
        "SI units.",
        page_file="index.html",
    )


def _list_details(result: Campaign) -> Iterator[Block]:
    flights = {_write_name(each): each.flight for each in result.outcomes if each.flight is not None}
    yield from overlay_laws(flights)
    quantities = _choose_quantities(result.outcomes)
    heads = build_columns(
        "flight",
        "tail",
        "date",
        "verdict",
        *map(write_head, quantities),
        left=(0, 1, 2, 3),
        elastic=(3,),
    )
    overlaid = set(_choose_overlaid(flights))
    yield Table(
        heads,
        tuple(_build_row(each, quantities) for each in result.outcomes),
        "Flights",
        note=f"Standard deviations, intervals and all other values stand in the folder {DATASET!r}.",
        is_filtered=True,
        links=tuple(each.flight.page if each.flight else None for each in result.outcomes),
        overlay=OVERLAY if overlaid else "",
        keys=tuple(_write_name(each) if _write_name(each) in overlaid else "" for each in result.outcomes),
    )


def overlay_laws(flights: dict[str, Flight]) -> Iterator[Block]:
    """Yield the figure in which a reader overlays the laws of flights, if there are some."""
    from opid.plots.fleet import draw_flight_laws

    chosen = _choose_overlaid(flights)
    if not chosen:
        return
    first = f"The first {MOST_OVERLAID} flights have a box. " if len(chosen) == MOST_OVERLAID else ""
    yield Figure(
        OVERLAY,
        "Laws of chosen flights",
        f"Tick flights in the table to overlay their springs and dampers. {first}Left: the force that carries the "
        "body, over the travel of the runs. Right: the force of the damper in the position of rest, without parts that "
        "have a memory.",
        lambda: draw_flight_laws(chosen),
        is_chosen=True,
    )


def _choose_overlaid(flights: dict[str, Flight]) -> dict[str, Flight]:
    known = [name for name, flight in flights.items() if flight.strut_laws]
    return {name: flights[name] for name in known[:MOST_OVERLAID]}


def _write_name(outcome: Outcome) -> str:
    return " ".join(filter(None, (outcome.tail, outcome.name)))


def _choose_quantities(outcomes: Sequence[Outcome]) -> list[Quantity]:
    """Return what most flights have: mass, and stiffness (or gas) and damping of each suspension."""
    counts = Counter(what for each in outcomes if each.flight is not None for what in each.flight.values)
    order, least = ("mass", "gas", "stiffness", "damping"), 0.1 * sum(each.flight is not None for each in outcomes)
    kept = [what for what, n in counts.items() if what.name in order and n > least]
    return sorted(kept, key=lambda what: (order.index(what.name), what.gear))


def write_head(quantity: Quantity) -> str:
    """Return a quantity with its suspension and unit as the head of a column of flights."""
    label = " ".join(filter(None, (quantity.gear, quantity.label.split(" (")[0])))
    return f"{label} [{quantity.unit}]"


def _build_row(outcome: Outcome, quantities: Sequence[Quantity]) -> Row:
    values = {} if outcome.flight is None else outcome.flight.values
    cells = []
    for what in quantities:
        estimate = values.get(what)
        cells.append("-" if estimate is None else rounded(estimate.value, estimate.std))
    # The reason stands before the numbers, which a narrow window may cut.
    verdict = ": ".join(filter(None, (outcome.verdict.value, outcome.reason)))
    return (outcome.name, outcome.tail or "-", str(outcome.date or "-"), verdict, *cells)
