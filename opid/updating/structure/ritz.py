"""Modes of a structure with affine stiffness for many parameter values, by Ritz vectors that serve all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse

from opid.errors import InputError, nearest
from opid.signals.recording import FloatArray
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import SHIFT, lowest_modes


@dataclass(frozen=True, eq=False)
class RitzModel:
    """(K0 + sum theta_i K_i) c = lambda c in mass-orthonormal Ritz vectors."""

    stiffness: FloatArray  # (n, n) K0
    parts: FloatArray  # (n_parameters, n, n) K_i
    sensor_rows: FloatArray  # (n_sensors, n) motion of the sensors
    names: tuple[str, ...]  # of the parameters
    sensors: tuple[str, ...]  # names of the sensors
    n_modes: int  # number of its lowest modes that are right
    worst: float  # estimated largest relative error of an eigenvalue over the box it was made for


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
        modes: numbers of the wanted modes, from 1; those below them are only kept so that the numbers are right.

    Raises:
        InputError: an unknown parameter, an empty box, no mode or one that is not there.
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

    points, middle = _spread(low, high), np.sqrt(low * high)
    solve = _inverse(structure.mass, stiffness_at(middle))
    basis = lowest_modes(structure.mass, stiffness_at(middle), count)[1]
    done: set[int] = set()
    for _ in range(40):
        images = [matrix @ basis for matrix in (base, *parts)]
        reduced = [(each + each.T) / 2 for each in (basis.T @ image for image in images)]
        rows = basis[structure.sensor_indices]
        model = RitzModel(reduced[0], np.array(reduced[1:]), rows, names, structure.sensors, count, 0.0)
        errors = _errors(model, structure.mass @ basis, images, points, wanted, solve, middle)
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
        model: of `ritz_model`.
        theta: (n, n_parameters), all at once.

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
        raise InputError("no parameter is to vary: name at least one with its range")
    for name, (low, high) in box.items():
        if not 0 < low < high < np.inf:
            raise InputError(f"{name!r} is to vary from {low:g} to {high:g}: give positive ends, the lower one first")


def _spread(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return points over the box, evenly in the logarithm, with its corners."""
    from scipy.stats import qmc

    inner = qmc.Sobol(low.size, scramble=False).random(64)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * min(low.size, 6))).reshape(min(low.size, 6), -1).T
    corners = np.pad(corners, ((0, 0), (0, low.size - corners.shape[1])), constant_values=0.5)
    return low * (high / low) ** np.vstack([corners, inner])


def _inverse(mass: Any, stiffness: Any) -> Callable[[FloatArray], FloatArray]:
    """Return the inverse of a stiffness as a function; a small shift makes that of a free structure regular."""
    from scipy.sparse.linalg import splu

    shift = SHIFT * stiffness.diagonal().mean() / mass.diagonal().mean()
    return splu(sparse.csc_matrix(stiffness + shift * mass)).solve


def _errors(
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
        # K at theta is at least the smallest ratio times K at the middle
        size = np.einsum("ij,ij->j", residual, solve(residual)) / min(1.0, float(np.min(theta / middle)))
        errors[row] = np.max(size / np.maximum(value, 1e-300))
    return errors


def _extend_basis(mass: Any, basis: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return the basis with the parts of the shapes outside it, mass-orthonormal."""
    for shape in shapes.T:
        rest = shape
        for _ in range(2):  # the second time against rounding
            rest = rest - basis @ (basis.T @ (mass @ rest))
        size = np.sqrt(rest @ (mass @ rest))
        if size > 1e-7:
            basis = np.column_stack([basis, rest / size])
    return basis
