"""The law of a mode from its free decays alone: q'' + c0 q' + k0 q + sum c_n q'|q'|^(n-1) + sum k_n q|q|^(n-1) = 0.

Start values come from the harmonic linearisation of frequency and damping over amplitude, which is linear in the
coefficients; then amplitude and phase of each decay (`flow`) are fitted to the measured ones over all its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.laws.law import Law
from opid.modal.decay.flow import Flow, predicted_decay, slow_flow
from opid.modal.decay.track import Track
from opid.modal.power_laws import HIGHEST_ORDER, fitted_power_law, harmonic_share
from opid.signals.recording import FloatArray

DRIFT_ERROR = 0.1
"""Share to which the drift of the frequency is known: it is that of a smooth curve."""
IMPOSSIBLE = 1e8
"""Error of a law that does not vibrate, or does not decay over all of the record, standard deviations."""
LEAST_RANGE = 1.5
"""Largest amplitude over the smallest, below which no law is looked for."""


@dataclass(frozen=True, eq=False)
class DecayLaw:
    """What free decays say of the restoring force of their mode, without any force measured.

    Args:
        stiffness: k_n by its power n; 1 is k0. Force per unit mass (or modal force) over displacement^n.
        damping: c_n by its power n; 1 is c0. Likewise over velocity^n.
        frequency_low_hz: natural frequency at zero amplitude, Hz.
        damping_low: damping ratio at zero amplitude.
        amplitude: (n,) displacement amplitudes within those of the decays.
        frequency_hz: (n,) natural frequency at them, Hz.
        damping_ratio: (n,) damping ratio at them.
        covariance: of k0, k_2 ..., c0, c_2 ... in this order.
        misfit: rms of what the law does not explain of amplitude and phase, over its standard deviation; 1 is noise.
        phase_error: rms of that, rad (and relative amplitude).
        warnings: what to doubt.
    """

    stiffness: dict[int, Estimate]
    damping: dict[int, Estimate]
    frequency_low_hz: Estimate
    damping_low: Estimate
    amplitude: FloatArray
    frequency_hz: FloatArray
    damping_ratio: FloatArray
    covariance: FloatArray
    misfit: float
    phase_error: float
    warnings: tuple[str, ...]

    @property
    def law(self) -> Law:
        """The nonlinear restoring force, powers 2 and up, per unit mass."""
        return fitted_power_law(self.stiffness, self.damping)


def backbone(track: Track, derivative: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return displacement amplitude, natural frequency (rad/s), its std, c = 2 zeta omega (1/s) and its std, each (n,).

    From phase and amplitude of a free vibration A(t) cos phi(t) (Feldman 1994, Mech. Syst. Signal Process. 8, eq. 6)

        omega^2 = phi'^2 - A''/A - c A'/A,   c = -2 A'/A - phi''/phi',

    where A = B / |j phi' - delta|^m for the m-th derivative of the displacement.

    Args:
        track: what a decay shows.
        derivative: m, 2 for accelerations.
    """
    rate = track.rate + derivative * track.chirp / track.omega
    damping = 2.0 * rate + -track.chirp / track.omega
    amplitude = track.amplitude / (track.omega**2 + rate**2) ** (0.5 * derivative)
    order = np.argsort(track.time_s)
    smooth = np.polyfit(track.time_s[order], rate[order], 1, w=1.0 / np.maximum(track.rate_std[order], 1e-300))[0]
    natural = np.sqrt(np.maximum(track.omega**2 - rate**2 + smooth + damping * rate, 1e-300))
    drift_std = DRIFT_ERROR * (2 * derivative - 1) * track.chirp / track.omega
    return amplitude, natural, track.omega_std, damping, np.hypot(2.0 * track.rate_std, drift_std)


def fit_decays(
    tracks: Sequence[Track],
    *,
    derivative: int = 2,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
) -> DecayLaw:
    """Fit one law to one or several free decays of a mode.

    Args:
        tracks: amplitude and phase of each.
        derivative: 2 where they are of accelerations, 1 velocities, 0 displacements.
        stiffness_order: N_s, 1 for a linear spring; the order with the lowest Bayesian criterion where None.
        damping_order: N_d likewise.

    Raises:
        InputError: no decay at all, or orders outside 1 to 5.
        NotDeterminedError: fewer windows than coefficients, or a law that does not decay.
    """
    if not tracks:
        raise InputError("there is no free decay to fit a law to: give at least one")
    for word, order in (("stiffness_order", stiffness_order), ("damping_order", damping_order)):
        if order is not None and not 1 <= order <= HIGHEST_ORDER:
            raise InputError(f"{word} is {order}, give 1 (linear) to {HIGHEST_ORDER}")
    shown = [np.concatenate(parts) for parts in zip(*(backbone(each, derivative) for each in tracks), strict=True)]
    amplitude, natural, natural_std, damping, damping_std = shown
    unit = _Units(float(amplitude.max()), float(np.median(natural)))
    level = amplitude / unit.length
    warnings: list[str] = []
    if level.max() < LEAST_RANGE * level.min():
        warnings.append(f"the amplitude falls by {level.max() / level.min():.2g} only: powers above 1 rest on little")
    square = (natural / unit.rate) ** 2
    k, n_s = _linear_fit(level, square, 2.0 * natural_std * natural / unit.rate**2, stiffness_order)
    speed = level * natural / unit.rate
    c, n_d = _linear_fit(speed, damping / unit.rate, damping_std / unit.rate, damping_order)
    n_data = 2 * amplitude.size
    if n_data <= n_s + n_d + 2 * len(tracks) + 2:
        raise NotDeterminedError(
            f"{n_data} amplitudes and phases cannot tell {n_s + n_d} coefficients: lower the orders"
        )
    linear = float(_linear_fit(speed, damping / unit.rate, damping_std / unit.rate, 1)[0][0])
    tame = (float(np.median(square)), max(linear, 1e-5))
    return _refined(tracks, unit, k, c, tame, derivative, warnings)


