"""Figures of a body in motion: the force of each suspension, measured and predicted accelerations, what is left."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.mechanics.laws.law import Law
from opid.mechanics.truth import BodyTruth
from opid.plots.body import further_sensors
from opid.plots.style import (
    BLUE,
    GREEN,
    INK,
    PALE,
    SKY,
    VERMILION,
    figure_of,
    house_style,
    panels,
    plain_numbers,
    require_answer,
    run_colors,
    thick,
)
from opid.suspensions.result import Identification, InterfaceEstimate, RunResidual

__all__ = ["body_residuals", "predicted_accelerations", "suspension_forces"]

Truth = Mapping[str, Any]
_TRAVEL, _VELOCITY = "travel z [mm]", "velocity z′ [m/s]"
# lines of the residual are averaged over so many Hz
SMOOTHING_HZ = 0.5
# of measured and predicted accelerations that is shown
SHOWN_S = 4.0


def suspension_forces(result: Identification, axes: Any = None, *, truth: BodyTruth | None = None) -> np.ndarray:
    """Draw the force of each suspension over velocity and over travel, and its nonlinear part.

    Suspensions that share one law share a row.

    Args:
        result: the identification.
        axes: two Axes for each row, or None for a new figure.
        truth: of a simulated aircraft: the true nonlinear part is drawn too.

    Returns:
        (n_rows, 2) Axes.

    Raises:
        NotDeterminedError: the fit was refused.
    """
    require_answer(result)
    shown = [
        each
        for index, each in enumerate(result.interfaces)
        if not any(before.name in each.shared_with for before in result.interfaces[:index])
    ]
    with house_style():
        grid = panels(axes, len(shown), 2, height_in=0.5 + 2.4 * len(shown))
        for row, interface in zip(grid, shown, strict=True):
            _forces(row, result, interface, _true_law(interface, truth, result.per_mass))
        grid[-1, 0].set_xlabel(_VELOCITY)
        grid[-1, 1].set_xlabel(_TRAVEL)
        for ax in grid[0]:
            thick(ax.legend(loc="upper left", fontsize=7, handlelength=1.4, labelspacing=0.3))
    return grid


def predicted_accelerations(
    result: Identification, axes: Any = None, *, run: str | None = None, start_s: float | None = None
) -> np.ndarray:
    """Draw some seconds of what each sensor on the body read and of what the model said it would, offsets removed.

    Args:
        result: the identification.
        axes: one Axes a sensor, or None for a new figure.
        run: name of the run; the first where left out.
        start_s: first time; where left out the stretch is around the largest reading.

    Returns:
        (n_sensors, 1) Axes.

    Raises:
        NotDeterminedError: the fit was refused.
    """
    require_answer(result)
    shown = next((each for each in result.runs if each.name == run), result.runs[0])
    begin = _loudest(shown) if start_s is None else start_s
    part = (shown.time_s >= begin) & (shown.time_s <= begin + SHOWN_S)
    names = sensor_names(result, len(shown.measured))
    with house_style():
        grid = panels(axes, len(names), height_in=0.7 + 1.55 * len(names), sharex=True)
        for ax, name, measured, predicted in zip(grid[:, 0], names, shown.measured, shown.predicted, strict=True):
            # an accelerometer may have an offset, of which the model knows nothing
            read = measured - float(np.mean(measured - predicted))
            left, time = read - predicted, shown.time_s[part]
            ax.plot(time, read[part], color=PALE, linewidth=3.5, label="measured")
            ax.plot(time, predicted[part], color=BLUE, linewidth=1.0, label="predicted")
            label = f"difference, {1e3 * float(left.std()):.2g} mm/s² rms"
            ax.plot(time, left[part], color=VERMILION, linewidth=0.8, label=label)
            ax.set_title(name)
            ax.set_ylabel("acceleration [m/s²]")
            ax.margins(x=0)
            thick(ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1))
        grid[-1, 0].set_xlabel(f"time [s], run {shown.name!r}")
    return grid


def body_residuals(result: Identification, axes: Any = None) -> np.ndarray:
    """Draw the errors of the prediction of each sensor over its noise, averaged over neighbouring lines.

    Args:
        result: the identification.
        axes: one Axes a sensor (a multiple of two from four on), or None for a new figure.

    Returns:
        (n_rows, n_columns) Axes, the last switched off if it is not needed.

    Raises:
        NotDeterminedError: the fit was refused.
    """
    require_answer(result)
    names = sensor_names(result, max(len(run.residual) for run in result.runs))
    columns = 1 if len(names) < 4 else 2
    rows = -(-len(names) // columns)
    with house_style():
        grid = panels(axes, rows, columns, height_in=0.7 + 1.75 * rows, sharex=True, sharey=True)
        for index, (ax, name) in enumerate(zip(grid.ravel(), names, strict=False)):
            for run, color in zip(result.runs, run_colors(len(result.runs)), strict=True):
                ax.plot(*_smooth_residual(run, index), color=color, linewidth=1.2, label=f"run {run.name!r}")
            ax.axhline(1.0, color=INK, linestyle="--", linewidth=1, label="noise")
            ax.set_title(name)
            ax.margins(x=0)
        for ax in grid.ravel()[len(names) :]:
            ax.set_axis_off()
        grid[0, 0].set_yscale("log")
        _frame(grid[0, 0])
        for row in grid:
            row[0].set_ylabel("residual over noise")
        for ax in grid[-1]:
            ax.set_xlabel("frequency [Hz]")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        thick(figure_of(grid).legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5)))
    return grid


def sensor_names(result: Identification, n_sensors: int) -> list[str]:
    """Return what the sensors on the body are called: after their suspensions, then the further ones.

    Of pairs the means come first, then the suspensions that are in none.

    Args:
        result: the identification.
        n_sensors: number of sensors.
    """
    names = [f"above {interface.name}" for interface in result.interfaces]
    if result.structure == "pair":
        pairs = [candidate.interfaces for candidate in result.candidates if candidate.kind == "pair"]
        paired = {name for pair in pairs for name in pair}
        names = [f"mean above {', '.join(pair)}" for pair in pairs]
        names += [f"above {interface.name}" for interface in result.interfaces if interface.name not in paired]
    elif result.structure == "rigid_body":
        names += further_sensors(result)
    return [*names[:n_sensors], *(f"sensor {index + 1}" for index in range(len(names), n_sensors))]


def _true_law(interface: InterfaceEstimate, truth: BodyTruth | None, per_mass: bool) -> Law | None:
    true = None if truth is None else truth.interfaces.get(interface.name)
    if truth is None or true is None:
        return None
    return true.law.scaled(1.0 / truth.parameters.sprung_mass_kg) if per_mass else true.law


def _forces(row: np.ndarray, result: Identification, interface: InterfaceEstimate, true: Law | None) -> None:
    unit, scale = ("m/s²", 1.0) if result.per_mass else ("kN", 1e-3)
    together = [name for name in (interface.name, *interface.shared_with) if name in result.places] or [interface.name]
    together = list(dict.fromkeys(together))
    for ax, along, visited, slope, factor in (
        (row[0], "velocity", interface.velocity, interface.damping.value, 1.0),
        (row[1], "travel", interface.travel, interface.stiffness.value, 1e3),
    ):
        line = np.linspace(-1.0, 1.0, 401) * (float(np.abs(visited).max()) if visited.size else 0.0)
        zero = np.zeros_like(line)
        motion = (zero, line) if along == "velocity" else (line, zero)
        rms = factor * float(np.sqrt(np.mean(visited**2))) if visited.size else 0.0
        ax.axvspan(-rms, rms, color="#F1F1F1", zorder=0, label="± rms of the motion")
        nonlinear, symbol = interface.law.force(*motion), "C z′" if along == "velocity" else "K z"
        if slope is not None:
            linear = slope * line
            # where f is nothing both are one line: the dashed one lies on top of the wide one
            ax.plot(factor * line, scale * linear, color=INK, linewidth=1.1, linestyle="--", label=symbol, zorder=2.5)
            ax.plot(factor * line, scale * (linear + nonlinear), color=SKY, linewidth=3.2, label=f"{symbol} + f")
        ax.plot(factor * line, scale * nonlinear, color=VERMILION, linewidth=2.0, label="nonlinear part f")
        if true is not None:
            force = scale * true.force(*motion)
            ax.plot(factor * line, force, color=GREEN, linewidth=4, alpha=0.45, label="f, truth", zorder=1.5)
        ax.margins(x=0)
    row[0].set_ylabel(f"force{' / M' * result.per_mass} [{unit}]")
    law = interface.law.name.replace("_", " ").replace("+", " + ")
    row[0].set_title(", ".join(together))
    row[1].set_title(f"law: {law}", fontweight="normal")


def _loudest(run: RunResidual) -> float:
    """Begin of the stretch around the largest reading, within the run."""
    peak = float(run.time_s[int(np.argmax(np.abs(run.measured).max(axis=0)))])
    return max(float(run.time_s[0]), min(peak - 0.5 * SHOWN_S, float(run.time_s[-1]) - SHOWN_S))


def _smooth_residual(run: RunResidual, sensor: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequency, and rms of the residual of some lines around it."""
    frequency = run.frequency_hz
    n = max(1, min(frequency.size, round(SMOOTHING_HZ / float(frequency[1] - frequency[0]))))
    power = np.convolve(np.abs(run.residual[sensor]) ** 2, np.ones(n), "valid") / n
    return np.convolve(frequency, np.ones(n), "valid") / n, np.sqrt(power)


def _frame(ax: Axes) -> None:
    """Heights that leave noise flat: at least from a half to two."""
    low, high = ax.get_ylim()
    ax.set_ylim(min(low, 0.5), max(high, 2.0))
    plain_numbers(ax.yaxis)
