"""The law of a mode from its free decays alone: q'' + c0 q' + k0 q + sum c_n q'|q'|^(n-1) + sum k_n q|q|^(n-1) = 0.

Start values come from the harmonic linearisation of frequency and damping over amplitude, which is linear in the
coefficients. Then amplitude and phase of each decay are fitted to the measured ones over all its time. They follow from
a law without time steps, by harmonic balance and averaging: A' = -delta(A) A, phi' = omega(A). The terms of second
order in damping and in the drift of the frequency are kept: the frequency of the fundamental is then right to about
1e-5 for a shift of 3 % and a damping ratio of 1 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.laws.law import Law
from opid.modal.decay.track import Track
from opid.modal.forced.restoring_fit import sum_lagged_products
from opid.modal.power_laws import HIGHEST_ORDER, coefficients_json, make_fitted_law
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

IMPOSSIBLE = 1e8  # error of a law that does not vibrate or does not decay over all the record, standard deviations


@dataclass(frozen=True, eq=False)
class DecayLaw:
    """The restoring force of a mode from its free decays, without any measured force.

    Args:
        stiffness: k_n by its power n, where 1 is k0: force per unit mass (or modal force) over displacement^n.
        damping: c_n by its power n, where 1 is c0: force per unit mass (or modal force) over velocity^n.
        frequency_low_hz: natural frequency at zero amplitude, Hz.
        damping_low: damping ratio at zero amplitude.
        amplitude: (n,) displacement amplitudes within those of the decays.
        frequency_hz: (n,) natural frequency at these amplitudes, Hz.
        damping_ratio: (n,) damping ratio at these amplitudes.
        covariance: covariance of k0, k_2 ..., c0, c_2 ... in this order.
        misfit: rms error of amplitude and phase over its standard deviation; noise alone gives 1.
        phase_error: rms error of phase, rad, and of relative amplitude.
        warnings: one sentence for each warning about the law.
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
        return make_fitted_law(self.stiffness, self.damping)

    def as_json(self) -> dict[str, Any]:
        """Return the law as result.json holds it."""
        return {
            **coefficients_json(self.stiffness, self.damping),
            "frequency_low_hz": asdict(self.frequency_low_hz),
            "damping_low": asdict(self.damping_low),
            **{name: getattr(self, name) for name in ("amplitude", "frequency_hz", "damping_ratio", "misfit")},
            "warnings": self.warnings,
        }


@dataclass(frozen=True, eq=False)
class Flow:
    """The slow motion of the fundamental A(t) cos phi(t) of a free decay, as functions of its amplitude."""

    log_amplitude: FloatArray  # (n,) logarithm of A, rising
    omega: FloatArray  # (n,) phi'
    rate: FloatArray  # (n,) delta = -A'/A
    natural: FloatArray  # (n,) natural frequency, without the terms of second order
    damping: FloatArray  # (n,) c = 2 zeta omega
    # (n,) delta' - j omega': (A exp(j phi))'' = -((omega + j delta)^2 + drift) A exp(j phi)
    drift: NDArray[np.complex128]


