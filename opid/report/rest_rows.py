"""Rows of a table that say where a suspension rests in each run, and how stiff it is there."""

from __future__ import annotations

from collections.abc import Iterator

from opid.mechanics.weight import depends_on_travel
from opid.report.as_text import Row, estimate_row
from opid.suspensions.result import InterfaceEstimate


def rest_rows(interface: InterfaceEstimate, units: tuple[str, str], *, told: bool) -> Iterator[Row]:
    """Yield a row for each number; none where the force of the law does not depend on the travel.

    Args:
        interface: the suspension.
        units: of its stiffness and damping.
        told: whether the table has columns for the truth.
    """
    if interface.stiffness.value is None or not depends_on_travel(interface.law):
        return
    yield Row("At rest, run by run: static travel from the reference run, tangent stiffness, equivalent damping")
    if interface.rest_m.value:
        yield estimate_row("rest on the law", "m", interface.rest_m, None, told)
    for each in interface.at_rest:
        if each.travel_m.std:
            yield estimate_row(f"{each.run}: travel", "m", each.travel_m, None, told)
        yield estimate_row(f"{each.run}: stiffness", units[0], each.stiffness, None, told)
        yield estimate_row(f"{each.run}: damping", units[1], each.damping, None, told)
