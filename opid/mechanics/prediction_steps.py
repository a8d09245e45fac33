"""Predict, correct, repeat: the filter of `opid.mechanics.prediction` as plain functions, for `kernels` to compile."""

from __future__ import annotations

import numpy as np

from opid.mechanics.steps import _STAGE_PLACE, _STAGE_STEP, _STAGE_WEIGHT, _joint_forces, _places


def _answer_of(joints, accelerance, state, n, ground, force, slopes, by_parameter, body, by_state):  # type: ignore[no-untyped-def]
    """Acceleration of the body at each interface and its derivatives by the state."""
    moving = (4 if ground else 2) * n
    still = state[moving : moving + n]
    place_of_body = state[2 * n : 3 * n] if ground else still
    _joint_forces(joints, state[:n], state[n : 2 * n], place_of_body, force, slopes, by_parameter)
    for i in range(n):
        body[i] = 0.0
        for k in range(n):
            body[i] -= accelerance[i, k] * force[k]
            by_state[i, k] = -accelerance[i, k] * slopes[k, 0]
            by_state[i, n + k] = -accelerance[i, k] * slopes[k, 1]
            if ground:
                by_state[i, 2 * n + k] = -accelerance[i, k] * joints[0][k, 2]


def _correct_by(state, by, covariance, by_state, noise, moving, n, innovation, change, scale, gain):  # type: ignore[no-untyped-def]
    """Whiten the innovation and correct the state by it (Cholesky form of the Kalman update).

    `innovation` and its derivatives `change` come in raw and leave white; the gain is not differentiated: at the
    optimum the innovation is uncorrelated with what the gain multiplies.
    """
    n_states, n_parameters = state.size, by.shape[1]
    for s in range(n_states):
        for i in range(n):
            share = covariance[s, moving + n + i]
            for q in range(moving):
                share += covariance[s, q] * by_state[i, q]
            gain[s, i] = share
    for i in range(n):
        for k in range(i + 1):
            variance = gain[moving + n + i, k]
            for s in range(moving):
                variance += by_state[i, s] * gain[s, k]
            if i == k:
                variance += noise[1, i] ** 2
            for q in range(k):
                variance -= scale[i, q] * scale[k, q]
            scale[i, k] = np.sqrt(variance) if i == k else variance / scale[k, k]
    for i in range(n):
        per_scale = 1.0 / scale[i, i]
        for q in range(i):
            for s in range(n_states):
                gain[s, i] -= gain[s, q] * scale[i, q]
            innovation[i] -= scale[i, q] * innovation[q]
            for p in range(n_parameters):
                change[i, p] -= scale[i, q] * change[q, p]
        innovation[i] *= per_scale
        for p in range(n_parameters):
            change[i, p] *= per_scale
        for s in range(n_states):
            gain[s, i] *= per_scale
    for s in range(n_states):
        for i in range(n):
            share = gain[s, i]
            state[s] += share * innovation[i]
            for p in range(n_parameters):
                by[s, p] += share * change[i, p]
            for q in range(n_states):
                covariance[s, q] -= share * gain[q, i]


