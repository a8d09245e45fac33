"""Few coordinates for a finite-element structure: sensors, joints and modes (Craig and Bampton 1968); Ritz vectors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, sparse

from opid.errors import InputError, nearest, require_positive
from opid.mechanics.backbones.jointed_modes import JointedModes, jointed_modes
from opid.mechanics.structure import modal_assurance
from opid.signals.recording import FloatArray
from opid.updating.structure.affine import AffineStructure

IntArray = NDArray[np.int64]

SHIFT = 1e-6  # shift over the mean ratio of stiffness to mass; it makes the stiffness of a free structure regular
ALIKE = 0.5  # modal assurance criterion from which on two shapes are taken for the same


@dataclass(frozen=True, eq=False)
class ReducedStructure:
    """M x'' + K x = 0 in few coordinates p, x = basis p.

    Args:
        mass: (n, n) mass matrix, kg.
        stiffness: (n, n) stiffness matrix, N/m.
        basis: (n_dof, n) motion of every degree of freedom for a unit of each coordinate.
        sensor_rows: (n_sensors, n) rows of `basis` at the sensors.
        joint_rows: (n_joints, n) extension of each joint.
        boundary: degrees of freedom that were kept as coordinates, in order (sensors, then ends of joints).
        sensors: names of the sensors.
        joints: names of the joints.
        method: "fixed" or "free".
        n_cut: number of directions that were removed because the free modes contain them.
    """

    mass: FloatArray
    stiffness: FloatArray
    basis: FloatArray
    sensor_rows: FloatArray
    joint_rows: FloatArray
    boundary: tuple[str, ...]
    sensors: tuple[str, ...]
    joints: tuple[str, ...]
    method: str
    n_cut: int = 0

    @property
    def n_dof(self) -> int:
        """Number of coordinates."""
        return len(self.mass)


@dataclass(frozen=True, eq=False)
class ReductionErrors:
    """The differences of a reduced structure from the full one, mode by mode (Song Fig. 7).

    Args:
        frequency_hz: (n,) frequencies of the full structure, Hz.
        reduced_hz: (n,) frequencies of the reduced structure, Hz.
        relative: (n,) frequency of the reduced over that of the full structure, less 1.
        mac: (n,) modal assurance criterion of modes with the same number, over all degrees of freedom. For modes with
            equal frequencies it is that of the nearest shape in their common space.
        nearest: (n,) number, from 1, of the mode of the full structure whose shape each reduced mode has: its own, or
            another one where the order has changed; 0 where none of the n has a MAC of 0.5.
        nearest_mac: (n,) modal assurance criterion with that mode, or the largest where there is none.
        method: "fixed" or "free".
        n_dof: number of coordinates of the reduced structure.
        n_cut: number of directions that were removed because other coordinates contain them.
    """

    frequency_hz: FloatArray
    reduced_hz: FloatArray
    relative: FloatArray
    mac: FloatArray
    nearest: IntArray
    nearest_mac: FloatArray
    method: str = "fixed"
    n_dof: int = 0
    n_cut: int = 0


def lowest_modes(mass: Any, stiffness: Any, n_modes: int) -> tuple[FloatArray, FloatArray]:
    """Return the lowest eigenvalues (n_modes,), 1/s^2, ascending, and the mass-normalised shapes (n_dof, n_modes).

    The matrices are sparse or dense, in kg and N/m; the stiffness may be singular (a free structure). InputError: more
    modes than degrees of freedom, or a stiffness that is not positive.

    >>> lowest_modes(np.eye(2), np.diag([9.0, 4.0]), 1)[0].round(9).tolist()
    [4.0]
    """
    from scipy.sparse.linalg import eigsh

    n_dof = mass.shape[0]
    if not 1 <= n_modes <= n_dof:
        raise InputError(f"{n_modes} modes of {n_dof} degrees of freedom are wanted: give a number from 1 to {n_dof}")
    m, k = sparse.csc_matrix(mass), sparse.csc_matrix(stiffness)
    if n_dof <= 200 or n_modes > n_dof // 2:  # the dense solver is faster
        eigenvalue, shapes = linalg.eigh(k.toarray(), m.toarray(), subset_by_index=(0, n_modes - 1))
    else:
        shift = -SHIFT * k.diagonal().mean() / m.diagonal().mean()
        # With a fixed start the answer is the same from call to call.
        eigenvalue, shapes = eigsh(k, k=n_modes, M=m, sigma=shift, v0=np.random.default_rng(1).standard_normal(n_dof))
        order = np.argsort(eigenvalue)
        eigenvalue, shapes = eigenvalue[order], shapes[:, order]
    # Rounding may put a rigid-body mode a little below 0.
    if eigenvalue[0] < -max(1e-3 * SHIFT * k.diagonal().mean() / m.diagonal().mean(), 1e-6 * eigenvalue[-1]):
        raise InputError(
            f"the stiffness is not positive: its lowest eigenvalue is {eigenvalue[0]:.3g} 1/s^2; check the signs of "
            "its parts, and whether each part is complete"
        )
    return eigenvalue, shapes / np.sqrt(np.einsum("ij,ij->j", shapes, m @ shapes))


def craig_bampton(
    structure: AffineStructure, factors: Mapping[str, float] | None = None, *, n_modes: int = 15, method: str = "fixed"
) -> ReducedStructure:
    """Reduce a structure to its boundary (sensors, then other ends of joints) and internal modes.

    Every boundary degree of freedom has its constraint mode, the static shape for a unit of it with the others held.
    "fixed" adds the lowest modes with the boundary held (Craig and Bampton); "free" adds the lowest modes of the whole
    structure, as in section 4.2 of Song et al. Free modes lie almost within the space of the constraint modes, so that
    the common mass matrix is nearly singular: directions that are there twice are removed.

    Args:
        structure: the finite-element structure.
        factors: factors of the stiffness parts by name; 1 where left out.
        n_modes: number of internal modes.
        method: "fixed" or "free".

    Raises:
        InputError: an unknown factor or method, a factor that is not positive, or more modes than there are.
    """
    factors = {} if factors is None else factors
    if method not in ("fixed", "free"):
        raise InputError(f"there is no reduction {method!r}: give 'fixed' or 'free'")
    for name, value in factors.items():
        require_positive(f"the factor {name!r}", value)
    stiffness = structure.stiffness_at(factors)
    boundary = list(dict.fromkeys([*structure.sensors, *(end for ends in structure.joints.values() for end in ends)]))
    kept = np.array([structure.dofs.index(name) for name in boundary])
    inner = np.setdiff1d(np.arange(structure.n_dof), kept)
    most, which = (inner.size, "inside") if method == "fixed" else (structure.n_dof, "in all")
    if not 0 <= n_modes <= most:
        raise InputError(f"n_modes is {n_modes}: give a number from 0 to {most}, the degrees of freedom {which}")
    basis = np.zeros((structure.n_dof, len(boundary) + n_modes))
    basis[kept, np.arange(len(boundary))] = 1.0
    if inner.size:
        basis[inner, : len(boundary)] = _solve_constraint_modes(stiffness, inner, kept)
    if n_modes and method == "fixed":
        held = np.ix_(inner, inner)
        basis[inner, len(boundary) :] = lowest_modes(structure.mass[held], stiffness[held], n_modes)[1]
    elif n_modes:
        shapes = lowest_modes(structure.mass, stiffness, n_modes)[1]
        basis = _join_free_modes(structure.mass, basis[:, : len(boundary)], shapes)
    n_cut = len(boundary) + n_modes - basis.shape[1]
    mass, reduced = (basis.T @ (matrix @ basis) for matrix in (structure.mass, stiffness))
    found = ReducedStructure(
        (mass + mass.T) / 2, (reduced + reduced.T) / 2, basis, basis[structure.sensor_indices],
        structure.joint_rows @ basis, tuple(boundary), structure.sensors, tuple(structure.joints), method, n_cut,
    )  # fmt: skip
    for array in (found.mass, found.stiffness, found.basis, found.sensor_rows, found.joint_rows):
        array.flags.writeable = False
    return found


def reduce(
    structure: AffineStructure, factors: Mapping[str, float] | None = None, *, n_modes: int = 15
) -> JointedModes:
    """Return the modes of a structure reduced by fixed-interface modes: `modes_of(craig_bampton(...))`.

    `structure`, `factors` and `n_modes` are those of `craig_bampton`.
    """
    return modes_of(craig_bampton(structure, factors, n_modes=n_modes))


def modes_of(reduced: ReducedStructure) -> JointedModes:
    """Return all modes of a `reduced` structure, as its sensors and joints see them."""
    return jointed_modes(
        reduced.mass,
        reduced.stiffness,
        sensor_rows=reduced.sensor_rows,
        joint_rows=reduced.joint_rows,
        sensors=reduced.sensors,
        joints=reduced.joints,
    )


def find_couplings(structure: AffineStructure, reduced: ReducedStructure) -> FloatArray:
    """Return what each part of the stiffness is between the modes of `modes_of(reduced)`, for a unit of its factor.

    The coordinates of the reduced structure are held.

    Args:
        structure: the structure that was reduced.
        reduced: the reduced structure.

    Returns:
        (n_parts, n_modes, n_modes) Phi^T K_i Phi in the order of the parts, 1/s^2.
    """
    _, shapes = linalg.eigh(reduced.stiffness, reduced.mass)
    basis = reduced.basis @ shapes
    return np.array([basis.T @ (part @ basis) for part in structure.parts.values()])


def reduction_errors(
    structure: AffineStructure, reduced: ReducedStructure, n: int = 15, *, factors: Mapping[str, float] | None = None
) -> ReductionErrors:
    """Compare the first n modes of a reduced structure with those of the full one (Song Fig. 7).

    Args:
        structure: the finite-element structure.
        reduced: the reduced structure.
        n: number of modes to compare, at most that of the coordinates of the reduced structure.
        factors: factors of the stiffness parts in the reduction.

    Raises:
        InputError: an unknown factor, or more modes than the reduced structure has.
    """
    if not 1 <= n <= reduced.n_dof:
        raise InputError(f"n is {n}: give a number from 1 to {reduced.n_dof}, the modes of the reduced structure")
    eigenvalue, shapes = lowest_modes(structure.mass, structure.stiffness_at(factors or {}), n)
    found, coordinates = linalg.eigh(reduced.stiffness, reduced.mass, subset_by_index=(0, n - 1))
    other = reduced.basis @ coordinates
    full_hz, reduced_hz = (np.sqrt(np.maximum(part, 0.0)) / (2 * np.pi) for part in (eigenvalue, found))
    # [i, j] compares reduced mode i with full mode j, or with the nearest shape among modes of the frequency of j.
    mac = np.empty((n, n))
    for mode in range(n):
        alike = np.flatnonzero(np.abs(full_hz - full_hz[mode]) <= 1e-4 * full_hz[mode])
        nearest_shapes = shapes[:, alike] @ np.linalg.lstsq(shapes[:, alike], other, rcond=None)[0]
        mac[:, mode] = [modal_assurance(*pair).item() for pair in zip(nearest_shapes.T, other.T, strict=True)]
    own = mac.diagonal()
    nearest = np.where(own >= ALIKE, np.arange(n), np.argmax(mac, axis=1)).astype(np.int64)
    nearest_mac = mac[np.arange(n), nearest]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(full_hz > 0, reduced_hz / full_hz - 1, 0.0)
    return ReductionErrors(
        full_hz, reduced_hz, relative, own.copy(), np.where(nearest_mac >= ALIKE, nearest + 1, 0), nearest_mac,
        reduced.method, reduced.n_dof, reduced.n_cut,
    )  # fmt: skip


def _solve_constraint_modes(stiffness: sparse.csr_matrix, inner: Any, kept: Any) -> FloatArray:
    """Return the static motion of the inner degrees of freedom for unit of each kept one, -K_ii^-1 K_ib."""
    from scipy.sparse.linalg import splu

    try:
        solved = splu(sparse.csc_matrix(stiffness[np.ix_(inner, inner)])).solve(
            -stiffness[np.ix_(inner, kept)].toarray()
        )
    except RuntimeError:
        solved = np.array([np.nan])
    if not np.isfinite(solved).all():
        raise InputError(
            "the structure can still move freely with its sensors and joints held: put it on springs or add sensors"
        )
    return solved


def _join_free_modes(mass: sparse.csr_matrix, constraint: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return constraint modes without the space of the free modes, as mass-orthogonal columns, then the free modes."""
    size = np.einsum("ij,ij->j", constraint, mass @ constraint)
    remainder = (constraint - shapes @ (shapes.T @ (mass @ constraint))) / np.sqrt(size)
    weight, direction = linalg.eigh(remainder.T @ (mass @ remainder))
    keep = weight > 1e-10
    return np.hstack([remainder @ (direction[:, keep] / np.sqrt(weight[keep])), shapes])


