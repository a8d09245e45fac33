"""Health over time as text and as a page with its figures."""

from __future__ import annotations

from collections import Counter
from itertools import islice

from opid.estimate import rounded
from opid.report.as_text import aligned, labelled, laid_out, wrapped
from opid.report.page import Page, Picture
from opid.suspensions.flights.comparison import Comparison
from opid.suspensions.flights.departures import Point, Series

TITLE = "Health over time"
HEAD = ("", "unit", "expected", "last flight", "±", "departure", "limit", "")


def text_of(result: Comparison) -> str:
    """Return a comparison as text: what changed, the last flight against those before, and what to doubt.

    Args:
        result: from `compare`.
    """
    table = comparison_rows(result)
    lines = iter(aligned([HEAD, *(row for _, row in table)], left=(0, 1)))
    return laid_out(
        [f"{TITLE}: {span(result)}"],
        labelled("Change: " if result.changes else "", changes(result)),
        [next(lines)],
        *([gear, *islice(lines, n)] for gear, n in Counter(heading for heading, _ in table).items()),
        wrapped(basis(result)),
        labelled("Warning: ", (f"{doubt}." for doubt in result.warnings)),
    )


def page_of(result: Comparison) -> Page:
    """Return what the page of a comparison shows.

    Args:
        result: from `compare`.
    """
    table = comparison_rows(result)
    return Page(
        "comparison.html.jinja",
        TITLE,
        comparison_pictures(result),
        {
            "span": span(result),
            "changes": changes(result),
            "flagged": bool(result.changes),
            "columns": HEAD,
            "groups": {gear: [row for heading, row in table if heading == gear] for gear, _ in table},
            "flights": [
                ("flight", "date", "method"),
                *((flight.name, str(flight.date or "-"), flight.method) for flight in result.flights),
            ],
            "basis": basis(result),
        },
        result.warnings,
        command=["opid", "compare", *(str(flight.path) for flight in result.flights)],
        data_file="comparison.json",
    )


def comparison_pictures(result: Comparison) -> tuple[Picture, ...]:
    """Return the figures of a comparison: one for each quantity.

    Args:
        result: from `compare`.
    """
    from opid.plots.comparison import compared_quantity

    labels = list(dict.fromkeys(series.quantity.label for series in result.series))

    def picture(number: int, label: str) -> Picture:
        return Picture(
            f"compared_{number}_{label.split(' (')[0].replace(' ', '_')}",
            label[:1].upper() + label[1:],
            ""
            if number > 1
            else "Values with 95 % intervals; dashed, what the flights before let expect; between the thin lines is "
            "what is not flagged by one flight alone; rings, what is flagged. Hollow values have no interval and are "
            "not judged.",
            lambda found, truth: compared_quantity(found, label),
        )

    return tuple(picture(number, label) for number, label in enumerate(labels, start=1))


def span(result: Comparison) -> str:
    """Return how many flights there are, and from when.

    Args:
        result: from `compare`.
    """
    first, last = result.flights[0], result.flights[-1]
    when = f"{first.date} to {last.date}" if result.dated else f"{first.name} to {last.name}"
    return f"{len(result.flights)} flights, {when}"


def changes(result: Comparison) -> list[str]:
    """Return what changed as sentences, or that nothing did.

    Args:
        result: from `compare`.
    """
    if not result.changes:
        return ["No change exceeds its uncertainty."]
    return [f"{change.statement[:1].upper()}{change.statement[1:]}." for change in result.changes]


def basis(result: Comparison) -> str:
    """Return the sentence that says what a flag means.

    Args:
        result: from `compare`.
    """
    return (
        f"Each flight is compared with the weighted mean of the earlier ones that were not flagged, by itself and with "
        f"the one before it: {result.n_tests} comparisons. Departures are in standard deviations. If nothing changed, "
        f"the chance of any flag is {result.false_alarm:g}. To judge by a new state, after a repair, leave out the "
        "results before it."
    )


def comparison_rows(result: Comparison) -> list[tuple[str, tuple[str, ...]]]:
    """Return the last judged flight of each series against those before.

    Args:
        result: from `compare`.

    Returns:
        The gear, and cells in the order of `HEAD`; the gears in the order of the flights.
    """
    gears = list(dict.fromkeys(series.quantity.gear for series in result.series))
    gears.sort(key=lambda gear: not gear)
    return [
        (gear or "whole body", _row(series))
        for gear in gears
        for series in result.series
        if series.quantity.gear == gear
    ]


def _row(series: Series) -> tuple[str, ...]:
    quantity = series.quantity
    # a kind of friction is told where it is looked for, and here there are 80 characters
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
        _flag(series, last),
    )


def _flag(series: Series, last: Point) -> str:
    if last.flagged:
        return "flagged"
    return "flagged before" if any(point.flagged for point in series.points) else ""
