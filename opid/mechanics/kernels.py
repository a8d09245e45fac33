"""The compiled part of mechanics: the laws on single numbers and the time step, by numba."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from opid.mechanics import laws as laws_module
from opid.mechanics.laws import LAWS, FloatArray, Law

_CODES = {name: code for code, name in enumerate(LAWS)}
_N_VALUES = max(len(kind.parameters) for kind in LAWS.values())


def law_arrays(*laws: Law) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Return laws as the compiled functions take them: one table with the terms of all.

    Returns:
        The row at which each law begins and, at the end, the number of rows, (n_laws + 1,);
        the code of each term, (n_terms,); its values, (n_terms, n_max), filled up with ones.

    >>> from opid.mechanics.laws import default_law
    >>> law_arrays(default_law("arctan_velocity"))
    (array([0, 1]), array([0]), array([[4.e+02, 2.e-02, 1.e+00]]))
    """
    terms = [term for law in laws for term in law.terms]
    firsts = np.cumsum([0, *(len(law.terms) for law in laws)], dtype=np.int64)
    codes = np.array([_CODES[term.name] for term in terms], dtype=np.int64)
    values = np.ones((len(terms), _N_VALUES))
    for row, term in zip(values, terms, strict=True):
        row[: len(term.values)] = term.values
    return firsts, codes, values


def _dispatch(functions: tuple[Callable[..., Any], ...], n_inner: tuple[int, ...]) -> Callable[..., Any]:
    """Return a compiled (code, z, v, values, row) -> functions[code](z, v, *inner), a chain of ifs.

    The inner parameters are values[row, 1:]; views of the row would cost more than the force itself.
    """

    def one_more(otherwise: Callable[..., Any], place: int) -> Callable[..., Any]:
        function = njit(functions[place], error_model="numpy")

        # one body for each number of inner parameters: a compiled call cannot spread an array over arguments
        @njit(error_model="numpy")
        def with_none(code, z, v, values, row):  # type: ignore[no-untyped-def]
            return function(z, v) if code == place else otherwise(code, z, v, values, row)

        @njit(error_model="numpy")
        def with_one(code, z, v, values, row):  # type: ignore[no-untyped-def]
            return function(z, v, values[row, 1]) if code == place else otherwise(code, z, v, values, row)

        @njit(error_model="numpy")
        def with_two(code, z, v, values, row):  # type: ignore[no-untyped-def]
            if code == place:
                return function(z, v, values[row, 1], values[row, 2])
            return otherwise(code, z, v, values, row)

        return (with_none, with_one, with_two)[n_inner[place]]

    @njit(error_model="numpy")
    def unknown(code, z, v, values, row):  # type: ignore[no-untyped-def]
        return np.nan

    chain: Callable[..., Any] = unknown
    for place in range(len(functions)):
        chain = one_more(chain, place)
    return chain


_N_INNER = tuple(len(kind.parameters) - 1 for kind in LAWS.values())
_shape = _dispatch(tuple(kind.shape for kind in LAWS.values()), _N_INNER)


@njit(error_model="numpy")
def _force(codes, values, first, last, z, v):  # type: ignore[no-untyped-def]
    total = 0.0
    for row in range(first, last):
        total += values[row, 0] * _shape(codes[row], z, v, values, row)
    return total


# inlined: as a call, with its seven arrays, it takes longer than what it computes
@njit(error_model="numpy", inline="always")
def _accelerate(system, drive, half_step, x, v, out):  # type: ignore[no-untyped-def]
    """out = drive - stiffness x - damping v - sum_j loads_j f_j(directions_j x, directions_j v)."""
    stiffness, damping, directions, loads, firsts, codes, values = system
    for i in range(x.size):
        out[i] = drive[half_step, i]
        for k in range(x.size):
            out[i] -= stiffness[i, k] * x[k] + damping[i, k] * v[k]
    for joint in range(directions.shape[0]):
        extension = 0.0
        rate = 0.0
        for k in range(x.size):
            extension += directions[joint, k] * x[k]
            rate += directions[joint, k] * v[k]
        force = _force(codes, values, firsts[joint], firsts[joint + 1], extension, rate)
        for i in range(x.size):
            out[i] -= loads[joint, i] * force


def _padded(place: int) -> tuple[Callable[..., Any], ...]:
    """Return the derivative by inner parameter `place` of every kind, zero where a kind has none."""
    zero = (lambda z, v: 0.0, lambda z, v, a: 0.0, lambda z, v, a, b: 0.0)
    return tuple(
        kind.by_inner[place] if place < len(kind.by_inner) else zero[len(kind.parameters) - 1] for kind in LAWS.values()
    )


