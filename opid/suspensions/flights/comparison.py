"""Health over time: changes from flight to flight that exceed their uncertainty."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError, list_names
from opid.estimate import Estimate, format_change
from opid.json_values import plain
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray
from opid.suspensions.flights.departures import (
    DEFAULTS,
    FlightSettings,
    MeasuredQuantity,
    Point,
    Series,
    Status,
    chance_of_steps,
    collect_values,
    find_usual_law,
    judge_series,
    scatter_between,
)
from opid.suspensions.flights.result_file import Flight, Quantity
from opid.suspensions.flights.results import Flights

SCHEMA = "opid.comparison/1"

_MIDDLE_DEVIATE = 0.6745
"""Median of the absolute value of a normal deviate of standard deviation 1."""


@dataclass(frozen=True)
class Change:
    """Consecutive flagged flights that depart to the same side.

    Args:
        quantity: the quantity that changed.
        first: index of the first of them in `Comparison.flights`.
        last: index of the last.
        fraction: relative change of their mean against the flights before, with its interval; without a value if these
            are not clearly different from zero, and without an interval if the next flight does not confirm it.
        departure: departure of the flight that departs most, in standard deviations.
        confirmed: whether the flight after the first departs as well; None if there is none yet.
        statement: the change in a sentence.
    """

    quantity: Quantity
    first: int
    last: int
    fraction: Estimate
    departure: float
    confirmed: bool | None
    statement: str


@dataclass(frozen=True, repr=False)
class Comparison(Result):
    """Flights of one structure against each other.

    Args:
        flights: the flights, the earliest first.
        dated: whether they are in the order of their dates.
        series: one for each quantity of each gear.
        changes: the flagged changes, the earliest first.
        false_alarm: chance of any flag if nothing changed and the intervals hold.
        n_tests: number of tests among which it is divided.
        warnings: the warnings, one sentence each.
        settings: the tuned numbers.
    """

    flights: tuple[Flight, ...]
    dated: bool
    series: tuple[Series, ...]
    changes: tuple[Change, ...]
    false_alarm: float
    n_tests: int
    warnings: tuple[str, ...]
    settings: FlightSettings

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return each quantity of the last flight in which it was judged, or of the last flight if it never was."""
        rows = []
        for each in self.series:
            last = (each.judged or each.points)[-1]
            rows.append(SummaryRow.of(each.quantity.key, last.estimate, each.quantity.unit))
        return tuple(rows)

    @property
    def has_flags(self) -> bool:
        """Whether a change is flagged."""
        return bool(self.changes)

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The results that are compared, as they were when they were read."""
        return tuple(each.file for each in self.flights if each.file is not None)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of comparison.json, as `docs/schemas/comparison-1.schema.json` describes it."""
        return plain(
            {
                "schema": SCHEMA,
                "flagged": bool(self.changes),
                "false_alarm": self.false_alarm,
                "n_tests": self.n_tests,
                "structure": self.flights[0].structure,
                "dated": self.dated,
                "flights": [
                    {
                        "name": flight.name,
                        "path": str(flight.path),
                        "date": None if flight.date is None else flight.date.isoformat(),
                        "method": flight.method,
                    }
                    for flight in self.flights
                ],
                "series": [
                    series.quantity.to_dict()
                    | {"unit": series.quantity.unit, "scatter": series.scatter, "threshold": series.threshold}
                    | {"points": [_build_point(point) for point in series.points]}
                    for series in self.series
                ],
                "changes": [
                    change.quantity.to_dict()
                    | {"first": change.first, "last": change.last, "share": asdict(change.fraction)}
                    | {"departure": change.departure, "confirmed": change.confirmed, "statement": change.statement}
                    for change in self.changes
                ],
                "warnings": self.warnings,
                "settings": asdict(self.settings),
            }
        )

    def _write_headline(self) -> str:
        n = len(self.changes)
        flagged = f"{n} change{'s' * (n != 1)} flagged" if n else "no change exceeds its uncertainty"
        return f"{len(self.flights)} flights, {flagged}"


def _build_point(point: Point) -> dict[str, Any]:
    own = asdict(point)
    head, expected_std = {"flight": own.pop("flight")} | own.pop("estimate"), own.pop("std")
    return head | own | {"expected_std": expected_std}


