"""Forces of laws and sliders, and the time steps of a structure, compiled."""

from __future__ import annotations

import numpy as np

from opid.mechanics.kernels.compilation import evaluate, evolve, kernel, part


@part(inline=True)
def _compute_force(codes, values, first, last, z, v):  # type: ignore[no-untyped-def]
    total = 0.0
    for row in range(first, last):
        shape = evaluate(codes[row], z + values[row, 3], v, values[row, 1], values[row, 2])[0]
        total += values[row, 0] * (shape - values[row, 4])
    return total


@part(inline=True)
def _compute_force_with_memory(law_table, first, last, z, v, memory, rates):  # type: ignore[no-untyped-def]
    """Return the force of a law and the decay of its quickest memory, 1/s; the rates of memories go to `rates`."""
    codes, values, memories, elements = law_table
    total, quickest = 0.0, 0.0
    for row in range(first, last):
        begin, count = memories[row, 0], memories[row, 1]
        if count == 0:
            total += _compute_force(codes, values, row, row + 1, z, v)
        for q in range(begin, begin + count):
            h = _confine(memory[q], elements[q, 1])
            rate, by_h, _, _, _, _ = evolve(
                codes[row], h, v, values[row, 1], values[row, 2], values[row, 9], elements[q, 0]
            )
            total += values[row, 0] * elements[q, 6] * (h + values[row, 8] * rate)
            rates[q], quickest = rate, max(quickest, np.abs(by_h))
    return total, quickest


@part(inline=True)
def _confine(h, limit):  # type: ignore[no-untyped-def]
    # These comparisons leave nan as nan.
    h = limit if h > limit else h
    return -limit if h < -limit else h


@part(inline=True, freedom="any order")
def _compute_slider_force(sliders, first, last, positions, z):  # type: ignore[no-untyped-def]
    """Return the force of Jenkins elements, whose sliders do not move within a step."""
    total = 0.0
    begin = max(0, first)
    for k in range(last - first):
        stretch, reach = z - positions[begin + k], sliders[1, begin + k]
        total += sliders[0, begin + k] * _confine(stretch, reach)
    return total


@part(inline=True)
def _move_sliders(joints, x, positions):  # type: ignore[no-untyped-def]
    """Drag along the sliders whose springs would carry more than the slip force."""
    directions, spans, _, _, _, sliders = joints
    for joint in range(directions.shape[0]):
        begin, n = max(0, spans[joint, 4]), spans[joint, 5] - spans[joint, 4]
        if n == 0:
            continue
        z = _multiply(directions, joint, spans[joint, 0], spans[joint, 1], x)
        for k in range(n):
            low, high = z - sliders[1, begin + k], z + sliders[1, begin + k]
            position = positions[begin + k]
            position = low if position < low else position
            positions[begin + k] = high if position > high else position


@part(inline=True, freedom="any order")
def _multiply(matrix, row, first, last, x):  # type: ignore[no-untyped-def]
    total = 0.0
    # Counting from 0 and max show the compiler that no index is negative, so that it takes several numbers at once.
    begin = max(0, first)
    for k in range(last - first):
        total += matrix[row, begin + k] * x[begin + k]
    return total


@part(inline=True, freedom="any order")
def _multiply_two(one, other, row, first, last, x, v):  # type: ignore[no-untyped-def]
    total = 0.0
    begin = max(0, first)
    for k in range(last - first):
        total += one[row, begin + k] * x[begin + k] + other[row, begin + k] * v[begin + k]
    return total


@part(inline=True)
def _drive(inputs, spans, forces, half_step, out):  # type: ignore[no-untyped-def]
    """Compute out = inputs forces at one half step."""
    for i in range(out.size):
        total = 0.0
        for k in range(spans[i, 2], spans[i, 3]):
            total += inputs[i, k] * forces[half_step, k]
        out[i] = total


