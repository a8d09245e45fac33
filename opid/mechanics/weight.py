"""The rest position of each run: its additional weight moves it along the curves of the springs.

Travel z is measured from the position at which a suspension rests. Let F(d) be its whole spring force over the travel d
from the rest of the reference run. A run that carries more mass rests at the d at which

    sum_s j_s (F_s(d_s) - F_s(0)) = L g,    d = J q,

with j_s the rows of J, L the loading's mass matrix and g the acceleration of free fall. There is no free parameter:
d follows from stiffness, law and mass, and the implicit function theorem gives its derivatives. With linear springs d
has no effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.mechanics.driven import Interface, UnboundedResponseError
from opid.mechanics.laws.law import Law, TermSet
from opid.signals.recording import FloatArray

GRAVITY_M_PER_S2 = 9.80665
"""Standard gravity, ISO 80000-3."""

ATMOSPHERE_PA = 101325.0
"""Standard atmosphere, ISO 2533."""


FARTHEST_REST_M = 10.0
"""A travel that no suspension reaches, m."""
# A kind may divide zero by zero at rest before it replaces the result.
_QUIETLY = np.errstate(all="ignore")


@dataclass(frozen=True, eq=False)
class Rest:
    """The rest position of the suspensions of a run.

    Args:
        travel: (n_interfaces,) travel from the rest of the reference run, m.
        compliance: (n_interfaces, n_interfaces) travel of each interface for a unit force on each, m/N.
        by_load: (n_interfaces,) travel that the load causes to first order, times the reference mass, m kg.
    """

    travel: FloatArray
    compliance: FloatArray
    by_load: FloatArray


@_QUIETLY
def find_rest(
    interfaces: Sequence[Interface], rows: FloatArray, load: FloatArray, held: FloatArray | float = 0.0
) -> Rest:
    """Return the position at which the suspensions rest under a load.

    Args:
        interfaces: the suspensions at the rest of the reference run; forces per unit of the reference mass.
        rows: (n_interfaces, n_dof) j of each interface.
        load: (n_dof,) weight of the run's loading, per unit of the reference mass.
        held: (n_dof,) weight of the body that the suspensions carry less than in the reference run, per unit of the
            reference mass.

    Raises:
        UnboundedResponseError: no position at which springs and weight balance.
    """
    travel = np.zeros(len(interfaces))
    carried, slope = _evaluate_springs(interfaces, travel)
    total = load + held
    missing = total
    for _ in range(50):
        compliance = rows @ np.linalg.pinv(rows.T @ (slope[:, np.newaxis] * rows), hermitian=True)
        step = compliance @ missing
        size = np.abs(step).max()
        # A nanometre is far below the resolution of any accelerometer.
        if size < 1e-9:
            return Rest(travel + step, compliance @ rows.T, compliance @ load)
        # Where a spring softens, Newton's step is too long: it is halved until the missing force, as travel, is less.
        for _ in range(30):
            force, slope = _evaluate_springs(interfaces, travel + step)
            missing = total - rows.T @ (force - carried)
            if np.abs(compliance @ missing).max() < size:
                break
            step = 0.5 * step
        travel = travel + step
        if not np.abs(travel).max() < FARTHEST_REST_M:
            break
    given = _find_most_carried(interfaces, rows, total, carried)
    raise UnboundedResponseError(
        f"the springs balance at most {100 * given:.0f} % of the weight that a run carries more or less, and the "
        f"remaining {100 * (1 - given):.0f} % would drive a suspension beyond its stop: check the mass change with its "
        "sign and unit, change the mass by less, or give a law with the stop that is reached (rebound_stop or "
        "bump_stop)"
    )


def laws_at_rest(interfaces: Sequence[Interface], rows: FloatArray, load: FloatArray) -> list[Law]:
    """Return the laws of suspensions that carry a load, each about its new position at rest.

    `interfaces` are the suspensions at rest without the load, `rows` their j, (n_interfaces, n_dof), and `load` is the
    weight of the load, (n_dof,) N and N m.

    Raises:
        UnboundedResponseError: no position at which springs and weight balance.
    """
    laws = [interface.law for interface in interfaces if isinstance(interface.law, Law)]
    if not any(map(depends_on_rest, laws)):
        return laws
    travel = find_rest(interfaces, rows, load).travel
    return [law.resting_at(law.rest_m + float(z)) for law, z in zip(laws, travel, strict=True)]


def by_parameters(interface: Interface, travel: float) -> FloatArray:
    """Return the derivatives of a spring's force at rest by the parameters of an interface, in their order.

    Args:
        interface: the suspension at the rest of the reference run.
        travel: travel from there to the rest of this run, m.
    """
    _, by_position, of_law = interface.law.static_force(travel)
    of_rest = by_position - interface.law.static_force(0.0)[1]
    return np.array([travel, 0.0, travel, float(of_rest), *of_law])


def resting(interface: Interface, travel: float) -> Interface:
    """Return `interface` with its rest position moved by `travel`, m, from that of the reference run."""
    return replace(interface, law=replace(interface.law, rest_m=interface.law.rest_m + float(travel)))


@_QUIETLY
def depends_on_travel(law: TermSet) -> bool:
    """Return whether a law has a force without any motion, at some travel."""
    travel = np.multiply.outer([-1.0, 1.0], [1e-3, 1e-2, 1e-1, 1.0]).ravel()
    return any(bool(np.any(term.evaluate(travel, np.zeros_like(travel))[0])) for term in law.terms)


def depends_on_rest(law: TermSet) -> bool:
    """Return whether a law depends on the rest position: springs do, and friction that their force presses."""
    is_loaded = any(term.kind.is_friction and term.kind.is_about_rest for term in law.terms)
    return is_loaded or depends_on_travel(law)


@_QUIETLY
def slopes_at_rest(law: TermSet) -> bool:
    """Return whether a law adds to the tangent stiffness at rest; memories do not count."""
    return bool(law.gradient(0.0, 0.0)[0])


def _find_most_carried(
    interfaces: Sequence[Interface], rows: FloatArray, total: FloatArray, carried: FloatArray
) -> float:
    """Return the largest fraction of a load that springs balance along the direction in which it pushes them."""
    direction = rows @ total
    travel = np.outer(direction / np.abs(direction).max(), np.geomspace(1e-6, FARTHEST_REST_M, 500))
    forces = total @ rows.T @ (_evaluate_springs(interfaces, travel)[0] - carried[:, np.newaxis])
    return float(np.clip(np.nanmax(forces) / (total @ total), 0.0, 1.0))


def _evaluate_springs(interfaces: Sequence[Interface], travel: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return spring forces about the origins of their laws, and their slopes, each (n_interfaces, ...)."""
    force, slope = np.empty((2, *travel.shape))
    for number, (interface, z) in enumerate(zip(interfaces, travel, strict=True)):
        slope[number] = interface.stiffness + interface.ground_stiffness
        force[number] = slope[number] * z
        position = np.array(interface.law.rest_m + z)
        for term in interface.law.terms:
            shape, by_z, *_ = term.static_force(position)
            force[number] += term.amplitude * shape
            slope[number] += term.amplitude * by_z
    return force, slope
