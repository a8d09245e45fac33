"""From fitted forms of the law of decays to its estimates, curves and warnings in SI units."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from opid.errors import NotDeterminedError
from opid.estimate import Estimate
from opid.mechanics.backbones.harmonic_balance import first_harmonic_factor
from opid.modal.decay.form_fit import AT_EDGE, FormFit
from opid.modal.decay.forms import DecayProblem, FittedForms
from opid.modal.decay.law import DecayLaw, withhold_intervals
from opid.modal.decay.law_search import LawForm
from opid.modal.decay.scaled_track import find_span
from opid.modal.decay.slow_flow import Flow, find_joint_fall, solve_slow_flow
from opid.modal.forced.restoring_fit import find_jackknife
from opid.modal.joint_terms import TOO_SHARP, JointEstimates, find_rest_stiffness
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray

CURVE_STEP = 1e-5  # step of a coefficient, in the units of a fit, by which the slopes of the curves are found


def describe_law(problem: DecayProblem, fitted: FittedForms) -> DecayLaw:
    """Return the best fit in SI units; what its rivals say otherwise widens the intervals."""
    best, units, lowest = fitted.best, problem.units, float(problem.seen.level.min())
    curves = _find_law_curves(problem, fitted)
    low, spread = best.find_low()
    few = _widen_few_windows(sum(each.log_amplitude.size for each in problem.decays), best.form.size)
    of_joint = np.hypot(_find_joint_error(best, curves, lowest), few * _find_choice_error(fitted))
    k0_error, c0_error = of_joint[list(best.places)]
    curves = _widen_curves(best, curves)
    # A clock that is fast by c takes frequencies for those over 1 + c; a gain that drifts passes for damping.
    drift = MODAL.gain_drift / max(float(each.time[-1]) for each in problem.decays)
    k0_error = np.hypot(k0_error, 2.0 * MODAL.clock_tolerance * low[2] ** 2)
    c0_error = np.hypot(c0_error, 2.0 * drift)
    low_error = np.array([k0_error, c0_error, 0.5 * k0_error / low[2], 0.5 * c0_error / low[2]])
    low_std = np.sqrt((few * _widen(fitted.fits, low)) ** 2 + curves.find_missed_low(low[2]) ** 2 + low_error**2)
    wider = np.full(best.vector.size, few)
    wider[list(best.places)] = low_std[:2] / np.sqrt(np.maximum(np.diag(spread)[:2], 1e-300))
    factors = units.find_factors(best.form, best.vector)
    by_gain = units.find_gain_error(best.form, best.vector)
    covariance = best.whole_covariance * np.outer(wider, wider) + np.outer(by_gain, by_gain)
    of_joint[list(best.places)] = 0.0
    covariance += np.diag(of_joint**2)
    covariance = covariance * np.outer(factors, factors)
    n_k = best.form.stiffness_order
    stiffness, damping, friction, memory = _estimate_coefficients(fitted, factors, covariance, few, units.gain_std)
    # Slip falls as a power of the amplitude below 1, and is far from gone at the smallest one that was seen.
    reaches = lowest <= MODAL.reaches_zero and not best.form.slips_at(lowest, best.vector)
    has_no_ratio = best.form.has_friction or best.is_active or fitted.is_doubted or fitted.is_another_kind
    scale_hz = units.rate / (2.0 * np.pi)
    law = DecayLaw(
        stiffness=dict(enumerate(stiffness, start=1)),
        damping=dict(enumerate(damping, start=1)),
        joint_estimates=JointEstimates(friction, best.form.memory, tuple(memory)),
        frequency_low_hz=_estimate(low[2] * scale_hz, low_std[2] * scale_hz, best.repeats) if reaches else Estimate(),
        damping_low=_estimate(low[3], low_std[3], best.repeats) if reaches and not has_no_ratio else Estimate(),
        frequency_scatter_hz=float(0.5 * best.scatter[0] / low[2] * scale_hz),
        damping_scatter=float(0.5 * best.scatter[n_k] / low[2]),
        amplitude=curves.level * units.length,
        frequency_hz=curves.natural * scale_hz,
        damping_ratio=curves.damping / (2.0 * curves.natural),
        frequency_std_hz=np.hypot(curves.natural_std, MODAL.clock_tolerance * curves.natural) * scale_hz,
        damping_std=np.hypot(curves.damping_std, 2.0 * drift) / (2.0 * curves.natural),
        covariance=covariance,
        misfit=best.misfit,
        phase_error=best.phase_error,
        warnings=(*_warn_of_law(best, lowest), *fitted.warnings),
    )
    return withhold_intervals(law) if fitted.is_untold else law


def _find_joint_error(best: FormFit, curves: _LawCurves, lowest: float) -> FloatArray:
    """Return by how much the slow flow leaves the values of a named joint, k0 and c0 uncertain, (p,), in their units.

    `lowest` is the smallest amplitude that was seen: at rest the stiffness differs by what the joint softens there.
    """
    errors = np.zeros(best.vector.size)
    if best.form.memory is not None and not best.form.memory.is_slip:
        of_values, of_curves = MODAL.joint_error
        joint = best.form.split(best.vector)[2]
        first, (k0, c0) = best.form.size - best.form.n_memory, best.places
        errors[first:] = of_values * best.vector[first:]
        if best.form.memory.has_jump:
            # The fraction of the force that slides at once is J / (1 + J).
            errors[-1] *= 1.0 + best.vector[-1]
        softened = of_curves * float(joint.find_softening(np.array([lowest]))[0])
        errors[k0] = np.hypot(softened, MODAL.rest_error * find_rest_stiffness(joint.kind, joint.values))
        errors[c0] = of_curves * abs(best.vector[c0])
        # Each higher power of damping may take the part of the joint's loss that is off, at the largest motion.
        lost = of_curves * float(joint.find_damping(np.ones(1))[0])
        powers = np.arange(2, best.form.damping_order + 1)
        errors[c0 + 1 : c0 + powers.size + 1] = lost / first_harmonic_factor(powers)
    return float(np.max(0.5 * curves.damping / curves.natural)) * errors


def _widen_curves(best: FormFit, curves: _LawCurves) -> _LawCurves:
    """Return the curves of a law with what the slow flow leaves uncertain of a named joint.

    So do the bands hold the curves of steady cycles, which differ by what a falling amplitude changes in a joint with
    memory.
    """
    if best.form.memory is None:
        return curves
    joint = best.form.split(best.vector)[2]
    ratio = 0.5 * curves.damping / curves.natural
    error = 0.0 if best.form.memory.is_slip else MODAL.joint_error[1] * float(np.max(ratio))
    change = ratio * find_joint_fall(joint, curves.level)
    square = np.hypot(error * joint.find_softening(curves.level), change.real)
    damping = np.hypot(error * curves.damping, change.imag / curves.natural)
    return replace(
        curves,
        natural_std=np.hypot(curves.natural_std, 0.5 * square / curves.natural),
        damping_std=np.hypot(curves.damping_std, damping),
    )


@dataclass(frozen=True, eq=False)
class _LawCurves:
    """Natural frequency and damping of a law over the amplitude, in the units of the fit, (n,) each.

    `missed` holds what the law misses of frequency and of damping at the smallest amplitudes that were measured.
    """

    level: FloatArray
    natural: FloatArray
    natural_std: FloatArray
    damping: FloatArray
    damping_std: FloatArray
    missed: tuple[float, float]

    def find_missed_low(self, root: float) -> FloatArray:
        """Return what is missed of k0, c0, root of k0 and damping ratio, (4,), as in `FormFit.find_low`."""
        natural, damping = self.missed
        return np.array([2.0 * root * natural, damping, natural, 0.5 * damping / root])


def _find_law_curves(problem: DecayProblem, fitted: FittedForms) -> _LawCurves:
    """Return the curves of the best fit over the amplitudes of the decays, with their standard deviations."""
    best, units, seen = fitted.best, problem.units, problem.seen
    flow = _solve_flow(problem, best.form, best.vector)
    if flow is None:
        raise NotDeterminedError("no law of these orders decays over all amplitudes of the decays: lower the orders")
    shown = flow.log_amplitude + units.derivative * np.log(flow.natural)
    logs = np.concatenate([each.log_amplitude for each in problem.decays])
    inside = (shown >= logs.min()) & (shown <= logs.max())
    few = _widen_few_windows(logs.size, best.form.size)
    variance = np.zeros((2, flow.natural.size))
    for fit, weight in fitted.fits:
        variance += few**2 * weight * _find_curve_variance(problem, fit, flow)
    at, order = flow.log_amplitude[inside], np.argsort(seen.level)
    logs_seen, missed = np.log(seen.level[order]), []
    for values, measured, std in (
        (flow.natural, np.sqrt(seen.square), 0.5 * seen.square_std / np.sqrt(seen.square)),
        (flow.damping, seen.damping, seen.damping_std),
    ):
        off = measured[order] - np.interp(logs_seen, flow.log_amplitude, values)
        squares = np.maximum(off**2 - std[order] ** 2, 0.0)
        # The mean of three windows is taken, for a curve that crosses the true one misses nothing there.
        near = np.array([np.mean(squares[max(0, k - 1) : k + 2]) for k in range(squares.size)])
        missed.append(np.sqrt(fitted.part * near))
    stds = [
        np.sqrt(own[inside] + np.interp(at, logs_seen, each) ** 2) for own, each in zip(variance, missed, strict=True)
    ]
    return _LawCurves(
        level=np.exp(at),
        natural=flow.natural[inside],
        natural_std=stds[0],
        damping=flow.damping[inside],
        damping_std=stds[1],
        missed=(float(missed[0][0]), float(missed[1][0])),
    )


def _solve_flow(problem: DecayProblem, form: LawForm, vector: FloatArray) -> Flow | None:
    """Return the slow flow of a form over the amplitudes of all decays; None if it does not vibrate or decay."""
    k, c, joint = form.split(vector)
    return solve_slow_flow(k, c, *find_span(problem.decays), joint)


def _find_curve_variance(problem: DecayProblem, fit: FormFit, about: Flow) -> FloatArray:
    """Return the variances of natural frequency and damping of a form about the curves of the best one, (2, n)."""
    own = _solve_flow(problem, fit.form, fit.vector)
    if own is None:
        return np.full((2, about.natural.size), np.nan)
    slopes = []
    for step in CURVE_STEP * np.eye(fit.vector.size):
        other = _solve_flow(problem, fit.form, fit.vector + step) or own
        slopes.append(np.stack([other.natural - own.natural, other.damping - own.damping]) / CURVE_STEP)
    by_gain = problem.units.find_gain_error(fit.form, fit.vector)
    covariance = fit.covariance + np.outer(by_gain, by_gain)
    off = np.stack([own.natural - about.natural, own.damping - about.damping])
    variance = np.einsum("jcn,jk,kcn->cn", slopes, covariance, slopes) + off**2
    if not fit.without:
        return np.asarray(variance, dtype=np.float64)
    shown = own.log_amplitude + problem.units.derivative * np.log(own.natural)
    steps = []
    for each in fit.without:
        other = _solve_flow(problem, fit.form, each.vector) or own
        # Beyond the amplitudes that are left the curve is an extrapolation, which tells nothing of the whole decay.
        is_left = (shown >= each.log_low) & (shown <= each.log_high)
        steps.append(is_left * np.stack([other.natural - own.natural, other.damping - own.damping]))
    of_model = [np.diag(find_jackknife(each)) for each in np.moveaxis(np.array(steps), 1, 0)]
    return np.asarray(variance + fit.part * np.array(of_model), dtype=np.float64)


def _estimate_coefficients(
    fitted: FittedForms, factors: FloatArray, covariance: FloatArray, few: float, gain_std: float
) -> tuple[list[Estimate], list[Estimate], Estimate, list[Estimate]]:
    """Return k_n, c_n, friction, empty without any, and the values of the joint of the best fit in SI units.

    `factors` lead to SI units, in which the covariance is; `few` widens for few windows, and `gain_std` for the gain of
    the amplitudes.
    """
    best = fitted.best
    values, std = best.vector * factors, np.sqrt(np.diag(covariance))
    n_k, n_c = best.form.stiffness_order, best.form.damping_order
    estimates = [
        _estimate(value, each, best.repeats if j in best.places else 1)
        for j, (value, each) in enumerate(zip(values, std, strict=True))
    ]
    damping = estimates[n_k : n_k + n_c]
    if best.is_active:
        # No structure at rest has negative damping: what the record holds beside the decay is not known.
        damping[0] = damping[0].without_interval()
    if fitted.is_doubted:
        damping = [each.without_interval() for each in damping]
    rest = estimates[n_k + n_c :]
    friction = Estimate()
    if best.form.has_friction:
        rest.pop(0)
        # The gain of the amplitude changes friction by as much.
        spread = np.hypot(few * _widen_value(fitted.fits, _take_friction), gain_std * best.vector[n_k + n_c])
        friction = Estimate.normal(values[n_k + n_c], spread * factors[n_k + n_c])
    if fitted.is_doubted and best.form.memory is not None and not best.form.memory.is_slip:
        # A named joint stays in the law where laws without it explain the decay better.
        rest = [each.without_interval() for each in rest]
    if best.form.is_sharp(best.vector):
        rest[-1] = rest[-1].without_interval()
    return estimates[:n_k], damping, friction, rest


def _widen(fits: Sequence[tuple[FormFit, float]], low: FloatArray) -> FloatArray:
    """Return (4,) standard deviations of the values at zero amplitude about those of the best fit, over all forms."""
    squares = np.zeros(low.size)
    for fit, weight in fits:
        values, spread = fit.find_low()
        squares += weight * (np.diag(spread) + (values - low) ** 2)
    return np.asarray(np.sqrt(squares), dtype=np.float64)


def _widen_few_windows(n_windows: int, n_coefficients: int) -> float:
    """Return the half width of an interval of Student's t over that of a normal one: few windows tell the noise badly.

    A window gives an amplitude and a phase, and each decay has a start value of both.
    """
    from scipy import special

    return float(special.stdtrit(max(2 * n_windows - n_coefficients - 2, 1), 0.975)) / 1.96


def _widen_value(fits: Sequence[tuple[FormFit, float]], find_place: Callable[[LawForm], int | None]) -> float:
    """Return the standard deviation of a value about that of the best fit, over all forms that have it.

    `find_place` returns the index of the value in the vector of a form, None where the form lacks it.
    """
    best, weights, squares = float(fits[0][0].vector[find_place(fits[0][0].form)]), [], []
    for fit, weight in fits:
        place = find_place(fit.form)
        if place is not None:
            squares.append(fit.whole_covariance[place, place] + (fit.vector[place] - best) ** 2)
            weights.append(weight)
    # A law that is asked for may have no weight beside others that explain the decay far better.
    return float(np.sqrt(np.average(squares, weights=weights) if sum(weights) > 0.0 else squares[0]))


def _find_choice_error(fitted: FittedForms) -> FloatArray:
    """Return how far other kinds of the same joint put the values of a named one, (p,), beyond their own variances."""
    best = fitted.best
    errors, memory = np.zeros(best.vector.size), best.form.memory
    if memory is None or memory.is_slip:
        return errors
    for number in range(best.form.n_memory):
        find_place = partial(_take_joint_value, memory.name, number)
        place = best.form.size - best.form.n_memory + number
        more = _widen_value(fitted.fits, find_place) ** 2 - best.whole_covariance[place, place]
        errors[place] = np.sqrt(max(more, 0.0))
    return errors


def _take_friction(form: LawForm) -> int | None:
    return form.stiffness_order + form.damping_order if form.has_friction else None


def _take_joint_value(name: str, number: int, form: LawForm) -> int | None:
    has_it = form.memory is not None and form.memory.name == name and number < form.n_memory
    return form.size - form.n_memory + number if has_it else None


def _estimate(value: float, std: float, repeats: int) -> Estimate:
    """Return a normal estimate, or one of Student's t where the scatter of a few repeats is in it."""
    if repeats == 1:
        return Estimate.normal(value, std)
    from scipy.stats import t

    half = float(t.ppf(0.975, repeats - 1)) * float(std)
    return Estimate(float(value), float(std), (float(value) - half, float(value) + half))


