"""A user's finite-element structure whose stiffness is affine in the parameters to update: K = K0 + sum theta_i K_i."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from scipy import sparse

from opid.errors import InputError, nearest
from opid.signals.recording import FloatArray

SYMMETRY = 1e-8
"""Of the largest entry: what a matrix of a finite-element code may be unsymmetric by rounding."""


@dataclass(frozen=True, eq=False)
class AffineStructure:
    """M x'' + (K0 + sum theta_i K_i) x + joints = 0, with names for what is measured and where the joints are.

    Args:
        mass: (n_dof, n_dof) sparse M, kg; symmetric, positive on the diagonal.
        stiffness: (n_dof, n_dof) sparse K0 of what is not updated (springs it hangs on), N/m; symmetric.
        parts: K_i by the name of the parameter theta_i that multiplies it (1 for the nominal structure), N/m.
        dofs: name of each degree of freedom.
        sensors: degrees of freedom that are measured, by name, in the order of the data.
        joints: the two degrees of freedom that each nonlinear joint lies between, by the name of the joint.

    Raises:
        InputError: everything that is wrong with it: shapes, symmetry, a mass that is not positive, unknown names.
    """

    mass: sparse.csr_matrix
    stiffness: sparse.csr_matrix
    parts: Mapping[str, sparse.csr_matrix]
    dofs: tuple[str, ...]
    sensors: tuple[str, ...]
    joints: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "dofs", tuple(self.dofs))
        object.__setattr__(self, "sensors", tuple(self.sensors))
        n_dof = len(self.dofs)
        if len(set(self.dofs)) < n_dof:
            twice = next(name for name in self.dofs if self.dofs.count(name) > 1)
            raise InputError(f"the degree of freedom {twice!r} stands twice: give each a name of its own")
        for name in ("mass", "stiffness"):
            object.__setattr__(self, name, _checked(name, getattr(self, name), n_dof))
        parts = {name: _checked(f"stiffness part {name!r}", part, n_dof) for name, part in self.parts.items()}
        object.__setattr__(self, "parts", MappingProxyType(parts))
        object.__setattr__(self, "joints", MappingProxyType({k: (a, b) for k, (a, b) in self.joints.items()}))
        if self.mass.diagonal().min() <= 0:
            bad = self.dofs[int(np.argmin(self.mass.diagonal()))]
            raise InputError(f"the mass of {bad!r} is not positive: remove the degree of freedom or give it a mass")
        if not self.sensors:
            raise InputError("no sensor is named: say which degrees of freedom are measured")
        for sensor in self.sensors:
            self._place("sensor", sensor)
        for joint, (one, other) in self.joints.items():
            for end in (one, other):
                self._place(f"joint {joint!r}", end)
            if one == other:
                raise InputError(f"joint {joint!r} lies between {one!r} and itself: name two degrees of freedom")

    @property
    def n_dof(self) -> int:
        """Number of degrees of freedom."""
        return len(self.dofs)

    def stiffness_at(self, factors: Mapping[str, float]) -> sparse.csr_matrix:
        """K0 + sum theta_i K_i for these factors by name; 1 where one is left out. InputError for an unknown name."""
        for name in factors:
            if name not in self.parts:
                raise InputError(f"there is no parameter {name!r}: {nearest(name, self.parts)}")
        total = self.stiffness.copy()
        for name, part in self.parts.items():
            total = total + float(factors.get(name, 1.0)) * part
        return sparse.csr_matrix(total)

    @property
    def sensor_places(self) -> FloatArray:
        """(n_sensors,) place of each sensor among the degrees of freedom."""
        return np.array([self.dofs.index(sensor) for sensor in self.sensors])

    @property
    def joint_rows(self) -> FloatArray:
        """(n_joints, n_dof) extension of each joint, second end less first, for unit motion."""
        rows = np.zeros((len(self.joints), self.n_dof))
        for row, (one, other) in zip(rows, self.joints.values(), strict=True):
            row[self.dofs.index(one)], row[self.dofs.index(other)] = -1.0, 1.0
        return rows

    def _place(self, what: str, name: str) -> int:
        if name not in self.dofs:
            raise InputError(
                f"{what} names the degree of freedom {name!r}, which is not there: {nearest(name, self.dofs)}"
            )
        return self.dofs.index(name)


def _checked(name: str, matrix: sparse.spmatrix, n_dof: int) -> sparse.csr_matrix:
    found = sparse.csr_matrix(matrix, dtype=np.float64)
    if found.shape != (n_dof, n_dof):
        raise InputError(f"the {name} matrix has shape {found.shape} for {n_dof} degrees of freedom: give a square one")
    if not np.isfinite(found.data).all():
        raise InputError(f"the {name} matrix has entries that are not finite: export it again")
    if found.nnz and np.abs((found - found.T).data).max(initial=0.0) > SYMMETRY * np.abs(found.data).max():
        raise InputError(f"the {name} matrix is not symmetric: export the whole matrix, or mirror the stored triangle")
    return found
