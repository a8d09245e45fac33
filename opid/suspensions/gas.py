"""The gas of a strut as it is serviced: pressure and volume, and what both together say of leaks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from opid.mechanics.laws import LAWS
from opid.mechanics.weight import ATMOSPHERE_PA
from opid.signals.recording import FloatArray
from opid.suspensions.intervals import Parameters
from opid.suspensions.result import GasColumn, InterfaceEstimate, SpringEstimate
from opid.suspensions.settings import GasSettings
from opid.suspensions.study import MeasuredInterface


def gas_of(known: Parameters, number: int, piston_area_m2: float | None) -> GasColumn | None:
    """Return the gas that carries a group of interfaces in the reference run; None where none is found.

    Its force at rest is (p - p0) A with the pressure p, that of the air p0 and the area A of the piston; the amplitude
    of the law is p A, and the length of the column V/A.

    Args:
        known: parameters of a fit whose mass is determined.
        number: of the group.
        piston_area_m2: what the gas pushes on; None where it is not stated.
    """
    model, theta = known.fit.model, known.fit.theta
    terms = model.laws(theta)[number].terms
    place = next((k for k, term in enumerate(terms) if term.kind.quasi_static), None)
    if place is None or model.inverse_mass(theta) <= 0.0:
        return None
    area = piston_area_m2 or 1.0

    def read(vector: FloatArray) -> FloatArray:
        term = model.laws(vector)[number].terms[place]
        force = term.amplitude / model.inverse_mass(vector)
        return np.array([force * term.inner[0], force / area - ATMOSPHERE_PA, area * term.inner[0]])

    content, pressure, volume = known.of_function(read)
    return GasColumn(content) if piston_area_m2 is None else GasColumn(content, pressure, volume)


def doubts_of_gas(
    interfaces: Sequence[InterfaceEstimate], measured: Sequence[MeasuredInterface], settings: GasSettings
) -> Iterator[str]:
    """Yield what to doubt of the gas that carries suspensions, one sentence each, once for those that share a law.

    Args:
        interfaces: as they are told; those that cannot be fitted are not among them.
        measured: all of them as they were stated, with the area of the piston.
        settings: what gas in a strut is like.
    """
    done, areas = set[str](), {stated.name: stated.piston_area_m2 for stated in measured}
    for each in interfaces:
        if done.isdisjoint(each.shared_with):
            names = ", ".join((each.name, *each.shared_with))
            where = f"at {names!r}: " if len(measured) > 1 else ""
            for doubt in _doubts(each, areas[each.name], settings):
                yield where + doubt
        done.add(each.name)


def _doubts(interface: InterfaceEstimate, piston_area_m2: float | None, settings: GasSettings) -> Iterator[str]:
    pressure, (low, high) = None if interface.gas is None else interface.gas.pressure_pa.value, settings.pressures_pa
    if pressure is not None and not low <= pressure <= high:
        yield (
            f"the stated piston_area_m2 of {piston_area_m2:g} contradicts the static pressure: the weight would make "
            f"it {1e-6 * pressure:.2g} MPa, and struts are serviced with {1e-6 * low:g} to {1e-6 * high:g} MPa; check "
            "the area and the unit of the mass changes"
        )
    yield from doubts_of_exponents(interface, settings)


def doubts_of_exponents(suspension: SpringEstimate, settings: GasSettings) -> Iterator[str]:
    """Yield the exponents of a suspension that gas in a strut does not have, one sentence each.

    Args:
        suspension: as it is told.
        settings: what gas in a strut is like.
    """
    for kind, estimates in suspension.law_estimates.items():
        if not LAWS[kind].quasi_static:
            continue
        for parameter in LAWS[kind].parameters:
            value = estimates[parameter.name].value
            if parameter.known is None or value is None:
                continue
            mean, reach = parameter.known[0], settings.far_std * parameter.known[1]
            if abs(value - mean) > reach:
                yield (
                    f"the exponent {value:.3g} of {kind} is unusual for gas in a strut ({mean - reach:.3g} to "
                    f"{mean + reach:.3g}): another spring probably carries a part of the weight, so do not trust "
                    "static force, length, pressure and volume of the gas; the mass does not depend on them"
                )
