"""What the noise of force cell and accelerometers does to the equation of a mode, and to what is fitted to it.

The error of the equation is e = n_f - n_a - c(t) n_v - k(t) n_q: the acceleration's noise n_a, integrated once and
twice, is multiplied by the tangents k(t) and c(t) at the amplitude of the moment. Regressors and left
side share that noise; to first order the tangents hold all of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft

from opid.modal.forced.equation import ModeLines
from opid.signals.recording import FloatArray

Powers = Sequence[int]


def line_noise(lines: ModeLines, powers_k: Powers, powers_c: Powers, value: FloatArray) -> FloatArray:
    """Return the standard deviation of the equation's error on each line, (m,), by the mean square over time.

    Args:
        lines: of one test.
        powers_k: powers of the displacement.
        powers_c: powers of the velocity.
        value: their coefficients, k_n and then c_n.
    """
    k, c = tangents(lines, powers_k, powers_c, value)
    omega = 2 * np.pi * lines.frequency_hz
    mean = np.abs(1 + c.mean() / (1j * omega) + k.mean() / (1j * omega) ** 2) ** 2
    spread = c.var() / omega**2 + k.var() / omega**4
    return np.sqrt(lines.noise_force**2 + lines.noise_inertia**2 * (mean + spread))


def noise_scores(
    lines: ModeLines, gradient: np.ndarray, powers_k: Powers, powers_c: Powers, value: FloatArray
) -> FloatArray:
    """Return the covariance of Re sum conj(gradient) E over the lines, E the transform of the error, (p, p).

    Args:
        lines: of one test.
        gradient: (m, p) complex.
        powers_k: powers of the displacement.
        powers_c: powers of the velocity.
        value: their coefficients.
    """
    k, c = tangents(lines, powers_k, powers_c, value)
    n = lines.q.size
    spectrum = np.zeros((n // 2 + 1, gradient.shape[1]), dtype=np.complex128)
    spectrum[lines.places] = gradient
    # Re sum conj(G_l) e^(-j omega_l t), one signal a parameter, faded as the terms were
    of_force = 0.5 * n * fft.irfft(spectrum, n, axis=0) * lines.fade[:, None]
    frequency = fft.rfftfreq(n, 1 / lines.fs)
    kept = ((frequency >= lines.kept_hz[0]) & (frequency <= lines.kept_hz[1]))[:, None]
    backward = np.where(kept, -2j * np.pi * frequency[:, None], 1.0)  # the adjoint of a division by j omega
    through = [fft.rfft(tangent[:, None] * of_force, axis=0) for tangent in (c, k)]
    integrated = np.where(kept, through[0] / backward + through[1] / backward**2, 0.0)
    of_inertia = of_force + fft.irfft(integrated, n, axis=0)
    noise = lines.noise_force**2 * of_force.T @ of_force + lines.noise_inertia**2 * of_inertia.T @ of_inertia
    # the levels were read from lines of the faded record
    return noise / np.sum(lines.fade**2)


def tangents(lines: ModeLines, powers_k: Powers, powers_c: Powers, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return tangent stiffness, 1/s^2, and damping, 1/s, at each moment, (n,) each.

    Args:
        lines: of one test.
        powers_k: powers of the displacement.
        powers_c: powers of the velocity.
        value: their coefficients.
    """
    k0, c0 = lines.linear
    k, c = np.full(lines.q.size, k0), np.full(lines.v.size, c0)
    n_k = len(powers_k)
    for total, motion, powers, part in ((k, lines.q, powers_k, value[:n_k]), (c, lines.v, powers_c, value[n_k:])):
        for power, each in zip(powers, part, strict=True):
            total += each * power * np.abs(motion) ** (power - 1)
    return k, c
