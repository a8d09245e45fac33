"""Figures of a body on several suspensions: where everything is, which structure, and suspension by suspension."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from opid.estimate import Estimate
from opid.mechanics.truth import BodyTruth
from opid.plots.style import (
    BEHIND,
    BLUE,
    GREEN,
    GREY,
    INK,
    PALE,
    VERMILION,
    figure_of,
    house_style,
    panels,
    plain_numbers,
    pretty,
    run_colors,
)
from opid.suspensions.result import BodyRatios, Candidate, Identification

__all__ = ["plan_view", "structure_candidates", "suspension_parameters"]

FARTHEST_DRAWN = 1e4
"""Residual over noise at which a structure stands whose fit ran away and left more; its number is written beside it."""


def plan_view(result: Identification, ax: Any = None, *, truth: BodyTruth | None = None) -> Axes:
    """Draw the body from above: suspensions, sensors, the centre of gravity with its intervals, and the loadings.

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.
        truth: of a simulated aircraft: its centre of gravity is drawn too.
    """
    with house_style():
        ax = panels(ax, 1, height_in=4.6)[0, 0]
        for name, (x, y, sensor_x, sensor_y) in result.places.items():
            ax.plot([y, sensor_y], [x, sensor_x], color=PALE, linewidth=1.2, zorder=1)
            ax.plot([y], [x], marker="o", markersize=11, color=INK, markerfacecolor="white", markeredgewidth=1.8)
            _note(ax, name, (y, x), (0, -16), fontweight="bold", ha="center")
            _sensor(ax, sensor_x, sensor_y)
        for name, (x, y) in further_sensors(result).items():
            _sensor(ax, x, y)
            _note(ax, name, (y, x), (8, 0), color=BLUE, va="center")
        _loadings(ax, result)
        _centre_of_gravity(ax, result, truth)
        _room(ax)
        ax.set_xlabel("y, to the left [m]")
        ax.set_ylabel("x, forward [m]")
        ax.set_title("From above")
        handles = [
            Line2D([], [], marker="o", markersize=9, color=INK, markerfacecolor="white", linestyle="none"),
            Line2D([], [], marker="^", markersize=6, color=BLUE, linestyle="none"),
        ]
        drawn, labels = ax.get_legend_handles_labels()
        named = ["suspension", "sensor on the body", *labels]
        legend = ax.legend([*handles, *drawn], named, loc="upper left", bbox_to_anchor=(1.03, 1.0), labelspacing=1.1)
        for handle in legend.legend_handles:
            if isinstance(handle, Line2D):
                handle.set_markersize(min(handle.get_markersize(), 9.0))
    return ax


def structure_candidates(result: Identification, ax: Any = None) -> Axes:
    """Draw what each structure leaves, over the noise: of the runs it was fitted to, and of runs left out.

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.
    """
    candidates, explained = result.candidates, result.settings.verdicts.explained
    with house_style():
        ax = panels(ax, 1, height_in=1.4 + 0.5 * len(candidates))[0, 0]
        ax.axvspan(1e-3, explained, color="#F1F1F1", zorder=0)
        ax.axvline(explained, color=INK, linestyle="--", linewidth=1)
        found = [value for candidate in candidates for value in _levels(candidate)] or [1.0]
        for row, candidate in enumerate(candidates):
            _candidate(ax, row, candidate, max(found))
        ax.set_xscale("log")
        ax.set_xlim(min(0.8, *found) / 1.1, max(4.0, *found) * 3.0)
        plain_numbers(ax.xaxis)
        labels = [candidate.label + _law_line(candidate) for candidate in candidates]
        ax.set_yticks(range(len(candidates)), labels, fontsize=8)
        for label, candidate in zip(ax.get_yticklabels(), candidates, strict=True):
            label.set_color(VERMILION if candidate.recommended else INK)
            label.set_fontweight("bold" if candidate.recommended else "normal")
        ax.set_ylim(len(candidates) - 0.5, -0.5)
        ax.grid(False, axis="y")
        ax.set_xlabel(f"residual over the noise of the sensors; up to {explained:g} it is noise")
        ax.set_title("Structures on the same data")
        dot: dict[str, Any] = {"marker": "o", "markersize": 7, "color": GREY, "linestyle": "none"}
        handles = [Line2D([], [], label="fitted runs", **dot)]
        if any(candidate.left_out_over_noise is not None for candidate in candidates):
            handles.append(Line2D([], [], label="runs left out", markerfacecolor="white", **dot))
        figure_of(ax).legend(handles=handles, loc="outside lower center", ncols=2)
    return ax


def suspension_parameters(result: Identification, axes: Any = None, *, truth: BodyTruth | None = None) -> np.ndarray:
    """Draw stiffness, damping and the amplitudes of the laws of all suspensions, with 95 % intervals.

    Args:
        result: the identification.
        axes: as many Axes as there are quantities, or None for a new figure.
        truth: of a simulated aircraft: drawn as bars.

    Returns:
        (n_rows, n_columns) Axes, those of the last row that are not needed switched off.
    """
    quantities = list(_quantities(result, truth))
    columns = min(len(quantities), 3)
    rows = -(-len(quantities) // columns)
    names = [interface.name for interface in result.interfaces]
    with house_style():
        grid = panels(axes, rows, columns, height_in=0.5 + 2.9 * rows)
        for ax, quantity in zip(grid.ravel(), quantities, strict=False):
            _quantity(ax, quantity, names)
        for ax in grid.ravel()[len(quantities) :]:
            ax.set_axis_off()
        if truth is not None:
            grid[0, 0].legend(loc="lower right")
    return grid


def further_sensors(result: Identification) -> dict[str, tuple[float, float]]:
    """Return the (x, y) of the sensors on the body beside those of the suspensions, by the names of their channels.

    Args:
        result: the identification.
    """
    return {sensor.channel: (sensor.x_m, sensor.y_m) for sensor in result.study.sensors}


# ---- from above ------------------------------------------------------------------------------------


def _room(ax: Axes) -> None:
    """One scale along both axes, no narrower than 0.6 times as high, y to the left: the nose points upward."""
    ax.margins(0.12)
    (low_y, high_y), (low_x, high_x) = ax.get_xlim(), ax.get_ylim()
    wide, high = max(high_y - low_y, 0.6 * (high_x - low_x)), max(high_x - low_x, 0.6 * (high_y - low_y))
    middle_y, middle_x = (low_y + high_y) / 2, (low_x + high_x) / 2
    ax.set_xlim(middle_y + wide / 2, middle_y - wide / 2)
    ax.set_ylim(middle_x - high / 2, middle_x + high / 2)
    ax.set_aspect("equal", adjustable="box")


def _note(ax: Axes, text: str, position: tuple[float, float], shift: tuple[float, float], **style: Any) -> None:
    ax.annotate(text, position, shift, textcoords="offset points", **{"fontsize": 8.5, **style})


def _sensor(ax: Axes, x: float, y: float) -> None:
    ax.plot([y], [x], marker="^", markersize=6, color=BLUE, linestyle="none", zorder=3)


def _loadings(ax: Axes, result: Identification) -> None:
    colors = run_colors(len(result.runs))
    for run, color in zip(result.runs, colors, strict=True):
        for index, (mass_kg, x, y) in enumerate(run.loading):
            label = f"carried in run {run.name!r}" if index == 0 else None
            size = float(np.clip(5 + 0.4 * np.sqrt(abs(mass_kg)), 6, 18))
            face = color if mass_kg >= 0 else "white"
            ax.plot(
                [y],
                [x],
                marker="s",
                markersize=size,
                color=color,
                markerfacecolor=face,
                alpha=0.6,
                linestyle="none",
                label=label,
                zorder=2,
            )
            _note(ax, f"{mass_kg:+g} kg".replace("-", "−"), (y, x), (0, 0.5 * size + 4), color=color, ha="center")


def _centre_of_gravity(ax: Axes, result: Identification, truth: BodyTruth | None) -> None:
    assert isinstance(result.ratios, BodyRatios)  # one gear has no centre of gravity
    x, y = result.ratios.x_cg_m, result.ratios.y_cg_m
    if truth is not None:
        true = truth.parameters
        label = "centre of gravity, truth"
        ring: dict[str, Any] = {"marker": "o", "markersize": 15, "markerfacecolor": "none", "linestyle": "none"}
        ax.plot([true.y_cg_m], [true.x_cg_m], color=GREEN, alpha=0.7, markeredgewidth=3, label=label, **ring)
    if x.value is None or y.value is None:
        return
    for estimate, fixed, along in ((x, y.value, "x"), (y, x.value, "y")):
        if estimate.interval95 is not None:
            ends, held = list(estimate.interval95), [fixed, fixed]
            ax.plot(*((held, ends) if along == "x" else (ends, held)), color=VERMILION, linewidth=2, zorder=4)
    text = f"centre of gravity (± 95 %)\nx = {_spread(x, 1.0)} m\ny = {_spread(y, 1.0)} m"
    ax.plot([y.value], [x.value], marker="x", markersize=8, color=VERMILION, linestyle="none", label=text, zorder=5)


# ---- structures ------------------------------------------------------------------------------------


def _law_line(candidate: Candidate) -> str:
    """The laws below the name, two of them at most: long lines would leave no room for the figure."""
    laws = [law.replace("_", " ").replace("+", " + ") for law in candidate.law.split("; ") if law]
    laws = [law if len(law) <= 34 else law[:32] + "…" for law in laws]
    return "".join(f"\n{law}" for law in (laws if len(laws) < 3 else [laws[0], f"and {len(laws) - 1} other laws"]))


def _levels(candidate: Candidate) -> Iterator[float]:
    for value in (candidate.residual_over_noise, candidate.left_out_over_noise):
        if value is not None and np.isfinite(value) and value > 0:
            yield min(float(value), FARTHEST_DRAWN)


def _candidate(ax: Axes, row: int, candidate: Candidate, farthest: float) -> None:
    color = VERMILION if candidate.recommended else INK if candidate.explains else GREY
    inside, outside = candidate.residual_over_noise, candidate.left_out_over_noise
    if not np.isfinite(inside):
        _note(ax, "no fit", (max(farthest, 1.0), row), (0, 0), va="center", ha="right", color=GREY)
        return
    ends = list(_levels(candidate))
    ax.plot(ends, [row] * len(ends), color=color, linewidth=1)
    if outside is not None and np.isfinite(outside):
        ax.plot([ends[-1]], [row], marker="o", markersize=8, color=color, markerfacecolor="white", linestyle="none")
    ax.plot(ends[:1], [row], marker="o", markersize=5.5, color=color, linestyle="none")
    text = f"{inside:.3g}" if outside is None else f"{inside:.3g}, left out {outside:.3g}"
    _note(ax, text, (max(ends), row), (9, 0), va="center", color=color, fontsize=8, bbox=BEHIND)


# ---- suspension by suspension ----------------------------------------------------------------------


@dataclass(frozen=True)
class _Quantity:
    """One panel: what every suspension has of it, and the truth."""

    title: str
    label: str
    scale: float
    estimates: tuple[Estimate, ...]
    true: tuple[float | None, ...]


def _quantities(result: Identification, truth: BodyTruth | None) -> Iterator[_Quantity]:
    known = [None if truth is None else truth.interfaces.get(each.name) for each in result.interfaces]
    scale = 1.0 / truth.parameters.sprung_mass_kg if truth is not None and result.per_mass else 1.0
    for key, title, unit, per_mass in (
        ("stiffness", "Stiffness K", "kN/m", "1/s^2"),
        ("damping", "Damping C", "kN s/m", "1/s"),
    ):
        suffix = "n_per_m" if key == "stiffness" else "n_s_per_m"
        true = tuple(None if each is None else scale * getattr(each, f"{key}_{suffix}") for each in known)
        values = tuple(getattr(each, key) for each in result.interfaces)
        shown = (f"{title} / M", f"[{pretty(per_mass)}]", 1.0) if result.per_mass else (title, f"[{unit}]", 1e-3)
        yield _Quantity(*shown, values, true)
    amplitudes = {
        (term.name, parameter.name): parameter.unit
        for interface in result.interfaces
        for term in interface.law.terms
        for parameter in term.kind.parameters
        if parameter.role == "amplitude"
    }
    for (kind, parameter), unit in amplitudes.items():
        values = tuple(each.law_estimates.get(kind, {}).get(parameter, Estimate()) for each in result.interfaces)
        laws = [{} if each is None else each.law.parameters.get(kind, {}) for each in known]
        true = tuple(scale * law[parameter] if parameter in law else None for law in laws)
        per = f"{unit}/kg" if result.per_mass else unit
        what = parameter.partition("_")[0]
        yield _Quantity(kind.replace("_", " ").capitalize(), f"{what} [{pretty(per)}]", 1.0, values, true)


def _quantity(ax: Axes, quantity: _Quantity, names: list[str]) -> None:
    labelled = False
    for index, (estimate, true) in enumerate(zip(quantity.estimates, quantity.true, strict=True)):
        if true is not None:
            label = None if labelled else "truth"
            height = [quantity.scale * true] * 2
            bar = [index - 0.32, index + 0.32]
            ax.plot(bar, height, color=GREEN, linewidth=5, alpha=0.4, solid_capstyle="butt", label=label, zorder=1)
            labelled = True
        if estimate.value is None:
            _note(ax, "–", (index, 0.5), (0, 0), xycoords=("data", "axes fraction"), color=GREY, ha="center")
            continue
        value = quantity.scale * estimate.value
        ends = [value]
        if estimate.interval95 is not None:
            ends = [quantity.scale * end for end in estimate.interval95]
            ax.plot([index, index], ends, color=BLUE, linewidth=2)
            ax.plot([index, index], ends, color=BLUE, marker="_", markersize=8, linestyle="none")
        ax.plot([index], [value], color=BLUE, marker="o", markersize=4, linestyle="none")
        text = _spread(estimate, quantity.scale).replace(" ± ", "\n± ")
        _note(ax, text, (index, max(ends)), (0, 8), ha="center", fontsize=7.5)
    ax.set_xticks(range(len(names)), names)
    ax.set_xlim(-0.6, len(names) - 0.4)
    ax.margins(y=0.25)
    ax.grid(False, axis="x")
    ax.set_title(quantity.title)
    ax.set_ylabel(quantity.label)
    if all(value is None for value in (*quantity.true, *(estimate.value for estimate in quantity.estimates))):
        ax.set_yticks([])


def _spread(estimate: Estimate, scale: float) -> str:
    """Value and half the 95 % interval, with the digits that it leaves."""
    assert estimate.value is not None
    value = scale * estimate.value
    if estimate.interval95 is None or estimate.interval95[1] <= estimate.interval95[0]:
        return f"{value:.4g}".replace("-", "−")
    half = 0.5 * scale * (estimate.interval95[1] - estimate.interval95[0])
    decimals = max(0, 1 - int(np.floor(np.log10(half))))
    if decimals > 6 or abs(value) >= 1e6:
        return f"{value:.4g} ± {half:.2g}".replace("-", "−")
    return f"{value:.{decimals}f} ± {half:.{decimals}f}".replace("-", "−")
