"""Estimates and laws as the rows of a table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from opid.estimate import Estimate, format_number, rounded
from opid.mechanics.laws.law import Law, unit_of_parameter
from opid.mechanics.truth import Truth
from opid.report.document import Row, Table, build_columns
from opid.report.formulas import embed_formula
from opid.suspensions.result import GasColumn

INTERVAL = "The interval holds the value with 95 % if the model holds."
"""What each table of estimates says of its intervals."""

ROUNDING = 1e-12
"""A value whose relative standard deviation is smaller is a constant: such a deviation comes from rounding."""


def build_estimate_row(label: str, unit: str, estimate: Estimate, true: float | None = None) -> Row:
    """Return an estimate as a row of `tabulate_estimates`; a constant has neither standard deviation nor interval."""
    std, interval = estimate.std, estimate.interval95
    if std is not None and estimate.value is not None and std <= ROUNDING * abs(estimate.value):
        std, interval = None, None  # the constant was given, or the fit left it at a bound
    between = f"{rounded(interval[0], std)} .. {rounded(interval[1], std)}" if interval else "-"
    error = is_inside = "-"
    if true is not None and estimate.value is not None:
        error = f"{round(100 * (estimate.value / true - 1), 2) + 0.0:+.2f}%" if true else "-"
        is_inside = "-" if interval is None else "yes" if estimate.holds(true) else "no"
    known = "-" if true is None else format_number(true)
    return (label, rounded(estimate.value, std), rounded(std, std), between, unit, known, error, is_inside)


def format_estimate(estimate: Estimate, factor: float = 1.0) -> tuple[str, str]:
    """Return a value and its standard deviation, times a factor; a dash where there is none.

    >>> format_estimate(Estimate.normal(0.00418, 0.00005), 100.0), format_estimate(Estimate.normal(119.609))
    (('0.4180', '0.0050'), ('119.6', '-'))
    """
    value, std = (None if each is None else factor * each for each in (estimate.value, estimate.std))
    return rounded(value, std), rounded(std, std)


def tabulate_estimates(rows: Iterable[Row], truth: Truth | None = None, title: str = "", legend: str = "") -> Table:
    """Return a table of rows by `build_estimate_row` and of headings; with a truth it shows that, and no std. dev.

    >>> [column.head for column in tabulate_estimates([]).columns]
    ['', 'value', 'std. dev.', '95 % interval', 'unit']
    """
    heads = ("", "value", "std. dev.", "95 % interval", "unit", "truth", "error", "inside")
    # the interval implies the standard deviation, and a terminal has only 80 characters
    shown = (0, 1, 2, 3, 4) if truth is None else (0, 1, 3, 4, 5, 6, 7)
    return Table(
        build_columns(*(heads[index] for index in shown), optional=() if truth is None else (5,)),
        tuple(row if len(row) == 1 else tuple(row[index] for index in shown) for row in rows),
        title,
        legend=legend,
    )


def say_law(law: Law, symbol: str = "f") -> str:
    """Return the name of a law, and its formula where it is one term."""
    return f"{law.name}, {embed_formula(f'{symbol} = {law.latex}')}" if len(law.terms) == 1 else law.name


def list_gas_rows(gas: GasColumn | None, where: str) -> Iterator[Row]:
    """Yield a heading and the rows of a column of gas; none where there is no gas."""
    if gas is None:
        return
    rows = [("gas: pressure times volume", "N m", gas.content_n_m)]
    if gas.pressure_pa.value is not None:
        rows += [("gas: gauge pressure", "Pa", gas.pressure_pa), ("gas: volume", "m^3", gas.volume_m3)]
    yield (f"{where}; pressure times volume falls where gas leaks or cools",)
    yield from (build_estimate_row(*row) for row in rows)


def list_law_rows(
    law: Law,
    estimates: Mapping[str, Mapping[str, Estimate]],
    *,
    of: str = "",
    per_mass: bool = False,
    true: Mapping[str, Mapping[str, float]] | None = None,
    true_scale: float = 1.0,
) -> Iterator[Row]:
    """Yield a row for each parameter of a law that has an estimate; each term of a sum has a heading.

    Estimates and true values are {kind: {parameter: ...}}; the true amplitudes are multiplied by `true_scale`.
    """
    for term in law.terms:
        if len(law.terms) > 1:
            yield (f"Term {term.name}{f' of {of}' if of else ''}: {embed_formula(term.kind.latex)}",)
        for parameter in term.kind.parameters if term.name in estimates else ():
            known = (true or {}).get(term.name, {}).get(parameter.name)
            if known is not None and parameter.role == "amplitude":
                known *= true_scale
            unit, found = unit_of_parameter(parameter, per_mass=per_mass), estimates[term.name][parameter.name]
            yield build_estimate_row(parameter.words, unit, found, known)
