"""The figure of the answer: the estimates of every method side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.transforms import offset_copy

from opid.estimate import Estimate, format_number
from opid.mechanics.truth import GearTruth
from opid.plots.style import (
    GREEN,
    GREY,
    INK,
    choose_run_colors,
    figure_of,
    format_minus,
    house_style,
    panels,
    write_note,
)
from opid.suspensions.paper.chain import PaperChain, PeakPair
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.paper.spectral_equation import RATIOS
from opid.suspensions.result import GearRatios

# each pair of peaks that is shown has one, over and over
_PAIR_MARKERS = ("D", "s", "p")


@dataclass(frozen=True)
class _Mark:
    """One estimate in the figure of all methods."""

    row: int
    column: int
    color: str
    shift: float
    estimate: Estimate
    marker: str = "o"
    is_filled: bool = True


_METHODS = (
    "the paper\nas printed",
    "the same,\nsign restored",
    "complex\nleast squares",
    "errors in variables,\none run",
    "errors in variables,\nall runs",
)
_N_PEAK_FORMULAS = 2
_COLUMNS = ("M₂ [kg]", "K₂/M₂ [1/s²]", "C₂/M₂ [1/s]", "K₃/M₂ [1/s²]")


def estimates(
    result: AnyIdentification, axes: Any = None, *, truth: GearTruth | None = None, has_peak_formula: bool = True
) -> np.ndarray:
    """Draw mass and ratios to it as every method of the chain finds them, with 95 % intervals.

    A value beyond the frame is written beside its mark at the edge, with an arrow. The peak formula has one mark for
    each of the strongest matched pairs, hollow where the match is not credible.

    Args:
        result: the identification.
        axes: four Axes, or None for a new figure.
        truth: of a simulated run: drawn as lines.
        has_peak_formula: whether the peak formula of the paper is among the methods.

    Returns:
        (1, 4) Axes.
    """
    chain = result.paper_chain
    pairs = chain.table_3 if has_peak_formula else ()
    marks = list(_list_marks(result, pairs))
    methods = range(0 if has_peak_formula else _N_PEAK_FORMULAS, len(_METHODS))
    lines = _list_true_lines(chain, truth)
    with house_style():
        grid = panels(axes, 1, 4, height_in=1.2 + 0.6 * len(methods), width_in=8.6, sharey=True)
        for column, ax in enumerate(grid[0]):
            mine = [mark for mark in marks if mark.column == column]
            low, high = _find_limits(mine, [value for value, _ in lines[column]])
            ax.set_xlim(low, high)
            ax.locator_params(axis="x", nbins=3)
            for value, color in lines[column]:
                ax.axvline(value, color=color, linewidth=4, alpha=0.25)
            for mark in mine:
                _draw_mark(ax, mark, low, high)
            if not any(mark.estimate.value is not None for mark in mine):
                ax.set_xticks([])
                style: dict[str, Any] = {"color": GREY, "ha": "center", "backgroundcolor": "white"}
                ax.text(0.5, 0.5, "not determined", transform=ax.transAxes, **style)
            ax.set_title(_COLUMNS[column])
            ax.set_ylim(methods.stop - 0.5, methods.start - 0.5)
            ax.grid(False, axis="y")
            for row in methods[:-1]:
                ax.axhline(row + 0.5, color="#E4E4E4", linewidth=0.7)
        of_all = "driven model,\nall runs" if result.method == "model" else _METHODS[-1]
        grid[0, 0].set_yticks(methods, [*_METHODS[methods.start : -1], of_all])
        has_mass = any(mark.color == INK for mark in marks)
        _draw_legend(figure_of(grid), chain, pairs, has_mass=has_mass, has_truth=bool(truth))
    return grid


def _list_marks(result: AnyIdentification, pairs: Sequence[PeakPair]) -> Iterator[_Mark]:
    runs = result.paper_chain.runs
    colors = choose_run_colors(len(runs))
    shifts = np.linspace(-0.18, 0.18, len(runs)) if len(runs) > 1 else [0.0]
    for i, pair in enumerate(pairs):
        for row, mass in enumerate((pair.as_printed, pair.sign_restored)):
            if mass.sprung_mass_kg == 0:
                continue
            values = (
                mass.sprung_mass_kg,
                mass.stiffness_n_per_m / mass.sprung_mass_kg,
                None,
                mass.ground_stiffness_n_per_m / mass.sprung_mass_kg,
            )
            for column, value in enumerate(values):
                shift, look = 0.27 * (i - 1), (_PAIR_MARKERS[i % len(_PAIR_MARKERS)], pair.match.credible)
                yield _Mark(row, column, GREY, shift, Estimate(value), *look)
    mass_estimate, ratios, inverse_mass = _find_estimates(result)
    for run, color, shift in zip(runs, colors, shifts, strict=True):
        for row, fit in ((2, run.complex_fit), (3, run.spectral_fit)):
            for k in range(3):
                yield _Mark(row, k + 1, color, float(shift), Estimate.normal(fit.value[k], fit.std[k]))
        of_reference = 1 / (1 + inverse_mass * run.mass_change_kg)
        for k, ratio in enumerate(ratios):
            if ratio.value is not None:
                spread = None if ratio.std is None else of_reference * ratio.std
                yield _Mark(4, k + 1, color, float(shift), Estimate.normal(of_reference * ratio.value, spread))
    if mass_estimate.value is not None:
        yield _Mark(4, 0, INK, 0.0, mass_estimate)


def _find_estimates(result: AnyIdentification) -> tuple[Estimate, list[Estimate], float]:
    """Mass, ratios and 1/M2 of all runs: those of the result, or of the joint fit if the method is the paper's."""
    if isinstance(result, PaperIdentification) and result.method == "paper":
        joint, added = result.joint, result.added_mass
        std = dict(zip(joint.names, joint.std, strict=True))
        mass = Estimate() if added is None else Estimate.normal(added.sprung_mass_kg, added.std[0])
        over_mass = [Estimate.normal(value, std.get(name)) for name, value in zip(RATIOS, joint.ratios, strict=True)]
        return mass, over_mass, joint.inverse_mass
    mass, ratios = result.parameters.sprung_mass_kg, result.ratios
    assert isinstance(ratios, GearRatios)  # a body has no such chain
    over_mass = [ratios.stiffness_per_mass, ratios.damping_per_mass, ratios.ground_stiffness_per_mass]
    return mass, over_mass, 1 / mass.value if mass.value else 0.0


