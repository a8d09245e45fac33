"""Repeatability of the suspensions from run to run, estimated from the runs and from what the study states.

Springs, damping and friction of each run depart from those of all runs by factors 1 + e. It is known beforehand that e
is small, but hardly how small: the stated repeatability is believed within a factor of ten. If springs, damping and
friction all changed by the same ratio from one mass to the other, or if a repeated run at the first mass agrees with
the first one, the departures are small and the mass is well known; it is not if they changed by different ratios.

The gains of sensors of forces differ from run to run as well, and a gain that grew looks like springs, damping and
friction that all grew by one ratio. Their stated repeatability is believed within a factor of two.

The posterior of the repeatability is computed on a grid of values; each value weights the departures differently
(empirical hierarchical model, Gelman et al. 2013, ch. 5). The intervals are those of the mixture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from opid.signals.recording import FloatArray
from opid.suspensions.fitting.fit import Fit, fit_model
from opid.suspensions.settings import RepeatabilitySettings

_HALF_OF_95 = 1.96


@dataclass(frozen=True, eq=False)
class Levels:
    """Posterior at each value of the repeatability.

    Args:
        repeatability: (n_levels,) relative standard deviation of the departures.
        gains_differ: (n_levels,) factor on the stated repeatability of gains; 1 where none differ.
        weight: (n_levels,) posterior probability of each value.
        moved: (n_levels, n_unknowns) the best vector minus that of the fit.
        covariance: (n_levels, n_unknowns, n_unknowns) covariance about the best vector.
    """

    repeatability: FloatArray
    gains_differ: FloatArray
    weight: FloatArray
    moved: FloatArray
    covariance: FloatArray

    @property
    def median(self) -> float:
        """The median of the repeatability."""
        return self._find_median(self.repeatability)

    @property
    def median_of_gains(self) -> float:
        """The median of the factor on the stated repeatability of gains."""
        return self._find_median(self.gains_differ)

    @property
    def at_median(self) -> int:
        """Number of the level that is nearest to both medians."""
        off = np.log(self.repeatability / self.median), np.log(self.gains_differ / self.median_of_gains)
        return int(np.argmin(np.abs(off).sum(axis=0)))

    def _find_median(self, values: FloatArray) -> float:
        order = np.argsort(values, kind="stable")
        return float(np.exp(np.interp(0.5, np.cumsum(self.weight[order]), np.log(values[order]))))

    def widen(self, factors: FloatArray) -> Levels:
        """Return the levels with the standard deviation of each entry multiplied by a factor, (n_unknowns,)."""
        return replace(self, covariance=self.covariance * np.outer(factors, factors))

    def with_more(self, covariance: FloatArray) -> Levels:
        """Return the levels with the covariance of further errors added, (n_unknowns, n_unknowns)."""
        return replace(self, covariance=self.covariance + covariance)

    def second_moments(self) -> FloatArray:
        """Return the second moments of the vector about that of the fit, over all levels, (n_unknowns, n_unknowns)."""
        about = np.einsum("l,lij->ij", self.weight, self.covariance)
        return np.asarray(about + np.einsum("l,li,lj->ij", self.weight, self.moved, self.moved))

    def deviation(self, slopes: FloatArray) -> float:
        """Return the standard deviation of a normal distribution whose 95 % interval holds 95 % of the mixture.

        The mixture is that of a linear function of the vector with (n_unknowns,) slopes, about its value at the fit.
        Neither tail has more than 2.5 %.
        """
        mean = self.moved @ slopes
        std = np.sqrt(np.maximum(np.einsum("i,lij,j->l", slopes, self.covariance, slopes), 1e-300))
        reach = float(np.abs(mean).max() + 10 * std.max())

        def end(side: float) -> float:
            def excess(value: float) -> float:
                return float(self.weight @ special.ndtr((side * mean - value) / std)) - 0.025

            return float(optimize.brentq(excess, -reach, reach, xtol=1e-6 * reach))

        return max(end(1.0), end(-1.0)) / _HALF_OF_95


@dataclass(frozen=True)
class Repeatability:
    """Repeatability of the suspensions in the runs of a fit.

    Args:
        stated: relative standard deviation of springs, damping and friction from run to run, known beforehand.
        is_usual: whether it is the usual value because the study states none.
        estimated: median of the posterior; None if the runs were fitted as alike.
        exceeds: whether the runs show more than the stated value, according to the settings.
        mass_if_alike: standard deviation of the mass if all runs were alike, over its actual one; None without a mass.
        rules_mass: whether the repeatability causes most of the interval of the mass.
    """

    stated: float
    is_usual: bool
    estimated: float | None = None
    exceeds: bool = False
    mass_if_alike: float | None = None
    rules_mass: bool = False


def repeatability_of(fit: Fit, found: Levels | None, stated: float, *, is_usual: bool) -> Repeatability:
    """Return the repeatability of the suspensions in the runs of a fit.

    `found` is None if the runs were fitted as alike; `is_usual` says that the study states no repeatability.
    """
    if found is None:
        return Repeatability(stated, is_usual)
    known, fraction, rules = fit.model.settings.repeatability, None, False
    above = float(found.weight[found.repeatability > known.contradicted * stated].sum())
    if fit.model.mass_free:
        slopes = np.zeros(fit.theta.size)
        slopes[fit.model.names.index("inverse_mass")] = 1.0
        # The lowest value is far below what any data show.
        alike = float(np.sqrt(slopes @ found.covariance[0] @ slopes))
        fraction = min(1.0, alike / found.deviation(slopes))
        rules = fraction < known.rules_below
    return Repeatability(stated, is_usual, found.median, above > known.contradicted_weight, fraction, rules)


def levels(fit: Fit, stated: float) -> Levels:
    """Return the posterior at each value of the repeatability, to first order about a fit that has departures."""
    model, known = fit.model, fit.model.settings.repeatability
    n, errors = fit.n_data, fit.errors
    free = np.zeros(fit.theta.size, dtype=bool)
    for index in range(len(model.runs)):
        free[model.indices_of_run(index)[1]] = True
    weight = np.concatenate([np.full(n, np.sqrt(fit.weight)), np.ones(errors.stacked.size - n)])
    jacobian, left = errors.jacobian * weight[:, np.newaxis], errors.stacked * weight
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    gains, nominal = model.stds_of_run_gains, np.zeros(fit.theta.size)
    nominal[list(gains)] = 1.0
    # The Gram matrix without the prior of the departures and gains, in units of each column.
    before = np.where(free, 1 / (model.repeatability * size), 0.0) ** 2
    for index, std in gains.items():
        before[index] = 1 / (model.gains_differ * std * size[index]) ** 2
    gram = (jacobian / size).T @ (jacobian / size) - np.diag(before)
    departs = fit.theta - nominal
    along = -(jacobian / size).T @ left + before * departs * size
    return weigh_levels(gram, along[:, np.newaxis], departs, size, free, stated, known, gains)[0]


def weigh_levels(
    gram: FloatArray,
    along: FloatArray,
    theta: FloatArray,
    size: FloatArray,
    free: NDArray[np.bool_],
    stated: float,
    known: RepeatabilitySettings,
    gains: Mapping[int, float],
) -> list[Levels]:
    """Return the posterior at each value of the repeatability for normal equations without a prior of the departures.

    There is one posterior for each column of right-hand sides: the information is the same for all of them.

    Args:
        gram: (n_unknowns, n_unknowns) J^T J of the weighted errors and of all other priors, in units of `size`.
        along: (n_unknowns, n_cases) -J^T e, likewise.
        theta: (n_unknowns,) the vector about which the errors are linear, gains that differ from run to run minus 1.
        size: (n_unknowns,) positive scale of each entry of the vector.
        free: (n_unknowns,) which entries are departures.
        stated: the stated repeatability.
        known: settings of the repeatability.
        gains: stated standard deviations of the gains that differ from run to run, by their index; `gram` and `along`
            hold no prior of them either.
    """
    scaled, of_prior = (theta * size)[:, np.newaxis], free.copy()
    of_prior[list(gains)] = True
    powers = known.gain_powers if gains else (0.0,)
    log_level = np.tile(np.linspace(*known.reach, known.n_levels), len(powers))
    power = np.repeat(powers, known.n_levels)
    repeatability = stated * np.exp(log_level * np.log(known.doubt))
    gains_differ = np.exp(power * np.log(known.gain_doubt))
    log_weight, moved, covariance = [], [], []
    for level, factor, log, log_factor in zip(repeatability, gains_differ, log_level, power, strict=True):
        prior = np.where(free, 1 / (level * size), 0.0) ** 2
        for index, std in gains.items():
            prior[index] = 1 / (factor * std * size[index]) ** 2
        inside = gram + np.diag(prior)
        sizes, directions = np.linalg.eigh(inside)
        # A direction that nothing depends on, for example a stop that is never reached, does not change the weights.
        seen = sizes > 1e-13 * sizes[-1]
        inverse = (directions[:, seen] / sizes[seen]) @ directions[:, seen].T
        slope = along - prior[:, np.newaxis] * scaled
        step = inverse @ slope
        likely = 0.5 * np.sum(slope * step, axis=0) - 0.5 * float(prior @ scaled[:, 0] ** 2)
        likely += 0.5 * float(np.sum(np.log(prior[of_prior]))) - 0.5 * float(np.sum(np.log(sizes[seen])))
        log_weight.append(likely - 0.5 * log**2 - 0.5 * log_factor**2)
        moved.append(step / size[:, np.newaxis])
        covariance.append(inverse / np.outer(size, size))
    weights, steps, spread = special.softmax(log_weight, axis=0), np.array(moved), np.array(covariance)
    return [
        Levels(repeatability, gains_differ, weights[:, case], steps[:, :, case], spread)
        for case in range(along.shape[1])
    ]


def with_departures(fit: Fit, repeatability: float) -> Fit:
    """Fit once more with departures of springs, damping and friction in each run, of this standard deviation."""
    model = replace(fit.model, repeatability=repeatability)
    theta = np.zeros(model.n_shared + model.n_own * len(model.runs))
    theta[: model.n_shared] = fit.theta[: model.n_shared]
    for index in range(len(model.runs)):
        theta[model.indices_of_run(index)[0]] = fit.theta[fit.model.indices_of_run(index)[0]]
    return fit_model(model, theta)


def is_much_better(freed: Fit, fit: Fit) -> bool:
    """Return whether a fit with departures explains the runs much better than one without."""
    return freed.bic < fit.bic - fit.model.settings.repeatability.bic_margin


def with_own_repeatability(fit: Fit) -> Fit:
    """Fit once more at the repeatability estimated from the runs; a fit without departures is returned unchanged."""
    if not fit.model.repeatability:
        return fit
    found = levels(fit, fit.model.repeatability)
    differ = replace(fit.model, repeatability=found.median, gains_differ=found.median_of_gains)
    return fit_model(differ, fit.theta)
