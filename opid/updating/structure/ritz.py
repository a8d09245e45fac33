"""Modes of a structure with affine stiffness for very many parameter values: Ritz vectors that serve all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from opid.errors import InputError, nearest
from opid.signals.recording import FloatArray
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import SHIFT, lowest_modes

TOLERANCE = 1e-8
"""Relative error of an eigenvalue at which no more vectors are taken."""
N_CANDIDATES = 64
"""Parameter values, a power of 2, at which the basis is tried."""
MOST_ROUNDS = 40
"""Of refinement; each costs one sparse eigenvalue problem."""
DEPENDENT = 1e-7
"""Part of a shape outside the basis below which it is taken to lie within."""


@dataclass(frozen=True, eq=False)
class RitzModel:
    """(K0 + sum theta_i K_i) c = lambda c in mass-orthonormal Ritz vectors.

    Args:
        stiffness: (n, n) K0.
        parts: (n_parameters, n, n) K_i.
        sensor_rows: (n_sensors, n) motion of the sensors.
        names: of the parameters.
        sensors: names of the sensors.
        n_modes: lowest modes that it counts.
        worst: estimated largest relative error of an eigenvalue over the box it was made for.
    """

    stiffness: FloatArray
    parts: FloatArray
    sensor_rows: FloatArray
    names: tuple[str, ...]
    sensors: tuple[str, ...]
    n_modes: int
    worst: float

    @property
    def n_vectors(self) -> int:
        """Number of Ritz vectors."""
        return len(self.stiffness)


def ritz_model(
    structure: AffineStructure,
    *,
    box: Mapping[str, tuple[float, float]],
    modes: Sequence[int],
    tolerance: float = TOLERANCE,
) -> RitzModel:
    """Return a small model whose modes are those of the structure everywhere in a box of parameters.

    It begins with the modes at the middle of the box. Where the residual K phi - lambda M phi of a wanted mode, in the
    norm of the inverse stiffness, is largest among points spread over the box, the shapes of the full structure there
    are added, until it is small everywhere.

    Args:
        structure: the finite-element structure.
        box: lower and upper end of each parameter that varies, positive; the others stay at 1.
        modes: numbers of the wanted modes, from 1; those below are there only to be counted.
        tolerance: relative error of an eigenvalue that is good enough.

    Raises:
        InputError: an unknown parameter, an empty box, no mode or one that is not there.
    """
    names, low, high = _box(structure, box)
    wanted = np.array(sorted(set(modes)), dtype=np.intp) - 1
    if not wanted.size or wanted[0] < 0 or wanted[-1] >= structure.n_dof:
        raise InputError(f"modes are {list(modes)}: give numbers from 1 to {structure.n_dof}")
    count = int(wanted[-1]) + 1
    base = structure.stiffness_at(dict.fromkeys(names, 1.0)) - sum(structure.parts[name] for name in names)
    given = [structure.mass, sparse.csr_matrix(base), *(structure.parts[name] for name in names)]
    points = _spread(low, high)
    middle = np.sqrt(low * high)
    solve = _inverse(given, middle)
    basis = lowest_modes(given[0], _at(given, middle), count)[1]
    done: set[int] = set()
    for _ in range(MOST_ROUNDS):
        model = _model(structure, given, basis, names, count, 0.0)
        errors = _errors(model, given, basis, points, wanted, solve, middle)
        worst = int(np.argmax(errors))
        if errors[worst] <= tolerance or worst in done or len(basis.T) >= structure.n_dof:
            break
        done.add(worst)
        shapes = lowest_modes(given[0], _at(given, points[worst]), count)[1]
        basis = _extended(given[0], basis, shapes[:, wanted])
    return _model(structure, given, basis, names, count, float(errors.max()))


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


def _box(
    structure: AffineStructure, box: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], FloatArray, FloatArray]:
    for name in box:
        if name not in structure.parts:
            known = nearest(name, structure.parts) if structure.parts else "the structure has none"
            raise InputError(f"there is no parameter {name!r}: {known}")
    if not box:
        raise InputError("no parameter is to vary: name at least one with its range")
    for name, (low, high) in box.items():
        if not 0 < low < high < np.inf:
            raise InputError(f"{name!r} is to vary from {low:g} to {high:g}: give positive ends, the lower one first")
    low, high = np.array(list(box.values()), dtype=np.float64).T
    return tuple(box), low, high


def _spread(low: FloatArray, high: FloatArray) -> FloatArray:
    """Points over the box, evenly in the logarithm, its corners among them."""
    from scipy.stats import qmc

    inner = qmc.Sobol(low.size, scramble=False).random(N_CANDIDATES)
    corners = np.array(np.meshgrid(*[[0.0, 1.0]] * min(low.size, 6))).reshape(min(low.size, 6), -1).T
    corners = np.pad(corners, ((0, 0), (0, low.size - corners.shape[1])), constant_values=0.5)
    return low * (high / low) ** np.vstack([corners, inner])


def _at(given: Sequence[Any], theta: FloatArray) -> sparse.csr_matrix:
    return sparse.csr_matrix(given[1] + sum(value * part for value, part in zip(theta, given[2:], strict=True)))


def _inverse(given: Sequence[Any], theta: FloatArray) -> Any:
    """The inverse of the stiffness at theta as a function, a little shifted off rigid-body motion."""
    from scipy.sparse.linalg import splu

    mass, stiffness = given[0], _at(given, theta)
    shift = SHIFT * stiffness.diagonal().mean() / mass.diagonal().mean()
    return splu(sparse.csc_matrix(stiffness + shift * mass)).solve


def _model(
    structure: AffineStructure,
    given: Sequence[Any],
    basis: FloatArray,
    names: tuple[str, ...],
    count: int,
    worst: float,
) -> RitzModel:
    reduced = [basis.T @ (matrix @ basis) for matrix in given[1:]]
    stiffness, *parts = [(each + each.T) / 2 for each in reduced]
    at_sensors = basis[structure.sensor_indices]
    return RitzModel(stiffness, np.array(parts), at_sensors, names, structure.sensors, count, worst)


def _errors(
    model: RitzModel,
    given: Sequence[Any],
    basis: FloatArray,
    points: FloatArray,
    wanted: Any,
    solve: Any,
    middle: FloatArray,
) -> FloatArray:
    """(n_points,) estimated relative error of the worst wanted eigenvalue, r^T K^-1 r / lambda."""
    eigenvalue, vectors = np.linalg.eigh(model.stiffness + np.tensordot(points, model.parts, axes=1))
    images = [matrix @ basis for matrix in given]  # mass, base, parts
    errors = np.zeros(len(points))
    for row, theta in enumerate(points):
        value, vector = eigenvalue[row, wanted], vectors[row][:, wanted]
        stiff = images[1] + np.tensordot(theta, np.array(images[2:]), axes=1)
        residual = stiff @ vector - (images[0] @ vector) * value
        # K at theta is at least the smallest ratio times K at the middle
        size = np.einsum("ij,ij->j", residual, solve(residual)) / min(1.0, float(np.min(theta / middle)))
        errors[row] = np.max(size / np.maximum(value, 1e-300))
    return errors


def _extended(mass: Any, basis: FloatArray, shapes: FloatArray) -> FloatArray:
    """The basis with what of the shapes lies outside it, mass-orthonormal."""
    for shape in shapes.T:
        rest = shape
        for _ in range(2):  # once more against rounding
            rest = rest - basis @ (basis.T @ (mass @ rest))
        size = np.sqrt(rest @ (mass @ rest))
        if size > DEPENDENT:
            basis = np.column_stack([basis, rest / size])
    return basis