def _predictions(  # type: ignore[no-untyped-def]
    joints, accelerance, by_mass, drive, by_drive, measured, by_measured, step_s, start, covariance_start, noise, ground,
    differentiate,
):  # fmt: skip
    """Predict each sample from the ones before it, see `opid.mechanics.prediction`.

    State: z, v, [x, w], offset of the drive, offset of the measured, n of each. Parameters: those of the joints,
    directions of A, of the drive, of the measured, then the moving part of the start. `noise` rows: of the drive, of
    the measured, and what the two offsets walk in a step.

    All derivatives obey one linear system, so its step is built once: `step_by` holds the derivatives of the moving
    state after a Runge-Kutta step by that before it, then by a force on the body (as an acceleration) in each stage,
    then by the drive in each stage (the same with the other sign where no ground spring tells them apart).
    """
    n, n_samples = drive.shape[1], measured.shape[0]
    linear = joints[0]
    moving = (4 if ground else 2) * n
    n_states = moving + 2 * n
    owns, _ = _places(joints)
    n_joint = owns[n]
    n_mass, n_drive, n_measured = by_mass.shape[0], by_drive.shape[1], by_measured.shape[1]
    n_known = n_joint + n_mass + n_drive + n_measured
    n_parameters = n_known + moving if differentiate else 0
    owner = np.zeros(n_joint, np.int64)
    for i in range(n):
        owner[owns[i] : owns[i + 1]] = i

    state, covariance = start.copy(), covariance_start.copy()
    by, by_next = np.zeros((n_states, n_parameters)), np.zeros((moving, n_parameters))
    if differentiate:
        for s in range(moving):
            by[s, n_known + s] = 1.0
    force, slopes, by_parameter = np.zeros(n), np.zeros((n, 2)), np.zeros(n_joint)
    stage_force, stage_by_parameter = np.zeros((4, n)), np.zeros((4, n_joint))
    body, by_state = np.zeros(n), np.zeros((n, moving))
    raw, change = np.zeros(n), np.zeros((n, n_parameters))
    scale, gain = np.zeros((n, n)), np.zeros((n_states, n))
    n_columns = moving + 4 * n * (2 if ground else 1)
    here, following = np.zeros(moving), np.zeros(moving)
    by_here, step_by, by_force = np.zeros((moving, n_columns)), np.zeros((moving, n_columns)), np.zeros((n, n_columns))
    by_joint, by_offset = np.zeros((4, moving, n)), np.zeros((moving, n))
    product = np.zeros((n_states, n_states))
    innovation, spread = np.empty((n, n_samples)), np.empty((n, n_samples))
    sensitivity, motion = np.empty((n, n_parameters, n_samples)), np.empty((n_samples, 3, n))

    for step in range(n_samples):
        _answer_of(joints, accelerance, state, n, ground, force, slopes, by_parameter, body, by_state)
        for i in range(n):
            motion[step, 0, i], motion[step, 1, i], motion[step, 2, i] = state[i], state[n + i], body[i]
            raw[i] = measured[step, i] - body[i] - state[moving + n + i]
            if differentiate:
                for p in range(n_parameters):
                    total = by[moving + n + i, p]
                    for s in range(moving):
                        total += by_state[i, s] * by[s, p]
                    change[i, p] = -total
                for p in range(n_joint):
                    change[i, p] += accelerance[i, owner[p]] * by_parameter[p]
                for m in range(n_mass):
                    for k in range(n):
                        change[i, n_joint + m] += by_mass[m, i, k] * force[k]
                for y in range(n_measured):
                    change[i, n_joint + n_mass + n_drive + y] += by_measured[step, y, i]
        _correct_by(state, by, covariance, by_state, noise, moving, n, raw, change, scale, gain)
        for i in range(n):
            innovation[i, step], spread[i, step] = raw[i], scale[i, i]
            for p in range(n_parameters):
                sensitivity[i, p, step] = change[i, p]
        if step == n_samples - 1:
            break

        for s in range(moving):
            here[s] = following[s] = state[s]
            for c in range(n_columns):
                by_here[s, c] = step_by[s, c] = 1.0 if s == c else 0.0
        for stage in range(4):
            half_step = 2 * step + _STAGE_PLACE[stage]
            place_of_body = here[2 * n : 3 * n] if ground else body
            _joint_forces(joints, here[:n], here[n : 2 * n], place_of_body, force, slopes, stage_by_parameter[stage])
            weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
            for i in range(n):
                stage_force[stage, i] = force[i]
                for c in range(n_columns):
                    by_force[i, c] = slopes[i, 0] * by_here[i, c] + slopes[i, 1] * by_here[n + i, c]
                    if ground:
                        by_force[i, c] += linear[i, 2] * by_here[2 * n + i, c]
            for i in range(n):
                acceleration = 0.0
                for k in range(n):
                    acceleration -= accelerance[i, k] * force[k]
                relative = acceleration - drive[half_step, i] - state[moving + i]
                # z before v and x before w: the rate of the first is the second, as it stands at this stage
                following[i] += weight * here[n + i]
                here[i] = state[i] + ahead * here[n + i]
                following[n + i] += weight * relative
                here[n + i] = state[n + i] + ahead * relative
                if ground:
                    following[2 * n + i] += weight * here[3 * n + i]
                    here[2 * n + i] = state[2 * n + i] + ahead * here[3 * n + i]
                    following[3 * n + i] += weight * acceleration
                    here[3 * n + i] = state[3 * n + i] + ahead * acceleration
                for c in range(n_columns):
                    by_body = 0.0
                    for k in range(n):
                        by_body -= accelerance[i, k] * by_force[k, c]
                    if c == moving + stage * n + i:
                        by_body += 1.0
                    by_relative = by_body
                    if ground and c == moving + (4 + stage) * n + i:
                        by_relative -= 1.0
                    first = 1.0 if c == i else 0.0
                    second = 1.0 if c == n + i else 0.0
                    step_by[i, c] += weight * by_here[n + i, c]
                    by_here[i, c] = first + ahead * by_here[n + i, c]
                    step_by[n + i, c] += weight * by_relative
                    by_here[n + i, c] = second + ahead * by_relative
                    if ground:
                        third = 1.0 if c == 2 * n + i else 0.0
                        fourth = 1.0 if c == 3 * n + i else 0.0
                        step_by[2 * n + i, c] += weight * by_here[3 * n + i, c]
                        by_here[2 * n + i, c] = third + ahead * by_here[3 * n + i, c]
                        step_by[3 * n + i, c] += weight * by_body
                        by_here[3 * n + i, c] = fourth + ahead * by_body

        of_drive, sign = (moving + 4 * n, 1.0) if ground else (moving, -1.0)
        for s in range(moving):
            state[s] = following[s]
            for i in range(n):
                by_offset[s, i] = 0.0
                for stage in range(4):
                    by_offset[s, i] += sign * step_by[s, of_drive + stage * n + i]
                    by_joint[stage, s, i] = 0.0
                    for k in range(n):
                        by_joint[stage, s, i] -= step_by[s, moving + stage * n + k] * accelerance[k, i]
        if differentiate:
            for s in range(moving):
                for p in range(n_parameters):
                    total = 0.0
                    for q in range(moving):
                        total += step_by[s, q] * by[q, p]
                    for i in range(n):
                        total += by_offset[s, i] * by[moving + i, p]
                    by_next[s, p] = total
                for stage in range(4):
                    for p in range(n_joint):
                        by_next[s, p] += by_joint[stage, s, owner[p]] * stage_by_parameter[stage, p]
                    half_step = 2 * step + _STAGE_PLACE[stage]
                    for i in range(n):
                        on_body = step_by[s, moving + stage * n + i]
                        for m in range(n_mass):
                            for k in range(n):
                                by_next[s, n_joint + m] -= on_body * by_mass[m, i, k] * stage_force[stage, k]
                        of_stage = sign * step_by[s, of_drive + stage * n + i]
                        for d in range(n_drive):
                            by_next[s, n_joint + n_mass + d] += of_stage * by_drive[half_step, d, i]
            for s in range(moving):
                for p in range(n_parameters):
                    by[s, p] = by_next[s, p]

        # P = Phi P Phi' + Q, the moving rows, then the moving columns
        for s in range(moving):
            for q in range(n_states):
                total = 0.0
                for k in range(moving):
                    total += step_by[s, k] * covariance[k, q]
                for i in range(n):
                    total += by_offset[s, i] * covariance[moving + i, q]
                product[s, q] = total
        for s in range(moving):
            for q in range(n_states):
                covariance[s, q] = product[s, q]
        for s in range(n_states):
            for q in range(moving):
                total = 0.0
                for k in range(moving):
                    total += covariance[s, k] * step_by[q, k]
                for i in range(n):
                    total += covariance[s, moving + i] * by_offset[q, i]
                product[s, q] = total
        for s in range(n_states):
            for q in range(moving):
                covariance[s, q] = product[s, q]
        for i in range(n):
            for s in range(moving):
                for q in range(moving):
                    covariance[s, q] += noise[0, i] ** 2 * by_offset[s, i] * by_offset[q, i]
            covariance[moving + i, moving + i] += noise[2, i] ** 2
            covariance[moving + n + i, moving + n + i] += noise[3, i] ** 2
    return innovation, spread, sensitivity, motion
