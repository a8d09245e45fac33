"""Figures that compare model classes: their log evidences, the forces that they make of the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from opid.plots.style import GREY, INK, RUN_COLORS, house_style, panels, thick
from opid.signals.recording import FloatArray
from opid.updating.result import ClassPosterior, Updating

__all__ = ["ForceBand", "joint_forces", "log_evidences"]

_METHODS = {"laplace": ("o", "Laplace"), "transitional": ("s", "transitional MCMC"), "quadrature": ("x", "quadrature")}
# from here on the axis of the evidences is logarithmic
_LINEAR_TO = 10.0

# of the largest force: curves that are nearer to each other than this hide each other
_SAME_FORCE = 0.02
# length of a dash, in widths of its line; width of the line of the best class
_DASH, _WIDE = 4.0, 2.4
# marks of the truth, which other lines are seen between
_N_TRUTH = 16
# classes in one column of a legend
_IN_ONE_COLUMN = 6

LEAST_STD = 0.005  # of a log evidence: what is less is drawn without a bar


@dataclass(frozen=True, eq=False)
class ForceBand:
    """Force of one class over the extension of the joints.

    Args:
        name: of the class.
        force: (n,) at the mean of the parameters, N.
        low: (n,) lower end of the 95 % band, N.
        high: (n,) upper end, N.
    """

    name: str
    force: FloatArray
    low: FloatArray
    high: FloatArray


def log_evidences(result: Updating, ax: Any = None) -> Axes:
    """Draw the log evidence of every class, by every method, less that of the best class.

    Args:
        result: of the updating.
        ax: one Axes, or None for a new figure.
    """
    classes = result.classes
    best = max((each.log_evidence for each in classes if np.isfinite(each.log_evidence)), default=0.0)
    named: set[str] = set()
    with house_style():
        ax = panels(ax, 1, height_in=1.4 + 0.42 * len(classes))[0, 0]
        lowest, spread = 0.0, False
        for row, each in enumerate(classes):
            color = RUN_COLORS[1] if each.model_class.name == result.best_class else RUN_COLORS[0]
            for evidence in each.evidences:
                marker, label = _METHODS.get(evidence.method, ("d", evidence.method))
                offset = evidence.log_evidence - best
                if not np.isfinite(offset):
                    continue
                lowest = min(lowest, offset - 2 * evidence.std)
                bar = 2 * evidence.std if evidence.std > LEAST_STD else None
                spread = spread or bar is not None
                ax.errorbar(
                    offset, row, xerr=bar, color=color, marker=marker, linestyle="none", markersize=6,
                    markerfacecolor="none", markeredgewidth=1.5, elinewidth=1.2, capsize=3,
                    label="_" if label in named else label,
                )  # fmt: skip
                named.add(label)
        _as_differences(ax, lowest)
        ax.axvline(0, color=GREY, linewidth=0.9, zorder=0)
        ax.set_yticks(range(len(classes)), [_class_label(each) for each in classes])
        ax.set_ylim(len(classes) - 0.5, -0.5)
        bars = " (± 2 standard deviations)" if spread else ""
        ax.set_xlabel(f"log evidence less that of the best class{bars}")
        if named:
            # above the axes: a class may lie anywhere within
            ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(named), fontsize=8)
    return ax


def joint_forces(
    extension: FloatArray,
    bands: Sequence[ForceBand],
    *,
    best: str,
    truth: FloatArray | None = None,
    reached: Mapping[int, float] | None = None,
    ax: Any = None,
) -> Axes:
    """Draw the nonlinear force of every class over the extension that the tests reached.

    Args:
        extension: (n,) m.
        bands: one a class.
        best: name of the best class, which alone has its band drawn.
        truth: (n,) force of a simulation, N.
        reached: extension that the tests of each mode reached, m, by its number.
        ax: one Axes, or None for a new figure.
    """
    x = 1e3 * extension
    with house_style():
        ax = panels(ax, 1, height_in=3.8)[0, 0]
        for number, band in enumerate(bands):
            color = RUN_COLORS[number % len(RUN_COLORS)]
            if band.name == best:
                ax.plot(x, band.force, color=color, linewidth=_WIDE, label=f"{band.name} (best)", zorder=2)
                ax.fill_between(x, band.low, band.high, color=color, alpha=0.25, linewidth=0, label="its 95 % band")
            else:
                style = _dashes(band, bands, best)
                ax.plot(x, band.force, color=color, label=band.name, zorder=3, **style)
        if truth is not None:
            ax.plot(
                x, truth, color=INK, linestyle="none", marker="o", markersize=4, markerfacecolor="white",
                markevery=max(1, len(x) // _N_TRUTH), label="truth", zorder=5,
            )  # fmt: skip
        for mode, extended in (reached or {}).items():
            ax.axvline(1e3 * extended, color=GREY, linestyle=":", linewidth=1.0)
            ax.annotate(
                f"mode {mode}", (1e3 * extended, 1), (-3, -3), xycoords=("data", "axes fraction"),
                textcoords="offset points", rotation=90, ha="right", va="top", fontsize=8, color=INK,
            )  # fmt: skip
        # joints that are not extended at all leave nothing to zoom in on
        if x[-1] > x[0]:
            ax.set_xlim(float(x[0]), float(x[-1]))
        ax.set_xlabel("extension of a joint [mm]")
        ax.set_ylabel("nonlinear force [N]")
        legend = ax.legend(loc="upper left", fontsize=8, ncols=1 if len(bands) <= _IN_ONE_COLUMN else 2)
        thick(legend)
        for handle in legend.legend_handles:
            # the turns of a class are too far apart for a legend
            if isinstance(handle, Line2D) and handle.is_dashed():
                handle.set_linestyle("--")
    return ax


def _dashes(band: ForceBand, bands: Sequence[ForceBand], best: str) -> dict[str, Any]:
    """The line of a class that is not the best; classes whose curves lie on each other take turns along the curve."""
    largest = max(float(np.abs(each.force).max()) for each in bands)
    together = [each.name for each in bands if np.abs(each.force - band.force).max() <= _SAME_FORCE * largest]
    # the best is drawn whole beneath and shows where it is its turn
    turn = sum(name != best for name in together[: together.index(band.name)])
    dashes = (turn * _DASH, (_DASH, max(1, len(together) - 1) * _DASH))
    return {"linestyle": dashes, "linewidth": _WIDE if best in together else 1.5}


def _class_label(each: ClassPosterior) -> str:
    name, law = each.model_class.name, each.model_class.law_in_words
    return name if name == law else f"{name}: {law}"


def _as_differences(ax: Axes, lowest: float) -> None:
    """Linear near the best class and logarithmic beyond, with plain numbers."""
    if lowest > -3 * _LINEAR_TO:
        ax.set_xlim(min(1.15 * lowest, -1.0), max(-0.06 * lowest, 0.3))
        return
    ax.set_xscale("symlog", linthresh=_LINEAR_TO, linscale=1.5)
    ax.set_xlim(2 * lowest, 4)
    decades = [_LINEAR_TO * 10**power * step for power in range(1, 12) for step in (1, 3)]
    ticks = [0, -2, -5, -10, -30, *(-each for each in decades if each < -2 * lowest)]
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "−")))
    ax.xaxis.set_minor_locator(NullLocator())
