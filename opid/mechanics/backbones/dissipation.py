"""What follows from backbones that were found: the energy lost in a cycle, and the higher harmonics of all modes.

At phase resonance the force works against the damping alone: it feeds in what modes and joints lose. Damping moves the
frequency of a backbone in second order only, so its motion is that of the structure without damping.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

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
        return self._evaluate(extension, rate, reach)[0]

    def find_stiffness(self, extension: FloatArray, reach: FloatArray) -> FloatArray:
        """Return the derivative of that force by the extension, N/m, for a joint at rest."""
        return self._evaluate(extension, np.zeros_like(extension), reach)[1]

    def _evaluate(self, extension: FloatArray, rate: FloatArray, reach: FloatArray) -> list[FloatArray]:
        """Return the force, and its derivative by the extension."""
        kind = LAWS[self.kind]
        amplitude, *inner = (column[:, None, None, None] for column in self.values.T)
        found: tuple[Any, ...]
        if kind.cycle is not None:
            found = kind.cycle(extension, reach[..., None], *(*inner, 1.0, 1.0, 1.0)[:3])
        else:
            found = kind.function(extension, rate, *(*inner, 1.0, 1.0)[:2])
        return [np.asarray(amplitude * each * self.is_there[:, None]) for each in found[:2]]

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


# ---- higher harmonics ------------------------------------------------------------------------------


def find_higher_harmonics(
    found: BackboneFamily,
    springs: Sequence[PlacedTerm],
    orders: Sequence[int],
    *,
    at: FloatArray,
    eigenvalue: FloatArray,
    at_joints: FloatArray,
    damping_ratio: FloatArray,
) -> FloatArray:
    """Return harmonics above the first of the modal coordinates, (n_samples, n_points, n_orders, n_modes), m kg^1/2.

    The joints' extensions z_1 of the backbone are kept. The modes of a structure, which may be another one than that of
    the backbone, answer to the forces linearly, with F_h and S = dF_h/dz those of the backbone's extensions z:

        (l_i - h^2 l + 2j zeta h (l_i l)^1/2) q_ih + psi_i^T (F_h + S (sum_k psi_k q_k - z)) = 0,

    so that a mode which a harmonic meets answers at the frequency of a test, where a backbone would have a loop. What
    is in phase with the first harmonic is returned.

    Args:
        found: the backbones; harmonics that they do not have begin at 0.
        springs: the springs of the joints.
        orders: numbers of the harmonics, above 1.
        at: (n_points,) l, the eigenvalue of the motion, 1/s^2.
        eigenvalue: (n_samples, n_modes) l_i, 1/s^2.
        at_joints: (n_samples, n_joints, n_modes) psi.
        damping_ratio: (n_samples,) zeta of all modes.
    """
    n, n_points, n_joints, numbers = *found.eigenvalue.shape, at_joints.shape[1], np.array(orders)
    every = np.array(sorted({*found.harmonics, *orders}))
    amplitudes = np.zeros((n, n_points, every.size, n_joints))
    amplitudes[:, :, np.searchsorted(every, found.harmonics)] = found.extension.reshape(n, n_points, -1, n_joints)
    angle = 2 * np.pi * (np.arange(N_TIMES // (4 if every[0] and (every % 2).all() else 2)) + 0.5) / N_TIMES
    extension = np.einsum("nphj,ht->npjt", amplitudes, np.cos(np.outer(every, angle)))
    reach = np.abs(amplitudes.sum(axis=2))
    cosines = np.cos(np.outer(numbers, angle))
    nothing = np.zeros_like(extension)
    force = sum((term.find_force(extension, nothing, reach) for term in springs), nothing)
    stiffness = sum((term.find_stiffness(extension, reach) for term in springs), nothing)
    pushed = np.einsum("npjt,ht->nphj", force, 2 * cosines / angle.size)
    slopes = np.einsum("npjt,ht,gt->nphgj", stiffness, 2 * cosines / angle.size, cosines, optimize=True)
    own, square = eigenvalue[:, None, None], numbers[:, None] ** 2 * at[:, None, None]
    lag = 2j * damping_ratio[:, None, None, None] * np.sqrt(np.maximum(own, 0.0) * square)
    receptance = 1 / (own - square + lag)
    flexibility = np.einsum("nji,nphi,nki->nphjk", at_joints, receptance, at_joints, optimize=True)
    start = amplitudes[:, :, np.searchsorted(every, numbers)]
    size = numbers.size * n_joints
    coupled = np.einsum("nphjk,nphgk->nphjgk", flexibility, slopes).reshape(n, n_points, size, size)
    missing = start + np.einsum("nphjk,nphk->nphj", flexibility, pushed)
    moved = np.linalg.solve(np.eye(size) + coupled, -missing.reshape(n, n_points, size, 1))
    pushed = pushed + np.einsum("nphgj,npgj->nphj", slopes, moved.reshape(n, n_points, numbers.size, n_joints))
    return np.asarray(-(receptance * np.einsum("nphj,nji->nphi", pushed, at_joints)).real)
