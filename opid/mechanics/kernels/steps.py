"""Forces of laws and sliders, and the time steps of a structure, compiled."""

from __future__ import annotations

import numpy as np

from opid.mechanics.kernels.choice import evaluate
from opid.mechanics.kernels.compilation import kernel, part


@part(inline=True)
def _force(codes, values, first, last, z, v):  # type: ignore[no-untyped-def]
    total = 0.0
    for row in range(first, last):
        shape = evaluate(codes[row], z + values[row, 3], v, values[row, 1], values[row, 2])[0]
        total += values[row, 0] * (shape - values[row, 4])
    return total


@part(inline=True, freedom="any order")
def _slider_force(sliders, first, last, positions, z):  # type: ignore[no-untyped-def]
    """Force of Jenkins elements; their sliders stand where they stood when the step began."""
    total = 0.0
    begin = max(0, first)
    for k in range(last - first):
        stretch, reach = z - positions[begin + k], sliders[1, begin + k]
        # written so that nan stays nan
        stretch = reach if stretch > reach else stretch
        stretch = -reach if stretch < -reach else stretch
        total += sliders[0, begin + k] * stretch
    return total


@part(inline=True)
def _move_sliders(joints, x, positions):  # type: ignore[no-untyped-def]
    """Drag along the sliders whose springs carry more than they can."""
    directions, spans, _, _, _, sliders = joints
    for joint in range(directions.shape[0]):
        begin, n = max(0, spans[joint, 4]), spans[joint, 5] - spans[joint, 4]
        if n == 0:
            continue
        z = _dot(directions, joint, spans[joint, 0], spans[joint, 1], x)
        for k in range(n):
            low, high = z - sliders[1, begin + k], z + sliders[1, begin + k]
            place = positions[begin + k]
            place = low if place < low else place
            positions[begin + k] = high if place > high else place


@part(inline=True, freedom="any order")
def _dot(matrix, row, first, last, x):  # type: ignore[no-untyped-def]
    total = 0.0
    # max, and counting from 0: the compiler then knows that no place counts from the end, and takes several at once
    begin = max(0, first)
    for k in range(last - first):
        total += matrix[row, begin + k] * x[begin + k]
    return total


@part(inline=True, freedom="any order")
def _dot_of_two(one, other, row, first, last, x, v):  # type: ignore[no-untyped-def]
    total = 0.0
    begin = max(0, first)
    for k in range(last - first):
        total += one[row, begin + k] * x[begin + k] + other[row, begin + k] * v[begin + k]
    return total


@part(inline=True)
def _drive(inputs, spans, forces, half_step, out):  # type: ignore[no-untyped-def]
    """out = inputs forces, at one half step."""
    for i in range(out.size):
        total = 0.0
        for k in range(spans[i, 2], spans[i, 3]):
            total += inputs[i, k] * forces[half_step, k]
        out[i] = total


@part(inline=True)
def _accelerate(matrices, joints, drive, positions, x, v, out):  # type: ignore[no-untyped-def]
    """out = drive - stiffness x - damping v - sum_j loads_j (K_j z + C_j w + f_j(z, w) + sliders_j), z = d_j x.

    Of each row of a matrix only what lies between its first and its last nonzero (`spans`) is taken.
    """
    stiffness, damping, spans, _ = matrices
    for i in range(x.size):
        out[i] = drive[i] - _dot_of_two(stiffness, damping, i, spans[i, 0], spans[i, 1], x, v)
    directions, joint_spans, linear, loads, law_table, sliders = joints
    codes, values = law_table
    for j in range(directions.shape[0]):
        z = _dot(directions, j, joint_spans[j, 0], joint_spans[j, 1], x)
        w = _dot(directions, j, joint_spans[j, 0], joint_spans[j, 1], v)
        force = linear[j, 0] * z + linear[j, 1] * w
        force += _force(codes, values, joint_spans[j, 6], joint_spans[j, 7], z, w)
        force += _slider_force(sliders, joint_spans[j, 4], joint_spans[j, 5], positions, z)
        begin = max(0, joint_spans[j, 2])
        for i in range(joint_spans[j, 3] - joint_spans[j, 2]):
            out[begin + i] -= loads[j, begin + i] * force


@kernel()
def _force_many(codes, values, z, v):  # type: ignore[no-untyped-def]
    force = np.empty(z.size)
    for k in range(force.size):
        force[k] = _force(codes, values, 0, codes.size, z[k], v[k])
    return force