def _warn_of_law(best: FormFit, lowest: float) -> list[str]:
    warnings = []
    falls = f"the amplitude falls only by a factor of {1.0 / lowest:.2g}"
    if lowest > 1.0 / MODAL.least_range:
        warnings.append(
            f"{falls}: the powers above 1 are poorly determined, record a longer decay or a stronger impact"
        )
    if lowest > MODAL.reaches_zero:
        warnings.append(f"{falls}: frequency and damping at zero amplitude are not told, record a longer decay")
    if best.form.slips_at(lowest, best.vector):
        warnings.append(
            "the joint still slips at the smallest amplitude: frequency and damping at zero amplitude are not told"
        )
    if best.form.is_sharp(best.vector):
        warnings.append(TOO_SHARP)
    if best.repeat_misfit > MODAL.most_misfit:
        warnings.append(
            f"the laws of the single decays differ by {best.repeat_misfit:.2g} times what noise and the scatter of k0 "
            "and c0 leave: frequency and damping are no functions of the amplitude alone, as with two close modes or a "
            "structure that moved; the intervals are wider by as much"
        )
    if best.is_at_edge:
        warnings.append(f"no interval is given: {AT_EDGE}")
    if best.is_active:
        warnings.append(
            "the damping at small amplitude is negative, which no structure at rest has: the law only describes the "
            "amplitudes of the record, and its c1 is no damping; give a stretch that nothing drives"
        )
    return warnings
