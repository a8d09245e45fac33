"""Flights against each other: level and power by simulation, and what to doubt."""

from pathlib import Path

import numpy as np
import pytest
from made_flights import GEARS, TRUTH, error
from scipy.stats import binom, norm

from opid.estimate import Estimate
from opid.suspensions.flights.comparison import compare
from opid.suspensions.flights.departures import (
    FlightSettings,
    chance_of_steps,
    collect_values,
    judge_series,
    scatter_between,
)
from opid.suspensions.flights.result_file import Flight, Quantity
from opid.suspensions.flights.results import Flights, put_in_order

MASS = Quantity("", "mass", "kg")


def fleet(rng, n, *, std=0.01, scatter=0.0, shared=0.0, at=None, loss=0.05):
    """Flights of three gears; the left strut is softer from flight `at` on.

    All quantities of a flight share one error, that of its mass: so much of each `std`.
    """
    flights = []
    for i in range(n):
        common = 1 + shared * std * rng.standard_normal() if shared else 1.0
        own = std * np.sqrt(1 - shared**2)

        def found(true, common=common, own=own):
            return Estimate.normal(common * error(rng, true, own, scatter).value, std * true)

        values = {MASS: found(TRUTH["mass"])}
        for gear, size in GEARS.items():
            for name in ("stiffness", "damping", "friction"):
                gone = loss if at is not None and i >= at and (gear, name) == ("left", "stiffness") else 0.0
                kind = "arctan_velocity" if name == "friction" else ""
                quantity = Quantity(gear, name, "N", kind)
                values[quantity] = found(size * TRUTH[name] * (1 - gone))
        laws = dict.fromkeys(GEARS, ("arctan_velocity",))
        flights.append(Flight(f"f{i}", Path(f"f{i}"), None, "model", "rigid_body", laws, values))
    return Flights(tuple(flights), False)


def one_series(values, std):
    flights = [
        Flight(f"f{i}", Path(), None, "model", "x", {}, {MASS: Estimate.normal(x, std)}) for i, x in enumerate(values)
    ]
    return Flights(tuple(flights), False)


def found_at(comparison, at):
    """Whether the loss of the left strut was flagged within two flights of `at`."""
    return any(
        (change.quantity.gear, change.quantity.name) == ("left", "stiffness") and at <= change.first <= at + 1
        for change in comparison.changes
    )


# ---- level -------------------------------------------------------------------------------------------


def test_unharmed_fleets_are_not_flagged_at_the_stated_level():
    n_fleets = 50
    flagged = sum(bool(compare(fleet(np.random.default_rng(seed), 10)).changes) for seed in range(n_fleets))
    # more than this would happen once in ten thousand at the stated level of 1 in 1000
    assert flagged <= binom.isf(1e-4, n_fleets, 1e-3)


def test_the_level_is_kept_where_it_can_be_measured():
    level, n_fleets = 0.2, 80
    results = [compare(fleet(np.random.default_rng(seed), 6), false_alarm=level) for seed in range(n_fleets)]
    flagged = sum(bool(result.changes) for result in results)
    assert flagged <= binom.isf(1e-3, n_fleets, level)
    # and it is not wasted either: singles alone would be 50 of the 90 comparisons
    assert flagged >= 0.25 * level * n_fleets
    assert results[0].n_tests == 10 * (2 * 6 - 3)


@pytest.mark.parametrize("shared", [0.0, 0.7, 0.95])
@pytest.mark.parametrize("n", [3, 4, 5, 6])
def test_few_flights_that_share_an_error_are_neither_flagged_nor_taken_for_scatter(n, shared):
    n_fleets = 25
    results = [compare(fleet(np.random.default_rng([seed, n]), n, shared=shared)) for seed in range(n_fleets)]
    assert sum(bool(result.changes) for result in results) <= binom.isf(1e-4, n_fleets, 1e-3)
    scattered = sum(any(series.scatter > 0 for series in result.series) for result in results)
    assert scattered <= (binom.isf(1e-4, n_fleets, 0.01) if n > 4 else 0)


def test_the_threshold_is_the_closed_form_of_sidak():
    result = compare(fleet(np.random.default_rng(0), 8), false_alarm=0.01)
    threshold = {each.threshold for each in result.series if each.scatter == 0.0}
    level = 1 - (1 - 2 * norm.sf(next(iter(threshold)))) ** result.n_tests
    assert level == pytest.approx(0.01, rel=1e-9)


def test_departures_from_the_earlier_mean_are_independent_and_normal():
    rng = np.random.default_rng(5)
    departures = []
    for _ in range(300):
        flights = one_series(100 + rng.standard_normal(5), 1.0)
        series = judge_series(collect_values(flights.flights, MASS), scatter=0.0, freedom=np.inf, chance=1e-6)
        departures.append([point.departure for point in series.points[1:]])
    covariance = np.cov(np.array(departures).T)
    assert np.allclose(covariance, np.eye(4), atol=0.25)


