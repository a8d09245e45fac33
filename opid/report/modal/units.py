"""The coefficients of a mode's restoring force in a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from opid.estimate import Estimate
from opid.report.as_text import Row, columns, estimate_row

SPREAD = columns(None).index("std. dev.")
"""The column of the standard deviation, which the interval beside it tells too."""


def coefficient_columns(truth: Mapping[str, Any] | None = None) -> tuple[str, ...]:
    """Return the heads of a table of coefficients: value, interval and unit, and with a truth what it is beside.

    Args:
        truth: as in truth.json, or None.

    >>> coefficient_columns()
    ('', 'value', '95 % interval', 'unit')
    """
    heads = columns(truth)
    return heads if truth is not None else heads[:SPREAD] + heads[SPREAD + 1 :]


def coefficient_row(
    label: str, unit: str, estimate: Estimate, true: float | None = None, with_truth: bool = False
) -> Row:
    """Return a coefficient as a line of that table.

    Args:
        label: what it is, like "k3".
        unit: of the value.
        estimate: value and interval.
        true: of a simulation.
        with_truth: whether the table has columns for the truth.

    >>> coefficient_row("k3", "N/(m^3 kg^2)", Estimate.normal(5.0, 0.5)).cells
    ('5.00', '4.02 .. 5.98', 'N/(m^3 kg^2)')
    """
    row = estimate_row(label, unit, estimate, true, with_truth)
    return row if with_truth else Row(label, row.cells[: SPREAD - 1] + row.cells[SPREAD:])