@part(inline=True)
def _accelerate(matrices, joints, drive, positions, memory, x, v, out, rates):  # type: ignore[no-untyped-def]
    """Compute out = drive - stiffness x - damping v - sum_j loads_j (K_j z + C_j w + f_j(z, w) + sliders_j), z = d_j x.

    Each row of a matrix counts only between its first and its last nonzero (`spans`). The rates of memories go to
    `rates`, and the decay of the quickest one is returned.
    """
    quickest = 0.0
    stiffness, damping, spans, _ = matrices
    for i in range(x.size):
        out[i] = drive[i] - _multiply_two(stiffness, damping, i, spans[i, 0], spans[i, 1], x, v)
    directions, joint_spans, linear, loads, law_table, sliders = joints
    for j in range(directions.shape[0]):
        z = _multiply(directions, j, joint_spans[j, 0], joint_spans[j, 1], x)
        w = _multiply(directions, j, joint_spans[j, 0], joint_spans[j, 1], v)
        force = linear[j, 0] * z + linear[j, 1] * w
        of_law, decay = _compute_force_with_memory(law_table, joint_spans[j, 6], joint_spans[j, 7], z, w, memory, rates)
        force += of_law
        quickest = max(quickest, decay)
        force += _compute_slider_force(sliders, joint_spans[j, 4], joint_spans[j, 5], positions, z)
        begin = max(0, joint_spans[j, 2])
        for i in range(joint_spans[j, 3] - joint_spans[j, 2]):
            out[begin + i] -= loads[j, begin + i] * force
    return quickest


# stages of the classical Runge-Kutta method: position in half steps, weight, and step to the next stage
_STAGE_PLACE = (0, 1, 1, 2)
_STAGE_WEIGHT = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)
_STAGE_STEP = (0.5, 0.5, 1.0, 0.0)


@kernel()
def structure_steps(matrices, joints, forces, step_s, steps_per_sample, x0, v0, positions0, memory0):  # type: ignore[no-untyped-def]
    """Return displacement, velocity and acceleration at each sample, (n, n_dof) each, and the state after the last.

    `matrices` and `joints` are those of `opid.mechanics.response.Assembled`, `forces` stand at half steps. The state
    is the sliders' positions and what the laws remember; the last value is how fast the quickest memory decayed, 1/s.
    """
    n_steps = forces.shape[0] // 2
    n_samples = n_steps // steps_per_sample + 1
    displacement = np.empty((n_samples, x0.size))
    velocity = np.empty((n_samples, x0.size))
    acceleration = np.empty((n_samples, x0.size))
    positions, quickest = positions0.copy(), 0.0
    memory, h_begin, h_next, rates = memory0.copy(), memory0.copy(), memory0.copy(), np.zeros(memory0.size)
    x, v, a, drive = x0.copy(), v0.copy(), np.empty(x0.size), np.empty(x0.size)
    x_begin, v_begin, x_next, v_next = x0.copy(), v0.copy(), np.empty(x0.size), np.empty(x0.size)
    _, _, spans, inputs = matrices
    law_table = joints[4]
    _drive(inputs, spans, forces, 0, drive)
    _move_sliders(joints, x, positions)
    for step in range(n_steps + 1):
        for i in range(x0.size):
            x_begin[i] = x_next[i] = x[i]
            v_begin[i] = v_next[i] = v[i]
        for q in range(memory.size):
            h_begin[q] = h_next[q] = memory[q]
        sample = step // steps_per_sample
        # The last sample takes no step and only needs its acceleration.
        for stage in range(4 if step < n_steps else 1):
            if stage == 1 or stage == 3:
                _drive(inputs, spans, forces, 2 * step + _STAGE_PLACE[stage], drive)
            decay = _accelerate(matrices, joints, drive, positions, memory, x, v, a, rates)
            quickest = max(quickest, decay)
            if stage == 0 and sample * steps_per_sample == step:
                for i in range(x0.size):
                    displacement[sample, i], velocity[sample, i], acceleration[sample, i] = x[i], v[i], a[i]
            for i in range(x0.size):
                x_next[i] += _STAGE_WEIGHT[stage] * step_s * v[i]
                v_next[i] += _STAGE_WEIGHT[stage] * step_s * a[i]
                x[i] = x_begin[i] + _STAGE_STEP[stage] * step_s * v[i]
                v[i] = v_begin[i] + _STAGE_STEP[stage] * step_s * a[i]
            for q in range(memory.size):
                h_next[q] += _STAGE_WEIGHT[stage] * step_s * rates[q]
                memory[q] = h_begin[q] + _STAGE_STEP[stage] * step_s * rates[q]
        if step < n_steps:
            for i in range(x0.size):
                x[i] = x_next[i]
                v[i] = v_next[i]
            for q in range(memory.size):
                memory[q] = _confine(h_next[q], law_table[3][q, 1])
            _move_sliders(joints, x, positions)
        else:
            for q in range(memory.size):
                memory[q] = h_begin[q]
    return displacement, velocity, acceleration, positions, memory, quickest


