"""Figures of the fit of nonlinear modes: the sine beats, restoring forces, frequency and damping, orders."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.mechanics.truth import ModeTruth
from opid.modal.forced.mode_fit import ForceCurve, ModeFit
from opid.modal.result import ModalIdentification
from opid.plots.modal.shapes import number_modes
from opid.plots.style import BLUE, GREEN, INK, PALE, SKY, VERMILION, house_style, panels, plain_numbers, thick

__all__ = ["fourier_amplitude", "modal_orders", "mode_restoring_force", "sine_beats"]

_AMPLITUDE = "\N{SQUARE ROOT}kg"


def sine_beats(result: ModalIdentification, mode: int, axes: Any = None) -> np.ndarray:
    """Draw the tests that a mode was fitted to in its modal coordinate, in time and in frequency.

    Args:
        result: the identification.
        mode: number of the mode, from 1; one that was fitted.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    fit = next(fit for fit in result.fits if fit.mode == mode)
    tests = [test for test in result.tests if test.name in fit.tests]
    # the highest level lies below the others
    tests.sort(key=lambda test: -float(np.abs(test.modal_acceleration(mode)).max()))
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.3, width_in=7.4)
        over_time, over_frequency = grid[0]
        low, high = _around(result, fit)
        for color, test in zip(_levels(len(tests)), tests, strict=True):
            motion = test.modal_acceleration(mode)
            over_time.plot(np.arange(motion.size) / test.fs, motion, color=color, linewidth=0.7, label=test.name)
            frequency, amplitude = fourier_amplitude(motion, test.fs)
            seen = (frequency >= low) & (frequency <= high)
            over_frequency.plot(frequency[seen], amplitude[seen], color=color, linewidth=1.1, label=test.name)
        over_frequency.axvspan(*fit.band_hz, color=PALE, alpha=0.35, linewidth=0, zorder=0, label="fitted band")
        every = enumerate(result.modes.frequency_hz, start=1)
        number_modes(over_frequency, {n: hz for n, hz in every if max(low, 1e-9) <= hz <= high}, own=mode)
        over_frequency.set_yscale("log")
        over_frequency.set_xlim(low, high)
        top = over_frequency.get_ylim()[1]
        over_frequency.set_ylim(top / 3e4, top)
        over_time.set_xlabel("time [s]")
        over_time.set_ylabel(f"modal acceleration [m/s² {_AMPLITUDE}]")
        over_time.set_title(f"Mode {mode}, {len(tests)} tests")
        over_frequency.set_xlabel("frequency [Hz]")
        over_frequency.set_ylabel(f"Fourier amplitude [m/s² {_AMPLITUDE}/Hz]")
        over_frequency.set_title("modes by number", fontweight="normal", pad=14)
        handles, labels = over_frequency.get_legend_handles_labels()
        thick(over_time.legend(handles, labels, loc="upper right", fontsize=7.5, ncols=1 + len(tests) // 6))
    return grid


def mode_restoring_force(fit: ModeFit, axes: Any = None, *, truth: ModeTruth | None = None) -> np.ndarray:
    """Draw the stiffness and the damping force of a mode with its band, and its frequency and damping over amplitude.

    Args:
        fit: of the mode.
        truth: of a simulated test.
        axes: six Axes, or None for a new figure.

    Returns:
        (2, 3) Axes: stiffness above, damping below; whole force, nonlinear part, what it makes of the mode.
    """
    amplitude = fit.stiffness_curve.position
    with house_style():
        grid = panels(axes, 2, 3, height_in=5.2, width_in=8.6)
        _force_row(grid[0], fit.stiffness_curve, f"q [{{}}m {_AMPLITUDE}]", "stiffness force", "k₀ q")
        _force_row(grid[1], fit.damping_curve, f"q′ [{{}}m/s {_AMPLITUDE}]", "damping force", "c₀ q′")
        factor, prefix = _prefix(amplitude)
        for ax, name, scale, values, label in (
            (grid[0, 2], "frequency_hz", 1, fit.frequency_at_hz, "natural frequency [Hz]"),
            (grid[1, 2], "damping_ratio", 100, fit.damping_at, "damping ratio [%]"),
        ):
            linear = scale * getattr(fit, name)
            ax.axhline(linear, color=BLUE, linestyle="--", linewidth=1.1, label="linear, as given")
            ax.plot(factor * amplitude, scale * values, color=VERMILION, linewidth=2.0, label="over amplitude")
            if truth is not None:
                at, known = np.asarray(truth.amplitude), scale * np.asarray(getattr(truth, name))
                shown = at <= 1.02 * amplitude[-1]
                dots = {"color": GREEN, "linewidth": 0, "marker": ".", "markersize": 6}
                ax.plot(factor * at[shown], known[shown], **dots, label="truth, other modes at rest")
            ax.set_xlabel(f"amplitude of q [{prefix}m {_AMPLITUDE}]")
            ax.set_ylabel(label)
            thick(ax.legend(loc="best", fontsize=7.5))
        grid[1, 2].set_ylim(bottom=0)
        grid[0, 0].set_title(f"Mode {fit.mode}: N_s = {fit.stiffness_order}, N_d = {fit.damping_order}")
        grid[0, 1].set_title("nonlinear part, 95 %", fontweight="normal")
    return grid


def modal_orders(fit: ModeFit, ax: Any = None) -> Axes:
    """Draw the misfit that each pair of orders leaves on tests that were left out.

    Args:
        fit: of a mode whose orders were searched.
        ax: one Axes, or None for a new figure.
    """
    rungs = sorted(fit.orders, key=lambda rung: (rung.stiffness_order, rung.damping_order))
    with house_style():
        ax = panels(ax, 1, height_in=1.2 + 0.19 * len(rungs), width_in=5.6)[0, 0]
        for row, rung in enumerate(rungs):
            color = VERMILION if rung.chosen else INK
            error, std = 100 * rung.error, 100 * rung.error_std
            ax.plot([max(error - std, error / 3), error + std], [row, row], color=color, linewidth=1.2)
            ax.plot([error], [row], marker="o", markersize=6, color=color, linestyle="none")
        ax.set_xscale("log")
        plain_numbers(ax.xaxis)
        labels = [f"{rung.stiffness_order}, {rung.damping_order}" for rung in rungs]
        ax.set_yticks(range(len(rungs)), labels)
        for label, rung in zip(ax.get_yticklabels(), rungs, strict=True):
            label.set_color(VERMILION if rung.chosen else INK)
            label.set_fontweight("bold" if rung.chosen else "normal")
        ax.set_ylim(len(rungs) - 0.5, -0.5)
        ax.grid(False, axis="y")
        ax.set_ylabel("N_s, N_d", labelpad=10)
        ax.set_xlabel("misfit where left out [% of the modal force]")
        ax.set_title(f"Mode {fit.mode}: orders tried")
    return ax


def fourier_amplitude(samples: np.ndarray, fs: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the lines of a transient record and its Fourier amplitude |X| there, the unit of the samples per Hz.

    Args:
        samples: (n,) a record that begins and ends at rest.
        fs: sampling rate, Hz.

    >>> frequency, amplitude = fourier_amplitude(np.r_[1.0, np.zeros(7)], 4.0)
    >>> frequency.tolist(), amplitude.tolist()
    ([0.0, 0.5, 1.0, 1.5, 2.0], [0.25, 0.25, 0.25, 0.25, 0.25])
    """
    return np.fft.rfftfreq(samples.size, 1 / fs), np.abs(np.fft.rfft(samples)) / fs


def _force_row(row: np.ndarray, curve: ForceCurve, along: str, name: str, symbol: str) -> None:
    """The whole force beside the linear one, and the nonlinear part alone, with their band."""
    factor, prefix = _prefix(curve.position)
    x = factor * curve.position
    whole, part = row[0], row[1]
    for ax, base in ((whole, curve.linear), (part, 0.0 * curve.linear)):
        ax.fill_between(x, base + curve.low, base + curve.high, color=VERMILION, alpha=0.25, linewidth=0)
        ax.plot(x, base, color=BLUE, linestyle="--", linewidth=1.1, label=f"linear, {symbol}")
        ax.plot(x, base + curve.force, color=VERMILION, linewidth=1.8, label="with nonlinear part")
        ax.set_xlabel(along.format(prefix))
    whole.set_ylabel(f"{name} [N/{_AMPLITUDE}]")
    thick(whole.legend(loc="upper left", fontsize=7.5))


def _levels(n: int) -> list[Any]:
    """One colour a level, the highest first: pale below, dark above."""
    if n <= 3:
        return [SKY, BLUE, INK][:n]
    from matplotlib import colormaps

    return [colormaps["viridis"](0.85 * (1 - level / (n - 1))) for level in range(n)]


def _around(result: ModalIdentification, fit: ModeFit) -> tuple[float, float]:
    """A range of frequency with the fitted band and both neighbours in it."""
    below, above = result.modes.neighbours_hz(fit.mode)
    width = fit.band_hz[1] - fit.band_hz[0]
    low = max(below, fit.frequency_hz - 4 * width) if below else fit.band_hz[0]
    high = min(above, fit.frequency_hz + 4 * width) if np.isfinite(above) else fit.band_hz[1]
    room = 0.15 * (max(high, fit.band_hz[1]) - min(low, fit.band_hz[0]))
    return max(min(low, fit.band_hz[0]) - room, 0.0), max(high, fit.band_hz[1]) + room


def _prefix(values: np.ndarray) -> tuple[float, str]:
    """A factor and the prefix of the unit that make values easy to read."""
    largest = float(np.abs(values).max())
    for factor, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ")):
        if largest * factor >= 1:
            return factor, prefix
    return 1e9, "n"
