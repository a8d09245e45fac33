"""Figures of what was recorded, and of what double integration makes of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.plots.style import GREY, INK, PALE, RUN_COLORS, house_style, panels, pretty, run_colors, run_title, thick
from opid.signals.recording import Recording
from opid.signals.spectra import cross_spectra
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.result import AnyIdentification

__all__ = ["accelerations", "integration", "recording"]


def accelerations(result: AnyIdentification, axes: Any = None) -> np.ndarray:
    """Draw the acceleration of the spindle and of the airframe, one panel a run.

    Args:
        result: the identification.
        axes: one Axes a run, or None for a new figure.

    Returns:
        (n_runs, 1) Axes.
    """
    runs = result.study.runs
    with house_style():
        grid = panels(axes, len(runs), height_in=0.6 + 1.9 * len(runs), sharex=True, sharey=True)
        for ax, run, color in zip(grid[:, 0], runs, run_colors(len(runs)), strict=True):
            for samples, shade, width, name in (
                (run.recording.channel(result.study.unsprung), PALE, 0.5, "spindle (unsprung)"),
                (run.recording.channel(result.study.sprung), color, 0.7, "airframe (sprung)"),
            ):
                label = f"{name}, {np.std(samples):.2f} m/s² rms"
                ax.plot(run.recording.time_s, samples - np.mean(samples), color=shade, linewidth=width, label=label)
            ax.set_title(run_title(run))
            ax.set_ylabel("acceleration − mean [m/s²]")
            ax.margins(x=0)
            thick(ax.legend(loc="upper right", ncols=2))
        grid[-1, 0].set_xlabel("time [s]")
    return grid


def integration(run: RunEvidence, axes: Any = None) -> np.ndarray:
    """Draw the relative displacement by the paper's literal recipe against sound integration.

    Above both on one scale, below the sound one alone: mean removal before each integration leaves a parabola that
    hides the motion (see `opid.signals.motion`).

    Args:
        run: one run of the evidence.
        axes: two Axes, or None for a new figure.

    Returns:
        (2, 1) Axes.
    """
    literal, sound = run.motion_mean_removed, run.motion
    inside = sound.interior
    with house_style():
        grid = panels(axes, 2, height_in=4.2, sharex=True, height_ratios=[3, 2])
        above, below = grid[:, 0]
        for ax in (above, below):
            if ax is above:
                label = f"mean removed before each integration, {_rms_mm(literal.displacement)} rms"
                ax.plot(run.time_s, 1e3 * literal.displacement, color=RUN_COLORS[1], label=label)
            label = f"band above {sound.high_pass_hz:g} Hz, {_rms_mm(sound.displacement[inside])} rms"
            ax.plot(
                run.time_s[inside], 1e3 * sound.displacement[inside], color=RUN_COLORS[0], linewidth=0.7, label=label
            )
            ax.set_ylabel("travel z [mm]")
            ax.margins(x=0.01)
        above.set_title(f"Relative displacement z = x₂ − x₁ of run {run.name!r}, integrated twice")
        thick(above.legend(loc="best"))
        below.set_title("The same, the sound integration alone")
        below.set_xlabel("time [s]")
    return grid


def recording(run: Recording, axes: Any = None) -> np.ndarray:
    """Draw time history and power spectral density of every channel of a recording.

    Args:
        run: the recording.
        axes: (n_channels, 2) Axes, or None for a new figure.

    Returns:
        (n_channels, 2) Axes.
    """
    with house_style():
        n_channels = len(run.channels)
        grid = panels(axes, n_channels, 2, height_in=0.7 + 1.9 * n_channels, sharex="col", width_ratios=[3, 2])
        for (time_ax, psd_ax), channel in zip(grid, run.channels, strict=True):
            samples = run.channel(channel.name)
            time_ax.plot(run.time_s, samples, color=RUN_COLORS[0], linewidth=0.6)
            time_ax.set_title(f"{channel.name}, {np.std(samples):.3g} {pretty(channel.unit)} rms")
            time_ax.set_ylabel(f"[{pretty(channel.unit)}]")
            time_ax.margins(x=0)
            _density(psd_ax, samples, run.fs, channel.unit)
        grid[0, 1].set_title("power spectral density")
        grid[-1, 0].set_xlabel("time [s]")
        grid[-1, 1].set_xlabel("frequency [Hz]")
    return grid


def _density(ax: Axes, samples: np.ndarray, fs: float, unit: str) -> None:
    spectra = cross_spectra((samples - samples.mean())[:, np.newaxis], fs=fs)
    frequency_hz, density = spectra.frequency_hz[1:], spectra.density[1:, 0, 0].real
    ax.set_xscale("log")
    ax.set_ylabel(f"[({pretty(unit)})²/Hz]")
    if not np.any(density > 0):
        ax.text(0.5, 0.5, "mute: nothing to show", color=GREY, ha="center", transform=ax.transAxes)
        return
    ax.set_yscale("log")
    ax.plot(frequency_hz, density, color=INK, linewidth=0.8)
    ax.margins(x=0)


def _rms_mm(displacement: np.ndarray) -> str:
    return f"{1e3 * float(np.sqrt(np.mean(displacement**2))):.3g} mm"