def compare(flights: Flights, *, false_alarm: float | None = None, settings: FlightSettings = DEFAULTS) -> Comparison:
    r"""Compare each flight with the earlier ones, quantity by quantity, and flag what changed.

    A flight is compared with the weighted mean of the earlier flights that were not flagged, and so is its mean with
    the flight before it; the departures z = (value - mean) / std are independent and normal (recursive residuals, Brown
    et al. 1975) if the intervals hold and nothing changed. With N of them,

        P(any |z| > t) <= 1 - (1 - a)^N,  a = P(|z| > t)

    whatever the correlation between quantities (Sidak 1967), so a = 1 - (1 - false_alarm)^(1/N). If the steps between
    neighbouring flights, of five or more, are larger than their intervals explain (`chance_of_steps`), the median of
    all gears gives the scatter between flights (wheel tracks, temperature). It is added to the standard deviations, and
    t is that of Student's distribution with the degrees of freedom of the scatter. The flight after a flagged one is
    judged by itself (`FlightSettings.following`): it confirms the flag or not.

    Args:
        flights: the flights, from `read_flights`.
        false_alarm: chance of any flag in the whole comparison if nothing changed; None for that of the settings.
        settings: the tuned numbers.

    Raises:
        InputError: a chance that is not between 0 and 0.5.
        NotDeterminedError: no quantity has an interval in two flights.
    """
    if false_alarm is not None:
        settings = replace(settings, false_alarm=false_alarm)
    if not 0 < settings.false_alarm <= 0.5:
        raise InputError(
            f"the chance of a false alarm is {settings.false_alarm:g}: give one between 0 and 0.5, like 0.001"
        )
    found = [collect_values(flights.flights, quantity) for quantity in _list_quantities(flights)]
    n_tests = sum(max(0, 2 * each.value.size - 3) for each in found)
    if not n_tests:
        raise NotDeterminedError(
            "no quantity has a value with an interval in two flights, so no change can be compared with its "
            "uncertainty: "
            f"{'; '.join(_explain_no_intervals(flights))}"
        )
    chance = -math.expm1(math.log1p(-settings.false_alarm) / n_tests)
    table = _tabulate_values(found, len(flights.flights))
    scatter = _estimate_scatter([each.quantity.label for each in found], *table, settings)
    series = []
    for each in found:
        fraction, freedom = scatter[each.quantity.label]
        series.append(judge_series(each, scatter=fraction, freedom=freedom, chance=chance, settings=settings))
    changes = sorted(
        (change for each in series for change in _join_changes(each, series, flights, settings)),
        key=lambda each: each.first,
    )
    left_out = (each.sentence for each in flights.left_out)
    warnings = _list_warnings(flights.flights, series, changes, chance_of_steps(*table), settings)
    return Comparison(
        flights.flights,
        flights.dated,
        tuple(series),
        tuple(changes),
        settings.false_alarm,
        n_tests,
        (*left_out, *flights.notes, *warnings),
        settings,
    )


def _explain_no_intervals(flights: Flights) -> Iterator[str]:
    """Yield why intervals are missing, and which flights were left out."""
    others = sorted({flight.method for flight in flights.flights} - {"model"})
    if others:
        yield f"the results come from the method {' and '.join(others)}, and the default method gives intervals"
    else:
        yield "the warnings of the results give the reason"
    yield from (each.sentence for each in flights.left_out)


def _estimate_scatter(
    labels: Sequence[str], value: FloatArray, std: FloatArray, settings: FlightSettings
) -> dict[str, tuple[float, float]]:
    """Return scatter and degrees of freedom for each kind of quantity, of all gears together."""
    # Few flights show little about one quantity, but more about all quantities together.
    are_all = _is_narrow(value, std, settings.narrow, settings) or _do_most_differ(labels, value, std, settings)
    below = settings.narrow_as_others if are_all else settings.narrow
    common, freedom_of_all = _find_common_factor(value, std, settings) if are_all else (0.0, math.inf)
    scatter = {}
    for label in dict.fromkeys(labels):
        mine = np.array([each == label for each in labels])
        fraction, freedom = scatter_between(value[mine], std[mine], settings=settings)
        if not _is_narrow(value[mine], std[mine], below, settings):
            fraction = 0.0
        if common and not _are_better(value[mine], std[mine], common, settings):
            # A few steps may be small by chance, and all steps together say how far the common scatter can be trusted.
            fraction = max(fraction, common * float(np.nanmedian(std[mine] / np.abs(value[mine]))))
            freedom = max(freedom, freedom_of_all)
        scatter[label] = (fraction, freedom) if fraction else (0.0, math.inf)
    return scatter