def test_scatter_larger_than_the_intervals_does_not_cry_wolf():
    n_fleets = 30
    fleets = [fleet(np.random.default_rng(seed), 12, std=0.003, scatter=0.01) for seed in range(n_fleets)]
    results = [compare(each) for each in fleets]
    # with the intervals as they are stated every one of them would be flagged
    assert sum(bool(result.changes) for result in results) <= 3
    fractions = [
        series.scatter for result in results for series in result.series if series.quantity.name == "stiffness"
    ]
    assert np.median(fractions) == pytest.approx(0.01, rel=0.15)
    assert all("neighbouring flights differ by more than their intervals" in " ".join(r.warnings) for r in results[:3])


# ---- power -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("std", "at", "shared", "least"),
    [(0.01, 8, 0.0, 0.85), (0.01, 3, 0.0, 0.8), (0.01, 3, 0.9, 0.8), (0.01, 4, 0.7, 0.8), (0.003, 8, 0.0, 1.0),
     (0.003, 3, 0.0, 1.0), (0.003, 3, 0.9, 1.0), (0.003, 5, 0.7, 1.0)],
)  # fmt: skip
def test_a_loss_of_5_percent_is_flagged_within_two_flights(std, at, shared, least):
    n_fleets = 30
    results = [
        compare(fleet(np.random.default_rng(seed), at + 2, std=std, shared=shared, at=at)) for seed in range(n_fleets)
    ]
    assert sum(found_at(result, at) for result in results) >= least * n_fleets
    others = [c for r in results for c in r.changes if (c.quantity.gear, c.quantity.name) != ("left", "stiffness")]
    assert len(others) <= 2
    if std == 0.003:
        change = results[0].changes[0]
        assert change.confirmed is True
        assert change.fraction.holds(-0.05)
        assert "stiffness of 'left'" in change.statement
        assert "flagged, confirmed by the next flight" in change.statement


def test_a_change_is_still_seen_under_scatter():
    results = [compare(fleet(np.random.default_rng(s), 22, std=0.002, scatter=0.005, at=20)) for s in range(10)]
    assert sum(found_at(result, 20) for result in results) >= 9


def test_a_great_loss_in_the_third_flight_is_no_scatter():
    for shared in (0.0, 0.95):
        result = compare(fleet(np.random.default_rng(1), 3, std=0.002, shared=shared, at=2, loss=0.2))
        (change,) = result.changes
        assert (change.quantity.gear, change.quantity.name, change.first) == ("left", "stiffness", 2)
        told = " ".join(result.warnings)
        assert "depend on the intervals of the results" in told
        assert "included in the limits" not in told


def test_a_strut_that_softens_from_flight_to_flight_is_no_scatter():
    flights = list(fleet(np.random.default_rng(2), 8, std=0.002).flights)
    left = Quantity("left", "stiffness", "N")
    for i, flight in enumerate(flights):
        softer = {left: Estimate.normal((1 - 0.01 * i) * flight.values[left].value, flight.values[left].std)}
        flights[i] = Flight(flight.name, Path(), None, "model", "x", flight.laws, {**flight.values, **softer})
    result = compare(Flights(tuple(flights), False))
    assert {change.quantity for change in result.changes} == {left}
    assert "included in the limits" not in " ".join(result.warnings)


def test_a_single_odd_flight_is_not_confirmed_and_the_next_are_judged_without_it():
    result = compare(one_series([100, 101, 99, 100, 120, 100, 101], 1.0))
    (change,) = result.changes
    assert (change.first, change.last, change.confirmed) == (4, 4, False)
    assert "not confirmed by the next flight" in change.statement
    last = result.series[0].points[-1]
    assert last.expected == pytest.approx(100.0)


def test_a_lasting_change_stays_flagged_against_the_flights_before_it():
    result = compare(one_series([100, 101, 99, 100, 90, 95, 91, 90], 1.0))
    (change,) = result.changes
    assert (change.first, change.last, change.confirmed) == (4, 7, True)
    assert result.series[0].points[-1].expected == pytest.approx(100.0)
    assert change.fraction.value == pytest.approx(-0.085)


def test_two_flights_together_show_what_neither_does_alone():
    values = [100, 100, 100, 100, 100, 100, 100, 100, 96.6, 96.6]
    result = compare(one_series(values, 1.0))
    (change,) = result.changes
    assert (change.first, change.last) == (8, 9)
    assert "flagged by this flight and the next together" in change.statement
    assert result.series[0].points[8].with_next
    # one of them alone is not flagged, nor is a far one beside a usual one
    assert compare(one_series(values[:9], 1.0)).changes == ()
    assert compare(one_series([*values[:8], 96.5, 99.0], 1.0)).changes == ()


