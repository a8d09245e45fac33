"""The figure of a log's health: history with the faults marked, spectrum with the lines named, spectrogram."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from opid.errors import InputError, nearest
from opid.estimate import format_number
from opid.plots.style import (
    BLUE,
    COUNT_MAP,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    figure_of,
    format_minus,
    format_units,
    house_style,
    panels,
    panels_in_rows,
    write_note,
)
from opid.plots.texts import shorten
from opid.signals.health.result import ChannelHealth, Health, Overview, SpectralLine, Stretch

WIDTH_IN = 12.0
KINDS = {
    "gap": ("gap: no samples", GREY),
    "missing": ("missing values", PURPLE),
    "clipped": ("clipped", VERMILION),
    "flat": ("held at one value", ORANGE),
    "spike": ("spike", GREEN),
}
# a health keeps this many stretches of each kind: the record may have more
MOST_STRETCHES = 100
MOST_LABELS = 6
# with this many channels at most, each row has more height
FEW = 6
LONGEST_NAME = 26
# the colours span from the one to the other at most: a value that is held would make the range far too large
LEAST_DB, DEEPEST_DB = 40.0, 90.0


def health_picture(
    health: Health,
    axes: Any = None,
    *,
    channels: Sequence[str] | None = None,
    segment_s: tuple[float, float] | None = None,
) -> np.ndarray:
    """Draw history, power spectral density and spectrogram of each channel, with what is wrong marked.

    The history is the band between the least and the largest value of each stretch of time. Single spikes do not
    stretch its scale: how far they reach is written beside them.

    Args:
        health: from `opid.inspect`.
        axes: (n_channels, 3) Axes, or None for a new figure.
        channels: names of those to draw; all where left out. Some 12 fit on one figure.
        segment_s: begin and end of the segment that is used, s, to be shaded.

    Returns:
        (n_channels, 3) Axes.

    Raises:
        InputError: a name that is none of the channels.
    """
    drawn = _choose_channels(health, channels)
    n, row_in = len(drawn), 1.75 if len(drawn) <= FEW else 1.4
    with house_style():
        grid = panels(axes, n, 3, height_in=1.2 + row_in * n, width_in=WIDTH_IN, sharex="col", width_ratios=[10, 7, 7])
        stretches = [_list_stretches(health, channel) for channel in drawn]
        depth_db = _find_depth_db(drawn)
        mesh = None
        for (history_ax, psd_ax, spectrogram_ax), channel, wrong in zip(grid, drawn, stretches, strict=True):
            _draw_history(history_ax, channel, wrong, segment_s)
            _draw_spectrum(psd_ax, channel, _find_rate(health, channel))
            mesh = _draw_spectrogram(spectrogram_ax, channel, wrong, depth_db) or mesh
        _set_limits(grid, drawn)
        if n > FEW:
            for ax in grid.flat:
                ax.minorticks_off()  # drawing them would take most of the time
        grid[0, 1].set_title("power spectral density")
        grid[0, 2].set_title("spectrogram")
        for ax, label in zip(grid[-1], ("time [s]", "frequency [Hz]", "time [s]"), strict=True):
            ax.set_xlabel(label)
        _draw_legend(grid, stretches, segment_s, is_on_figure=axes is None)
        if mesh is not None:
            bar = figure_of(grid).colorbar(mesh, ax=list(grid[:, 2]), aspect=18 * n, pad=0.02)
            bar.set_label("dB below the loudest")
            bar.outline.set_visible(False)
    return grid


def _choose_channels(health: Health, names: Sequence[str] | None) -> list[ChannelHealth]:
    known = {channel.name: channel for channel in health.channels}
    for name in names or ():
        if name not in known:
            raise InputError(f"there is no channel {name!r} to draw: {nearest(name, known)}")
    chosen = list(health.channels) if names is None else [known[name] for name in names]
    if not chosen:
        raise InputError("there is no channel to draw: give one or more")
    return chosen


def orientation_picture(health: Health, axes: Any = None) -> np.ndarray:
    """Draw the axes of each three-axis sensor as seen from the side, the vertical of gravity upward.

    An axis is as long as its projection: one that points at the reader is a dot. The wedge about the vertical is the
    95 % interval of its angle in this view.

    Args:
        health: from `opid.inspect`.
        axes: an Axes for each sensor, or None for a new figure.

    Returns:
        (n_rows, n_columns) Axes, those after the last sensor off.

    Raises:
        InputError: no sensor with a known orientation.
    """
    if not health.orientations:
        raise InputError(
            "no three-axis sensor has a known orientation: inspect a log with three axes that read gravity"
        )
    n = len(health.orientations)
    columns = min(n, 4)
    with house_style():
        rows = -(-n // columns)
        grid = panels_in_rows(axes, n, columns, height_in=2.6 * rows + 0.3, width_in=2.6 * columns + 0.4)
        for ax, (name, found) in zip(grid.ravel(), health.orientations.items(), strict=False):
            up, across, _ = found.directions
            height, half = np.array([0.0, 1.0]), np.tan(1.96 * found.std_rad)
            ax.fill_betweenx(height, -half * height, half * height, color=SKY, alpha=0.4, linewidth=0)
            ax.plot([0, 0], [0, 1], color=GREY, linestyle="--", linewidth=1.0)
            for letter, right, top, color in zip("xyz", across, up, (VERMILION, GREEN, BLUE), strict=True):
                ax.plot([0, right], [0, top], color=color, linewidth=2.0)
                ax.plot([right], [top], "o", color=color, markersize=5)
                write_note(ax, letter, (right, top), (4, 4), color=color)
            ax.set_title(f"{_write_name(name)}, {format_minus(f'{np.degrees(found.std_rad):.2g}')}° std. dev.")
            ax.set(xlim=(-1.2, 1.2), ylim=(-1.2, 1.2), aspect="equal", xlabel="across", ylabel="up")
    return grid


def _list_stretches(health: Health, channel: ChannelHealth) -> dict[str, list[Stretch]]:
    """The faulty stretches of a channel by kind, the gaps of its clock included."""
    gaps = [gap for clock in health.clocks if channel.name in clock.channels for gap in clock.gaps]
    every = list(dict.fromkeys((*gaps, *channel.stretches)))
    return {kind: own for kind in KINDS if (own := [each for each in every if each.kind == kind])}


def _find_rate(health: Health, channel: ChannelHealth) -> float:
    return next((clock.fs for clock in health.clocks if channel.name in clock.channels), health.fs)


# ---- history -------------------------------------------------------------------------------------


def _draw_history(
    ax: Axes, channel: ChannelHealth, wrong: dict[str, list[Stretch]], segment_s: tuple[float, float] | None
) -> None:
    unit = "" if channel.unit == "?" else f" {format_units(channel.unit)}"
    ax.set_title(
        f"{_write_name(channel.name)}, {'mute' if channel.mute else f'{format_number(channel.rms, 4)}{unit} rms'}"
    )
    ax.set_ylabel("[no unit]" if channel.unit == "?" else f"[{format_units(channel.unit)}]")
    overview = channel.overview
    if overview is None or not np.isfinite(overview.lowest).any():
        _write_nothing(ax, "no values")
    else:
        ax.fill_between(overview.time_s, overview.lowest, overview.highest, color=BLUE, linewidth=0.6)
        _scale_history(ax, overview, wrong.get("spike", []))
    if segment_s is not None:
        ax.axvspan(*segment_s, color=SKY, alpha=0.22, linewidth=0, zorder=0)
    top = ax.get_xaxis_transform()
    for kind, own in wrong.items():
        color = KINDS[kind][1]
        spans = [(each.start_s, each.stop_s - each.start_s) for each in own]
        # the edge makes even the shortest stretches visible
        ax.broken_barh(spans, (0, 1), transform=top, color=color, alpha=0.3, linewidth=0.7, zorder=0.5)
        ax.broken_barh(spans, (0.94, 0.06), transform=top, color=color, linewidth=0.7, zorder=3)
        if kind == "spike":
            middles = [0.5 * (each.start_s + each.stop_s) for each in own]
            ax.plot(middles, [0.95] * len(own), "v", color=color, markersize=5, transform=top, zorder=4)


def _scale_history(ax: Axes, overview: Overview, spikes: Sequence[Stretch]) -> None:
    """Scale the history to its values without spikes, and write how far the spikes reach."""
    half_s = 0.5 * float(np.median(np.diff(overview.time_s))) if overview.time_s.size > 1 else 0.0
    calm = np.isfinite(overview.lowest)
    for each in spikes:
        calm &= (overview.time_s + half_s < each.start_s) | (overview.time_s - half_s > each.stop_s)
    if not calm.any():
        return
    low, high = float(overview.lowest[calm].min()), float(overview.highest[calm].max())
    least, most = float(np.nanmin(overview.lowest)), float(np.nanmax(overview.highest))
    room = 0.5 * (high - low)
    # the marks need room at the top
    if spikes and room > 0 and (least < low - room or most > high + room):
        ax.set_ylim(low - 0.3 * room, high + 0.6 * room)
        reach = " and ".join(
            format_number(value, 4) for value, far in ((least, least < low - room), (most, most > high + room)) if far
        )
        _write(ax, format_minus(f"spikes reach {reach}"), 0.03, color=GREEN)
    elif most > least:
        ax.set_ylim(least - 0.08 * (most - least), most + 0.15 * (most - least))


# ---- spectra -------------------------------------------------------------------------------------


def _draw_spectrum(ax: Axes, channel: ChannelHealth, fs: float) -> None:
    unit = "" if channel.unit == "?" else format_units(channel.unit)
    ax.set_xscale("log")
    ax.set_ylabel(f"[{f'({unit})²' if '/' in unit or ' ' in unit else f'{unit}²' if unit else '1'}/Hz]")
    overview = channel.overview
    if overview is None or not np.any(overview.psd[overview.frequency_hz > 0] > 0):
        _write_nothing(ax, "mute: no spectrum" if channel.mute else "no spectrum")
        return
    shown = (overview.frequency_hz > 0) & (overview.psd > 0)
    ax.set_yscale("log")
    ax.plot(overview.frequency_hz[shown], overview.psd[shown], color=INK, linewidth=0.8)
    low, high = float(overview.psd[shown].min()), float(overview.psd[shown].max())
    if channel.noise_floor > 0:
        # white noise spreads evenly up to half the rate
        floor = channel.noise_floor**2 / (0.5 * fs)
        ax.axhline(floor, color=GREY, linewidth=1.0, linestyle="--")
        low, high = min(low, floor), max(high, floor)
        _write(
            ax,
            f"noise at most {format_number(channel.noise_floor, 2)} {unit} rms".replace("  ", " "),
            floor,
            color=GREY,
        )
    decades = max(float(np.log10(high / low)), 1.0)
    others = [line for line in channel.lines if "mains" not in line.name]
    ax.set_ylim(low * 10 ** (-0.25 * decades), high * 10 ** ((0.45 if others else 0.1) * decades))
    mains = [line for line in channel.lines if line not in others]
    _mark_lines(ax, mains, overview, VERMILION)
    _mark_lines(ax, others, overview, BLUE, is_named=True)
    if mains:
        _write(ax, _say_mains(mains), 0.03, color=VERMILION)


def _mark_lines(
    ax: Axes, lines: Sequence[SpectralLine], overview: Overview, color: str, *, is_named: bool = False
) -> None:
    """Mark every line; if `is_named`, write the frequencies of the strongest lines that have room."""
    labelled: list[float] = []
    frequency_hz = overview.frequency_hz
    decades = float(np.log10(frequency_hz[-1] / frequency_hz[frequency_hz > 0][0]))
    for line in lines:
        nearest_line = int(np.argmin(np.abs(frequency_hz - line.frequency_hz)))
        level = float(overview.psd[max(nearest_line - 1, 0) : nearest_line + 2].max())
        ax.plot([line.frequency_hz], [level], "o", color=color, markersize=3.5)
        position = float(np.log10(line.frequency_hz))
        if is_named and len(labelled) < MOST_LABELS and all(abs(position - one) > 0.055 * decades for one in labelled):
            labelled.append(position)
            text, at = f"{format_number(line.frequency_hz, 4)} Hz", (line.frequency_hz, level)
            write_note(ax, text, at, (0, 4), fontsize=7, color=color, rotation=90, ha="center", va="bottom")


def _say_mains(lines: Sequence[SpectralLine]) -> str:
    """The lines of the mains in words: "mains, 50 Hz, and harmonics 2, 3"."""
    harmonics = sorted(line.harmonic for line in lines if line.harmonic is not None and line.harmonic > 1)
    listed = ", ".join(map(str, harmonics))
    first = [line.name for line in lines if line.harmonic == 1]
    if not first:
        return f"{lines[0].name.partition(' of the ')[2]}: harmonic{'s' * (len(harmonics) > 1)} {listed}"
    return first[0] + (f", and harmonic{'s' * (len(harmonics) > 1)} {listed}" if harmonics else "")


def _draw_spectrogram(ax: Axes, channel: ChannelHealth, wrong: dict[str, list[Stretch]], depth_db: float) -> Any:
    ax.grid(False)
    ax.set_yscale("log")
    ax.set_ylabel("[Hz]")
    overview = channel.overview
    if overview is None or not np.any(overview.spectrogram[:, overview.spectrogram_hz > 0] > 0):
        _write_nothing(ax, "no spectrogram")
        return None
    bands = overview.spectrogram_hz > 0
    level = _compute_decibels(overview.spectrogram[:, bands])
    time_s = _find_edges(overview.spectrogram_s, float(overview.time_s[0]), float(overview.time_s[-1]))
    frequency_hz = overview.spectrogram_hz[bands]
    frequency_edges = _find_edges(frequency_hz, 0.75 * frequency_hz[0], 1.25 * frequency_hz[0])
    mesh = ax.pcolormesh(time_s, frequency_edges, level.T, cmap=COUNT_MAP, vmin=-depth_db, vmax=0.0, rasterized=True)
    for kind in (each for each in ("gap", "missing") if each in wrong):
        spans = [(each.start_s, each.stop_s - each.start_s) for each in wrong[kind]]
        ax.broken_barh(spans, (0, 1), transform=ax.get_xaxis_transform(), color=KINDS[kind][1], linewidth=0.7)
    return mesh


def _compute_decibels(density: np.ndarray) -> np.ma.MaskedArray:
    """Levels relative to the largest, masked where there are no values."""
    there = np.ma.masked_invalid(np.ma.masked_less_equal(density, 0.0))
    return 10 * np.ma.log10(there / there.max())


def _find_depth_db(channels: Sequence[ChannelHealth]) -> float:
    """Colour range below the maximum, dB: the median over channels of the 5 % quantile of their spectrograms."""
    quietest = []
    for overview in (channel.overview for channel in channels):
        if overview is None:
            continue
        density = overview.spectrogram[:, overview.spectrogram_hz > 0]
        if np.any(density > 0):
            quietest.append(-float(np.quantile(_compute_decibels(density).compressed(), 0.05)))
    usual = float(np.median(quietest)) if quietest else LEAST_DB
    return 10 * float(np.ceil(np.clip(usual, LEAST_DB, DEEPEST_DB) / 10))


def _find_edges(middles: np.ndarray, low: float, high: float) -> np.ndarray:
    """Edges of cells from their middles; `low` and `high` are those of a single cell."""
    if middles.size < 2:
        return np.array([low, max(high, np.nextafter(low, np.inf))])
    between = 0.5 * (middles[1:] + middles[:-1])
    return np.concatenate([[1.5 * middles[0] - 0.5 * middles[1]], between, [1.5 * middles[-1] - 0.5 * middles[-2]]])


# ---- what stands around ----------------------------------------------------------------------------


def _set_limits(grid: np.ndarray, channels: Sequence[ChannelHealth]) -> None:
    """Give all rows the same times and the same frequencies."""
    seen = [channel.overview for channel in channels if channel.overview is not None]
    times = np.concatenate([each.time_s for each in seen]) if seen else np.empty(0)
    lines = np.concatenate([each.frequency_hz[each.frequency_hz > 0] for each in seen]) if seen else np.empty(0)
    if times.size and times.min() < times.max():
        for column in (0, 2):
            grid[0, column].set_xlim(times.min(), times.max())
    if lines.size and lines.min() < lines.max():
        grid[0, 1].set_xlim(lines.min(), lines.max())


def _draw_legend(
    grid: np.ndarray,
    stretches: Sequence[dict[str, list[Stretch]]],
    segment_s: tuple[float, float] | None,
    *,
    is_on_figure: bool,
) -> None:
    """One legend for all rows."""
    handles: list[Any] = [Patch(color=BLUE, label="least to largest value")]
    if segment_s is not None:
        handles.append(Patch(color=SKY, alpha=0.35, label="segment that is used"))
    for kind, (label, color) in KINDS.items():
        most = max((len(wrong.get(kind, ())) for wrong in stretches), default=0)
        if most:
            label += f" (the first {MOST_STRETCHES} are drawn)" if most >= MOST_STRETCHES else ""
            mark = Line2D([], [], marker="v", linestyle="none", color=color, label=label)
            handles.append(mark if kind == "spike" else Patch(color=color, label=label))
    if is_on_figure:
        figure_of(grid).legend(handles=handles, loc="outside upper left", ncols=len(handles))
    else:
        grid[0, 0].legend(handles=handles, loc="lower right", fontsize=7)


def _write(ax: Axes, text: str, height: float, *, color: str) -> None:
    """Write at the left edge: a noise floor above its line, other text near the bottom."""
    is_floor = color == GREY
    at: Any = ax.get_yaxis_transform() if is_floor else ax.transAxes
    box = {"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.3}
    how: Any = {"xycoords": at, "va": "bottom", "fontsize": 7, "zorder": 5, "bbox": box}
    write_note(ax, text, (0.0, height), (3.0, 1.5 if is_floor else 0.0), color=color, **how)


def _write_name(name: str) -> str:
    """Return a name that fits above a history, on one line."""
    return shorten(" ".join(name.split()), LONGEST_NAME)


def _write_nothing(ax: Axes, text: str) -> None:
    ax.text(0.5, 0.5, text, color=GREY, ha="center", va="center", transform=ax.transAxes)
    ax.set_yticks([])
