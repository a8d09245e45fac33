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


# Interfaces driven by measured accelerations: b = -A F(z, v, x), z' = v, v' = b - u, x' = w, w' = b.
#
# x - z does not depend on the law: (x - z)'' = u. So x = z + d, and the derivatives of d by the drive and by the start
# are sums known beforehand. What is left of each parameter p is the derivative y of (z, v). At stage s of a step it
# obeys y' = J_s y + (0, c_s), J_s = [0, 1; -A kz_s, -A kv_s] with the slopes kz, kv of the forces, and the Runge-Kutta
# step is linear in y and c:
#
#     y(next) = T y + sum_s L_s (0, c_s),   L_4 = h/6,  L_3 = h/3 + h L_4 J_4,  L_2 = h/3 + h/2 L_3 J_3,
#                                           L_1 = h/6 + h/2 L_2 J_2,            T = 1 + sum_s L_s J_s.
#
# These matrices are made once a step and serve all parameters: the derivatives are those of the steps themselves.


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


def _joint_forces(joints, z, v, x, force, slopes, by_parameter):  # type: ignore[no-untyped-def]
    """Force of every joint, its slopes by z and v, its derivatives by its own parameters."""
    by_own = by_parameter.reshape((1, by_parameter.size))
    place = 0
    for i in range(z.size):
        force[i], slopes[i, 0], slopes[i, 1], place = _joint_force(joints, i, place, 0, z[i], v[i], x[i], by_own)


def _places(joints):  # type: ignore[no-untyped-def]
    """Where the own parameters of each interface begin (k, c, g and those of its law), and whether any g is there."""
    linear, firsts, _, n_inner, _ = joints
    owns = np.zeros(firsts.size, np.int64)
    grounded = False
    for i in range(firsts.size - 1):
        owns[i + 1] = owns[i] + 3
        for row in range(firsts[i], firsts[i + 1]):
            owns[i + 1] += 1 + n_inner[row]
        grounded = grounded or linear[i, 2] != 0.0
    return owns, grounded


def _free_start(n, n_drive, grounded):  # type: ignore[no-untyped-def]
    """Derivatives of d = x - z at the stages and of d' by directions of the drive and by the start z, v, x, w."""
    n_free = n_drive + 4 * n if grounded else 0
    by_d, by_e = np.zeros((5, n_free, n)), np.zeros((n_free, n))
    if grounded:
        for i in range(n):
            for row in range(2):
                sign = 2.0 * row - 1.0
                by_d[0, n_drive + 2 * row * n + i, i] = sign
                by_e[n_drive + (2 * row + 1) * n + i, i] = sign
    return by_d, by_e


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


def _answer_sensitivity(joints, accelerance, by_mass, owns, force, by_z, by_v, by_own, y, by_d, by_force, answer, step):  # type: ignore[no-untyped-def]
    """Derivatives of the body acceleration -A F at a sample."""
    n, n_own, n_mass = by_z.shape[1], by_own.shape[1], by_mass.shape[0]
    for i in range(n):
        for p in range(y.shape[1]):
            by_force[i, p] = by_z[0, i] * y[i, p] + by_v[0, i] * y[n + i, p]
        for p in range(owns[i], owns[i + 1]):
            by_force[i, p] += by_own[0, p]
        for c in range(by_d.shape[1]):
            by_force[i, n_own + n_mass + c] += joints[0][i, 2] * by_d[0, c, i]
    for i in range(n):
        for p in range(y.shape[1]):
            total = 0.0
            for k in range(n):
                total -= accelerance[i, k] * by_force[k, p]
            answer[i, p, step] = total
        for m in range(n_mass):
            for k in range(n):
                answer[i, n_own + m, step] -= by_mass[m, i, k] * force[0, k]


def _free_motion(by_drive, step, step_s, by_d, by_e):  # type: ignore[no-untyped-def]
    """Derivatives of d at the stages of a step, (4, n_columns, n), and of d and d' after it."""
    for c in range(by_e.shape[0]):
        for i in range(by_e.shape[1]):
            first, middle, last = 0.0, 0.0, 0.0
            if c < by_drive.shape[1]:
                first, middle = by_drive[2 * step, c, i], by_drive[2 * step + 1, c, i]
                last = by_drive[2 * step + 2, c, i]
            d, e = by_d[0, c, i], by_e[c, i]
            by_d[1, c, i] = d + 0.5 * step_s * e
            by_d[2, c, i] = d + 0.5 * step_s * (e + 0.5 * step_s * first)
            by_d[3, c, i] = d + step_s * (e + 0.5 * step_s * middle)
            by_d[4, c, i] = d + step_s * (e + step_s * (first + 2.0 * middle) / 6.0)
            by_e[c, i] = e + step_s * (first + 4.0 * middle + last) / 6.0


