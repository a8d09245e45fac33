"""Figure of a plan: expected standard deviations over the duration of the runs and their mass change."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.plots.style import (
    GREY,
    INK,
    choose_run_colors,
    format_minus,
    format_units,
    house_style,
    panels_in_rows,
    plain_numbers,
)
from opid.suspensions.planning.result import PlanResult


def expected_std(result: PlanResult, axes: Any = None) -> Axes:
    """Draw the expected standard deviation of each target over the duration of a run, one line for each mass change.

    A circle marks the best plan, and a dashed line the target.

    Args:
        result: the plan.
        axes: one Axes for each target, or None for a new figure.
    """
    grid, loaded = result.grid, [each for each in result.best.runs if each.mass_change_kg]
    units = {each.name: each.unit for each in result.best.numbers}
    with house_style():
        axes = panels_in_rows(axes, len(result.targets), min(2, len(result.targets)), height_in=3.6).ravel()
        for ax, target, table in zip(axes, result.targets, grid.std, strict=False):
            colors = choose_run_colors(len(grid.mass_changes_kg))
            for change_kg, row, color in zip(grid.mass_changes_kg, table, colors, strict=True):
                std = np.array([np.nan if each is None else each for each in row])
                if np.isfinite(std).any():
                    label = format_minus(f"{change_kg:+g} kg")
                    ax.plot(grid.durations_s, std, color=color, marker=".", label=label)
            ax.axhline(target.std, color=GREY, linestyle="--", linewidth=1, label="target")
            reached = result.best.std_of(target.name)
            if result.best.runs and reached is not None:
                name = "cheapest plan" if result.cheapest is not None else "nearest plan"
                duration_s = (loaded or result.best.runs)[0].duration_s
                mark: Any = {"marker": "o", "markersize": 10, "markerfacecolor": "none", "linestyle": "none"}
                ax.plot([duration_s], [reached], color=INK, label=name, **mark)
            ax.set(xscale="log", yscale="log", xlabel="duration of each run [s]", title=target.name)
            ax.set_ylabel(f"expected std. dev. [{format_units(units[target.name])}]")
            for axis in (ax.xaxis, ax.yaxis):
                plain_numbers(axis)
        axes[0].legend()
    return axes[0]