_by_z = _dispatch(tuple(kind.by_z for kind in LAWS.values()), _N_INNER)
_by_v = _dispatch(tuple(kind.by_v for kind in LAWS.values()), _N_INNER)
_by_first = _dispatch(_padded(0), _N_INNER)
_by_second = _dispatch(_padded(1), _N_INNER)


# inlined for the same reason as _accelerate
@njit(error_model="numpy", inline="always")
def _joint_forces(joints, z, v, x, force, slopes, by_parameter):  # type: ignore[no-untyped-def]
    """Force of each joint k z + c v + f(z, v) + g x, its slopes by z and v, its derivatives by its own parameters."""
    linear, firsts, codes, n_inner, values = joints
    place = 0
    for joint in range(z.size):
        k, c, g = linear[joint, 0], linear[joint, 1], linear[joint, 2]
        force[joint] = k * z[joint] + c * v[joint] + g * x[joint]
        slopes[joint, 0], slopes[joint, 1] = k, c
        by_parameter[place], by_parameter[place + 1], by_parameter[place + 2] = z[joint], v[joint], x[joint]
        place += 3
        for row in range(firsts[joint], firsts[joint + 1]):
            amplitude, code = values[row, 0], codes[row]
            shape = _shape(code, z[joint], v[joint], values, row)
            force[joint] += amplitude * shape
            slopes[joint, 0] += amplitude * _by_z(code, z[joint], v[joint], values, row)
            slopes[joint, 1] += amplitude * _by_v(code, z[joint], v[joint], values, row)
            by_parameter[place] = shape
            place += 1
            if n_inner[row] > 0:
                by_parameter[place] = amplitude * _by_first(code, z[joint], v[joint], values, row)
                place += 1
            if n_inner[row] > 1:
                by_parameter[place] = amplitude * _by_second(code, z[joint], v[joint], values, row)
                place += 1


# the stages of the classical Runge-Kutta method: place in half steps, weight, and step to the next stage
_STAGE_PLACE = (0, 1, 1, 2)
_STAGE_WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
_STAGE_STEP = (0.5, 0.5, 1.0, 0.0)