def _step_sensitivity(  # type: ignore[no-untyped-def]
    joints, by_mass, by_drive, owns, step, force, by_own, of_acceleration, of_force, transition, y, by_d, y_next
):
    """y after the step: T y and what the parameters do at each stage."""
    n, n_own, n_mass, n_drive = force.shape[1], by_own.shape[1], by_mass.shape[0], by_drive.shape[1]
    for row in range(2 * n):
        for p in range(y.shape[1]):
            y_next[row, p] = transition[row, 0] * y[0, p]
        for column in range(1, 2 * n):
            for p in range(y.shape[1]):
                y_next[row, p] += transition[row, column] * y[column, p]
        for stage in range(4):
            for i in range(n):
                push, share = of_acceleration[stage, row, i], of_force[stage, row, i]
                for p in range(owns[i], owns[i + 1]):
                    y_next[row, p] += share * by_own[stage, p]
                for m in range(n_mass):
                    for k in range(n):
                        y_next[row, n_own + m] -= push * by_mass[m, i, k] * force[stage, k]
                for c in range(n_drive):
                    y_next[row, n_own + n_mass + c] -= push * by_drive[2 * step + _STAGE_PLACE[stage], c, i]
                for c in range(by_d.shape[1]):
                    y_next[row, n_own + n_mass + c] += share * joints[0][i, 2] * by_d[stage, c, i]


def _driven_steps(joints, accelerance, by_mass, drive, by_drive, step_s, start, ground, sensitivity):  # type: ignore[no-untyped-def]
    n = drive.shape[1]
    n_samples, n_mass, n_drive = drive.shape[0] // 2 + 1, by_mass.shape[0], by_drive.shape[1]
    owns, grounded = _places(joints)
    n_own = owns[n]
    n_parameters = n_own + n_mass + n_drive + 4 * n
    # nothing depends on the place of a body that no spring holds to the ground
    n_moving = n_parameters if grounded else n_parameters - 2 * n

    force, by_z, by_v, by_own = np.zeros((4, n)), np.zeros((4, n)), np.zeros((4, n)), np.zeros((4, n_own))
    of_acceleration, of_force = np.zeros((4, 2 * n, n)), np.zeros((4, 2 * n, n))
    transition, work = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
    y, by_force = np.zeros((2 * n, n_moving)), np.zeros((n, n_moving))
    by_d, by_e = _free_start(n, n_drive, grounded)
    for i in range(n):
        y[i, n_own + n_mass + n_drive + i] = 1.0
        y[n + i, n_own + n_mass + n_drive + n + i] = 1.0
    y_next = y.copy()

    # rows of the state: z, v, d, d'
    state = start.copy()
    state[2] -= start[0]
    state[3] -= start[1]
    here, following = state.copy(), state.copy()
    motion, answer = np.empty((2, n, n_samples)), np.empty((n, n_samples))
    by_answer = np.zeros((n, n_parameters if sensitivity else 0, n_samples))
    for step in range(n_samples):
        last = step == n_samples - 1
        for stage in range(1 if last else 4):
            place = 0
            for i in range(n):
                x = here[0, i] + here[2, i] if ground else 0.0
                force[stage, i], by_z[stage, i], by_v[stage, i], place = _joint_force(
                    joints, i, place, stage, here[0, i], here[1, i], x, by_own
                )
                # x = z + d
                by_z[stage, i] += joints[0][i, 2]
            weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
            for i in range(n):
                body = 0.0
                for k in range(n):
                    body -= accelerance[i, k] * force[stage, k]
                if stage == 0:
                    motion[0, i, step], motion[1, i, step], answer[i, step] = here[0, i], here[1, i], body
                under = drive[2 * step + _STAGE_PLACE[stage], i]
                # z before v and d before d': the rate of the first is the second, as it stands at this stage
                following[0, i] += weight * here[1, i]
                here[0, i] = state[0, i] + ahead * here[1, i]
                following[1, i] += weight * (body - under)
                here[1, i] = state[1, i] + ahead * (body - under)
                following[2, i] += weight * here[3, i]
                here[2, i] = state[2, i] + ahead * here[3, i]
                following[3, i] += weight * under
                here[3, i] = state[3, i] + ahead * under
        for row in range(4):
            for i in range(n):
                state[row, i] = here[row, i] = following[row, i]
        if sensitivity:
            _answer_sensitivity(
                joints, accelerance, by_mass, owns, force, by_z, by_v, by_own, y, by_d, by_force, by_answer, step
            )
        if sensitivity and not last:
            _step_matrices(accelerance, by_z, by_v, step_s, of_acceleration, of_force, transition, work)
            _free_motion(by_drive, step, step_s, by_d, by_e)
            _step_sensitivity(
                joints, by_mass, by_drive, owns, step, force, by_own, of_acceleration, of_force, transition, y, by_d,
                y_next,
            )  # fmt: skip
            by_d[0] = by_d[4]
            y, y_next = y_next, y
    return motion, answer, by_answer


