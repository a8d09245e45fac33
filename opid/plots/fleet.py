"""Figures of several flights: all struts of a fleet at a glance, one strut flight by flight, and laws overlaid."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num

from opid.mechanics.laws.law import Law
from opid.plots.style import (
    BLUE,
    INK,
    VERMILION,
    choose_run_colors,
    figure_of,
    format_minus,
    format_units,
    house_style,
    panels,
    panels_in_rows,
)
from opid.suspensions.flights.fleet import FleetSeries, Strut, StrutFlight
from opid.suspensions.flights.result_file import Flight, StrutLaw, find_page

_MOST_COLUMNS = 60
"""Columns of the map: more are narrower than a reader can point at."""

_SMOOTHED = 3
"""A cell has the mean of so many flights, as the comparison has: the scatter of a single one would hide a step."""

_PALE = 4.0
"""The strongest colour is this many standard deviations of such a mean, so that scatter is pale."""

_ROW_IN, _LEAST_IN, _MOST_IN = 0.16, 2.6, 9.0
"""Height of a strut, and of the map, inches: 500 struts are rows of two pixels, which still show a step."""

_MOST_NAMES = 50
"""More names do not fit beside the map; the reader then points at a row."""


_N_POINTS = 61
"""Points of a drawn law."""

_RATE_PER_S = 10.0
"""The damper is drawn up to this times the travel, as at 1.6 Hz."""


def draw_fleet_map(series: FleetSeries, ax: Any = None) -> Axes:
    """Draw one quantity of all struts over date: by how many percent each differs from its first level.

    What the covariates and the common trend explain is taken away. A cell is empty, and white, where the strut did not
    fly in the days of its column (see `find_column_days`). The struts that changed stand above, the others
    below them, by name.

    Args:
        series: one of `Fleet.series`.
        ax: one Axes, or None for a new figure.
    """
    struts = sorted(series.struts, key=lambda strut: (bool(strut.changes), _find_latest_level(strut)), reverse=True)
    edges = _find_edges(series)
    cells = np.full((len(struts), edges.size - 1), np.nan)
    for row, strut in enumerate(struts):
        levels = [0.0, *np.cumsum([np.log1p(each.fraction.value or 0.0) for each in strut.changes])]
        column = np.searchsorted(edges, [date2num(flight.date) for flight in strut.flights], side="right") - 1
        value = np.array([_find_departure(flight) + levels[flight.level] for flight in strut.flights])
        level = np.array([flight.level for flight in strut.flights])
        several = [np.arange(max(0, k - _SMOOTHED + 1), k + 1) for k in range(value.size)]
        # the mean of flights before and after a change would show the change later than it was
        smooth = [value[each[level[each] == level[k]]].mean() for k, each in enumerate(several)]
        for k in np.unique(column):
            cells[row, k] = 100 * np.expm1(np.array(smooth)[column == k].mean())
    changes = [abs(100 * (each.fraction.value or 0.0)) for strut in struts for each in strut.changes]
    spread = np.nanmedian(np.abs(cells)) / 0.6745
    most = max([0.1, _PALE * float(spread), *changes])
    with house_style():
        height = float(np.clip(_ROW_IN * len(struts), _LEAST_IN, _MOST_IN))
        ax = panels(ax, 1, height_in=height + 0.8)[0, 0]
        rows = np.arange(len(struts) + 1) - 0.5
        mesh = ax.pcolormesh(
            edges, rows, np.ma.masked_invalid(cells), cmap="PuOr_r", norm=TwoSlopeNorm(0.0, -most, most)
        )
        bar = figure_of(ax).colorbar(mesh, ax=ax, pad=0.02)
        bar.set_label("from its first level [%]")
        ax.grid(visible=False)  # its lines would look like marks in the empty cells
        _format_dates(ax)
        ax.set_ylim(len(struts) - 0.5, -0.5)
        names = [strut.tail or "all" for strut in struts]
        ax.fmt_ydata = lambda y: names[round(y)]
        if len(names) <= _MOST_NAMES:
            ax.set_yticks(range(len(names)), names)
        else:
            shown = np.unique(np.linspace(0, len(names) - 1, 10).round().astype(int))
            ax.set_yticks(shown, [names[k] for k in shown])
        n_changed = sum(bool(strut.changes) for strut in struts)
        said = f"{n_changed} of {len(struts)} struts changed" if n_changed else f"none of {len(struts)} struts changed"
        ax.set_title(f"{_say_quantity(series)}: {said}")
    return ax


def find_column_days(series: FleetSeries) -> float:
    """Return how many days one column of the map of a fleet stands for.

    Args:
        series: one of `Fleet.series`.
    """
    edges = _find_edges(series)
    return float(edges[1] - edges[0])


def _find_edges(series: FleetSeries) -> np.ndarray:
    """Return the edges of the columns of the map, days since 1970: as many columns as a strut has flights at most."""
    days = np.array([date2num(flight.date) for strut in series.struts for flight in strut.flights])
    n_columns = min(_MOST_COLUMNS, max(len(strut.flights) for strut in series.struts))
    return np.linspace(days.min() - 0.5, days.max() + 0.5, n_columns + 1)


def draw_strut(series: FleetSeries, strut: Strut, ax: Any = None) -> Axes:
    """Draw one quantity of one strut over date: values with 95 % bars, what was expected, and where it changed.

    Args:
        series: one of `Fleet.series`.
        strut: one of its struts.
        ax: one Axes, or None for a new figure.
    """
    at = np.array([date2num(flight.date) for flight in strut.flights])
    values = np.array([flight.estimate.value for flight in strut.flights], dtype=float)
    ends = np.array([flight.estimate.interval95 for flight in strut.flights], dtype=float)
    judged = [k for k, flight in enumerate(strut.flights) if flight.expected.value is not None]
    expected = np.array([strut.flights[k].expected.value for k in judged], dtype=float)
    std = np.array([strut.flights[k].expected.std for k in judged], dtype=float)
    own = np.array([strut.flights[k].estimate.std for k in judged], dtype=float)
    half = series.threshold * np.sqrt(std**2 + own**2 + (series.scatter * expected) ** 2)
    with house_style():
        ax = panels(ax, 1, height_in=3.2)[0, 0]
        ax.fill_between(
            at[judged],
            expected - half,
            expected + half,
            color=BLUE,
            alpha=0.2,
            linewidth=0,
            label="limit for one flight",
        )
        ax.plot(at[judged], expected, color=BLUE, linewidth=1, linestyle="--", label="expected")
        dot: dict[str, Any] = {"color": INK, "marker": "o", "markersize": 3.5, "linestyle": "none"}
        name = "value, 95 % interval"
        ax.vlines(at, ends[:, 0], ends[:, 1], color=INK, linewidth=1, gid=name)
        for k, flight in enumerate(strut.flights):
            label = name if k == 0 else ""
            ax.plot(at[k : k + 1], values[k : k + 1], label=label, gid=name, url=str(find_page(flight.result)), **dot)
        for number, change in enumerate(strut.changes):
            text = format_minus(f"{100 * (change.fraction.value or 0.0):+.1f} %")
            ax.axvline(at[change.first], color=VERMILION, linewidth=1, label="change" if number == 0 else "")
            ax.annotate(
                text, (at[change.first], 0.97), (4, 0), ("data", "axes fraction"), "offset points", va="top", fontsize=9
            )
        _format_dates(ax)
        ax.set_ylabel(f"{series.quantity.label.split(' (')[0]} [{format_units(series.quantity.unit)}]")
        ax.set_title(f"{_say_quantity(series)} of {strut.tail or 'the aircraft'}")
        ax.legend(loc="best", fontsize=9)
    return ax


def _say_quantity(series: FleetSeries) -> str:
    quantity = series.quantity
    return quantity.label[:1].upper() + quantity.label[1:] + (f", {quantity.gear}" if quantity.gear else "")


def _find_departure(flight: StrutFlight) -> float:
    """The logarithm of a value over what was expected; 0 for a flight that is not judged."""
    if flight.expected.value is None or flight.estimate.value is None:
        return 0.0
    return float(np.log(flight.estimate.value / flight.expected.value))


def _find_latest_level(strut: Strut) -> float:
    return abs(float(np.sum([np.log1p(each.fraction.value or 0.0) for each in strut.changes])))


def _format_dates(ax: Axes) -> None:
    locator = AutoDateLocator(minticks=3, maxticks=8)
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))
    ax.set_xlabel("date of the flight")


def draw_flight_laws(flights: Mapping[str, Flight], axes: Any = None) -> Axes:
    """Draw the spring and the damper of each suspension of some flights, a row for each suspension.

    Args:
        flights: by the names that their curves get.
        axes: two Axes for each suspension, or None for a new figure.
    """
    gears = list(dict.fromkeys(gear for flight in flights.values() for gear in flight.strut_laws))
    with house_style():
        axes = panels_in_rows(axes, 2 * len(gears), 2, height_in=3.0)
        colors = choose_run_colors(len(flights))
        for (of_spring, of_damper), gear in zip(np.reshape(axes, (-1, 2)), gears, strict=True):
            for (name, flight), color in zip(flights.items(), colors, strict=True):
                strut = flight.strut_laws.get(gear)
                if strut is None:
                    continue
                travel, carried = _compute_spring(strut)
                of_spring.plot(1e3 * travel, carried, color=color, label=name)
                rate, damped = _compute_damper(strut)
                of_damper.plot(rate, damped, color=color, label=name)
            unit = "N/kg" if any(flight.per_mass for flight in flights.values()) else "N"
            of = f": {gear}" if len(gears) > 1 else ""
            of_spring.set(xlabel="travel [mm]", ylabel=f"force [{unit}]", title=f"Spring{of}")
            of_damper.set(xlabel="rate [m/s]", ylabel=f"force [{unit}]", title=f"Damper{of}")
        of_spring.legend()
    return np.reshape(axes, -1)[0]


def _compute_spring(strut: StrutLaw) -> tuple[np.ndarray, np.ndarray]:
    """The force at standstill over the travel of the runs."""
    travel = np.linspace(*strut.travelled_m, _N_POINTS)
    law = strut.law.static_force(travel)[0] if strut.law else 0.0
    return travel, strut.stiffness * travel + law


def _compute_damper(strut: StrutLaw) -> tuple[np.ndarray, np.ndarray]:
    """The force in the position of rest over the rate, without terms that have a memory."""
    most = _RATE_PER_S * max(map(abs, strut.travelled_m))
    rate = np.linspace(-most, most, _N_POINTS)
    terms = tuple(term for term in strut.law.terms if term.kind.memory is None) if strut.law else ()
    return rate, strut.damping * rate + Law(terms).force(0.0, rate)
