"""The posterior of one model class: best parameters, samples, evidence, warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError, NotDeterminedError, nearest
from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, with_amplitudes
from opid.updating.likelihood.contradictions import find_motion_errors
from opid.updating.likelihood.curves import (
    LikelihoodSlopes,
    describe_failures,
    likelihood_function,
    make_curves,
    slopes_function,
)
from opid.updating.likelihood.interactions import adapt_to_class, find_omitted_pull
from opid.updating.model_class import ClassParameter, DampingRatio, ModelClass
from opid.updating.result import ClassPosterior
from opid.updating.sampling.chains import (
    Chain,
    LogDensity,
    Progress,
    diagnose,
    estimates_of,
    posterior_density,
    spread_starts,
)
from opid.updating.sampling.evidence import (
    Evidence,
    Maximum,
    importance,
    laplace,
    laplace_of_samples,
    maximum_a_posteriori,
    prior_sensitivity,
    quadrature,
)
from opid.updating.sampling.samplers import Transitional, metropolis, nuts, transitional
from opid.updating.settings import UPDATING
from opid.updating.study import SAMPLERS, Sampler
from opid.updating.warnings import TOO_LITTLE, find_fit, has_no_effect, warn_of_class

_NOWHERE = 1e12  # what a search takes for the negative logarithm of a density of 0
_AMPLITUDE_STEP = 0.005  # The slopes are compared at amplitudes that differ by this to either side, in ln A.
_MOST_DRAWS = 10  # A sample that finds no place within the prior in so many draws stays where it is.
_UNKNOWN_CALIBRATION = (
    "how a calibration error of the amplitudes moves theta cannot be computed, because the model does not converge "
    "beside its best parameters: no interval is given; take fewer harmonics, or state motion_error = 0"
)
METHODS = ("quadrature", "laplace", "importance", "transitional")


@dataclass(frozen=True, eq=False)
class Density:
    """The posterior of one class as functions of theta, (n, n_parameters) -> (n,)."""

    likelihood: LogDensity  # logarithm of p(D | theta); it is only evaluated where the prior is not zero
    prior: LogDensity  # logarithm of p(theta)
    posterior: LogDensity  # sum of both


def density_of(data: BackboneData, model_class: ModelClass) -> Density:
    """Return the posterior of one `model_class` given the `data` of its backbones, as functions of theta."""
    evaluate = likelihood_function(data, model_class)

    def likelihood(theta: FloatArray) -> FloatArray:
        return evaluate(theta)[0]

    return Density(likelihood, model_class.log_prior, posterior_density(likelihood, model_class.log_prior))


def update_class(
    data: BackboneData,
    model_class: ModelClass,
    *,
    rng: np.random.Generator,
    sampler: Sampler = "adaptive",
    n_samples: int = 5500,
    evidences: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> ClassPosterior:
    """Return the posterior of the parameters of one law and the evidence of that law (Song et al. 2021, section 2).

    The search for the maximum a posteriori starts at the best of many draws of the prior; its curvature gives the first
    covariance of the proposals. Adaptive Metropolis runs up to twenty chains side by side with n_samples in all. One in
    eleven is dropped (5000 of 5500 are left, as in the paper).

    Args:
        data: the backbones, from `backbone_data`.
        model_class: the law with its priors.
        rng: source of chance.
        sampler: "adaptive", "nuts" or "transitional".
        n_samples: number of samples of all chains, the warm-up included.
        evidences: some of "quadrature", "laplace", "importance" and "transitional"; classes are compared by the first.
            Where None, quadrature, which is exact, and Laplace up to three parameters; importance and Laplace beyond.
            The transitional sampler adds its own, which comes first where another method gives none.
        progress: a function that is called with the fraction of the samples that are drawn; by transitional Markov
            chain Monte Carlo with the exponent of the likelihood, which ends at 1, too.

    Raises:
        InputError: an unknown sampler or evidence, or quadrature of more than three parameters.
        NotDeterminedError: the class has no likelihood anywhere in its prior.
    """
    methods = _choose_methods(evidences, model_class.n_parameters)
    if sampler not in SAMPLERS:
        raise InputError(f"there is no sampler {sampler!r}: {nearest(sampler, SAMPLERS)}")
    if sampler == "nuts" and data.form != "recommended":
        raise InputError(f"the likelihood {data.form!r} has no slopes: take another sampler, or the recommended form")
    data, density, peak, warnings = _find_adapted_peak(data, model_class, rng, holds_all=sampler == "transitional")
    stages = None
    if peak is None or sampler == "transitional" or "transitional" in methods:
        stages = transitional(
            density.likelihood, density.prior, model_class.sample_prior, rng=rng,
            n_particles=max(n_samples // UPDATING.n_moves, 100), n_moves=UPDATING.n_moves, progress=progress,
        )  # fmt: skip
    if stages and (peak is None or sampler == "transitional"):
        chain = stages.chain
    else:
        assert peak is not None
        if sampler == "nuts":
            chain = _walk(data, model_class, peak, n_samples, rng, progress)
        else:
            chain = _sample(density, peak, n_samples, rng, progress)
    best = chain.best if peak is None else peak.theta
    unreached, sentences = _find_unreached(data, model_class, best)
    found, refused = _compute_evidences(methods, density, model_class, peak, chain, stages, rng)
    covariance = _limit_by_prior(peak, model_class) if peak else chain.covariance
    moved = _find_calibration(data, model_class, best, covariance)
    calibrated = _calibrate(chain, model_class, moved, rng)
    estimates = estimates_of(calibrated, [f"theta_{k + 1}" for k in range(model_class.n_parameters)])
    diagnostics, is_calibrated = diagnose(chain), bool(np.isfinite(moved).all())
    if not is_calibrated:
        warnings.append(_UNKNOWN_CALIBRATION)
    is_idle = has_no_effect(data, model_class)
    pulled = find_omitted_pull(data, model_class, best, covariance)
    is_pulled = not (np.abs(pulled) <= UPDATING.most_omitted * np.sqrt(np.diag(calibrated.covariance))).all()
    if not is_calibrated or is_pulled or diagnostics.effective_samples < UPDATING.fewest_samples:
        estimates = {name: each.without_interval() for name, each in estimates.items()}
    estimates = _withhold_unfit(data, model_class, best, estimates)
    if not is_idle:
        warnings += [*sentences, *refused, *warn_of_class(
            data, model_class, chain, best, estimates=estimates, evidences=found, diagnostics=diagnostics,
            untold=unreached, is_pulled=is_pulled,
        )]  # fmt: skip
    return ClassPosterior(
        model_class=model_class,
        evidences=found,
        best=best,
        estimates=estimates,
        covariance=calibrated.covariance,
        samples=calibrated.pooled,
        calibration_std=np.sqrt(np.sum(moved**2, axis=0)),
        log_likelihood_at_best=float(density.likelihood(best[None])[0]),
        diagnostics=diagnostics,
        prior_sensitivity=prior_sensitivity(density.likelihood, model_class, chain.pooled, best),
        warnings=(f"no theta that its prior allows {TOO_LITTLE}",) if is_idle else tuple(warnings),
        chain=chain,
        has_no_effect=is_idle,
        is_pulled=is_pulled,
    )


def _withhold_unfit(
    data: BackboneData, model_class: ModelClass, best: FloatArray, estimates: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the estimates, without their intervals where the law fits neither the backbones nor the force.

    The intervals of a law that does not fit tell how well the nearest wrong one is known. A wrong damper leaves the
    springs what they are. The paper's forms keep theirs, as they are printed.
    """
    if data.form != "recommended":
        return dict(estimates)
    do_springs_fit, do_dampers_fit = find_fit(data, model_class, best)
    dissipative = [isinstance(each, DampingRatio) or (isinstance(each, ClassParameter) and each.term.is_damper)
                   for each in model_class.parameters]  # fmt: skip
    return {
        name: each if do_springs_fit and (do_dampers_fit or not loses) else each.without_interval()
        for (name, each), loses in zip(estimates.items(), dissipative, strict=True)
    }


