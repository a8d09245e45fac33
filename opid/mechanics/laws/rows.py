"""The parameters of a law that was found, as rows of a summary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from opid.estimate import Estimate
from opid.mechanics.laws.kinds import Parameter
from opid.mechanics.laws.law import Law
from opid.result import SummaryRow


def unit_of_parameter(parameter: Parameter, *, per_mass: bool) -> str:
    """Return the unit of a parameter of a law.

    Args:
        parameter: of a kind of law.
        per_mass: whether the force is given per kg.

    >>> from opid.mechanics.laws.law import LAWS
    >>> [unit_of_parameter(each, per_mass=True) for each in LAWS["arctan_velocity"].parameters]
    ['N/kg', 'm/s']
    """
    return f"{parameter.unit}/kg" if per_mass and parameter.role == "amplitude" else parameter.unit


def law_rows(
    law: Law, estimates: Mapping[str, Mapping[str, Estimate]], name: str, *, per_mass: bool = False
) -> Iterator[SummaryRow]:
    """Yield the parameters of a law.

    Args:
        law: the law.
        estimates: {kind: {parameter: Estimate}} of it; a kind that is missing has no rows.
        name: what stands before the kind in the names of the rows.
        per_mass: whether the force is given per kg.
    """
    for term in law.terms:
        for parameter in term.kind.parameters if term.name in estimates else ():
            yield SummaryRow.of(
                f"{name}.{term.name}.{parameter.name}",
                estimates[term.name][parameter.name],
                unit_of_parameter(parameter, per_mass=per_mass),
            )
