"""The modes of a reduced structure as functions of the factors of its stiffness."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from opid.errors import InputError
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import craig_bampton, find_couplings, modes_of

REMEMBERED = 1024  # number of structures that are kept: as many as a sampler asks for at once


@dataclass(frozen=True, eq=False)
class FactoredModes:
    """The modes of K0 + sum theta_i K_i in the coordinates of the modes at reference factors.

    The static shapes and the internal modes of the reduction stay those of the reference factors, so that an error of a
    frequency is of the second order in the change of the factors: on the wing-engine structure it grows by 2e-6 where a
    modulus changes by 30 % (tests/test_factored_modes.py).

    Args:
        base: the modes at the reference factors.
        names: names of the factors.
        reference: (n_factors,) reference factors.
        covariance: (n_factors, n_factors) what is known of the factors: where a search for them begins.
        couplings: (n_factors, n_modes, n_modes) each part of the stiffness between these modes, for a unit of its
            factor, 1/s^2.
    """

    base: JointedModes
    names: tuple[str, ...]
    reference: FloatArray
    covariance: FloatArray
    couplings: FloatArray

    def at(self, factors: FloatArray) -> tuple[JointedModes, FloatArray]:
        """Return the modes for `factors`, (n_factors,), from the lowest, and the couplings between them.

        Raises:
            InputError: factors with which the structure is not stiff.
        """
        return self._remembered(tuple(factors.tolist()))

    @cached_property
    def _remembered(self) -> Callable[[tuple[float, ...]], tuple[JointedModes, FloatArray]]:
        # The curves of all modes and sensors ask for the same factors, one after the other.
        return lru_cache(maxsize=REMEMBERED)(self._solve)

    def _solve(self, factors: tuple[float, ...]) -> tuple[JointedModes, FloatArray]:
        changed = np.diag(self.base.eigenvalue) + np.tensordot(factors - self.reference, self.couplings, axes=1)
        eigenvalue, turn = np.linalg.eigh(changed)
        if eigenvalue[0] < -1e-6 * eigenvalue[-1]:
            raise InputError(f"the factors {list(factors)} make the stiffness negative: give larger ones")
        # Eigenvectors have any sign; with that of the reference, shapes are continuous functions of the factors.
        turn = turn * np.where(np.take_along_axis(turn, np.argmax(np.abs(turn), axis=0)[None], axis=0) < 0, -1.0, 1.0)
        system = JointedModes(
            eigenvalue, self.base.at_sensors @ turn, self.base.at_joints @ turn, self.base.sensors, self.base.joints
        )
        return system, turn.T @ self.couplings @ turn


def factored_modes(
    structure: AffineStructure, factors: Mapping[str, float], covariance: FloatArray, *, n_modes: int = 15
) -> FactoredModes:
    """Return the modes of a structure as functions of factors of its stiffness, about reference `factors` by name.

    Args:
        structure: the finite-element structure.
        factors: the reference of each factor that varies; the others stay at 1.
        covariance: (n_factors, n_factors) what is known of them.
        n_modes: number of internal modes of the reduction.

    Raises:
        InputError: an unknown factor, one that is not positive, or more modes than there are.
    """
    reduced = craig_bampton(structure, factors, n_modes=n_modes)
    parts = [*structure.parts]
    couplings = find_couplings(structure, reduced)[[parts.index(name) for name in factors]]
    return FactoredModes(modes_of(reduced), tuple(factors), np.array(list(factors.values())), covariance, couplings)
