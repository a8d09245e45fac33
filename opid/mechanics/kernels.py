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


_shape = _dispatch(
    tuple(kind.shape for kind in LAWS.values()), tuple(len(kind.parameters) - 1 for kind in LAWS.values())
)


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


# the stages of the classical Runge-Kutta method: place in half steps, weight, and step to the next stage
_STAGE_PLACE = (0, 1, 1, 2)
_STAGE_WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
_STAGE_STEP = (0.5, 0.5, 1.0, 0.0)


def _compiled(laws_digest: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return force_kernel and runge_kutta_4.

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

    return force_kernel, runge_kutta_4


force_kernel, runge_kutta_4 = _compiled(
    1 + int.from_bytes(hashlib.sha256(inspect.getsource(laws_module).encode()).digest()[:7])
)