def _compiled(laws_digest: int) -> tuple[Callable[..., Any], ...]:
    """Return force_kernel, runge_kutta_4 and driven_runge_kutta_4.

    numba renews its cache when this file changes, but not when laws.py does, whose functions are compiled in.
    It does compare closure variables: the digest of laws.py (never 0), carried as one, renews the cache.
    """

    @njit(cache=True, error_model="numpy")
    def force_kernel(codes, values, z, v):  # type: ignore[no-untyped-def]
        force = np.empty(z.size if laws_digest else 0)
        for k in range(force.size):
            force[k] = _force(codes, values, 0, codes.size, z[k], v[k])
        return force

    @njit(cache=True, error_model="numpy")
    def runge_kutta_4(system, drive, step_s, x0, v0):  # type: ignore[no-untyped-def]
        n_steps = drive.shape[0] // 2 if laws_digest else 0
        displacement = np.empty((n_steps + 1, x0.size))
        velocity = np.empty((n_steps + 1, x0.size))
        acceleration = np.empty((n_steps + 1, x0.size))
        x, v, a = x0.copy(), v0.copy(), np.empty(x0.size)
        x_next, v_next = np.empty(x0.size), np.empty(x0.size)
        for step in range(n_steps + 1):
            for i in range(x0.size):
                displacement[step, i] = x_next[i] = x[i]
                velocity[step, i] = v_next[i] = v[i]
            # the last sample takes no step, it only needs its acceleration
            for stage in range(4 if step < n_steps else 1):
                _accelerate(system, drive, 2 * step + _STAGE_PLACE[stage], x, v, a)
                for i in range(x0.size):
                    if stage == 0:
                        acceleration[step, i] = a[i]
                    x_next[i] += _STAGE_WEIGHT[stage] * step_s * v[i]
                    v_next[i] += _STAGE_WEIGHT[stage] * step_s * a[i]
                    x[i] = displacement[step, i] + _STAGE_STEP[stage] * step_s * v[i]
                    v[i] = velocity[step, i] + _STAGE_STEP[stage] * step_s * a[i]
            for i in range(x0.size):
                x[i] = x_next[i]
                v[i] = v_next[i]
        return displacement, velocity, acceleration

    @njit(cache=True, error_model="numpy")
    def driven_runge_kutta_4(joints, accelerance, by_mass, drive, by_drive, step_s, start):  # type: ignore[no-untyped-def]
        """Interfaces driven by measured accelerations, with the derivatives of what they answer.

        b = -A F(z, v, x), v' = b - u, w' = b, z' = v, x' = w; parameters: those of the joints, the directions of A,
        the directions of u, the start z, v, x, w. Differentiating each stage gives the exact derivative of the steps.
        """
        n = drive.shape[1]
        n_samples = drive.shape[0] // 2 + 1 if laws_digest else 0
        n_joint = 3 * n
        for row in range(joints[2].size):
            n_joint += 1 + joints[3][row]
        n_mass, n_drive = by_mass.shape[0], by_drive.shape[1]
        n_parameters = n_joint + n_mass + n_drive + 4 * n
        # rows of the state: z, v, x, w; of its derivatives likewise, one column a parameter
        state, here, following = start.copy(), start.copy(), start.copy()
        by = np.zeros((4, n, n_parameters))
        for row in range(4):
            for i in range(n):
                by[row, i, n_parameters - (4 - row) * n + i] = 1.0
        by_here, by_following = by.copy(), by.copy()
        force, slopes, by_parameter = np.zeros(n), np.zeros((n, 2)), np.zeros(n_joint)
        body, by_force, by_body = np.zeros(n), np.zeros((n, n_parameters)), np.zeros((n, n_parameters))
        by_relative = np.zeros(n_parameters)
        motion, answer = np.empty((n_samples, 2, n)), np.empty((n_samples, n))
        by_answer = np.empty((n_samples, n, n_parameters))
        for step in range(n_samples):
            for stage in range(4 if step < n_samples - 1 else 1):
                half_step = 2 * step + _STAGE_PLACE[stage]
                _joint_forces(joints, here[0], here[1], here[2], force, slopes, by_parameter)
                place = 0
                for i in range(n):
                    by_z, by_v, by_x = slopes[i, 0], slopes[i, 1], joints[0][i, 2]
                    for p in range(n_parameters):
                        by_force[i, p] = by_z * by_here[0, i, p] + by_v * by_here[1, i, p] + by_x * by_here[2, i, p]
                    n_own = 3
                    for row in range(joints[1][i], joints[1][i + 1]):
                        n_own += 1 + joints[3][row]
                    for _ in range(n_own):
                        by_force[i, place] += by_parameter[place]
                        place += 1
                for i in range(n):
                    body[i] = 0.0
                    for p in range(n_parameters):
                        by_body[i, p] = 0.0
                    for k in range(n):
                        share = accelerance[i, k]
                        body[i] -= share * force[k]
                        for p in range(n_parameters):
                            by_body[i, p] -= share * by_force[k, p]
                        for m in range(n_mass):
                            by_body[i, n_joint + m] -= by_mass[m, i, k] * force[k]
                if stage == 0:
                    for i in range(n):
                        motion[step, 0, i], motion[step, 1, i], answer[step, i] = here[0, i], here[1, i], body[i]
                        for p in range(n_parameters):
                            by_answer[step, i, p] = by_body[i, p]
                weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
                for i in range(n):
                    relative = body[i] - drive[half_step, i]
                    for p in range(n_parameters):
                        by_relative[p] = by_body[i, p]
                    for d in range(n_drive):
                        by_relative[n_joint + n_mass + d] -= by_drive[half_step, d, i]
                    # z before v and x before w: the rate of the first is the second, as it stands at this stage
                    following[0, i] += weight * here[1, i]
                    here[0, i] = state[0, i] + ahead * here[1, i]
                    following[1, i] += weight * relative
                    here[1, i] = state[1, i] + ahead * relative
                    following[2, i] += weight * here[3, i]
                    here[2, i] = state[2, i] + ahead * here[3, i]
                    following[3, i] += weight * body[i]
                    here[3, i] = state[3, i] + ahead * body[i]
                    for p in range(n_parameters):
                        by_following[0, i, p] += weight * by_here[1, i, p]
                        by_here[0, i, p] = by[0, i, p] + ahead * by_here[1, i, p]
                        by_following[1, i, p] += weight * by_relative[p]
                        by_here[1, i, p] = by[1, i, p] + ahead * by_relative[p]
                    for p in range(n_parameters):
                        by_following[2, i, p] += weight * by_here[3, i, p]
                        by_here[2, i, p] = by[2, i, p] + ahead * by_here[3, i, p]
                        by_following[3, i, p] += weight * by_body[i, p]
                        by_here[3, i, p] = by[3, i, p] + ahead * by_body[i, p]
            for row in range(4):
                for i in range(n):
                    state[row, i] = here[row, i] = following[row, i]
                    for p in range(n_parameters):
                        by[row, i, p] = by_here[row, i, p] = by_following[row, i, p]
        return motion, answer, by_answer

    return force_kernel, runge_kutta_4, driven_runge_kutta_4


force_kernel, runge_kutta_4, driven_runge_kutta_4 = _compiled(
    1 + int.from_bytes(hashlib.sha256(inspect.getsource(laws_module).encode()).digest()[:7])
)
