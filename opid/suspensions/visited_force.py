"""An identified restoring force over the part of the plane of travel and velocity that the runs visited."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.mechanics.laws import Law
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class VisitedForce:
    """An identified restoring force at the places of the plane that the runs visited.

    Args:
        travel: (n,) z, m.
        velocity: (n,) z', m/s.
        force: (n,) K2 z + C2 z' + f(z, z'), N, or per unit of mass in m/s^2 where the mass is not determined.
        nonlinear_force: (n,) f(z, z') alone.
        per_mass: whether the forces are per unit of mass.
    """

    travel: FloatArray
    velocity: FloatArray
    force: FloatArray
    nonlinear_force: FloatArray
    per_mass: bool


def visited_force(
    travel: FloatArray,
    velocity: FloatArray,
    law: Law,
    *,
    stiffness: float,
    damping: float,
    per_mass: bool,
    n_cells: int = 31,
) -> VisitedForce:
    """Evaluate an identified restoring force at the visited cells of the plane.

    Args:
        travel: (n,) where the runs were, m.
        velocity: (n,) likewise, m/s.
        law: the nonlinear law.
        stiffness: K2 (or K2/M2).
        damping: C2 (or C2/M2).
        per_mass: whether the three are per unit of mass.
        n_cells: cells along each axis.

    >>> z, v = np.linspace(-1, 1, 99), np.linspace(-2, 2, 99)
    >>> force = visited_force(z, v, Law(), stiffness=2.0, damping=0.0, per_mass=False)
    >>> bool(np.allclose(force.force, 2 * force.travel))
    True
    """
    counts, z_edges, v_edges = np.histogram2d(travel, velocity, bins=n_cells)
    i, j = np.nonzero(counts)
    z, v = (z_edges[i] + z_edges[i + 1]) / 2, (v_edges[j] + v_edges[j + 1]) / 2
    nonlinear = law.force(z, v)
    return VisitedForce(z, v, stiffness * z + damping * v + nonlinear, nonlinear, per_mass)
