"""Predict, correct, repeat: the filter of `opid.mechanics.prediction` as plain functions, for `kernels` to compile.

State of n interfaces, n numbers each: z, v, offset of the drive o, offset of the readings r, [d, e]. The last two only
where a ground spring needs the place of the body: x = z + d, and d' = e, e' = u + o know nothing of the law. With
b = -A F, z' = v and v' = b - u - o, a sensor reads b + r; one that sits beside its interface reads -R F + r.

A small change y of (z, v) obeys y' = J_s y + (0, c_s) at stage s of a step, J_s = [0, 1; -A kz_s, -A kv_s] with the
slopes kz, kv of the forces, and the classical Runge-Kutta step is linear in y and c:

    y(next) = T y + sum_s L_s (0, c_s),   L_4 = h/6,  L_3 = h/3 + h L_4 J_4,  L_2 = h/3 + h/2 L_3 J_3,
                                          L_1 = h/6 + h/2 L_2 J_2,            T = 1 + sum_s L_s J_s.

These matrices are made once a step and serve all parameters and the covariance: the derivatives are those of the steps
themselves, with the gain of the correction held fixed.
"""

from __future__ import annotations

import numpy as np

from opid.mechanics.steps import _STAGE_PLACE, _STAGE_STEP, _STAGE_WEIGHT, _joint_force, _places


def _step_matrices(accelerance, by_z, by_v, step_s, of_acceleration, of_force, transition, work):  # type: ignore[no-untyped-def]
    """T; what a body acceleration at a stage does to (z, v) after the step, L_s (0, 1); and a joint force, L_s (0, -A).

    From the last stage to the first, one row of L_s J_s in `work` at a time.
    """
    n = by_z.shape[1]
    for row in range(2 * n):
        for column in range(2 * n):
            transition[row, column] = 1.0 if row == column else 0.0
            work[column] = 0.0
        for stage in range(3, -1, -1):
            weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
            for i in range(n):
                work[i] = ahead * work[i] + (weight if row == i else 0.0)
                of_acceleration[stage, row, i] = ahead * work[n + i] + (weight if row == n + i else 0.0)
            for i in range(n):
                share = 0.0
                for k in range(n):
                    share -= of_acceleration[stage, row, k] * accelerance[k, i]
                of_force[stage, row, i] = share
                work[n + i] = work[i] + share * by_v[stage, i]
                work[i] = share * by_z[stage, i]
                transition[row, i] += work[i]
                transition[row, n + i] += work[n + i]


def _by_offset_and_ground(linear, of_acceleration, of_force, step_s, ground, transition, of_drive):  # type: ignore[no-untyped-def]
    """What the drive at each half step does to (z, v), by itself and by d of later stages; columns of o, d and e."""
    n = linear.shape[0]
    for row in range(2 * n):
        for i in range(n):
            g = linear[i, 2]
            first, second = of_force[0, row, i], of_force[1, row, i]
            third, fourth = of_force[2, row, i], of_force[3, row, i]
            of_drive[0, row, i] = -of_acceleration[0, row, i] + 0.25 * step_s * step_s * g * third
            of_drive[1, row, i] = (
                -of_acceleration[1, row, i] - of_acceleration[2, row, i] + 0.5 * step_s * step_s * g * fourth
            )
            of_drive[2, row, i] = -of_acceleration[3, row, i]
            transition[row, 2 * n + i] = of_drive[0, row, i] + of_drive[1, row, i] + of_drive[2, row, i]
            if ground:
                transition[row, 4 * n + i] = g * (first + second + third + fourth)
                transition[row, 5 * n + i] = g * step_s * (0.5 * (second + third) + fourth)


def _carry(transition, step_s, ground, columns, carried):  # type: ignore[no-untyped-def]
    """carried = Phi columns; `transition` holds the rows of Phi for z and v, the others are known beforehand."""
    m, n = columns.shape[1], transition.shape[0] // 2
    for row in range(2 * n):
        for c in range(m):
            carried[row, c] = 0.0
        for i in range(n):
            # an offset of the readings moves nothing
            z, v, o = transition[row, i], transition[row, n + i], transition[row, 2 * n + i]
            for c in range(m):
                carried[row, c] += z * columns[i, c] + v * columns[n + i, c] + o * columns[2 * n + i, c]
            if ground:
                d, e = transition[row, 4 * n + i], transition[row, 5 * n + i]
                for c in range(m):
                    carried[row, c] += d * columns[4 * n + i, c] + e * columns[5 * n + i, c]
    for s in range(2 * n, 4 * n):
        for c in range(m):
            carried[s, c] = columns[s, c]
    if ground:
        for i in range(n):
            for c in range(m):
                e, o = columns[5 * n + i, c], columns[2 * n + i, c]
                carried[4 * n + i, c] = columns[4 * n + i, c] + step_s * (e + 0.5 * step_s * o)
                carried[5 * n + i, c] = e + step_s * o


