"""Departures of one quantity over the flights: values that differ from earlier ones by more than their uncertainty."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from opid.estimate import Estimate
from opid.signals.recording import FloatArray
from opid.suspensions.flights.result_file import Flight, Quantity


@dataclass(frozen=True)
class FlightSettings:
    """When a value departs from the earlier ones, and when the flights scatter.

    Args:
        false_alarm: chance that a structure that did not change is flagged anywhere in a comparison, if the intervals
            hold.
        narrow: intervals are too narrow where the chance of the steps between neighbouring flights is below this ...
        narrow_as_others: ... or below this for one quantity, where the intervals of all together are too narrow.
        enough_steps: fewer steps between neighbouring flights do not distinguish a change from scatter.
        exempt: where the intervals of all together are too narrow, the scatter of all counts for a quantity, too,
            unless steps as large as its own have this chance with it.
        suspect: below this chance of the steps scatter is not yet certain, but a flag may be scatter; where it is that
            of the middle step of all quantities, they have scatter.
        clear_std: a change is given as a fraction where the value before is this many standard deviations from zero.
        following: one-sided chance at which the flight after a flagged one confirms it. It is a single test, so it
            shares the false alarms with no other.
        freedom_of_a_step: degrees of freedom that each of the overlapping differences adds to their median. Student's
            distribution with them has the far tail that such a median gives to normal deviates (simulated for 2 to 147
            differences).
        largest_scatter: scatter between flights is looked for up to this many times the value.
        best_of_usual: no standard deviation counts as less than this fraction of the middle one of its quantity, for it
            falls with the root of the length of the record: four times as long a flight has half of it.
        each_of_two_std: both flights of a pair depart by this many standard deviations: one alone is judged alone.
    """

    false_alarm: float = 1e-3
    narrow: float = 0.01
    narrow_as_others: float = 0.5
    enough_steps: int = 4
    exempt: float = 0.999
    suspect: float = 0.1
    clear_std: float = 5.0
    following: float = 0.01
    freedom_of_a_step: float = 0.4
    largest_scatter: float = 10.0
    best_of_usual: float = 0.5
    each_of_two_std: float = 1.96


DEFAULTS = FlightSettings()


class Status(StrEnum):
    """The verdict on one quantity of one flight: it is the first, as expected or flagged, or it is not judged.

    Stiffness and damping beside a law of another kind than that of the other flights are not judged.
    """

    FIRST = "first"
    AS_EXPECTED = "as expected"
    FLAGGED = "flagged"
    NO_VALUE = "no value"
    NO_INTERVAL = "no interval"
    OTHER_LAW = "other law"


@dataclass(frozen=True)
class Point:
    """One quantity of one flight.

    Args:
        flight: its index in `Comparison.flights`.
        estimate: the estimate of its result.
        status: the verdict on it.
        expected: weighted mean of the earlier flights that were not flagged; None if it is not judged.
        std: standard deviation of the departure, from this flight, the mean, and the scatter between flights.
        limits: lowest and highest value that does not flag this flight by itself.
        departure: (value - expected) / std.
        with_next: whether it was flagged by its mean with the next flight, although each was within its own limits.
        confirmed: whether the next flight departs to the same side; None without a flag or without a next flight.
    """

    flight: int
    estimate: Estimate
    status: Status
    expected: float | None = None
    std: float | None = None
    limits: tuple[float, float] | None = None
    departure: float | None = None
    with_next: bool = False
    confirmed: bool | None = None

    @property
    def flagged(self) -> bool:
        """Whether it departs by more than its uncertainty."""
        return self.status is Status.FLAGGED

    @property
    def has_interval(self) -> bool:
        """Whether it has a value with an interval, and so can be judged."""
        return self.status not in (Status.NO_VALUE, Status.NO_INTERVAL, Status.OTHER_LAW)


@dataclass(frozen=True)
class Series:
    """One quantity over all flights that have it.

    Args:
        quantity: the quantity.
        points: one for each flight.
        scatter: standard deviation between flights beyond the intervals, as a fraction of the value; 0 where the
            intervals explain the differences.
        threshold: departure above which a flight is flagged, in standard deviations.
        least_std: standard deviation below which that of a single flight does not count.
    """

    quantity: Quantity
    points: tuple[Point, ...]
    scatter: float
    threshold: float
    least_std: float = 0.0

    @property
    def judged(self) -> tuple[Point, ...]:
        """The flights that were compared with earlier ones."""
        return tuple(point for point in self.points if point.departure is not None)

    def own_std(self, point: Point) -> float:
        """Return the standard deviation of one flight as it counts, without the scatter."""
        return max(point.estimate.std or 0.0, self.least_std)

    def inflation(self, point: Point) -> float:
        """Return by which factor the scatter makes the standard deviation of one flight larger."""
        return math.hypot(1.0, self.scatter * (point.expected or 0.0) / self.own_std(point))


@dataclass(frozen=True, eq=False)
class MeasuredQuantity:
    """A quantity before it is judged.

    Args:
        quantity: the quantity.
        points: (n,) points of the flights that have an interval.
        value: (n,) their values.
        std: (n,) their standard deviations.
        others: points of the flights without a value or interval.
    """

    quantity: Quantity
    points: tuple[Point, ...]
    value: FloatArray
    std: FloatArray
    others: tuple[Point, ...]

    @property
    def flights(self) -> list[int]:
        """(n,) indices of the flights."""
        return [point.flight for point in self.points]


def find_usual_law(flights: Sequence[Flight], gear: str) -> tuple[str, ...]:
    """Return the kinds of the law that most flights have for a suspension; the first ones where as many differ."""
    return Counter(flight.laws[gear] for flight in flights if gear in flight.laws).most_common(1)[0][0]


def collect_values(flights: Sequence[Flight], quantity: Quantity) -> MeasuredQuantity:
    """Return the values of one quantity in all flights.

    Stiffness and damping are the linear part beside the law: those beside laws of different kinds differ though the
    suspension is the same.
    """
    is_linear_part = quantity.name in ("stiffness", "damping") and not quantity.kind
    usual = find_usual_law(flights, quantity.gear) if is_linear_part else None
    kept: list[Point] = []
    others: list[Point] = []
    for index, flight in enumerate(flights):
        estimate = flight.values.get(quantity, Estimate())
        status = Status.NO_VALUE if estimate.value is None else Status.NO_INTERVAL if not estimate.std else Status.FIRST
        if status is Status.FIRST and usual is not None and flight.laws[quantity.gear] != usual:
            status = Status.OTHER_LAW
        (kept if status is Status.FIRST else others).append(Point(index, estimate, status))
    value, std = np.array([[each.estimate.value, each.estimate.std] for each in kept], dtype=float).reshape(-1, 2).T
    return MeasuredQuantity(quantity, tuple(kept), value, std, tuple(others))


def judge_series(
    found: MeasuredQuantity, *, scatter: float, freedom: float, chance: float, settings: FlightSettings = DEFAULTS
) -> Series:
    """Compare each value with the weighted mean of the earlier ones that were not flagged.

    `chance` is the two-sided chance of flagging one value by itself; scatter and its degrees of freedom are those of
    `scatter_between`. The intervals are taken as known, so that scatter and interval together have more degrees of
    freedom (Welch 1947, Satterthwaite 1946).
    """
    x = found.value
    beyond = (scatter * np.median(x) if x.size else 0.0) ** 2
    usual = float(np.median(found.std)) if x.size else 0.0
    least = settings.best_of_usual * usual
    variance = np.maximum(found.std, least) ** 2 + beyond
    freedom = freedom * (1 + usual**2 / beyond) ** 2 if beyond else math.inf
    far, near = (find_threshold(each, freedom) for each in (chance, 2 * settings.following))
    points: list[Point] = []
    kept: list[int] = []
    for i, point in enumerate(found.points):
        if not kept:
            points.append(point)
            kept.append(i)
            continue
        point = _compare_with_kept(replace(point, status=Status.AS_EXPECTED), x, variance, kept, i, far)
        before = points[-1]
        follows = before.flagged and _is_on_same_side(before, point)
        if abs(point.departure or 0.0) > (near if follows else far):
            point = replace(point, status=Status.FLAGGED)
        elif (
            len(kept) > 1
            and kept[-1] == i - 1
            and _departs_together(x, variance, kept, i, far, settings.each_of_two_std)
        ):
            kept.pop()
            points[-1] = replace(
                _compare_with_kept(before, x, variance, kept, i - 1, far), status=Status.FLAGGED, with_next=True
            )
            point = replace(_compare_with_kept(point, x, variance, kept, i, far), status=Status.FLAGGED)
        else:
            kept.append(i)
        points.append(point)
    return Series(found.quantity, _confirm_flags(points, found.others), scatter, far, least)


def find_threshold(chance: float, freedom: float) -> float:
    """Return the departure that is exceeded by this two-sided chance, in standard deviations.

    Args:
        chance: that an unchanged value departs further, to either side.
        freedom: degrees of freedom of Student's distribution; infinite for the normal one.

    >>> round(find_threshold(0.05, math.inf), 2), round(find_threshold(0.05, 4.0), 2)
    (1.96, 2.78)
    """
    from scipy.special import ndtri, stdtrit

    return -float(ndtri(chance / 2) if math.isinf(freedom) else stdtrit(freedom, chance / 2))


def _compare_with_kept(
    point: Point, x: FloatArray, variance: FloatArray, kept: Sequence[int], i: int, far: float
) -> Point:
    """Return the point compared with the flights that are kept."""
    mean, mean_variance = _mean(x, variance, kept)
    std = math.sqrt(variance[i] + mean_variance)
    limits = (mean - far * std, mean + far * std)
    return replace(point, expected=mean, std=std, limits=limits, departure=float((x[i] - mean) / std))


def _is_on_same_side(one: Point, other: Point) -> bool:
    return (one.departure or 0.0) * (other.departure or 0.0) > 0


def _mean(x: FloatArray, variance: FloatArray, kept: Sequence[int]) -> tuple[float, float]:
    weight = 1 / variance[list(kept)]
    return float(weight @ x[list(kept)] / weight.sum()), float(1 / weight.sum())


def _departs_together(
    x: FloatArray, variance: FloatArray, kept: Sequence[int], i: int, far: float, each_of_two_std: float
) -> bool:
    """Whether the mean of this flight and the one before departs from those before both."""
    mean, mean_variance = _mean(x, variance, kept[:-1])
    two, two_variance = _mean(x, variance, [i - 1, i])
    if abs(two - mean) <= far * math.sqrt(two_variance + mean_variance):
        return False
    each = (x[[i - 1, i]] - mean) / np.sqrt(variance[[i - 1, i]] + mean_variance)
    return bool(np.all(each > each_of_two_std) or np.all(each < -each_of_two_std))


def _confirm_flags(points: Sequence[Point], others: Sequence[Point]) -> tuple[Point, ...]:
    """Return all flights in their order; each flag says whether the next flight confirms it."""
    done = {point.flight: point for point in others}
    for point, following in zip(points, [*points[1:], None], strict=True):
        confirmed = None
        if point.flagged and following is not None:
            confirmed = following.flagged and _is_on_same_side(point, following)
        done[point.flight] = replace(point, confirmed=confirmed)
    return tuple(done[i] for i in sorted(done))


# ---- scatter between flights -------------------------------------------------------------------------


def chance_of_steps(value: FloatArray, std: FloatArray) -> float:
    """Return the chance of steps as large as those between neighbouring flights if the intervals hold.

    Quantities of a flight have common errors (that of its mass), so a step from flight to flight counts once, by the
    mean square of its quantities: its chance is the greater of those for equal and for independent quantities.
    Neighbouring steps have a flight in common, so every other step is used, and the larger result of the two choices
    counts. The result is the binomial chance that so many of n steps exceed the middle one: a single large step is a
    change and no scatter.

    Values and standard deviations are (n_quantities, n_flights), NaN where there is none.

    >>> x = np.array([[100.0, 103, 98, 101, 96, 104, 99, 103]])
    >>> chance_of_steps(x, np.full(x.shape, 0.1)) < 1e-6, chance_of_steps(x, np.full(x.shape, 10.0)) > 0.5
    (True, True)
    """
    from scipy.special import bdtrc, chdtrc

    step, stated, _ = _compute_differences(value, std)
    n = np.sum(~np.isnan(step), axis=0)
    squares = np.nansum(step**2 / stated, axis=0)[n > 0]
    n = n[n > 0]
    chance = np.maximum(chdtrc(1, squares / n), chdtrc(n, squares))
    of_middle = [0.0 if chance.size else 1.0]
    for every_other in (np.sort(chance[first::2])[::-1] for first in (0, 1)):
        if every_other.size:
            rank = (every_other.size - 1) // 2
            of_middle.append(float(bdtrc(every_other.size - rank - 1, every_other.size, every_other[rank])))
    return max(of_middle)


def scatter_between(value: FloatArray, std: FloatArray, *, settings: FlightSettings = DEFAULTS) -> tuple[float, float]:
    """Return the scatter between flights beyond their intervals as a fraction of the value, and its degrees of freedom.

    With this scatter the median difference of neighbouring flights is that of normal deviates; it is 0 if the intervals
    explain the differences. Values of one quantity of each gear are (n_gears, n_flights), NaN where there is none.

    >>> x = np.array([[100.0, 103, 98, 101, 96, 104]])
    >>> fraction, freedom = scatter_between(x, np.full(x.shape, 0.1))
    >>> f"{fraction:.3f}, {freedom:.0f}"
    '0.052, 2'
    >>> scatter_between(x, np.full(x.shape, 10.0))[0]
    0.0
    """
    from scipy.optimize import brentq
    from scipy.special import ndtri

    step, stated, size = _compute_differences(value, std)
    known = ~np.isnan(step)
    step, stated, size = step[known], stated[known], size[known]
    n = step.size
    if not n:
        return 0.0, 1.0
    rank = (n - 1) // 2
    # This is the expected median of n absolute normal deviates (Filliben 1975).
    usual = float(ndtri((1 + (rank + 1 - 0.3175) / (n + 0.365)) / 2))

    def above(fraction: float) -> float:
        return float(np.sort(np.abs(step) / np.sqrt(stated + size * fraction**2))[rank]) - usual

    explained = above(0.0) <= 0 or above(settings.largest_scatter) >= 0
    scatter = 0.0 if explained else float(brentq(above, 0.0, settings.largest_scatter))
    return scatter, max(1.0, settings.freedom_of_a_step * n)


def _compute_differences(value: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return differences of neighbouring flights, their variance, and that of a scatter as large as the values."""
    step, stated = np.diff(value), std[:, 1:] ** 2 + std[:, :-1] ** 2
    middle = np.array([np.nanmedian(row) if np.any(np.isfinite(row)) else 0.0 for row in value]).reshape(-1, 1)
    return step, stated, np.broadcast_to(2 * middle**2, step.shape)