@part(inline=True)
def _compute_joint_force(joints, i, column, stage, z, v, x, by_own):  # type: ignore[no-untyped-def]
    """Return the force of joint i without its terms with memory, k z + c v + f(z, v) + g x, and its slopes by z and v.

    Its derivatives by its own parameters (k, c, g, rest position, those of the law) go to by_own[stage] from
    `column` on.
    """
    linear, firsts, codes, n_inner, values, memories, _, _ = joints
    k, c, g = linear[i, 0], linear[i, 1], linear[i, 2]
    total, slope_z, slope_v = k * z + c * v + g * x, k, c
    by_own[stage, column], by_own[stage, column + 1], by_own[stage, column + 2] = z, v, x
    by_rest = column + 3
    by_own[stage, by_rest] = 0.0
    column += 4
    for row in range(firsts[i], firsts[i + 1]):
        if memories[row, 1] == 0:
            amplitude = values[row, 0]
            shape, shape_z, shape_v, first, second = evaluate(
                codes[row], z + values[row, 3], v, values[row, 1], values[row, 2]
            )
            shape -= values[row, 4]
            total += amplitude * shape
            slope_z += amplitude * shape_z
            slope_v += amplitude * shape_v
            by_own[stage, by_rest] += amplitude * (shape_z - values[row, 5] + values[row, 11] * shape)
            by_own[stage, column] = values[row, 10] * shape
            if n_inner[row] > 0:
                by_own[stage, column + 1] = amplitude * (first - values[row, 6] + values[row, 12] * shape)
            if n_inner[row] > 1:
                by_own[stage, column + 2] = amplitude * (second - values[row, 7] + values[row, 13] * shape)
        column += 1 + n_inner[row]
    return total, slope_z, slope_v


@part(inline=True)
def _compute_remembered_force(joints, i, column, stage, v, first_memory, memory, by_own, evolution):  # type: ignore[no-untyped-def]
    """Force of the terms of joint i with memory, A (h + d h'), and its slope by v.

    `_compute_slipping_force` is for what slips.

    The derivatives by the parameters of the law go to by_own[stage], from `column` on. For each memory q,
    evolution[stage, q] gets h', its derivatives by h and v, the derivative of the force by h, and those of h' by the
    inner parameters. `memory` holds h from `first_memory` on.
    """
    _, firsts, codes, n_inner, values, memories, elements, _ = joints
    total, slope_v = 0.0, 0.0
    for row in range(firsts[i], firsts[i + 1]):
        begin, count = memories[row, 2], memories[row, 3]
        if count > 0 and elements[memories[row, 0], 1] == np.inf:
            amplitude, lag = values[row, 0] / count, values[row, 8]
            for k in range(1 + n_inner[row]):
                by_own[stage, column + k] = 0.0
            for q in range(begin, begin + count):
                h, u = memory[first_memory + q], elements[memories[row, 0] + q - begin, 0]
                rate, by_h, by_v, by_a, by_b, by_c = evolve(
                    codes[row], h, v, values[row, 1], values[row, 2], values[row, 9], u
                )
                shape = h + lag * rate
                total += amplitude * shape
                slope_v += amplitude * lag * by_v
                by_memory = amplitude * (1.0 + lag * by_h)
                for k, value in enumerate((rate, by_h, by_v, by_memory, by_a, by_b, by_c)):
                    evolution[stage, q, k] = value
                by_own[stage, column] += shape / count
                for k in range(n_inner[row]):
                    by_own[stage, column + 1 + k] += amplitude * (
                        lag * evolution[stage, q, 4 + k] + (rate if k == 3 else 0.0)
                    )
        column += 1 + n_inner[row]
    return total, slope_v


@part(inline=True)
def _sum_held(elements, begin, count, held):  # type: ignore[no-untyped-def]
    total = 0.0
    for e in range(begin, begin + count):
        total += elements[e, 6] * held[e]
    return total


@part(inline=False, freedom="any order")
def _sum_elements(elements, begin, count, travel, pulled, held):  # type: ignore[no-untyped-def]
    """Weighted sums over elements: h after a travel; h' / v of those that stick, its derivatives, and their `held`."""
    total, slope, by_a, by_b, by_c, kept = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    begin = max(0, begin)
    for k in range(count):
        e = begin + k
        limit, weight = elements[e, 1], elements[e, 6]
        free = pulled[e] + elements[e, 2] * travel
        sticks = weight if np.abs(free) < limit else 0.0
        total += weight * _confine(free, limit)
        slope += sticks * elements[e, 2]
        by_a += sticks * elements[e, 3]
        by_b += sticks * elements[e, 4]
        by_c += sticks * elements[e, 5]
        kept += sticks * held[e]
    return total, slope, by_a, by_b, by_c, kept


