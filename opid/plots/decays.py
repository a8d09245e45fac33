"""Figure of a free decay: the record, and frequency and damping over its amplitude."""

from __future__ import annotations

from typing import Any

import numpy as np

from opid.modal.free_decay import Decay
from opid.plots.style import BLUE, PALE, VERMILION, house_style, panels, thick

__all__ = ["free_decay_figure"]


def free_decay_figure(decay: Decay, axes: Any = None) -> np.ndarray:
    """Draw a free decay with the amplitude that was followed, and natural frequency and damping ratio over it.

    Args:
        decay: what it shows.
        axes: three Axes, or None for a new figure.

    Returns:
        (1, 3) Axes.
    """
    factor, unit = _readable(float(decay.amplitude.max()), decay.amplitude_unit)
    amplitude = factor * decay.amplitude
    with house_style():
        grid = panels(axes, 1, 3, height_in=3.0, width_in=9.0)
        record, frequency, damping = grid[0]
        record.plot(decay.time_s, decay.signal, color=PALE, linewidth=0.6, label="record")
        for sign in (1, -1):
            label = "amplitude" if sign > 0 else None
            record.plot(decay.time_s, sign * decay.envelope, color=VERMILION, linewidth=1.4, label=label)
        record.set_xlabel("time [s]")
        record.set_ylabel(f"[{_printed(decay.signal_unit)}]")
        record.set_title(decay.name if decay.mode is None else f"{decay.name}, mode {decay.mode}")
        thick(record.legend(loc="upper right", fontsize=7.5))
        for ax, values, std, low, label in (
            (frequency, decay.frequency_hz, decay.frequency_std_hz, decay.frequency_low_hz, "natural frequency [Hz]"),
            (damping, 100 * decay.damping_ratio, 100 * decay.damping_std, decay.damping_low, "damping ratio [%]"),
        ):
            ax.fill_between(
                amplitude, values - 1.96 * std, values + 1.96 * std, color=VERMILION, alpha=0.25, linewidth=0
            )
            ax.plot(amplitude, values, color=VERMILION, linewidth=1.4, label="measured, 95 %")
            if low.value is not None:
                height = low.value if ax is frequency else 100 * low.value
                ax.axhline(height, color=BLUE, linestyle="--", linewidth=1.1, label="at zero amplitude")
            ax.set_xscale("log")
            ax.set_xlabel(f"amplitude [{unit}]")
            ax.set_ylabel(label)
        thick(frequency.legend(loc="best", fontsize=7.5))
    return grid


def _readable(largest: float, unit: str) -> tuple[float, str]:
    """A factor and a unit in which an amplitude in m or m kg^1/2 is easy to read."""
    factor, prefix = (1e3, "m") if largest >= 1e-3 else (1e6, "µ")
    return factor, prefix + _printed(unit)


def _printed(unit: str) -> str:
    return unit.replace("kg^1/2", "√kg").replace("^2", "²")