# ---- many parameter values -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RitzModel:
    """(K0 + sum theta_i K_i) c = lambda c in mass-orthonormal Ritz vectors."""

    stiffness: FloatArray  # (n, n) K0
    parts: FloatArray  # (n_parameters, n, n) K_i
    sensor_rows: FloatArray  # (n_sensors, n) motion of the sensors
    names: tuple[str, ...]  # names of the parameters
    sensors: tuple[str, ...]  # names of the sensors
    n_modes: int  # number of its lowest modes that are right
    worst: float  # estimated largest relative error of an eigenvalue over the box of parameters


def ritz_model(
    structure: AffineStructure, *, box: Mapping[str, tuple[float, float]], modes: Sequence[int]
) -> RitzModel:
    """Return a small model whose modes are those of the structure everywhere in a box of parameters.

    It begins with the modes at the middle of the box. Among points spread over the box, that with the largest residual
    K phi - lambda M phi of a wanted mode, in the norm of the inverse stiffness, is chosen; the shapes of the full
    structure there are added, until the residual is small everywhere.

    Args:
        structure: the finite-element structure.
        box: lower and upper end of each parameter that varies, positive; the others stay at 1.
        modes: numbers of the wanted modes, from 1; modes below them are only kept so that the numbers are right.

    Raises:
        InputError: an unknown parameter, an empty box, no mode or one that the structure does not have.
    """
    _refuse_box(structure, box)
    names, (low, high) = tuple(box), np.array(list(box.values()), dtype=np.float64).T
    wanted = np.array(sorted(set(modes)), dtype=np.intp) - 1
    if not wanted.size or wanted[0] < 0 or wanted[-1] >= structure.n_dof:
        raise InputError(f"modes are {list(modes)}: give numbers from 1 to {structure.n_dof}")
    count = int(wanted[-1]) + 1
    parts = [structure.parts[name] for name in names]
    base = structure.stiffness_at(dict.fromkeys(names, 1.0)) - sum(parts)

    def stiffness_at(theta: FloatArray) -> sparse.csr_matrix:
        return sparse.csr_matrix(base + sum(value * part for value, part in zip(theta, parts, strict=True)))

    points, middle = _spread_points(low, high), np.sqrt(low * high)
    solve = _factorise(structure.mass, stiffness_at(middle))
    basis = lowest_modes(structure.mass, stiffness_at(middle), count)[1]
    done: set[int] = set()
    for _ in range(40):
        images = [matrix @ basis for matrix in (base, *parts)]
        reduced = [(each + each.T) / 2 for each in (basis.T @ image for image in images)]
        rows = basis[structure.sensor_indices]
        model = RitzModel(reduced[0], np.array(reduced[1:]), rows, names, structure.sensors, count, 0.0)
        errors = _estimate_errors(model, structure.mass @ basis, images, points, wanted, solve, middle)
        worst = int(np.argmax(errors))
        if errors[worst] <= 1e-8 or worst in done or len(basis.T) >= structure.n_dof:
            break
        done.add(worst)
        shapes = lowest_modes(structure.mass, stiffness_at(points[worst]), count)[1]
        basis = _extend_basis(structure.mass, basis, shapes[:, wanted])
    return replace(model, worst=float(errors.max()))


