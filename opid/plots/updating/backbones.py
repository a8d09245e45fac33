"""Figures of backbones: measured at several sensors, and predicted with their bands (Figs. 4, 5, 11, 12 of Song)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from opid.errors import InputError
from opid.plots.style import BLUE, INK, VERMILION, house_style, panels, thick
from opid.updating.measured import MeasuredBackbone
from opid.updating.result import BackboneBand

__all__ = ["measured_backbones", "predicted_backbones"]

_COLUMNS = 3


def measured_backbones(
    measured: Sequence[MeasuredBackbone], mode: int, *, sensors: Sequence[str], axes: Any = None
) -> np.ndarray:
    """Draw the amplitude of some sensors over the frequency of phase resonance, all curves of a mode in one panel.

    Args:
        measured: the backbones, of all modes.
        mode: number of the mode, from 1.
        sensors: one panel each.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of three; those without a sensor are empty.

    Raises:
        InputError: no backbone of that mode.
    """
    curves = _of_mode(measured, mode)
    with house_style():
        grid = _grid(len(sensors), axes)
        for ax, sensor in zip(grid.ravel(), sensors, strict=False):
            factor, unit = _length_unit(_largest(curves, sensor))
            for curve in (curve for curve in curves if sensor in curve.sensors):
                ax.plot(
                    curve.frequency_hz, factor * np.abs(_at(curve, sensor)),
                    color=BLUE, linewidth=0.9, alpha=0.75, marker=".", markersize=3.5,
                )  # fmt: skip
            _label_axes(ax, sensor, unit)
        grid[0, 0].annotate(
            f"mode {mode}, {len(curves)} curve{'s' * (len(curves) > 1)}", (0.04, 0.93), xycoords="axes fraction",
            fontsize=8, va="top",
        )  # fmt: skip
    return grid


def predicted_backbones(
    bands: Sequence[BackboneBand], measured: Sequence[MeasuredBackbone], mode: int, axes: Any = None
) -> np.ndarray:
    """Draw the predicted backbones of a mode with their 95 % bands over the measured points.

    Args:
        bands: the prediction, of all modes and sensors; one panel for each of this mode. A band breaks off where its
            frequencies are nan.
        measured: the backbones, of all modes.
        mode: number of the mode, from 1.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of three; those without a band are empty.

    Raises:
        InputError: no band of that mode.
    """
    own = [band for band in bands if band.mode == mode]
    if not own:
        raise InputError(f"no backbone of mode {mode} was predicted: there are {sorted({b.mode for b in bands})}")
    curves = [curve for curve in measured if curve.mode == mode]
    with house_style():
        grid = _grid(len(own), axes)
        for ax, band in zip(grid.ravel(), own, strict=False):
            factor, unit = _length_unit(max(float(band.amplitude.max()), _largest(curves, band.sensor)))
            height = factor * band.amplitude
            ax.fill_betweenx(
                height, band.low_hz, band.high_hz, color=VERMILION, alpha=0.22, linewidth=0, label="95 % band"
            )
            ax.plot(band.frequency_hz, height, color=VERMILION, label="predicted")
            for number, curve in enumerate(curve for curve in curves if band.sensor in curve.sensors):
                ax.plot(
                    curve.frequency_hz, factor * np.abs(_at(curve, band.sensor)),
                    color=INK, linestyle="none", marker=".", markersize=3, alpha=0.6,
                    label="measured" if number == 0 else None,
                )  # fmt: skip
            _label_axes(ax, band.sensor, unit)
            if np.isfinite(band.coverage):
                ax.set_title(f"sensor {band.sensor}: {100 * band.coverage:.0f} % within")
        thick(grid[0, 0].legend(loc="upper left", fontsize=7.5, title=f"mode {mode}", title_fontsize=8))
    return grid


def _of_mode(measured: Sequence[MeasuredBackbone], mode: int) -> list[MeasuredBackbone]:
    curves = [curve for curve in measured if curve.mode == mode]
    if not curves:
        raise InputError(f"no backbone of mode {mode} was measured: there are {sorted({c.mode for c in measured})}")
    return curves


def _grid(n: int, axes: Any) -> np.ndarray:
    """Rows of three panels; those beyond the last one are empty."""
    columns = min(n, _COLUMNS)
    rows = -(-n // columns)
    if axes is not None:
        return panels(axes, 1, n, height_in=3.0)
    grid = panels(None, rows, columns, height_in=0.5 + (2.5 if columns > 1 else 3.0) * rows)
    for ax in grid.ravel()[n:]:
        ax.set_axis_off()
    return grid


def _at(curve: MeasuredBackbone, sensor: str) -> np.ndarray:
    return curve.amplitude[:, curve.sensors.index(sensor)]


def _largest(curves: Sequence[MeasuredBackbone], sensor: str) -> float:
    return max((float(np.abs(_at(curve, sensor)).max()) for curve in curves if sensor in curve.sensors), default=0.0)


def _length_unit(largest: float) -> tuple[float, str]:
    """What metres are multiplied by to be numbers that one reads, and the unit then."""
    if largest >= 1:
        return 1.0, "m"
    return (1e3, "mm") if largest >= 2e-5 else (1e6, "µm")


def _label_axes(ax: Axes, sensor: str, unit: str) -> None:
    ax.set_title(f"sensor {sensor}")
    ax.set_xlabel("frequency [Hz]")
    ax.set_ylabel(f"amplitude [{unit}]")
    ax.set_ylim(bottom=0)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5))
