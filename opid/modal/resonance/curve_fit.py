"""The law of a mode from its response curves, what speaks against it, and the curves that a law makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.mechanics.structure import ComplexArray
from opid.modal.forced.mode_fit import UNITS
from opid.modal.linear.modes import LinearModes
from opid.modal.resonance.curves import ResponseCurve, add_other_modes, read_curve_states
from opid.modal.resonance.law import LawCandidate, ResonanceLaw, StateCheck, check_states, fit_states
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import SteadyState
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

N_AMPLITUDES = 2000  # at which the equation of the mode is solved; a root between two of them is interpolated
HIGHEST = "highest"  # the word for the curve of the largest displacement
FEWEST_NEAR = 3  # points of a curve near quadrature through which a line is drawn
FEWEST_CURVES = 3  # of which one is held out: two levels at least must show how frequency and damping move
MOST_WITHOUT = 0.05  # fraction of drawn laws without a motion, from which no interval is given
BEYOND = 1.5  # largest amplitude at which a law makes motions, over the largest that it was fitted to


@dataclass(frozen=True)
class CurveResonance:
    """Where a measured curve is at phase resonance.

    Args:
        hz: frequency, Hz.
        hz_std: standard deviation of it by the noise of the point nearest to quadrature, Hz.
        amplitude: amplitude of the mode, m kg^1/2.
        force: modal force there, N/kg^1/2.
        motion: amplitude of the displacement of the sensor by the shape of the mode, m.
        hz_std_at_motion: standard deviation of the frequency as one of this motion, Hz: the noise of the amplitude
            counts, too, by the slope of the law.
    """

    hz: float
    hz_std: float
    amplitude: float
    force: float
    motion: float
    hz_std_at_motion: float


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A response curve beside the one that a law makes of the same forces.

    Args:
        curve: the measured curve.
        response: (n,) complex acceleration of the sensor by the law, m/s^2; of several motions that the law allows at a
            frequency the one nearest to the measured one; NaN where it has none up to 1.5 times its largest amplitude.
        is_prediction: whether the law is that of other measurements, without any of the curves.
        resonance: where the measured curve is at phase resonance; None where no point is near it, or there is no law.
    """

    curve: ResponseCurve
    response: ComplexArray
    is_prediction: bool
    resonance: CurveResonance | None = None

    @classmethod
    def without_law(cls, curve: ResponseCurve) -> CurveFit:
        """Return a curve for which there is no law."""
        return cls(curve, np.full(curve.frequency_hz.size, np.nan, dtype=np.complex128), False)

    @property
    def error(self) -> float:
        """Rms of the difference over the rms of the measured acceleration, where the law has a motion.

        Where a curve turns over, a small difference of frequency makes a large one of amplitude.
        """
        has = np.isfinite(self.response)
        if not has.any():
            return float("nan")
        left = np.abs(self.response - self.curve.acceleration)[has]
        return float(np.sqrt(np.mean(left**2) / np.mean(self.curve.amplitude[has] ** 2)))

    @property
    def peak_ratio(self) -> float:
        """Largest amplitude by the law over the largest measured one; NaN where the law has no motion."""
        has = np.isfinite(self.response)
        return float(np.abs(self.response[has]).max() / self.curve.amplitude.max()) if has.any() else float("nan")

    def as_json(self) -> dict[str, Any]:
        """Return the curve as result.json holds it."""
        return {
            "name": self.curve.name,
            "sensor": self.curve.sensor,
            "frequency_hz": self.curve.frequency_hz,
            "force_n": self.curve.force_n,
            "amplitude": self.curve.amplitude,
            "phase_deg": self.curve.phase_deg,
            "amplitude_by_law": np.abs(self.response),
            "phase_by_law_deg": np.degrees(np.angle(self.response)),
            "is_prediction": self.is_prediction,
            "error": self.error,
            "peak_ratio": self.peak_ratio,
            "resonance": None if self.resonance is None else asdict(self.resonance),
        }


@dataclass(frozen=True, eq=False)
class CurvesLaw:
    """What several response curves of one mode give together.

    Args:
        states: the motions that count.
        law: the law; None where the curves do not determine it.
        check: inertia and rate of the frequency that the curves show; None where there are too few motions.
        reason: why there is no law, "" if there is one.
    """

    states: tuple[SteadyState, ...]
    law: ResonanceLaw | None
    check: StateCheck | None
    reason: str


