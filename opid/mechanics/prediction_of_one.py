"""The filter of `opid.mechanics.prediction_steps` for one interface: numbers in place of small arrays.

State z, v, offset of the drive o, offset of the readings r, [d, e] with x = z + d; numbers of the covariance P are
named by the two states they belong to. `ground` is None where the last two are left out: the compiler then makes a
kernel without them.
"""

from __future__ import annotations

import numpy as np

from opid.mechanics.steps import _STAGE_STEP, _STAGE_WEIGHT, _joint_force, _places


def _carried(ground, transition, z, v, o, d, e):  # type: ignore[no-untyped-def]
    """What a step makes of small changes of the state."""
    zz, zv, zo, zd, ze, vz, vv, vo, vd, ve, h = transition
    z, v = zz * z + zv * v + zo * o, vz * z + vv * v + vo * o
    if ground is None:
        return z, v, d, e
    return z + zd * d + ze * e, v + vd * d + ve * e, d + h * (e + 0.5 * h * o), e + h * o


def _carried_covariance(ground, transition, covariance, disturbances):  # type: ignore[no-untyped-def]
    """Phi P Phi' + Q; noise of the drive acts like an offset that lasts a step."""
    zz, zv, zo, zr, zd, ze, vv, vo, vr, vd, ve, oo, orr, od, oe, rr, rd, re, dd, de, ee = covariance
    zz_, vz_, dz_, ez_ = _carried(ground, transition, zz, zv, zo, zd, ze)
    zv_, vv_, dv_, ev_ = _carried(ground, transition, zv, vv, vo, vd, ve)
    zd_, vd_, dd_, ed_ = _carried(ground, transition, zd, vd, od, dd, de)
    ze_, ve_, de_, ee_ = _carried(ground, transition, ze, ve, oe, de, ee)
    zo, vo, od, oe = _carried(ground, transition, zo, vo, oo, od, oe)
    zr, vr, rd, re = _carried(ground, transition, zr, vr, orr, rd, re)
    zn, vn, dn, en = _carried(ground, transition, 0.0, 0.0, disturbances[0], 0.0, 0.0)
    zz, zv, zd, ze = _carried(ground, transition, zz_, zv_, zo + zn, zd_, ze_)
    _, vv, vd, ve = _carried(ground, transition, vz_, vv_, vo + vn, vd_, ve_)
    _, _, dd, de = _carried(ground, transition, dz_, dv_, od + dn, dd_, de_)
    _, _, _, ee = _carried(ground, transition, ez_, ev_, oe + en, ed_, ee_)
    oo, rr = oo + disturbances[1], rr + disturbances[2]
    return zz, zv, zo, zr, zd, ze, vv, vo, vr, vd, ve, oo, orr, od, oe, rr, rd, re, dd, de, ee


def _covariance_with_reading(covariance, by_z, by_v, by_d):  # type: ignore[no-untyped-def]
    """P H' for the reading b + r."""
    zz, zv, zo, zr, zd, ze, vv, vo, vr, vd, ve, _, orr, od, _, rr, rd, re, dd, de, _ = covariance
    return (
        by_z * zz + by_v * zv + by_d * zd + zr,
        by_z * zv + by_v * vv + by_d * vd + vr,
        by_z * zo + by_v * vo + by_d * od + orr,
        by_z * zr + by_v * vr + by_d * rd + rr,
        by_z * zd + by_v * vd + by_d * dd + rd,
        by_z * ze + by_v * ve + by_d * de + re,
    )


def _corrected_covariance(covariance, gain):  # type: ignore[no-untyped-def]
    """P - K K' with the gain K of the white innovation."""
    zz, zv, zo, zr, zd, ze, vv, vo, vr, vd, ve, oo, orr, od, oe, rr, rd, re, dd, de, ee = covariance
    z, v, o, r, d, e = gain
    return (
        zz - z * z, zv - z * v, zo - z * o, zr - z * r, zd - z * d, ze - z * e,
        vv - v * v, vo - v * o, vr - v * r, vd - v * d, ve - v * e,
        oo - o * o, orr - o * r, od - o * d, oe - o * e,
        rr - r * r, rd - r * d, re - r * e,
        dd - d * d, de - d * e,
        ee - e * e,
    )  # fmt: skip