@dataclass(frozen=True)
class _Units:
    """Length and rate in which the coefficients of all powers are of one size."""

    length: float
    rate: float

    def stiffness(self, power: int) -> float:
        return self.rate**2 * self.length ** (1 - power)

    def damping(self, power: int) -> float:
        return self.rate * (self.length * self.rate) ** (1 - power)


def _linear_fit(level: FloatArray, y: FloatArray, std: FloatArray, order: int | None) -> tuple[FloatArray, int]:
    """Coefficients of y = sum_n value_n a_n level^(n-1), n = 1 .. order, and the order."""
    std = np.maximum(std, 1e-12 * float(np.median(np.abs(y))) + 1e-300)
    best: tuple[float, FloatArray, int] = (np.inf, np.zeros(0), 0)
    for trial in range(1, HIGHEST_ORDER + 1) if order is None else (order,):
        if trial >= level.size - 1:
            break
        columns = np.column_stack([harmonic_share(n) * level ** (n - 1) for n in range(1, trial + 1)])
        values = np.asarray(np.linalg.lstsq(columns / std[:, None], y / std, rcond=1e-12)[0], dtype=np.float64)
        misfit = float(np.sum(((y - columns @ values) / std) ** 2))
        # windows overlap by half: two of three are worth one
        n = 0.67 * level.size
        score = n * np.log(max(misfit / level.size, 0.5)) + trial * np.log(n)
        if score < best[0]:
            best = (score, values, trial)
    if best[2] == 0:
        raise NotDeterminedError(f"{level.size} windows cannot tell {order or 1} coefficients: lower the orders")
    return best[1], best[2]