@part(inline=True)
def _compute_slipping_force(joints, i, column, stage, is_begun, travel, pulled, held, by_own, evolution):  # type: ignore[no-untyped-def]
    """Force of the terms of joint i whose elements slip, A times their mean h, and its slope by z.

    The joint moved by `travel` since h was `pulled`. At the beginning of a step (`is_begun` is False) the travel is
    zero, and so is the slope, for h is a state there. `held` is h' / v of the elements that did not slip when the last
    step ended, and 0 for the others.

    A state q stands for the mean h of a term. A change of it spreads over the elements in proportion to `held`, and
    those that have begun to slip lose their part: evolution[stage, q, 3] is the derivative of the force by what is
    left. evolution[stage, q, 7] is the slope.
    """
    _, firsts, _, n_inner, values, memories, elements, _ = joints
    total, slope_z = 0.0, 0.0
    for row in range(firsts[i], firsts[i + 1]):
        begin, count, q = memories[row, 0], memories[row, 1], memories[row, 2]
        if memories[row, 3] > 0 and elements[begin, 1] < np.inf:
            amplitude = values[row, 0]
            of_all, slope, by_a, by_b, by_c, kept = _sum_elements(elements, begin, count, travel, pulled, held)
            before = _sum_held(elements, begin, count, held)
            for k in range(8):
                evolution[stage, q, k] = 0.0
            evolution[stage, q, 3] = amplitude * kept / before if before > 0.0 else 0.0
            if is_begun:
                evolution[stage, q, 7] = amplitude * slope
                slope_z += amplitude * slope
            total += amplitude * of_all
            by_own[stage, column] = of_all
            for k, by_value in enumerate((by_a, by_b, by_c)):
                if k < n_inner[row]:
                    by_own[stage, column + 1 + k] = amplitude * by_value * travel
        column += 1 + n_inner[row]
    return total, slope_z


@part(inline=False)
def _list_places(joints):  # type: ignore[no-untyped-def]
    """Return the first column of the parameters of each interface (k, c, g, rest position, those of the law)."""
    _, firsts, _, n_inner, _, _, _, _ = joints
    owns = np.zeros(firsts.size, np.int64)
    for i in range(firsts.size - 1):
        owns[i + 1] = owns[i] + 4
        for row in range(firsts[i], firsts[i + 1]):
            owns[i + 1] += 1 + n_inner[row]
    return owns


@part(inline=True)
def _follow(joints, step_s, v_begin, v_end, followed):  # type: ignore[no-untyped-def]
    """Move the memories of faint terms over a step in which v is a straight line, by the midpoint rule.

    A faint term moves nothing, so its memory h is no state: `followed`, (3, n, 4), holds h and its derivatives by three
    inner parameters at the beginning, the middle and the end of the step.
    """
    _, firsts, codes, _, values, memories, _, elements = joints
    for i in range(firsts.size - 1):
        for row in range(firsts[i], firsts[i + 1]):
            begin, a, b, c = -2 - memories[row, 0], values[row, 1], values[row, 2], values[row, 9]
            for q in range(begin, begin + (memories[row, 1] if begin >= 0 else 0)):
                u, limit = elements[q, 0], elements[q, 1]
                for half in range(2 if limit < np.inf else 0):
                    # Until it slips, h moves with the travel.
                    travel = 0.5 * step_s * (v_begin[i] + (0.25 + 0.5 * half) * (v_end[i] - v_begin[i]))
                    free = followed[half, q, 0] + elements[q, 2] * travel
                    followed[half + 1, q, 0] = _confine(free, limit)
                    for k in range(3):
                        after = followed[half, q, 1 + k] + elements[q, 3 + k] * travel
                        followed[half + 1, q, 1 + k] = after if np.abs(free) <= limit else 0.0
                for half in range(2 if limit == np.inf else 0):
                    h, then = followed[half, q, 0], half + 1
                    for k in range(1, 4):
                        followed[then, q, k] = followed[half, q, k]
                    change = 0.5 * (v_end[i] - v_begin[i])
                    at_first = v_begin[i] + half * change
                    rate, by_h, _, _, _, _ = evolve(codes[row], h, at_first + 0.5 * change, a, b, c, u)
                    decay = 0.5 * step_s * np.abs(by_h)
                    n_parts = 1 + int(decay) if decay < 50.0 else 50
                    part_s = 0.5 * step_s / n_parts
                    for k in range(n_parts):
                        v = at_first + (k + 0.5) / n_parts * change
                        if n_parts > 1:
                            rate, _, _, _, _, _ = evolve(codes[row], h, v, a, b, c, u)
                        rate, by_h, _, by_a, by_b, by_c = evolve(codes[row], h + 0.5 * part_s * rate, v, a, b, c, u)
                        h += part_s * rate
                        # An implicit step stays stable for any decay.
                        fading = 0.5 * part_s * by_h
                        for column, by_value in enumerate((by_a, by_b, by_c)):
                            before = followed[then, q, 1 + column] * (1.0 + fading)
                            followed[then, q, 1 + column] = (before + part_s * by_value) / (1.0 - fading)
                    followed[then, q, 0] = h


