"""The effect of a step of a prediction on small changes of its state: derivatives by parameters, and the covariance.

The state is that of `opid.mechanics.kernels.prediction_steps`. A small change y of (z, v, h) obeys
y' = J_s y + (0, c_s, 0) at stage s of a step of the length t,

    J_s = [0, 1, 0; -A kz_s, -A kv_s, -A kh_s; 0, rv_s, rh_s],

with the slopes kz, kv, kh of the forces and rv, rh of the memories. The classical Runge-Kutta step is linear in y and
c:

    y(next) = T y + sum_s L_s (0, c_s, 0),   L_4 = t/6,  L_3 = t/3 + t L_4 J_4,  L_2 = t/3 + t/2 L_3 J_3,
                                             L_1 = t/6 + t/2 L_2 J_2,            T = 1 + sum_s L_s J_s.

These matrices are made once in a step and serve all parameters and the covariance. The derivatives are those of the
steps themselves, with the gain of the correction held fixed.
"""

from __future__ import annotations

import numpy as np

from opid.mechanics.kernels.compilation import part
from opid.mechanics.kernels.steps import _STAGE_STEP, _STAGE_WEIGHT


@part(inline=True, freedom="fused")
def _compute_step_matrices(  # type: ignore[no-untyped-def]
    accelerance, by_z, by_v, evolution, owners, step_s, of_acceleration, of_force, of_memory, transition, work
):
    """Make T, and the effect of a body acceleration, joint force or memory rate at a stage on (z, v, h) after the step.

    The latter are L_s (0, 1, 0), L_s (0, -A, 0) and L_s (0, 0, 1), made from the last stage to the first, one row of
    L_s J_s in `work` at a time.
    """
    n, n_moving = by_z.shape[1], transition.shape[0]
    for row in range(n_moving):
        for column in range(n_moving):
            transition[row, column] = 1.0 if row == column else 0.0
            work[column] = 0.0
        for stage in range(3, -1, -1):
            weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
            for i in range(n):
                work[i] = ahead * work[i] + (weight if row == i else 0.0)
                of_acceleration[stage, row, i] = ahead * work[n + i] + (weight if row == n + i else 0.0)
            for q in range(n_moving - 2 * n):
                of_memory[stage, row, q] = ahead * work[2 * n + q] + (weight if row == 2 * n + q else 0.0)
            for i in range(n):
                coefficient = 0.0
                for k in range(n):
                    coefficient -= of_acceleration[stage, row, k] * accelerance[k, i]
                of_force[stage, row, i] = coefficient
                work[n + i] = work[i] + coefficient * by_v[stage, i]
                work[i] = coefficient * by_z[stage, i]
            for q in range(n_moving - 2 * n):
                i, of_rate = owners[q], of_memory[stage, row, q]
                work[n + i] += of_rate * evolution[stage, q, 2]
                work[2 * n + q] = of_rate * evolution[stage, q, 1] + of_force[stage, row, i] * evolution[stage, q, 3]
            for column in range(n_moving):
                transition[row, column] += work[column]


@part(inline=False, freedom="fused")
def _slip(joints, evolution, at_end, of_acceleration, of_force, transition):  # type: ignore[no-untyped-def]
    """Add the effect of slipping elements to these matrices: their mean h is a state that moves with z.

    At a stage h follows from its value at the beginning and the travel since then, dh_s = r_s dh + T_s (dz_s - dz).
    `_compute_step_matrices` took A T_s as a slope of the force, and A r_s as its derivative by h. `at_end` has T and r
    where the step ends.
    """
    firsts, memories, elements = joints[1], joints[5], joints[6]
    n, n_moving = firsts.size - 1, transition.shape[0]
    for i in range(n):
        for term in range(firsts[i], firsts[i + 1]):
            if memories[term, 3] > 0 and elements[memories[term, 0], 1] < np.inf:
                q = memories[term, 2]
                for row in range(n_moving):
                    for stage in range(4):
                        transition[row, i] -= of_force[stage, row, i] * evolution[stage, q, 7]
    for i in range(n):
        for term in range(firsts[i], firsts[i + 1]):
            if memories[term, 3] > 0 and elements[memories[term, 0], 1] < np.inf:
                q = memories[term, 2]
                row, slope = 2 * n + q, at_end[q, 0]
                for column in range(n_moving):
                    transition[row, column] = slope * transition[i, column]
                transition[row, i] -= slope
                transition[row, row] += at_end[q, 1]
                for stage in range(4):
                    for k in range(n):
                        of_acceleration[stage, row, k] = slope * of_acceleration[stage, i, k]
                        of_force[stage, row, k] = slope * of_force[stage, i, k]


