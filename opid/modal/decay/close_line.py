"""A weak line so close to a mode that no window of its decay separates them: another mode, hum, or a force that fades.

Where a law misses amplitude and phase of a decay, a line C exp((-d + j w) t) is fitted together with a law. It bends
both in proportion to its ratio to the mode, which grows where the mode falls faster.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from opid.errors import NotDeterminedError
from opid.modal.decay.forms import DecayProblem
from opid.modal.decay.law_search import LawForm, score_misfit
from opid.modal.decay.scaled_track import ScaledTrack, find_span
from opid.modal.decay.slow_flow import predict_decay, solve_slow_flow
from opid.modal.decay.track import Track
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

SIZE = 4  # logarithm of the size of a line, its angle, rad, angular frequency, rad/s, and rate of decay, 1/s


@dataclass(frozen=True, eq=False)
class CloseLine:
    """A line beside a mode.

    Args:
        log_phasor: logarithm of its size and its angle at the first window, in the unit of the signal.
        pole: -d + j w.
        covariance: (4, 4) covariance of the logarithm of the size, the angle, w and d.
        ratio: its size over that of the mode at the first window.
        gain: by how much a law beside it is better than the best law alone, in the Bayesian criterion.
    """

    log_phasor: complex
    pole: complex
    covariance: FloatArray
    ratio: float
    gain: float

    @property
    def frequency_hz(self) -> float:
        """Its frequency, Hz."""
        return float(self.pole.imag / (2.0 * np.pi))

    def subtract(self, track: Track) -> Track:
        """Return the track of the mode alone.

        The covariance has so much of the error of the line that a fit to the track is one of the law and the line.
        """
        time = track.time_s - track.time_s.min()
        part = np.exp(self.log_phasor + self.pole * time - np.log(track.amplitude) - 1j * track.phase)
        left = 1.0 - part
        slope = (-track.rate + 1j * track.omega - part * self.pole) / left
        bend = -part / left
        by_line = np.stack([bend, 1j * bend, 1j * time * bend, -time * bend], axis=1)
        both = np.concatenate([by_line.real, by_line.imag])
        return replace(
            track,
            amplitude=track.amplitude * np.abs(left),
            phase=track.phase + np.angle(left),
            omega=slope.imag,
            rate=-slope.real,
            omega_std=np.hypot(track.omega_std, np.abs(bend * (self.pole.imag - track.omega)) * MODAL.line_error),
            rate_std=np.hypot(track.rate_std, np.abs(bend * (self.pole.real + track.rate)) * MODAL.line_error),
            covariance=track.covariance + MODAL.free_line**2 * both @ self.covariance @ both.T,
        )


@dataclass(frozen=True, eq=False)
class LawAlone:
    """A law without a line: its form, its coefficients in the units of the fit, and its squared errors."""

    form: LawForm
    vector: FloatArray
    squares: float


def find_close_line(problem: DecayProblem, track: Track, best: LawAlone | None) -> CloseLine | None:
    """Return a line that explains, beside a law, what the best law misses of one decay; None where there is none.

    Args:
        problem: the decay in the units of a fit, with the orders that are asked for.
        track: the decay.
        best: the best law without a line; None where no law was found.
    """
    decay, rate = problem.decays[0], problem.units.rate
    n, found = problem.n_data, []
    for form, guess in _list_forms(problem, best):
        if 0.5 * n < MODAL.windows_per_value * (form.size + SIZE):
            continue
        fitted = _fit_with_line(decay, form, guess, problem.units.derivative)
        if fitted is not None:
            found.append((form, *fitted))
    if not found:
        return None
    laws = [] if best is None else [best]
    squares = [float(errors @ errors) for _, _, errors, _ in found] + [each.squares for each in laws]
    sizes = [form.size + SIZE for form, *_ in found] + [each.form.size for each in laws]
    scores = score_misfit(squares, n, sizes)
    scores += [form.prior_score + MODAL.joint_evidence for form, *_ in found] + [each.form.prior_score for each in laws]
    chosen = int(np.argmin(scores[: len(found)]))
    form, vector, errors, covariance = found[chosen]
    gain = float(scores[len(found)] - scores[chosen]) if laws else np.inf
    if gain < MODAL.decisive or problem.is_beyond_noise(
        float(errors @ errors), form.size + 2 + SIZE, MODAL.chance_misfit
    ):
        return None
    size, angle, omega, fall = vector[-SIZE:]
    scale = problem.units.length * rate**problem.units.derivative
    factors = np.array([1.0, 1.0, rate, rate])
    return CloseLine(
        complex(size + np.log(scale), angle + track.phase[np.argmin(track.time_s)]),
        complex(-fall, omega) * rate,
        covariance * np.outer(factors, factors),
        float(np.exp(size - decay.log_amplitude[0])),
        gain,
    )


def _list_forms(problem: DecayProblem, best: LawAlone | None) -> list[tuple[LawForm, FloatArray]]:
    """Return forms that may stand beside a line, and their start values: simple ones, and the best one without it."""
    forms = [] if best is None else [(best.form, best.vector)]
    for orders in MODAL.orders_beside_line:
        if any(each not in (None, own) for each, own in zip(_asked(problem), orders, strict=True)):
            continue
        try:
            forms += replace(problem, stiffness_order=orders[0], damping_order=orders[1]).search_forms(False, False)
        except NotDeterminedError:
            continue
    return list({form: (form, guess) for form, guess in reversed(forms)}.values())


def _asked(problem: DecayProblem) -> tuple[int | None, int | None]:
    return problem.stiffness_order, problem.damping_order


def _fit_with_line(
    decay: ScaledTrack, form: LawForm, guess: FloatArray, derivative: int
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return coefficients, start, shift and line by one decay, the errors, and the covariance of the line."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import least_squares

    low, high = find_span([decay])
    seen = decay.log_amplitude + 1j * decay.phase

    def predict(vector: FloatArray) -> NDArray[np.complex128] | None:
        k, c, joint = form.split(vector)
        flow = solve_slow_flow(k, c, low, high, joint) if form.may_vibrate(vector) else None
        found = None if flow is None else predict_decay(flow, decay.time, float(vector[form.size]), derivative)
        return None if found is None else found[0] + 1j * (found[1] + vector[form.size + 1])

    def errors(vector: FloatArray) -> FloatArray:
        mode = predict(vector)
        if mode is None:
            return np.full(2 * decay.time.size, 1e8)
        off = seen - mode
        if vector.size > form.size + 2:
            size, angle, omega, fall = vector[-SIZE:]
            line = np.exp(np.clip(size - mode.real, -50.0, 5.0) - fall * decay.time)
            off = off - np.log(1.0 + line * np.exp(1j * (angle + omega * decay.time - mode.imag)))
        return solve_triangular(decay.root, np.concatenate([off.real, off.imag]), lower=True)

    first = np.concatenate([guess, [decay.log_amplitude[0], 0.0]])
    scale = np.concatenate([np.full(form.size, 0.1), [0.1, 0.1]])
    if np.abs(errors(first)).max() >= 1e8:
        return None
    alone = least_squares(errors, first, x_scale=scale, max_nfev=40)
    mode = predict(alone.x)
    if mode is None or np.abs(alone.fun).max() >= 1e8:
        return None
    start = _find_start(decay, mode, alone.jac, alone.fun)
    if start is None:
        return None
    whole = least_squares(
        errors, np.concatenate([alone.x, start]), x_scale=np.concatenate([scale, [0.3, 0.3, 1e-3, 1e-3]]), max_nfev=80
    )
    fall, turned = float(whole.x[-1]), float(np.ptp(whole.x[-2] * decay.time - mode.imag))
    own = float(-np.polyfit(decay.time, decay.log_amplitude, 1)[0])
    is_line = -MODAL.rising_line * own < fall < MODAL.alike_damping * own and turned > MODAL.least_turn
    inverse = np.linalg.pinv(whole.jac.T @ whole.jac, rcond=1e-14, hermitian=True)
    return (whole.x, whole.fun, inverse[-SIZE:, -SIZE:]) if is_line else None


def _find_start(
    decay: ScaledTrack, mode: NDArray[np.complex128], jacobian: FloatArray, errors: FloatArray
) -> FloatArray | None:
    """Return size, angle, frequency and rate of the line that, to the first order, lowers the errors of a law most."""
    from scipy.linalg import solve_triangular

    time = decay.time
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    left = errors - basis @ (basis.T @ errors)
    mean = float(np.polyfit(time, mode.imag, 1)[0])
    own = float(-np.polyfit(time, mode.real, 1)[0])
    step = 0.5 * np.pi / time[-1]
    number = min(int(MODAL.searched_line * mean / step), 200)
    omega = mean + step * np.arange(-number, number + 1)
    best: tuple[float, FloatArray] | None = None
    for fall in (0.0, 0.6 * own, own, 1.6 * own):
        part = np.exp((1j * omega - fall) * time[:, None] - mode[:, None])
        one, other = (
            solve_triangular(decay.root, np.concatenate([each.real, each.imag]), lower=True)
            for each in (-part, -1j * part)
        )
        one, other = (each - basis @ (basis.T @ each) for each in (one, other))
        # Least squares of two columns for each frequency at once
        a, b, c = (np.sum(x * y, axis=0) for x, y in ((one, one), (one, other), (other, other)))
        d, e = -left @ one, -left @ other
        size = np.maximum(a * c - b**2, 1e-12 * a * c + 1e-300)
        real, imaginary = (c * d - b * e) / size, (a * e - b * d) / size
        saved = real * d + imaginary * e
        k = int(np.argmax(saved))
        if best is None or saved[k] > best[0]:
            phasor = complex(real[k], imaginary[k])
            best = float(saved[k]), np.array([np.log(abs(phasor) + 1e-12), np.angle(phasor), omega[k], fall])
    return None if best is None else best[1]
