"""A comparison of flights as the content of comparison.json."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from opid.json_values import plain
from opid.suspensions.flights.comparison import SCHEMA, Change, Comparison
from opid.suspensions.flights.departures import Point, Series


def comparison_json(result: Comparison) -> dict[str, Any]:
    """Return a comparison as the content of comparison.json.

    Args:
        result: from `compare`.

    Returns:
        What `docs/schemas/comparison-1.schema.json` describes.
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


def _of_what(found: Series | Change) -> dict[str, Any]:
    return {"gear": found.quantity.gear, "quantity": found.quantity.name, "kind": found.quantity.kind}


def _point(point: Point) -> dict[str, Any]:
    own = asdict(point)
    head, expected_std = {"flight": own.pop("flight")} | own.pop("estimate"), own.pop("std")
    return head | own | {"expected_std": expected_std}