@part(inline=False, freedom="fused")
def _push_slipping(n, joints, evolution, travels, pulled, of_force, moved, carried):  # type: ignore[no-untyped-def]
    """Add to `carried` the difference of elements that slip at a stage from their mean; `moved` has derivatives."""
    _, firsts, _, _, values, memories, elements, _ = joints
    for i in range(n):
        for term in range(firsts[i], firsts[i + 1]):
            begin, count, q = memories[term, 0], memories[term, 1], memories[term, 2]
            if memories[term, 3] > 0 and elements[begin, 1] < np.inf:
                for stage in range(4):
                    kept = evolution[stage, q, 3] / values[term, 0]
                    if kept == 1.0:
                        continue
                    for e in range(begin, begin + count):
                        sticks = np.abs(pulled[e] + elements[e, 2] * travels[stage, i]) < elements[e, 1]
                        more = values[term, 0] * elements[e, 6] * ((1.0 if sticks else 0.0) - kept)
                        for row in range(2 * n):
                            factor = of_force[stage, row, i] * more
                            for p in range(carried.shape[1]):
                                carried[row, p] += factor * moved[e, p]


@part(inline=False, freedom="fused")
def _drag(n, joints, owns, travels, pulled, before, moved, carried):  # type: ignore[no-untyped-def]
    """Move the derivatives of elements that slip to the end of a step, and put their mean in `carried`.

    `before` has the derivatives of z where the step began.
    """
    _, firsts, _, n_inner, _, memories, elements, _ = joints
    width = carried.shape[1]
    for i in range(n):
        column = owns[i] + 4
        for term in range(firsts[i], firsts[i + 1]):
            begin, count, row = memories[term, 0], memories[term, 1], 2 * n + memories[term, 2]
            if memories[term, 3] > 0 and elements[begin, 1] < np.inf:
                for p in range(width):
                    before[i, p] = carried[i, p] - before[i, p]
                    carried[row, p] = 0.0
                for e in range(begin, begin + count):
                    slope = elements[e, 2]
                    if np.abs(pulled[e] + slope * travels[4, i]) < elements[e, 1]:
                        for p in range(width):
                            moved[e, p] += slope * before[i, p]
                        for k in range(n_inner[term]):
                            moved[e, column + 1 + k] += elements[e, 3 + k] * travels[4, i]
                        for p in range(width):
                            carried[row, p] += elements[e, 6] * moved[e, p]
                    else:
                        # An element that slips does not depend on its position before.
                        for p in range(width):
                            moved[e, p] = 0.0
                for p in range(width):
                    before[i, p] = carried[i, p] - before[i, p]
            column += 1 + n_inner[term]


