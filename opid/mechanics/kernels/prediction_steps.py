"""Predict, correct, repeat: the filter of `opid.mechanics.prediction`, compiled.

State of n interfaces, n numbers each: z, v, [h], offset of the drive o, offset of the readings r, [d, e], [w]. What the
laws remember, h, is one number for each term with memory, h' = r(h, v). d and e are there only where a ground spring
needs the place of the body: x = z + d, and d' = e, e' = u + o know nothing of the law. w is the acceleration of the
body by forces that nobody measured. It decays by a factor from sample to sample and is pushed anew at random; between
two samples it is a straight line. With b = w - A F, z' = v and v' = b - u - o, a sensor reads b + r; one that sits
beside its interface reads w - R F + r.

A small change y of (z, v, h) obeys y' = J_s y + (0, c_s, 0) at stage s of a step of the length t,

    J_s = [0, 1, 0; -A kz_s, -A kv_s, -A kh_s; 0, rv_s, rh_s],

with the slopes kz, kv, kh of the forces and rv, rh of the memories. The classical Runge-Kutta step is linear in y and
c:

    y(next) = T y + sum_s L_s (0, c_s, 0),   L_4 = t/6,  L_3 = t/3 + t L_4 J_4,  L_2 = t/3 + t/2 L_3 J_3,
                                             L_1 = t/6 + t/2 L_2 J_2,            T = 1 + sum_s L_s J_s.

These matrices are made once a step and serve all parameters and the covariance: the derivatives are those of the steps
themselves, with the gain of the correction held fixed.

A memory that turns over quickly needs short steps: where t |rh| is above `_MOST_DECAY`, the time from one sample to the
next is divided, and the drive between its half steps is the parabola through them.
"""

from __future__ import annotations

import numpy as np

from opid.mechanics.kernels.compilation import kernel, part
from opid.mechanics.kernels.small_arrays import small_zeros
from opid.mechanics.kernels.steps import (
    _STAGE_PLACE,
    _STAGE_STEP,
    _STAGE_WEIGHT,
    _confined,
    _follow,
    _followed_forces,
    _joint_force,
    _owners,
    _places,
    _remembered_force,
)

# what a memory may decay by in a step, as its rate times the step; at 2.8 the steps would grow without bound. So fast a
# memory is nearly where it ends: after a reversal, where it matters, the velocity and with it the decay are small
_MOST_DECAY = 2.0
# of a sample: a memory that needs more is a step, and static laws describe it
_MOST_STEPS = 30


@part(inline=True, freedom="fused")
def _step_matrices(  # type: ignore[no-untyped-def]
    accelerance, by_z, by_v, evolution, owners, step_s, of_acceleration, of_force, of_memory, transition, work
):
    """T; what a body acceleration, a joint force or a rate of a memory at a stage does to (z, v, h) after the step.

    These are L_s (0, 1, 0), L_s (0, -A, 0) and L_s (0, 0, 1), made from the last stage to the first, one row of L_s J_s
    in `work` at a time.
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
                share = 0.0
                for k in range(n):
                    share -= of_acceleration[stage, row, k] * accelerance[k, i]
                of_force[stage, row, i] = share
                work[n + i] = work[i] + share * by_v[stage, i]
                work[i] = share * by_z[stage, i]
            for q in range(n_moving - 2 * n):
                i, of_rate = owners[q], of_memory[stage, row, q]
                work[n + i] += of_rate * evolution[stage, q, 2]
                work[2 * n + q] = of_rate * evolution[stage, q, 1] + of_force[stage, row, i] * evolution[stage, q, 3]
            for column in range(n_moving):
                transition[row, column] += work[column]


@part(inline=True, freedom="fused")
def _by_offset_and_ground(  # type: ignore[no-untyped-def]
    linear, of_acceleration, of_force, step_s, ground, unmeasured, decay, transition, of_drive, of_push
):
    """What the drive at each half step does to (z, v, h), by itself and by d of later stages; columns of o, d, e and w.

    `of_push` is what a push at the end of the step does, which w grows to from nothing at its beginning.
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