def _carry_covariance(transition, step_s, ground, noise, covariance, product, transposed):  # type: ignore[no-untyped-def]
    """P = Phi P Phi' + Q; noise of the drive acts like an offset that lasts a step."""
    n_states, n = covariance.shape[0], noise.shape[1]
    _carry(transition, step_s, ground, covariance, product)
    for s in range(n_states):
        for q in range(n_states):
            transposed[q, s] = product[s, q]
    _carry(transition, step_s, ground, transposed, product)
    for i in range(n):
        variance = noise[0, i] ** 2
        for s in range(n_states):
            transposed[0, s] = transition[s, 2 * n + i] if s < 2 * n else 0.0
        if ground:
            transposed[0, 4 * n + i], transposed[0, 5 * n + i] = 0.5 * step_s * step_s, step_s
        for s in range(n_states):
            share = variance * transposed[0, s]
            for q in range(n_states):
                product[s, q] += share * transposed[0, q]
        product[2 * n + i, 2 * n + i] += noise[2, i] ** 2
        product[3 * n + i, 3 * n + i] += noise[3, i] ** 2
    for s in range(n_states):
        for q in range(s + 1):
            covariance[s, q] = covariance[q, s] = product[s, q]


def _balance(step_s, tied, transition):  # type: ignore[no-untyped-def]
    """The transition with z + tied d in place of z."""
    n = tied.size
    for i in range(n):
        transition[i, 2 * n + i] += 0.5 * step_s * step_s * tied[i]
        transition[i, 4 * n + i] += tied[i]
        transition[i, 5 * n + i] += step_s * tied[i]
    for row in range(2 * n):
        for i in range(n):
            transition[row, 4 * n + i] -= tied[i] * transition[row, i]


def _gain(covariance, by_state, noise, gain, scale):  # type: ignore[no-untyped-def]
    """Gain K of the white innovation, lower Cholesky factor of the covariance of the raw one, and P - K K'."""
    n, n_states = by_state.shape
    for i in range(n):
        for s in range(n_states):
            gain[i, s] = covariance[3 * n + i, s]
        for q in range(n_states):
            share = by_state[i, q]
            # of the offsets of the readings each interface sees its own
            if share != 0.0 and not 3 * n <= q < 4 * n:
                for s in range(n_states):
                    gain[i, s] += share * covariance[q, s]
    for i in range(n):
        for k in range(i + 1):
            variance = noise[1, i] ** 2 if i == k else 0.0
            for s in range(n_states):
                variance += by_state[i, s] * gain[k, s]
            for q in range(k):
                variance -= scale[i, q] * scale[k, q]
            scale[i, k] = np.sqrt(variance) if i == k else variance / scale[k, k]
    for i in range(n):
        per_scale = 1.0 / scale[i, i]
        for q in range(i):
            for s in range(n_states):
                gain[i, s] -= scale[i, q] * gain[q, s]
        for s in range(n_states):
            gain[i, s] *= per_scale
        for s in range(n_states):
            for q in range(n_states):
                covariance[s, q] -= gain[i, s] * gain[i, q]


def _correct(gain, innovation, change, state, by):  # type: ignore[no-untyped-def]
    """Correct the state and its derivatives by the white innovation."""
    n, n_states = gain.shape
    for i in range(n):
        for s in range(n_states):
            share = gain[i, s]
            state[s] += share * innovation[i]
            for p in range(by.shape[1]):
                by[s, p] += share * change[i, p]


