"""Backbones by the plain Newton's method on every degree of freedom: for comparison with `opid.mechanics.backbones`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg

from opid.mechanics.backbones.harmonic_balance import joint_harmonics, transform_at
from opid.mechanics.laws.law import FloatArray, Law


def plain_backbone(
    mass: ArrayLike,
    stiffness: ArrayLike,
    law: Law,
    *,
    joint_rows: ArrayLike,
    sensor_row: ArrayLike,
    mode: int,
    amplitude: ArrayLike,
    harmonics: Sequence[int] = (1,),
    n_times: int = 64,
) -> tuple[FloatArray, FloatArray]:
    """Return frequencies and motions by Newton's method on every degree of freedom: the reference for `backbone`.

    (K - h^2 l M) x_h + J^T F_h = 0 for all harmonics and s x_1 = A, F_h by n_times points of the period.

    Args:
        mass: (n_dof, n_dof) kg.
        stiffness: (n_dof, n_dof) N/m.
        law: of all joints.
        joint_rows: (n_joints, n_dof) extension of each joint for unit motion.
        sensor_row: (n_dof,) reading of the sensor likewise.
        mode: number of the mode, from 1.
        amplitude: (n,) of the sensor, m, growing.
        harmonics: of the motion.
        n_times: points in a period.

    Returns:
        (n,) frequencies, Hz, and (n, n_harmonics, n_dof) cosine coefficients, m; nan from where it failed.
    """
    M, K, J = (np.asarray(each, dtype=np.float64) for each in (mass, stiffness, joint_rows))
    s, amplitudes = np.asarray(sensor_row, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
    n_dof, n_harmonics, first = len(M), len(harmonics), tuple(harmonics).index(1)
    eigenvalue, shapes = linalg.eigh(K, M, subset_by_index=[mode - 1, mode - 1])
    transform = transform_at(
        2 * np.pi * (np.arange(n_times) + 0.5) / n_times, np.full(n_times, 1.0 / n_times), tuple(harmonics)
    )
    x, at, last = np.zeros((n_harmonics, n_dof)), float(eigenvalue[0]), amplitudes[0]
    x[first] = shapes[:, 0] * last / (s @ shapes[:, 0])
    frequency_hz = np.full(amplitudes.size, np.nan)
    motion = np.full((amplitudes.size, n_harmonics, n_dof), np.nan)
    for point, target in enumerate(amplitudes):
        x, last = x * target / last, target
        for _ in range(20):
            force, slopes = joint_harmonics((law,) * len(J), transform, x @ J.T)
            value, jacobian = np.empty(x.size + 1), np.zeros((x.size + 1, x.size + 1))
            for k, h in enumerate(harmonics):
                rows = slice(k * n_dof, (k + 1) * n_dof)
                dynamic = K - h**2 * at * M
                value[rows] = dynamic @ x[k] + J.T @ force[k]
                jacobian[rows, rows] = dynamic
                for g in range(n_harmonics):
                    jacobian[rows, g * n_dof : (g + 1) * n_dof] += J.T @ (slopes[:, k, g, np.newaxis] * J)
                jacobian[rows, -1] = -(h**2) * M @ x[k]
            value[-1], jacobian[-1, first * n_dof : (first + 1) * n_dof] = s @ x[first] - target, s
            step = np.linalg.solve(jacobian, value)
            x, at = x - step[:-1].reshape(x.shape), at - step[-1]
            if np.abs(step[:-1]).max() <= 1e-8 * np.abs(x).max() and abs(step[-1]) <= 1e-8 * at:
                frequency_hz[point], motion[point] = np.sqrt(at) / (2 * np.pi), x
                break
        else:
            break
    return frequency_hz, motion