@part(inline=True)
def _add_followed_forces(joints, i, column, half, stage, v, followed, by_own):  # type: ignore[no-untyped-def]
    """Compute derivatives of the force of joint i by parameters of its faint terms with memory, at a stage."""
    _, firsts, codes, n_inner, values, memories, _, elements = joints
    for row in range(firsts[i], firsts[i + 1]):
        begin, count, lag = -2 - memories[row, 0], memories[row, 1], values[row, 8]
        for k in range(1 + n_inner[row] if begin >= 0 else 0):
            by_own[stage, column + k] = 0.0
        for q in range(begin, begin + (count if begin >= 0 else 0)):
            h, amplitude = followed[half, q, 0], values[row, 0] * elements[q, 6]
            rate, by_h, by_a, by_b, by_c = 0.0, 0.0, 0.0, 0.0, 0.0
            # The force of elements that slip has no lag.
            if elements[q, 1] == np.inf:
                rate, by_h, _, by_a, by_b, by_c = evolve(
                    codes[row], h, v, values[row, 1], values[row, 2], values[row, 9], elements[q, 0]
                )
            by_own[stage, column] += elements[q, 6] * (h + lag * rate)
            for k, by_value in enumerate((by_a, by_b, by_c, 0.0)):
                if k < n_inner[row]:
                    through_h = followed[half, q, 1 + k] if k < 3 else 0.0
                    later = rate if k == 3 else 0.0
                    by_own[stage, column + 1 + k] += amplitude * (
                        (1.0 + lag * by_h) * through_h + lag * by_value + later
                    )
        column += 1 + n_inner[row]


@part(inline=True)
def _copy_followed(joints, i, column, before, stage, by_own):  # type: ignore[no-untyped-def]
    """Copy the derivatives by the parameters of the faint terms with memory of joint i from another stage."""
    _, firsts, _, n_inner, _, memories, _, _ = joints
    for row in range(firsts[i], firsts[i + 1]):
        for k in range(1 + n_inner[row] if memories[row, 0] < -1 else 0):
            by_own[stage, column + k] = by_own[before, column + k]
        column += 1 + n_inner[row]


@part(inline=False)
def _list_owners(joints):  # type: ignore[no-untyped-def]
    """Return the interface to which each state of a memory belongs."""
    firsts, memories = joints[1], joints[5]
    n_memories = 0
    for row in range(memories.shape[0]):
        n_memories += memories[row, 3]
    owners = np.zeros(n_memories, np.int64)
    for i in range(firsts.size - 1):
        for row in range(firsts[i], firsts[i + 1]):
            for q in range(memories[row, 3]):
                owners[memories[row, 2] + q] = i
    return owners


@kernel()
def remembered_along(joints, v, step_s):  # type: ignore[no-untyped-def]
    """Return derivatives of the force of one joint, all of whose terms are faint, along a motion: (n, n_own)."""
    n_followed, n_own = len(joints[7]), _list_places(joints)[1]
    followed, by_own, pace = np.zeros((3, n_followed, 4)), np.zeros((1, n_own)), np.zeros((2, 1))
    found = np.empty((v.size, n_own))
    for k in range(v.size):
        _add_followed_forces(joints, 0, 4, 2, 0, v[k], followed, by_own)
        for p in range(n_own):
            found[k, p] = by_own[0, p]
        if k + 1 < v.size:
            for q in range(n_followed):
                for column in range(4):
                    followed[0, q, column] = followed[2, q, column]
            pace[0, 0], pace[1, 0] = v[k], v[k + 1]
            _follow(joints, step_s, pace[0], pace[1], followed)
    return found