def test_the_last_flight_waits_for_the_next():
    (change,) = compare(one_series([100, 101, 99, 100, 110], 1.0)).changes
    assert change.confirmed is None
    assert "the next flight will confirm it or not" in change.statement


# ---- scatter -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("shared", [0.0, 1.0])
@pytest.mark.parametrize(("n_quantities", "n_flights"), [(1, 15), (10, 5), (10, 15), (10, 60)])
def test_a_small_chance_of_steps_is_as_rare_as_it_says(n_quantities, n_flights, shared):
    rng = np.random.default_rng(2)
    size, n_sets = (n_quantities, n_flights), 300
    chances = [
        chance_of_steps(
            100 + np.sqrt(1 - shared) * rng.standard_normal(size) + shared * rng.standard_normal(n_flights),
            np.ones(size),
        )
        for _ in range(n_sets)
    ]
    assert np.sum(np.array(chances) < 0.05) <= binom.isf(1e-3, n_sets, 0.05)


def test_one_step_does_not_pass_for_scatter():
    rng = np.random.default_rng(3)
    x = 100 + rng.standard_normal((1, 20))
    x[:, 10:] += 40
    assert chance_of_steps(x, np.ones(x.shape)) > 0.01
    assert scatter_between(x, np.ones(x.shape))[0] < 0.01
    assert chance_of_steps(x[:, :1], np.ones((1, 1))) == 1.0
    assert scatter_between(x[:, :1], np.ones((1, 1))) == (0.0, 1.0)


def test_flights_that_lack_a_quantity_leave_the_other_steps():
    x = np.array([[100.0, 103, 98, 101, 96, 104, 99, 103], [np.nan] * 4 + [100.0, 101, np.nan, 100]])
    assert chance_of_steps(x, np.full(x.shape, 0.1)) < 1e-6
    assert scatter_between(x, np.full(x.shape, 0.1))[1] == pytest.approx(0.4 * 8)


def test_few_flights_of_which_most_quantities_differ_are_not_flagged():
    for seed in range(5):
        result = compare(fleet(np.random.default_rng(seed), 3, std=0.003, scatter=0.02))
        assert not result.changes
        assert "neighbouring flights differ by more than their intervals" in " ".join(result.warnings)


def test_flags_of_few_flights_that_may_be_scatter_are_said_to_be_that():
    results = [compare(fleet(np.random.default_rng(seed), 4, std=0.003, scatter=0.006)) for seed in range(40)]
    told = [" ".join(each.warnings) for each in results if each.changes]
    assert told
    assert all("depend on the intervals" in each for each in told)
    assert any("a flag may be scatter (wheel tracks, temperature, loading); more flights" in each for each in told)


def test_what_scatter_hides_is_said():
    result = compare(fleet(np.random.default_rng(1), 12, std=0.003, scatter=0.015))
    told = " ".join(result.warnings)
    assert "is included in the limits, so that a single flight shows changes of" in told
    assert "depend on the intervals" not in told


def test_changes_of_all_gears_at_once_are_told_to_be_that():
    flights = list(fleet(np.random.default_rng(0), 9, std=0.003).flights)
    for i in (7, 8):
        values = {
            q: Estimate.normal(0.9 * e.value, e.std) if q.name == "damping" else e for q, e in flights[i].values.items()
        }
        flights[i] = Flight(f"f{i}", Path(), None, "model", "rigid_body", flights[i].laws, values)
    result = compare(Flights(tuple(flights), False))
    assert len(result.changes) == 3
    assert any("damping falls in all gears at once" in warning for warning in result.warnings)


def test_one_day_with_two_flights_is_said():
    rng = np.random.default_rng(0)
    first, second = fleet(rng, 2).flights
    from dataclasses import replace
    from datetime import date

    same = put_in_order([replace(flight, date=date(2026, 3, 1)) for flight in (second, first)])
    assert [flight.name for flight in same.flights] == ["f1", "f0"]
    assert "2 flights have the date 2026-03-01" in same.notes[0]


def test_the_numbers_of_a_comparison_can_be_passed_and_stand_in_it():
    flights = fleet(np.random.default_rng(1), 12, std=0.003, scatter=0.015)
    usual, blind = compare(flights), compare(flights, settings=FlightSettings(enough_steps=100, suspect=0.0))
    assert any(series.scatter > 0 for series in usual.series)
    assert not any(series.scatter > 0 for series in blind.series)
    assert blind.settings == FlightSettings(enough_steps=100, suspect=0.0)
    assert compare(flights, false_alarm=0.01).settings == FlightSettings(false_alarm=0.01)


def test_the_odd_one_of_two_is_not_known():
    result = compare(one_series([100.0, 120.0], 1.0))
    assert any("is not known which of the two is unusual" in warning for warning in result.warnings)
