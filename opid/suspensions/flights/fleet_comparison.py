"""The comparison of a fleet: each strut with its own past and with the others, by the model of `fleet_model`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, timedelta
from itertools import pairwise
from pathlib import Path

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.estimate import Estimate, format_change
from opid.result import RESULT_FILE
from opid.signals.recording import FloatArray
from opid.suspensions.flights.dataset import FleetDataset, FleetTable
from opid.suspensions.flights.departures import find_threshold
from opid.suspensions.flights.fleet import Fleet, FleetSeries, Strut, StrutChange, StrutDrift, StrutFlight
from opid.suspensions.flights.fleet_model import (
    DEFAULTS,
    BoolArray,
    CommonStep,
    FleetSettings,
    FleetValues,
    Judged,
    Population,
    add_step,
    find_common_step,
    find_tempers,
    fit_population,
    judge_flights,
)
from opid.suspensions.flights.result_file import Quantity

_DAYS_A_YEAR = 365.25
_SETTLED = 0.02
"""The fit is repeated until no variance of a strut moves by more than this fraction."""

_MOST_STEPS = 3
"""Steps of all struts that are looked for, one after the other."""

_MAD_OF_NORMAL = 0.6745
"""Median absolute deviation of the standard normal distribution."""

_LEAST_YEARS = 1 / 12
"""Flights of a few days count as those of a month, or hardly any alarm would be allowed among them."""


def compare_fleet(
    dataset: FleetDataset,
    *,
    alarms_per_year: float | None = None,
    settings: FleetSettings = DEFAULTS,
) -> Fleet:
    """Say which struts of a fleet changed by more than their uncertainty.

    For each quantity of each place a hierarchical model is fitted to the logarithms of all values (`fleet_model`): a
    common level, trend and effect of the covariates, and for each strut a level and a trend of its own. Then the
    flights of a strut are compared, one after the other, with what its flights before and the other struts say. With N
    comparisons of all quantities in T years each has the chance `alarms_per_year` T / N to be flagged if nothing
    changed (Bonferroni), so that the expected number of false alarms is at most the stated one.

    Args:
        dataset: from `read_dataset`.
        alarms_per_year: expected number of false alarms in a year of the whole fleet; that of the settings if left out.
        settings: the tuned numbers.

    Raises:
        InputError: a number of alarms that is not positive.
        NotDeterminedError: no strut has a quantity with an interval at two dated flights.
    """
    alarms = settings.alarms_per_year if alarms_per_year is None else alarms_per_year
    if not 0 < alarms < math.inf:
        raise InputError(f"the alarms per year are {alarms:g}: give a positive number, like 0.1 for one in ten years")
    kept = (_keep_judged(table, settings) for table in dataset.tables)
    tables = [table for table in kept if table is not None]
    if not tables:
        raise NotDeterminedError(
            f"no strut in {dataset.path} has a value with an interval at two dated flights: give flights dates, and "
            "identify them by the usual method"
        )
    days = np.concatenate([table.day for table in tables])
    first = float(days.min())
    # The months in which there are flights count: one mistyped date must not make a century of allowed alarms.
    years = max(_LEAST_YEARS, np.unique(days * 12 // _DAYS_A_YEAR).size / 12)
    laid = [(table, *_lay_out(table, first, settings)) for table in tables]
    n_tests = sum(
        int(np.maximum(0, values.is_there.sum(axis=1) - w).sum()) for _, _, values, _ in laid for w in settings.windows
    )
    # each strut has a trend, too, and each quantity a common step
    n_tests += sum(rows.shape[0] + settings.candidates for _, rows, *_ in laid)
    chance = min(0.5, alarms * years / n_tests)
    series = tuple(_compare_struts(*each, settings, chance, dataset.path.parent, first) for each in laid)
    if not any(each.n_tests for each in series):
        raise NotDeterminedError(
            f"no strut in {dataset.path} has enough flights to be compared with its own past: give flights of more "
            "days, or more aircraft"
        )
    warnings = tuple(_list_warnings(dataset, tables, series))
    return Fleet(str(dataset.path), series, dataset.n_flights, years, alarms, warnings, settings, dataset.files)


def _keep_judged(table: FleetTable, settings: FleetSettings) -> FleetTable | None:
    """Return the values that have a date, all covariates, and a logarithm; None if no strut has two."""
    is_kept = np.isfinite(table.day) & (table.std > 0) & (table.value > settings.clear_std * table.std)
    is_kept &= ~_find_copies(table)
    # a covariate that most flights lack explains nothing
    covariates = {name: x for name, x in table.covariates.items() if np.isfinite(x).mean() > 0.5}
    for x in covariates.values():
        is_kept &= np.isfinite(x)
    _, counts = np.unique(table.tail[is_kept], return_counts=True)
    if not (counts > 1).any():
        return None
    return FleetTable(
        table.quantity,
        table.tail[is_kept],
        table.flight[is_kept],
        table.day[is_kept],
        table.value[is_kept],
        table.std[is_kept],
        {name: x[is_kept] for name, x in covariates.items()},
        table.folder[is_kept],
    )


def _find_copies(table: FleetTable) -> BoolArray:
    """The flights of a strut that hold the same numbers as one before them on the same day: they are no new ones."""
    seen: set[tuple[str, float, float, float]] = set()
    copies = np.zeros(table.value.size, dtype=bool)
    rows = zip(map(str, table.tail), table.day.tolist(), table.value.tolist(), table.std.tolist(), strict=True)
    for k, row in enumerate(rows):
        copies[k] = row in seen
        seen.add(row)
    return copies


_Laid = tuple[np.ndarray, FleetValues, dict[str, tuple[int, ...]]]


def _lay_out(table: FleetTable, first_day: float, settings: FleetSettings) -> _Laid:
    """Return the rows of each strut by date, padded with -1, their values, and the columns of each covariate."""
    tails = np.unique(table.tail)
    of_tail = [np.flatnonzero(table.tail == tail) for tail in tails]
    rows = np.full((len(tails), max(map(len, of_tail))), -1)
    for i, several in enumerate(of_tail):
        rows[i, : several.size] = several[np.argsort(table.day[several], kind="stable")]
    is_there = rows >= 0
    years = (table.day - first_day) / _DAYS_A_YEAR
    columns: list[FloatArray] = [np.ones_like(years), years]
    places: dict[str, tuple[int, ...]] = {}
    varying = {name: (x - x.mean()) / x.std() for name, x in table.covariates.items() if x.std() > 0}
    has_squares = table.value.size >= settings.values_per_coefficient * (2 + 2 * len(varying))
    for name, x in varying.items():
        powers = [x, x**2 - 1] if has_squares and np.unique(x).size > 2 else [x]
        places[name] = tuple(range(len(columns), len(columns) + len(powers)))
        columns += powers
    at = np.where(is_there, rows, 0)
    fixed = np.stack(columns, axis=-1)[at]
    values = FleetValues(
        np.log(table.value)[at],
        np.where(is_there, (table.std / table.value)[at], 1.0),
        is_there,
        fixed,
        np.where(is_there, years[at], 0.0),
    )
    return rows, values, places


def _compare_struts(
    table: FleetTable,
    rows: np.ndarray,
    values: FleetValues,
    places: Mapping[str, tuple[int, ...]],
    settings: FleetSettings,
    chance: float,
    folder: Path,
    first_day: float,
) -> FleetSeries:
    steps: list[CommonStep] = []
    for _ in range(_MOST_STEPS + 1):
        population, judged, used = _judge_all(values, settings, chance)
        step = find_common_step(values, population, used, settings, chance)
        if step is None or len(steps) == _MOST_STEPS:
            break
        steps.append(step)
        values = add_step(values, step)
    struts = tuple(_build_strut(table, row, s, judged, folder) for s, row in enumerate(rows))
    return FleetSeries(
        table.quantity,
        struts,
        population.scatter,
        population.level,
        _estimate_coefficient(population, 1),
        {name: _estimate_coefficient(population, several[0]) for name, several in places.items()},
        find_threshold(chance, population.freedom),
        judged.n_tests,
        tuple(_build_step(step, first_day) for step in steps),
        tuple(_find_drifts(table.quantity, struts, settings, chance)),
    )


def _find_drifts(
    quantity: Quantity, struts: Sequence[Strut], settings: FleetSettings, chance: float
) -> Iterator[StrutDrift]:
    """Yield the struts whose trend departs from that of the others by more than these differ among each other."""
    known = [each for each in struts if each.trend_per_year.value is not None and len(each.flights) > 2]
    value = np.array([each.trend_per_year.value for each in known], dtype=float)
    std = np.array([each.trend_per_year.std for each in known], dtype=float)
    usual, spread, freedom = 0.0, 0.0, math.inf
    if value.size >= settings.few:
        usual = float(np.median(value))
        # The spread beyond the standard deviations, from the median so that a strut that drifts does not hide itself.
        square = (float(np.median(np.abs(value - usual))) / _MAD_OF_NORMAL) ** 2 - float(np.median(std)) ** 2
        spread, freedom = math.sqrt(max(0.0, square)), float(value.size - 1)
    departure = (value - usual) / np.sqrt(std**2 + spread**2)
    limit = find_threshold(chance, freedom)
    for strut, each in zip(known, departure, strict=True):
        if abs(each) > limit:
            yield StrutDrift(quantity, strut.tail, strut.trend_per_year, usual, float(each))


def _judge_all(values: FleetValues, settings: FleetSettings, chance: float) -> tuple[Population, Judged, BoolArray]:
    """Fit the fleet and judge its flights, until neither the flags nor the scatter of the struts move any more."""
    used, tempers = values.is_there.copy(), None
    for _ in range(settings.rounds):
        population = fit_population(values, used)
        judged = judge_flights(values, population, used, settings, chance, tempers)
        again = find_tempers(judged, tempers, settings)
        # What follows a change does not tell about the trend and the scatter of an unchanged strut.
        before = values.is_there & ~np.logical_or.accumulate(judged.changed_at, axis=1)
        is_settled = tempers is not None and np.allclose(again.factor, tempers.factor, rtol=_SETTLED)
        if (before == used).all() and is_settled:
            break
        used, tempers = before, again
    return population, judged, used


def _build_step(step: CommonStep, first_day: float) -> tuple[date, Estimate]:
    """The day of a step of all struts, and its size as a fraction."""
    day = date(1970, 1, 1) + timedelta(days=round(first_day + step.years * _DAYS_A_YEAR))
    return day, _convert_to_fraction(step.size, step.std)


def _convert_to_fraction(size: float, std: float) -> Estimate:
    """A change of the logarithm as a fraction, with its interval."""
    ends = math.expm1(size - 1.96 * std), math.expm1(size + 1.96 * std)
    return Estimate(math.expm1(size), math.exp(size) * std, ends)


def _estimate_coefficient(population: Population, index: int) -> Estimate:
    return Estimate.normal(float(population.coefficients[index]), math.sqrt(population.covariance[index, index]))


def _build_strut(table: FleetTable, row: FloatArray, s: int, judged: Judged, folder: Path) -> Strut:
    tail = str(table.tail[row[0]])
    n = int((row >= 0).sum())
    level = np.cumsum(judged.changed_at[s])
    starts = [*np.flatnonzero(judged.changed_at[s, :n]), n]
    flights, changes = [], []
    for k in range(n):
        r = row[k]
        value, mean = float(table.value[r]), math.exp(judged.expected[s, k])
        std = math.sqrt(max(0.0, judged.expected_std[s, k] ** 2 - (table.std[r] / table.value[r]) ** 2))
        departure = judged.departure[s, k]
        is_judged = k > 0 and math.isfinite(departure)
        flights.append(
            StrutFlight(
                str(table.flight[r]),
                date(1970, 1, 1) + timedelta(days=int(table.day[r])),
                Estimate.normal(value, float(table.std[r])),
                Estimate.normal(mean, mean * std) if is_judged else Estimate(),
                float(departure) if is_judged else None,
                int(level[k]),
                folder / str(table.folder[r]) / RESULT_FILE,
            )
        )
    for start, end in pairwise(starts):
        size, std = float(judged.size[s, start]), float(judged.size_std[s, start])
        fraction = _convert_to_fraction(size, std)
        first = flights[start]
        changes.append(
            StrutChange(
                table.quantity,
                tail,
                int(start),
                first.flight,
                first.date,
                fraction,
                float(judged.strongest[s, start]),
                int(judged.window[s, start]),
                int(end - start),
            )
        )
    trend = Estimate.normal(float(judged.trend[s]), float(judged.trend_std[s]))
    return Strut(tail, tuple(flights), trend, *_set_lone_apart(changes))


def _set_lone_apart(changes: Sequence[StrutChange]) -> tuple[tuple[StrutChange, ...], tuple[StrutChange, ...]]:
    """Return the changes, and apart from them those of one flight after which the values come back."""
    lasting, lone = [], []
    rest = list(changes)
    while rest:
        change = rest.pop(0)
        if change.n_flights == 1 and rest and _comes_back(change, rest[0]):
            lone.append(change)
            rest.pop(0)
        elif change.n_flights > change.n_needed and not _lasts(change):
            lone.append(change)
        else:
            lasting.append(change)
    return tuple(lasting), tuple(lone)


def _lasts(change: StrutChange) -> bool:
    """Whether the flights since a change, taken together, are still unlike those before it."""
    low, high = change.fraction.interval95 or (math.nan, math.nan)
    return low > 0 or high < 0


def _comes_back(change: StrutChange, following: StrutChange) -> bool:
    there, back = change.fraction, following.fraction
    left = math.log1p(there.value or 0.0) + math.log1p(back.value or 0.0)
    return abs(left) < 1.96 * math.hypot(there.std or 0.0, back.std or 0.0)


def _list_warnings(dataset: FleetDataset, tables: Sequence[FleetTable], series: Sequence[FleetSeries]) -> Iterator[str]:
    """Yield what was left out, and what may be no change of a strut."""
    n_lost = sum(dataset.without_values.values())
    if n_lost:
        yield (
            f"without values, and left out: {n_lost} of {dataset.n_flights} flights; the index page of the campaign "
            "gives the reasons"
        )
    kept = {table.quantity: table.value.size for table in tables}
    for table in dataset.tables:
        n_left = table.value.size - kept.get(table.quantity, 0)
        if n_left:
            yield (
                f"left out: {n_left} of {table.value.size} values of {table.quantity.full_label}, which have no date "
                "or no covariate, are not clearly positive, or are copies of others"
            )
    for each in series:
        yield from (
            f"{change.subject} in {change.flight!r} ({change.date}) alone: the flights after it "
            "are as those before, so it is no change of the strut"
            for strut in each.struts
            for change in strut.lone
        )
        what = each.quantity.full_label
        for day, fraction in each.common_steps:
            yield (
                f"{what} changes by {format_change(fraction)} in all struts about {day}: the cause is common to them "
                "(temperature, loading, a sensor, a new track) and no strut is flagged for it"
            )
        trend = each.trend_per_year
        if len(each.struts) > 1 and abs(trend.value or 0.0) > each.threshold * (trend.std or math.inf):
            yield (
                f"{what} changes by {100 * (trend.value or 0.0):+.1f} % a year in all struts: the cause is common to "
                "them (age, or what no covariate tells) and no strut is flagged for it"
            )