def _balanced(transition, tied):  # type: ignore[no-untyped-def]
    """The transition with z + tied d in place of z."""
    zz, zv, zo, zd, ze, vz, vv, vo, vd, ve, h = transition
    return zz, zv, zo + tied * 0.5 * h * h, zd + tied * (1.0 - zz), ze + tied * h, vz, vv, vo, vd - tied * vz, ve, h


def _upper(covariance, n_states, tied):  # type: ignore[no-untyped-def]
    """The upper triangle of a covariance of six states, of which the last two may be left out; z + tied d for z."""
    p = np.zeros((6, 6))
    p[:n_states, :n_states] = covariance
    p[0] += tied * p[4]
    p[:, 0] += tied * p[:, 4]
    return (
        p[0, 0], p[0, 1], p[0, 2], p[0, 3], p[0, 4], p[0, 5],
        p[1, 1], p[1, 2], p[1, 3], p[1, 4], p[1, 5],
        p[2, 2], p[2, 3], p[2, 4], p[2, 5],
        p[3, 3], p[3, 4], p[3, 5],
        p[4, 4], p[4, 5],
        p[5, 5],
    )  # fmt: skip


def _predictions_of_one(  # type: ignore[no-untyped-def]
    joints, accelerance, by_mass, drive, by_drive, measured, by_measured, step_s, start, by_start, covariance_start,
    noise, ground, correct, differentiate,
):  # fmt: skip
    """As `_predictions` for one interface: numbers in place of small arrays."""
    n_samples, n_states, h = measured.shape[0], start.size, step_s
    owns = _places(joints)
    n_own, share, g = owns[1], accelerance[0, 0], joints[0][0, 2]
    n_mass, n_drive, n_measured = by_mass.shape[0], by_drive.shape[1], by_measured.shape[1]
    first_drive, first_measured = n_own + n_mass, n_own + n_mass + n_drive
    n_known = first_measured + n_measured
    n_parameters = n_known + by_start.shape[1] if differentiate else 0
    by = np.zeros((n_parameters, 6))
    if differentiate:
        for p in range(by_start.shape[1]):
            for s in range(n_states):
                by[n_known + p, s] = by_start[s, p]
    # what each parameter does itself: to the reading, then to z, v, d, e in a step
    direct = np.zeros((n_parameters, 5))
    # of the rows of the stages the last is that of the prediction, which is the first stage where nothing is corrected
    seen = 4 if correct else 0
    by_own, force, slope_z, slope_v = np.zeros((5, n_own)), np.zeros(4), np.zeros(4), np.zeros(4)
    of_z, of_v = np.zeros(4), np.zeros(4)
    # The covariance is that of z + tied d, travel about the place where both springs balance. By itself d grows, for no
    # reading sees it in the long run, and with it z: their small difference would drown.
    tied = 0.0
    if ground is not None:
        _, slope, _, _ = _joint_force(joints, 0, 0, seen, 0.0, 0.0, 0.0, by_own)
        if slope + g > 0.0:
            tied = g / (slope + g)
    covariance = _upper(covariance_start, n_states, tied)
    disturbances = (noise[0, 0] ** 2, noise[2, 0] ** 2, noise[3, 0] ** 2)
    innovation, spread = np.empty((1, n_samples)), np.empty((1, n_samples))
    sensitivity, motion = np.empty((n_samples, 1, n_parameters)), np.empty((3, 1, n_samples))
    z0, v0, o, r, d0, e0 = start[0], start[1], start[2], start[3], 0.0, 0.0
    if ground is not None:
        d0, e0 = start[4], start[5]

    for step in range(n_samples):
        # the last sample takes a step, too, which nobody sees
        now, half, following = 2 * step, min(2 * step + 1, drive.shape[0] - 1), min(2 * step + 2, drive.shape[0] - 1)
        x = z0 + d0 if ground is not None else 0.0
        answering, by_z, by_v, _ = _joint_force(joints, 0, 0, seen, z0, v0, x, by_own)
        total, by_z, by_v, by_d = answering, -share * (by_z + g), -share * by_v, -share * g
        body = -share * answering
        motion[0, 0, step], motion[1, 0, step], motion[2, 0, step] = z0, v0, body
        deviation, per_deviation, gain = noise[1, 0], 1.0 / noise[1, 0], (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if correct:
            z, v, a, b, d, e = _covariance_with_reading(covariance, by_z, by_v, by_d - tied * by_z)
            variance = by_z * z + by_v * v + (by_d - tied * by_z) * d + b + noise[1, 0] ** 2
            # rounding must not make it smaller than the noise of the reading
            deviation = np.sqrt(max(variance, noise[1, 0] ** 2))
            per_deviation = 1.0 / deviation
            gain = (
                z * per_deviation, v * per_deviation, a * per_deviation, b * per_deviation, d * per_deviation,
                e * per_deviation,
            )  # fmt: skip
            covariance = _corrected_covariance(covariance, gain)
            gain = (gain[0] - tied * gain[4], gain[1], gain[2], gain[3], gain[4], gain[5])
        white = (measured[step, 0] - body - r) * per_deviation
        innovation[0, step], spread[0, step] = white, deviation
        gain_z, gain_v, gain_o, gain_r, gain_d, gain_e = gain
        z0, v0, o, r = z0 + gain_z * white, v0 + gain_v * white, o + gain_o * white, r + gain_r * white
        d0, e0 = d0 + gain_d * white, e0 + gain_e * white

        z, v, z1, v1 = z0, v0, z0, v0
        first, middle, last = drive[now, 0] + o, drive[half, 0] + o, drive[following, 0] + o
        under = (first, middle, middle, last)
        places = (d0, d0 + 0.5 * h * e0, d0 + 0.5 * h * (e0 + 0.5 * h * first), d0 + h * (e0 + 0.5 * h * middle))
        for stage in range(4):
            if stage == 0 and not correct:
                force[0], slope_z[0], slope_v[0] = total, by_z, by_v
            else:
                x = z + places[stage] if ground is not None else 0.0
                total, to_z, to_v, _ = _joint_force(joints, 0, 0, stage, z, v, x, by_own)
                force[stage], slope_z[stage], slope_v[stage] = total, -share * (to_z + g), -share * to_v
            weight, ahead = _STAGE_WEIGHT[stage] * h, _STAGE_STEP[stage] * h
            relative = -share * total - under[stage]
            z1, v1 = z1 + weight * v, v1 + weight * relative
            z, v = z0 + ahead * v, v0 + ahead * relative
        z0, v0 = z1, v1
        if ground is not None:
            d0, e0 = d0 + h * (e0 + h * (first + 2.0 * middle) / 6.0), e0 + h * (first + 4.0 * middle + last) / 6.0
        if not (correct or differentiate):
            continue

        t_zz, t_zv, t_vz, t_vv = 1.0, 0.0, 0.0, 1.0
        z_z, z_v, v_z, v_v = 0.0, 0.0, 0.0, 0.0
        for stage in range(3, -1, -1):
            weight, ahead = _STAGE_WEIGHT[stage] * h, _STAGE_STEP[stage] * h
            of_z[stage], of_v[stage] = ahead * z_v, weight + ahead * v_v
            z_v = weight + ahead * z_z + slope_v[stage] * of_z[stage]
            v_v = ahead * v_z + slope_v[stage] * of_v[stage]
            z_z, v_z = slope_z[stage] * of_z[stage], slope_z[stage] * of_v[stage]
            t_zz, t_zv, t_vz, t_vv = t_zz + z_z, t_zv + z_v, t_vz + v_z, t_vv + v_v
        # the drive in the first, the middle and the last half step: by itself, and by d of later stages
        z_first, z_middle, z_last = -of_z[0], -of_z[1] - of_z[2], -of_z[3]
        v_first, v_middle, v_last = -of_v[0], -of_v[1] - of_v[2], -of_v[3]
        if ground is not None:
            z_first, z_middle = z_first + by_d * 0.25 * h * h * of_z[2], z_middle + by_d * 0.5 * h * h * of_z[3]
            v_first, v_middle = v_first + by_d * 0.25 * h * h * of_v[2], v_middle + by_d * 0.5 * h * h * of_v[3]
        sum_z, sum_v = of_z[0] + of_z[1] + of_z[2] + of_z[3], of_v[0] + of_v[1] + of_v[2] + of_v[3]
        transition = (
            t_zz, t_zv, z_first + z_middle + z_last,
            by_d * sum_z, by_d * h * (0.5 * (of_z[1] + of_z[2]) + of_z[3]),
            t_vz, t_vv, v_first + v_middle + v_last,
            by_d * sum_v, by_d * h * (0.5 * (of_v[1] + of_v[2]) + of_v[3]),
            h,
        )  # fmt: skip
        if correct:
            covariance = _carried_covariance(ground, _balanced(transition, tied), covariance, disturbances)
        if not differentiate:
            continue

        for p in range(n_own):
            direct[p, 0] = share * by_own[seen, p]
            direct[p, 1], direct[p, 2] = 0.0, 0.0
            for stage in range(4):
                direct[p, 1] -= share * of_z[stage] * by_own[stage, p]
                direct[p, 2] -= share * of_v[stage] * by_own[stage, p]
        if n_mass > 0:
            push_z = of_z[0] * force[0] + of_z[1] * force[1] + of_z[2] * force[2] + of_z[3] * force[3]
            push_v = of_v[0] * force[0] + of_v[1] * force[1] + of_v[2] * force[2] + of_v[3] * force[3]
            for m in range(n_mass):
                direct[n_own + m, 0] = by_mass[m, 0, 0] * answering
                direct[n_own + m, 1] = -by_mass[m, 0, 0] * push_z
                direct[n_own + m, 2] = -by_mass[m, 0, 0] * push_v
        for c in range(n_drive):
            p, first = first_drive + c, by_drive[now, c, 0]
            middle, last = by_drive[half, c, 0], by_drive[following, c, 0]
            direct[p, 1] = z_first * first + z_middle * middle + z_last * last
            direct[p, 2] = v_first * first + v_middle * middle + v_last * last
            direct[p, 3] = h * h * (first + 2.0 * middle) / 6.0
            direct[p, 4] = h * (first + 4.0 * middle + last) / 6.0
        for c in range(n_measured):
            direct[first_measured + c, 0] = by_measured[step, c, 0]
        for p in range(n_parameters):
            z, v, d, e = by[p, 0], by[p, 1], by[p, 4], by[p, 5]
            change = direct[p, 0] - by_z * z - by_v * v - by[p, 3]
            if ground is not None:
                change -= by_d * d
            change *= per_deviation
            sensitivity[step, 0, p] = change
            by[p, 2] += gain_o * change
            by[p, 3] += gain_r * change
            z, v, d, e = z + gain_z * change, v + gain_v * change, d + gain_d * change, e + gain_e * change
            z, v, d, e = _carried(ground, transition, z, v, by[p, 2], d, e)
            by[p, 0], by[p, 1] = z + direct[p, 1], v + direct[p, 2]
            if ground is not None:
                by[p, 4], by[p, 5] = d + direct[p, 3], e + direct[p, 4]
    return innovation, spread, sensitivity, motion
