"""A user's own structure as text and as a page."""

from __future__ import annotations

from collections.abc import Iterator

from opid.mechanics.laws.rows import unit_of_parameter
from opid.report.as_text import (
    Row,
    columns,
    estimate_row,
    formula,
    labelled,
    laid_out,
    parameter_label,
    refusal,
    table_lines,
    wrapped,
)
from opid.report.page import Page
from opid.suspensions.fitting.noise import over_noise
from opid.suspensions.own_structure import StructureIdentification
from opid.suspensions.result import SpringEstimate, units_of_suspensions

TITLE = "Own structure"


def text_of(result: StructureIdentification) -> str:
    """Return the identification of a user's own structure as text: the numbers, what they rest on, what to doubt.

    Args:
        result: from `identify_structure`.
    """
    return laid_out(
        [TITLE],
        refusal(result.not_determined),
        table_lines(structure_rows(result), columns(None)),
        wrapped(structure_limits(result)),
        labelled("Warning: ", result.warnings),
    )


def page_of(result: StructureIdentification) -> Page:
    """Return what the page of a user's own structure shows.

    Args:
        result: from `identify_structure`.
    """
    content = {"columns": columns(None), "rows": structure_rows(result), "limits": structure_limits(result)}
    return Page("structure.html.jinja", TITLE, (), content, result.warnings, result.not_determined)


def structure_rows(result: StructureIdentification) -> list[Row]:
    """Return the table of numbers: masses, suspensions with their laws, joints.

    Args:
        result: from `identify_structure`.
    """
    unit = "of the first" if result.per_mass else "kg"
    rows = [estimate_row(f"mass of {name}", unit, each) for name, each in result.masses.items()]
    for what, springs in (("Suspension", result.interfaces), ("Joint", result.joints)):
        for each in springs.values():
            rows += _spring_rows(what, each, per_mass=result.per_mass)
    return rows


def structure_limits(result: StructureIdentification) -> str:
    """Return the sentences that say what the answer rests on.

    Args:
        result: from `identify_structure`.
    """
    sensors = ", ".join(f"{name} {over_noise(each)}" for name, each in result.residual_of.items())
    left_out = result.left_out_over_noise
    others = "" if left_out is None else f" Runs that the others predict leave {over_noise(left_out)} times."
    limits = "".join(f" {each[0].upper()}{each[1:]}." for each in result.limits)
    return (
        f"The fit leaves {over_noise(result.residual_over_noise)} times the noise of "
        f"{1e3 * result.noise_m_per_s2:.2g} mm/s^2 (by sensor: {sensors}).{others}{limits}"
    )


def _spring_rows(what: str, spring: SpringEstimate, *, per_mass: bool) -> Iterator[Row]:
    stiffness, damping = units_of_suspensions(per_mass=per_mass)
    law = "" if what == "Joint" else f": {spring.law.name}"
    yield Row(f"{what} {spring.name}{law}")
    yield estimate_row("stiffness", stiffness, spring.stiffness)
    yield estimate_row("damping", damping, spring.damping)
    for term in spring.law.terms:
        yield Row(f"Term {term.name} of {spring.name}: {formula(term.kind.latex)}")
        for parameter in term.kind.parameters if term.name in spring.law_estimates else ():
            found = spring.law_estimates[term.name][parameter.name]
            yield estimate_row(parameter_label(parameter), unit_of_parameter(parameter, per_mass=per_mass), found)
