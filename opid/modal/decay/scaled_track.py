"""Tracks of decays in the units of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from opid.modal.decay.law_search import LawForm
from opid.modal.decay.slow_flow import Flow, predict_decay
from opid.modal.decay.track import Track
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


@dataclass(frozen=True, eq=False)
class ScaledTrack:
    """A track in units of length and rate, with times and phases from the first window on and the root of its noise."""

    time: FloatArray
    log_amplitude: FloatArray
    phase: FloatArray
    root: FloatArray

    @classmethod
    def from_track(cls, track: Track, length: float, rate: float, derivative: int) -> ScaledTrack:
        """Return a track of a derivative of the displacement in units of `length` and `rate`."""
        # A small addition to the diagonal limits the weight of every window.
        noise = track.covariance + np.diag(1e-6 * np.diag(track.covariance) + 1e-14)
        logs = np.log(track.amplitude / (length * rate**derivative))
        time, root = (track.time_s - track.time_s[0]) * rate, np.asarray(np.linalg.cholesky(noise), dtype=np.float64)
        return cls(time, logs, track.phase - track.phase[0], root)

    def leave_out(self, number: int) -> ScaledTrack:
        """Return the track without the windows of one of `n_blocks` stretches, by its number from 0."""
        n = self.time.size
        kept = np.arange(n) * MODAL.n_blocks // n != number
        both = np.concatenate([kept, kept])
        covariance = (self.root @ self.root.T)[np.ix_(both, both)]
        time, phase = self.time[kept], self.phase[kept]
        root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return ScaledTrack(time - time[0], self.log_amplitude[kept], phase - phase[0], root)

    def errors(self, flow: Flow, start: float, shift: float, derivative: int) -> FloatArray | None:
        """Return the (2n,) errors of log-amplitude and phase of a law over their standard deviation."""
        from scipy.linalg import solve_triangular

        predicted = predict_decay(flow, self.time, start, derivative)
        if predicted is None:
            return None
        misfit = np.concatenate([self.log_amplitude - predicted[0], self.phase - predicted[1] - shift])
        return solve_triangular(self.root, misfit, lower=True)


@dataclass(frozen=True)
class FitUnits:
    """Length and rate by which a fit is scaled, the derivative that was measured, and how well its gain is known."""

    length: float
    rate: float
    derivative: int
    gain_std: float

    def find_factors(self, form: LawForm, vector: FloatArray) -> FloatArray:
        """Return (p,) factors from the coefficients of a form to SI units."""
        of_k = [self.rate**2 * self.length**-n for n in range(form.stiffness_order)]
        of_c = [self.rate * (self.length * self.rate) ** -n for n in range(form.damping_order)]
        of_friction = [self.rate**2 * self.length] * form.has_friction
        force = self.rate**2 * self.length
        of_memory = form.memory.find_factors(form.take_memory(vector), force, self.length) if form.memory else ()
        return np.array([*of_k, *of_c, *of_friction, *of_memory])

    def find_gain_error(self, form: LawForm, vector: FloatArray) -> FloatArray:
        """Return (p,) by how much the coefficients of a form change by one standard deviation of the gain.

        A law of the power n of g q has a coefficient g^(1 - n) times that of q; friction is of the power 0, and so are
        the largest force of a joint and the travel at which it slides.
        """
        above_one = [*range(form.stiffness_order), *range(form.damping_order), *[-1.0] * form.has_friction]
        if form.memory is not None:
            above_one += [power - 1.0 for power in form.memory.count_powers(form.take_memory(vector))]
        return -self.gain_std * np.array(above_one) * vector


def find_span(decays: Sequence[ScaledTrack]) -> tuple[float, float]:
    """Return the logarithms of amplitude between which the law of some decays is solved."""
    low = min(float(each.log_amplitude.min()) for each in decays) - 0.7
    return low, max(float(each.log_amplitude.max()) for each in decays) + 0.4
