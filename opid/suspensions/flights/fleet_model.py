"""A hierarchical model of one quantity over a fleet: each strut is a draw about the trend that all have in common.

The logarithm of a value of strut s at a flight with covariates x, t years after the first, is

    y = a + b t + c x + u_s + w_s t + e,   u_s ~ N(0, level^2), w_s ~ N(0, trend^2), e ~ N(0, std^2 + scatter^2),

with the standard deviation that the flight states. Level, trend and scatter are found by restricted maximum likelihood
(Patterson & Thompson 1971). The flights of a strut are then judged one after the other: the prior of a strut is what
the other struts say, so that the population informs a strut of which little is known (`judge_flights`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.special import digamma, polygamma
from scipy.stats import norm, t as student

from opid.signals.recording import FloatArray
from opid.suspensions.flights.departures import find_threshold

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class FleetSettings:
    """When a strut has changed, and what is fitted to the fleet.

    Args:
        alarms_per_year: expected number of false alarms in a year of the whole fleet, all quantities together.
        windows: numbers of consecutive flights that are judged by their mean: one shows a large change at once, three a
            small one.
        step_std: standard deviation of a change, as a logarithm, once it is flagged: the new level is as good as
            unknown.
        most_uncertain: nor where its departure has more than so many times the standard deviation of the mean itself:
            what is expected of it is then hardly known, and an error in it would be taken for a change.
        candidates: days at which a step of all struts is looked for, and again around the best of them.
        few: fewer struts do not show how much struts differ in scatter or trend.
        most_std: a mean is not judged where its departure has a larger standard deviation, as a logarithm.
        values_per_coefficient: a covariate gets a square, too, where there are at least so many values for each
            coefficient.
        rounds: flagged flights are left out of the fit, which is repeated until the flags stay, at most so often.
        clear_std: a value whose logarithm is taken is this many standard deviations from zero.
    """

    alarms_per_year: float = 0.1
    windows: tuple[int, ...] = (1, 2, 3)
    step_std: float = 1.0
    most_std: float = 0.3
    most_uncertain: float = 4.0
    few: int = 5
    candidates: int = 40
    values_per_coefficient: int = 20
    rounds: int = 8
    clear_std: float = 5.0


DEFAULTS = FleetSettings()

_VAGUE = 1e4
"""Variance of a coefficient of which nothing is known, in units in which covariates and logarithms are about one."""


@dataclass(frozen=True, eq=False)
class FleetValues:
    """The flights of S struts, each padded to N flights in the order of their dates.

    Args:
        y: logarithms of the values, (S, N); anything where there is no flight.
        std: their standard deviations, (S, N).
        is_there: whether there is a flight, (S, N).
        fixed: what all struts answer to alike, (S, N, p): 1, years, covariates.
        years: time of each flight, years after the first of all, (S, N).
    """

    y: FloatArray
    std: FloatArray
    is_there: BoolArray
    fixed: FloatArray
    years: FloatArray

    @property
    def own(self) -> FloatArray:
        """What each strut answers to in its own way, (S, N, 2): 1 and years."""
        return np.stack([np.ones_like(self.years), self.years], axis=-1)


@dataclass(frozen=True, eq=False)
class Population:
    """What the fleet has in common.

    Args:
        scatter: standard deviation from flight to flight beyond the intervals, as a logarithm.
        level: standard deviation of the struts about the common level.
        trend: standard deviation of their trends about the common one, 1/year.
        coefficients: of `FleetValues.fixed`, (p,).
        covariance: of these, (p, p).
        freedom: degrees of freedom of the scatter.
    """

    scatter: float
    level: float
    trend: float
    coefficients: FloatArray
    covariance: FloatArray
    freedom: float


@dataclass(frozen=True, eq=False)
class _Sums:
    """The sums over the flights of each strut from which the likelihood and its coefficients follow."""

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray
    log_det: FloatArray


def fit_population(values: FleetValues, is_used: BoolArray) -> Population:
    """Find level, trend and scatter of a fleet by restricted maximum likelihood, and its common coefficients.

    Args:
        values: of the fleet.
        is_used: the flights that are fitted, (S, N).
    """
    used = is_used & values.is_there
    # The logarithm of a stiffness in N/m is about 13; its square over that of 0.005 would drown the misfit in rounding.
    offset, *_ = np.linalg.lstsq(values.fixed[used], values.y[used], rcond=None)
    values = replace(values, y=values.y - values.fixed @ offset)
    typical = float(np.median(values.std[used]))
    n, p, n_struts = int(used.sum()), values.fixed.shape[-1], int(used.any(axis=1).sum())
    floor = 2 * math.log(1e-3 * typical)
    has_trend = n > 2 * n_struts + p and float(np.ptp(values.years[used])) > 0

    def variances(theta: FloatArray) -> tuple[float, float, float]:
        scatter, level = np.exp(theta[:2])
        return float(scatter), float(level), float(np.exp(theta[2])) if has_trend else 0.0

    def misfit(theta: FloatArray) -> float:
        sums = _sum_over_flights(values, used, *variances(theta))
        xx, xy = sums.xx.sum(axis=0), sums.xy.sum(axis=0)
        _, log_det = np.linalg.slogdet(xx + np.eye(p) / _VAGUE)
        solved = np.linalg.solve(xx + np.eye(p) / _VAGUE, xy)
        return float(sums.log_det.sum() + log_det + sums.yy.sum() - xy @ solved)

    start = 2 * np.log([typical, max(typical, 1e-2), max(typical, 1e-2)])[: 3 if has_trend else 2]
    bounds = [(floor, 2 * math.log(10.0))] * start.size
    # A simplex needs no gradient, and what rounding leaves of one ends a descent far from the minimum.
    accuracy = {"xatol": 1e-3, "fatol": 1e-4, "maxiter": 2000}
    found = min(
        (minimize(misfit, start + s, method="Nelder-Mead", bounds=bounds, options=accuracy) for s in (0.0, -4.0)),
        key=_find_cost,
    )
    scatter, level, trend = variances(found.x)
    sums = _sum_over_flights(values, used, scatter, level, trend)
    covariance = np.linalg.inv(sums.xx.sum(axis=0) + np.eye(p) / _VAGUE)
    coefficients = offset + covariance @ sums.xy.sum(axis=0)
    freedom = max(1.0, n - p - n_struts)
    return Population(
        math.sqrt(scatter),
        math.sqrt(level),
        math.sqrt(trend),
        coefficients,
        covariance,
        freedom if scatter > 2 * math.exp(floor) else math.inf,
    )


def _find_cost(found: Any) -> float:
    return float(found.fun)


def _sum_over_flights(values: FleetValues, used: BoolArray, scatter: float, level: float, trend: float) -> _Sums:
    """Sum with the inverse covariance of each strut, by the identity of Woodbury for its two own coefficients."""
    variance = values.std**2 + scatter
    weight = np.where(used, 1 / variance, 0.0)
    own, fixed, y = values.own, values.fixed, np.where(used, values.y, 0.0)
    prior = np.diag([level, trend])
    weighted = own * weight[..., None]
    inner = np.einsum("sni,snj->sij", weighted, own)
    shrink = prior @ np.linalg.inv(np.eye(2) + inner @ prior)
    own_x = np.einsum("sni,snp->sip", weighted, fixed)
    own_y = np.einsum("sni,sn->si", weighted, y)
    _, log_det = np.linalg.slogdet(np.eye(2) + inner @ prior)
    return _Sums(
        np.einsum("snp,sn,snq->spq", fixed, weight, fixed) - np.einsum("sip,sij,sjq->spq", own_x, shrink, own_x),
        np.einsum("snp,sn->sp", fixed, weight * y) - np.einsum("sip,sij,sj->sp", own_x, shrink, own_y),
        np.einsum("sn,sn->s", y, weight * y) - np.einsum("si,sij,sj->s", own_y, shrink, own_y),
        log_det + np.where(used, np.log(variance), 0.0).sum(axis=1),
    )


@dataclass(frozen=True)
class CommonStep:
    """A step of all struts at once.

    Args:
        years: when it happens, years after the first flight of all.
        size: as a logarithm.
        std: its standard deviation.
    """

    years: float
    size: float
    std: float


def find_common_step(
    values: FleetValues, population: Population, is_used: BoolArray, settings: FleetSettings, chance: float
) -> CommonStep | None:
    """Find the day on which all struts change at once by more than chance explains; None where there is none.

    Each candidate is a further coefficient that all struts have in common, beside those of trend and covariates.

    Args:
        values: of the fleet.
        population: from `fit_population`.
        is_used: the flights that are fitted, (S, N).
        settings: the tuned numbers.
        chance: two-sided chance of each comparison to be flagged if nothing changed.
    """
    used = is_used & values.is_there
    days = np.unique(values.years[used])[1:]
    if values.y.shape[0] < settings.few or days.size < 2:
        return None
    limit = find_threshold(chance, population.freedom)
    variances = population.scatter**2, population.level**2, population.trend**2
    centred = replace(values, y=values.y - values.fixed @ population.coefficients)
    found: dict[int, CommonStep] = {}

    def try_days(first: int, last: int) -> int:
        for k in map(int, np.unique(np.linspace(first, last, settings.candidates).round())):
            step = (values.years >= days[k]).astype(float)
            both = (used & (step > 0)).any(axis=1) & (used & (step == 0)).any(axis=1)
            if k in found or both.sum() < settings.few:
                continue
            more = replace(centred, fixed=np.concatenate([values.fixed, step[..., None]], axis=-1))
            sums = _sum_over_flights(more, used, *variances)
            covariance = np.linalg.inv(sums.xx.sum(axis=0) + np.eye(more.fixed.shape[-1]) / _VAGUE)
            size = float((covariance @ sums.xy.sum(axis=0))[-1])
            found[k] = CommonStep(float(days[k]), size, math.sqrt(covariance[-1, -1]))
        return max(found, key=lambda k: abs(found[k].size) / found[k].std, default=-1)

    best = try_days(0, days.size - 1)
    if best < 0:
        return None
    width = days.size // settings.candidates + 1
    best = try_days(max(0, best - width), min(days.size - 1, best + width))
    step = found[best]
    # What is smaller than the scatter of one flight is no change of a strut either, and what is left of a season is so.
    of_flight = math.hypot(population.scatter, float(np.median(values.std[used])))
    return step if abs(step.size) > max(limit * step.std, of_flight) else None


def add_step(values: FleetValues, step: CommonStep) -> FleetValues:
    """Return the flights with a step that all struts have in common as a further coefficient."""
    column = (values.years >= step.years).astype(float)
    return replace(values, fixed=np.concatenate([values.fixed, column[..., None]], axis=-1))


# ---- one flight after the other ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Judged:
    """The flights of a fleet, judged one after the other.

    Args:
        expected: what the flights before say of each, with the covariates of the flight, (S, N).
        expected_std: standard deviation of the departure of each, from the flight and from what is expected, (S, N).
        departure: (y - expected) / expected_std, NaN where a flight is not judged, (S, N).
        changed_at: whether a change begins with this flight, (S, N).
        strongest: the departure that flagged it, of the mean of a window, (S, N).
        window: number of flights in that window, (S, N).
        size: the change as a logarithm, of all flights until the next change, (S, N); NaN where none begins.
        size_std: its standard deviation, (S, N).
        n_tests: number of means that were judged.
        trend: trend of each strut now, 1/year, (S,).
        trend_std: its standard deviation, (S,).
    """

    expected: FloatArray
    expected_std: FloatArray
    departure: FloatArray
    changed_at: BoolArray
    strongest: FloatArray
    window: FloatArray
    size: FloatArray
    size_std: FloatArray
    n_tests: int
    trend: FloatArray
    trend_std: FloatArray


@dataclass
class _State:
    """What is known of the coefficients of each strut, common and own: mean (S, q) and covariance (S, q, q)."""

    mean: FloatArray
    covariance: FloatArray

    def copy(self) -> _State:
        """Return a copy that does not change with this one."""
        return _State(self.mean.copy(), self.covariance.copy())

    def take(self, other: _State, rows: BoolArray) -> None:
        """Take the state of some struts from another."""
        self.mean[rows], self.covariance[rows] = other.mean[rows], other.covariance[rows]

    def update(self, h: FloatArray, y: FloatArray, variance: FloatArray, rows: BoolArray) -> None:
        """Take a flight of some struts into account (Kalman 1960), in the form of Joseph, which stays positive."""
        ph = np.einsum("sij,sj->si", self.covariance, h)
        gain = ph / (np.einsum("si,si->s", h, ph) + variance)[:, None]
        step = gain * (y - np.einsum("si,si->s", h, self.mean))[:, None]
        kept = np.eye(h.shape[1]) - gain[:, :, None] * h[:, None, :]
        after = kept @ self.covariance @ kept.transpose(0, 2, 1)
        after += variance[:, None, None] * gain[:, :, None] * gain[:, None, :]
        self.mean[rows] += step[rows]
        self.covariance[rows] = after[rows]


def judge_flights(
    values: FleetValues,
    population: Population,
    is_used: BoolArray,
    settings: FleetSettings,
    chance: float,
    tempers: Tempers | None = None,
) -> Judged:
    """Compare each flight of each strut with its flights before and with the other struts.

    The prior of a strut has the coefficients that all other struts give, so that no flight is compared with itself.
    The mean of the last 1, 2, ... flights is compared with what the flights before them say. Where it departs, a change
    begins with the first of them: the level of the strut is unknown from there, and what follows is compared with the
    new level.

    Args:
        values: of the fleet.
        population: from `fit_population`.
        is_used: the flights from which the common coefficients are taken, (S, N).
        settings: the tuned numbers.
        chance: two-sided chance of each comparison to be flagged if nothing changed.
        tempers: how much each strut scatters; all alike if None.
    """
    limit = np.full(values.y.shape[0], find_threshold(chance, population.freedom))
    n_struts, n_flights, p = values.fixed.shape
    h = np.concatenate([values.fixed, values.own], axis=-1)
    variance = values.std**2 + population.scatter**2
    if tempers is not None:
        limit = np.maximum(limit, student.isf(chance / 2, np.minimum(tempers.freedom, 1e6)))
        variance = variance * tempers.factor[:, None]
    state = _State(*_find_priors(values, population, is_used))
    shape = (n_struts, n_flights)
    expected, spread, departure, strongest, window, size, size_std = (np.full(shape, np.nan) for _ in range(7))
    changed, first, n_tests = np.zeros(shape, bool), np.zeros(n_struts, int), 0
    before: list[_State] = []
    old: dict[tuple[int, int], _State] = {}
    step = np.zeros(state.mean.shape[1])
    step[p] = settings.step_std**2
    for n in range(n_flights):
        here = values.is_there[:, n]
        before.append(state.copy())
        rest, std = _compare(before[n], h[:, n : n + 1], values.y[:, n : n + 1], variance[:, n : n + 1])
        expected[:, n], spread[:, n] = np.where(here, values.y[:, n] - rest, np.nan), np.where(here, std, np.nan)
        is_judged = here & (std < settings.most_std)
        departure[:, n] = np.where(is_judged, rest / std, np.nan)
        state.update(h[:, n], values.y[:, n], variance[:, n], here)
        flagged = np.zeros(n_struts, bool)
        for w in settings.windows:
            start = n - w + 1
            # the first flight of a level, and of a strut, has nothing of its own with which it could be compared
            can = here & ~flagged & (start > first)
            if not can.any():
                continue
            part = slice(start, n + 1)
            mean, std = _compare(before[start], h[:, part], values.y[:, part], variance[:, part])
            own = np.sqrt(1 / (1 / variance[:, part]).sum(axis=1))
            can &= (std < settings.most_std) & (std < settings.most_uncertain * own)
            n_tests += int(can.sum())
            now = can & (np.abs(mean) > limit * std)
            for s in map(int, np.flatnonzero(now)):
                changed[s, start], strongest[s, start], window[s, start] = True, mean[s] / std[s], w
                old[s, start] = _State(before[start].mean[[s]], before[start].covariance[[s]])
            if now.any():
                flagged |= now
                first[now] = start
                again = before[start].copy()
                again.covariance += np.diag(step)
                before[start].take(again, now)
                for k in range(start, n + 1):
                    if k > start:
                        before[k].take(again, now)
                    again.update(h[:, k], values.y[:, k], variance[:, k], now)
                state.take(again, now)
    for (s, start), state_before in old.items():
        following = np.flatnonzero(changed[s, start + 1 :])
        part = slice(start, start + 1 + int(following[0]) if following.size else int(values.is_there[s].sum()))
        mean, std = _compare(state_before, h[[s], part], values.y[[s], part], variance[[s], part])
        size[s, start], size_std[s, start] = mean[0], std[0]
    slope = np.zeros(state.mean.shape[1])
    slope[1], slope[p + 1] = 1.0, 1.0
    trend_std = np.sqrt(np.maximum(np.einsum("i,sij,j->s", slope, state.covariance, slope), 0.0))
    return Judged(
        expected, spread, departure, changed, strongest, window, size, size_std, n_tests, state.mean @ slope, trend_std
    )


@dataclass(frozen=True, eq=False)
class Tempers:
    """How much each strut scatters beside the others, and how often a flight is far off.

    Args:
        factor: of the variance of each strut, (S,).
        freedom: of Student's distribution of its departures, (S,).
    """

    factor: FloatArray
    freedom: FloatArray


def find_tempers(judged: Judged, before: Tempers | None, settings: FleetSettings) -> Tempers:
    """Find the scatter of each strut, moderated by that of all (Smyth 2004), and the tails that all have in common.

    The variances of the struts are draws of one distribution, found by its moments, and each is drawn towards their
    mean as far as its flights are few. The tails are those of Student's distribution, fitted to all departures.

    Args:
        judged: the flights as they were judged.
        before: with which they were judged.
        settings: the tuned numbers.
    """
    n_struts = judged.departure.shape[0]
    factor, freedom = np.ones(n_struts), np.full(n_struts, np.inf)
    scale = np.ones(n_struts) if before is None else before.factor
    z = np.where(judged.changed_at, np.nan, judged.departure) * np.sqrt(scale)[:, None]
    n = np.isfinite(z).sum(axis=1).astype(float)
    square = np.nansum(z**2, axis=1) / np.maximum(n, 1.0)
    known = (n >= 2) & (square > 0)
    if known.sum() >= settings.few:
        centred = np.log(square[known]) - digamma(n[known] / 2) + np.log(n[known] / 2)
        by_chance = float(polygamma(1, n[known] / 2).mean())
        excess = float(centred.var(ddof=1)) - by_chance
        # chance alone spreads the variances of struts, and the spread has an error of its own
        if excess > 2 * by_chance * math.sqrt(2 / known.sum()):
            own = brentq(lambda each: float(polygamma(1, each / 2)) - excess, 1e-3, 1e6)
            typical = math.exp(float(centred.mean()) + float(digamma(own / 2)) - math.log(own / 2))
            factor = np.maximum(1.0, (own * typical + n * square) / (own + n))
            freedom = own + n
    left = z / np.sqrt(factor)[:, None]
    left = left[np.isfinite(left)]
    if left.size >= settings.values_per_coefficient:
        width = float(left.std())
        start, bounds = [math.log(8.0), math.log(width)], [(math.log(2.1), math.log(200.0)), (-3.0, 3.0)]
        found = minimize(_compute_misfit_of_tails, start, (left,), method="L-BFGS-B", bounds=bounds)
        normal = left.size * math.log(width) - float(norm.logpdf(left / width).sum())
        if normal - found.fun > 2.0:
            freedom = np.minimum(freedom, math.exp(found.x[0]))
            factor = factor * math.exp(2 * found.x[1])
    return Tempers(factor, freedom)


def _compute_misfit_of_tails(theta: FloatArray, values: FloatArray) -> float:
    return float(values.size * theta[1] - student.logpdf(values / np.exp(theta[1]), np.exp(theta[0])).sum())


def _compare(state: _State, h: FloatArray, y: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much the weighted mean of some flights departs from a state, and its standard deviation."""
    weight = 1 / variance
    weight = weight / weight.sum(axis=1, keepdims=True)
    together = np.einsum("sn,sni->si", weight, h)
    mean = np.einsum("sn,sn->s", weight, y) - np.einsum("si,si->s", together, state.mean)
    square = np.einsum("si,sij,sj->s", together, state.covariance, together) + (weight**2 * variance).sum(axis=1)
    return mean, np.sqrt(square)


def _find_priors(values: FleetValues, population: Population, is_used: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of common and own coefficients of each strut, as all other struts give them."""
    p = values.fixed.shape[-1]
    sums = _sum_over_flights(
        values, values.is_there & is_used, population.scatter**2, population.level**2, population.trend**2
    )
    others_xx = sums.xx.sum(axis=0) - sums.xx + np.eye(p) / _VAGUE
    common = np.linalg.inv(others_xx)
    n_struts = values.y.shape[0]
    mean = np.zeros((n_struts, p + 2))
    mean[:, :p] = np.einsum("spq,sq->sp", common, sums.xy.sum(axis=0) - sums.xy)
    covariance = np.zeros((n_struts, p + 2, p + 2))
    covariance[:, :p, :p] = common
    covariance[:, p, p], covariance[:, p + 1, p + 1] = population.level**2, population.trend**2
    return mean, covariance
