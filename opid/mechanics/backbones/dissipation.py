"""The energy that a structure loses in a cycle of a backbone, to which the force of a test at phase resonance is equal.

At phase resonance the force works against the damping alone: it feeds in what modes and joints lose. Damping moves the
frequency of a backbone in second order only, so its motion is that of the structure without damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.mechanics.backbones.family import BackboneFamily
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.laws.law import FloatArray

# Times in a period. Forces of dampers have corners where the motion turns; the error of |v| v is below 1e-6.
N_TIMES = 96


@dataclass(frozen=True, eq=False)
class PlacedTerm:
    """A term of the laws of some joints, for many samples of its parameters.

    Args:
        kind: name of the kind in `opid.laws.LAWS`, one without a memory or with a cycle.
        values: (n_samples, n_parameters) parameters in their units, the amplitude first.
        is_there: (n_joints,) whether each joint has the term.
    """

    kind: str
    values: FloatArray
    is_there: NDArray[np.bool_]

    def find_force(self, extension: FloatArray, rate: FloatArray, reach: FloatArray) -> FloatArray:
        """Return the force, N, at extensions, m, and their rates, m/s, (n_samples, n_points, n_joints, n_times).

        A kind with memory has the mean force of both directions of a cycle up to `reach`, m, (n_samples, n_points,
        n_joints).
        """
        kind = LAWS[self.kind]
        amplitude, *inner = (column[:, None, None, None] for column in self.values.T)
        if kind.cycle is not None:
            force = amplitude * kind.cycle(extension, reach[..., None], *(*inner, 1.0, 1.0, 1.0)[:3])[0]
        else:
            force = amplitude * kind.function(extension, rate, *(*inner, 1.0, 1.0)[:2])[0]
        return np.asarray(force * self.is_there[:, None])

    def find_lost_in_cycle(self, reach: FloatArray) -> FloatArray | float:
        """Return the energy that a kind with memory loses in cycles up to `reach`, J; 0 of other kinds."""
        kind = LAWS[self.kind]
        if kind.cycle_loss is None:
            return 0.0
        amplitude, *inner = (column[:, None, None] for column in self.values.T)
        return np.asarray(amplitude * kind.cycle_loss(reach, *(*inner, 1.0, 1.0, 1.0)[:3]) * self.is_there)


def find_loss(
    found: BackboneFamily,
    system: JointedModes,
    springs: Sequence[PlacedTerm],
    dampers: Sequence[PlacedTerm],
    damping_ratio: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the energy that modes and dampers of joints lose in a cycle, and the kinetic energy, J.

    With q_ih the harmonics of the modal coordinates, which follow from the harmonics F_h of the springs' forces as in
    `backbone`, and z the extensions of the joints,

        W = sum_i sum_h pi 2 zeta omega_i h^2 omega q_ih^2 + sum over joints of the integral of f(z') z' dt + W_m,
        E = sum_i sum_h h^2 omega^2 q_ih^2 / 2.

    W / (4 pi E) is the effective damping ratio, and W_m what joints with memory lose (`Kind.cycle_loss`).

    Args:
        found: the backbones.
        system: the structure that they belong to.
        springs: the springs of the joints.
        dampers: the dampers of the joints.
        damping_ratio: (n_samples,) zeta of all modes.

    Returns:
        W and E, (n_samples, n_points) each.
    """
    harmonics, n_joints = np.array(found.harmonics), len(system.joints)
    amplitudes = found.extension.reshape(*found.extension.shape[:2], harmonics.size, n_joints)
    # The whole period, for a damper may have other forces in one direction than in the other.
    angle = np.outer(harmonics, 2 * np.pi * (np.arange(N_TIMES) + 0.5) / N_TIMES)
    omega = np.sqrt(found.eigenvalue)
    extension = np.einsum("nphj,ht->npjt", amplitudes, np.cos(angle))
    rate = -omega[..., None, None] * np.einsum("nphj,ht->npjt", amplitudes, harmonics[:, None] * np.sin(angle))
    # Where all harmonics are at their largest, a cycle turns.
    reach = np.abs(amplitudes.sum(axis=2))
    # In the other parts of the period the springs have the same forces, in the opposite order or of the other sign.
    n_own = N_TIMES // (2 if 0 in harmonics else 4)
    own = extension[..., :n_own]
    at_rest, nothing = np.zeros_like(own), np.zeros_like(extension)
    elastic = sum((term.find_force(own, at_rest, reach) for term in springs), at_rest)
    weight = np.cos(angle[:, :n_own]) * np.where(harmonics == 0, 1.0, 2.0)[:, None] / n_own
    q = _find_coordinates(found, system, amplitudes, np.einsum("npjt,ht->nphj", elastic, weight))
    square = (harmonics[:, None] * q) ** 2
    modal = square @ np.sqrt(np.maximum(system.eigenvalue, 0.0))
    lost = 2 * np.pi * damping_ratio[:, None] * omega * modal.sum(axis=2)
    resisting = sum((term.find_force(extension, rate, reach) for term in dampers), nothing)
    lost = lost + 2 * np.pi / omega * np.sum(resisting * rate, axis=2).mean(axis=-1)
    for term in springs:
        lost = lost + np.sum(term.find_lost_in_cycle(reach) * np.ones_like(reach), axis=2)
    return lost, 0.5 * found.eigenvalue * square.sum(axis=(2, 3))


def _find_coordinates(
    found: BackboneFamily, system: JointedModes, amplitudes: FloatArray, forces: FloatArray
) -> FloatArray:
    """Return the harmonics of the modal coordinates, (n_samples, n_points, n_harmonics, n_modes).

    `amplitudes` and `forces` are those of the extensions of the joints and of their forces, (n_samples, n_points,
    n_harmonics, n_joints).
    """
    m, first, own = system.index(found.mode), found.harmonics.index(1), system.at_joints[:, system.index(found.mode)]
    apart = system.eigenvalue - np.array(found.harmonics)[:, None] ** 2 * found.eigenvalue[..., None, None]
    # The equation of the mode itself is singular in the first harmonic; there the extensions tell its coordinate.
    # A mean loses nothing, and that of a free mode is not known.
    apart[..., first, m] = np.inf
    apart[..., np.array(found.harmonics) == 0, :] = np.inf
    q = -(forces @ system.at_joints) / apart
    q[..., first, m] = (amplitudes[..., first, :] - q[..., first, :] @ system.at_joints.T) @ own / (own @ own)
    return np.asarray(q)
