"""What to doubt about a Bayesian updating, one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, curves_of, residuals
from opid.updating.likelihood.lack_of_fit import LackOfFit
from opid.updating.likelihood.model_curves import named_points
from opid.updating.model_class import ModelClass
from opid.updating.result import BackboneBand, ClassPosterior, Diagnostics, Evidence
from opid.updating.sampling.diagnostics import Pressure

FEW_SAMPLES = 200.0
"""Effective samples below which a 95 % interval is rough."""

WARNED_R_HAT = 1.05
"""Above it the chains have not found the same distribution."""

RARE = 1e-3
"""Probability, of all modes together, below which a misfit that all curves share is no chance."""

LEAST_MISFIT = 0.05
"""Of the measured growth of lambda: a smaller misfit is told from none by many curves, and does no harm."""

MOST_UNEXPLAINED = 0.3
"""Of the measured growth of lambda: what a class may leave where the curves are too short to tell their noise."""

METHODS_DIFFER = 0.5
"""Between the logarithms of two evidences, beside three of their standard deviations."""

TOO_CLOSE = 1.0
"""Difference of log evidence below which two classes cannot be told apart."""

POOR_COVERAGE = 0.8
"""Share of the measured points within a 95 % band below which it is doubted."""

LEAST_MOVED = 0.05
"""Of the measured growth of the frequencies: a class that moves them by less anywhere in its prior tells nothing."""

_TOO_LITTLE = (
    f"moves the frequencies by more than {100 * LEAST_MOVED:.0f} % of their measured growth: look at the unit of the "
    "amplitudes, and at the scale of the law"
)
MOVES_NOTHING = f"no theta that its prior allows {_TOO_LITTLE}"
"""All there is to say of a class without any effect."""


def doubts_of_class(
    model_class: ModelClass,
    estimates: Mapping[str, Estimate],
    evidences: Sequence[Evidence],
    diagnostics: Diagnostics,
    pressures: Sequence[Pressure],
    *,
    misfits: Sequence[LackOfFit],
    unexplained: float,
    gaps: Sequence[str],
    lost: Sequence[str],
    met: Sequence[str] = (),
) -> Iterator[str]:
    """Yield what to doubt about the posterior of one class.

    Args:
        model_class: the class.
        estimates: of its parameters.
        evidences: by every method.
        diagnostics: of the sampling.
        pressures: where the posterior presses against its priors.
        misfits: what the best parameters leave in each mode, the same way in all curves.
        unexplained: share of the measured growth of lambda that the best parameters leave; only asked where `misfits`
            is empty.
        gaps: where the model did not converge for samples of the posterior, from `where_it_fails`.
        lost: where it did not for parameters three times as far out, which have no curve then.
        met: measured points at which modes interact, from `where_modes_interact`.
    """
    for pressure in pressures:
        yield pressure.sentence
    yield from _doubts_of_fit(misfits, unexplained)
    if gaps:
        yield (
            f"in {'; in '.join(gaps)} of the samples the model does not converge: its curve is bridged there from its "
            "other points; take fewer harmonics, or leave out measured points near those amplitudes (an interaction of "
            "modes, which continued_backbone follows)"
        )
    elif lost:
        yield (
            f"beside the posterior, in {'; in '.join(lost)} of the parameters, the model does not converge: they count "
            "as impossible, which may cut the posterior off; take fewer harmonics, or leave out measured points near "
            "those amplitudes"
        )
    for clause in met:
        yield (
            f"in {clause}: frequencies measured there may lie off the smooth backbone of the model, which knows no "
            "interaction; leave those points out (continued_backbone follows an interaction)"
        )
    if diagnostics.effective_samples < FEW_SAMPLES:
        yield (
            f"the samples are worth {diagnostics.effective_samples:.0f} independent ones: intervals are rough, draw "
            "more"
        )
    if diagnostics.r_hat > WARNED_R_HAT:
        yield f"the chains differ (R-hat {diagnostics.r_hat:.2f}): draw more samples, or take the transitional sampler"
    if evidences:
        first = evidences[0]
        for other in evidences[1:]:
            apart = abs(other.log_evidence - first.log_evidence)
            if apart > METHODS_DIFFER + 3 * (first.std**2 + other.std**2) ** 0.5:
                yield f"log evidence by {other.method} is {apart:.1f} from that by {first.method}: believe the latter"
    if model_class.n_parameters > 1:
        for (name, estimate), kind in zip(estimates.items(), model_class.kinds, strict=True):
            if estimate.holds(0.0):
                yield f"the interval of {name} contains 0: the data do not ask for the term {kind}"


def _doubts_of_fit(misfits: Sequence[LackOfFit], unexplained: float) -> Iterator[str]:
    """A misfit that all curves of a mode share, larger than chance and large enough to matter."""
    rare = [each for each in misfits if each.probability < RARE / len(misfits) and each.share > LEAST_MISFIT]
    if rare:
        worst = max(rare, key=lambda each: each.share)
        yield (
            f"at its best it leaves {100 * worst.share:.0f} % of the measured growth of the frequencies of mode "
            f"{worst.mode} unexplained, the same way in all curves (by chance in less than one of "
            f"{1 / RARE:.0f} sets): this law does not fit the backbones, its intervals mean nothing"
        )
    elif not misfits and not unexplained <= MOST_UNEXPLAINED:
        yield (
            f"at its best it leaves {100 * unexplained:.0f} % of the measured growth of the frequencies unexplained: "
            "this law does not fit the backbones, its intervals mean nothing"
        )


def doubts_of_choice(classes: Sequence[ClassPosterior], bands: Sequence[BackboneBand]) -> Iterator[str]:
    """Yield what to doubt about the best class and its prediction.

    Args:
        classes: all of them.
        bands: that the best class predicts.
    """
    if all(each.warnings == (MOVES_NOTHING,) for each in classes):
        return  # there is nothing to choose, nor to predict
    ranked = sorted(classes, key=lambda each: -each.log_evidence)
    if len(ranked) > 1:
        apart = ranked[0].log_evidence - ranked[1].log_evidence
        best, second = ranked[0].model_class.name, ranked[1].model_class.name
        if apart < TOO_CLOSE:
            yield (
                f"{best!r} and {second!r} differ by {apart:.1f} in log evidence: the data cannot tell them apart, "
                "measure at larger amplitudes"
            )
        else:
            yield from _prior_decides(ranked)
    for band in bands:
        missing = ~np.isfinite(band.frequency_hz)
        if missing.any():
            where = named_points(band.amplitude, missing, band.sensor)
            yield (
                f"mode {band.mode}: there is no band at {where}, where the model does not converge for most draws: "
                "take fewer harmonics, or leave out measured points near those amplitudes"
            )
        if band.coverage < POOR_COVERAGE:
            yield (
                f"mode {band.mode}: the 95 % band holds {100 * band.coverage:.0f} % of the measured points: the law or "
                "the linear structure is wrong there"
            )


def _prior_decides(ranked: Sequence[ClassPosterior]) -> Iterator[str]:
    """Whether a prior twice as wide, of the best class or of another, would put another one first."""
    best = ranked[0]
    for name, change in best.prior_sensitivity.items():
        apart = best.log_evidence - ranked[1].log_evidence
        if -change > apart:
            yield (
                f"with a prior of {name} twice as wide, {ranked[1].model_class.name!r} would come before "
                f"{best.model_class.name!r} ({change:.1f} against {apart:.1f} in log evidence): the prior decides"
            )
    for other in ranked[1:]:
        apart = best.log_evidence - other.log_evidence
        for name, change in other.prior_sensitivity.items():
            if change > apart:
                yield (
                    f"with a prior of its {name} twice as wide, {other.model_class.name!r} would come before "
                    f"{best.model_class.name!r} ({change:+.1f} against {apart:.1f} in log evidence): the prior decides"
                )


def doubts_of_classes(classes: Sequence[ClassPosterior]) -> list[str]:
    """Return the doubts of all classes with their names; a single one where none of them has any effect.

    Args:
        classes: all of them.
    """
    if all(each.warnings == (MOVES_NOTHING,) for each in classes):
        return [f"no class {_TOO_LITTLE}"]
    return [f"class {each.model_class.name!r}: {doubt}" for each in classes for doubt in each.warnings]


def moves_nothing(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> bool:
    """Return whether a class leaves the frequencies where they are, while the measured ones grow.

    Args:
        data: the backbones.
        model_class: the class.
        theta: (n, n_parameters), draws of its prior.
    """
    for mode in data.modes:
        eigenvalue, _, _, lost = curves_of(data, mode, model_class)(theta)
        if lost.any() or np.ptp(eigenvalue, axis=1).max() > LEAST_MOVED * np.ptp(mode.growth) * mode.linear:
            return False
    return True


def unexplained_share(data: BackboneData, model_class: ModelClass, theta: FloatArray) -> float:
    """Return what the model leaves of the measured growth of lambda, as a share of its rms over all points.

    Each curve may lie off as a whole: its mean error is not counted.

    Args:
        data: the backbones.
        model_class: the law.
        theta: (n_parameters,).
    """
    left, shift = [], []
    for mode in data.modes:
        eigenvalue, _, _, lost = curves_of(data, mode, model_class)(theta[None])
        if lost.any():
            return float("nan")
        of_curve = np.eye(mode.curve[-1] + 1)[mode.curve]
        mean = of_curve @ (of_curve / of_curve.sum(axis=0)).T
        error = residuals(mode, eigenvalue)[0] / mode.linear
        grown = mode.eigenvalue / mode.linear
        left.append(error - mean @ error)
        shift.append(grown - mean @ grown)
    return float(np.linalg.norm(np.concatenate(left)) / np.linalg.norm(np.concatenate(shift)))
