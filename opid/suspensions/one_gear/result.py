"""What an identification found: parameters with intervals, the law, the evidence, and what to doubt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.laws import Law
from opid.signals.recording import FloatArray
from opid.suspensions.paper.restoring_force import RestoringForce

SCHEMA = "opid.identification/1"
PARAMETERS = (
    "sprung_mass_kg",
    "suspension_stiffness_n_per_m",
    "suspension_damping_n_s_per_m",
    "ground_stiffness_n_per_m",
)
RATIOS = (
    "stiffness_per_mass",
    "damping_per_mass",
    "ground_stiffness_per_mass",
    "natural_frequency_hz",
    "damping_ratio",
)


@dataclass(frozen=True, eq=False)
class VisitedForce:
    """The identified restoring force at the places of the plane that the runs visited.

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


@dataclass(frozen=True, eq=False)
class Identification:
    """The result of an identification.

    Args:
        method: "classical", "model" or "paper".
        title: title of the study.
        parameters: one `Estimate` for each name in `PARAMETERS`, of the reference run.
        ratios: one `Estimate` for each name in `RATIOS` (1/s^2, 1/s, 1/s^2, Hz, 1).
        law: the nonlinear law in N, or per unit of mass (m/s^2) where the mass is not determined.
        law_estimates: {kind: {parameter: Estimate}} in the same unit.
        restoring_force: the identified force over the visited plane.
        diagnostics: what the answer rests on, ready for JSON.
        warnings: what to doubt, one sentence each.
        not_determined: why absolute values are missing, or None.
        evidence: the intermediate results, for figures (`opid.suspensions.paper.classical.Evidence`).
        date: of the runs; None if it is not known.
    """

    method: str
    title: str
    parameters: Mapping[str, Estimate]
    ratios: Mapping[str, Estimate]
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    restoring_force: VisitedForce
    diagnostics: Mapping[str, Any]
    warnings: tuple[str, ...]
    not_determined: str | None
    evidence: Any
    date: date | None = None


def visited_force(
    surfaces: list[RestoringForce],
    law: Law,
    *,
    stiffness: float,
    damping: float,
    per_mass: bool,
    n_bins: int = 31,
) -> VisitedForce:
    """Evaluate an identified restoring force at the visited cells of the plane.

    Args:
        surfaces: restoring-force points of the runs; they say which cells were visited.
        law: the nonlinear law.
        stiffness: K2 (or K2/M2).
        damping: C2 (or C2/M2).
        per_mass: whether the three are per unit of mass.
        n_bins: cells along each axis.

    >>> points = RestoringForce(np.linspace(-1, 1, 99), np.linspace(-2, 2, 99), np.zeros(99), 10.0, "spectral", 0.3)
    >>> force = visited_force([points], Law(), stiffness=2.0, damping=0.0, per_mass=False)
    >>> bool(np.allclose(force.force, 2 * force.travel))
    True
    """
    z = np.concatenate([surface.travel for surface in surfaces])
    v = np.concatenate([surface.velocity for surface in surfaces])
    counts, z_edges, v_edges = np.histogram2d(z, v, bins=n_bins)
    i, j = np.nonzero(counts)
    travel, velocity = (z_edges[i] + z_edges[i + 1]) / 2, (v_edges[j] + v_edges[j + 1]) / 2
    nonlinear = law.force(travel, velocity)
    return VisitedForce(travel, velocity, stiffness * travel + damping * velocity + nonlinear, nonlinear, per_mass)
