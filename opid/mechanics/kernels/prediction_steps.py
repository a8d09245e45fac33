"""Predict, correct, repeat: the filter of `opid.mechanics.driven.predict`, compiled.

The state of n interfaces has n numbers each of: z, v, [h], offset of the drive o, offset of the readings r, [d, e],
[w]. Of what the laws remember, h, there is one number for each term with memory, h' = r(h, v). d and e are there only
where a ground spring needs the position of the body: x = z + d, and d' = e, e' = u + o, which do not depend on the law.
w is the acceleration of the body by forces that nobody measured. From sample to sample it decays by a factor and is
pushed at random; between two samples it is a straight line. With b = w - A F, z' = v and v' = b - u - o, a sensor reads
b + r; a sensor that is not at its interface reads w - R F + S z + r. S is zero but for sensors of the travel.

`small_changes` has what a step does to small changes of the state, to derivatives and to the covariance.

A memory that turns over quickly needs short steps: where t |rh| is above `_MOST_DECAY`, the time from one sample to the
next is divided, and the drive between its half steps is the parabola through them.
"""

from __future__ import annotations

import numpy as np

from opid.mechanics.kernels.compilation import kernel, part, small_zeros
from opid.mechanics.kernels.small_changes import (
    _balance,
    _carry,
    _carry_covariance,
    _carry_ground,
    _compute_gain,
    _compute_step_matrices,
    _derive_by_offset_and_ground,
    _drag,
    _multiply_rows,
    _push,
    _push_ground,
    _push_memories,
    _push_slipping,
    _slip,
)
from opid.mechanics.kernels.steps import (
    _STAGE_PLACE,
    _STAGE_STEP,
    _STAGE_WEIGHT,
    _add_followed_forces,
    _compute_joint_force,
    _compute_remembered_force,
    _compute_slipping_force,
    _confine,
    _copy_followed,
    _follow,
    _list_owners,
    _list_places,
    _sum_elements,
    _sum_held,
)

# largest decay of a memory in a step, as its rate times the step; from 2.8 on the steps would grow without bound. Such
# a fast memory has nearly reached its end; after a reversal, where it matters, velocity and decay are small
_MOST_DECAY = 2.0
# largest number of steps in a sample: a memory that needs more is nearly a jump, which static laws describe
_MOST_STEPS = 30


@part(inline=True)
def _interpolate(given, start, begin, end, out):  # type: ignore[no-untyped-def]
    """Compute values of the parabola through three half steps, at the beginning, middle and end of a part of it."""
    for row in range(3):
        t = begin + 0.5 * row * (end - begin)
        first, middle, last = (2.0 * t - 1.0) * (t - 1.0), 4.0 * t * (1.0 - t), t * (2.0 * t - 1.0)
        for c in range(given.shape[1]):
            for i in range(given.shape[2]):
                out[row, c, i] = (
                    first * given[start, c, i] + middle * given[start + 1, c, i] + last * given[start + 2, c, i]
                )


@part(inline=False)
def _correct_elements(n, q, joints, white, gain, change, differentiate, pulled, held, moved):  # type: ignore[no-untyped-def]
    """Spread the correction of state q over those of its elements that did not slip."""
    memories, elements = joints[5], joints[6]
    for term in range(len(memories)):
        begin, count = memories[term, 0], memories[term, 1]
        if memories[term, 3] > 0 and memories[term, 2] == q and elements[begin, 1] < np.inf:
            total = _sum_held(elements, begin, count, held)
            for e in range(begin, begin + count if total > 0.0 else begin):
                part_of_it = held[e] / total
                for i in range(n):
                    pulled[e] += part_of_it * gain[i, 2 * n + q] * white[i]
                    for p in range(moved.shape[1] if differentiate and held[e] > 0.0 else 0):
                        moved[e, p] += part_of_it * gain[i, 2 * n + q] * change[i, p]


