"""The time steps as plain functions of numbers and arrays, for `opid.mechanics.kernels` to compile.

Nothing here is called as it stands: `_evaluate` is the choice among the kinds of law, which the compiler puts in.
"""

from __future__ import annotations

import numpy as np


def _evaluate(code, z, v, a, b):  # type: ignore[no-untyped-def]
    """Stands for what `_evaluation` returns."""
    raise NotImplementedError


def _force(codes, values, first, last, z, v):  # type: ignore[no-untyped-def]
    total = 0.0
    for row in range(first, last):
        total += values[row, 0] * _evaluate(codes[row], z, v, values[row, 1], values[row, 2])[0]
    return total


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


def _force_many(codes, values, z, v):  # type: ignore[no-untyped-def]
    force = np.empty(z.size)
    for k in range(force.size):
        force[k] = _force(codes, values, 0, codes.size, z[k], v[k])
    return force


# the stages of the classical Runge-Kutta method: place in half steps, weight, and step to the next stage
_STAGE_PLACE = (0, 1, 1, 2)
_STAGE_WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
_STAGE_STEP = (0.5, 0.5, 1.0, 0.0)


def _structure_steps(system, drive, step_s, x0, v0):  # type: ignore[no-untyped-def]
    n_steps = drive.shape[0] // 2
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


def _joint_force(joints, i, place, stage, z, v, x, by_own):  # type: ignore[no-untyped-def]
    """Force of joint i, k z + c v + f(z, v) + g x, and its slopes by z and v.

    Its derivatives by its own parameters go to by_own[stage] from `place` on; the place after them is returned, too.
    """
    linear, firsts, codes, n_inner, values = joints
    k, c, g = linear[i, 0], linear[i, 1], linear[i, 2]
    total, slope_z, slope_v = k * z + c * v + g * x, k, c
    by_own[stage, place], by_own[stage, place + 1], by_own[stage, place + 2] = z, v, x
    place += 3
    for row in range(firsts[i], firsts[i + 1]):
        amplitude = values[row, 0]
        shape, shape_z, shape_v, first, second = _evaluate(codes[row], z, v, values[row, 1], values[row, 2])
        total += amplitude * shape
        slope_z += amplitude * shape_z
        slope_v += amplitude * shape_v
        by_own[stage, place] = shape
        if n_inner[row] > 0:
            by_own[stage, place + 1] = amplitude * first
        if n_inner[row] > 1:
            by_own[stage, place + 2] = amplitude * second
        place += 1 + n_inner[row]
    return total, slope_z, slope_v, place


def _places(joints):  # type: ignore[no-untyped-def]
    """Where the own parameters of each interface begin (k, c, g and those of its law)."""
    _, firsts, _, n_inner, _ = joints
    owns = np.zeros(firsts.size, np.int64)
    for i in range(firsts.size - 1):
        owns[i + 1] = owns[i] + 3
        for row in range(firsts[i], firsts[i + 1]):
            owns[i + 1] += 1 + n_inner[row]
    return owns