def fit_curves(
    curves: Sequence[ResponseCurve],
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    stiffness_order: int | None = None,
    damping_order: int | None = None,
    settings: ResonanceSettings | None = None,
) -> CurvesLaw:
    """Fit the law of a mode to its response curves at several levels, and look for what speaks against them.

    The inertia of the mode is 1 if force, motion and shape have the units that are stated, and a motion that is steady
    at each frequency does not lag behind it. Both are fitted once more beside the law; if one of them is off, the law
    is withheld.

    Args:
        curves: the curves.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        stiffness_order: N_s, 1 to 5; chosen where None.
        damping_order: N_d, 1 to 5; chosen where None.
        settings: which points count; the usual ones where left out.

    Raises:
        InputError: what `read_curve_states` refuses.
    """
    chosen = settings or ResonanceSettings()
    each = [
        read_curve_states(curve, modes=modes, mode=mode, drive_point=drive_point, settings=chosen) for curve in curves
    ]
    states = tuple(state for several in each for state in several)
    try:
        law = fit_states(
            states,
            chosen,
            stiffness_order=stiffness_order,
            damping_order=damping_order,
            measured_waves=False,
            is_grouped=True,
        )
    except NotDeterminedError as error:
        return CurvesLaw(states, None, None, str(error))
    slopes = np.concatenate([_find_slope(several, chosen) for several in each])
    check = check_states(states, slopes, law)
    reason = _find_contradiction(check, modes, mode, chosen)
    return CurvesLaw(states, None if reason else law, check, reason)


def _find_slope(states: Sequence[SteadyState], settings: ResonanceSettings) -> ComplexArray:
    """Return the change of the complex amplitude over itself with the frequency, s/rad, along the drive."""
    omega = np.array([each.pole.imag for each in states])
    if omega.size < 2:
        return np.zeros(omega.size, dtype=np.complex128)
    q = np.array([each.displacement[0] / each.force for each in states])
    step, change = np.abs(np.diff(omega)), np.log(q[1:] / q[:-1])
    # A jump is no slope, and neither is the step to a part of the curve that was left out.
    smooth = (step > 0.0) & (np.abs(change) < settings.largest_jump)
    slope = np.where(smooth, change / np.where(step > 0.0, step, 1.0), 0.0)
    before, after = np.concatenate([[0.0], slope]), np.concatenate([slope, [0.0]])
    n = np.concatenate([[0], smooth.astype(int)]) + np.concatenate([smooth.astype(int), [0]])
    return np.asarray((before + after) / np.maximum(n, 1), dtype=np.complex128)


def _find_contradiction(check: StateCheck, modes: LinearModes, mode: int, settings: ResonanceSettings) -> str:
    """Return why curves do not give a law although their motions do, "" if nothing speaks against it."""
    inertia, std = float(check.inertia.value or 0.0), float(check.inertia.std or 0.0)
    rate, rate_std = float(check.lag.value or 0.0), float(check.lag.std or 0.0)
    bandwidth = 0.5 * float(modes.damping()[modes.index(mode)])
    is_off = abs(inertia - 1.0) > max(MODAL.warned_mass, settings.hidden_sigma * std)
    is_late = rate > max(settings.hidden_sigma * rate_std, settings.most_lag * bandwidth**2)
    # A motion never runs ahead of its drive. One that lags shows a wrong inertia, too, but none of another unit.
    if is_off and not (is_late and MODAL.mass_range[0] < inertia < MODAL.mass_range[1]):
        return describe_wrong_mass(inertia, "the response curves show", mode, settings)
    if is_late:
        return (
            "the motions of the response curves lag behind the frequency, as in a sweep of "
            f"{rate / (2.0 * np.pi):.2g} Hz/s: wait at each frequency until the amplitude stands still, some "
            f"{4.0 / bandwidth:.2g} s"
        )
    return ""


def describe_wrong_mass(inertia: float, who: str, mode: int, settings: ResonanceSettings) -> str:
    """Return a clause on a modal mass that is not 1, with the unit that would make it so where there is one.

    Args:
        inertia: the modal mass.
        who: what shows it, and the verb.
        mode: number of the mode, from 1.
        settings: how near to a unit it must be.
    """
    near = (name for name, factor in UNITS.items() if abs(inertia / factor - 1) < settings.near_unit)
    unit = next((f" ({name} would give this)" for name in near), "")
    return (
        f"{who} a modal mass of {inertia:.3g} where mass-normalised shapes and the stated units give 1{unit}: check "
        f"the units of amplitude and force, and the shape of mode {mode} at both"
    )