def _push(owns, step, step_s, ground, by_mass, by_drive, force, by_own, of_acceleration, of_force, of_drive, body, by):  # type: ignore[no-untyped-def]
    """What the parameters themselves do to the state in a step; `body` is room for what they do to the body."""
    n, n_own, n_mass, n_drive = force.shape[1], by_own.shape[1], by_mass.shape[2], by_drive.shape[1]
    for stage in range(4):
        for i in range(n):
            for m in range(n_mass):
                body[stage, i, m] = 0.0
            for k in range(n):
                share = force[stage, k]
                for m in range(n_mass):
                    body[stage, i, m] += by_mass[i, k, m] * share
    for row in range(2 * n):
        for stage in range(4):
            for i in range(n):
                share, on_body = of_force[stage, row, i], of_acceleration[stage, row, i]
                for p in range(owns[i], owns[i + 1]):
                    by[row, p] += share * by_own[stage, p]
                for m in range(n_mass):
                    by[row, n_own + m] -= on_body * body[stage, i, m]
        for half in range(3):
            for c in range(n_drive):
                for i in range(n):
                    by[row, n_own + n_mass + c] += of_drive[half, row, i] * by_drive[2 * step + half, c, i]
    if ground:
        for c in range(n_drive):
            for i in range(n):
                first, middle = by_drive[2 * step, c, i], by_drive[2 * step + 1, c, i]
                last = by_drive[2 * step + 2, c, i]
                by[4 * n + i, n_own + n_mass + c] += step_s * step_s * (first + 2.0 * middle) / 6.0
                by[5 * n + i, n_own + n_mass + c] += step_s * (first + 4.0 * middle + last) / 6.0


