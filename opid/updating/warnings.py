"""Warnings about a Bayesian updating, one sentence each, and the test of whether a law fits the backbones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.estimate import Estimate, format_percent
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, ModeData
from opid.updating.likelihood.curves import describe_failures, describe_points, make_curves, residuals
from opid.updating.likelihood.force import ForceData
from opid.updating.likelihood.interactions import describe_interactions, describe_misplaced, warn_of_pairs
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import ClassParameter, ModelClass
from opid.updating.result import BackboneBand, ClassPosterior, LinearPosterior
from opid.updating.sampling.chains import Chain, Diagnostics, find_pressures
from opid.updating.sampling.evidence import Evidence
from opid.updating.settings import UPDATING

N_PATTERNS = 2  # slope and curvature over the amplitude, the errors that a wrong law makes

_PULLED = ", and this moves theta by too much for its interval, so that neither this nor bands are given"
TOO_LITTLE = (
    f"moves the frequencies by more than {100 * UPDATING.least_moved:.0f} % of their measured growth: check the unit "
    "of the amplitudes, and the scale of the law"
)


# ---- the linear structure ---------------------------------------------------------------------------


def warn_of_linear_choice(classes: Sequence[LinearPosterior]) -> Iterator[str]:
    """Yield at most one warning about the choice among classes of linear parameters."""
    if len(classes) < 2:
        return
    best, second, *_ = sorted(classes, key=lambda each: -each.log_evidence)
    lost = [each.name for each in classes if each.evidence is None]
    if lost:
        yield f"the linear classes {', '.join(map(repr, lost))} have no evidence: draw more samples"
    elif (apart := best.log_evidence - second.log_evidence) < UPDATING.too_close:
        yield (
            f"the linear classes {best.name!r} and {second.name!r} differ by {apart:.1f} in log evidence: the lowest "
            "points cannot distinguish them, measure more modes or sensors"
        )


# ---- one class -------------------------------------------------------------------------------------


def warn_of_class(
    data: BackboneData,
    model_class: ModelClass,
    chain: Chain,
    best: FloatArray,
    *,
    estimates: Mapping[str, Estimate],
    evidences: Sequence[Evidence],
    diagnostics: Diagnostics,
    untold: Sequence[int] = (),
    is_pulled: bool = False,
) -> Iterator[str]:
    """Yield warnings about the posterior of one class.

    That of the parameters `untold`, from 1, is their prior; it `is_pulled` where omitted interactions move it.
    """
    for pressure in find_pressures(chain.pooled, model_class.priors):
        if pressure.parameter not in untold:
            yield f"theta_{pressure.parameter} {pressure.sentence}"
    misfits = lack_of_fit(data, model_class, best)
    told = [*warn_of_fit(misfits, np.nan if misfits else unexplained_fraction(data, model_class, best))]
    yield from told or warn_of_bump(find_bumps(data, model_class, best))
    if data.force is not None and (error := find_force_error(data, data.force, model_class, best)) is not None:
        yield from warn_of_force(force_misfit(data.force, error, data.noise))
        yield from warn_of_force_level(data.force, error, data.noise)
    near = chain.thinned(UPDATING.n_checked)
    far = best + UPDATING.far_out * (near - best)
    far = np.concatenate([best[None], far[np.isfinite(model_class.log_prior(far))]])
    yield from warn_of_curves(
        describe_failures(data, model_class, near),
        describe_failures(data, model_class, far, lost=True),
        describe_interactions(data, model_class, best),
        is_pulled=is_pulled,
    )
    yield from warn_of_pairs(data, model_class, best)
    if diagnostics.effective_samples < UPDATING.few_samples:
        is_none = diagnostics.effective_samples < UPDATING.fewest_samples
        yield (
            f"the samples are worth only {diagnostics.effective_samples:.0f} independent ones: "
            f"{'no interval is given' if is_none else 'intervals are rough'}, draw more samples"
        )
    if diagnostics.r_hat > UPDATING.most_r_hat:
        yield f"the chains differ (R-hat {diagnostics.r_hat:.2f}): draw more samples, or take the transitional sampler"
    if diagnostics.divergent > UPDATING.most_divergent:
        yield (
            f"{format_percent(diagnostics.divergent)} of the walks of the sampler went astray: the posterior has an "
            "edge, as where the model has no solution; take the adaptive sampler"
        )
    first, *others = evidences
    for other in others:
        apart = abs(other.log_evidence - first.log_evidence)
        if apart > UPDATING.methods_differ + UPDATING.methods_sigma * (first.std**2 + other.std**2) ** 0.5:
            yield f"log evidence by {other.method} differs by {apart:.1f} from that by {first.method}: use the latter"
    if model_class.n_parameters > 1:
        for (name, estimate), own in zip(estimates.items(), model_class.parameters, strict=True):
            # The changes at the knots of a spline are needed together.
            is_alone = isinstance(own, ClassParameter) and own.is_amplitude and own.term.gap_m is None
            if is_alone and estimate.holds(0.0):
                yield f"the interval of {name} contains 0: the data do not need the term {own.key}"


def warn_of_curves(
    gaps: Sequence[str], lost: Sequence[str], met: Sequence[str], *, is_pulled: bool = False
) -> Iterator[str]:
    """Yield warnings about the curves of the model: gaps, curves lost beside the posterior, modes that interact.

    `gaps` and `lost` are from `describe_failures`, `met` is from `describe_interactions`; theta `is_pulled` where these
    move it by a large part of its interval.
    """
    if gaps:
        yield (
            f"in {'; in '.join(gaps)} of the samples the model does not converge: its curve is interpolated there from "
            "its other points; take fewer harmonics, or leave out measured points near those amplitudes (an "
            "interaction of modes, which continued_backbone follows)"
        )
    elif lost:
        yield (
            f"beside the posterior, in {'; in '.join(lost)} of the parameters, the model does not converge: these "
            "parameters count as impossible, which may cut the posterior off; take fewer harmonics, or leave out "
            "measured points near those amplitudes"
        )
    for clause in met:
        yield (
            f"in {clause}: frequencies measured there may lie off the smooth backbone of the model, which leaves "
            f"interactions out{_PULLED if is_pulled else ''}; leave those points out, or state interaction = 'keep' "
            "(continued_backbone follows an interaction)"
        )


def has_no_effect(data: BackboneData, model_class: ModelClass) -> bool:
    """Return whether a class leaves the frequencies almost constant everywhere in its prior."""
    theta = model_class.sample_prior(UPDATING.n_tried, np.random.default_rng(0))
    for mode in data.modes:
        eigenvalue, _, _, lost = make_curves(data, mode, model_class)(theta)
        if lost.any() or np.ptp(eigenvalue, axis=1).max() > UPDATING.least_moved * np.ptp(mode.growth) * mode.linear:
            return False
    return True


# ---- does its law fit ------------------------------------------------------------------------------


@dataclass(frozen=True)
class LackOfFit:
    """The misfit of a law to the growth of the frequencies of one mode, as far as it is common to all curves."""

    mode: int  # number of the mode, from 1
    fraction: float  # misfit over the measured growth of lambda, both as rms over the points
    probability: float  # probability of such a misfit by chance if the law is right


def warn_of_fit(misfits: Sequence[LackOfFit], unexplained: float) -> Iterator[str]:
    """Yield at most one sentence, on a misfit common to all curves of a mode, larger than chance and large enough.

    Where the curves are too short for `misfits`, the fraction `unexplained` is judged.
    """
    if large := _find_large(misfits, UPDATING.least_misfit):
        worst = max(large, key=lambda each: each.fraction)
        yield (
            f"with the best parameters {100 * worst.fraction:.0f} % of the measured growth of the frequencies of mode "
            f"{worst.mode} stay unexplained, alike in all curves (by chance in less than one of "
            f"{1 / UPDATING.rare:.0f} sets): this law does not fit the backbones, and no interval of it holds"
        )
    elif not misfits and not unexplained <= UPDATING.most_unexplained:
        yield (
            f"with the best parameters {100 * unexplained:.0f} % of the measured growth of the frequencies stay "
            "unexplained: this law does not fit the backbones, and no interval of it holds"
        )


def warn_of_bump(bumps: Sequence[LackOfFit]) -> Iterator[str]:
    """Yield at most one sentence, on a bump that all curves of a mode have alike, larger than chance allows."""
    if large := _find_large(bumps, UPDATING.least_bump):
        worst = max(large, key=lambda each: each.fraction)
        yield (
            f"with the best parameters a bump of {100 * worst.fraction:.1f} % of the measured growth of the "
            f"frequencies of mode {worst.mode} is left, alike in all curves: another mode may pull them where the "
            "structure has no interaction, or the law has another form there; no interval of it holds"
        )


def _find_large(misfits: Sequence[LackOfFit], least: float) -> list[LackOfFit]:
    """Return the misfits above a fraction that are not by chance."""
    return [each for each in misfits if each.fraction > least and each.probability < UPDATING.rare / len(misfits)]


def find_unfit_modes(data: BackboneData, model_class: ModelClass, best: FloatArray) -> set[int]:
    """Return the numbers of the modes whose backbones or force a class does not fit with its best parameters."""
    return _find_unfit_springs(data, model_class, best) | _find_unfit_dampers(data, model_class, best)


def find_fit(data: BackboneData, model_class: ModelClass, best: FloatArray) -> tuple[bool, bool]:
    """Return whether a class fits the backbones with its best parameters, bumps included, and whether the force.

    It does not where an interaction whose points are kept lies elsewhere than in the structure.
    """
    bumps = _find_large(find_bumps(data, model_class, best), UPDATING.least_bump)
    return (
        not (bumps or describe_misplaced(data) or _find_unfit_springs(data, model_class, best)),
        not _find_unfit_dampers(data, model_class, best),
    )


def _find_unfit_springs(data: BackboneData, model_class: ModelClass, best: FloatArray) -> set[int]:
    misfits = lack_of_fit(data, model_class, best)
    if not misfits and not unexplained_fraction(data, model_class, best) <= UPDATING.most_unexplained:
        return {mode.mode for mode in data.modes}
    return {each.mode for each in _find_large(misfits, UPDATING.least_misfit)}


def _find_unfit_dampers(data: BackboneData, model_class: ModelClass, best: FloatArray) -> set[int]:
    if data.force is None or (error := find_force_error(data, data.force, model_class, best)) is None:
        return set()
    large = _find_large(force_misfit(data.force, error, data.noise), UPDATING.least_force_misfit)
    return {each.mode for each in large} | {mode for mode, _, _ in _find_wrong_levels(data.force, error, data.noise)}


def warn_of_force(misfits: Sequence[LackOfFit]) -> Iterator[str]:
    """Yield at most one sentence, on a misfit to the force of a mode that is large and not by chance."""
    if large := _find_large(misfits, UPDATING.least_force_misfit):
        worst = max(large, key=lambda each: each.fraction)
        yield (
            f"with the best parameters the force of mode {worst.mode} is {100 * worst.fraction:.0f} % (rms) off over "
            "the amplitude: these dampers do not lose the measured energy, and no interval of them holds; if the "
            "force is that noisy, state force_noise"
        )


def warn_of_force_level(force: ForceData, error: FloatArray, noise: NoiseSettings) -> Iterator[str]:
    """Yield a sentence for each mode whose force is larger or smaller than calibration and scatter allow.

    `error` is that of `find_force_error`.
    """
    for number, level, expected in _find_wrong_levels(force, error, noise):
        yield (
            f"with the best parameters the force of mode {number} is {np.exp(level):.3g} times what the dampers and "
            f"damping ratios need, {abs(level) / expected:.0f} standard deviations of its calibration: check its unit "
            "(peak or rms), the drive point and the damping ratios; no interval of the dampers holds"
        )


def _find_wrong_levels(force: ForceData, error: FloatArray, noise: NoiseSettings) -> Iterator[tuple[int, float, float]]:
    """Yield each mode whose force is off, with the logarithm of its factor and the deviation that is expected.

    The curves of a mode have the calibration and the error of its energy in common, and each has an offset, which is
    expected as it scatters, and at least as it is stated.
    """
    for number in np.unique(force.of_mode):
        curve, own = force.place["curve"][force.of_mode == number], error[force.of_mode == number]
        levels = np.array([own[curve == each].mean() for each in np.unique(curve)])
        offset = max(noise.force_offset, float(levels.std(ddof=1)) if levels.size > 1 else 0.0)
        expected = np.sqrt(noise.force_error**2 + noise.energy_error**2 + offset**2 / levels.size)
        if abs(levels.mean()) > UPDATING.missed_sigma * expected:
            yield int(number), float(levels.mean()), float(expected)


def find_force_error(
    data: BackboneData, force: ForceData, model_class: ModelClass, theta: FloatArray
) -> FloatArray | None:
    """Return the logarithm of the measured work over that of theta, (n_points,); None where the model has no curve."""
    rows, losses = theta[np.newaxis], []
    for mode in data.modes:
        curves = make_curves(data, mode, model_class)
        losses.append(curves.find_losses(rows, curves.solve(rows)))
    error = force.values - force.place["between"] @ np.concatenate(losses, axis=1)[0]
    return error if np.isfinite(error).all() else None


def force_misfit(force: ForceData, error: FloatArray, noise: NoiseSettings) -> list[LackOfFit]:
    """Return the misfit to the work of the force over the amplitude of each mode that has one, as a fraction.

    What all curves have alike is judged as `lack_of_fit` does. Few curves cannot tell it from their scatter: there the
    rms over all points counts that is several times the noise that is stated. What errors that are stated can explain
    (a floor of the force, for one), up to `stated_sigma` of their standard deviations, is no misfit. `error` is that of
    `find_force_error`.
    """
    found, patterns = [], force.place["patterns"] * force.place["common_std"]
    least_squares = np.linalg.lstsq(
        np.vstack([patterns / noise.force_noise, np.eye(patterns.shape[1])]),
        np.concatenate([error / noise.force_noise, np.zeros(patterns.shape[1])]),
        rcond=None,
    )[0]
    error = error - patterns @ np.clip(least_squares, -UPDATING.stated_sigma, UPDATING.stated_sigma)
    most = max(UPDATING.least_force_misfit, UPDATING.most_force_noise * noise.force_noise)
    for number in np.unique(force.of_mode):
        mine = force.of_mode == number
        every = (force.place["curve"], force.relative_amplitude, force.place["growth"])
        points = CurvePoints(*(each[mine] for each in every))
        judged = _judge_misfit(points, error[mine], 0.0, noise.curve_growth)
        of_curve = np.eye(points.curve.max() + 1)[points.curve][:, np.unique(points.curve)]
        left = error[mine] - of_curve @ ((of_curve.T @ error[mine]) / of_curve.sum(axis=0))
        rms = float(np.sqrt(np.mean(left**2)))
        if rms > most and of_curve.shape[1] < UPDATING.few_sets:
            found.append(LackOfFit(int(number), rms, 0.0))
        elif judged is not None:
            found.append(LackOfFit(int(number), float(np.linalg.norm(judged[0])), judged[1]))
    return found


def lack_of_fit(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> tuple[LackOfFit, ...]:
    """Return the misfit of theta, (n_parameters,), to each mode whose curves have enough points to show one.

    A straight line and a parabola over the amplitude are fitted to the errors of lambda of each curve, with an offset.
    If the law is right, their coefficients scatter about 0 from curve to curve (by each curve's own errors) and
    together (by the error of the linear structure that grows with lambda, `linear_error_growth`); Hotelling's T^2 gives
    the probability of their mean then. As few curves determine their scatter poorly, the scatter that is expected from
    the points and from the slope of each single curve (`curve_growth`) counts as much as ten more curves.
    """
    found = []
    for mode in data.modes:
        eigenvalue, _, _, lost = make_curves(data, mode, model_class)(theta[None])
        if not lost[0]:
            error = (mode.eigenvalue - mode.between @ eigenvalue[0]) / mode.linear
            found += _find_misfit(data, mode, error)
    return tuple(found)


def find_bumps(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> tuple[LackOfFit, ...]:
    """Return what the errors of lambda with theta, (n_parameters,), have alike in all curves of each mode.

    The errors are those that no offset, slope or pattern of the errors explains, averaged in parts of the amplitude.
    The scatter between the curves gives the probability that their mean is chance. Modes with fewer than three curves,
    and the paper's forms, have none.
    """
    from scipy.stats import f as fisher

    found = []
    for mode in data.modes:
        eigenvalue, _, _, lost = make_curves(data, mode, model_class)(theta[None])
        n_curves = int(mode.curve[-1]) + 1
        if lost[0] or mode.errors is None or n_curves < UPDATING.fewest_alike:
            continue
        offsets = np.eye(n_curves)[mode.curve]
        patterns = np.empty((mode.curve.size, 0)) if mode.errors.patterns is None else mode.errors.patterns
        known = np.linalg.qr(np.column_stack([offsets, offsets * mode.growth[:, None], patterns]))[0]
        error = (mode.eigenvalue - mode.between @ eigenvalue[0]) / mode.linear
        error = error - known @ (known.T @ error)
        last = UPDATING.n_bump_parts - 1
        part = np.minimum((mode.relative_amplitude * UPDATING.n_bump_parts).astype(int), last)
        squares, freedom = [], 0
        for number in range(UPDATING.n_bump_parts):
            mine = part == number
            own = [float(error[mine & (mode.curve == curve)].mean()) for curve in np.unique(mode.curve[mine])]
            if len(own) >= UPDATING.fewest_alike:
                squares.append((np.mean(own) ** 2, np.var(own, ddof=1) / len(own)))
                freedom += len(own) - 1
        if not squares:
            continue
        alike, chance = np.mean(squares, axis=0)
        fraction = float(np.sqrt(alike) / max(float((mode.eigenvalue / mode.linear).std()), 1e-30))
        found.append(LackOfFit(mode.mode, fraction, float(fisher.sf(alike / chance, len(squares), freedom))))
    return tuple(found)


def _find_misfit(data: BackboneData, mode: ModeData, error: FloatArray) -> list[LackOfFit]:
    """Return a list of one record, or an empty one where the curves are too short."""
    # The setting linear_error belongs to the frequency; the error of lambda is twice as large.
    growth = mode.frequency_noise.common_scale if mode.frequency_noise else data.noise.growth_of_linear_error
    points = CurvePoints(mode.curve, mode.relative_amplitude, mode.growth)
    judged = _judge_misfit(points, error, 2 * data.noise.linear_error * growth, data.noise.curve_growth)
    if judged is None:
        return []
    grown = mode.eigenvalue / mode.linear
    fraction = float(np.linalg.norm(judged[0]) / max(float(grown.std()), 1e-30))
    return [LackOfFit(mode.mode, fraction, judged[1])]


@dataclass(frozen=True, eq=False)
class CurvePoints:
    """Where the points of some curves lie."""

    curve: NDArray[np.int64]  # (n_points,) number of the curve
    relative_amplitude: FloatArray  # (n_points,) amplitude over the largest
    growth: FloatArray  # (n_points,) growth by the nonlinearity


def _judge_misfit(
    points: CurvePoints, error: FloatArray, common_std: float, own_growth: float
) -> tuple[FloatArray, float] | None:
    """Return the coefficients of an error that all curves have alike, and its probability; None where they are short.

    Args:
        points: where the points are.
        error: (n_points,) the errors.
        common_std: standard deviation of an error of all curves that grows with the growth.
        own_growth: growth of the offset of a curve in units of the noise of a point.
    """
    from scipy.stats import f as fisher

    terms = np.vander(points.relative_amplitude, 1 + N_PATTERNS, increasing=True)
    # The patterns have rms 1 and mean 0, so that the norm of their coefficients is an rms.
    patterns = np.linalg.qr(terms)[0][:, 1:] * np.sqrt(len(terms))
    own, slopes, left, freedom = [], [], 0.0, 0
    for curve in np.unique(points.curve):
        mine = points.curve == curve
        columns = np.column_stack([np.ones(mine.sum()), patterns[mine]])
        if mine.sum() < columns.shape[1]:
            continue
        fitted = np.linalg.lstsq(columns, np.stack([error[mine], points.growth[mine]], axis=1), rcond=None)[0]
        own.append(fitted[1:, 0])
        slopes.append(fitted[1:, 1])
        left += float(np.sum((error[mine] - columns @ fitted[:, 0]) ** 2))
        freedom += int(mine.sum()) - columns.shape[1]
    if freedom < 1:
        return None
    mean, slope, n = np.mean(own, axis=0), np.mean(slopes, axis=0), len(own)
    common = common_std**2 * np.outer(slope, slope)
    weight = min(UPDATING.expected_weight, freedom)
    per_point = np.eye(N_PATTERNS) * n / len(error) + own_growth**2 * np.outer(slope, slope)
    expected = left / freedom * per_point
    between = np.array(own) - mean
    scatter = (between.T @ between + weight * expected) / (n - 1 + weight)
    # Harmonics that are left out, and interpolation, make small errors of lambda: curves without noise get no warning.
    exact = 1e-5**2 * np.eye(N_PATTERNS)
    score = float(mean @ np.linalg.solve(scatter / n + common + exact, mean))
    last = max(n - 1 + weight - N_PATTERNS + 1, 1)
    return mean, float(fisher.sf(score * last / (N_PATTERNS * (n - 1 + weight)), N_PATTERNS, last))


def unexplained_fraction(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> float:
    """Return the misfit of theta, (n_parameters,), to the measured growth of lambda, as a fraction of its rms.

    The mean error of each curve is not counted.
    """
    left, shift = [], []
    for mode in data.modes:
        eigenvalue, _, _, lost = make_curves(data, mode, model_class)(theta[None])
        if lost.any():
            return float("nan")
        of_curve = np.eye(mode.curve[-1] + 1)[mode.curve]
        mean = of_curve @ (of_curve / of_curve.sum(axis=0)).T
        error = residuals(mode, eigenvalue)[0] / mode.linear
        grown = mode.eigenvalue / mode.linear
        left.append(error - mean @ error)
        shift.append(grown - mean @ grown)
    return float(np.linalg.norm(np.concatenate(left)) / np.linalg.norm(np.concatenate(shift)))


# ---- all classes -----------------------------------------------------------------------------------


def warn_of_classes(classes: Sequence[ClassPosterior]) -> list[str]:
    """Return the warnings of all classes with their names; a single one if no class moves the frequencies."""
    if all(each.has_no_effect for each in classes):
        return [f"no class {TOO_LITTLE}"]
    return [f"class {each.model_class.name!r}: {warning}" for each in classes for warning in each.warnings]


def warn_of_choice(classes: Sequence[ClassPosterior], bands: Sequence[BackboneBand]) -> Iterator[str]:
    """Yield warnings about the choice of the best class and the bands that it predicts."""
    if all(each.has_no_effect for each in classes):
        return  # there is nothing to choose or to predict
    ranked = sorted(classes, key=lambda each: -each.log_evidence)
    if len(ranked) > 1:
        apart = ranked[0].log_evidence - ranked[1].log_evidence
        best, second = ranked[0].model_class.name, ranked[1].model_class.name
        if apart < UPDATING.too_close:
            yield (
                f"{best!r} and {second!r} differ by {apart:.1f} in log evidence: the data cannot distinguish them, "
                "measure at larger amplitudes"
            )
        else:
            yield from _warn_of_prior(ranked)
    for band in bands:
        yield from _warn_of_band(band)


def _warn_of_band(band: BackboneBand) -> Iterator[str]:
    """Yield where a band has gaps, and where it does not hold the measured points as often as it should."""
    missing = ~np.isfinite(band.frequency_hz)
    if missing.any():
        where = describe_points(band.amplitude, missing, band.sensor)
        advice = "leave out measured points near those amplitudes" if band.is_measured else "predict smaller amplitudes"
        yield (
            f"mode {band.mode}: there is no band at {where}, where the model does not converge for most draws: "
            f"take fewer harmonics, or {advice}"
        )
    if band.coverage < UPDATING.poor_coverage:
        yield (
            f"mode {band.mode}: the 95 % band holds only {100 * band.coverage:.0f} % of the measured points: the "
            "law or the linear structure is wrong there, try another law"
        )
    if band.left_out is not None and band.left_out < UPDATING.poor_left_out:
        yield (
            f"mode {band.mode}: the bands that the other curves give hold only {100 * band.left_out:.0f} % of the "
            "points of curves that were left out: the curves differ by more than their errors, look for one that is "
            "of another test or mode"
        )
    if band.mode_left_out is not None and band.mode_left_out < UPDATING.poor_coverage:
        yield (
            f"mode {band.mode}: the band that the other modes give holds only {100 * band.mode_left_out:.0f} % of its "
            "points: the law is wrong, or the errors of the linear structure or of the curves are larger than stated "
            "(linear_error, curve_offset), so do not trust bands of modes without curves"
        )
    poor = [each for each in band.sensors if each.left_out is not None and each.left_out < UPDATING.poor_left_out]
    if poor:
        worst = min(poor, key=lambda each: each.left_out or 0.0)
        yield (
            f"mode {band.mode}: the bands that the other curves give hold only {100 * (worst.left_out or 0.0):.0f} % "
            f"of the motions of sensor {worst.sensor!r} in curves that were left out"
            f"{f', and too few of {len(poor) - 1} other sensors' if len(poor) > 1 else ''}: the shapes differ by more "
            "than their errors, look for a curve that is of another test or mode"
        )


def _warn_of_prior(ranked: Sequence[ClassPosterior]) -> Iterator[str]:
    """Yield where a prior twice as wide, of the best class or of another, would put another class first."""
    best, second, *_ = ranked
    apart = best.log_evidence - second.log_evidence
    decisive = [
        (name, second, f"{change:.1f}", apart) for name, change in best.prior_sensitivity.items() if -change > apart
    ]
    for other in ranked[1:]:
        apart = best.log_evidence - other.log_evidence
        changes = other.prior_sensitivity.items()
        decisive += [(f"its {name}", other, f"{change:+.1f}", apart) for name, change in changes if change > apart]
    for name, first, change, apart in decisive:
        yield (
            f"with a prior of {name} twice as wide, {first.model_class.name!r} would come before "
            f"{best.model_class.name!r} ({change} against {apart:.1f} in log evidence): the prior decides, so give "
            "reasons for its width"
        )