def _find_calibration(
    data: BackboneData, model_class: ModelClass, best: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Return how far theta moves with a standard deviation of each sensor's calibration, (n_sensors, n_parameters).

    The posterior is about Gaussian near its maximum. With C its `covariance` and g the slopes of the likelihood there,
    the maximum moves by C dg/d ln A if the amplitudes A of a controlled sensor grow. A common factor s of all
    amplitudes changes the coefficient of a cubic spring by 1 / s^2, and gaps and travels by s. Only the recommended
    form has it. The moves are nan where the likelihood has no slopes.
    """
    if data.form != "recommended" or not data.noise.motion_error:
        return np.zeros((0, best.size))
    moves = []
    for sensor, error in find_motion_errors(data, model_class, best).items():
        ends = []
        for step in (_AMPLITUDE_STEP, -_AMPLITUDE_STEP):
            value, slopes = slopes_function(with_amplitudes(data, sensor, np.exp(step)), model_class)(best[np.newaxis])
            ends.append(slopes[0] if np.isfinite(value[0]) else np.full(best.size, np.nan))
        moves.append(error * covariance @ (ends[0] - ends[1]) / (2 * _AMPLITUDE_STEP))
    return np.array(moves)


def _calibrate(chain: Chain, model_class: ModelClass, moved: FloatArray, rng: np.random.Generator) -> Chain:
    """Return a chain with errors of the calibration, whose moves are (n_sensors, n_parameters).

    An error that leads beyond the prior is drawn anew.
    """
    samples, left, moves = chain.pooled.copy(), np.arange(len(chain.pooled)), np.nan_to_num(moved)
    for _ in range(_MOST_DRAWS if moves.any() else 0):
        tried = chain.pooled[left] + rng.standard_normal((left.size, len(moves))) @ moves
        inside = np.isfinite(model_class.log_prior(tried))
        samples[left[inside]] = tried[inside]
        left = left[~inside]
    return replace(chain, samples=samples.reshape(chain.samples.shape))


def _limit_by_prior(peak: Maximum, model_class: ModelClass) -> FloatArray:
    """Return the covariance at a maximum, which is no wider than a uniform prior where the data tell nothing.

    Other priors are in the curvature of the maximum already.
    """
    std = np.sqrt(np.diag(peak.covariance_inside))
    relative = peak.covariance_inside / np.outer(std, std)
    # The variance of a uniform prior is a twelfth of the square of its width; other ones add no precision.
    of_prior = np.array([
        12 * (own / (prior.second - prior.first)) ** 2 if prior.family == "uniform" else 0.0
        for prior, own in zip(model_class.priors, std, strict=True)
    ])  # fmt: skip
    # This is the inverse of the sum of both precisions.
    limited = np.linalg.solve(np.eye(std.size) + relative * of_prior, relative)
    return np.asarray(limited * np.outer(std, std))


def _find_unreached(data: BackboneData, model_class: ModelClass, best: FloatArray) -> tuple[tuple[int, ...], list[str]]:
    """Return numbers of parameters, from 1, whose terms begin beyond all measured points, and a sentence on them."""
    reached = np.zeros(len(data.system.joints))
    for mode in data.modes if model_class.has_knots else ():
        for found in make_curves(data, mode, model_class).solve(best[np.newaxis]):
            at_turns = found.extension.reshape(found.amplitude.size, len(found.harmonics), -1).sum(axis=1)
            reached = np.fmax(reached, np.fmax.reduce(np.abs(at_turns)))
    numbers, knots, largest = [], [], 0.0
    for number, each in enumerate(model_class.law_parameters, start=1):
        of_joints = [own for joint, own in zip(data.system.joints, reached, strict=True) if each.term.acts_at(joint)]
        if each.term.gap_m is not None and each.term.gap_m >= max(of_joints, default=0.0):
            numbers.append(number)
            knots.append(f"{1e3 * each.term.gap_m:g}")
            largest = max([largest, *of_joints])
    if not numbers:
        return (), []
    names = " and ".join(f"theta_{number}" for number in numbers)
    return tuple(numbers), [
        f"no data tell {names}: terms begin at {' and '.join(knots)} mm, and in the curves their joints extend by at "
        f"most {1e3 * largest:.3g} mm; the posterior is the prior there, leave these knots out"
    ]


def estimate_evidence(data: BackboneData, model_class: ModelClass, rng: np.random.Generator) -> float:
    """Return the log evidence of one class by Laplace's method, without samples; -inf where it has no likelihood.

    Args:
        data: the backbones, from `backbone_data`.
        model_class: the laws with their priors.
        rng: source of chance.
    """
    try:
        _, _, peak, _ = _find_adapted_peak(data, model_class, rng)
        return -np.inf if peak is None else laplace(peak, support=[p.support for p in model_class.priors]).log_evidence
    except NotDeterminedError:
        return -np.inf


def _find_adapted_peak(
    data: BackboneData, model_class: ModelClass, rng: np.random.Generator, *, holds_all: bool = False
) -> tuple[BackboneData, Density, Maximum | None, list[str]]:
    """Return the data as the class sees them at its maximum, its density, its maximum, and warnings.

    `holds_all` is whether the samples will be those of all maxima.
    """
    found, density = data, density_of(data, model_class)
    peak, warnings = _find_peak(density, found, model_class, rng, holds_all)
    for _ in range(1 if data.met_damping is None else UPDATING.n_paired):
        if peak is None or (adapted := adapt_to_class(data, model_class, peak.theta)) is data:
            break
        found, density = adapted, density_of(adapted, model_class)
        near = _follow_peak(density, model_class, peak, rng)
        peak, warnings = _find_peak(density, found, model_class, rng, holds_all) if near is None else (near, warnings)
    return found, density, peak, warnings


def _follow_peak(density: Density, model_class: ModelClass, peak: Maximum, rng: np.random.Generator) -> Maximum | None:
    """Return the maximum of a density that differs little from one whose maximum is known; None where it is lost."""
    if not np.isfinite(density.posterior(peak.theta[np.newaxis])).all():
        return None
    return _climb(density, peak.theta, [prior.support for prior in model_class.priors], rng)


def _choose_methods(evidences: Sequence[str] | None, n_parameters: int) -> tuple[str, ...]:
    if evidences is None:
        return METHODS[:2] if n_parameters <= UPDATING.most_by_quadrature else ("importance", "laplace")
    for method in evidences:
        if method not in METHODS:
            raise InputError(f"there is no evidence {method!r}: {nearest(method, METHODS)}")
    if not evidences:
        raise InputError(f"no evidence is named: give some of {', '.join(METHODS)}")
    if "quadrature" in evidences and n_parameters > UPDATING.most_by_quadrature:
        raise InputError(
            f"quadrature takes up to {UPDATING.most_by_quadrature} parameters and the class has {n_parameters}: take "
            "importance"
        )
    return tuple(evidences)


def _find_peak(
    density: Density, data: BackboneData, model_class: ModelClass, rng: np.random.Generator, holds_all: bool
) -> tuple[Maximum | None, list[str]]:
    """Return the highest maximum from several starts, None where none has a curvature, and warnings about it."""
    support = [prior.support for prior in model_class.priors]
    starts = _draw_starts(data, model_class, rng)
    values = density.posterior(starts)
    if data.form == "recommended" and (model_class.slips or model_class.has_knots):
        # Force and travel of a joint that slips compensate for each other along a narrow, bent ridge, and so do the
        # pieces of a spline.
        starts = np.concatenate([_approach(data, model_class, starts, values), starts])
        values = density.posterior(starts)
    if not np.isfinite(values).any():
        where = "; in ".join(describe_failures(data, model_class, starts, lost=True))
        raise NotDeterminedError(
            f"class {model_class.name!r} has no backbone anywhere in its prior (in {where or 'any mode'} of its draws "
            "the model does not converge): take a smaller scale or prior, other harmonics, or leave out measured "
            "points at those amplitudes"
        )
    peaks: list[Maximum] = []
    for _ in range(3):
        start = starts[int(np.argmax(values))]
        peak = _climb(density, start, support, rng)
        if peak is not None:
            spread = np.sqrt(np.diag(peak.covariance))
            if not any((np.abs(peak.theta - other.theta) < spread).all() for other in peaks):
                peaks.append(peak)
        # The next start lies apart from this one and from the maximum to which it led.
        width = np.ptp(starts, axis=0)
        near = np.zeros(len(starts), dtype=bool)
        for each in (start,) if peak is None else (peak.theta, start):
            near |= (np.abs(starts - each) / width < 0.2).all(axis=1)
        values = np.where(near, -np.inf, values)
        if not np.isfinite(values).any():
            break
    if not peaks:
        return None, [
            "the posterior has no maximum with a curvature: its samples and its evidence come from transitional Monte "
            "Carlo"
        ]
    peaks.sort(key=lambda each: -each.log_density)
    warnings = []
    if len(peaks) > 1 and peaks[0].log_density - peaks[1].log_density < 5:
        other = ", ".join(f"{value:.3g}" for value in peaks[1].theta)
        advice = (
            "mean and interval are those of both together; if one is impossible, give a prior that leaves it out"
            if holds_all
            else "take the transitional sampler, which finds both"
        )
        warnings.append(
            f"there is a second maximum at theta = ({other}), {peaks[0].log_density - peaks[1].log_density:.1f} lower "
            f"in log density: {advice}"
        )
    return peaks[0], warnings


def _approach(data: BackboneData, model_class: ModelClass, starts: FloatArray, values: FloatArray) -> FloatArray:
    """Return where the slopes lead from the best of some starts, (n, n_parameters), without the force of the tests."""
    from scipy.optimize import minimize

    find_slopes = _density_of_scores(replace(data, force=None), model_class)

    def fall(score: FloatArray) -> tuple[float, FloatArray]:
        value, slopes = find_slopes(score[np.newaxis])
        return (-float(value[0]), -slopes[0]) if np.isfinite(value[0]) else (_NOWHERE, slopes[0])

    first = np.argsort(-values)[: UPDATING.n_approached]
    scores = np.stack([prior.to_normal(starts[first, k]) for k, prior in enumerate(model_class.priors)], axis=1)
    ends = [minimize(fall, score, jac=True, method="L-BFGS-B", options={"maxiter": 60}).x for score in scores]
    return _place_scores(model_class, np.array(ends))[0]


def _draw_starts(data: BackboneData, model_class: ModelClass, rng: np.random.Generator) -> FloatArray:
    """Return draws of the prior, (n, n_parameters), with factors of the stiffness about those that phase I found."""
    starts = model_class.sample_prior(UPDATING.n_starts, rng)
    if data.structure is not None:
        known = data.structure
        factors = rng.multivariate_normal(known.reference, known.covariance, size=len(starts))
        starts[:, -factors.shape[1] :] = factors
    return starts


def _climb(
    density: Density, start: FloatArray, support: list[tuple[float, float]], rng: np.random.Generator
) -> Maximum | None:
    """Return the maximum from one start, None where it has no curvature."""
    try:
        peak = maximum_a_posteriori(density.posterior, start, support=support, max_iterations=UPDATING.most_iterations)
        return peak if peak.precision.size else None  # `precision` raises without a curvature
    except NotDeterminedError as error:
        return None if error.partial is None else _fit_rough_peak(density, np.asarray(error.partial), support, rng)


def _fit_rough_peak(
    density: Density, theta: FloatArray, support: list[tuple[float, float]], rng: np.random.Generator
) -> Maximum | None:
    """Return the maximum of a quadratic that is fitted over about a standard deviation.

    It serves where the density has small steps, as near a modal interaction.
    """
    steps = np.abs(theta) * 1e-5 + 1e-9
    reach = np.geomspace(1.0, 1e6, 49)
    top = float(density.posterior(theta[None])[0])
    for k in range(theta.size):
        along = theta + reach[:, None] * steps[k] * np.eye(theta.size)[k]
        fallen = np.flatnonzero(density.posterior(along) < top - UPDATING.rough_drop)
        if not fallen.size:
            return None
        steps[k] *= reach[fallen[0]]
    scaled = np.clip(rng.standard_normal((60 * theta.size, theta.size)), -2, 2)
    low, high = np.transpose(support)
    points = np.clip(theta + scaled * steps, low, high)
    values = density.posterior(points)
    kept = np.isfinite(values) & (values > top - 8 * theta.size)
    u = (points[kept] - theta) / steps
    rows, columns = np.tril_indices(theta.size)
    terms = np.column_stack([np.ones(len(u)), u, u[:, rows] * u[:, columns]])
    if len(terms) < 2 * terms.shape[1]:
        return None
    fitted = np.linalg.lstsq(terms, values[kept] - top, rcond=None)[0][1 + theta.size :]
    curvature = np.zeros((theta.size, theta.size))
    curvature[rows, columns] = fitted
    curvature = curvature + curvature.T
    if np.linalg.eigvalsh(curvature)[-1] >= 0:
        return None
    highest = int(np.argmax(np.where(kept, values, -np.inf)))
    best, value = (points[highest], float(values[highest])) if values[highest] > top else (theta, top)
    nothing = np.zeros(theta.size)
    return Maximum(best, value, nothing, curvature / np.outer(steps, steps), nothing, len(points))


def _sample(
    density: Density, peak: Maximum, n_samples: int, rng: np.random.Generator, progress: Progress | None
) -> Chain:
    n_chains = int(np.clip(n_samples // UPDATING.shortest_chain, 4, UPDATING.most_chains))
    # `spread_starts` doubles the scatter, so the starts follow the Laplace approximation and need a short warm-up only.
    start = spread_starts(density.posterior, peak.theta, peak.covariance_inside / 4, n_chains=n_chains, rng=rng)
    dropped = n_samples // (UPDATING.warm_up * n_chains)
    kept = (n_samples - n_samples // UPDATING.warm_up) // n_chains
    return metropolis(
        density.posterior, start, covariance=peak.covariance_inside, n_samples=kept, n_warm_up=dropped, rng=rng,
        progress=progress,
    )  # fmt: skip


def _place_scores(model_class: ModelClass, score: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return theta for standard normal scores, and the derivatives of each parameter by its score, (n, d) each."""
    pairs = [prior.from_normal(score[:, k]) for k, prior in enumerate(model_class.priors)]
    return np.stack([value for value, _ in pairs], axis=1), np.stack([slope for _, slope in pairs], axis=1)


def _density_of_scores(data: BackboneData, model_class: ModelClass) -> LikelihoodSlopes:
    """Return scores (n, d) -> their log density (n,) and its slopes (n, d); the prior of scores is standard normal."""
    slopes_of = slopes_function(data, model_class)

    def find_slopes(score: FloatArray) -> tuple[FloatArray, FloatArray]:
        theta, stretch = _place_scores(model_class, score)
        value, slopes = np.full(len(score), -np.inf), np.zeros(score.shape)
        inside = np.isfinite(model_class.log_prior(theta))
        if inside.any():
            found, by_theta = slopes_of(theta[inside])
            value[inside] = found - 0.5 * np.sum(score[inside] ** 2, axis=1)
            slopes[inside] = by_theta * stretch[inside] - score[inside]
        return value, np.where(np.isfinite(value)[:, np.newaxis], slopes, 0.0)

    return find_slopes


def _walk(
    data: BackboneData,
    model_class: ModelClass,
    peak: Maximum,
    n_samples: int,
    rng: np.random.Generator,
    progress: Progress | None,
) -> Chain:
    """Return chains of the no-U-turn sampler, which walks where the prior is a standard normal distribution."""
    priors, find_slopes = model_class.priors, _density_of_scores(data, model_class)
    # A maximum at a bound has no finite score.
    low, high = np.transpose([prior.support for prior in priors])
    within = 0.5 * np.minimum(np.sqrt(np.diag(peak.covariance_inside)), high - low)
    best = np.clip(peak.theta, low + within, high - within)
    middle = np.array([[float(prior.to_normal(value)) for prior, value in zip(priors, best, strict=True)]])
    stretch = _place_scores(model_class, middle)[1][0]
    # The curvature of the prior limits the scores where the data do not.
    precision = np.linalg.inv(peak.covariance_inside) * np.outer(stretch, stretch)
    covariance = np.linalg.inv(precision + np.eye(len(precision)))
    start = spread_starts(
        lambda score: find_slopes(score)[0], middle[0], covariance / 4, n_chains=UPDATING.n_walks, rng=rng
    )
    kept = (n_samples - n_samples // UPDATING.warm_up) // UPDATING.n_walks
    walked = nuts(
        find_slopes, start, covariance=covariance, n_samples=kept, n_warm_up=UPDATING.steps_learnt, rng=rng,
        progress=progress,
    )  # fmt: skip
    theta = _place_scores(model_class, walked.pooled)[0]
    # The density of theta is that of the scores over the stretch of the coordinates.
    value = walked.log_density + 0.5 * np.sum(walked.samples**2, axis=2)
    value = value + model_class.log_prior(theta).reshape(value.shape)
    return replace(walked, samples=theta.reshape(walked.samples.shape), log_density=value)


def _compute_evidences(
    methods: Sequence[str],
    density: Density,
    model_class: ModelClass,
    peak: Maximum | None,
    chain: Chain,
    stages: Transitional | None,
    rng: np.random.Generator,
) -> tuple[tuple[Evidence, ...], list[str]]:
    """Return the evidence by each method, at least one, and the reasons where a method has none."""
    support = [prior.support for prior in model_class.priors]
    most = UPDATING.most_nodes if chain.n_parameters < 3 else UPDATING.most_nodes_of_three

    def by_samples() -> Evidence:
        best, at_best = (
            (peak.theta, peak.log_density) if peak else (chain.best, float(density.posterior(chain.best[None])[0]))
        )
        return laplace_of_samples(at_best, best, chain)

    found, refused = [], []
    for method in methods:
        try:
            if method == "transitional" and stages is not None:
                found.append(stages.evidence)
            elif method == "laplace":
                found.append(laplace(peak, support=support) if peak else by_samples())
            elif method == "importance":
                found.append(importance(density.posterior, chain, rng=rng))
            else:
                found.append(quadrature(
                    density.posterior, chain.pooled.mean(axis=0), chain.covariance, support=support, tolerance=1e-3,
                    max_evaluations=most,
                ))  # fmt: skip
        except (NotDeterminedError, InputError) as error:
            refused.append(f"{method} gives no evidence: {error}")
    if stages and "transitional" not in methods:
        # Classes are compared by the first: where a method refuses, Laplace's is hardly right.
        found.insert(0 if refused else len(found), stages.evidence)
        refused = [f"{each}; the class is compared by its transitional evidence" for each in refused]
    if not found:
        try:
            found.append(by_samples())
        except NotDeterminedError as error:
            raise NotDeterminedError("; ".join([*refused, str(error)])) from error
    return tuple(found), refused