def _predictions(  # type: ignore[no-untyped-def]
    joints, accelerance, by_mass, reading, by_reading, drive, by_drive, measured, by_measured, step_s, start, by_start,
    covariance_start, noise, ground, correct, differentiate,
):  # fmt: skip
    """Predict each sample from the ones before it, see `opid.mechanics.prediction`.

    Parameters: those of the joints, directions of A (the last axis of `by_mass`), of the drive, of the measured, then
    those of `by_start`.
    """
    n, n_samples, n_states, linear = drive.shape[1], measured.shape[0], start.size, joints[0]
    owns = _places(joints)
    n_own, n_mass, n_drive, n_measured = owns[n], by_mass.shape[2], by_drive.shape[1], by_measured.shape[1]
    first_measured = n_own + n_mass + n_drive
    n_known = first_measured + n_measured
    n_parameters = n_known + by_start.shape[1] if differentiate else 0
    state, covariance = start.copy(), covariance_start.copy()
    by = np.zeros((n_states, n_parameters))
    if differentiate:
        for s in range(n_states):
            for c in range(by_start.shape[1]):
                by[s, n_known + c] = by_start[s, c]
    by_next = by.copy()
    # of the rows of the stages the last is that of the prediction, which is the first stage where nothing is corrected
    seen = 4 if correct else 0
    force, by_z, by_v, by_own = np.zeros((5, n)), np.zeros((5, n)), np.zeros((5, n)), np.zeros((5, n_own))
    of_acceleration, of_force, of_drive = np.zeros((4, 2 * n, n)), np.zeros((4, 2 * n, n)), np.zeros((3, 2 * n, n))
    transition, work = np.zeros((2 * n, n_states)), np.zeros(2 * n)
    body_by_mass = np.zeros((4, n, n_mass))
    product, transposed = np.zeros((n_states, n_states)), np.zeros((n_states, n_states))
    by_state, gain, scale = np.zeros((n, n_states)), np.zeros((n, n_states)), np.zeros((n, n))
    white, change = np.zeros(n), np.zeros((n, n_parameters))
    here, following = np.zeros((4, n)), np.zeros((4, n))
    # The covariance is that of z + tied d, travel about the place where both springs balance. By itself d grows, for no
    # reading sees it in the long run, and with it z: their small difference would drown.
    tied, place = np.zeros(n), 0
    for i in range(n):
        by_state[i, 3 * n + i], scale[i, i] = 1.0, noise[1, i]
        if ground:
            _, slope, _, place = _joint_force(joints, i, place, 0, 0.0, 0.0, 0.0, by_own)
            if slope + linear[i, 2] > 0.0:
                tied[i] = linear[i, 2] / (slope + linear[i, 2])
            for s in range(n_states):
                covariance[i, s] += tied[i] * covariance[4 * n + i, s]
            for s in range(n_states):
                covariance[s, i] += tied[i] * covariance[s, 4 * n + i]
    innovation, spread = np.empty((n, n_samples)), np.empty((n, n_samples))
    sensitivity, motion = np.empty((n_samples, n, n_parameters)), np.empty((3, n, n_samples))

    for step in range(n_samples):
        place = 0
        for i in range(n):
            z, v = state[i], state[n + i]
            x = z + state[4 * n + i] if ground else 0.0
            force[seen, i], by_z[seen, i], by_v[seen, i], place = _joint_force(joints, i, place, seen, z, v, x, by_own)
            by_z[seen, i] += linear[i, 2]
        for i in range(n):
            body = 0.0
            for k in range(n):
                body -= reading[i, k] * force[seen, k]
                by_state[i, k] = -reading[i, k] * by_z[seen, k]
                by_state[i, n + k] = -reading[i, k] * by_v[seen, k]
                if ground:
                    by_state[i, 4 * n + k] = -reading[i, k] * linear[k, 2]
            motion[0, i, step], motion[1, i, step], motion[2, i, step] = state[i], state[n + i], body
            white[i] = measured[step, i] - body - state[3 * n + i]
        if differentiate:
            for i in range(n):
                for p in range(n_parameters):
                    change[i, p] = -by[3 * n + i, p]
                for k in range(n):
                    z, v = by_state[i, k], by_state[i, n + k]
                    for p in range(n_parameters):
                        change[i, p] -= z * by[k, p] + v * by[n + k, p]
                    if ground:
                        d = by_state[i, 4 * n + k]
                        for p in range(n_parameters):
                            change[i, p] -= d * by[4 * n + k, p]
                    for p in range(owns[k], owns[k + 1]):
                        change[i, p] += reading[i, k] * by_own[seen, p]
                    for m in range(n_mass):
                        change[i, n_own + m] += by_reading[i, k, m] * force[seen, k]
                for c in range(n_measured):
                    change[i, first_measured + c] += by_measured[step, c, i]
        if correct:
            for k in range(n if ground else 0):
                for i in range(n):
                    by_state[i, 4 * n + k] -= tied[k] * by_state[i, k]
            _gain(covariance, by_state, noise, gain, scale)
            for k in range(n if ground else 0):
                for i in range(n):
                    gain[i, k] -= tied[k] * gain[i, 4 * n + k]
        for i in range(n):
            for q in range(i):
                white[i] -= scale[i, q] * white[q]
                for p in range(n_parameters):
                    change[i, p] -= scale[i, q] * change[q, p]
            white[i] /= scale[i, i]
            innovation[i, step], spread[i, step] = white[i], scale[i, i]
            per_scale = 1.0 / scale[i, i]
            for p in range(n_parameters):
                change[i, p] *= per_scale
                sensitivity[step, i, p] = change[i, p]
        if correct:
            _correct(gain, white, change, state, by)
        if step == n_samples - 1:
            break

        for i in range(n):
            here[0, i], here[1, i] = state[i], state[n + i]
            if ground:
                here[2, i], here[3, i] = state[4 * n + i], state[5 * n + i]
            for row in range(4):
                following[row, i] = here[row, i]
        for stage in range(4):
            place = 0
            for i in range(0 if stage > 0 or correct else n, n):
                z, v = here[0, i], here[1, i]
                x = z + here[2, i] if ground else 0.0
                force[stage, i], by_z[stage, i], by_v[stage, i], place = _joint_force(
                    joints, i, place, stage, z, v, x, by_own
                )
                by_z[stage, i] += linear[i, 2]
            weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
            for i in range(n):
                under = drive[2 * step + _STAGE_PLACE[stage], i] + state[2 * n + i]
                relative = -under
                for k in range(n):
                    relative -= accelerance[i, k] * force[stage, k]
                # z before v and d before e: the rate of the first is the second, as it stands at this stage
                following[0, i] += weight * here[1, i]
                here[0, i] = state[i] + ahead * here[1, i]
                following[1, i] += weight * relative
                here[1, i] = state[n + i] + ahead * relative
                if ground:
                    following[2, i] += weight * here[3, i]
                    here[2, i] = state[4 * n + i] + ahead * here[3, i]
                    following[3, i] += weight * under
                    here[3, i] = state[5 * n + i] + ahead * under
        for i in range(n):
            state[i], state[n + i] = following[0, i], following[1, i]
            if ground:
                state[4 * n + i], state[5 * n + i] = following[2, i], following[3, i]
        if not (correct or differentiate):
            continue

        _step_matrices(accelerance, by_z, by_v, step_s, of_acceleration, of_force, transition, work)
        _by_offset_and_ground(linear, of_acceleration, of_force, step_s, ground, transition, of_drive)
        if differentiate:
            _carry(transition, step_s, ground, by, by_next)
            _push(
                owns,
                step,
                step_s,
                ground,
                by_mass,
                by_drive,
                force,
                by_own,
                of_acceleration,
                of_force,
                of_drive,
                body_by_mass,
                by_next,
            )
            by, by_next = by_next, by
        if correct:
            if ground:
                _balance(step_s, tied, transition)
            _carry_covariance(transition, step_s, ground, noise, covariance, product, transposed)
    return innovation, spread, sensitivity, motion
