"""The laws of several flights over each other: what carries the body, and what damps it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.mechanics.laws.law import Law
from opid.plots.style import choose_run_colors, house_style, panels_in_rows
from opid.suspensions.flights.result_file import Flight, StrutLaw

_N_POINTS = 61

_RATE_PER_S = 10.0
"""The damper is drawn up to this times the travel, as at 1.6 Hz."""


def draw_flight_laws(flights: Mapping[str, Flight], axes: Any = None) -> Axes:
    """Draw the spring and the damper of each suspension of some flights, a row for each suspension.

    Args:
        flights: by the names that their curves get.
        axes: two Axes for each suspension, or None for a new figure.
    """
    gears = list(dict.fromkeys(gear for flight in flights.values() for gear in flight.strut_laws))
    with house_style():
        axes = panels_in_rows(axes, 2 * len(gears), 2, height_in=3.0)
        colors = choose_run_colors(len(flights))
        for (of_spring, of_damper), gear in zip(np.reshape(axes, (-1, 2)), gears, strict=True):
            for (name, flight), color in zip(flights.items(), colors, strict=True):
                strut = flight.strut_laws.get(gear)
                if strut is None:
                    continue
                travel, carried = _compute_spring(strut)
                of_spring.plot(1e3 * travel, carried, color=color, label=name)
                rate, damped = _compute_damper(strut)
                of_damper.plot(rate, damped, color=color, label=name)
            unit = "N/kg" if any(flight.per_mass for flight in flights.values()) else "N"
            of = f": {gear}" if len(gears) > 1 else ""
            of_spring.set(xlabel="travel [mm]", ylabel=f"force [{unit}]", title=f"Spring{of}")
            of_damper.set(xlabel="rate [m/s]", ylabel=f"force [{unit}]", title=f"Damper{of}")
        of_spring.legend()
    return np.reshape(axes, -1)[0]


def _compute_spring(strut: StrutLaw) -> tuple[np.ndarray, np.ndarray]:
    """The force at standstill over the travel of the runs."""
    travel = np.linspace(*strut.travelled_m, _N_POINTS)
    law = strut.law.static_force(travel)[0] if strut.law else 0.0
    return travel, strut.stiffness * travel + law


def _compute_damper(strut: StrutLaw) -> tuple[np.ndarray, np.ndarray]:
    """The force in the position of rest over the rate, without terms that have a memory."""
    most = _RATE_PER_S * max(map(abs, strut.travelled_m))
    rate = np.linspace(-most, most, _N_POINTS)
    terms = tuple(term for term in strut.law.terms if term.kind.memory is None) if strut.law else ()
    return rate, strut.damping * rate + Law(terms).force(0.0, rate)
