"""Figures of the choice of a law: the laws that were tried, and the force without a law beside the chosen one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.estimate import format_number
from opid.plots.style import (
    BEHIND,
    GREY,
    INK,
    PALE,
    RUN_COLORS,
    SURFACE_MAP,
    TRAVEL,
    VELOCITY,
    figure_of,
    format_law,
    house_style,
    name_rows,
    panels,
    plain_numbers,
    write_note,
)
from opid.suspensions.law_search.force_surface import ForceSurface
from opid.suspensions.law_search.pursuit import F, LawStep, chosen
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification

Ladder = Sequence[LawStep[Any]]

# this many laws are shown though the search rejected them
N_OTHERS = 8


def law_ladder(result: AnyIdentification, ax: Any = None) -> Axes:
    """Draw the noise that each law leaves unexplained, against the noise floor of the sensors.

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.
    """
    if isinstance(result, PaperIdentification):
        return model_ladder(result.ladder, ax, noise_floor_m_per_s2=result.chain.noise_floor_m_per_s2)
    return model_ladder(result.evidence[0].ladder, ax, noise_floor_m_per_s2=result.evidence[0].noise)


def model_ladder(ladder: Ladder, ax: Any = None, *, noise_floor_m_per_s2: float | None = None) -> Axes:
    """Draw what each law leaves of the runs it was fitted to and of runs that were left out, its criterion beside it.

    Args:
        ladder: of a search for laws, by the driven model or by the chain of the paper.
        ax: one Axes, or None for a new figure.
        noise_floor_m_per_s2: of the sensors.
    """
    steps, best = choose_steps(ladder), chosen(ladder)
    with house_style():
        ax = panels(ax, 1, height_in=1.3 + 0.32 * len(steps))[0, 0]
        for row, step in enumerate(steps):
            color = choose_color(step, best)
            fitted = 1e3 * step.fit.noise_m_per_s2
            ax.plot([fitted], [row], marker="o", markersize=7, color=color, linestyle="none")
            if step.left_out is not None:
                left_out = 1e3 * step.left_out
                look: dict[str, Any] = {"markersize": 10, "markerfacecolor": "none", "linestyle": "none"}
                ax.plot([left_out], [row], marker="D", color=color, **look)
            behind = step.fit.bic - best.fit.bic
            text = format_number(fitted, 4)
            if step is not best:
                text += f"   BIC {format_number(round(behind), has_sign=True)}"
            write_note(ax, text, (fitted, row), (10, 0), va="center", fontsize=8, bbox=BEHIND)
        if noise_floor_m_per_s2 is not None:
            floor = 1e3 * noise_floor_m_per_s2
            ax.axvline(floor, color=INK, linestyle="--", linewidth=1)
            write_note(
                ax,
                f"noise floor {format_number(floor, 2)}",
                (floor, 1),
                (4, 3),
                xycoords=("data", "axes fraction"),
                fontsize=8,
            )
        low, high = ax.get_xlim()
        # the text at the right needs room
        if (low > 0 and high / low > 3) or min(step.fit.noise_m_per_s2 for step in steps) * 3e3 < high:
            ax.set_xscale("log")
            low, high = ax.get_xlim()
            ax.set_xlim(low, high * (high / low) ** 0.45)
            plain_numbers(ax.xaxis)
        else:
            ax.set_xlim(low, high + 0.35 * (high - low))
        name_steps(ax, steps, best)
        ax.grid(True, axis="x", which="major")
        ax.set_xlabel("unexplained [mm/s² rms], ◇ left out")
        ax.set_title("Laws tried, the chosen one in colour", pad=16)
    return ax


def force_departures(surface: ForceSurface, ax: Any = None) -> Axes:
    """Draw by how many standard errors the measured force departs from the law over the visited motion.

    Args:
        surface: from `force_surface`.
        ax: one Axes, or None for a new figure.
    """
    # departures of this many standard errors or more have the darkest colours
    limit = 5.0
    with house_style():
        ax = panels(ax, 1, height_in=4.0, width_in=5.6)[0, 0]
        mesh = ax.pcolormesh(
            1e3 * surface.travel_edges,
            surface.velocity_edges,
            np.ma.masked_invalid(surface.departure.T),
            cmap=SURFACE_MAP,
            vmin=-limit,
            vmax=limit,
        )
        bar = figure_of(ax).colorbar(mesh, ax=ax, extend="both")
        bar.set_label("measured less law [standard errors]")
        ax.set_facecolor("#F2F2F2")
        ax.grid(False)
        ax.set_xlabel(TRAVEL)
        ax.set_ylabel(VELOCITY)
        ax.set_title(
            f"Largest departure {surface.largest_standard_errors:.1f} standard errors\n"
            f"(chance alone: up to {surface.expected_standard_errors:.1f})",
            fontweight="normal",
        )
    return ax


def force_sections(surface: ForceSurface, axes: Any = None) -> np.ndarray:
    """Draw the force that stiffness and damping leave, along travel and velocity with 95 % bands, and the law over it.

    Args:
        surface: from `force_surface`.
        axes: two Axes, or None for a new figure.

    Both panels have one scale, so that the larger part of the force looks larger.

    Returns:
        (1, 2) Axes.
    """
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.6, sharey=True)
        sections = (surface.along_travel, surface.along_velocity)
        labels = (f"{TRAVEL}, z′ near 0", f"{VELOCITY}, z near 0")
        for ax, section, factor, label in zip(grid[0], sections, (1e3, 1.0), labels, strict=True):
            x = factor * section.position
            known = np.isfinite(section.mean)
            band = 2 * section.standard_error
            ax.fill_between(
                x[known], (section.mean - band)[known], (section.mean + band)[known], color=PALE, label="measured, 95 %"
            )
            ax.plot(x, section.mean, color=INK, marker="o", markersize=3.5, linestyle="none", label="measured")
            ax.plot(x, section.law, color=RUN_COLORS[1], linewidth=1.8, label="law")
            ax.set_xlabel(label)
            along = label.split()[0]
            largest = float(np.abs(section.law).max())
            ax.set_title(f"Law over {along}: up to {format_number(largest, 2)} m/s²", fontweight="normal")
        grid[0, 0].set_ylabel("force per mass less (K z + C z′) [m/s²]")
        handles, words = grid[0, 0].get_legend_handles_labels()
        figure_of(grid).legend(handles, words, loc="outside lower center", ncols=3)
    return grid


def choose_steps(ladder: Sequence[LawStep[F]]) -> list[LawStep[F]]:
    """Return the steps of a search that were kept, and the most likely ones of the others."""
    others = sorted((step for step in ladder if not step.kept), key=lambda step: step.fit.bic)[:N_OTHERS]
    return [step for step in ladder if step.kept or step in others]


def choose_color(step: LawStep[Any], best: LawStep[Any]) -> str:
    """Return the colour of a step of a ladder, of which `best` was chosen."""
    return RUN_COLORS[1] if step is best else INK if step.kept else GREY


def name_steps(ax: Axes, steps: Sequence[LawStep[Any]], best: LawStep[Any]) -> None:
    """Write the laws of the steps beside the rows of an Axes, from the top."""
    names = [format_law(step.law_name) + " (sparse)" * (step.method == "sparse regression") for step in steps]
    name_rows(ax, names, [choose_color(step, best) for step in steps], chosen=[step is best for step in steps])
