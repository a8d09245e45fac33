"""Figures of forces that no sensor measured: virtual sensors with bands, their cycles, and the force through a tyre."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import chi2

from opid.errors import InputError
from opid.plots.style import (
    BLUE,
    INK,
    VERMILION,
    format_units,
    house_style,
    panels,
    panels_in_rows,
    plain_numbers,
    thicken,
)
from opid.suspensions.sensing.result import Sensing, VirtualSensor
from opid.suspensions.wheel.result import WheelIdentification

# seconds that a figure shows, about the largest force
_SHOWN_S = 4.0
_FACTORS = {"m": (1e3, "mm"), "N": (1e-3, "kN")}
_WORDS = {
    "strut_force": "strut force",
    "strut_load": "strut load",
    "tyre_force": "tyre force",
    "travel": "travel",
    "travel_velocity": "rate of travel",
    "acceleration": "acceleration",
    "velocity": "velocity",
}


def sensed_histories(result: Sensing, place: str, axes: Any = None) -> np.ndarray:
    """Draw the virtual sensors of an interface or a place over time, with 95 % bands, about the largest force.

    Args:
        result: virtual sensors along a record.
        place: name of the interface or the place; empty for one gear.
        axes: an Axes for each virtual sensor of the place, or None for a new figure.

    Returns:
        (n_sensors, 1) Axes.
    """
    sensors = [each for each in result.sensors if each.place == place]
    shown = _choose_samples(result)
    time_s = result.start_s + np.arange(len(result.sensors[0].value)) / result.fs
    with house_style():
        grid = panels(axes, len(sensors), 1, height_in=1.55 * len(sensors) + 0.4, sharex=True)
        for ax, sensor in zip(grid[:, 0], sensors, strict=True):
            factor, unit = _FACTORS.get(sensor.unit, (1.0, sensor.unit))
            value, half = factor * sensor.value[shown], factor * result.settings.band_std * sensor.std[shown]
            ax.fill_between(time_s[shown], value - half, value + half, color=BLUE, alpha=0.35, linewidth=0)
            ax.plot(time_s[shown], value, color=BLUE, linewidth=1.1)
            ax.set_ylabel(format_units(f"[{unit}]"))
            ax.set_title(_WORDS[sensor.quantity])
        grid[-1, 0].set_xlabel("time [s]")
    return grid


def rainflow_cycles(result: Sensing, axes: Any = None) -> np.ndarray:
    """Draw how many cycles of each strut force exceed a range, with their standard deviation.

    Args:
        result: virtual sensors along a record.
        axes: an Axes for each interface, or None for a new figure.

    Returns:
        (1, n_interfaces) Axes.
    """
    unit = "m/s^2" if result.per_mass else "N"
    factor, unit = _FACTORS.get(unit, (1.0, unit))
    with house_style():
        grid = panels(axes, 1, len(result.rainflow), height_in=3.2, sharey=True)
        for ax, counted in zip(grid[0], result.rainflow, strict=True):
            low = factor * counted.edges_n[:-1]
            exceeding = np.cumsum(counted.cycles[::-1])[::-1]
            std = np.sqrt(np.cumsum(counted.std[::-1] ** 2)[::-1])
            ax.errorbar(low, exceeding, yerr=1.96 * std, color=BLUE, ecolor=INK, elinewidth=0.8, drawstyle="steps-post",
                        label="cycles of a larger range")  # fmt: skip
            ax.axvline(
                factor * counted.least_range_n, color=VERMILION, linestyle="--", linewidth=1, label="width of the band"
            )
            ax.set_yscale("log")
            ax.set_ylim(0.4, 2.5 * float(exceeding.max()))
            ax.set_xlabel(format_units(f"range of the force [{unit}]"))
            ax.set_title(counted.place or "strut")
        grid[0, 0].set_ylabel("cycles")
        thicken(grid[0, 0].legend(loc="upper right"))
    return grid


def force_spectra(result: WheelIdentification, axes: Any = None) -> np.ndarray:
    """Draw the spectrum of the rate of the force through the tyre of each run, and that of the fitted road and tyre.

    The band holds 95 % of the measured lines if the fit is right.

    Args:
        result: wheel, tyre and road.
        axes: one Axes for each run, or None for a new figure.

    Returns:
        (n_rows, n_columns) Axes.

    Raises:
        InputError: nothing is determined.
    """
    if result.not_determined:
        raise InputError(f"there is no spectrum to draw: {result.not_determined}")
    unit = "1/s^4" if result.per_mass else "N^2/s^2/Hz"
    with house_style():
        grid = panels_in_rows(axes, len(result.roads), min(2, len(result.roads)), height_in=3.2)
        for ax, road in zip(grid.ravel(), result.roads, strict=False):
            # Blocks overlap by half, and share almost nothing under their windows.
            low, high = (chi2.ppf(each, 2 * road.n_blocks) / (2 * road.n_blocks) for each in (0.025, 0.975))
            ax.fill_between(
                road.frequency_hz, low * road.fitted, high * road.fitted, color=BLUE, alpha=0.25, linewidth=0
            )
            ax.plot(road.frequency_hz, road.measured, color=INK, linewidth=0.8, label="measured")
            ax.plot(road.frequency_hz, road.fitted, color=BLUE, linewidth=1.4, label="fitted")
            ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", title=road.run)
            plain_numbers(ax.xaxis)
        grid[0, 0].set_ylabel(format_units(f"rate of the force [{unit}]"))
        grid[0, 0].legend()
    return grid


def _choose_samples(result: Sensing) -> slice:
    """Return the samples about the largest strut force."""
    forces = [each for each in result.sensors if each.quantity == "strut_force"]
    largest: VirtualSensor = max(forces, key=lambda each: float(np.abs(each.value).max()))
    middle, half = int(np.argmax(np.abs(largest.value))), round(0.5 * _SHOWN_S * result.fs)
    first = max(0, min(middle - half, len(largest.value) - 2 * half))
    return slice(first, first + 2 * half)
