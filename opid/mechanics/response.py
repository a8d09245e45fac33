"""The time response of a structure to a force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from opid.errors import InputError
from opid.mechanics.kernels import law_arrays, runge_kutta_4
from opid.mechanics.laws import FloatArray
from opid.mechanics.structure import Structure, linear_matrices


@dataclass(frozen=True, eq=False)
class Response:
    """Motion of a structure at a uniform rate.

    Attributes:
        time_s: (n,) time, s.
        displacement: (n, n_dof), m.
        velocity: (n, n_dof), m/s.
        acceleration: (n, n_dof), m/s^2.
        fs: sampling rate, Hz.
    """

    time_s: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    fs: float


def time_response(
    structure: Structure,
    force: Callable[[FloatArray], ArrayLike] | ArrayLike,
    *,
    fs: float,
    duration_s: float,
    initial_displacement: ArrayLike | None = None,
    initial_velocity: ArrayLike | None = None,
) -> Response:
    """Return the motion of a structure under a force, by the classical Runge-Kutta method of order 4.

    One step a sample: take fs a hundred times the highest frequency that matters, 4096 Hz for a landing gear.

    Args:
        structure: the structure with its nonlinear joints.
        force: function of time (m,) s that gives forces (m, n_dof) N; or these forces at half steps,
            t = k/(2 fs) for k = 0 ... 2 (n - 1).
        fs: steps and samples a second, Hz.
        duration_s: n = round(fs duration_s) samples are returned, the first at time 0.
        initial_displacement: (n_dof,) m; zero where left out.
        initial_velocity: (n_dof,) m/s; zero where left out.

    Raises:
        InputError: a force of the wrong shape or not finite, or a response that grows without bound.

    >>> swing = Structure([[1.0]], [[0.0]], [[(2.0 * np.pi) ** 2]])
    >>> motion = time_response(swing, lambda t: np.zeros((t.size, 1)), fs=1000.0, duration_s=1.0,
    ...                        initial_displacement=[1.0])
    >>> motion.displacement[500].round(6)
    array([-1.])
    """
    if not (fs > 0.0 and np.isfinite(fs) and np.isfinite(duration_s)):
        raise InputError(f"fs is {fs} Hz and the duration {duration_s} s: give positive numbers")
    n_samples = round(fs * duration_s)
    if n_samples < 2:
        raise InputError(f"{duration_s} s at {fs} Hz make {n_samples} sample(s): at least two are needed")
    forces = _half_step_forces(force, 2 * n_samples - 1, structure.n_dof, fs)
    x0 = _state("initial_displacement", initial_displacement, structure.n_dof)
    v0 = _state("initial_velocity", initial_velocity, structure.n_dof)
    displacement, velocity, acceleration = runge_kutta_4(*_per_unit_mass(structure, forces), 1.0 / fs, x0, v0)
    _check_bounded(acceleration, fs)
    return Response(np.arange(n_samples) / fs, displacement, velocity, acceleration, float(fs))


def _per_unit_mass(structure: Structure, forces: FloatArray) -> tuple[tuple[np.ndarray, ...], FloatArray]:
    """Return the system and the drive as the kernel takes them, everything multiplied by M^-1."""
    mass, damping, stiffness = linear_matrices(structure)
    inverse = np.linalg.inv(mass)
    joints = [joint for joint in structure.joints if joint.law.terms]
    directions = np.array([joint.direction for joint in joints]).reshape(len(joints), structure.n_dof)
    table = law_arrays(*(joint.law for joint in joints))
    system = (inverse @ stiffness, inverse @ damping, directions, directions @ inverse, *table)
    # not forces @ inverse: BLAS threads can take a hundred times longer over so long and narrow an array
    return system, np.einsum("ti,ij->tj", forces, inverse)


def _half_step_forces(
    force: Callable[[FloatArray], ArrayLike] | ArrayLike, n_half_steps: int, n_dof: int, fs: float
) -> FloatArray:
    given = force(np.arange(n_half_steps) / (2.0 * fs)) if callable(force) else force
    forces = np.asarray(given, dtype=np.float64)
    if forces.shape != (n_half_steps, n_dof):
        raise InputError(
            f"the force has shape {forces.shape}: give {(n_half_steps, n_dof)}, "
            "one row for each half step and one column for each degree of freedom"
        )
    if not np.isfinite(forces).all():
        raise InputError("the force has values that are not finite: mend it before it drives a structure")
    return forces


def _state(name: str, given: ArrayLike | None, n_dof: int) -> FloatArray:
    state = np.zeros(n_dof) if given is None else np.array(given, dtype=np.float64)
    if state.shape != (n_dof,) or not np.isfinite(state).all():
        raise InputError(f"{name} is {given!r}: give {n_dof} finite number(s), one a degree of freedom")
    return state


def _check_bounded(acceleration: FloatArray, fs: float) -> None:
    unbounded = ~np.isfinite(acceleration).all(axis=1)
    if unbounded.any():
        raise InputError(
            f"the response grows without bound and overflows at {np.argmax(unbounded) / fs:g} s: "
            f"take fs above {fs:g} Hz, or look for negative stiffness or damping"
        )