@part(inline=True, freedom="fused")
def _derive_by_offset_and_ground(  # type: ignore[no-untyped-def]
    linear, of_acceleration, of_force, step_s, ground, unmeasured, decay, transition, of_drive, of_push
):
    """Make the effect of the drive at each half step on (z, v, h), directly and through d; and columns o, d, e, w of T.

    `of_push` is the effect of a push of w that grows from zero at the beginning of the step to its end.
    """
    n, n_moving = linear.shape[0], transition.shape[0]
    n_states = transition.shape[1]
    for row in range(n_moving):
        for i in range(n):
            g = linear[i, 2]
            first, second = of_force[0, row, i], of_force[1, row, i]
            third, fourth = of_force[2, row, i], of_force[3, row, i]
            of_drive[0, row, i] = -of_acceleration[0, row, i] + 0.25 * step_s * step_s * g * third
            of_drive[1, row, i] = (
                -of_acceleration[1, row, i] - of_acceleration[2, row, i] + 0.5 * step_s * step_s * g * fourth
            )
            of_drive[2, row, i] = -of_acceleration[3, row, i]
            transition[row, n_moving + i] = of_drive[0, row, i] + of_drive[1, row, i] + of_drive[2, row, i]
            if ground:
                transition[row, n_moving + 2 * n + i] = g * (first + second + third + fourth)
                transition[row, n_moving + 3 * n + i] = g * step_s * (0.5 * (second + third) + fourth)
            if unmeasured:
                halfway = of_acceleration[1, row, i] + of_acceleration[2, row, i]
                of_push[row, i] = 0.5 * halfway + of_acceleration[3, row, i]
                transition[row, n_states - n + i] = (
                    of_acceleration[0, row, i] + 0.5 * halfway + decay[i] * of_push[row, i]
                )


@part(inline=True, freedom="any order")
def _multiply_rows(one, row, other, other_row):  # type: ignore[no-untyped-def]
    total = 0.0
    for s in range(one.shape[1]):
        total += one[row, s] * other[other_row, s]
    return total


@part(inline=True, freedom="fused")
def _carry(n, transition, ground, unmeasured, moving, resting, carried):  # type: ignore[no-untyped-def]
    """Add rows z, v and h of Phi times columns to `carried`; `moving` has these rows, `resting` the other rows."""
    n_moving, n_states = transition.shape
    for row in range(n_moving):
        for i in range(n):
            # an offset of the readings does not move the body
            z, v, o = transition[row, i], transition[row, n + i], transition[row, n_moving + i]
            if ground:
                d, e = transition[row, n_moving + 2 * n + i], transition[row, n_moving + 3 * n + i]
                for c in range(moving.shape[1]):
                    of_ground = d * resting[2 * n + i, c] + e * resting[3 * n + i, c]
                    carried[row, c] += z * moving[i, c] + v * moving[n + i, c] + o * resting[i, c] + of_ground
            else:
                for c in range(moving.shape[1]):
                    carried[row, c] += z * moving[i, c] + v * moving[n + i, c] + o * resting[i, c]
            if unmeasured:
                w = transition[row, n_states - n + i]
                for c in range(moving.shape[1]):
                    carried[row, c] += w * resting[n_states - n_moving - n + i, c]
        for q in range(2 * n, n_moving):
            h = transition[row, q]
            for c in range(moving.shape[1]):
                carried[row, c] += h * moving[q, c]


@part(inline=True, freedom="fused")
def _carry_ground(step_s, n, resting):  # type: ignore[no-untyped-def]
    """Replace rows d and e of columns in `resting` by Phi times the columns: d' = e, e' = o."""
    for i in range(n):
        for c in range(resting.shape[1]):
            e, o = resting[3 * n + i, c], resting[i, c]
            resting[2 * n + i, c] += step_s * (e + 0.5 * step_s * o)
            resting[3 * n + i, c] = e + step_s * o


@part(inline=True, freedom="fused")
def _push(owns, start, by_mass, by_drive, force, by_own, of_acceleration, of_force, of_drive, carried):  # type: ignore[no-untyped-def]
    """Add to `carried` the effect of the parameters on z, v and h in a step whose drive begins at `start`."""
    n, n_own, n_mass, n_drive = force.shape[1], by_own.shape[1], by_mass.shape[2], by_drive.shape[1]
    for row in range(carried.shape[0]):
        for i in range(n):
            first, second = of_force[0, row, i], of_force[1, row, i]
            third, fourth = of_force[2, row, i], of_force[3, row, i]
            # max and counting from 0 show the compiler that no index is negative
            begin = max(0, owns[i])
            for p in range(owns[i + 1] - owns[i]):
                carried[row, begin + p] += (
                    first * by_own[0, begin + p]
                    + second * by_own[1, begin + p]
                    + third * by_own[2, begin + p]
                    + fourth * by_own[3, begin + p]
                )
        for c in range(n_drive):
            total = 0.0
            for half in range(3):
                for i in range(n):
                    total += of_drive[half, row, i] * by_drive[start + half, c, i]
            carried[row, n_own + n_mass + c] += total
        for i in range(n if n_mass > 0 else 0):
            for k in range(n):
                coefficient = 0.0
                for stage in range(4):
                    coefficient += of_acceleration[stage, row, i] * force[stage, k]
                for m in range(n_mass):
                    carried[row, n_own + m] -= coefficient * by_mass[i, k, m]


