"""The gas that carries a suspension, in the values used in service: of a taxiing gear and of a strut on the bench."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.mechanics.weight import ATMOSPHERE_PA
from opid.signals.recording import FloatArray
from opid.suspensions.result import GasColumn
from opid.suspensions.settings import GasSettings


def index_of_gas(law: Law) -> int | None:
    """Return the index of the term of a law that is a column of gas; None if there is none."""
    return next((index for index, term in enumerate(law.terms) if term.kind.quasi_static), None)


def amounts_of_gas(force_n: float, length_m: float, piston_area_m2: float | None) -> FloatArray:
    """Return pressure times volume, gauge pressure and volume of a column of gas, (3,) in N m, Pa and m^3.

    The gauge pressure is the absolute pressure p minus that of the air.

    Args:
        force_n: force of the law at its origin, p A.
        length_m: length of the column, V/A.
        piston_area_m2: A; None if it is not stated, so that only the first of the three values belongs to the gas.
    """
    area = piston_area_m2 or 1.0
    return np.array([force_n * length_m, force_n / area - ATMOSPHERE_PA, area * length_m])


def as_gas_column(amounts: Sequence[Estimate], piston_area_m2: float | None) -> GasColumn:
    """Return the gas column of these amounts, with pressure and volume only if the `piston_area_m2` is stated."""
    return GasColumn(amounts[0]) if piston_area_m2 is None else GasColumn(*amounts)


def warn_of_area(gas: GasColumn | None, piston_area_m2: float | None, settings: GasSettings) -> Iterator[str]:
    """Yield that the stated area of a piston contradicts the static pressure, in one sentence.

    Args:
        gas: the gas that was found, or None.
        piston_area_m2: the stated area.
        settings: the pressures at which struts are serviced.
    """
    pressure, (low, high) = None if gas is None else gas.pressure_pa.value, settings.pressures_pa
    if pressure is not None and not low <= pressure <= high:
        yield (
            f"the stated piston_area_m2 of {piston_area_m2:g} contradicts the static pressure: with this area the gas "
            f"would have {1e-6 * pressure:.2g} MPa, but struts are serviced with {1e-6 * low:g} to {1e-6 * high:g} "
            "MPa; check the area and the unit of the mass changes (on the test bench, of the force)"
        )