@part(inline=True, freedom="fused")
def _carry(n, transition, ground, unmeasured, moving, resting, carried):  # type: ignore[no-untyped-def]
    """Add rows z, v and h of Phi times columns to `carried`; `moving` has these rows of them, `resting` the others."""
    n_moving, n_states = transition.shape
    for row in range(n_moving):
        for i in range(n):
            # an offset of the readings moves nothing
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
    """Put rows d and e of Phi times columns in place of those in `resting`: d' = e, e' = o."""
    for i in range(n):
        for c in range(resting.shape[1]):
            e, o = resting[3 * n + i, c], resting[i, c]
            resting[2 * n + i, c] += step_s * (e + 0.5 * step_s * o)
            resting[3 * n + i, c] = e + step_s * o


@part(inline=True, freedom="any order")
def _dot_of_rows(one, row, other, other_row):  # type: ignore[no-untyped-def]
    total = 0.0
    for s in range(one.shape[1]):
        total += one[row, s] * other[other_row, s]
    return total


@part(inline=True, freedom="fused")
def _carry_covariance(  # type: ignore[no-untyped-def]
    transition, step_s, n_steps, ground, unmeasured, decay, of_push, noise, tied, covariance, product
):
    """P = Phi P Phi' + Q; noise of the drive acts like an offset that lasts a step, that of the motion spares d.

    In each of `n_steps` steps from one sample to the next an offset walks an n-th of its variance, and white noise of
    the same density has n times its variance.
    """
    n_moving, n_states, n = transition.shape[0], covariance.shape[0], noise.shape[1]
    for row in range(n_moving):
        for s in range(n_states):
            product[row, s] = 0.0
    _carry(n, transition, ground, unmeasured, covariance[:n_moving], covariance[n_moving:], product)
    for row in range(n_moving):
        for q in range(row + 1):
            total = _dot_of_rows(product, row, transition, q)
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
        # the rows z, v and h of `product` have the old w, the others the new one but for its push
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


@part(inline=True, freedom="fused")
def _balance(step_s, tied, transition):  # type: ignore[no-untyped-def]
    """The transition with z + tied d in place of z."""
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
def _gain(n_moving, ground, unmeasured, covariance, by_state, noise, gain, scale):  # type: ignore[no-untyped-def]
    """Gain K of the white innovation, lower Cholesky factor of the covariance of the raw one, and P - K K'."""
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
            variance = _dot_of_rows(by_state, i, gain, k)
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
            share = gain[i, s]
            for q in range(n_states):
                covariance[s, q] -= share * gain[i, q]


@part(inline=True, freedom="fused")
def _push(owns, place, by_mass, by_drive, force, by_own, of_acceleration, of_force, of_drive, carried):  # type: ignore[no-untyped-def]
    """Add to `carried` what the parameters themselves do to z, v and h in a step whose drive begins at `place`."""
    n, n_own, n_mass, n_drive = force.shape[1], by_own.shape[1], by_mass.shape[2], by_drive.shape[1]
    for row in range(carried.shape[0]):
        for i in range(n):
            first, second = of_force[0, row, i], of_force[1, row, i]
            third, fourth = of_force[2, row, i], of_force[3, row, i]
            # max, and counting from 0: the compiler then knows that no place counts from the end
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
                    total += of_drive[half, row, i] * by_drive[place + half, c, i]
            carried[row, n_own + n_mass + c] += total
        for i in range(n if n_mass > 0 else 0):
            for k in range(n):
                share = 0.0
                for stage in range(4):
                    share += of_acceleration[stage, row, i] * force[stage, k]
                for m in range(n_mass):
                    carried[row, n_own + m] -= share * by_mass[i, k, m]


@part(inline=True, freedom="fused")
def _push_memories(joints, owns, evolution, of_memory, carried):  # type: ignore[no-untyped-def]
    """Add what the inner parameters of terms with memory do to the memories in a step."""
    _, firsts, _, n_inner, _, memories, _, _ = joints
    for i in range(firsts.size - 1):
        place = owns[i] + 4
        for term in range(firsts[i], firsts[i + 1]):
            for q in range(max(0, memories[term, 0]), memories[term, 0] + memories[term, 1]):
                for k in range(n_inner[term]):
                    for row in range(carried.shape[0]):
                        for stage in range(4):
                            carried[row, place + 1 + k] += of_memory[stage, row, q] * evolution[stage, q, 4 + k]
            place += 1 + n_inner[term]