def _are_better(value: FloatArray, std: FloatArray, common: float, settings: FlightSettings) -> bool:
    """Whether the steps of one quantity tell that its flights scatter less than those of all quantities together."""
    steps = ~np.isnan(np.diff(value)).all(axis=0)
    is_known = steps.sum() >= settings.enough_steps
    return bool(is_known and chance_of_steps(value, std * math.hypot(1.0, common)) > settings.exempt)


def _find_common_factor(value: FloatArray, std: FloatArray, settings: FlightSettings) -> tuple[float, float]:
    """Return the scatter of all quantities together, in units of their standard deviations, and its freedom."""
    known = np.isfinite(std).sum(axis=1) > 1
    unit = np.nanmedian(std[known], axis=1, keepdims=True)
    scaled = (value[known] - np.nanmedian(value[known], axis=1, keepdims=True)) / unit
    # Here the values are their distances in standard deviations, about 1.
    most = settings.largest_scatter * float(np.nanmax(np.abs(value[known]) / std[known]))
    return scatter_between(scaled + 1.0, std[known] / unit, settings=replace(settings, largest_scatter=most))


def _do_most_differ(labels: Sequence[str], value: FloatArray, std: FloatArray, settings: FlightSettings) -> bool:
    """Whether most quantities of several gears differ between neighbouring flights, however few these are.

    A gear that is harmed does not do that.
    """
    from scipy.special import ndtri

    if max(Counter(labels).values()) < 2:
        return False
    steps = np.abs(np.diff(value)) / np.hypot(std[:, 1:], std[:, :-1])
    return bool(np.isfinite(steps).any() and np.nanmedian(steps) > -ndtri(settings.suspect / 2))


def _is_narrow(value: FloatArray, std: FloatArray, below: float, settings: FlightSettings) -> bool:
    """Whether there are enough steps between flights, and these are larger than their intervals explain."""
    steps = ~np.isnan(np.diff(value)).all(axis=0)
    return bool(steps.sum() >= settings.enough_steps and chance_of_steps(value, std) < below)


def _tabulate_values(found: Sequence[MeasuredQuantity], n_flights: int) -> tuple[FloatArray, FloatArray]:
    """Return values and standard deviations, a row for each quantity and a column for each flight."""
    value, std = (np.full((len(found), n_flights), np.nan) for _ in range(2))
    for row, each in enumerate(found):
        value[row, each.flights], std[row, each.flights] = each.value, each.std
    return value, std


def _list_quantities(flights: Flights) -> list[Quantity]:
    """Return the quantities that at least two flights have, ordered by name: stiffness of all gears, damping, ..."""
    of_each = [[quantity for quantity, e in flight.values.items() if e.value is not None] for flight in flights.flights]
    counts = Counter(quantity for several in of_each for quantity in several)
    names = list(dict.fromkeys(quantity.name for quantity in counts))
    order = ("gas", "stiffness", "damping", "friction")
    names.sort(key=lambda name: order.index(name) if name in order else len(order) + (name == "mass"))
    return [quantity for name in names for quantity, n in counts.items() if quantity.name == name and n > 1]


def _join_changes(
    series: Series, all_series: Sequence[Series], flights: Flights, settings: FlightSettings
) -> list[Change]:
    """Join consecutive flagged flights of a series that depart to the same side."""
    groups: list[list[Point]] = []
    before = None
    for point in series.points:
        if point.flagged:
            if before is not None and before.confirmed:
                groups[-1].append(point)
            else:
                groups.append([point])
        if point.departure is not None:
            before = point
    others = [each for each in all_series if each is not series]
    return [_change(series, group, others, flights, settings) for group in groups]


