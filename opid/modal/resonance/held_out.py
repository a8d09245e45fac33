"""A response curve that no fit has seen, predicted by the law of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, nearest
from opid.estimate import Estimate
from opid.modal.linear.modes import LinearModes
from opid.modal.resonance.curve_fit import CurveFit, fit_curves
from opid.modal.resonance.curves import ResponseCurve, read_curve_states
from opid.modal.resonance.driven_curve import CurveResonance, DrivenCurve, find_law_resonance, find_resonance
from opid.modal.resonance.law import LawCandidate, ResonanceLaw
from opid.modal.resonance.settings import ResonanceSettings
from opid.signals.recording import FloatArray

HIGHEST = "highest"  # the word for the curve of the largest displacement
FEWEST_CURVES = 3  # of which one is held out: two levels at least must show how frequency and damping move
MOST_WITHOUT = 0.05  # fraction of drawn laws without a motion, from which no interval is given


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A response curve that no fit has seen, predicted by the law of others.

    Args:
        fit: the curve beside the prediction.
        fitted: the names of the curves that gave the law, from the lowest to the highest.
        low: (n,) lower end of the 95 % band of the measured amplitude, m/s^2; NaN where the law has no motion.
        high: (n,) its upper end.
        resonance_hz: resonance under the force of this curve by the law; empty where the law has none.
        measured_hz: the measured resonance, by the points near quadrature.
        range_hz: the least and the largest measured resonance of all curves, this one included.
        lowest_hz: the measured resonance of the lowest fitted curve.
        amplitude: amplitude of the mode at resonance by the law, m kg^1/2.
        measured_amplitude: the measured one, m kg^1/2.
        reach: measured amplitude over the largest one that was fitted.
        widened: factor of all these intervals: how far the same prediction of the highest fitted curve from those below
            it was off, in standard deviations; 1 where it was within them, or where there were too few curves.
        reason: why there is no prediction, "" if there is one.
    """

    fit: CurveFit
    fitted: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    resonance_hz: Estimate
    measured_hz: Estimate
    range_hz: tuple[float, float]
    lowest_hz: float
    amplitude: Estimate
    measured_amplitude: float
    reach: float
    widened: float
    reason: str

    @property
    def shift_hz(self) -> float:
        """How far the measured resonance moves over all curves, Hz."""
        return self.range_hz[1] - self.range_hz[0]

    @property
    def error_fraction(self) -> float:
        """Error of the predicted resonance as a fraction of that shift; NaN without a prediction."""
        if self.resonance_hz.value is None or self.measured_hz.value is None:
            return float("nan")
        return float((self.resonance_hz.value - self.measured_hz.value) / self.shift_hz)

    def as_json(self) -> dict[str, Any]:
        """Return the prediction as result.json holds it; the curve itself stands among the curves."""
        of_resonance = ("range_hz", "lowest_hz", "shift_hz", "error_fraction")
        numbers = (*of_resonance, "low", "high", "measured_amplitude", "reach", "widened")
        estimates = ("resonance_hz", "measured_hz", "amplitude")
        return {
            "curve": self.fit.as_json(),
            "fitted": self.fitted,
            "reason": self.reason,
            **{name: getattr(self, name) for name in numbers},
            **{name: asdict(getattr(self, name)) for name in estimates},
        }


def choose_held_out(curves: Sequence[ResponseCurve], wanted: str, modes: LinearModes, mode: int) -> ResponseCurve:
    """Return the curve that is held out: that of a name, or that of the largest displacement where it is "highest".

    Raises:
        InputError: no such curve, or too few others.
    """
    if len(curves) < FEWEST_CURVES:
        raise InputError(
            f"mode {mode} has {len(curves)} response curve(s), and a prediction of one from the others needs "
            f"{FEWEST_CURVES}: give more [[curves]], at different levels of the force"
        )
    if wanted == HIGHEST:
        index = modes.index(mode)
        return max(
            curves,
            key=lambda each: float(np.max(each.amplitude / each.frequency_hz**2) / abs(modes.row(each.sensor)[index])),
        )
    names = [each.name for each in curves]
    if wanted not in names:
        raise InputError(f"there is no curve {wanted!r} to hold out: {nearest(wanted, names)}, or say {HIGHEST!r}")
    return curves[names.index(wanted)]