@part(inline=True, freedom="fused")
def _push_memories(joints, owns, evolution, of_memory, carried):  # type: ignore[no-untyped-def]
    """Add the effect of the inner parameters of terms with memory on the memories in a step."""
    _, firsts, _, n_inner, _, memories, _, _ = joints
    for i in range(firsts.size - 1):
        column = owns[i] + 4
        for term in range(firsts[i], firsts[i + 1]):
            for q in range(max(0, memories[term, 2]), memories[term, 2] + memories[term, 3]):
                for k in range(n_inner[term]):
                    for row in range(carried.shape[0]):
                        for stage in range(4):
                            carried[row, column + 1 + k] += of_memory[stage, row, q] * evolution[stage, q, 4 + k]
            column += 1 + n_inner[term]


@part(inline=True, freedom="fused")
def _push_ground(start, step_s, first_drive, by_drive, resting):  # type: ignore[no-untyped-def]
    """Add the effect of directions of the drive on d and e in a step whose drive begins at `start`."""
    n = by_drive.shape[2]
    for c in range(by_drive.shape[1]):
        for i in range(n):
            first, middle, last = by_drive[start, c, i], by_drive[start + 1, c, i], by_drive[start + 2, c, i]
            resting[2 * n + i, first_drive + c] += step_s * step_s * (first + 2.0 * middle) / 6.0
            resting[3 * n + i, first_drive + c] += step_s * (first + 4.0 * middle + last) / 6.0


@part(inline=True, freedom="fused")
def _compute_gain(n_moving, ground, unmeasured, covariance, by_state, noise, gain, scale):  # type: ignore[no-untyped-def]
    """Compute the gain K of the white innovation, the lower Cholesky factor of its raw covariance, and P - K K'."""
    n, n_states = by_state.shape
    for i in range(n):
        for s in range(n_states):
            gain[i, s] = covariance[n_moving + n + i, s]
        for s in range(n_states if unmeasured else 0):
            gain[i, s] += covariance[n_states - n + i, s]
        for k in range(n):
            z, v = by_state[i, k], by_state[i, n + k]
            for s in range(n_states):
                gain[i, s] += z * covariance[k, s] + v * covariance[n + k, s]
            if ground:
                d = by_state[i, n_moving + 2 * n + k]
                for s in range(n_states):
                    gain[i, s] += d * covariance[n_moving + 2 * n + k, s]
        for q in range(2 * n, n_moving):
            h = by_state[i, q]
            for s in range(n_states):
                gain[i, s] += h * covariance[q, s]
    for i in range(n):
        for k in range(i + 1):
            variance = _multiply_rows(by_state, i, gain, k)
            for q in range(k):
                variance -= scale[i, q] * scale[k, q]
            if i == k:
                # rounding must not make it smaller than the noise of the reading
                scale[i, i] = np.sqrt(max(variance + noise[1, i] ** 2, noise[1, i] ** 2))
            else:
                scale[i, k] = variance / scale[k, k]
    for i in range(n):
        for q in range(i):
            for s in range(n_states):
                gain[i, s] -= scale[i, q] * gain[q, s]
        per_scale = 1.0 / scale[i, i]
        for s in range(n_states):
            gain[i, s] *= per_scale
    for i in range(n):
        for s in range(n_states):
            coefficient = gain[i, s]
            for q in range(n_states):
                covariance[s, q] -= coefficient * gain[i, q]


