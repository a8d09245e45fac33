"""The coefficients of a mode's restoring force in a table, and their units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from opid.estimate import Estimate
from opid.report.as_text import Row, columns, estimate_row

SPREAD = columns(None).index("±")
"""The column of the standard deviation, which the interval beside it tells too."""


def unit_of(letter: str, power: int) -> str:
    """Return the unit of a coefficient, (N/kg^1/2) / (m kg^1/2)^n or (N/kg^1/2) / (m/s kg^1/2)^n, in short.

    Args:
        letter: "k" or "c".
        power: n.

    >>> unit_of("k", 3), unit_of("c", 2), unit_of("k", 1)
    ('N/(m^3 kg^2)', 'N s^2/(m^2 kg^1.5)', 'N/(m kg)')
    """

    seconds = f" {_raised('s', power)}" if letter == "c" else ""
    return f"N{seconds}/({_raised('m', power)} {_raised('kg', (power + 1) / 2)})"


def unit_per_mass(letter: str, power: int) -> str:
    """Return the unit of a coefficient per unit mass, (m/s^2) / m^n or (m/s^2) / (m/s)^n, in short.

    Args:
        letter: "k" or "c".
        power: n.

    >>> unit_per_mass("k", 1), unit_per_mass("k", 3), unit_per_mass("c", 1), unit_per_mass("c", 3)
    ('1/s^2', '1/(s^2 m^2)', '1/s', 's/m^2')
    """
    seconds, metres = (-2 if letter == "k" else power - 2), 1 - power
    exponents = {"s": seconds, "m": metres}
    above, below = ([_raised(name, abs(n)) for name, n in exponents.items() if n * sign > 0] for sign in (1, -1))
    under = f"({' '.join(below)})" if len(below) > 1 else "".join(below)
    return f"{' '.join(above) or '1'}/{under}"


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


def _raised(name: str, exponent: float) -> str:
    return name if exponent == 1 else f"{name}^{exponent:g}"
