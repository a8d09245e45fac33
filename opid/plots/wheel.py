"""Figure of wheel, tyre and road: the spectrum of the force through the tyre, measured and fitted."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import chi2

from opid.errors import InputError
from opid.plots.style import BLUE, INK, format_units, house_style, panels_in_rows, plain_numbers
from opid.suspensions.wheel.result import WheelIdentification


def force_spectra(result: WheelIdentification, axes: Any = None) -> np.ndarray:
    """Draw the spectrum of the rate of the force through the tyre of each run, and that of the fitted road and tyre.

    The band holds 95 % of the measured lines if the fit is right.

    Args:
        result: wheel, tyre and road.
        axes: one Axes for each run, or None for a new figure.

    Returns:
        (n_rows, n_columns) Axes.

    Raises:
        InputError: nothing is determined.
    """
    if result.not_determined:
        raise InputError(f"there is no spectrum to draw: {result.not_determined}")
    unit = "1/s^4" if result.per_mass else "N^2/s^2/Hz"
    with house_style():
        grid = panels_in_rows(axes, len(result.roads), min(2, len(result.roads)), height_in=3.2)
        for ax, road in zip(grid.ravel(), result.roads, strict=False):
            # Blocks overlap by half, and share almost nothing under their windows.
            low, high = (chi2.ppf(each, 2 * road.n_blocks) / (2 * road.n_blocks) for each in (0.025, 0.975))
            ax.fill_between(
                road.frequency_hz, low * road.fitted, high * road.fitted, color=BLUE, alpha=0.25, linewidth=0
            )
            ax.plot(road.frequency_hz, road.measured, color=INK, linewidth=0.8, label="measured")
            ax.plot(road.frequency_hz, road.fitted, color=BLUE, linewidth=1.4, label="fitted")
            ax.set(xscale="log", yscale="log", xlabel="frequency [Hz]", title=road.run)
            plain_numbers(ax.xaxis)
        grid[0, 0].set_ylabel(format_units(f"rate of the force [{unit}]"))
        grid[0, 0].legend()
    return grid