def _list_true_lines(chain: PaperChain, truth: GearTruth | None) -> list[list[tuple[float, str]]]:
    """Return value and colour of the true lines of each column, one a run for the ratios."""
    if truth is None:
        return [[], [], [], []]
    true = truth.parameters
    mass = true.sprung_mass_kg
    values = (true.suspension_stiffness_n_per_m, true.suspension_damping_n_s_per_m, true.ground_stiffness_n_per_m)
    colors = choose_run_colors(len(chain.runs))
    ratios = [
        [(value / (mass + run.mass_change_kg), color) for run, color in zip(chain.runs, colors, strict=True)]
        for value in values
    ]
    return [[(mass, GREEN)], *ratios]


def _find_limits(marks: list[_Mark], truths: list[float]) -> tuple[float, float]:
    """The limits of a panel that hold what the sound methods find; the peak formula may lie outside."""
    sound = [mark.estimate for mark in marks if mark.row >= _N_PEAK_FORMULAS]
    ends = [*truths, *(v for e in sound for v in (e.interval95 or (e.value,)) if v is not None)]
    ends = ends or [mark.estimate.value for mark in marks if mark.estimate.value is not None] or [0.0]
    low, high = min(ends), max(ends)
    margin = max(0.25 * (high - low), 0.15 * max(abs(low), abs(high)), 1e-3)
    return low - margin, high + margin


def _draw_mark(ax: Axes, mark: _Mark, low: float, high: float) -> None:
    value = mark.estimate.value
    if value is None or not np.isfinite(value):
        return
    row = mark.row + mark.shift
    style: dict[str, Any] = {"color": mark.color, "markerfacecolor": mark.color if mark.is_filled else "white"}
    if low <= value <= high:
        if mark.estimate.interval95 is not None:
            ax.plot(mark.estimate.interval95, [row, row], color=mark.color, linewidth=2)
        ax.plot([value], [row], marker=mark.marker, markersize=4.5, linestyle="none", **style)
        return
    edge, arrow, side, align = (low, "<", 1, "left") if value < low else (high, ">", -1, "right")
    ax.plot([edge], [row], marker=arrow, markersize=3.5, clip_on=False, linestyle="none", color=mark.color)
    inward = offset_copy(ax.transData, figure_of(ax), x=7 * side, units="points")
    ax.plot([edge], [row], marker=mark.marker, markersize=4.5, linestyle="none", transform=inward, **style)
    write_note(
        ax, format_minus(format_number(value, 3)), (edge, row), (12 * side, 0), va="center", ha=align, fontsize=7.5
    )


def _draw_legend(figure: Any, chain: PaperChain, pairs: Sequence[PeakPair], *, has_mass: bool, has_truth: bool) -> None:
    dot: dict[str, Any] = {"marker": "o", "linewidth": 2, "markersize": 4.5}
    handles = [
        Line2D([], [], color=color, label=f"run {run.name!r}", **dot)
        for run, color in zip(chain.runs, choose_run_colors(len(chain.runs)), strict=True)
    ]
    if has_mass:
        handles.append(Line2D([], [], color=INK, label="all runs", **dot))
    for pair, marker in zip(pairs, cycle(_PAIR_MARKERS), strict=False):
        match = pair.match
        low_hz, high_hz = (format_number(peak.frequency_hz, 3) for peak in (match.reference, match.changed))
        label = f"peaks {low_hz} → {high_hz} Hz"
        face, doubt = (GREY, "") if match.credible else ("white", " (not credible)")
        look: dict[str, Any] = {"marker": marker, "linestyle": "none", "markersize": 5, "markerfacecolor": face}
        handles.append(Line2D([], [], color=GREY, label=label + doubt, **look))
    if has_truth:
        handles.append(Line2D([], [], color=GREEN, linewidth=4, alpha=0.35, label="truth (of a run: in its colour)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4), fontsize=8.5)