def make_curve(
    law: ResonanceLaw,
    curve: ResponseCurve,
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    is_prediction: bool = True,
) -> CurveFit:
    """Return what a law makes of the forces of a response curve, the other modes by their linear properties.

    At each amplitude a of the mode harmonic balance of its fundamental leaves (k(a) - omega^2)^2 + (omega c(a))^2 =
    (F / a)^2, from which a follows; a may have three values.

    Args:
        law: the law.
        curve: frequencies and forces, and the measured motion, which tells which of several motions is meant.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        is_prediction: whether the law is that of other measurements.

    Raises:
        InputError: no such mode or sensor.
    """
    driven = _DrivenCurve.of(curve, modes, mode, drive_point)
    most = BEYOND * float(law.amplitude.max())
    settings = ResonanceSettings()
    states = read_curve_states(curve, modes=modes, mode=mode, drive_point=drive_point, settings=settings)
    shape = float(np.abs(driven.shape))
    resonance = _find_resonance(states, law.candidates[0], curve.error_fraction, shape, settings)
    is_near = min(abs(each.phase_error_deg) for each in states) < settings.near_deg
    response = driven.find_response(law.candidates[0], most, driven.measured)
    return CurveFit(curve, response, is_prediction, resonance if is_near else None)


@dataclass(frozen=True, eq=False)
class _DrivenCurve:
    """The forces of a response curve on one mode, and what all other modes add to its sensor."""

    omega: FloatArray  # (n,) rad/s
    shape: float  # of the mode at the sensor
    force: FloatArray  # (n,) modal force, N/kg^1/2
    others: ComplexArray  # (n,) m/s^2
    measured: FloatArray  # (n,) amplitude of the mode, m kg^1/2

    @classmethod
    def of(cls, curve: ResponseCurve, modes: LinearModes, mode: int, drive_point: str) -> _DrivenCurve:
        index, omega = modes.index(mode), 2.0 * np.pi * curve.frequency_hz
        shape, push = float(modes.row(curve.sensor)[index]), float(modes.row(drive_point)[index])
        others = add_other_modes(curve, modes, mode, drive_point)
        measured = np.abs((curve.acceleration - others) / (omega**2 * shape))
        return cls(omega, shape, push * curve.force_n, others, measured)

    def find_response(self, law: LawCandidate, most: float, near: FloatArray) -> ComplexArray:
        """Return the acceleration of the sensor by a law, of several motions that nearest to an amplitude, (n,).

        Args:
            law: the law.
            most: the largest amplitude of the mode that is searched; where there is no motion up to it, NaN.
            near: (n,) the amplitude of the mode that is meant.
        """
        # The measured force is turned against what moves the mode.
        force = self.force * np.exp(-1j * law.phase_rad)
        a = np.linspace(0.0, most, N_AMPLITUDES + 1)[1:]
        response = np.full(self.omega.size, np.nan, dtype=np.complex128)
        for at, omega in enumerate(self.omega.tolist()):
            excess = a * np.abs(law.find_dynamic_stiffness(a, omega)) - abs(force[at])
            left = np.flatnonzero((excess[:-1] < 0.0) != (excess[1:] < 0.0))
            if left.size:
                part = excess[left] / (excess[left] - excess[left + 1])
                roots = a[left] + part * (a[left + 1] - a[left])
                root = roots[[np.argmin(np.abs(roots - near[at]))]]
                q = force[at] / law.find_dynamic_stiffness(root, omega)[0]
                response[at] = -(omega**2) * self.shape * q + self.others[at]
        return response


# ---- a curve that is held out --------------------------------------------------------------------------


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
        InputError: what `read_curve_states` refuses.
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
    driven = _DrivenCurve.of(curve, **place)
    shape = float(np.abs(driven.shape))
    read: dict[str, Any] = {**place, "settings": settings}
    measured, *seen = (
        _find_resonance(read_curve_states(each, **read), best, each.error_fraction, shape, settings)
        for each in (curve, *others)
    )
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