def predict_held_out(
    curve: ResponseCurve,
    others: Sequence[ResponseCurve],
    law: ResonanceLaw,
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    settings: ResonanceSettings | None = None,
) -> HeldOut:
    """Predict a response curve by a law that has not seen it, with a band, and compare the two.

    The band holds what noise, gain, phase and the choice of the powers leave open. Beyond the amplitudes that were
    fitted nothing shows whether the powers go on, so the same prediction is made of the highest fitted curve from those
    below it: if it was off by more than its standard deviation, all intervals are widened by as much.

    Args:
        curve: the curve that was held out.
        others: the curves that gave the law, perhaps beside levels.
        law: the law.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        stiffness_order: N_s, 1 to 5; chosen where None.
        damping_order: N_d, 1 to 5; chosen where None.
        settings: which points count; the usual ones where left out.

    Raises:
        InputError: what `read_curve_states` refuses, or a curve that shows no stiffness.
    """
    chosen = settings or ResonanceSettings()
    place: dict[str, Any] = {"modes": modes, "mode": mode, "drive_point": drive_point}
    ranked = sorted(others, key=lambda each: max(state.amplitude for state in read_curve_states(each, **place)))
    widened = 1.0
    if len(ranked) >= FEWEST_CURVES:
        orders: dict[str, Any] = {"stiffness_order": stiffness_order, "damping_order": damping_order}
        below = fit_curves(ranked[:-1], **place, **orders, settings=chosen).law
        if below is not None:
            rehearsed = _predict(ranked[-1], ranked[:-1], below, place, chosen)
            widened = max(1.0, _find_miss(rehearsed))
    found = _predict(curve, ranked, law, place, chosen)
    return _widen(found, widened)


def _find_miss(found: HeldOut) -> float:
    """Return by how many standard deviations a predicted resonance is off; 0 without a prediction."""
    made, seen = found.resonance_hz, found.measured_hz
    if made.value is None or made.std is None or seen.value is None:
        return 0.0
    return float(abs(made.value - seen.value) / np.hypot(made.std, seen.std or 0.0))


def _widen(found: HeldOut, factor: float) -> HeldOut:
    middle = np.abs(found.fit.response)
    # Ratios of amplitudes keep the lower end above zero.
    low, high = (middle * (end / middle) ** factor for end in (found.low, found.high))
    hz, amplitude = (_scale(each, factor) for each in (found.resonance_hz, found.amplitude))
    return replace(found, low=low, high=high, widened=factor, resonance_hz=hz, amplitude=amplitude)


def _scale(estimate: Estimate, factor: float) -> Estimate:
    if estimate.value is None or estimate.std is None or estimate.interval95 is None:
        return estimate
    value = estimate.value
    low, high = (value + factor * (end - value) for end in estimate.interval95)
    return Estimate(value, factor * estimate.std, (low, high))


