"""Figures of health over time: one quantity of all gears, flight by flight, and what was flagged."""

from __future__ import annotations

from datetime import datetime, time
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter, date2num
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Transform, offset_copy

from opid.estimate import format_number
from opid.plots.style import (
    INK,
    choose_run_colors,
    figure_of,
    format_minus,
    format_units,
    house_style,
    panels,
    write_note,
)
from opid.suspensions.flights.comparison import Comparison
from opid.suspensions.flights.departures import Point, Series

# the gears of one flight have the same date, so that they are drawn this many points beside each other
BESIDE = 3.0
# the legend has this many names in a row, and each row is this many points high
IN_A_ROW, ROW_POINTS = 4, 16


def compared_quantity(result: Comparison, label: str, ax: Any = None) -> Axes:
    """Draw one quantity of all gears over date: values with 95 % bars, what was to be expected, and what was flagged.

    Gears of different size share one axis, so each is drawn in percent of what was expected of it at its last flight;
    the legend gives that in its unit. Between the thin lines a flight is not flagged by itself.

    Args:
        result: from `compare`.
        label: of the quantity, as in `Quantity.label`.
        ax: one Axes, or None for a new figure.

    Raises:
        ValueError: no such quantity.
    """
    series = [each for each in result.series if each.quantity.label == label]
    if not series:
        raise ValueError(f"no quantity is called {label!r}")
    positions = _find_positions(result)
    references = [_find_reference(each, result.settings.clear_std) for each in series]
    is_relative = all(reference is not None for reference in references)
    with house_style():
        ax = panels(ax, 1, height_in=3.4)[0, 0]
        for i, (each, reference, color) in enumerate(
            zip(series, references, choose_run_colors(len(series)), strict=True)
        ):
            shift = BESIDE * (i - (len(series) - 1) / 2)
            scale = 100 / abs(reference) if is_relative and reference else 1.0
            name = each.quantity.gear or "all of the body"
            if is_relative and reference:
                name += f": {format_number(reference, 4)} {format_units(each.quantity.unit)}"
            _draw_series(ax, result, each, positions, scale, color, name, shift, is_alone=len(series) == 1)
        _label_dates(ax, result)
        unit = "% of what was expected" if is_relative else format_units(series[0].quantity.unit)
        ax.set_ylabel(f"{label.split(' (')[0]} [{unit}]")
        # names stand between title and axes, where they hide nothing
        rows = -(-len(series) // IN_A_ROW)
        ax.set_title(_format_title(label, series), pad=6 + ROW_POINTS * rows)
        ax.margins(y=0.15)
        close: dict[str, Any] = {"borderaxespad": 0.2, "borderpad": 0.2}
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=min(len(series), IN_A_ROW), **close)
    return ax


