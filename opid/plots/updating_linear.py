"""Figures of the linear structure: what its updating did to frequencies and shapes, what its reduction leaves out."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from opid.plots.style import BLUE, GREY, INK, VERMILION, house_style, panels, thick
from opid.updating.reduction import ReductionErrors
from opid.updating.result import LinearPosterior

__all__ = ["linear_updating", "reduction_figure"]


def linear_updating(linear: LinearPosterior, axes: Any = None) -> np.ndarray:
    """Draw frequency error and MAC of every identified mode before and after linear updating (Song Table 2).

    Args:
        linear: phase I.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    modes = linear.modes
    place = np.arange(len(modes))
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
                bars = ax.bar(place + shift, values, width=0.38, color=color, label=label)
                ax.bar_label(bars, fmt="%.3g", fontsize=7.5, padding=2)
            ax.margins(y=0.14)
            ax.set_xticks(place, [f"mode {mode.mode}" for mode in modes])
        grid[0, 0].axhline(0, color=INK, linewidth=0.9)
        grid[0, 0].set_ylabel("frequency error [%]")
        grid[0, 1].set_ylabel("MAC with the tests")
        thick(grid[0, 0].legend(loc="best"))
    return grid


def reduction_figure(errors: ReductionErrors, axes: Any = None) -> np.ndarray:
    """Draw frequency error and MAC of the reduced structure against the whole one, mode by mode (Song Fig. 7).

    Args:
        errors: of the reduction.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    number = np.arange(1, len(errors.frequency_hz) + 1)
    percent = 100 * np.abs(errors.relative)
    with house_style():
        grid = panels(axes, 1, 2, height_in=2.9)
        left, right = grid[0]
        left.plot(number, np.maximum(percent, 1e-12), color=BLUE, marker="o", markersize=4, linewidth=1.0)
        left.set_yscale("log")
        left.set_ylabel("frequency error [%]")
        right.plot(number, errors.mac, color=VERMILION, marker="o", markersize=4, linewidth=1.0)
        right.axhline(1, color=GREY, linewidth=0.9, linestyle="--")
        right.set_ylim(min(0.0, float(np.min(errors.mac))), 1.05)
        right.set_ylabel("MAC")
        for ax in grid[0]:
            ax.set_xlabel("mode")
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    return grid