def _predict(
    curve: ResponseCurve,
    others: Sequence[ResponseCurve],
    law: ResonanceLaw,
    place: dict[str, Any],
    settings: ResonanceSettings,
) -> HeldOut:
    best, rng = law.candidates[0], np.random.default_rng(0)
    driven = DrivenCurve.of(curve, **place)
    shape = float(np.abs(driven.shape))

    def find_measured(each: ResponseCurve) -> CurveResonance:
        states = read_curve_states(each, **place, settings=settings)
        found = find_resonance(states, best, each.error_fraction, shape, settings)
        if found is None:
            raise InputError(
                f"response curve {each.name!r} shows no stiffness near quadrature: check its unit and its force, or "
                "leave it out"
            )
        return found

    measured, *seen = map(find_measured, (curve, *others))
    most = settings.farthest_reach * float(law.amplitude.max())
    response = driven.find_response(best, most, driven.measured)
    made = find_law_resonance(best, measured.force, most)
    weights = np.array([each.weight for each in law.candidates])
    picked = rng.choice(weights.size, settings.n_draws, p=weights / weights.sum())
    states = 1.0 + _find_scatter(seen, best, most) * rng.standard_normal(settings.n_draws)
    drawn = [
        law.candidates[index].draw(rng).with_state(state)
        for index, state in zip(picked.tolist(), states.tolist(), strict=True)
    ]
    near = np.abs((response - driven.others) / (driven.omega**2 * driven.shape))
    every = np.array([np.abs(driven.find_response(each, most, near)) for each in drawn])
    every *= 1.0 + curve.error_fraction * rng.standard_normal(every.shape)
    low, high = _find_band(every, np.abs(response))
    ends = np.array([find_law_resonance(each, measured.force, most) for each in drawn])
    reason = "" if np.isfinite(made).all() else _explain_no_resonance(curve, settings)
    return HeldOut(
        fit=CurveFit(curve, response, True),
        fitted=tuple(each.name for each in others),
        low=low,
        high=high,
        resonance_hz=_summarise(made[0], ends[:, 0]),
        measured_hz=Estimate.normal(measured.hz, measured.hz_std),
        range_hz=(min(each.hz for each in (measured, *seen)), max(each.hz for each in (measured, *seen))),
        lowest_hz=seen[0].hz,
        amplitude=_summarise(made[1], ends[:, 1]),
        measured_amplitude=measured.amplitude,
        reach=measured.amplitude / float(law.amplitude.max()),
        widened=1.0,
        reason=reason,
    )


def _find_scatter(seen: Sequence[CurveResonance], law: LawCandidate, most: float) -> float:
    """Return by how much the resonances of curves scatter about their law, rms, as a fraction of the frequency.

    The structure is in another state in each curve, and so it is in the one that is predicted.
    """
    made = np.array([find_law_resonance(law, each.force, most)[0] for each in seen])
    missed = made / np.array([each.hz for each in seen]) - 1.0
    missed = missed[np.isfinite(missed)]
    # The law has followed some of the scatter: two curves less tell it.
    return float(np.sqrt(np.sum(missed**2) / max(missed.size - 2, 1))) if missed.size else 0.0


def _explain_no_resonance(curve: ResponseCurve, settings: ResonanceSettings) -> str:
    return (
        f"the law by the other curves has no resonance under the force of {curve.name!r} up to "
        f"{settings.farthest_reach:g} times their largest amplitude: it does not go on to this level; record levels "
        "between them"
    )


def _find_band(drawn: FloatArray, response: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the 95 % band of drawn responses (n_draws, n), NaN where many of the draws have no motion."""
    known = np.isfinite(response) & (np.mean(np.isfinite(drawn), axis=0) > 1.0 - MOST_WITHOUT)
    low, high = np.full((2, response.size), np.nan)
    if known.any():
        low[known], high[known] = np.nanpercentile(drawn[:, known], (2.5, 97.5), axis=0)
    return low, high


def _summarise(value: float, drawn: FloatArray) -> Estimate:
    """Return the estimate with the interval of the draws; without an interval where many of them have no value."""
    if not np.isfinite(value):
        return Estimate()
    if np.mean(np.isnan(drawn)) > MOST_WITHOUT:
        return Estimate(value)
    low, high = np.nanpercentile(drawn, (2.5, 97.5))
    return Estimate(value, float(high - low) / 3.92, (min(float(low), value), max(float(high), value)))


# ---- a modal mass that nobody knows ---------------------------------------------------------------------