def _draw_series(
    ax: Axes,
    result: Comparison,
    series: Series,
    positions: np.ndarray,
    scale: float,
    color: str,
    name: str,
    shift: float,
    *,
    is_alone: bool,
) -> None:
    """Draw one series, its values shifted by some points on paper."""
    beside = offset_copy(ax.transData, figure_of(ax), x=shift, units="points")
    judged = [point for point in series.points if point.limits is not None]
    if judged:
        x = [positions[point.flight] for point in judged]
        low, high = (scale * np.array([point.limits[side] for point in judged if point.limits]) for side in (0, 1))
        # several bands overlap, and filled ones would hide each other: only a single one is filled
        if is_alone:
            ax.fill_between(x, low, high, color=color, alpha=0.10, linewidth=0)
        for edge in (low, high):
            ax.plot(x, edge, color=color, linewidth=0.8, alpha=0.8, marker="_" if len(x) == 1 else None)
        ax.plot(x, [scale * (point.expected or 0.0) for point in judged], color=color, linewidth=1, linestyle="--")
    known = [point for point in series.points if point.estimate.value is not None]
    bars = [point for point in known if point.estimate.interval95 is not None]
    value = np.array([point.estimate.value for point in known], dtype=float)
    # a value without an interval is hollow, for it was not judged
    dot: dict[str, Any] = {"marker": "o", "markersize": 4.5, "linestyle": "none", "transform": beside}
    for point, height in zip(known, scale * value, strict=True):
        face = color if point in bars else "white"
        page = str(result.flights[point.flight].page)
        ax.plot([positions[point.flight]], [height], color=color, markerfacecolor=face, url=page, gid=name, **dot)
    ends = np.array([point.estimate.interval95 for point in bars], dtype=float).reshape(-1, 2)
    at = [positions[point.flight] for point in bars]
    ax.vlines(at, scale * ends[:, 0], scale * ends[:, 1], color=color, label=name, transform=beside)
    # matplotlib does not count shifted points when it chooses the limits of the axes
    ax.update_datalim([(positions[point.flight], height) for point, height in zip(known, scale * value, strict=True)])
    ax.update_datalim(
        [(positions[point.flight], scale * end) for point, both in zip(bars, ends, strict=True) for end in both]
    )
    ax.autoscale_view()
    for point in series.points:
        if point.flagged:
            gear = series.quantity.gear if _is_first(series, point) else None
            _draw_flag(ax, point, positions[point.flight], scale, gear, beside)


def _draw_flag(ax: Axes, point: Point, position: float, scale: float, name: str | None, beside: Transform) -> None:
    """Draw a ring around a flagged value; the first one of a change has the departure beside it."""
    height = scale * (point.estimate.value or 0.0)
    ring: dict[str, Any] = {"marker": "o", "markersize": 10, "markerfacecolor": "none", "linestyle": "none"}
    ax.plot([position], [height], color=INK, transform=beside, **ring)
    if name is not None:
        verdict = {True: "confirmed", False: "not confirmed", None: "next flight awaited"}[point.confirmed]
        is_up = (point.departure or 0.0) > 0
        text = f"{name}{': ' * bool(name)}" + format_minus(f"{point.departure:+.1f} std, {verdict}")
        shift, side = ((-5, 9), "bottom") if is_up else ((-5, -9), "top")
        write_note(ax, text, (position, height), shift, xycoords=beside, ha="right", va=side, fontsize=8)


def _is_first(series: Series, point: Point) -> bool:
    """Whether the flight before it is not flagged to the same side."""
    before = [each for each in series.points if each.flight < point.flight and each.departure is not None]
    return not (before and before[-1].flagged and before[-1].confirmed)


def _find_reference(series: Series, clear_std: float) -> float | None:
    """The value that was expected last, if it is clearly not zero."""
    judged = [point for point in series.points if point.expected is not None and point.std is not None]
    if not judged:
        known = [point.estimate.value for point in series.points if point.estimate.value]
        return known[0] if known else None
    last = judged[-1]
    return last.expected if abs(last.expected or 0.0) > clear_std * (last.std or 0.0) else None


def _find_positions(result: Comparison) -> np.ndarray:
    if not result.dated:
        return np.arange(1.0, len(result.flights) + 1)
    days = [flight.date for flight in result.flights if flight.date is not None]
    return np.array([date2num(datetime.combine(day, time())) for day in days])


def _label_dates(ax: Axes, result: Comparison) -> None:
    if result.dated:
        locator = AutoDateLocator(minticks=3, maxticks=8)
        ax.xaxis.set_major_locator(locator)
        ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))
        ax.set_xlabel("date of the flight")
        return
    ax.set_xlabel("flight, in the order given")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))


def _format_title(label: str, series: list[Series]) -> str:
    flagged = [each.quantity.gear or "it is" for each in series if any(point.flagged for point in each.points)]
    text = label[:1].upper() + label[1:]
    return f"{text}: {', '.join(flagged)} flagged" if flagged else f"{text}: nothing flagged"