@part(inline=True, freedom="fused")
def _balance(step_s, tied, transition):  # type: ignore[no-untyped-def]
    """Change the transition from z to z + tied d."""
    n, n_moving = tied.size, transition.shape[0]
    d, e = n_moving + 2 * n, n_moving + 3 * n
    for i in range(n):
        transition[i, n_moving + i] += 0.5 * step_s * step_s * tied[i]
        transition[i, d + i] += tied[i]
        transition[i, e + i] += step_s * tied[i]
    for row in range(n_moving):
        for i in range(n):
            transition[row, d + i] -= tied[i] * transition[row, i]


@part(inline=True, freedom="fused")
def _carry_covariance(  # type: ignore[no-untyped-def]
    transition, step_s, n_steps, ground, unmeasured, decay, of_push, noise, tied, covariance, product
):
    """Compute P = Phi P Phi' + Q; noise of the drive acts like an offset for a step, that of the motion not on d.

    In each of the n steps from one sample to the next an offset walks by an n-th of its variance, and white noise of
    the same density has n times its variance.
    """
    n_moving, n_states, n = transition.shape[0], covariance.shape[0], noise.shape[1]
    for row in range(n_moving):
        for s in range(n_states):
            product[row, s] = 0.0
    _carry(n, transition, ground, unmeasured, covariance[:n_moving], covariance[n_moving:], product)
    for row in range(n_moving):
        for q in range(row + 1):
            total = _multiply_rows(product, row, transition, q)
            for i in range(n if unmeasured else 0):
                pushed = noise[5, i] ** 2 * (1.0 - decay[i] ** 2)
                total += pushed * of_push[row, i] * of_push[q, i]
            for i in range(n):
                of_row, of_q = transition[row, n_moving + i], transition[q, n_moving + i]
                total += n_steps * noise[0, i] ** 2 * of_row * of_q
                if row == i:
                    of_row -= 0.5 * step_s * step_s * tied[i]
                if q == i:
                    of_q -= 0.5 * step_s * step_s * tied[i]
                total += n_steps * noise[4, i] ** 2 * of_row * of_q
            covariance[row, q] = covariance[q, row] = total
    if ground:
        d, e = n_moving + 2 * n, n_moving + 3 * n
        _carry_ground(step_s, n, covariance[n_moving:])
        for i in range(n):
            variance = n_steps * noise[0, i] ** 2
            for row in range(n_moving):
                o = product[row, n_moving + i] + variance * transition[row, n_moving + i]
                product[row, d + i] += step_s * (product[row, e + i] + 0.5 * step_s * o)
                product[row, e + i] += step_s * o
            for s in range(n_moving, n_states):
                of_e, o = covariance[s, e + i], covariance[s, n_moving + i]
                covariance[s, d + i] += step_s * (of_e + 0.5 * step_s * o)
                covariance[s, e + i] = of_e + step_s * o
            covariance[d + i, d + i] += 0.25 * variance * step_s**4
            covariance[d + i, e + i] += 0.5 * variance * step_s**3
            covariance[e + i, d + i] += 0.5 * variance * step_s**3
            covariance[e + i, e + i] += variance * step_s**2
    for i in range(n if unmeasured else 0):
        # rows z, v and h of `product` still have the old w; the others have the new one without its push
        w, pushed = n_states - n + i, noise[5, i] ** 2 * (1.0 - decay[i] ** 2)
        for row in range(n_moving):
            product[row, w] = decay[i] * product[row, w] + pushed * of_push[row, i]
        for s in range(n_moving, n_states):
            covariance[w, s] *= decay[i]
        for s in range(n_moving, n_states):
            covariance[s, w] *= decay[i]
        covariance[w, w] += pushed
    for row in range(n_moving):
        for s in range(n_moving, n_states):
            covariance[row, s] = covariance[s, row] = product[row, s]
    for i in range(n):
        covariance[n_moving + i, n_moving + i] += noise[2, i] ** 2 / n_steps
        covariance[n_moving + n + i, n_moving + n + i] += noise[3, i] ** 2 / n_steps