@part(inline=True)
def _interpolate(given, place, begin, end, out):  # type: ignore[no-untyped-def]
    """Rows of a parabola through three half steps at the beginning, middle and end of a part of their step."""
    for row in range(3):
        t = begin + 0.5 * row * (end - begin)
        first, middle, last = (2.0 * t - 1.0) * (t - 1.0), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)
        for c in range(given.shape[1]):
            for i in range(given.shape[2]):
                out[row, c, i] = (
                    first * given[place, c, i] + middle * given[place + 1, c, i] + last * given[place + 2, c, i]
                )


@part(inline=True, freedom="fused")
def _push_ground(place, step_s, first_drive, by_drive, resting):  # type: ignore[no-untyped-def]
    """What directions of the drive do to d and e in a step whose drive begins at `place`."""
    n = by_drive.shape[2]
    for c in range(by_drive.shape[1]):
        for i in range(n):
            first, middle, last = by_drive[place, c, i], by_drive[place + 1, c, i], by_drive[place + 2, c, i]
            resting[2 * n + i, first_drive + c] += step_s * step_s * (first + 2.0 * middle) / 6.0
            resting[3 * n + i, first_drive + c] += step_s * (first + 4.0 * middle + last) / 6.0


@kernel(freedom="fused")
def _predictions(  # type: ignore[no-untyped-def]
    several, remembered, ground_is_followed, unmeasured_is_followed, joints, accelerance, by_mass, reading, by_reading,
    drive, by_drive, measured, by_measured, step_s, start, by_start, covariance_start, noise, correct, differentiate,
):  # fmt: skip
    """Predict each sample from the ones before it, see `opid.mechanics.prediction`.

    `several` is the number of interfaces, or None for one: the compiler then knows the sizes of all small arrays and
    keeps their numbers in registers. For one interface `remembered` is a tuple with a number for each memory, and
    `ground_is_followed` and `unmeasured_is_followed` are True or None; for several they are empty and bools.

    The covariance is that of z + tied d, travel about the place where both springs balance. By itself d grows, for no
    reading sees it in the long run, and with it z: their small difference would drown.

    Parameters: those of the joints, directions of A (the last axis of `by_mass`), of the drive, of the measured, then
    those of `by_start`.
    """
    n = 1 if several is None else several
    ground = False if ground_is_followed is None else ground_is_followed
    n_moving = 2 * n + len(remembered) if several is None else 2 * n + len(joints[6])
    unmeasured = False if unmeasured_is_followed is None else unmeasured_is_followed
    n_states = n_moving + (4 if ground else 2) * n + (n if unmeasured else 0)
    n_samples, linear = measured.shape[0], joints[0]
    owns, owners = _places(joints), _owners(joints)
    n_own, n_mass, n_drive, n_measured = owns[n], by_mass.shape[2], by_drive.shape[1], by_measured.shape[1]
    first_measured = n_own + n_mass + n_drive
    n_known = first_measured + n_measured
    n_parameters = n_known + by_start.shape[1] if differentiate else 0
    state, covariance = small_zeros(several, (n_states,)), small_zeros(several, (n_states, n_states))
    for s in range(n_states):
        state[s] = start[s]
        for q in range(n_states):
            covariance[s, q] = covariance_start[s, q]
    # The compiler takes blocks of columns at once; columns that nobody reads fill up the last block.
    width = (n_parameters + 15) // 16 * 16
    moving, carried = np.zeros((n_moving, width)), np.zeros((n_moving, width))
    resting = np.zeros((n_states - n_moving, width))
    if differentiate:
        for c in range(by_start.shape[1]):
            for s in range(n_moving):
                moving[s, n_known + c] = by_start[s, c]
            for s in range(n_moving, n_states):
                resting[s - n_moving, n_known + c] = by_start[s, c]
    # of the rows of the stages the last is that of the prediction, which is the first stage where nothing is corrected
    seen = 4 if correct else 0
    force, by_z, by_v, by_own = (
        small_zeros(several, (5, n)),
        small_zeros(several, (5, n)),
        small_zeros(several, (5, n)),
        np.zeros((5, n_own)),
    )
    evolution = small_zeros(several, (5, n_moving - 2 * n, 8))
    of_acceleration, of_force, of_drive, of_memory = (
        small_zeros(several, (4, n_moving, n)),
        small_zeros(several, (4, n_moving, n)),
        small_zeros(several, (3, n_moving, n)),
        small_zeros(several, (4, n_moving, n_moving - 2 * n)),
    )
    transition, work = small_zeros(several, (n_moving, n_states)), small_zeros(several, (n_moving,))
    product = small_zeros(several, (n_moving, n_states))
    by_state, gain, scale = (
        small_zeros(several, (n, n_states)),
        small_zeros(several, (n, n_states)),
        small_zeros(several, (n, n)),
    )
    white, change = small_zeros(several, (n,)), np.zeros((n, width))
    here, following = small_zeros(several, (4, n)), small_zeros(several, (4, n))
    memory, memory_next = small_zeros(several, (n_moving - 2 * n,)), small_zeros(several, (n_moving - 2 * n,))
    part_drive, part_by_drive = np.zeros((3, 1, n)), np.zeros((3, n_drive, n))
    whole_drive = drive.reshape(drive.shape[0], 1, n)
    # what faint terms remember, and v where a step begins and ends
    n_followed = len(joints[7])
    followed, pace = np.zeros((3, n_followed, 4)), np.zeros((2, n))
    tied, decay, of_push = small_zeros(several, (n,)), small_zeros(several, (n,)), small_zeros(several, (n_moving, n))
    for i in range(n):
        by_state[i, n_moving + n + i], scale[i, i] = 1.0, noise[1, i]
        if unmeasured:
            by_state[i, n_states - n + i] = 1.0
        if ground:
            if linear[i, 3] + linear[i, 2] > 0.0:
                tied[i] = linear[i, 2] / (linear[i, 3] + linear[i, 2])
            for s in range(n_states):
                covariance[i, s] += tied[i] * covariance[n_moving + 2 * n + i, s]
            for s in range(n_states):
                covariance[s, i] += tied[i] * covariance[s, n_moving + 2 * n + i]
    innovation, spread = np.empty((n, n_samples)), np.empty((n, n_samples))
    sensitivity, motion = np.empty((n_samples, n, n_parameters)), np.empty((3, n, n_samples))

    for step in range(n_samples):
        place = 0
        for i in range(n):
            z, v = state[i], state[n + i]
            x = z + state[n_moving + 2 * n + i] if ground else 0.0
            force[seen, i], by_z[seen, i], by_v[seen, i], place = _joint_force(joints, i, place, seen, z, v, x, by_own)
            by_z[seen, i] += linear[i, 2]
            if n_moving > 2 * n:
                more, slope = _remembered_force(joints, i, owns[i] + 4, seen, v, 2 * n, state, by_own, evolution)
                force[seen, i] += more
                by_v[seen, i] += slope
        for i in range(n if n_followed > 0 else 0):
            _followed_forces(joints, i, owns[i] + 4, 2, seen, seen + 1, state[n + i], followed, by_own)
        for i in range(n):
            body = 0.0
            for k in range(n):
                body -= reading[i, k] * force[seen, k]
                by_state[i, k] = -reading[i, k] * by_z[seen, k]
                by_state[i, n + k] = -reading[i, k] * by_v[seen, k]
                if ground:
                    by_state[i, n_moving + 2 * n + k] = -reading[i, k] * linear[k, 2]
            for q in range(n_moving - 2 * n):
                by_state[i, 2 * n + q] = -reading[i, owners[q]] * evolution[seen, q, 3]
            motion[0, i, step], motion[1, i, step], motion[2, i, step] = state[i], state[n + i], body
            white[i] = measured[step, i] - body - state[n_moving + n + i]
            if unmeasured:
                motion[2, i, step] += state[n_states - n + i]
                white[i] -= state[n_states - n + i]
        if differentiate:
            for i in range(n):
                for p in range(width):
                    change[i, p] = -resting[n + i, p]
                for p in range(width if unmeasured else 0):
                    change[i, p] -= resting[n_states - n_moving - n + i, p]
                for k in range(n):
                    z, v = by_state[i, k], by_state[i, n + k]
                    for p in range(width):
                        change[i, p] -= z * moving[k, p] + v * moving[n + k, p]
                    if ground:
                        d = by_state[i, n_moving + 2 * n + k]
                        for p in range(width):
                            change[i, p] -= d * resting[2 * n + k, p]
                    begin = max(0, owns[k])
                    for p in range(owns[k + 1] - owns[k]):
                        change[i, begin + p] += reading[i, k] * by_own[seen, begin + p]
                    for m in range(n_mass):
                        change[i, n_own + m] += by_reading[i, k, m] * force[seen, k]
                for q in range(2 * n, n_moving):
                    h = by_state[i, q]
                    for p in range(width):
                        change[i, p] -= h * moving[q, p]
                for c in range(n_measured):
                    change[i, first_measured + c] += by_measured[step, c, i]
        if correct:
            for k in range(n if ground else 0):
                for i in range(n):
                    by_state[i, n_moving + 2 * n + k] -= tied[k] * by_state[i, k]
            _gain(n_moving, ground, unmeasured, covariance, by_state, noise, gain, scale)
            for k in range(n if ground else 0):
                for i in range(n):
                    gain[i, k] -= tied[k] * gain[i, n_moving + 2 * n + k]
        for i in range(n):
            for q in range(i):
                white[i] -= scale[i, q] * white[q]
                for p in range(width):
                    change[i, p] -= scale[i, q] * change[q, p]
            per_scale = 1.0 / scale[i, i]
            white[i] *= per_scale
            innovation[i, step], spread[i, step] = white[i], scale[i, i]
            for p in range(width):
                change[i, p] *= per_scale
            for p in range(n_parameters):
                sensitivity[step, i, p] = change[i, p]
            for s in range(n_states):
                state[s] += gain[i, s] * white[i]
        if step == n_samples - 1:
            break

        n_steps = 1
        if n_moving > 2 * n:
            quickest = 0.0
            for q in range(n_moving - 2 * n):
                quickest = max(quickest, np.abs(evolution[seen, q, 1]))
            needed = quickest * step_s / _MOST_DECAY
            # written so that nan is many
            n_steps = 1 + int(needed) if needed < _MOST_STEPS else _MOST_STEPS
        part_s = step_s / n_steps
        for i in range(n if unmeasured else 0):
            decay[i] = np.exp(-noise[6, i] * part_s)
        for q in range(n_followed):
            for k in range(4):
                followed[0, q, k] = followed[2, q, k]
        for piece in range(n_steps):
            if n_steps > 1:
                begin, end = piece / n_steps, (piece + 1) / n_steps
                _interpolate(whole_drive, 2 * step, begin, end, part_drive)
                _interpolate(by_drive, 2 * step, begin, end, part_by_drive)
            for i in range(n):
                here[0, i], here[1, i] = state[i], state[n + i]
                if ground:
                    here[2, i], here[3, i] = state[n_moving + 2 * n + i], state[n_moving + 3 * n + i]
                for row in range(4):
                    following[row, i] = here[row, i]
            for q in range(n_moving - 2 * n):
                memory[q] = memory_next[q] = state[2 * n + q]
            for stage in range(4):
                place = 0
                for i in range(0 if stage > 0 or correct or piece > 0 else n, n):
                    z, v = here[0, i], here[1, i]
                    x = z + here[2, i] if ground else 0.0
                    force[stage, i], by_z[stage, i], by_v[stage, i], place = _joint_force(
                        joints, i, place, stage, z, v, x, by_own
                    )
                    by_z[stage, i] += linear[i, 2]
                    if n_moving > 2 * n:
                        more, slope = _remembered_force(joints, i, owns[i] + 4, stage, v, 0, memory, by_own, evolution)
                        force[stage, i] += more
                        by_v[stage, i] += slope
                weight, ahead = _STAGE_WEIGHT[stage] * part_s, _STAGE_STEP[stage] * part_s
                for q in range(n_moving - 2 * n):
                    rate = evolution[stage, q, 0]
                    memory_next[q] += weight * rate
                    memory[q] = state[2 * n + q] + ahead * rate
                for i in range(n):
                    if n_steps > 1:
                        under = part_drive[_STAGE_PLACE[stage], 0, i] + state[n_moving + i]
                    else:
                        under = drive[2 * step + _STAGE_PLACE[stage], i] + state[n_moving + i]
                    relative = -under
                    if unmeasured:
                        ends = 0.5 * _STAGE_PLACE[stage]
                        relative += (1.0 - ends + ends * decay[i]) * state[n_states - n + i]
                    for k in range(n):
                        relative -= accelerance[i, k] * force[stage, k]
                    # z before v and d before e: the rate of the first is the second, as it stands at this stage
                    following[0, i] += weight * here[1, i]
                    here[0, i] = state[i] + ahead * here[1, i]
                    following[1, i] += weight * relative
                    here[1, i] = state[n + i] + ahead * relative
                    if ground:
                        following[2, i] += weight * here[3, i]
                        here[2, i] = state[n_moving + 2 * n + i] + ahead * here[3, i]
                        following[3, i] += weight * under
                        here[3, i] = state[n_moving + 3 * n + i] + ahead * under
            for i in range(n):
                pace[0, i], pace[1, i] = state[n + i], following[1, i]
                state[i], state[n + i] = following[0, i], following[1, i]
                if unmeasured:
                    state[n_states - n + i] *= decay[i]
                if ground:
                    state[n_moving + 2 * n + i], state[n_moving + 3 * n + i] = following[2, i], following[3, i]
            for q in range(n_moving - 2 * n):
                state[2 * n + q] = memory_next[q]
            if not (correct or differentiate):
                for q in range(n_moving - 2 * n):
                    state[2 * n + q] = _confined(state[2 * n + q], joints[6][q, 1])
                continue
            if n_followed > 0:
                _follow(joints, part_s, pace[0], pace[1], followed)
                for i in range(n):
                    place = owns[i] + 4
                    for half, first, last in ((0, 0, 1), (1, 1, 3), (2, 3, 4)):
                        v = pace[0, i] + 0.5 * half * (pace[1, i] - pace[0, i])
                        _followed_forces(joints, i, place, half, first, last, v, followed, by_own)
                for q in range(n_followed if piece < n_steps - 1 else 0):
                    for k in range(4):
                        followed[0, q, k] = followed[2, q, k]

            _step_matrices(
                accelerance,
                by_z,
                by_v,
                evolution,
                owners,
                part_s,
                of_acceleration,
                of_force,
                of_memory,
                transition,
                work,
            )
            _by_offset_and_ground(
                linear,
                of_acceleration,
                of_force,
                part_s,
                ground,
                unmeasured,
                decay,
                transition,
                of_drive,
                of_push,
            )
            if differentiate:
                is_first = correct and piece == 0
                for row in range(n_moving):
                    for p in range(width):
                        carried[row, p] = 0.0
                    # of the correction z, v and h keep what the step makes of it, the others all
                    for i in range(n if is_first else 0):
                        share = _dot_of_rows(transition, row, gain, i)
                        for p in range(width):
                            carried[row, p] += share * change[i, p]
                _carry(n, transition, ground, unmeasured, moving, resting, carried)
                for s in range(n_moving, n_states if is_first else 0):
                    for i in range(n):
                        for p in range(width):
                            resting[s - n_moving, p] += gain[i, s] * change[i, p]
                place, given = (0, part_by_drive) if n_steps > 1 else (2 * step, by_drive)
                _push(owns, place, by_mass, given, force, by_own, of_acceleration, of_force, of_drive, carried)
                if n_moving > 2 * n:
                    _push_memories(joints, owns, evolution, of_memory, carried)
                if ground:
                    _carry_ground(part_s, n, resting)
                    _push_ground(place, part_s, n_own + n_mass, given, resting)
                for i in range(n if unmeasured else 0):
                    for p in range(width):
                        resting[n_states - n_moving - n + i, p] *= decay[i]
                moving, carried = carried, moving
            if correct:
                if ground:
                    _balance(part_s, tied, transition)
                _carry_covariance(
                    transition,
                    part_s,
                    n_steps,
                    ground,
                    unmeasured,
                    decay,
                    of_push,
                    noise,
                    tied,
                    covariance,
                    product,
                )
            for q in range(n_moving - 2 * n):
                row, limit = 2 * n + q, joints[6][q, 1]
                if np.abs(state[row]) > limit:
                    # what slips no longer knows where it came from
                    state[row] = limit if state[row] > 0.0 else -limit
                    for p in range(width):
                        moving[row, p] = 0.0
                    for s in range(n_states):
                        covariance[row, s] = covariance[s, row] = 0.0
    return innovation, spread, sensitivity, motion