def ritz_modes(model: RitzModel, theta: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (n, n_modes), 1/s^2, and mass-normalised shapes at the sensors (n, n_sensors, n_modes).

    Args:
        model: the model, from `ritz_model`.
        theta: (n, n_parameters) parameters, all at once.

    Raises:
        InputError: theta of another shape.
    """
    rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
    if rows.shape[1:] != (len(model.names),):
        raise InputError(f"theta has shape {rows.shape}: give one column for each of {len(model.names)} parameters")
    eigenvalue, vectors = np.linalg.eigh(model.stiffness + np.tensordot(rows, model.parts, axes=1))
    return eigenvalue[:, : model.n_modes], model.sensor_rows @ vectors[:, :, : model.n_modes]


def _refuse_box(structure: AffineStructure, box: Mapping[str, tuple[float, float]]) -> None:
    for name in box:
        if name not in structure.parts:
            known = nearest(name, structure.parts) if structure.parts else "the structure has none"
            raise InputError(f"there is no parameter {name!r}: {known}")
    if not box:
        raise InputError("no parameter varies: name at least one with its range")
    for name, (low, high) in box.items():
        if not 0 < low < high < np.inf:
            raise InputError(f"{name!r} varies from {low:g} to {high:g}: give positive ends, the lower one first")


def _spread_points(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return points over the box, evenly in the logarithm, with its corners."""
    from scipy.stats import qmc

    inner = qmc.Sobol(low.size, scramble=False).random(64)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * min(low.size, 6))).reshape(min(low.size, 6), -1).T
    corners = np.pad(corners, ((0, 0), (0, low.size - corners.shape[1])), constant_values=0.5)
    return low * (high / low) ** np.vstack([corners, inner])


