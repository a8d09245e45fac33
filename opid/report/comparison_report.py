"""Health over time as text, JSON and a page with its figures."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from opid.json_values import json_text, plain
from opid.report.as_text import aligned, rounded, wrapped
from opid.report.page import Picture, drawn, rendered
from opid.signals.directory import write_together
from opid.suspensions.flights.comparison import Change, Comparison
from opid.suspensions.flights.departures import Point, Series

SCHEMA = "opid.comparison/1"
TITLE = "Health over time"
HEAD = ("", "unit", "expected", "last flight", "±", "departure", "limit", "")


def comparison_text(result: Comparison) -> str:
    """Return a comparison as text: what changed, the last flight against those before, and what to doubt.

    Args:
        result: from `compare`.
    """
    parts = [f"{TITLE}: {span(result)}", ""]
    parts += [line for sentence in changes(result) for line in wrapped(sentence, "Change: " if result.changes else "")]
    table = comparison_rows(result)
    gears = dict.fromkeys(heading for heading, _ in table)
    lines = iter(aligned([HEAD, *(row for _, row in table)], n_left=2))
    parts += ["", next(lines)]
    for gear in gears:
        parts += ["", gear, *(next(lines) for heading, _ in table if heading == gear)]
    parts += ["", *wrapped(basis(result))]
    if result.warnings:
        parts += ["", *(line for doubt in result.warnings for line in wrapped(f"{doubt}.", "Warning: "))]
    return "\n".join(parts) + "\n"


def comparison_json(result: Comparison) -> dict[str, Any]:
    """Return a comparison as the content of comparison.json.

    Args:
        result: from `compare`.

    Returns:
        `schema`, `flagged`, `false_alarm`, `n_tests`, `structure`, `dated`, `flights` [{name, path, date, method}],
        `series` [{gear, quantity, kind, unit, scatter, threshold, points [{flight, value, std, interval95, status,
        expected, expected_std, limits, departure, with_next, confirmed}]}], `changes` [{gear, quantity, kind, first,
        last, share {value, std, interval95}, departure, confirmed, statement}], `warnings`, `settings`; flights are
        counted from 0 in `flight`, `first` and `last`.
    """
    return plain(
        {
            "schema": SCHEMA,
            "flagged": bool(result.changes),
            "false_alarm": result.false_alarm,
            "n_tests": result.n_tests,
            "structure": result.flights[0].structure,
            "dated": result.dated,
            "flights": [
                {
                    "name": flight.name,
                    "path": str(flight.path),
                    "date": None if flight.date is None else flight.date.isoformat(),
                    "method": flight.method,
                }
                for flight in result.flights
            ],
            "series": [
                _of_what(series)
                | {"unit": series.quantity.unit, "scatter": series.scatter, "threshold": series.threshold}
                | {"points": [_point(point) for point in series.points]}
                for series in result.series
            ],
            "changes": [
                _of_what(change)
                | {"first": change.first, "last": change.last, "share": asdict(change.share)}
                | {"departure": change.departure, "confirmed": change.confirmed, "statement": change.statement}
                for change in result.changes
            ],
            "warnings": result.warnings,
            "settings": asdict(result.settings),
        }
    )


def write_comparison_report(
    result: Comparison,
    directory: str | os.PathLike[str],
    *,
    paths: Sequence[str | os.PathLike[str]] = (),
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write comparison.json, report.html and the figures as PNG, and return the path of the page.

    Args:
        result: from `compare`.
        directory: made if it is not there; all files appear together, any other file in it stays.
        paths: what was compared, as it was given, for the command on the page.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    pictures = comparison_pictures(result)
    images = drawn(pictures, result, None, progress=progress)
    table = comparison_rows(result)
    page = rendered(
        "comparison.html.jinja",
        images,
        title=TITLE,
        span=span(result),
        changes=changes(result),
        flagged=bool(result.changes),
        columns=HEAD,
        groups={gear: [row for heading, row in table if heading == gear] for gear, _ in table},
        flights=[(flight.name, str(flight.date or "-"), flight.method) for flight in result.flights],
        basis=basis(result),
        warnings=result.warnings,
        pictures=pictures,
        command=f"opid compare {' '.join(shlex.quote(os.fspath(path)) for path in paths) or 'RESULT...'}",
    )
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = page.encode()
    # last, so that a comparison.json is never there without its report
    contents["comparison.json"] = json_text(comparison_json(result)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


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
    judged = [point for point in series.points if point.departure is not None]
    # a kind of friction is told where it is looked for, and here there are 80 characters
    label = quantity.label.split(" (")[0]
    if not judged:
        return (label, quantity.unit, "-", "-", "-", "-", "-", "not judged")
    last = judged[-1]
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


def _of_what(found: Series | Change) -> dict[str, Any]:
    return {"gear": found.quantity.gear, "quantity": found.quantity.name, "kind": found.quantity.kind}


def _point(point: Point) -> dict[str, Any]:
    own = asdict(point)
    estimate, own["expected_std"] = own.pop("estimate"), own.pop("std")
    return {"flight": own.pop("flight"), **estimate, **own}
