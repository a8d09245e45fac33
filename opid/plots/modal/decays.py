"""Figure of a free decay: the record, and frequency and damping over its amplitude."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import Decay
from opid.plots.style import BLUE, INK, PALE, VERMILION, house_style, panels, thick

__all__ = ["free_decay_figure"]

# heights are chosen for values known to this fraction of how far the well-known half of them ranges
KNOWN = 0.5
# room above and below them, fraction of their range
ROOM = 0.08


def free_decay_figure(decay: Decay, axes: Any = None, *, law: DecayLaw | None = None) -> np.ndarray:
    """Draw a free decay with the amplitude that was followed, and natural frequency and damping ratio over it.

    Heights are chosen for what is known well: at the smallest amplitudes the band may leave the panel.

    Args:
        decay: what it shows.
        axes: three Axes, or None for a new figure.
        law: a law of the mode, of this decay or of several, drawn beside what was measured.

    Returns:
        (1, 3) Axes.
    """
    factor, unit = _readable(float(decay.amplitude.max()), decay.amplitude_unit)
    with house_style():
        grid = panels(axes, 1, 3, height_in=3.0, width_in=9.0)
        _record(grid[0, 0], decay)
        shown = decay if law is None else law
        _panel(
            grid[0, 1], factor, decay.amplitude, decay.frequency_hz, decay.frequency_std_hz,
            shown.frequency_low_hz.value, None if law is None else (law.amplitude, law.frequency_hz),
        )  # fmt: skip
        _panel(
            grid[0, 2], factor, decay.amplitude, decay.damping_ratio, decay.damping_std,
            shown.damping_low.value, None if law is None else (law.amplitude, law.damping_ratio), percent=True,
        )  # fmt: skip
        for ax, label in ((grid[0, 1], "natural frequency [Hz]"), (grid[0, 2], "damping ratio [%]")):
            ax.set_xlabel(f"amplitude [{unit}]")
            ax.set_ylabel(label)
        thick(grid[0, 1].legend(loc="best", fontsize=7.5))
    return grid


def _record(ax: Axes, decay: Decay) -> None:
    ax.plot(decay.time_s, decay.signal, color=PALE, linewidth=0.6, label="record")
    for sign in (1, -1):
        label = "amplitude" if sign > 0 else None
        ax.plot(decay.time_s, sign * decay.envelope, color=VERMILION, linewidth=1.4, label=label)
    ax.set_xlabel("time [s]")
    ax.set_ylabel(f"[{_print_unit(decay.signal_unit)}]")
    ax.set_title(decay.name if decay.mode is None else f"{decay.name}, mode {decay.mode}")
    thick(ax.legend(loc="upper right", fontsize=7.5))


def _panel(
    ax: Axes,
    factor: float,
    amplitude: np.ndarray,
    values: np.ndarray,
    std: np.ndarray,
    low: float | None,
    law: tuple[np.ndarray, np.ndarray] | None,
    *,
    percent: bool = False,
) -> None:
    """Draw what was measured with its band, the law, and its limit, as high as what is known well needs it."""
    scale = 100.0 if percent else 1.0
    known = _known(values, std)
    below, above = scale * (values - 1.96 * std), scale * (values + 1.96 * std)
    at = factor * amplitude
    ax.fill_between(at, below, above, color=VERMILION, alpha=0.25, linewidth=0, label="95 %")
    ax.plot(at, scale * values, color=VERMILION, linewidth=0.7, alpha=0.4)
    ax.plot(at, np.where(known, scale * values, np.nan), color=VERMILION, linewidth=1.6, label="measured")
    if law is not None:
        ax.plot(factor * law[0], scale * law[1], color=INK, linewidth=1.0, label="law")
    ends = [*below[known], *above[known]]
    if low is not None:
        ends.append(scale * low)
        ax.axhline(scale * low, color=BLUE, linestyle="--", linewidth=1.1, label="law, at zero amplitude")
    room = ROOM * (max(ends) - min(ends)) or ROOM * abs(ends[0]) or 1.0
    ax.set_ylim(min(ends) - room, max(ends) + room)
    ax.set_xscale("log")


def _known(values: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Which values are known well, beside how far the better half of them ranges: they rule the heights."""
    better = std <= np.median(std)
    enough = max(KNOWN * float(np.ptp(values[better])), 2.0 * 1.96 * float(np.quantile(std, 0.25)))
    return 1.96 * std <= enough


def _readable(largest: float, unit: str) -> tuple[float, str]:
    """A factor and a unit in which an amplitude in m or m kg^1/2 is easy to read."""
    factor, prefix = (1e3, "m") if largest >= 1e-3 else (1e6, "µ")
    return factor, prefix + _print_unit(unit)


def _print_unit(unit: str) -> str:
    return unit.replace("kg^1/2", "√kg").replace("^2", "²")