def _factorise(mass: Any, stiffness: Any) -> Callable[[FloatArray], FloatArray]:
    """Return the inverse of a stiffness as a function; a small shift makes that of a free structure regular."""
    from scipy.sparse.linalg import splu

    shift = SHIFT * stiffness.diagonal().mean() / mass.diagonal().mean()
    return splu(sparse.csc_matrix(stiffness + shift * mass)).solve


def _estimate_errors(
    model: RitzModel,
    inertia: FloatArray,
    images: Sequence[FloatArray],
    points: FloatArray,
    wanted: NDArray[np.intp],
    solve: Callable[[FloatArray], FloatArray],
    middle: FloatArray,
) -> FloatArray:
    """Return the estimated relative error of the worst wanted eigenvalue, r^T K^-1 r / lambda, (n_points,).

    `inertia` is the mass times the basis, and `images` are the stiffness K0 and its parts times the basis.
    """
    eigenvalue, vectors = np.linalg.eigh(model.stiffness + np.tensordot(points, model.parts, axes=1))
    errors = np.zeros(len(points))
    for row, theta in enumerate(points):
        value, vector = eigenvalue[row, wanted], vectors[row][:, wanted]
        residual = (images[0] + np.tensordot(theta, images[1:], axes=1)) @ vector - (inertia @ vector) * value
        # K at theta is at least the smallest ratio times K at the middle.
        size = np.einsum("ij,ij->j", residual, solve(residual)) / min(1.0, float(np.min(theta / middle)))
        errors[row] = np.max(size / np.maximum(value, 1e-300))
    return errors


def _extend_basis(mass: Any, basis: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the basis with the parts of the shapes outside it, mass-orthonormal."""
    for shape in shapes.T:
        remainder = shape
        for _ in range(2):  # the second time against rounding
            remainder = remainder - basis @ (basis.T @ (mass @ remainder))
        size = np.sqrt(remainder @ (mass @ remainder))
        if size > 1e-7:
            basis = np.column_stack([basis, remainder / size])
    return basis
