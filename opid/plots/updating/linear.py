"""Figures of the linear structure: what its updating did to frequencies and shapes, what its reduction leaves out."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from opid.plots.style import BLUE, GREY, INK, VERMILION, house_style, panels, thick
from opid.updating.result import LinearPosterior
from opid.updating.structure.reduction import ReductionErrors

__all__ = ["linear_updating", "reduction_figure"]

# a frequency that agrees to the last digit has a place on a logarithmic axis, too
_LEAST_PERCENT = 1e-12
_HELD: dict[str, Any] = {"color": BLUE, "marker": "o", "markersize": 4, "label": "sensors and joints held"}
# hollow, so that the other one is seen within it
_FREE: dict[str, Any] = {
    "color": VERMILION, "marker": "s", "markersize": 6, "markerfacecolor": "none", "label": "free modes",
}  # fmt: skip


def linear_updating(linear: LinearPosterior, axes: Any = None) -> np.ndarray:
    """Draw frequency error and MAC of every identified mode before and after linear updating (Song Table 2).

    Args:
        linear: phase I.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    modes = linear.modes
    position = np.arange(len(modes))
    measured = np.array([mode.identified_hz for mode in modes])
    errors = [
        100 * (np.array([getattr(mode, name) for mode in modes]) / measured - 1)
        for name in ("initial_hz", "updated_hz")
    ]
    shapes = [[getattr(mode, name) for mode in modes] for name in ("initial_mac", "updated_mac")]
    with house_style():
        grid = panels(axes, 1, 2, height_in=2.9)
        for ax, (before, after) in zip(grid[0], (errors, shapes), strict=True):
            for shift, values, color, label in ((-0.2, before, BLUE, "initial"), (0.2, after, VERMILION, "updated")):
                bars = ax.bar(position + shift, values, width=0.38, color=color, label=label)
                ax.bar_label(bars, [_short(value) for value in values], fontsize=7.5, padding=2)
            ax.margins(y=0.14)
            ax.set_xticks(position, [f"mode {mode.mode}" for mode in modes])
        grid[0, 0].axhline(0, color=INK, linewidth=0.9)
        grid[0, 0].set_ylabel("frequency error [%]")
        grid[0, 1].set_ylabel("MAC with the tests")
        thick(grid[0, 0].legend(loc="best"))
    return grid


def reduction_figure(errors: ReductionErrors, axes: Any = None, *, free: ReductionErrors | None = None) -> np.ndarray:
    """Draw frequency error and MAC of the reduced structure against the whole one, mode by mode (Song Fig. 7).

    A cross is the MAC with the mode that a reduced mode is most like, where that is another one than that of its
    number: the order has changed.

    Args:
        errors: of the reduction with sensors and joints held.
        axes: two Axes, or None for a new figure.
        free: of the reduction with free modes, drawn beside it.

    Returns:
        (1, 2) Axes.
    """
    crosses: list[Line2D] = []
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.0)
        left, right = grid[0]
        for each, style in zip((errors, free), (_HELD, _FREE), strict=True):
            if each is None:
                continue
            number = np.arange(1, len(each.frequency_hz) + 1)
            left.plot(number, np.maximum(100 * np.abs(each.relative), _LEAST_PERCENT), linewidth=1.0, **style)
            right.plot(number, each.mac, linewidth=1.0, **style)
            other = (each.nearest > 0) & (each.nearest != number)
            if other.any():
                crosses += right.plot(
                    number[other], each.nearest_mac[other], color=style["color"], marker="x", linestyle="none",
                    label="with the mode that it is most like",
                )  # fmt: skip
        left.set_yscale("log")
        left.set_ylabel("frequency error [%]")
        right.axhline(1, color=GREY, linewidth=0.9, linestyle="--")
        right.set_ylim(-0.03, 1.05)
        right.set_ylabel("MAC")
        for ax in grid[0]:
            ax.set_xlabel("mode")
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        # above the axes: an error may lie anywhere within
        above: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "fontsize": 8}
        thick(left.legend(ncols=2, **above))
        if crosses:
            right.legend(handles=crosses[:1], **above)
    return grid


def _short(value: float) -> str:
    """A number of three digits, at most three of them decimals."""
    return (f"{value:.3g}" if abs(value) >= 1 and value != 1 else f"{value:.3f}").replace("-", "−")
