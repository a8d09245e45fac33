"""Rows of a table that say where a suspension rests in each run, and how stiff it is there."""

from __future__ import annotations

from collections.abc import Iterator

from opid.mechanics.weight import depends_on_travel
from opid.report.as_text import Row, estimate_row
from opid.suspensions.result import GasColumn, InterfaceEstimate


def rest_rows(interface: InterfaceEstimate, units: tuple[str, str], *, has_truth: bool) -> Iterator[Row]:
    """Yield a row for each number; none where the force of the law does not depend on the travel.

    Args:
        interface: the suspension.
        units: of its stiffness and damping.
        has_truth: whether the table has columns for the truth.
    """
    if interface.stiffness.value is None or not depends_on_travel(interface.law):
        return
    yield Row("At rest, run by run: static travel from the reference run, tangent stiffness, equivalent damping")
    if interface.rest_m.value:
        yield estimate_row("rest on the law", "m", interface.rest_m, None, has_truth)
    for each in interface.at_rest:
        if each.travel_m.std:
            yield estimate_row(f"{each.run}: travel", "m", each.travel_m, None, has_truth)
        yield estimate_row(f"{each.run}: stiffness", units[0], each.stiffness, None, has_truth)
        yield estimate_row(f"{each.run}: damping", units[1], each.damping, None, has_truth)
    if interface.gas is not None:
        yield from _gas_rows(interface.gas, has_truth=has_truth)


def _gas_rows(gas: GasColumn, *, has_truth: bool) -> Iterator[Row]:
    yield Row("Gas at rest in the reference run; pressure times volume falls where gas leaks or cools")
    yield estimate_row("gas: pressure times volume", "N m", gas.content_n_m, None, has_truth)
    if gas.pressure_pa.value is not None:
        yield estimate_row("gas: gauge pressure", "Pa", gas.pressure_pa, None, has_truth)
        yield estimate_row("gas: volume", "m^3", gas.volume_m3, None, has_truth)
