"""Figures of a test bench: force against motion, the law, the laws that were tried, and what is left over."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.estimate import format_number, format_percent
from opid.mechanics.laws.law import Law
from opid.mechanics.memory import force_along
from opid.plots.laws import choose_color, choose_steps, name_steps
from opid.plots.style import (
    GREY,
    INK,
    PALE,
    RUN_COLORS,
    TRAVEL,
    VELOCITY,
    build_motion,
    format_law,
    house_style,
    panels,
    plain_numbers,
    thicken,
    thin_samples,
    write_note,
)
from opid.suspensions.bench.intervals import sine_of
from opid.suspensions.bench.law import BenchLaw
from opid.suspensions.bench.record import Bench
from opid.suspensions.law_search.pursuit import chosen

_DOTS: dict[str, Any] = {"linestyle": "none", "marker": ".", "markersize": 2.2, "markeredgewidth": 0}


def force_against_motion(result: BenchLaw, axes: Any = None) -> np.ndarray:
    """Draw the measured force over velocity and over travel, and what the law makes of the same motion.

    Args:
        result: the law of a bench.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes; (1, 1) of a quasi-static test, which has no velocity.
    """
    bench, shown, scale, unit = _choose_samples(result)
    fitted = bench.force - result.residual
    motions = list(zip(_list_motions(result), (VELOCITY, TRAVEL), strict=True))[bench.is_quasi_static :]
    with house_style():
        grid = panels(axes, 1, len(motions), height_in=3.7, sharey=True)
        for ax, (motion, label) in zip(grid[0], motions, strict=True):
            ax.plot(motion[shown], scale * bench.force[shown], color=PALE, label="measured", **_DOTS)
            ax.plot(motion[shown], scale * fitted[shown], color=RUN_COLORS[1], label="law", **_DOTS)
            ax.set_xlabel(label)
        grid[0, 0].set_ylabel(f"force [{unit}]")
        name = format_law(result.law.name)
        grid[0, 0].set_title(name)
        explained = f"{format_percent(result.r2_left_out, 4)} explained where left out"
        if bench.is_quasi_static:
            grid[0, 0].set_title(f"{name}: {explained}")
        else:
            grid[0, 1].set_title(explained, fontweight="normal")
        thicken(grid[0, 0].legend(loc="upper left"))
    return grid


def bench_curves(result: BenchLaw, axes: Any = None) -> np.ndarray:
    """Draw the law over velocity (at z = 0) and over travel (at z' = 0), beside the measured force less its other part.

    Of a law that remembers, a loop is drawn: that of a sine as large and as fast as the record.

    Args:
        result: the law of a bench.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes; (1, 1) of a quasi-static test, which has no velocity.
    """
    bench, shown, scale, unit = _choose_samples(result)
    found = result.parameters
    slopes = [found.damping_n_s_per_m.value or 0.0, found.stiffness_n_per_m.value or 0.0]
    memory = result.law.remembering
    remembered, cycle = force_along(memory, bench.travel, bench.velocity, bench.fs), _compute_cycle(memory, bench)
    raws = (bench.velocity, bench.travel)
    curves = list(zip(raws, _list_motions(result), slopes, ("velocity", "travel"), strict=True))[
        bench.is_quasi_static :
    ]
    with house_style():
        grid = panels(axes, 1, len(curves), height_in=3.7)
        for ax, (raw, drawn, slope, along) in zip(grid[0], curves, strict=True):
            line = np.linspace(raw.min(), raw.max(), 601)
            factor = 1.0 if along == "velocity" else 1e3
            curve, straight = _compute_force_along(result, line, slope, along), slope * line
            dots = (_compute_force_along(result, raw, slope, along) + remembered + result.residual)[shown]
            if result.loop is not None:
                line = cycle[0] if along == "travel" else cycle[1]
                curve, straight = _compute_force_along(result, line, slope, along) + cycle[2], slope * line
            ax.plot(drawn[shown], scale * dots, color=PALE, label="measured, less the rest of the law", **_DOTS)
            symbol = "C z′" if along == "velocity" else "K z"
            ax.plot(factor * line, scale * straight, color=GREY, linestyle="--", linewidth=1.1, label=symbol)
            ax.plot(factor * line, scale * curve, color=RUN_COLORS[1], linewidth=2.0, label=f"{symbol} + f")
            ax.set_xlabel(VELOCITY if along == "velocity" else TRAVEL)
            ax.set_title("Over velocity, z = 0" if along == "velocity" else "Over travel, z′ = 0")
            low, high = (float(scale * each) for each in (min(dots.min(), curve.min()), max(dots.max(), curve.max())))
            room = 0.06 * (high - low)
            # the limits do not depend on the straight part, which may be far steeper than the whole law
            ax.set_ylim(low - room, high + 5 * room)
            thicken(ax.legend(loc="upper left"))
        grid[0, 0].set_ylabel(f"part of the force [{unit}]")
    return grid


def bench_ladder(result: BenchLaw, ax: Any = None) -> Axes:
    """Draw the fraction of the force that each law leaves unexplained: those kept, and the best of the others.

    Args:
        result: the law of a bench.
        ax: one Axes, or None for a new figure.
    """
    steps, answer = choose_steps(result.ladder), chosen(result.ladder)
    # a law that leaves nothing needs a place on a logarithmic axis, %
    least = 1e-10
    with house_style():
        ax = panels(ax, 1, height_in=1.5 + 0.26 * len(steps))[0, 0]
        for row, step in enumerate(steps):
            color = choose_color(step, answer)
            left_out = step.fit.error_rms if step.left_out is None else step.left_out
            inside, outside = (max(100 * (1 - r2), least) for r2 in (step.fit.r2, step.fit.r2_of(left_out)))
            ax.plot([inside, outside], [row, row], color=color, linewidth=1)
            ax.plot([inside], [row], marker="o", markersize=6, color=color, markerfacecolor="white", linestyle="none")
            ax.plot([outside], [row], marker="o", markersize=6, color=color, linestyle="none")
            write_note(
                ax, f"{format_number(outside, 3)} %", (max(inside, outside), row), (7, 0), va="center", fontsize=8
            )
        static = max(100 * (1 - result.memory.r2_at_most), least)
        ax.axvline(static, color=INK, linestyle="--", linewidth=1)
        above: Any = ("data", "axes fraction")
        write_note(ax, "best without memory", (static, 1), (0, 3), xycoords=above, ha="center", fontsize=8)
        ax.set_xscale("log")
        low, high = ax.get_xlim()
        ax.set_xlim(low / 1.1, high * (high / low) ** 0.15)
        plain_numbers(ax.xaxis)
        name_steps(ax, steps, answer)
        ax.grid(True, axis="x", which="major")
        ax.set_xlabel("unexplained [%], fitted ○, left out ●")
        ax.set_title("Laws tried", pad=16)
    return ax


def bench_residual(result: BenchLaw, axes: Any = None) -> np.ndarray:
    """Draw what the law leaves over, over time, velocity and travel.

    Args:
        result: the law of a bench.
        axes: three Axes, or None for a new figure.

    Returns:
        (1, 3) Axes; (1, 2) of a quasi-static test, which has no velocity.
    """
    bench, shown, scale, unit = _choose_samples(result)
    time = np.arange(bench.force.size) / bench.fs
    with house_style():
        velocity, travel = _list_motions(result)
        quantities = [(time, "time [s]"), (velocity, VELOCITY), (travel, TRAVEL)]
        if bench.is_quasi_static:
            quantities = [(time, "distance [m]"), (travel, TRAVEL)]
        grid = panels(axes, 1, len(quantities), height_in=3.1, sharey=True)
        for ax, (along, label) in zip(grid[0], quantities, strict=True):
            ax.plot(along[shown], scale * result.residual[shown], color=RUN_COLORS[0], **_DOTS)
            ax.axhline(0, color=INK, linewidth=0.8)
            ax.set_xlabel(label)
            ax.locator_params(axis="x", nbins=5)
        grid[0, 0].set_ylabel(f"force less law [{unit}]")
        whole = float(np.sqrt(np.mean(bench.force[bench.samples] ** 2)))
        grid[0, 0].set_title(
            f"{format_number(scale * result.residual_rms, 3)} {unit} rms left over of {format_number(scale * whole, 3)}"
        )
    return grid


def _list_motions(result: BenchLaw) -> tuple[np.ndarray, np.ndarray]:
    """Velocity in m/s and travel in mm, as they are drawn."""
    return result.bench.velocity, 1e3 * result.bench.travel


def _compute_force_along(result: BenchLaw, position: np.ndarray, slope: float, along: str) -> np.ndarray:
    """The force along travel or velocity while the other is zero, without the terms that remember."""
    static = Law(tuple(term for term in result.law.terms if term.kind.memory is None))
    return slope * position + static.force(*build_motion(position, along))


def _compute_cycle(memory: Law, bench: Bench) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Travel, velocity, and force of the terms that remember, over the last cycle of a sine like the record."""
    z, v, fs = sine_of(bench)
    n = z.size // 4
    return z[-n:], v[-n:], force_along(memory, z, v, fs)[-n:]


def _choose_samples(result: BenchLaw) -> tuple[Bench, np.ndarray, float, str]:
    """The record, those of its samples that are drawn, and the unit of force with the factor from newtons.

    Where the law does not hold (a voltage is off) nothing is drawn: it would look like an error of the law.
    """
    bench = result.bench
    counted = bench.samples
    factor, unit = (1e-3, "kN") if np.abs(bench.force[counted]).max() >= 5e3 else (1.0, "N")
    return bench, counted[thin_samples(counted.size)], factor, unit