@part(inline=False)
def _look_ahead(joints, travels, pulled, held, at_end):  # type: ignore[no-untyped-def]
    """Compute the mean h' / v of elements that stick at the end of a step, and the part of `held` that still sticks."""
    firsts, memories, elements = joints[1], joints[5], joints[6]
    for i in range(firsts.size - 1):
        for term in range(firsts[i], firsts[i + 1]):
            begin, count, q = memories[term, 0], memories[term, 1], memories[term, 2]
            if memories[term, 3] > 0 and elements[begin, 1] < np.inf:
                total = _sum_held(elements, begin, count, held)
                _, slope, _, _, _, kept = _sum_elements(elements, begin, count, travels[4, i], pulled, held)
                at_end[q, 0], at_end[q, 1] = slope, kept / total if total > 0.0 else 0.0


@part(inline=False)
def _end_step(n, joints, travels, pulled, held, state):  # type: ignore[no-untyped-def]
    """Move the elements that slip to the end of a step, and the states that are their means."""
    firsts, memories, elements = joints[1], joints[5], joints[6]
    for i in range(n):
        for term in range(firsts[i], firsts[i + 1]):
            begin, count, q = memories[term, 0], memories[term, 1], memories[term, 2]
            if memories[term, 3] > 0 and elements[begin, 1] < np.inf:
                total = 0.0
                for e in range(begin, begin + count):
                    free = pulled[e] + elements[e, 2] * travels[4, i]
                    held[e] = elements[e, 2] if np.abs(free) < elements[e, 1] else 0.0
                    pulled[e] = _confine(free, elements[e, 1])
                    total += elements[e, 6] * pulled[e]
                state[2 * n + q] = total


