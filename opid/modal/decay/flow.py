"""Amplitude and phase of the free decay of a given law, without a time step: harmonic balance and averaging.

The fundamental follows A' = -delta(A) A, phi' = omega(A), with the terms of second order in damping and in the drift of
the frequency kept, so that it is right to some 1e-5 of the frequency for a shift of 3 % and a damping ratio of 1 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.signals.recording import FloatArray

N_LEVELS, N_ANGLES = 100, 24
"""Amplitudes that harmonic balance is solved at, and angles of half a cycle: the other half is its mirror image."""


@dataclass(frozen=True, eq=False)
class Flow:
    """How the fundamental A(t) cos phi(t) of a free decay moves, over its amplitude.

    Args:
        log_level: (n,) logarithm of A, rising.
        omega: (n,) phi'.
        rate: (n,) delta = -A'/A.
        natural: (n,) natural frequency, without the terms of second order.
        damping: (n,) c = 2 zeta omega.
        drift: (n,) -delta' + j omega', as it enters the second derivative of A exp(j phi), times -1.
    """

    log_level: FloatArray
    omega: FloatArray
    rate: FloatArray
    natural: FloatArray
    damping: FloatArray
    drift: NDArray[np.complex128]


def slow_flow(k: FloatArray, c: FloatArray, low: float, high: float) -> Flow | None:
    """Return the slow flow of a law between two amplitudes; None where it does not vibrate or does not decay.

    Args:
        k: k_1 = k0, k_2 ..., of k_n q|q|^(n-1).
        c: c_1 = c0, c_2 ..., of c_n q'|q'|^(n-1).
        low: logarithm of the smallest amplitude.
        high: that of the largest.

    >>> flow = slow_flow(np.array([1.0]), np.array([0.02]), -1.0, 0.0)
    >>> round(float(flow.rate[0]), 6), round(float(flow.omega[0]), 6)
    (0.01, 0.99995)
    """
    log_level = np.linspace(low, high, N_LEVELS)
    a = np.exp(log_level)[:, None]
    angle = np.pi * (np.arange(N_ANGLES) + 0.5) / N_ANGLES
    cosine, sine = np.cos(angle), np.sin(angle)
    third_cosine, third_sine = np.cos(3.0 * angle), np.sin(3.0 * angle)
    in_phase, quadrature = np.zeros_like(a), np.zeros_like(a)
    omega, drag = np.full_like(a, np.sqrt(max(k[0], 1e-12))), np.zeros((1, 1))
    for _ in range(5):
        q = a * cosine + in_phase * third_cosine + quadrature * third_sine
        v = -omega * (a * sine + 3.0 * (in_phase * third_sine - quadrature * third_cosine))
        drag = _powers(c, v, 2)
        force = _powers(k, q, 2) + drag
        square = k[0] + _harmonic(force, cosine) / a
        if (square <= 0.0).any():
            return None
        omega = np.sqrt(square)
        in_phase = _harmonic(force, third_cosine) / (9.0 * square - k[0])
        quadrature = _harmonic(force, third_sine) / (9.0 * square - k[0])
    damping = c[0] - (_harmonic(drag, sine) / (omega * a))[:, 0]
    natural = omega[:, 0]
    step = log_level[1] - log_level[0]
    rate = damping / (2.0 + np.gradient(np.log(natural), step, edge_order=2))
    if (rate <= 0.0).any():
        return None
    rate_drift = -rate * np.gradient(rate, step, edge_order=2)
    damped = np.sqrt(np.maximum(natural**2 + rate**2 - damping * rate - rate_drift, 1e-12))
    drift = rate_drift + 1j * rate * np.gradient(damped, step, edge_order=2)
    return Flow(log_level, damped, rate, natural, damping, drift)


def _powers(values: FloatArray, x: FloatArray, lowest: int) -> FloatArray:
    """sum_n values_n x |x|^(n-1) from a power on."""
    size = np.abs(x)
    total = np.zeros_like(x)
    for power in range(values.size, lowest - 1, -1):
        total = (total + values[power - 1]) * (size if power > lowest else x * size ** (lowest - 1))
    return total


def _harmonic(force: FloatArray, shape: FloatArray) -> FloatArray:
    return 2.0 * (force @ shape / shape.size)[:, None]


def predicted_decay(
    flow: Flow, time: FloatArray, log_start: float, derivative: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return log-amplitude and phase of the m-th derivative, (n,) each; None where the flow does not reach so far.

    Args:
        flow: the slow flow of the law.
        time: (n,) times from the start of the decay on, the first 0.
        log_start: logarithm of the amplitude of the displacement at the start; its phase is 0 there.
        derivative: m, 0 to 2.
    """
    from scipy.interpolate import CubicSpline

    fall = flow.log_level[::-1]
    since = CubicSpline(-fall, 1.0 / flow.rate[::-1]).antiderivative()(-fall)
    turned = CubicSpline(-fall, flow.omega[::-1] / flow.rate[::-1]).antiderivative()(-fall)
    own_time = since - np.interp(-log_start, -fall, since)
    if (np.diff(own_time) <= 0.0).any() or not own_time[0] <= time[0] <= time[-1] <= own_time[-1]:
        return None
    # a smooth map both ways: amplitude and phase as functions of time
    log_level = CubicSpline(own_time, fall)(time)
    by_time = CubicSpline(own_time, turned)(time)
    phase = by_time - by_time[0]
    omega = np.interp(log_level, flow.log_level, flow.omega)
    rate = np.interp(log_level, flow.log_level, flow.rate)
    # A e^(j phi), differentiated: each time by -delta + j omega, the second time these two change as well
    gain = (omega + 1j * rate) ** derivative
    if derivative == 2:
        gain = gain + np.interp(log_level, flow.log_level, flow.drift)
    return log_level + np.log(np.abs(gain)), phase + np.angle(gain)