def _driven_steps_of_one(joints, accelerance, by_mass, drive, by_drive, step_s, start, ground, sensitivity):  # type: ignore[no-untyped-def]
    """As `_driven_steps` for one interface: numbers in place of small arrays, twice as fast."""
    n_samples, n_mass, n_drive = drive.shape[0] // 2 + 1, by_mass.shape[0], by_drive.shape[1]
    owns, grounded = _places(joints)
    n_own, share, g = owns[1], accelerance[0, 0], joints[0][0, 2]
    n_parameters = n_own + n_mass + n_drive + 4
    # nothing depends on the place of a body that no spring holds to the ground
    n_moving = n_parameters if grounded else n_parameters - 2
    force, by_z, by_v, by_own = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros((4, n_own))
    of_z, of_v = np.zeros(4), np.zeros(4)
    # derivatives of z and v; accelerations that the parameters beside those of the joint cause at each stage
    y, by_body, push = np.zeros((2, n_moving)), np.zeros(n_moving), np.zeros((4, n_moving - n_own))
    y[0, n_own + n_mass + n_drive] = y[1, n_own + n_mass + n_drive + 1] = 1.0
    by_d, by_e = _free_start(1, n_drive, grounded)
    motion, answer = np.empty((2, 1, n_samples)), np.empty((1, n_samples))
    by_answer = np.zeros((1, n_parameters if sensitivity else 0, n_samples))
    z0, v0, d0, e0 = start[0, 0], start[1, 0], start[2, 0] - start[0, 0], start[3, 0] - start[1, 0]
    for step in range(n_samples):
        last = step == n_samples - 1
        z, v, d, e = z0, v0, d0, e0
        for stage in range(1 if last else 4):
            x = z + d if ground else 0.0
            total, by_z[stage], by_v[stage], _ = _joint_force(joints, 0, 0, stage, z, v, x, by_own)
            # x = z + d
            by_z[stage] += g
            force[stage], body, under = total, -share * total, drive[2 * step + _STAGE_PLACE[stage], 0]
            if stage == 0:
                motion[0, 0, step], motion[1, 0, step], answer[0, step] = z, v, body
                z1, v1, d1, e1 = z, v, d, e
            weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
            z1, v1, d1, e1 = z1 + weight * v, v1 + weight * (body - under), d1 + weight * e, e1 + weight * under
            z, v, d, e = z0 + ahead * v, v0 + ahead * (body - under), d0 + ahead * e, e0 + ahead * under
        z0, v0, d0, e0 = z1, v1, d1, e1
        if not sensitivity:
            continue
        if grounded and not last:
            _free_motion(by_drive, step, step_s, by_d, by_e)
        for stage in range(4):
            for m in range(n_mass):
                push[stage, m] = -by_mass[m, 0, 0] * force[stage]
            for c in range(n_drive):
                push[stage, n_mass + c] = -by_drive[min(2 * step + _STAGE_PLACE[stage], drive.shape[0] - 1), c, 0]
            for c in range(by_d.shape[1]):
                if c >= n_drive:
                    push[stage, n_mass + c] = 0.0
                push[stage, n_mass + c] -= share * g * by_d[stage, c, 0]
        t_zz, t_zv, t_vz, t_vv = 1.0, 0.0, 0.0, 1.0
        z_z, z_v, v_z, v_v = 0.0, 0.0, 0.0, 0.0
        for stage in range(3, -1, -1):
            weight, ahead = _STAGE_WEIGHT[stage] * step_s, _STAGE_STEP[stage] * step_s
            of_z[stage], of_v[stage] = ahead * z_v, weight + ahead * v_v
            z_v = weight + ahead * z_z - share * by_v[stage] * of_z[stage]
            v_v = ahead * v_z - share * by_v[stage] * of_v[stage]
            z_z, v_z = -share * by_z[stage] * of_z[stage], -share * by_z[stage] * of_v[stage]
            t_zz, t_zv, t_vz, t_vv = t_zz + z_z, t_zv + z_v, t_vz + v_z, t_vv + v_v
        for p in range(n_moving):
            by_body[p] = -share * (by_z[0] * y[0, p] + by_v[0] * y[1, p])
            y[0, p], y[1, p] = t_zz * y[0, p] + t_zv * y[1, p], t_vz * y[0, p] + t_vv * y[1, p]
        for p in range(n_own):
            by_body[p] -= share * by_own[0, p]
            for stage in range(4):
                y[0, p] -= share * of_z[stage] * by_own[stage, p]
                y[1, p] -= share * of_v[stage] * by_own[stage, p]
        for p in range(n_own, n_moving):
            by_body[p] += push[0, p - n_own]
            for stage in range(4):
                y[0, p] += of_z[stage] * push[stage, p - n_own]
                y[1, p] += of_v[stage] * push[stage, p - n_own]
        for c in range(n_drive):
            # the drive moves z, not the body
            by_body[n_own + n_mass + c] += by_drive[2 * step, c, 0]
        for p in range(n_moving):
            by_answer[0, p, step] = by_body[p]
        by_d[0] = by_d[4]
    return motion, answer, by_answer