@kernel(freedom="fused")
def _predict_samples(  # type: ignore[no-untyped-def]
    several, remembered, ground_is_followed, unmeasured_is_followed, joints, accelerance, by_mass, reading, by_reading,
    of_travel, drive, by_drive, measured, by_measured, step_s, start, by_start, covariance_start, noise, correct,
    differentiate,
):  # fmt: skip
    """Predict each sample from the ones before it, see `opid.mechanics.driven.predict`.

    `several` is the number of interfaces, or None for one: the compiler then knows the sizes of all small arrays and
    keeps their numbers in registers. For one interface `remembered` is a tuple with a number for each memory, or None
    without memory, and `ground_is_followed` and `unmeasured_is_followed` are True or None; for several they are empty
    and bools. Without memory numba does not compile what follows `remembered is not None`.

    The covariance is that of z + tied d, the travel about the point where both springs balance. The variance of d, and
    with it that of z, grows because no reading shows d in the long run: rounding would hide their small difference.

    Parameters are those of the joints, directions of A (the last axis of `by_mass`), of the drive and of the measured,
    then those of `by_start`.
    """
    n = 1 if several is None else several
    ground = False if ground_is_followed is None else ground_is_followed
    unmeasured = False if unmeasured_is_followed is None else unmeasured_is_followed
    owns, owners = _list_places(joints), _list_owners(joints)
    n_memories = 0 if remembered is None else len(remembered) if several is None else owners.size
    n_moving = 2 * n + n_memories
    n_states = n_moving + (4 if ground else 2) * n + (n if unmeasured else 0)
    n_samples, linear = measured.shape[0], joints[0]
    n_own, n_mass, n_drive, n_measured = owns[n], by_mass.shape[2], by_drive.shape[1], by_measured.shape[1]
    first_measured = n_own + n_mass + n_drive
    n_known = first_measured + n_measured
    n_parameters = n_known + by_start.shape[1] if differentiate else 0
    state = small_zeros(several, remembered, (n_states,))
    covariance = small_zeros(several, remembered, (n_states, n_states))
    for s in range(n_states):
        state[s] = start[s]
        for q in range(n_states):
            covariance[s, q] = covariance_start[s, q]
    # The compiler takes blocks of columns at once; unused columns fill up the last block.
    width = (n_parameters + 15) // 16 * 16
    moving, carried = np.zeros((n_moving, width)), np.zeros((n_moving, width))
    resting = np.zeros((n_states - n_moving, width))
    if differentiate:
        for c in range(by_start.shape[1]):
            for s in range(n_moving):
                moving[s, n_known + c] = by_start[s, c]
            for s in range(n_moving, n_states):
                resting[s - n_moving, n_known + c] = by_start[s, c]
    # row of the stages that the prediction fills: the last one, or the first stage itself where nothing is corrected
    seen = 4 if correct else 0
    force = small_zeros(several, remembered, (5, n))
    by_z = small_zeros(several, remembered, (5, n))
    by_v = small_zeros(several, remembered, (5, n))
    by_own = np.zeros((5, n_own))
    evolution = small_zeros(several, remembered, (5, n_memories, 8))
    of_acceleration = small_zeros(several, remembered, (4, n_moving, n))
    of_force = small_zeros(several, remembered, (4, n_moving, n))
    of_drive = small_zeros(several, remembered, (3, n_moving, n))
    of_memory = small_zeros(several, remembered, (4, n_moving, n_memories))
    transition = small_zeros(several, remembered, (n_moving, n_states))
    work = small_zeros(several, remembered, (n_moving,))
    product = small_zeros(several, remembered, (n_moving, n_states))
    by_state = small_zeros(several, remembered, (n, n_states))
    gain = small_zeros(several, remembered, (n, n_states))
    scale = small_zeros(several, remembered, (n, n))
    white, change = small_zeros(several, remembered, (n,)), np.zeros((n, width))
    here, following = small_zeros(several, remembered, (4, n)), small_zeros(several, remembered, (4, n))
    memory = small_zeros(several, remembered, (n_memories,))
    memory_next = small_zeros(several, remembered, (n_memories,))
    if remembered is not None:
        # elements that slip: h, h' / v of those that did not slip when the last step ended, and the derivatives of h
        part_drive, part_by_drive = np.zeros((3, 1, n)), np.zeros((3, n_drive, n))
        whole_drive = drive.reshape(drive.shape[0], 1, n)
        elements, n_elements = joints[6], len(joints[6]) if n_memories > 0 else 0
        pulled, held, moved = np.zeros(n_elements), np.zeros(n_elements), np.zeros((n_elements, width))
        slips = False
        for e in range(n_elements):
            held[e], slips = elements[e, 2], slips or elements[e, 1] < np.inf
        # travel of each interface since the step began, at its stages and its end; what `_look_ahead` finds at the end
        travels, at_end, before = np.zeros((5, n)), np.zeros((n_memories, 2)), np.zeros((n, width))
    # memories of faint terms, and v where a step begins and ends
    n_followed = len(joints[7])
    followed, pace = np.zeros((3, n_followed, 4)), np.zeros((2, n))
    tied = small_zeros(several, remembered, (n,))
    decay = small_zeros(several, remembered, (n,))
    of_push = small_zeros(several, remembered, (n_moving, n))
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
        for i in range(n):
            z, v = state[i], state[n + i]
            x = z + state[n_moving + 2 * n + i] if ground else 0.0
            force[seen, i], by_z[seen, i], by_v[seen, i] = _compute_joint_force(
                joints, i, owns[i], seen, z, v, x, by_own
            )
            by_z[seen, i] += linear[i, 2]
            if remembered is not None:
                if n_memories > 0:
                    more, slope = _compute_remembered_force(
                        joints, i, owns[i] + 4, seen, v, 2 * n, state, by_own, evolution
                    )
                    force[seen, i] += more
                    by_v[seen, i] += slope
                if slips:
                    more, _ = _compute_slipping_force(
                        joints, i, owns[i] + 4, seen, False, 0.0, pulled, held, by_own, evolution
                    )
                    force[seen, i] += more
        for i in range(n if n_followed > 0 else 0):
            if step == 0:
                _add_followed_forces(joints, i, owns[i] + 4, 2, seen, state[n + i], followed, by_own)
            else:
                # The last stage of the step before was at this state.
                _copy_followed(joints, i, owns[i] + 4, 3, seen, by_own)
        for i in range(n):
            body = 0.0
            for k in range(n):
                body -= reading[i, k] * force[seen, k]
                body += of_travel[i, k] * state[k]
                by_state[i, k] = of_travel[i, k] - reading[i, k] * by_z[seen, k]
                by_state[i, n + k] = -reading[i, k] * by_v[seen, k]
                if ground:
                    by_state[i, n_moving + 2 * n + k] = -reading[i, k] * linear[k, 2]
            if remembered is not None:
                for q in range(n_memories):
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
                if remembered is not None:
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
            _compute_gain(n_moving, ground, unmeasured, covariance, by_state, noise, gain, scale)
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
        if remembered is not None and slips and correct:
            for q in range(n_memories):
                _correct_elements(n, q, joints, white, gain, change, differentiate, pulled, held, moved)
        if step == n_samples - 1:
            break

        n_steps = 1
        if remembered is not None:
            quickest = 0.0
            for q in range(n_memories):
                quickest = max(quickest, np.abs(evolution[seen, q, 1]))
            needed = quickest * step_s / _MOST_DECAY
            # In this form nan gives the largest number.
            n_steps = 1 + int(needed) if needed < _MOST_STEPS else _MOST_STEPS
        part_s = step_s / n_steps
        for i in range(n if unmeasured else 0):
            decay[i] = np.exp(-noise[6, i] * part_s)
        for q in range(n_followed):
            for k in range(4):
                followed[0, q, k] = followed[2, q, k]
        for piece in range(n_steps):
            if remembered is not None and n_steps > 1:
                begin, end = piece / n_steps, (piece + 1) / n_steps
                _interpolate(whole_drive, 2 * step, begin, end, part_drive)
                _interpolate(by_drive, 2 * step, begin, end, part_by_drive)
            for i in range(n):
                here[0, i], here[1, i] = state[i], state[n + i]
                if ground:
                    here[2, i], here[3, i] = state[n_moving + 2 * n + i], state[n_moving + 3 * n + i]
                for row in range(4):
                    following[row, i] = here[row, i]
            if remembered is not None:
                for q in range(n_memories):
                    memory[q] = memory_next[q] = state[2 * n + q]
            for stage in range(4):
                for i in range(0 if stage > 0 or correct or piece > 0 else n, n):
                    z, v = here[0, i], here[1, i]
                    x = z + here[2, i] if ground else 0.0
                    force[stage, i], by_z[stage, i], by_v[stage, i] = _compute_joint_force(
                        joints, i, owns[i], stage, z, v, x, by_own
                    )
                    by_z[stage, i] += linear[i, 2]
                    if remembered is not None:
                        if n_memories > 0:
                            more, slope = _compute_remembered_force(
                                joints, i, owns[i] + 4, stage, v, 0, memory, by_own, evolution
                            )
                            force[stage, i] += more
                            by_v[stage, i] += slope
                        if slips:
                            travel = z - state[i]
                            more, slope = _compute_slipping_force(
                                joints, i, owns[i] + 4, stage, stage > 0, travel, pulled, held, by_own, evolution
                            )
                            travels[stage, i] = travel
                            force[stage, i] += more
                            by_z[stage, i] += slope
                weight, ahead = _STAGE_WEIGHT[stage] * part_s, _STAGE_STEP[stage] * part_s
                if remembered is not None:
                    for q in range(n_memories):
                        rate = evolution[stage, q, 0]
                        memory_next[q] += weight * rate
                        memory[q] = state[2 * n + q] + ahead * rate
                for i in range(n):
                    if remembered is not None and n_steps > 1:
                        under = part_drive[_STAGE_PLACE[stage], 0, i] + state[n_moving + i]
                    else:
                        under = drive[2 * step + _STAGE_PLACE[stage], i] + state[n_moving + i]
                    relative = -under
                    if unmeasured:
                        ends = 0.5 * _STAGE_PLACE[stage]
                        relative += (1.0 - ends + ends * decay[i]) * state[n_states - n + i]
                    for k in range(n):
                        relative -= accelerance[i, k] * force[stage, k]
                    # z comes before v, and d before e, because the rate of the first is the second at this stage.
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
                if remembered is not None:
                    travels[4, i] = following[0, i] - state[i]
                state[i], state[n + i] = following[0, i], following[1, i]
                if unmeasured:
                    state[n_states - n + i] *= decay[i]
                if ground:
                    state[n_moving + 2 * n + i], state[n_moving + 3 * n + i] = following[2, i], following[3, i]
            if remembered is not None:
                for q in range(n_memories):
                    state[2 * n + q] = memory_next[q]
                if slips:
                    _look_ahead(joints, travels, pulled, held, at_end)
                    if not (correct or differentiate):
                        _end_step(n, joints, travels, pulled, held, state)
            if not (correct or differentiate):
                continue
            if n_followed > 0:
                _follow(joints, part_s, pace[0], pace[1], followed)
                for i in range(n):
                    for half, stage in ((0, 0), (1, 1), (2, 3)):
                        v = pace[0, i] + 0.5 * half * (pace[1, i] - pace[0, i])
                        _add_followed_forces(joints, i, owns[i] + 4, half, stage, v, followed, by_own)
                    # Both stages in the middle have the same memories.
                    _copy_followed(joints, i, owns[i] + 4, 1, 2, by_own)
                for q in range(n_followed if piece < n_steps - 1 else 0):
                    for k in range(4):
                        followed[0, q, k] = followed[2, q, k]

            _compute_step_matrices(
                accelerance, by_z, by_v, evolution, owners, part_s,
                of_acceleration, of_force, of_memory, transition, work,
            )  # fmt: skip
            if remembered is not None and slips:
                _slip(joints, evolution, at_end, of_acceleration, of_force, transition)
            _derive_by_offset_and_ground(
                linear, of_acceleration, of_force, part_s, ground, unmeasured, decay, transition, of_drive, of_push
            )
            if differentiate:
                is_first = correct and piece == 0
                for row in range(n_moving):
                    for p in range(width):
                        carried[row, p] = 0.0
                    # The step transforms the correction of z, v and h; the other states keep theirs.
                    for i in range(n if is_first else 0):
                        coefficient = _multiply_rows(transition, row, gain, i)
                        for p in range(width):
                            carried[row, p] += coefficient * change[i, p]
                _carry(n, transition, ground, unmeasured, moving, resting, carried)
                for s in range(n_moving, n_states if is_first else 0):
                    for i in range(n):
                        for p in range(width):
                            resting[s - n_moving, p] += gain[i, s] * change[i, p]
                if remembered is not None and n_steps > 1:
                    half_step, given = 0, part_by_drive
                else:
                    half_step, given = 2 * step, by_drive
                _push(owns, half_step, by_mass, given, force, by_own, of_acceleration, of_force, of_drive, carried)
                if remembered is not None:
                    if n_memories > 0:
                        _push_memories(joints, owns, evolution, of_memory, carried)
                    if slips:
                        for i in range(n):
                            for p in range(width):
                                before[i, p] = moving[i, p]
                            for k in range(n if is_first else 0):
                                for p in range(width):
                                    before[i, p] += gain[k, i] * change[k, p]
                        _push_slipping(n, joints, evolution, travels, pulled, of_force, moved, carried)
                        _drag(n, joints, owns, travels, pulled, before, moved, carried)
                if ground:
                    _carry_ground(part_s, n, resting)
                    _push_ground(half_step, part_s, n_own + n_mass, given, resting)
                for i in range(n if unmeasured else 0):
                    for p in range(width):
                        resting[n_states - n_moving - n + i, p] *= decay[i]
                moving, carried = carried, moving
            if correct:
                if ground:
                    _balance(part_s, tied, transition)
                _carry_covariance(
                    transition, part_s, n_steps, ground, unmeasured, decay, of_push, noise, tied, covariance, product
                )
            if remembered is not None and slips:
                _end_step(n, joints, travels, pulled, held, state)
    return innovation, spread, sensitivity, motion