def _measure_excess(flight: int, others: Sequence[Series]) -> float:
    """Return how many times their stated standard deviations the other quantities of a flight depart, at least 1.

    It is their middle departure over that of a normal deviate. A change of a gear leaves most quantities as they were;
    where most depart, the flight is unlike the others as a whole (its mass change was stated wrong, its intervals are
    too narrow), and so may the quantity be that was flagged.
    """
    departures = [
        abs(point.departure) * each.inflation(point)
        for each in others
        for point in each.judged
        if point.flight == flight and point.departure is not None
    ]
    return max(1.0, float(np.median(departures)) / _MIDDLE_DEVIATE) if departures else 1.0


def _change(
    series: Series, group: Sequence[Point], others: Sequence[Series], flights: Flights, settings: FlightSettings
) -> Change:
    """Compare the mean of the flagged flights with the flights before the first of them.

    The departure of each flight is as uncertain as the others of that flight show (`_measure_excess`); what is common
    to the flagged flights is not less uncertain in their mean.
    """
    first = group[0]
    expected = first.expected or 0.0
    values, own = np.array([(point.estimate.value or 0.0, series.own_std(point)) for point in group]).T
    variance = own**2 + (series.scatter * expected) ** 2
    # This is the part of the variance of the first departure that is due to the mean of the flights before.
    before = max(0.0, (first.std or 0.0) ** 2 - variance[0])
    change = float(values @ (1 / variance) / (1 / variance).sum()) - expected
    std = math.sqrt(1 / (1 / variance).sum() + before)
    std *= max(1.0, *(_measure_excess(point.flight, others) / series.inflation(point) for point in group))
    clear = abs(expected) > settings.clear_std * math.sqrt(before) and expected != 0
    fraction = Estimate.normal(change / abs(expected), std / abs(expected)) if clear else Estimate()
    if first.confirmed is False:
        # The next flight is as before: either the structure was changed and changed back, or this result alone is off.
        fraction = Estimate(fraction.value)
    departure = max((point.departure or 0.0 for point in group), key=abs)
    statement = _write_statement(series, group, flights, fraction, change, departure)
    return Change(series.quantity, first.flight, group[-1].flight, fraction, departure, first.confirmed, statement)


def _write_statement(
    series: Series, group: Sequence[Point], flights: Flights, fraction: Estimate, change: float, departure: float
) -> str:
    quantity, first = series.quantity, group[0]
    by = f"{change:+.3g} {quantity.unit}" if fraction.interval95 is None else format_change(fraction)
    since = when(flights.flights[first.flight])
    until = f" to {when(flights.flights[group[-1].flight])}" if len(group) > 1 else ""
    how = (
        "flagged by this flight and the next together"
        if first.with_next
        else "flagged, confirmed by the next flight"
        if first.confirmed
        else "flagged, not confirmed by the next flight"
        if first.confirmed is False
        else "flagged; the next flight will confirm it or not"
    )
    meaning = ""
    if quantity.name == "gas":
        meaning = (
            "a gas leak, less pressure on the same volume, or colder gas (1 % for each 3 K): "
            if change < 0
            else "an oil leak, more volume at the same pressure, unless gas was filled in or is warmer (1 % for each "
            "3 K): "
        )
    return f"{quantity.full_label}: {meaning}{by} in {since}{until}, {abs(departure):.1f} standard deviations: {how}"


def when(flight: Flight) -> str:
    """Return a flight by its name and date."""
    return f"{flight.name!r}" + (f" ({flight.date})" if flight.date else "")


# ---- warnings ----------------------------------------------------------------------------------------


def _list_warnings(
    flights: Sequence[Flight],
    series: Sequence[Series],
    changes: Sequence[Change],
    chance: float,
    settings: FlightSettings,
) -> Iterator[str]:
    yield from _warn_of_missing(flights, series)
    for gear, n in Counter(gear for flight in flights for gear in flight.laws).items():
        if n == 1:
            alone = next(flight for flight in flights if gear in flight.laws)
            yield f"{gear!r} occurs only in {when(alone)}, so it is not compared: call each gear by one name"
    yield from _warn_of_laws(flights)
    methods = sorted({flight.method for flight in flights})
    if len(methods) > 1:
        yield f"the results come from different methods ({', '.join(methods)}), which may differ from each other"
    yield from _warn_of_scatter(series, changes, chance, settings)
    by_gear: dict[str, list[str]] = {}
    for change in changes:
        if len(_list_points_before(change, series)) == 1:
            by_gear.setdefault(change.quantity.gear or "the body", []).append(change.quantity.label)
    for gear, labels in by_gear.items():
        yield (
            f"{', '.join(dict.fromkeys(labels))} of {gear!r}: there is only one flight before the flagged one, so it "
            "is not known which of the two is unusual"
        )
    yield from _warn_of_common_changes(flights, series, changes)