def _find_resonance(
    states: Sequence[SteadyState], law: LawCandidate, error: float, shape: float, settings: ResonanceSettings
) -> CurveResonance:
    """Return the resonance of a curve by its points near quadrature.

    Each of them gives the frequency at its own amplitude, which is a little below that at resonance: a line over the
    square of the amplitude leads there. Where the amplitudes are too few or too alike, the nearest point stands alone.
    """
    turned = [replace(each, force=each.force * np.exp(-1j * law.phase_rad)) for each in states]
    near = min(turned, key=lambda each: abs(each.phase_error_deg))
    omega = float(np.sqrt(max(near.stiffness, np.finfo(float).tiny)))
    std = error * abs(near.receptance_inverse) / (4.0 * np.pi * omega)
    pull = omega * near.damping
    amplitude = abs(near.force) / pull if pull > 0.0 else near.amplitude
    close = [each for each in turned if abs(each.phase_error_deg) < settings.near_deg]
    square = np.array([each.amplitude**2 for each in close])
    hz = omega / (2.0 * np.pi)
    if square.size >= FEWEST_NEAR and square.max() > settings.least_line * square.min():
        of_points = np.sqrt(np.maximum([each.stiffness for each in close], 0.0)) / (2.0 * np.pi)
        hz = float(np.polyfit(square / amplitude**2 - 1.0, of_points, 1)[1])
    ends = law.find_dynamic_stiffness(amplitude * np.array([1.0, 1.0 + error]), 0.0).real
    change = float(np.diff(np.sqrt(np.maximum(ends, 0.0)))[0]) / (2.0 * np.pi)
    return CurveResonance(
        hz=hz,
        hz_std=std,
        amplitude=float(amplitude),
        force=float(abs(near.force)),
        motion=float(amplitude * shape),
        hz_std_at_motion=float(np.hypot(std, change)),
    )


def find_law_resonance(law: LawCandidate, force: float, most: float) -> tuple[float, float]:
    """Return frequency, Hz, and amplitude at which a law is at phase resonance under a modal force.

    Both are NaN where there is none up to the amplitude `most`.
    """
    a = np.linspace(0.0, most, N_AMPLITUDES + 1)[1:]
    square = law.find_dynamic_stiffness(a, 0.0).real
    omega = np.sqrt(np.maximum(square, np.finfo(float).tiny))
    c = sum(value * first_harmonic_factor(n) * (omega * a) ** (n - 1) for n, value in law.damping.items())
    pull = omega * c * a
    reached = np.flatnonzero((pull >= force) & (square > 0.0))
    if not reached.size or (square[: reached[0] + 1] <= 0.0).any():
        return float("nan"), float("nan")
    at = slice(max(reached[0] - 1, 0), reached[0] + 1)
    amplitude = float(np.interp(force, pull[at], a[at]))
    return float(np.interp(amplitude, a, omega)) / (2.0 * np.pi), amplitude


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


def scale_shapes(
    curves: Sequence[ResponseCurve],
    *,
    modes: LinearModes,
    mode: int,
    drive_point: str,
    settings: ResonanceSettings | None = None,
) -> tuple[LinearModes, Estimate]:
    """Return the modes with the shape of one scaled so that the curves show a modal mass of 1, and that mass before.

    For shapes whose scale nobody knows. The motions at many frequencies tell inertia from stiffness.

    Args:
        curves: the curves.
        modes: linear modes of the structure.
        mode: number of the mode, from 1.
        drive_point: the sensor where the force acts.
        settings: which points count; the usual ones where left out.

    Raises:
        InputError: what `read_curve_states` refuses.
        NotDeterminedError: the curves do not tell it.
    """
    chosen, index, mass = settings or ResonanceSettings(), modes.index(mode), 1.0
    for _ in range(chosen.most_mass_steps):
        each = [
            read_curve_states(curve, modes=modes, mode=mode, drive_point=drive_point, settings=chosen)
            for curve in curves
        ]
        states = [state for several in each for state in several]
        law = fit_states(states, chosen, measured_waves=False, is_grouped=True)
        slopes = np.concatenate([_find_slope(several, chosen) for several in each])
        check = check_states(states, slopes, law, is_grouped=True)
        value, std = float(check.inertia.value or 0.0), float(check.inertia.std or 0.0)
        if value < chosen.hidden_sigma * std:
            raise NotDeterminedError(
                f"the response curves do not tell the modal mass of mode {mode} ({value:.3g}, standard deviation "
                f"{std:.2g}): give curves over a wider range of frequencies, or mass-normalised shapes"
            )
        mass *= value
        shapes = modes.shapes.copy()
        shapes[:, index] /= np.sqrt(value)
        modes = replace(modes, shapes=shapes)
        if abs(value - 1.0) < chosen.mass_converged:
            break
    return modes, Estimate.normal(mass, mass * std)