# the stages of the classical Runge-Kutta method: place in half steps, weight, and step to the next stage
_STAGE_PLACE = (0, 1, 1, 2)
_STAGE_WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
_STAGE_STEP = (0.5, 0.5, 1.0, 0.0)


@kernel()
def _structure_steps(matrices, joints, forces, step_s, steps_per_sample, x0, v0, positions0):  # type: ignore[no-untyped-def]
    n_steps = forces.shape[0] // 2
    n_samples = n_steps // steps_per_sample + 1
    displacement = np.empty((n_samples, x0.size))
    velocity = np.empty((n_samples, x0.size))
    acceleration = np.empty((n_samples, x0.size))
    positions = positions0.copy()
    x, v, a, drive = x0.copy(), v0.copy(), np.empty(x0.size), np.empty(x0.size)
    x_begin, v_begin, x_next, v_next = x0.copy(), v0.copy(), np.empty(x0.size), np.empty(x0.size)
    _, _, spans, inputs = matrices
    _drive(inputs, spans, forces, 0, drive)
    _move_sliders(joints, x, positions)
    for step in range(n_steps + 1):
        for i in range(x0.size):
            x_begin[i] = x_next[i] = x[i]
            v_begin[i] = v_next[i] = v[i]
        sample = step // steps_per_sample
        # the last sample takes no step, it only needs its acceleration
        for stage in range(4 if step < n_steps else 1):
            if stage == 1 or stage == 3:
                _drive(inputs, spans, forces, 2 * step + _STAGE_PLACE[stage], drive)
            _accelerate(matrices, joints, drive, positions, x, v, a)
            if stage == 0 and sample * steps_per_sample == step:
                for i in range(x0.size):
                    displacement[sample, i], velocity[sample, i], acceleration[sample, i] = x[i], v[i], a[i]
            for i in range(x0.size):
                x_next[i] += _STAGE_WEIGHT[stage] * step_s * v[i]
                v_next[i] += _STAGE_WEIGHT[stage] * step_s * a[i]
                x[i] = x_begin[i] + _STAGE_STEP[stage] * step_s * v[i]
                v[i] = v_begin[i] + _STAGE_STEP[stage] * step_s * a[i]
        if step < n_steps:
            for i in range(x0.size):
                x[i] = x_next[i]
                v[i] = v_next[i]
            _move_sliders(joints, x, positions)
    return displacement, velocity, acceleration, positions


@part(inline=True)
def _joint_force(joints, i, place, stage, z, v, x, by_own):  # type: ignore[no-untyped-def]
    """Force of joint i, k z + c v + f(z, v) + g x, and its slopes by z and v.

    Its derivatives by its own parameters (k, c, g, where its law rests, the law's own) go to by_own[stage] from `place`
    on; the place after them is returned, too.
    """
    linear, firsts, codes, n_inner, values = joints
    k, c, g = linear[i, 0], linear[i, 1], linear[i, 2]
    total, slope_z, slope_v = k * z + c * v + g * x, k, c
    by_own[stage, place], by_own[stage, place + 1], by_own[stage, place + 2] = z, v, x
    by_rest = place + 3
    by_own[stage, by_rest] = 0.0
    place += 4
    for row in range(firsts[i], firsts[i + 1]):
        amplitude = values[row, 0]
        shape, shape_z, shape_v, first, second = evaluate(
            codes[row], z + values[row, 3], v, values[row, 1], values[row, 2]
        )
        shape -= values[row, 4]
        total += amplitude * shape
        slope_z += amplitude * shape_z
        slope_v += amplitude * shape_v
        by_own[stage, by_rest] += amplitude * (shape_z - values[row, 5])
        by_own[stage, place] = shape
        if n_inner[row] > 0:
            by_own[stage, place + 1] = amplitude * (first - values[row, 6])
        if n_inner[row] > 1:
            by_own[stage, place + 2] = amplitude * (second - values[row, 7])
        place += 1 + n_inner[row]
    return total, slope_z, slope_v, place


@part(inline=False)
def _places(joints):  # type: ignore[no-untyped-def]
    """Where the own parameters of each interface begin (k, c, g, where its law rests, and those of the law)."""
    _, firsts, _, n_inner, _ = joints
    owns = np.zeros(firsts.size, np.int64)
    for i in range(firsts.size - 1):
        owns[i + 1] = owns[i] + 4
        for row in range(firsts[i], firsts[i + 1]):
            owns[i + 1] += 1 + n_inner[row]
    return owns
