"""The report of a user's own structure."""

from __future__ import annotations

from collections.abc import Iterator

from opid.estimate import format_number
from opid.report.document import Document, Paragraph, Row, build_warnings, format_count, write_sentence
from opid.report.estimates import INTERVAL, build_estimate_row, list_law_rows, say_law, tabulate_estimates
from opid.report.sketch import sketch_structure
from opid.suspensions.fitting.noise import over_noise
from opid.suspensions.own_structure import StructureIdentification
from opid.suspensions.result import SpringEstimate, units_of_suspensions


def build_document(result: StructureIdentification) -> Document:
    """Return the report of a structure: masses, suspensions with their laws, joints, and their basis."""
    springs = [f"the law of {name} is {each.law.name}" for name, each in result.interfaces.items()]
    return Document(
        "Own structure",
        f"{format_count(len(result.interfaces), 'measured suspension')}, identified from accelerations alone",
        write_sentence(
            f"{', '.join(springs)}; {over_noise(result.residual_over_noise)} times the sensors' noise is left"
        ),
        result.not_determined,
        (
            tabulate_estimates(
                _list_rows(result),
                legend=f"The force of each suspension is K z + C z′ + f(z, z′), z its travel. {INTERVAL}",
            ),
            Paragraph(_say_limits(result)),
            build_warnings(result.warnings),
        ),
        sketch=sketch_structure(result),
    )


def _list_rows(result: StructureIdentification) -> Iterator[Row]:
    unit = "of the first" if result.per_mass else "kg"
    for name, mass in result.masses.items():
        yield build_estimate_row(f"mass of {name}", unit, mass)
    for name, spring in result.interfaces.items():
        yield (f"Suspension {name}: {say_law(spring.law)}",)
        yield from _list_spring_rows(spring, per_mass=result.per_mass)
    for name, joint in result.joints.items():
        yield (f"Joint {name}",)
        yield from _list_spring_rows(joint, per_mass=result.per_mass)


def _list_spring_rows(spring: SpringEstimate, *, per_mass: bool) -> Iterator[Row]:
    stiffness, damping = units_of_suspensions(per_mass=per_mass)
    yield build_estimate_row("stiffness", stiffness, spring.stiffness)
    yield build_estimate_row("damping", damping, spring.damping)
    yield from list_law_rows(spring.law, spring.law_estimates, of=spring.name, per_mass=per_mass)


def _say_limits(result: StructureIdentification) -> str:
    sensors = ", ".join(f"{name} {over_noise(each)}" for name, each in result.residual_of.items())
    left_out = result.left_out_over_noise
    others = "" if left_out is None else f" Runs that the others predict leave {over_noise(left_out)} times."
    limits = "".join(f" {write_sentence(each)}" for each in result.limits)
    return (
        f"The fit leaves {over_noise(result.residual_over_noise)} times the noise of "
        f"{format_number(1e3 * result.noise_m_per_s2, 2)} mm/s^2 (by sensor: {sensors}).{others}{limits}"
    )
