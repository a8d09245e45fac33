"""Figures of a force appropriation and of the interaction of modes that it shows (Fig. 13 of Pacini)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from opid.modal.linear.frequency_response import FrequencyResponse
from opid.modal.resonance.appropriation import Appropriation, Interaction
from opid.plots.modal.shapes import number_modes
from opid.plots.style import BLUE, GREY, INK, RUN_COLORS, VERMILION, house_style, panels, thick

__all__ = ["backbone", "drive_point_response", "harmonic_shape", "modal_harmonics", "sensor_harmonics"]

# curves of modal harmonics at most
N_SHOWN = 6


def backbone(appropriation: Appropriation, axes: Any = None) -> np.ndarray:
    """Draw frequency and damping ratio of phase resonance over the amplitude of the mode.

    Args:
        appropriation: all levels; those that did not lock are hollow.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    amplitude = 1e6 * appropriation.amplitude
    index = appropriation.modes.index(appropriation.mode)
    linear = (appropriation.modes.frequency_hz[index], 100 * appropriation.modes.damping_ratio[index])
    found, locked = (appropriation.frequency_hz, 100 * appropriation.damping_ratio), appropriation.locked
    dots: dict[str, Any] = {"color": VERMILION, "linestyle": "none", "marker": "o", "markersize": 4}
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.3)
        labels = ("frequency at phase resonance [Hz]", "damping ratio [%]")
        for ax, values, low, label in zip(grid[0], found, linear, labels, strict=True):
            ax.axhline(low, color=BLUE, linestyle="--", linewidth=1.1, label="linear")
            for word, shown, face in (("locked", locked, VERMILION), ("not locked", ~locked, "white")):
                if shown.any() or shown is locked:
                    ax.plot(amplitude[shown], values[shown], **dots, markerfacecolor=face, label=word)
            ax.set_xlabel("amplitude of q [µm √kg]")
            ax.set_ylabel(label)
        grid[0, 0].set_title(f"Mode {appropriation.mode}: {int(locked.sum())} of {locked.size} levels locked")
        thick(grid[0, 0].legend(loc="best"))
    return grid


def sensor_harmonics(appropriation: Appropriation, sensor: str, ax: Any = None) -> Axes:
    """Draw the harmonics of a sensor over the level, the even ones dashed (Fig. 13a of Pacini).

    Args:
        appropriation: all levels.
        sensor: its name.
        ax: one Axes, or None for a new figure.

    Raises:
        InputError: no such sensor.
    """
    appropriation.modes.row(sensor)
    heights = np.abs(appropriation.sensors[:, appropriation.modes.sensors.index(sensor)])
    with house_style():
        ax = panels(ax, 1, height_in=3.3, width_in=5.2)[0, 0]
        for harmonic, (color, values) in enumerate(zip(RUN_COLORS, heights.T, strict=False), start=1):
            style = "--" if harmonic % 2 == 0 else "-"
            ax.plot(np.arange(1, len(heights) + 1), values, color=color, linestyle=style, label=f"harmonic {harmonic}")
        ax.set_yscale("log")
        ax.set_ylim(bottom=max(1e-6 * float(heights.max()), 0.5 * float(heights[heights > 0].min())))
        _over_levels(ax)
        ax.set_ylabel("acceleration [m/s²]")
        ax.set_title(f"Harmonics at {sensor}")
        thick(ax.legend(loc="best", fontsize=7.5, ncols=2))
    return ax


def modal_harmonics(interaction: Interaction, ax: Any = None) -> Axes:
    """Draw the modal harmonics that anywhere exceed the wanted fraction of the target's fundamental (Pacini Fig. 13b).

    Args:
        interaction: what the appropriation shows.
        ax: one Axes, or None for a new figure.
    """
    fractions = interaction.fractions.copy()
    fractions[:, interaction.target - 1, 0] = 0.0
    largest = fractions.max(axis=0)
    order = np.argsort(-largest, axis=None)[:N_SHOWN]
    highest = list(zip(*np.unravel_index(order, largest.shape), strict=True))
    index = np.arange(1, len(fractions) + 1)
    with house_style():
        ax = panels(ax, 1, height_in=3.3, width_in=5.2)[0, 0]
        ax.axhline(1.0, color=INK, linewidth=1.4, label=f"mode {interaction.target}, harmonic 1")
        shown = [each for each in highest if largest[each] > interaction.least_fraction] or highest[:1]
        for color, (mode, harmonic) in zip(RUN_COLORS, shown, strict=False):
            label = f"mode {mode + 1}, harmonic {harmonic + 1}"
            ax.plot(index, fractions[:, mode, harmonic], color=color, label=label)
        ax.axhline(interaction.least_fraction, color=GREY, linestyle="--", linewidth=1.0, label="fraction asked for")
        ax.set_ylim(bottom=0)
        _over_levels(ax)
        ax.set_ylabel("fraction of the fundamental")
        ax.set_title("Interaction" if interaction.flagged else "No interaction")
        thick(ax.legend(loc="best", fontsize=7.5))
    return ax


def harmonic_shape(interaction: Interaction, ax: Any = None) -> Axes:
    """Draw the MAC of a harmonic's deflection shape with the shapes of the mode and of others (Fig. 13c of Pacini).

    Args:
        interaction: what the appropriation shows.
        ax: one Axes, or None for a new figure.
    """
    index = np.arange(1, interaction.mac.size + 1)
    with house_style():
        ax = panels(ax, 1, height_in=3.3, width_in=5.2)[0, 0]
        ax.plot(index, interaction.mac, color=VERMILION, label=f"mode {interaction.mode}")
        ax.plot(index, interaction.mac_of_others, color=GREY, label="any other mode, at most")
        ax.axhline(interaction.least_assurance, color=INK, linestyle="--", linewidth=1.0, label="asked for")
        ax.set_ylim(0, 1.05)
        _over_levels(ax)
        ax.set_ylabel("MAC")
        ax.set_title(f"Shape of harmonic {interaction.harmonic}")
        thick(ax.legend(loc="best", fontsize=7.5))
    return ax


def drive_point_response(response: FrequencyResponse, marked: Mapping[int, float], ax: Any = None) -> Axes:
    """Draw the imaginary part of the drive-point response with some modes marked (Fig. 13d of Pacini).

    Args:
        response: with the drive point among its sensors.
        marked: frequency of modes, Hz, by their number.
        ax: one Axes, or None for a new figure.
    """
    imaginary = response.value[:, response.sensors.index(response.drive_point)].imag
    with house_style():
        ax = panels(ax, 1, height_in=3.3, width_in=5.2)[0, 0]
        ax.plot(response.frequency_hz, imaginary, color=BLUE, linewidth=1.1)
        number_modes(ax, marked, zorder=0)
        ax.set_xlim(float(response.frequency_hz[0]), float(response.frequency_hz[-1]))
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylabel("imaginary part [m/s²/N]")
        ax.set_title(f"Response at {response.drive_point}", pad=14)
    return ax


def _over_levels(ax: Axes) -> None:
    """Levels are counted: no ticks between them."""
    ax.set_xlabel("excitation index")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
