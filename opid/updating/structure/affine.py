"""A user's finite-element structure whose stiffness is affine in the parameters to update: K = K0 + sum theta_i K_i."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from opid.errors import InputError, nearest, refuse
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class AffineStructure:
    """M x'' + (K0 + sum theta_i K_i) x + joints = 0, with the names of sensors and joints.

    Args:
        mass: (n_dof, n_dof) sparse M, kg; symmetric, positive on the diagonal.
        stiffness: (n_dof, n_dof) sparse K0 of the parts that are not updated (such as soft supports), N/m; symmetric.
        parts: K_i by the name of the parameter theta_i that multiplies it (1 for the nominal structure), N/m.
        dofs: name of each degree of freedom.
        sensors: names of the degrees of freedom that are measured, in the order of the data.
        joints: the two degrees of freedom between which each nonlinear joint acts, by the name of the joint; or the one
            that a joint to the ground holds.

    Raises:
        InputError: everything that is wrong with it: shapes, symmetry, a mass that is not positive, unknown names.
    """

    mass: sparse.csr_matrix
    stiffness: sparse.csr_matrix
    parts: Mapping[str, sparse.csr_matrix]
    dofs: tuple[str, ...]
    sensors: tuple[str, ...]
    joints: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("dofs", "sensors"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("mass", "stiffness"):
            object.__setattr__(self, name, sparse.csr_matrix(getattr(self, name), dtype=np.float64))
        parts = {name: sparse.csr_matrix(part, dtype=np.float64) for name, part in self.parts.items()}
        object.__setattr__(self, "parts", MappingProxyType(parts))
        joints = {name: (ends,) if isinstance(ends, str) else tuple(ends) for name, ends in self.joints.items()}
        object.__setattr__(self, "joints", MappingProxyType(joints))
        matrices = {"mass": self.mass, "stiffness": self.stiffness}
        matrices |= {f"stiffness part {name!r}": part for name, part in parts.items()}
        faults = [fault for name, matrix in matrices.items() for fault in matrix_faults(name, matrix, self.dofs)]
        refuse([*name_faults(self.dofs, self.sensors, self.joints), *faults], None)

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
    def sensor_indices(self) -> NDArray[np.int64]:
        """(n_sensors,) index of each sensor among the degrees of freedom."""
        return np.array([self.dofs.index(sensor) for sensor in self.sensors])

    @property
    def joint_rows(self) -> FloatArray:
        """(n_joints, n_dof) extension of each joint for unit motion, see `find_joint_rows`."""
        return find_joint_rows(self.joints, self.dofs)


def find_joint_rows(joints: Mapping[str, tuple[str, ...]], dofs: Sequence[str]) -> FloatArray:
    """Return the extension of each joint for unit motion of each degree of freedom, (n_joints, n_dof).

    It is the motion of the second end less that of the first; of a joint to the ground, that of its only end.

    Args:
        joints: the ends of each joint by its name.
        dofs: names of the degrees of freedom, or of the sensors of modes.

    >>> find_joint_rows({"link": ("a", "b"), "foot": ("a",)}, ("a", "b")).tolist()
    [[-1.0, 1.0], [1.0, 0.0]]
    """
    rows = np.zeros((len(joints), len(dofs)))
    for row, ends in zip(rows, joints.values(), strict=True):
        for end, sign in zip(reversed(ends), (1.0, -1.0), strict=False):
            row[dofs.index(end)] = sign
    return rows


def matrix_faults(name: str, matrix: sparse.csr_matrix, dofs: Sequence[str]) -> Iterator[str]:
    """Yield what is wrong with one matrix of a structure, "mass", "stiffness" or a part of it."""
    if matrix.shape != (len(dofs), len(dofs)):
        yield f"the {name} matrix has shape {matrix.shape} for {len(dofs)} degrees of freedom: give a square one"
    elif not np.isfinite(matrix.data).all():
        yield f"the {name} matrix has entries that are not finite: export it again"
    else:
        # Rounding in a finite-element code may leave a small difference.
        if matrix.nnz and np.abs((matrix - matrix.T).data).max(initial=0.0) > 1e-8 * np.abs(matrix.data).max():
            yield f"the {name} matrix is not symmetric: export the whole matrix, or mirror the stored triangle"
        if name == "mass" and matrix.diagonal().min() <= 0:
            bad = dofs[int(np.argmin(matrix.diagonal()))]
            yield f"the mass of {bad!r} is not positive: remove the degree of freedom or give it a mass"


def name_faults(
    dofs: Sequence[str],
    sensors: Sequence[str],
    joints: Mapping[str, tuple[str, ...]],
    *,
    what: str = "degree of freedom",
) -> Iterator[str]:
    """Yield what is wrong with the names of degrees of freedom, sensors and ends of joints.

    Args:
        dofs: names of the degrees of freedom, or of the sensors of modes.
        sensors: names of those that are measured.
        joints: the ends of each joint by its name.
        what: what each of `dofs` is, in words.
    """
    known = dict.fromkeys(dofs)
    if len(known) < len(dofs):
        twice = next(name for name in dofs if dofs.count(name) > 1)
        yield f"two degrees of freedom are called {twice!r}: give each a name of its own"
    if not sensors:
        yield "no sensor is named: name the degrees of freedom that are measured"
    named = [("sensor", sensor) for sensor in sensors]
    named += [(f"joint {joint!r}", end) for joint, ends in joints.items() for end in ends]
    for part, name in named:
        if name not in known:
            yield f"{part} names the {what} {name!r}, which does not exist: {nearest(name, known)}"
    for joint, ends in joints.items():
        if len(ends) not in (1, 2):
            yield f"joint {joint!r} has {len(ends)} ends: name the two between which it lies, or one for the ground"
        elif len(set(ends)) < len(ends):
            yield f"joint {joint!r} lies between {ends[0]!r} and itself: name two, or one for a joint to the ground"


def structure_faults(structure: AffineStructure) -> Iterator[str]:
    """Yield whether the mass or the nominal stiffness is not positive."""
    if (worst := _compute_least_eigenvalue(structure.mass)) <= 0:
        yield f"the mass matrix is not positive (eigenvalue {worst:.3g} kg): export it again"
    # A free structure has eigenvalues of 0, which rounding may make negative.
    stiffness = structure.stiffness_at({})
    largest = float(np.abs(stiffness.diagonal()).max(initial=0.0))
    if (worst := _compute_least_eigenvalue(stiffness, 1e-9 * largest)) < -1e-8 * largest:
        yield f"the stiffness matrix is not positive (eigenvalue {worst:.3g} N/m): look for a wrong sign"


def _compute_least_eigenvalue(matrix: object, shift: float = 0.0) -> float:
    """Return the least eigenvalue if it is negative, else 0 or a positive number: pivots show its sign (Sylvester)."""
    from scipy.sparse.linalg import eigsh

    found = sparse.csc_matrix(matrix)
    if found.shape[0] <= 2:
        return float(np.linalg.eigvalsh(found.toarray())[0])
    if _is_positive(found, shift):
        return 1.0
    # No eigenvalue lies below -largest; the first shift that is enough is at most ten times too large.
    largest = float(np.abs(found).sum(axis=0).max())
    shift = max(shift, 1e-12 * largest)
    while shift < largest and not _is_positive(found, shift):
        shift *= 10
    try:
        # All eigenvalues lie above -shift, so the nearest to it is the least.
        return float(eigsh(found, k=1, sigma=-shift, return_eigenvectors=False, tol=1e-4)[0])
    except (RuntimeError, ValueError):  # the shift is an eigenvalue, or the iteration does not converge
        return -shift


def _is_positive(matrix: Any, shift: float) -> bool:
    """Return whether a sparse matrix plus `shift` times the identity has positive pivots only."""
    from scipy.sparse.linalg import splu

    try:
        factors = splu(
            matrix + shift * sparse.identity(matrix.shape[0], format="csc"),
            permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
    except RuntimeError:  # singular
        return False
    return bool((factors.U.diagonal() > 0).all() and (factors.perm_r == factors.perm_c).all())
