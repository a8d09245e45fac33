"""One window of a free decay: local least squares of a sinusoid along a smooth reference, with what rings beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class Reference:
    """A smooth guess of the fundamental at every sample of a stretch.

    Args:
        log_amplitude: (n,) logarithm of its amplitude.
        phase: (n,) rad.
        omega: (n,) rate of the phase, rad/s.
        rate: (n,) of the logarithm of the amplitude, downwards, 1/s.
    """

    log_amplitude: FloatArray
    phase: FloatArray
    omega: FloatArray
    rate: FloatArray


@dataclass(frozen=True, eq=False)
class Window:
    """What one window says of the fundamental: the reference times value exp(slope (t - centre)) near its centre.

    Args:
        first: its first sample in the stretch.
        centre: time at which value and slope are uncorrelated, s from the start of the stretch.
        value: 1 where the reference is right.
        slope: 0 where the reference is right, 1/s; the imaginary part is of the frequency, rad/s.
        by_value: (m,) what each sample adds to the logarithm of the value.
        slope_std: standard deviation of the parts of the slope for samples of noise 1.
        noise: standard deviation of white noise in the samples of the level found near the mode.
        fitted: (m,) the samples as fitted, with what was fitted beside the mode.
        weight: (m,) of the samples.
    """

    first: int
    centre: float
    value: complex
    slope: complex
    by_value: FloatArray
    slope_std: complex
    noise: float
    fitted: FloatArray
    weight: FloatArray


def fit_window(
    part: FloatArray, first: int, weight: FloatArray, reference: Reference, neighbours: FloatArray, fs: float
) -> Window:
    """Return the weighted least squares of one window.

    Args:
        part: (n,) the stretch of the record.
        first: first sample of the window in it.
        weight: (m,) weights of its samples.
        reference: what the mode is taken to follow.
        neighbours: frequencies that are fitted beside it, Hz.
        fs: sampling rate, Hz.
    """
    places = slice(first, first + weight.size)
    y = part[places]
    time = (first + np.arange(weight.size)) / fs
    height = np.exp(reference.log_amplitude[places])
    # alpha and beta are uncorrelated about the centre of what carries the information
    centre = float(np.sum(weight * height**2 * time) / np.sum(weight * height**2))
    since = (time - centre) / (weight.size / fs)
    phase = reference.phase[places]
    turning = height * np.exp(1j * phase)
    main = np.column_stack([turning.real, -turning.imag, since * turning.real, -since * turning.imag])
    columns = [main, np.ones((weight.size, 1)) * height.max(), since[:, None] * height.max()]
    omega = float(reference.omega[first])
    for harmonic in (2, 3):
        if harmonic * omega < 0.9 * np.pi * fs:
            over = height**harmonic / height.max() ** (harmonic - 1) * np.exp(1j * harmonic * phase)
            columns.append(np.column_stack([over.real, over.imag]))
    for frequency in neighbours:
        turn = height.max() * np.exp(2j * np.pi * frequency * (time - centre))
        columns.append(np.column_stack([turn.real, turn.imag, since * turn.real, since * turn.imag]))
    x = np.column_stack(columns)
    scale = np.sqrt(weight @ x**2)
    x = x / scale
    weighted = weight[:, None] * x
    solve = np.linalg.pinv(x.T @ weighted, rcond=1e-10, hermitian=True) @ weighted.T
    solution = solve @ y
    fitted = x @ solution
    rest = y - fitted
    functional = solve[:4] / scale[:4, None]
    alpha_r, alpha_i, beta_r, beta_i = (solution[:4] / scale[:4]).tolist()
    value, slope = complex(alpha_r, alpha_i) or 1e-12 + 0j, complex(beta_r, beta_i)
    # by the reference, not by the value found: noise that makes it small must not make it trusted less, too
    turn_back = np.exp(-1j * np.angle(value))
    by_value = (functional[0] + 1j * functional[1]) * turn_back
    by_slope = (functional[2] + 1j * functional[3]) * turn_back - (slope / value) * by_value
    span = weight.size / fs
    spread = complex(float(np.linalg.norm(by_slope.real)), float(np.linalg.norm(by_slope.imag))) / span
    return Window(
        first=first,
        centre=centre,
        value=value,
        slope=slope / value / span,
        by_value=by_value,
        slope_std=spread,
        noise=_noise(x, solve, weight, rest, since, turning),
        fitted=fitted,
        weight=weight,
    )


def _noise(
    x: FloatArray, solve: FloatArray, weight: FloatArray, rest: FloatArray, since: FloatArray, turning: FloatArray
) -> float:
    """Standard deviation of the samples that white noise of the level near the mode would have.

    It is what the powers 2 to 5 of time times the mode would take of the rest: their band is that of the mode, and what
    the reference misses of it is counted as noise.
    """
    powers = [turning * (2.0 * since) ** 2]
    for _ in range(3):
        powers.append(powers[-1] * (2.0 * since))
    more = np.column_stack([part for each in powers for part in (each.real, each.imag)])
    more = more - x @ (solve @ more)
    gram = more.T @ (weight[:, None] * more)
    values, vectors = np.linalg.eigh(gram)
    keep = values > 1e-8 * values[-1]
    basis = (more @ vectors[:, keep]) / np.sqrt(values[keep])
    taken = basis.T @ (weight * rest)
    expected = float(np.sum((weight[:, None] * basis) ** 2))
    return float(np.sqrt(taken @ taken / max(expected, 1e-300)))


def value_std(window: Window) -> float:
    """Return the standard deviation of the value of a window, of its real or imaginary part.

    Args:
        window: the window.
    """
    return window.noise * float(np.linalg.norm(window.by_value)) / np.sqrt(2.0)
