"""Figures of truth tests: measured, nonlinear and linear model side by side in time and in frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.modal.model import TruthTest
from opid.plots.modal.fits import fourier_amplitude
from opid.plots.style import BLUE, GREY, INK, VERMILION, house_style, panels, plain_numbers, thick

__all__ = ["truth_test", "truth_test_figures"]

# periods of the strongest line on either side of the largest acceleration
N_PERIODS = 5
# samples to either side of the peak in which its period is looked for
AROUND = 256
# height of the panel at the peak, in peaks of measurement and nonlinear model
ROOM = 2.0
# the spectrum is shown down to this fraction of its peak
LEAST_SHOWN = 1e-4
# points of a curve that stand for many samples or lines, and the fewest that still show its shape
N_CRESTS = 400
LEAST_CRESTS = 40


def truth_test(
    test: TruthTest, *, sensors: Sequence[str], nonlinear_hz: Sequence[float] = (), axes: Any = None
) -> np.ndarray:
    """Draw a truth test: acceleration over time, near its peak, and over frequency (Figs. 8 and 12 of Pacini).

    Args:
        test: the truth test.
        sensors: those to draw, one row each.
        nonlinear_hz: natural frequencies of the nonlinear modes, dashed lines.
        axes: three Axes a sensor, or None for a new figure.

    Returns:
        (n_sensors, 3) Axes.
    """
    with house_style():
        grid = panels(axes, len(sensors), 3, height_in=0.6 + 2.4 * len(sensors), width_in=9.4)
        for row, sensor in zip(grid, sensors, strict=True):
            _sensor(row, test, sensor, nonlinear_hz)
            row[0].set_ylabel("acceleration [m/s²]")
            row[0].set_title(sensor)
            figures = test.sensors[sensor]
            peak = f"peak ×{figures.peak_ratio_nonlinear:.2f}, linear ×{figures.peak_ratio_linear:.2f}"
            error = f"error {100 * figures.nrmse_nonlinear:.3g} %, linear {100 * figures.nrmse_linear:.3g} %"
            for ax, title in ((row[1], peak), (row[2], error)):
                ax.set_title(title, fontweight="normal", fontsize=9)
        thick(grid[0, 0].legend(loc="upper right", fontsize=7.5))
        for ax, label in zip(grid[-1], ("time [s]", "time [s], at the peak", "frequency [Hz]"), strict=True):
            ax.set_xlabel(label)
    return grid


def truth_test_figures(test: TruthTest, ax: Any = None) -> Axes:
    """Draw the errors of both models at every sensor of a truth test.

    Args:
        test: the truth test.
        ax: one Axes, or None for a new figure.
    """
    names = list(test.sensors)
    with house_style():
        ax = panels(ax, 1, height_in=3.0)[0, 0]
        for color, marker, label, values in (
            (BLUE, "s", "linear model", [100 * test.sensors[name].nrmse_linear for name in names]),
            (VERMILION, "o", "nonlinear model", [100 * test.sensors[name].nrmse_nonlinear for name in names]),
        ):
            ax.plot(range(len(names)), values, color=color, marker=marker, markersize=5, linestyle="none", label=label)
        ax.set_yscale("log")
        plain_numbers(ax.yaxis)
        ax.set_xticks(
            range(len(names)), names, rotation=90 if len(names) > 8 else 0, fontsize=8 if len(names) <= 30 else 6
        )
        ax.set_xlabel("sensor")
        ax.set_ylabel("rms error [% of measured rms]")
        ax.set_title(f"Truth test {test.name!r}")
        ax.grid(False, axis="x")
        thick(ax.legend(loc="best"))
    return ax


def _sensor(row: np.ndarray, test: TruthTest, sensor: str, nonlinear_hz: Sequence[float]) -> None:
    whole, near, spectrum = row
    fs = test.measured.fs
    measured = test.measured.channel(sensor)
    # measured on the paper in black, nonlinear in red, linear in blue; the linear one, often the largest, lies below
    series = (
        (test.linear.channel(sensor), BLUE, "linear", 1),
        (measured, INK, "measured", 2),
        (test.nonlinear.channel(sensor), VERMILION, "nonlinear", 3),
    )
    time = test.measured.time_s
    peak = int(np.abs(measured).argmax())
    reach = _reach(measured, peak)
    close = slice(max(peak - reach, 0), peak + reach + 1)
    for values, color, label, order in series:
        settings: dict[str, Any] = {"color": color, "label": label, "zorder": order}
        # two curves that agree are told apart as a thin line on a broad one
        broad = label == "measured"
        _whole(whole, time, values, 2 * reach // N_PERIODS, settings)
        near.plot(time[close], values[close], linewidth=2.6 if broad else 1.1, **settings)
        lines, height = fourier_amplitude(values - values.mean(), fs)
        shown = _thin_lines(lines, test.band_hz, height)
        spectrum.plot(
            *_crests(lines[shown], height[shown]),
            linewidth=2.2 if broad else 0.9,
            alpha=0.5 if broad else 1,
            **settings,
        )
    for hz in nonlinear_hz:
        spectrum.axvline(hz, color=GREY, linestyle="--", linewidth=0.8, zorder=0)
    spectrum.set_yscale("log")
    top = float(fourier_amplitude(measured - measured.mean(), fs)[1].max())
    spectrum.set_ylim(LEAST_SHOWN * top, 4 * top)
    spectrum.set_ylabel("Fourier amplitude [m/s²/Hz]", fontsize=8.5)
    # a linear model that overshoots by far would flatten the other two
    highest = ROOM * max(float(np.abs(values[close]).max()) for values in (measured, test.nonlinear.channel(sensor)))
    near.set_ylim(max(near.get_ylim()[0], -highest), min(near.get_ylim()[1], highest))
    near.locator_params(axis="x", nbins=5)


def _whole(ax: Axes, time: np.ndarray, values: np.ndarray, least: int, settings: dict[str, Any]) -> None:
    """Draw all of a record; of many periods only how far they go, the measured ones as an area, models as lines."""
    size = max(values.size // N_CRESTS, least)
    n = values.size // size
    if n < LEAST_CRESTS:
        ax.plot(time, values, linewidth=0.6, alpha=0.9, **settings)
        return
    blocks = values[: n * size].reshape(n, size)
    middle = time[size // 2 : n * size : size]
    low, high = blocks.min(axis=1), blocks.max(axis=1)
    if settings["label"] == "measured":
        ax.fill_between(middle, low, high, alpha=0.45, linewidth=0, **settings | {"zorder": 0.5})
        return
    for label, edge in ((settings["label"], high), (None, low)):
        ax.plot(middle, edge, linewidth=1.0, **settings | {"label": label})


def _crests(frequency: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The highest of some neighbouring lines where there are many: noise is then a line, and no block."""
    size = frequency.size // N_CRESTS
    if size < 2:
        return frequency, height
    blocks = height[: size * N_CRESTS].reshape(N_CRESTS, size)
    crests = size * np.arange(N_CRESTS) + blocks.argmax(axis=1)
    return frequency[crests], height[crests]


def _reach(measured: np.ndarray, peak: int) -> int:
    """Samples to either side of the peak that hold some periods of what is strongest there."""
    near = measured[max(peak - AROUND, 0) : peak + AROUND]
    height = np.abs(np.fft.rfft(near * np.hanning(near.size)))
    strongest = max(int(height[1:].argmax()) + 1, 2)
    return max(8, round(N_PERIODS * near.size / strongest))


def _thin_lines(frequency: np.ndarray, band_hz: tuple[float, float] | None, height: np.ndarray) -> np.ndarray:
    """Lines in the compared band; all that stand out where nothing limits it."""
    if band_hz is not None:
        return (frequency > 0) & (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    loud = np.flatnonzero(height > LEAST_SHOWN * height.max())
    return (frequency > 0) & (frequency <= frequency[loud[-1]])