def _warn_of_scatter(
    series: Sequence[Series], changes: Sequence[Change], chance: float, settings: FlightSettings
) -> Iterator[str]:
    """Yield by how much flights differ beyond their intervals, and which changes this hides."""
    scattered: dict[str, Series] = {}
    for each in series:
        if each.scatter > 0:
            # All gears have the same scatter of a kind of quantity.
            scattered.setdefault(each.quantity.label, each)
    for label, each in scattered.items():
        last = next((point for point in reversed(each.points) if point.std is not None), None)
        least = each.threshold * (last.std or 0.0) / abs(last.expected) if last and last.expected else math.nan
        hidden = "" if math.isnan(least) else f", so that a single flight shows changes of {100 * least:.2g} % or more"
        if least > 1.0:
            hidden = ", and so large that a single flight shows no change: give more flights"
        yield (
            f"{label}: neighbouring flights differ by more than their intervals, which corresponds to a scatter of "
            f"{100 * each.scatter:.2g} % from flight to flight (wheel tracks, temperature, loading); the scatter is "
            f"included in the limits{hidden}"
        )
    if scattered:
        return
    few = max(sum(point.departure is not None for point in each.points) for each in series)
    if few < settings.enough_steps:
        yield (
            f"with {few + 1} flights the scatter between flights cannot be estimated: the flags depend on the "
            "intervals of the results"
        )
    if changes and chance < settings.suspect:
        yield (
            "most quantities differ from flight to flight by more than their intervals explain: a flag may be scatter "
            "(wheel tracks, temperature, loading); more flights would show this"
        )


def _list_points_before(change: Change, series: Sequence[Series]) -> list[Point]:
    """Return the judged flights of the series before a change."""
    points = next(each.points for each in series if each.quantity == change.quantity)
    return [point for point in points if point.flight < change.first and point.has_interval]


def _warn_of_missing(flights: Sequence[Flight], series: Sequence[Series]) -> Iterator[str]:
    """Yield which quantities are missing, one sentence for each flight."""
    for status, words in ((Status.NO_VALUE, "have no value"), (Status.NO_INTERVAL, "have no interval")):
        for index, flight in enumerate(flights):
            lacking = [
                each.quantity.full_label
                for each in series
                if any(point.flight == index and point.status is status for point in each.points)
            ]
            if lacking:
                yield f"{when(flight)}: {list_names(lacking)} {words} and are not judged"


def _warn_of_laws(flights: Sequence[Flight]) -> Iterator[str]:
    """Yield which gears have laws of different kinds in different flights."""
    for gear in dict.fromkeys(gear for flight in flights for gear in flight.laws):
        of_flight = {flight.name: flight.laws[gear] for flight in flights if gear in flight.laws}
        name_of = {kinds: " + ".join(kinds) or "linear" for kinds in of_flight.values()}
        usual = find_usual_law(flights, gear)
        others = [f"{name_of[kinds]} in {name!r}" for name, kinds in of_flight.items() if kinds != usual]
        if others:
            yield (
                f"the law of {gear!r} is {name_of[usual]}, but {list_names(others)}: neither their amplitudes nor "
                "stiffness and damping, which are the linear part beside the law, are compared; identify all flights "
                "with one law (--law)"
            )


def _warn_of_common_changes(
    flights: Sequence[Flight], series: Sequence[Series], changes: Sequence[Change]
) -> Iterator[str]:
    """Yield the changes that all gears have in common."""
    gears = Counter(each.quantity.label for each in series)
    together: dict[tuple[str, int, bool], list[str]] = {}
    for change in changes:
        together.setdefault((change.quantity.label, change.first, change.departure > 0), []).append(
            change.quantity.gear
        )
    for (label, first, rises), names in together.items():
        if len(names) > 1 and len(names) == gears[label]:
            yield (
                f"{label} {'rises' if rises else 'falls'} in all gears at once in {when(flights[first])}: the cause is "
                "probably temperature, loading or speed and not a gear"
            )
