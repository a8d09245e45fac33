"""Estimates and laws as the rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from opid.estimate import Estimate, rounded
from opid.mechanics.laws.kinds import Parameter
from opid.mechanics.laws.law import Law
from opid.mechanics.laws.rows import unit_of_parameter
from opid.mechanics.truth import Truth
from opid.report.document import Column, columns

ROUNDING = 1e-12
"""A standard deviation that is a smaller part of its value is the rounding of numbers: the value is a constant."""

# what stands in the LaTeX of `opid.mechanics.laws.law`, in plain text
_PLAIN = (
    (r"\tfrac{2}{\pi}", "(2/pi)"),
    (r"\operatorname{sgn}", "sgn"),
    (r"\tfrac12", "1/2"),
    (r"\dot z", "z'"),
    (r"\dot h_u", "h_u'"),
    (r"\dot h", "h'"),
    (r"\overline{h_u}", "mean(h_u)"),
    (r"e^{-(z' / w)^2}", "exp(-(z' / w)^2)"),
    (r"\tau", "tau"),
    (r"\min", "min"),
    (r"\le", "<="),
    ("\\ ", " "),
    (r"\arctan", "arctan"),
    (r"\tanh", "tanh"),
    (r"\,", ""),
)


def estimate_columns(truth: Truth | None = None) -> tuple[Column, ...]:
    """Return the columns of a table of estimates.

    Args:
        truth: of a simulation, or None.

    >>> [column.head for column in estimate_columns()]
    ['', 'value', 'std. dev.', '95 % interval', 'unit']
    """
    if truth is None:
        return columns("", "value", "std. dev.", "95 % interval", "unit")
    # the interval tells the standard deviation too, and 80 characters are few
    return columns("", "value", "95 % interval", "unit", "truth", "error", "inside", optional=(5,))


def estimate_row(
    label: str, unit: str, estimate: Estimate, true: float | None = None, has_truth: bool = False
) -> tuple[str, ...]:
    """Return an estimate as a row of the table; a constant has neither standard deviation nor interval.

    Args:
        label: what it is.
        unit: of the value.
        estimate: value and interval.
        true: of a simulated run.
        has_truth: whether the table has columns for the truth.
    """
    std, interval = estimate.std, estimate.interval95
    if std is not None and estimate.value is not None and std <= ROUNDING * abs(estimate.value):
        std, interval = None, None  # a constant: it stayed at a bound, or was given
    between = f"{rounded(interval[0], std)} .. {rounded(interval[1], std)}" if interval else "-"
    value = rounded(estimate.value, std)
    if not has_truth:
        return (label, value, rounded(std, std), between, unit)
    if true is None or estimate.value is None:
        return (label, value, between, unit, "-" if true is None else f"{true:.6g}", "-", "-")
    error = f"{round(100 * (estimate.value / true - 1), 2) + 0.0:+.2f}%" if true else "-"
    held = "-" if interval is None else "yes" if estimate.holds(true) else "no"
    return (label, value, between, unit, f"{true:.6g}", error, held)


def law_in_words(law: Law, symbol: str = "f") -> str:
    """Return the name of a law, and its formula where it is one term.

    Args:
        law: the law.
        symbol: what the formula gives.
    """
    return f"{law.name}, {symbol} = {formula(law.latex)}" if len(law.terms) == 1 else law.name


def law_rows(
    law: Law,
    estimates: Mapping[str, Mapping[str, Estimate]],
    *,
    of: str = "",
    per_mass: bool = False,
    true: Mapping[str, Mapping[str, float]] | None = None,
    true_scale: float = 1.0,
    has_truth: bool = False,
) -> Iterator[tuple[str, ...]]:
    """Yield a row for each parameter of a law; of a sum each term has a heading.

    Args:
        law: the law.
        estimates: {kind: {parameter: Estimate}} of it; a kind that is missing has no rows.
        of: whose law it is, for the headings.
        per_mass: whether the force is per kg of the mass.
        true: {kind: {parameter: value}} of a simulated run.
        true_scale: its amplitudes are multiplied by this.
        has_truth: whether the table has columns for the truth.
    """
    for term in law.terms:
        if len(law.terms) > 1:
            yield (f"Term {term.name}{f' of {of}' if of else ''}: {formula(term.kind.latex)}",)
        for parameter in term.kind.parameters if term.name in estimates else ():
            known = (true or {}).get(term.name, {}).get(parameter.name)
            if known is not None and parameter.role == "amplitude":
                known *= true_scale
            unit, found = unit_of_parameter(parameter, per_mass=per_mass), estimates[term.name][parameter.name]
            yield estimate_row(parameter_label(parameter), unit, found, known, has_truth)


def parameter_label(parameter: Parameter) -> str:
    """Return the name of a parameter of a law in words, without its unit.

    Args:
        parameter: of a kind of law.

    >>> from opid.mechanics.laws.law import LAWS
    >>> [parameter_label(each) for each in LAWS["gas_column"].parameters]
    ['static force', 'gas length', 'exponent']
    """
    name = parameter.name
    if parameter.role == "amplitude":
        # amplitude_n, damping_n_s2_per_m2, stiffness_n_per_m3: the word before the unit
        name = name.split("_n")[0]
    return name.removesuffix("_m").removesuffix("_s").removesuffix("_m_per").replace("_", " ")


def formula(latex: str) -> str:
    """Return the LaTeX of a law as plain text.

    Args:
        latex: as in `opid.mechanics.laws.law`.
    """
    for written, plain in _PLAIN:
        latex = latex.replace(written, plain)
    return latex
