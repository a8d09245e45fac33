"""The report of results of many flights against each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from opid.estimate import Estimate, format_number, rounded, with_std
from opid.report.document import (
    Block,
    Document,
    Figure,
    Paragraph,
    Remarks,
    Row,
    Table,
    build_columns,
    build_warnings,
    format_count,
    write_sentence,
)
from opid.report.suspensions.campaign import OVERLAY, overlay_laws, write_head
from opid.suspensions.flights.comparison import Comparison
from opid.suspensions.flights.departures import Point, Series
from opid.suspensions.flights.result_file import Flight, Quantity


def build_document(result: Comparison) -> Document:
    """Return the report of a comparison: the changes, the last flight against those before, and the warnings."""
    changes = tuple(write_sentence(change.statement) for change in result.changes)
    heads = build_columns(
        "", "unit", "expected", "latest", "std. dev.", "departure", "limit", "", left=(0, 1, 7), optional=(6,)
    )
    return Document(
        "Health over time",
        _say_span(result),
        write_sentence(
            f"{format_count(len(changes), 'change')} flagged" if changes else "no change exceeds its uncertainty"
        ),
        None,
        (
            Remarks("Change", changes, is_warning=True),
            Table(heads, tuple(_list_rows(result))),
            Paragraph(_say_basis(result)),
            build_warnings(result.warnings),
        ),
        lambda: _list_details(result),
        ["opid", "compare", *(str(flight.path) for flight in result.flights)],
        source="results",
        data_file="comparison.json",
    )


def _list_details(result: Comparison) -> Iterator[Block]:
    from opid.plots.comparison import compared_quantity

    labels = list(dict.fromkeys(series.quantity.label for series in result.series))

    def build_figure(number: int, label: str) -> Figure:
        return Figure(
            f"compared_{number}_{label.split(' (')[0].replace(' ', '_')}",
            label[:1].upper() + label[1:],
            ""
            if number > 1
            else "Values with 95 % intervals. Dashed: the value expected from earlier flights; thin lines: limits for "
            "one flight alone; rings: flagged values. Hollow values have no interval and are not judged.",
            lambda: compared_quantity(result, label),
        )

    for number, label in enumerate(labels, start=1):
        yield build_figure(number, label)
    yield from overlay_laws({flight.name: flight for flight in result.flights})
    quantities = tuple(dict.fromkeys(series.quantity for series in result.series))
    yield Table(
        build_columns("flight", "date", "method", *map(write_head, quantities), left=(0, 1, 2)),
        tuple(_build_flight_row(flight, quantities) for flight in result.flights),
        "Flights",
        note="Values are given ± one standard deviation; a head sorts by the values of its column.",
        is_filtered=True,
        links=tuple(flight.page for flight in result.flights),
        overlay=OVERLAY if any(flight.strut_laws for flight in result.flights) else "",
        keys=tuple(flight.name if flight.strut_laws else "" for flight in result.flights),
    )


def _build_flight_row(flight: Flight, quantities: Sequence[Quantity]) -> Row:
    found = (flight.values.get(quantity, Estimate()) for quantity in quantities)
    values = (with_std(each.value, each.std) for each in found)
    return (flight.name, str(flight.date or "-"), flight.method, *values)


def _say_span(result: Comparison) -> str:
    first, last = result.flights[0], result.flights[-1]
    when = f"{first.date} to {last.date}" if result.dated else f"{first.name} to {last.name}"
    return f"{len(result.flights)} flights, {when}"


def _say_basis(result: Comparison) -> str:
    return (
        f"Each flight is compared with the weighted mean of the earlier ones that were not flagged, by itself and with "
        f"the one before it: {result.n_tests} comparisons. Departures are in standard deviations. If nothing changed, "
        f"the chance of any flag is {format_number(result.false_alarm)}. To judge by a new state, after a repair, "
        "leave out the results before it."
    )


def _list_rows(result: Comparison) -> Iterator[tuple[str, ...]]:
    """The last judged flight of each series against those before, gear by gear."""
    gears = list(dict.fromkeys(series.quantity.gear for series in result.series))
    for gear in sorted(gears, key=lambda gear: not gear):
        yield (gear or "whole body",)
        yield from (_build_row(series) for series in result.series if series.quantity.gear == gear)


def _build_row(series: Series) -> tuple[str, ...]:
    quantity = series.quantity
    # a line has only 80 characters, so that the kind of friction stands elsewhere
    label = quantity.label.split(" (")[0]
    if not series.judged:
        return (label, quantity.unit, "-", "-", "-", "-", "-", "not judged")
    last = series.judged[-1]
    std = last.estimate.std
    return (
        label,
        quantity.unit,
        rounded(last.expected, std),
        rounded(last.estimate.value, std),
        rounded(std, std),
        f"{last.departure:+.1f}",
        f"{series.threshold:.1f}",
        _say_flag(series, last),
    )


def _say_flag(series: Series, last: Point) -> str:
    if last.flagged:
        return "flagged"
    return "flagged before" if any(point.flagged for point in series.points) else ""