def _refined(
    tracks: Sequence[Track],
    unit: _Units,
    k: FloatArray,
    c: FloatArray,
    tame: tuple[float, float],
    derivative: int,
    warnings: list[str],
) -> DecayLaw:
    """Move the coefficients and the start of each decay until amplitude and phase are met over all of the time."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import least_squares

    logs = [np.log(track.amplitude / (unit.length * unit.rate**derivative)) for track in tracks]
    times = [(track.time_s - track.time_s[0]) * unit.rate for track in tracks]
    low = min(float(x.min()) for x in logs) - 0.7
    high = max(float(x.max()) for x in logs) + 0.4
    roots = [_root(track.covariance) for track in tracks]
    n_s, n_k = k.size, k.size + c.size

    def errors(vector: FloatArray) -> FloatArray:
        flow = slow_flow(vector[:n_s], vector[n_s:n_k], low, high)
        if flow is None:
            return np.full(2 * sum(x.size for x in logs), IMPOSSIBLE)
        found: list[FloatArray] = []
        for place, track in enumerate(tracks):
            start, shift = vector[n_k + 2 * place : n_k + 2 * place + 2]
            predicted = predicted_decay(flow, times[place], start, derivative)
            if predicted is None:
                return np.full(2 * sum(x.size for x in logs), IMPOSSIBLE)
            amplitude, phase = predicted
            rest = np.concatenate([logs[place] - amplitude, track.phase - track.phase[0] - phase - shift])
            found.append(solve_triangular(roots[place], rest, lower=True))
        return np.concatenate(found)

    start = np.concatenate([k, c, *([float(x[0]), 0.0] for x in logs)])
    if np.abs(errors(start)).max() >= IMPOSSIBLE:
        # the start values of all powers do not vibrate, or do not decay: the linear part alone does
        start[:n_k] = 0.0
        start[0], start[n_s] = tame
    scale = np.concatenate(
        [np.ones(n_s), np.full(c.size, max(abs(float(c[0])), 1e-4)), np.tile([0.1, 0.1], len(tracks))]
    )
    found = least_squares(errors, start, x_scale=scale, method="trf", xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=60)
    flow = slow_flow(found.x[:n_s], found.x[n_s:n_k], low, high)
    if flow is None or not np.abs(found.fun).max() < IMPOSSIBLE:
        raise NotDeterminedError("no law of these orders decays over all amplitudes of the record: lower the orders")
    covariance = _covariance(found.jac, found.fun, [x.size for x in logs])
    rests = [root @ part for root, part in zip(roots, _split(found.fun, logs), strict=True)]
    misfit = float(np.sqrt(np.sum(found.fun**2) / max(found.fun.size - found.x.size, 1)))
    return _decay_law(
        found.x,
        covariance,
        n_s,
        n_k,
        unit,
        flow,
        misfit,
        float(np.sqrt(np.mean(np.concatenate(rests) ** 2))),
        warnings,
        logs,
        derivative,
    )


def _root(covariance: FloatArray) -> FloatArray:
    """Lower Cholesky factor; a small share is added to the diagonal, below which no window is trusted."""
    diagonal = np.diag(covariance)
    return np.asarray(np.linalg.cholesky(covariance + np.diag(1e-6 * diagonal + 1e-14)), dtype=np.float64)


def _split(errors: FloatArray, logs: Sequence[FloatArray]) -> list[FloatArray]:
    ends = np.cumsum([2 * x.size for x in logs])[:-1]
    return np.split(errors, ends)


def _covariance(jacobian: FloatArray, errors: FloatArray, sizes: Sequence[int]) -> FloatArray:
    """Covariance of the parameters: of white errors of their own size or, where larger, of errors that are correlated.

    The scores of windows up to the lag 2 n^(1/3) apart, amplitude and phase together, may be correlated (Newey and West
    1987, Econometrica 55, 703-708).
    """
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13, hermitian=True)
    n, p = jacobian.shape
    white = inverse * max(float(errors @ errors) / max(n - p, 1), 1.0)
    meat, first = np.zeros((p, p)), 0
    for size in sizes:
        rows = slice(first, first + 2 * size)
        scores = (scaled[rows] * errors[rows, None]).reshape(2, size, p).sum(axis=0)
        lags = min(size - 1, int(2.0 * size ** (1.0 / 3.0)))
        meat += scores.T @ scores
        for lag in range(1, lags + 1):
            cross = scores[lag:].T @ scores[:-lag]
            meat += (1.0 - lag / (lags + 1)) * (cross + cross.T)
        first += 2 * size
    coloured = n / max(n - p, 1) * inverse @ meat @ inverse
    wider = np.sqrt(np.maximum(np.diag(coloured) / np.maximum(np.diag(white), 1e-300), 1.0))
    return white * np.outer(wider, wider) / np.outer(scale, scale)


def _decay_law(
    vector: FloatArray,
    covariance: FloatArray,
    n_s: int,
    n_k: int,
    unit: _Units,
    flow: Flow,
    misfit: float,
    phase_error: float,
    warnings: list[str],
    logs: Sequence[FloatArray],
    derivative: int,
) -> DecayLaw:
    std = np.sqrt(np.diag(covariance))
    factors = np.array(
        [unit.stiffness(n) for n in range(1, n_s + 1)] + [unit.damping(n) for n in range(1, n_k - n_s + 1)]
    )
    estimates = [Estimate.normal(vector[j] * factors[j], std[j] * factors[j]) for j in range(n_k)]
    k0, c0 = vector[0], vector[n_s]
    if not k0 > 0.0:
        raise NotDeterminedError("the law found has no stiffness at zero amplitude: lower the orders")
    low_hz = np.sqrt(k0) * unit.rate / (2.0 * np.pi)
    gradient = np.zeros(vector.size)
    gradient[0], gradient[n_s] = -0.25 * c0 / k0**1.5, 0.5 / np.sqrt(k0)
    gain = derivative * np.log(flow.natural)
    measured = (flow.log_level + gain >= min(x.min() for x in logs)) & (
        flow.log_level + gain <= max(x.max() for x in logs)
    )
    return DecayLaw(
        stiffness={n: estimates[n - 1] for n in range(1, n_s + 1)},
        damping={n: estimates[n_s + n - 1] for n in range(1, n_k - n_s + 1)},
        frequency_low_hz=Estimate.normal(low_hz, 0.5 * low_hz * std[0] / k0),
        damping_low=Estimate.normal(0.5 * c0 / np.sqrt(k0), float(np.sqrt(gradient @ covariance @ gradient))),
        amplitude=np.exp(flow.log_level[measured]) * unit.length,
        frequency_hz=flow.natural[measured] * unit.rate / (2.0 * np.pi),
        damping_ratio=(flow.damping / (2.0 * flow.natural))[measured],
        covariance=covariance[:n_k, :n_k] * np.outer(factors, factors),
        misfit=misfit,
        phase_error=phase_error,
        warnings=tuple(warnings),
    )
