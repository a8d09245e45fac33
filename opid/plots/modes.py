"""Figures of linear modes: auto-MAC, mode indicators, responses at the drive point, and shifts with the level."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from opid.errors import list_names
from opid.estimate import format_number, format_percent
from opid.modal.linear.frequency_response import FrequencyResponse, ModeIndicator
from opid.modal.linear.level_shifts import LevelShift
from opid.modal.result import ModalIdentification
from opid.plots.style import (
    BLUE,
    COUNT_MAP,
    GREY,
    INK,
    ORANGE,
    VERMILION,
    choose_run_colors,
    figure_of,
    house_style,
    panels,
    plain_numbers,
    take_axes,
    thicken,
    write_note,
)

MOST_WRITTEN = 10  # with more modes the cells of a matrix have no room for their values
DECADES_SHOWN = 5  # a mode indicator function is shown so far below its highest value


def auto_mac(result: ModalIdentification, ax: Any = None) -> Axes:
    """Draw the modal assurance criterion of the shapes against each other (Figs. 6b and 10b of Pacini).

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.
    """
    n = result.modes.n_modes
    with house_style():
        ax = panels(ax, 1, height_in=4.3, width_in=5.2)[0, 0]
        ax.grid(False)
        edges = (0.5, n + 0.5)
        image = ax.imshow(
            result.auto_mac, origin="lower", vmin=0, vmax=1, cmap=COUNT_MAP, extent=(*edges, *edges), aspect="equal"
        )
        figure_of(ax).colorbar(image, ax=ax, label="MAC", shrink=0.85)
        for (row, column), value in np.ndenumerate(result.auto_mac if n <= MOST_WRITTEN else np.empty((0, 0))):
            ink = INK if value > 0.5 else "white"
            ax.text(column + 1, row + 1, f"{value:.2f}", ha="center", va="center", color=ink, fontsize=8.5)
        ticks = np.arange(1, n + 1, 1 if n <= 30 else 5)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_ticks(ticks, [str(mode) for mode in ticks])
            axis.set_tick_params(labelsize=8.5 if n <= 14 else 7)
        for label in (*ax.get_xticklabels(), *ax.get_yticklabels()):
            if int(label.get_text()) in result.model.laws:
                label.set_color(VERMILION)
                label.set_fontweight("bold")
        ax.set(xlabel="mode (nonlinear ones in red)", ylabel="mode")
        ax.set_title(f"Auto-MAC, condition number {format_number(result.condition_number, 3)}")
    return ax


def mode_indicators(
    measured: Mapping[str, ModeIndicator],
    resynthesised: ModeIndicator,
    *,
    marked: Mapping[int, float] | None = None,
    zoomed: Sequence[int] = (),
    title: str = "Nonlinear modes by number",
    axes: Any = None,
) -> np.ndarray:
    """Draw the largest value of mode indicator functions, measured and of the linear modes (Figs. 6 and 7 of Pacini).

    Args:
        measured: by the name of the test, from the lowest level to the highest; may be empty.
        resynthesised: from the linear modes.
        marked: frequency of modes by their number: dashed lines.
        zoomed: numbers of marked modes that get a panel of their own below.
        title: what the marked modes are.
        axes: 1 + len(zoomed) Axes, or None for a new figure.

    Returns:
        (1 + len(zoomed),) Axes.
    """
    marked = dict(marked or {})
    with house_style():
        flat = np.atleast_1d(np.asarray(_make_panels(len(zoomed)) if axes is None else axes, dtype=object)).ravel()
        take_axes(flat)
        top = float(np.nanmax(resynthesised.value[:, 0]))
        for ax in flat:
            for color, (name, indicator) in zip(_choose_colors(len(measured)), measured.items(), strict=True):
                ax.plot(indicator.frequency_hz, indicator.value[:, 0], color=color, linewidth=0.9, label=name)
            dashed = {"color": INK, "linestyle": "--", "linewidth": 1.0}
            ax.plot(resynthesised.frequency_hz, resynthesised.value[:, 0], label="linear modes", **dashed)
            ax.set_yscale("log")
        whole = flat[0]
        number_modes(whole, marked, linestyle=":", zorder=0)
        whole.set_xlim(float(resynthesised.frequency_hz[0]), float(resynthesised.frequency_hz[-1]))
        least = 0.3 * float(np.nanmin(resynthesised.value[:, 0]))
        whole.set(ylim=(max(top * 10.0**-DECADES_SHOWN, least), 3 * top), ylabel="CMIF [m/s²/N]")
        whole.set_xlabel("frequency [Hz]")
        whole.set_title(title if marked else "Mode indicator", pad=14)
        thicken(whole.legend(loc="lower right", ncols=2))
        for ax, number in zip(flat[1:], zoomed, strict=True):
            _zoom(ax, marked[number], measured, resynthesised)
            ax.set_title(f"mode {number}", fontsize=9)
    return flat


def level_shift_figures(
    shifts: Sequence[LevelShift],
    axes: Any = None,
    *,
    frequency_threshold: float | None = None,
    damping_threshold: float | None = None,
) -> np.ndarray:
    """Draw by how much natural frequency and damping ratio of each mode move from the lowest level to the highest.

    Args:
        shifts: one a mode.
        axes: two Axes, or None for a new figure.
        frequency_threshold: relative shift from which a mode counts as nonlinear: dashed lines; none if left out.
        damping_threshold: likewise of the damping ratio.

    Returns:
        (2, 1) Axes: frequency above, damping below.
    """
    with house_style():
        grid = panels(axes, 2, height_in=4.2, sharex=True)
        thresholds = (frequency_threshold, damping_threshold)
        for ax, name, threshold in zip(grid[:, 0], ("frequency", "damping"), thresholds, strict=True):
            ax.axhline(0, color=INK, linewidth=0.8)
            if threshold is not None:
                for sign, label in ((1, f"threshold {format_percent(threshold, 3)}"), (-1, None)):
                    ax.axhline(sign * 100 * threshold, color=GREY, linestyle="--", linewidth=0.9, label=label)
                ax.legend(loc="best", fontsize=7.5)
            for x, shift in enumerate(shifts):
                estimate = shift.frequency_shift if name == "frequency" else shift.damping_shift
                if estimate.value is None:
                    continue
                color = VERMILION if shift.nonlinear else INK if shift.determined else GREY
                if estimate.interval95 is not None:
                    ax.plot([x, x], [100 * end for end in estimate.interval95], color=color, linewidth=1.2)
                face = color if shift.determined else "white"
                ax.plot([x], [100 * estimate.value], marker="o", markersize=5.5, color=color, markerfacecolor=face)
            ax.set_ylabel(f"{name} shift [%]")
            ax.grid(False, axis="x")
        grid[1, 0].set_xticks(range(len(shifts)), [str(shift.mode) for shift in shifts])
        grid[1, 0].set(xlim=(-0.5, len(shifts) - 0.5), xlabel="mode")
        grid[0, 0].set_title("Nonlinear modes in red, hollow where the levels cannot tell")
    return grid


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
        ax.set(xlim=(float(response.frequency_hz[0]), float(response.frequency_hz[-1])), xlabel="frequency [Hz]")
        ax.set_ylabel("imaginary part [m/s²/N]")
        ax.set_title(f"Response at {response.drive_point}", pad=14)
    return ax


def stage_responses(responses: Mapping[str, FrequencyResponse], marked: Mapping[int, float], ax: Any = None) -> Axes:
    """Draw the size of the response at the drive point at several stages of a campaign (Fig. 11 of Pacini).

    Args:
        responses: by the name of the stage, each with its drive point among its sensors.
        marked: frequency of modes of the first stage, Hz, by their number.
        ax: one Axes, or None for a new figure.
    """
    with house_style():
        ax = panels(ax, 1, height_in=3.8)[0, 0]
        for color, (name, each) in zip(_choose_colors(len(responses)), responses.items(), strict=True):
            size = np.abs(each.value[:, each.sensors.index(each.drive_point)])
            ax.plot(each.frequency_hz, size, color=color, linewidth=1.1, label=name)
        number_modes(ax, marked, zorder=0)
        ends = [(each.frequency_hz[0], each.frequency_hz[-1]) for each in responses.values()]
        ax.set(xlim=(min(low for low, _ in ends), max(high for _, high in ends)), yscale="log", xlabel="frequency [Hz]")
        ax.set_ylabel("size of the response [m/s²/N]")
        drives = list_names(dict.fromkeys(each.drive_point for each in responses.values()))
        ax.set_title(f"Response at {drives}", pad=14)
        legend = ax.legend(loc="lower right")
        thicken(legend)
        for label in legend.get_texts():
            label.set_parse_math(False)  # a name may hold dollar signs
    return ax


def number_modes(ax: Axes, marked: Mapping[int, float], *, own: int | None = None, **line: Any) -> None:
    """Draw a line at the frequency of some modes, with the number of the mode above; the line of `own` is dark."""
    for number, hz in marked.items():
        color, style = (INK, "-") if number == own else (GREY, "--")
        ax.axvline(hz, **{"color": color, "linestyle": style, "linewidth": 0.9, **line})
        above: Any = ("data", "axes fraction")
        write_note(ax, str(number), (hz, 1), (0, 2), xycoords=above, ha="center", fontsize=8, color=color)


def _zoom(ax: Axes, centre_hz: float, measured: Mapping[str, ModeIndicator], made: ModeIndicator) -> None:
    low, high = 0.95 * centre_hz, 1.03 * centre_hz
    ax.set_xlim(low, high)
    every = (*measured.values(), made)
    height = np.concatenate([each.value[(each.frequency_hz >= low) & (each.frequency_hz <= high), 0] for each in every])
    ax.set_ylim(0.7 * float(np.nanquantile(height, 0.02)), 1.5 * float(np.nanmax(height)))
    plain_numbers(ax.yaxis)
    ax.tick_params(labelsize=7.5)
    ax.locator_params(axis="x", nbins=4)


def _make_panels(n_zoomed: int) -> list[Any]:
    """Axes of a new figure: one wide panel, and small ones below it."""
    columns = max(n_zoomed, 1)
    figure = Figure(figsize=(7.4, 3.4 + 2.0 * (n_zoomed > 0)), layout="constrained")
    grid = figure.add_gridspec(1 + (n_zoomed > 0), columns, height_ratios=[1.6, 1][: 1 + (n_zoomed > 0)])
    return [figure.add_subplot(grid[0, :]), *(figure.add_subplot(grid[1, column]) for column in range(n_zoomed))]


def _choose_colors(n: int) -> list[str]:
    return [BLUE, ORANGE, VERMILION][:n] if n <= 3 else choose_run_colors(n)