def find_backbone(track: Track, derivative: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return displacement amplitude, natural frequency (rad/s), its std, c = 2 zeta omega (1/s) and its std, each (n,).

    From phase and amplitude of a free vibration A(t) cos phi(t) (Feldman 1994, Mech. Syst. Signal Process. 8, eq. 6)

        omega^2 = phi'^2 - A''/A - c A'/A,   c = -2 A'/A - phi''/phi',

    where A = B / |j phi' - delta|^m for the m-th derivative of the displacement that the track shows.
    """
    rate = track.rate + derivative * track.chirp / track.omega
    damping = 2.0 * rate + -track.chirp / track.omega
    amplitude = track.amplitude / (track.omega**2 + rate**2) ** (0.5 * derivative)
    order = np.argsort(track.time_s)
    smooth = np.polyfit(track.time_s[order], rate[order], 1, w=1.0 / np.maximum(track.rate_std[order], 1e-300))[0]
    natural = np.sqrt(np.maximum(track.omega**2 - rate**2 + smooth + damping * rate, 1e-300))
    drift_std = MODAL.drift_error * (2 * derivative - 1) * track.chirp / track.omega
    return amplitude, natural, track.omega_std, damping, np.hypot(2.0 * track.rate_std, drift_std)


def fit_decays(
    tracks: Sequence[Track],
    *,
    derivative: int = 2,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
) -> DecayLaw:
    """Fit one law to one or several free decays of a mode.

    The tracks are of accelerations, or of velocities (`derivative` 1) or displacements (0). An order of 1 is linear;
    where an order is None, the one with the lowest Bayesian criterion is taken.

    Raises:
        InputError: orders outside 1 to 5.
        NotDeterminedError: fewer windows than coefficients, or a law that does not decay.
    """
    for word, order in (("stiffness_order", stiffness_order), ("damping_order", damping_order)):
        if order is not None and not 1 <= order <= HIGHEST_ORDER:
            raise InputError(f"{word} is {order}, give 1 (linear) to {HIGHEST_ORDER}")
    amplitude, natural, natural_std, damping, damping_std = (
        np.concatenate(parts) for parts in zip(*(find_backbone(each, derivative) for each in tracks), strict=True)
    )
    # In these units the coefficients of all powers have similar sizes.
    length, rate = float(amplitude.max()), float(np.median(natural))
    level = amplitude / length
    warnings: tuple[str, ...] = ()
    if level.max() < MODAL.least_range * level.min():
        falls = f"the amplitude falls only by a factor of {level.max() / level.min():.2g}"
        warnings = (f"{falls}: the powers above 1 are poorly determined, record a longer decay or a stronger impact",)
    square, speed = (natural / rate) ** 2, level * natural / rate
    of_speed = (speed, damping / rate, damping_std / rate)
    k = _fit_linear(level, square, 2.0 * natural_std * natural / rate**2, stiffness_order)
    c = _fit_linear(*of_speed, damping_order)
    n_coefficients, n_data = k.size + c.size, 2 * amplitude.size
    if n_data <= n_coefficients + 2 * len(tracks) + 2:
        raise NotDeterminedError(
            f"{n_data} amplitudes and phases cannot determine {n_coefficients} coefficients: lower the orders"
        )
    tame = np.zeros(k.size), np.zeros(c.size)
    tame[0][0], tame[1][0] = float(np.median(square)), max(float(_fit_linear(*of_speed, 1)[0]), 1e-5)
    decays = [_ScaledTrack.from_track(track, length, rate, derivative) for track in tracks]
    fit = _refine(decays, (k, c), tame, derivative)
    std = np.sqrt(np.diag(fit.covariance))
    factors = np.array(
        [rate**2 * length**-n for n in range(k.size)] + [rate * (length * rate) ** -n for n in range(c.size)]
    )
    estimates = [Estimate.normal(fit.vector[j] * each, std[j] * each) for j, each in enumerate(factors)]
    k0, c0 = fit.vector[0], fit.vector[k.size]
    if not k0 > 0.0:
        raise NotDeterminedError("the fitted law has no stiffness at zero amplitude: lower the orders")
    low_hz = np.sqrt(k0) * rate / (2.0 * np.pi)
    gradient = np.zeros(fit.vector.size)
    gradient[0], gradient[k.size] = -0.25 * c0 / k0**1.5, 0.5 / np.sqrt(k0)
    seen = fit.flow.log_amplitude + derivative * np.log(fit.flow.natural)
    logs = np.concatenate([each.log_amplitude for each in decays])
    measured = (seen >= logs.min()) & (seen <= logs.max())
    return DecayLaw(
        stiffness=dict(enumerate(estimates[: k.size], start=1)),
        damping=dict(enumerate(estimates[k.size :], start=1)),
        frequency_low_hz=Estimate.normal(low_hz, 0.5 * low_hz * std[0] / k0),
        damping_low=Estimate.normal(0.5 * c0 / np.sqrt(k0), float(np.sqrt(gradient @ fit.covariance @ gradient))),
        amplitude=np.exp(fit.flow.log_amplitude[measured]) * length,
        frequency_hz=fit.flow.natural[measured] * rate / (2.0 * np.pi),
        damping_ratio=(fit.flow.damping / (2.0 * fit.flow.natural))[measured],
        covariance=fit.covariance[:n_coefficients, :n_coefficients] * np.outer(factors, factors),
        misfit=fit.misfit,
        phase_error=fit.phase_error,
        warnings=warnings,
    )


def solve_slow_flow(k: FloatArray, c: FloatArray, low: float, high: float) -> Flow | None:
    """Return the slow flow of a law from amplitude exp(low) to exp(high); None if it does not vibrate or decay.

    k = (k0, k_2, ...) belongs to q|q|^(n-1), c = (c0, c_2, ...) to q'|q'|^(n-1).

    >>> flow = solve_slow_flow(np.array([1.0]), np.array([0.02]), -1.0, 0.0)
    >>> round(float(flow.rate[0]), 6), round(float(flow.omega[0]), 6)
    (0.01, 0.99995)
    """
    log_amplitude = np.linspace(low, high, 100)
    a = np.exp(log_amplitude)[:, None]
    angle = np.pi * (np.arange(24) + 0.5) / 24  # half a cycle; the other half is its mirror image
    cosine, sine = np.cos(angle), np.sin(angle)
    third_cosine, third_sine = np.cos(3.0 * angle), np.sin(3.0 * angle)
    in_phase, quadrature = np.zeros_like(a), np.zeros_like(a)
    omega, drag = np.full_like(a, np.sqrt(max(k[0], 1e-12))), np.zeros((1, 1))
    for _ in range(5):
        q = a * cosine + in_phase * third_cosine + quadrature * third_sine
        v = -omega * (a * sine + 3.0 * (in_phase * third_sine - quadrature * third_cosine))
        drag = _sum_higher_powers(c, v)
        force = _sum_higher_powers(k, q) + drag
        square = k[0] + _find_harmonic(force, cosine) / a
        if (square <= 0.0).any():
            return None
        omega = np.sqrt(square)
        in_phase = _find_harmonic(force, third_cosine) / (9.0 * square - k[0])
        quadrature = _find_harmonic(force, third_sine) / (9.0 * square - k[0])
    damping = c[0] - (_find_harmonic(drag, sine) / (omega * a))[:, 0]
    natural = omega[:, 0]
    step = log_amplitude[1] - log_amplitude[0]
    rate = damping / (2.0 + np.gradient(np.log(natural), step, edge_order=2))
    if (rate <= 0.0).any():
        return None
    rate_drift = -rate * np.gradient(rate, step, edge_order=2)
    damped = np.sqrt(np.maximum(natural**2 + rate**2 - damping * rate - rate_drift, 1e-12))
    drift = rate_drift + 1j * rate * np.gradient(damped, step, edge_order=2)
    return Flow(log_amplitude, damped, rate, natural, damping, drift)


def predict_decay(
    flow: Flow, time: FloatArray, log_start: float, derivative: int
) -> tuple[FloatArray, FloatArray] | None:
    """Return log-amplitude and phase of the m-th derivative, (n,) each; None where the flow does not reach so far.

    The first time is 0; there the displacement has the amplitude exp(log_start) and the phase 0.
    """
    from scipy.interpolate import CubicSpline

    fall = flow.log_amplitude[::-1]
    since = CubicSpline(-fall, 1.0 / flow.rate[::-1]).antiderivative()(-fall)
    turned = CubicSpline(-fall, flow.omega[::-1] / flow.rate[::-1]).antiderivative()(-fall)
    own_time = since - np.interp(-log_start, -fall, since)
    if (np.diff(own_time) <= 0.0).any() or not own_time[0] <= time[0] <= time[-1] <= own_time[-1]:
        return None
    # Times and amplitudes map smoothly onto each other, so amplitude and phase are functions of time.
    log_amplitude = CubicSpline(own_time, fall)(time)
    by_time = CubicSpline(own_time, turned)(time)
    omega, rate = (np.interp(log_amplitude, flow.log_amplitude, each) for each in (flow.omega, flow.rate))
    # Each derivative of A e^(j phi) multiplies it by -delta + j omega; for the second one these change as well.
    gain = (omega + 1j * rate) ** derivative
    if derivative == 2:
        gain = gain + np.interp(log_amplitude, flow.log_amplitude, flow.drift)
    return log_amplitude + np.log(np.abs(gain)), by_time - by_time[0] + np.angle(gain)


def _sum_higher_powers(values: FloatArray, x: FloatArray) -> FloatArray:
    """Return sum_n values_n x |x|^(n-1) from n = 2 on."""
    size, total = np.abs(x), np.zeros_like(x)
    for value in values[:0:-1]:
        total = (total + value) * size
    return total * x


def _find_harmonic(force: FloatArray, shape: FloatArray) -> FloatArray:
    return 2.0 * (force @ shape / shape.size)[:, None]


def _fit_linear(level: FloatArray, y: FloatArray, std: FloatArray, order: int | None) -> FloatArray:
    """Return the coefficients of y = sum_n value_n a_n level^(n-1), n = 1 .. order."""
    std = np.maximum(std, 1e-12 * float(np.median(np.abs(y))) + 1e-300)
    best: tuple[float, FloatArray] = (np.inf, np.zeros(0))
    for trial in range(1, HIGHEST_ORDER + 1) if order is None else (order,):
        if trial >= level.size - 1:
            break
        columns = np.column_stack([first_harmonic_factor(n) * level ** (n - 1) for n in range(1, trial + 1)])
        values = np.asarray(np.linalg.lstsq(columns / std[:, None], y / std, rcond=1e-12)[0], dtype=np.float64)
        misfit = float(np.sum(((y - columns @ values) / std) ** 2))
        # Windows overlap by half, so three are worth about two.
        n = 0.67 * level.size
        score = n * np.log(max(misfit / level.size, 0.5)) + trial * np.log(n)
        if score < best[0]:
            best = (score, values)
    if not best[1].size:
        raise NotDeterminedError(f"{level.size} windows cannot determine {order or 1} coefficients: lower the orders")
    return best[1]


@dataclass(frozen=True, eq=False)
class _ScaledTrack:
    """A track in units of length and rate, with times and phases from the first window on and the root of its noise."""

    time: FloatArray
    log_amplitude: FloatArray
    phase: FloatArray
    root: FloatArray

    @classmethod
    def from_track(cls, track: Track, length: float, rate: float, derivative: int) -> _ScaledTrack:
        # A small addition to the diagonal limits the weight of every window.
        noise = track.covariance + np.diag(1e-6 * np.diag(track.covariance) + 1e-14)
        logs = np.log(track.amplitude / (length * rate**derivative))
        time, root = (track.time_s - track.time_s[0]) * rate, np.asarray(np.linalg.cholesky(noise), dtype=np.float64)
        return cls(time, logs, track.phase - track.phase[0], root)

    def errors(self, flow: Flow, start: float, shift: float, derivative: int) -> FloatArray | None:
        """Return the (2n,) errors of log-amplitude and phase of a law over their standard deviation."""
        from scipy.linalg import solve_triangular

        predicted = predict_decay(flow, self.time, start, derivative)
        if predicted is None:
            return None
        misfit = np.concatenate([self.log_amplitude - predicted[0], self.phase - predicted[1] - shift])
        return solve_triangular(self.root, misfit, lower=True)


@dataclass(frozen=True, eq=False)
class _Fit:
    """A vector of k, c, then start and phase of each decay; its covariance, the flow of the law, and the misfit."""

    vector: FloatArray
    covariance: FloatArray
    flow: Flow
    misfit: float
    phase_error: float


def _refine(
    decays: Sequence[_ScaledTrack],
    guess: tuple[FloatArray, FloatArray],
    tame: tuple[FloatArray, FloatArray],
    derivative: int,
) -> _Fit:
    from scipy.optimize import least_squares

    low = min(float(each.log_amplitude.min()) for each in decays) - 0.7
    high = max(float(each.log_amplitude.max()) for each in decays) + 0.4
    n_s, n_k = guess[0].size, guess[0].size + guess[1].size
    sizes = [2 * each.time.size for each in decays]

    def errors(vector: FloatArray) -> FloatArray:
        flow = solve_slow_flow(vector[:n_s], vector[n_s:n_k], low, high)
        if flow is not None:
            pairs = zip(decays, vector[n_k:].reshape(-1, 2), strict=True)
            found = [each.errors(flow, start, shift, derivative) for each, (start, shift) in pairs]
            parts = [part for part in found if part is not None]
            if len(parts) == len(decays):
                return np.concatenate(parts)
        return np.full(sum(sizes), IMPOSSIBLE)

    starts = [np.array([each.log_amplitude[0], 0.0]) for each in decays]
    start = np.concatenate([*guess, *starts])
    if np.abs(errors(start)).max() >= IMPOSSIBLE:
        # The law of the start values does not vibrate or decay, but its linear part alone does.
        start = np.concatenate([*tame, *starts])
    of_damping = np.full(n_k - n_s, max(abs(float(guess[1][0])), 1e-4))
    scale = np.concatenate([np.ones(n_s), of_damping, np.full(2 * len(decays), 0.1)])
    found = least_squares(errors, start, x_scale=scale, method="trf", xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=60)
    flow = solve_slow_flow(found.x[:n_s], found.x[n_s:n_k], low, high)
    if flow is None or not np.abs(found.fun).max() < IMPOSSIBLE:
        raise NotDeterminedError("no law of these orders decays over all amplitudes of the record: lower the orders")
    parts = np.split(found.fun, np.cumsum(sizes)[:-1])
    misfits = np.concatenate([each.root @ part for each, part in zip(decays, parts, strict=True)])
    misfit = float(np.sqrt(np.sum(found.fun**2) / max(found.fun.size - found.x.size, 1)))
    return _Fit(
        found.x, _find_covariance(found.jac, found.fun, sizes), flow, misfit, float(np.sqrt(np.mean(misfits**2)))
    )


def _find_covariance(jacobian: FloatArray, errors: FloatArray, sizes: Sequence[int]) -> FloatArray:
    """Return the covariance of the parameters for white errors or, where that is larger, for correlated ones.

    The scores of windows up to the lag 2 n^(1/3) apart, amplitude and phase together, may be correlated.
    """
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    scaled = jacobian / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13, hermitian=True)
    n, p = jacobian.shape
    white = inverse * max(float(errors @ errors) / max(n - p, 1), 1.0)
    meat = np.zeros((p, p))
    for scores in np.split(scaled * errors[:, None], np.cumsum(sizes)[:-1]):
        both = scores.reshape(2, -1, p).sum(axis=0)
        meat += sum_lagged_products(both, int(2.0 * len(both) ** (1.0 / 3.0)))
    coloured = n / max(n - p, 1) * inverse @ meat @ inverse
    wider = np.sqrt(np.maximum(np.diag(coloured) / np.maximum(np.diag(white), 1e-300), 1.0))
    return white * np.outer(wider, wider) / np.outer(scale, scale)
