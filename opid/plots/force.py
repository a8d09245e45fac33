"""Figures of the restoring force: the surface, its two slices, and the law that was found."""

from __future__ import annotations

from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from opid.errors import NotDeterminedError
from opid.estimate import format_number
from opid.mechanics.laws.law import Law
from opid.mechanics.truth import BodyTruth, GearTruth, SuspensionTruth, TaxiTruth
from opid.mechanics.weight import depends_on_travel
from opid.plots.style import (
    COUNT_MAP,
    GREEN,
    GREY,
    INK,
    PALE,
    RUN_COLORS,
    SHADED,
    SURFACE_MAP,
    TRAVEL,
    VELOCITY,
    WIDTH_IN,
    build_motion,
    choose_run_colors,
    find_true_scale,
    format_minus,
    format_run,
    house_style,
    panels,
    require_answer,
    take_axes,
    thicken,
    thin_samples,
)
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.printed import PrintedRun
from opid.suspensions.paper.restoring_force import LawFit, SliceCurve
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.result import Identification, InterfaceEstimate

_FORCE = "force per mass −x₂″ [m/s²]"


def restoring_force_surface(run: RunEvidence, ax: Any = None) -> Axes:
    """Draw the averaged restoring-force surface in three dimensions.

    Args:
        run: one run of the evidence.
        ax: three-dimensional Axes, or None for a new figure.
    """
    from mpl_toolkits.mplot3d import Axes3D

    from opid.plots.charts.surfaces import Surface

    with house_style():
        if ax is None:
            ax = Figure(figsize=(6.4, 4.6)).add_axes((0.02, 0.02, 0.94, 0.98), projection="3d")
        assert isinstance(ax, Axes3D)
        take_axes([ax])
        travel, velocity = run.binned.centres
        faces = _list_faces(np.stack([1e3 * travel, velocity, run.binned.mean], axis=-1))
        limit = float(np.nanmax(np.abs(run.binned.mean)))
        surface = Surface(faces, faces[..., 2].mean(axis=1), cmap=SURFACE_MAP, edgecolor=GREY, linewidth=0.3)
        surface.set_clim(-limit, limit)
        ax.add_collection3d(surface, autolim=False)
        ax.set(xlim=(1e3 * travel.min(), 1e3 * travel.max()), ylim=(velocity.min(), velocity.max()))
        ax.set(zlim=(-limit, limit), xlabel=TRAVEL, ylabel=VELOCITY, zlabel="−x₂″ [m/s²]")
        ax.locator_params(nbins=5)
        ax.view_init(elev=24, azim=-125)
        ax.set_box_aspect((4, 4, 3), zoom=0.95)
        ax.set_title(f"Mean restoring force, {format_run(run)}", loc="center", y=0.98)
    return ax


def _list_faces(points: np.ndarray) -> np.ndarray:
    """Quadrangles (n, 4, 3) between neighbouring points (rows, columns, 3), where all four are known."""
    corners = [points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]]
    faces = np.stack(corners, axis=2).reshape(-1, 4, 3)
    return faces[np.isfinite(faces).all(axis=(1, 2))]


def restoring_force_map(run: RunEvidence, axes: Any = None) -> np.ndarray:
    """Draw the averaged restoring-force surface from above, and how many points stand behind each cell.

    Args:
        run: one run of the evidence.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    binned = run.binned
    edges = (1e3 * binned.travel_edges, binned.velocity_edges)
    limit = float(np.nanmax(np.abs(binned.mean)))
    with house_style():
        grid = panels(axes, 1, 2, height_in=4.2, sharex=True, sharey=True)
        force_ax, count_ax = grid[0]
        color = force_ax.pcolormesh(*edges, binned.mean.T, cmap=SURFACE_MAP, vmin=-limit, vmax=limit)
        travel, velocity = binned.centres
        levels = force_ax.contour(
            1e3 * travel, velocity, np.ma.masked_invalid(binned.mean), levels=9, colors=INK, linewidths=0.6
        )
        force_ax.clabel(levels, fontsize=7.5, fmt=lambda level: format_minus(format_number(level)))
        # the words stand below the map: beside it they would seem to belong to the next one
        force_ax.figure.colorbar(color, ax=force_ax, label=_FORCE, location="bottom")
        counts = np.ma.masked_equal(binned.counts, 0)
        color = count_ax.pcolormesh(*edges, counts.T, cmap=COUNT_MAP, norm=LogNorm(1, max(2.0, float(counts.max()))))
        count_ax.figure.colorbar(color, ax=count_ax, label="samples in the cell", location="bottom")
        force_ax.set_title(f"Mean force, {format_run(run)}")
        count_ax.set_title(f"Samples; {binned.coverage:.0%} of the cells hold ≥ {binned.min_count}")
        for ax in grid[0]:
            ax.set_xlabel(TRAVEL)
            ax.grid(False)
        force_ax.set_ylabel(VELOCITY)
    return grid


def slices(run: RunEvidence | PrintedRun, axes: Any = None) -> np.ndarray:
    """Draw stiffness curve and damping curve with the arctangents fitted to them, and the residuals below.

    As Figs. 6 and 7 of Iwaniec & Uhl (2007).

    Args:
        run: one run of the evidence, mended or as printed.
        axes: four Axes, or None for a new figure.

    Returns:
        (2, 2) Axes.
    """
    with house_style():
        grid = panels(axes, 2, 2, height_in=4.8, sharex="col", sharey="row", height_ratios=[2, 1])
        for column, curve, fit in zip(grid.T, run.slices, run.slice_fits, strict=True):
            _draw_slice(column, curve, fit)
        grid[0, 0].set_ylabel(_FORCE)
        grid[1, 0].set_ylabel("residual [m/s²]")
    return grid


def _draw_slice(column: np.ndarray, curve: SliceCurve, fit: LawFit) -> None:
    is_along_travel = curve.along == "travel"
    scale, label = (1e3, TRAVEL) if is_along_travel else (1.0, VELOCITY)
    shown = thin_samples(curve.position.size)
    line = np.linspace(curve.position.min(), curve.position.max(), 400)
    straight = next(value for name, value in fit.straight.items() if name != "offset") * line + fit.straight["offset"]
    arctangent = fit.law.force(*build_motion(line, curve.along))
    other = (
        f"|z′| ≤ {format_number(curve.half_width, 2)} m/s"
        if is_along_travel
        else f"|z| ≤ {format_number(1e3 * curve.half_width, 2)} mm"
    )
    above, below = column
    dots = {"linestyle": "none", "marker": ".", "markersize": 2.5}
    position = scale * curve.position[shown]
    above.plot(position, curve.force_per_mass[shown], color=PALE, label=f"measured, {other}", **dots)
    # if stiffness and arctangent cannot be distinguished, each alone may be hundreds of times the force
    if fit.verdicts[0].distinguishable:
        dashed = {"color": RUN_COLORS[0], "linewidth": 1.1, "linestyle": "--"}
        above.plot(scale * line, straight, label="its straight part", **dashed)
    above.plot(scale * line, straight + arctangent, color=RUN_COLORS[1], label="slope + arctangent")
    above.set_title("Stiffness curve" if is_along_travel else "Damping curve")
    above.text(0.97, 0.05, _say_verdict(curve, fit), ha="right", va="bottom", fontsize=8.5, transform=above.transAxes)
    thicken(above.legend(loc="upper left"))
    below.plot(position, fit.residual[shown], color=GREY, **dots)
    below.axhline(0, color=INK, linewidth=0.8)
    below.set_title(f"{format_number(fit.residual_rms, 2)} m/s² rms", fontweight="normal", fontsize=8.5)
    below.set_xlabel(label)
    below.locator_params(axis="x", nbins=6)


def _say_verdict(curve: SliceCurve, fit: LawFit) -> str:
    amplitude, inner = fit.law.vector
    factor, unit, beside = (1e3, "mm", "stiffness") if curve.along == "travel" else (1.0, "m/s", "damping")
    if not fit.verdicts[0].distinguishable:
        return f"the arctangent cannot be\ndistinguished from {beside}"
    return f"amplitude {format_number(amplitude, 3)} m/s²\nscale {format_number(factor * inner, 3)} {unit}"


def law_curves(result: AnyIdentification, axes: Any = None, *, truth: GearTruth | None = None) -> np.ndarray:
    """Draw the identified force over velocity (at z = 0) and over travel (at z' = 0), with its linear part.

    Args:
        result: the identification.
        axes: two Axes, or None for a new figure.
        truth: of a simulated run: its law is drawn too.

    Returns:
        (1, 2) Axes.

    Raises:
        NotDeterminedError: the fit was refused.
    """
    require_answer(result)
    visited = result.restoring_force
    travelled, moved = _find_motion(result)
    stiffness, damping = _find_slopes(result)
    true_law = None if truth is None or visited.per_mass else truth.law
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.4)
        _draw_law(grid[0, 0], moved, 1.0, damping, result.law, true_law, "velocity")
        _draw_law(grid[0, 1], travelled, 1e3, stiffness, result.law, true_law, "travel")
        grid[0, 0].set_ylabel("force per sprung mass [m/s²]" if visited.per_mass else "force [N]")
    return grid


def find_rested_springs(result: Identification) -> list[InterfaceEstimate]:
    """Return the suspensions whose law depends on travel, so that it matters where they rest; one of those alike."""
    found: list[InterfaceEstimate] = []
    for each in result.interfaces:
        is_shown = any(other.name in each.shared_with for other in found)
        if each.stiffness.value is not None and each.at_rest and depends_on_travel(each.law) and not is_shown:
            found.append(each)
    return found


def static_curves(result: Identification, axes: Any = None, *, truth: TaxiTruth | None = None) -> np.ndarray:
    """Draw the force of each spring over the travel from the origin of its law, and where each run rests on it.

    Args:
        result: the identification.
        axes: one Axes for each of `find_rested_springs`, or None for a new figure.
        truth: of a simulated run: its springs are drawn too.

    Returns:
        (1, n_springs) Axes.

    Raises:
        NotDeterminedError: the fit was refused, or no law depends on travel.
    """
    require_answer(result)
    springs = find_rested_springs(result)
    if not springs:
        raise NotDeterminedError("the springs are straight: where a run rests on them changes nothing")
    unit, scale = ("m/s²", 1.0) if result.per_mass else ("kN", 1e-3)
    with house_style():
        grid = panels(axes, 1, len(springs), height_in=3.8, width_in=max(WIDTH_IN, 3.4 * len(springs)))
        for ax, spring in zip(grid[0], springs, strict=True):
            true = truth.interfaces.get(spring.name) if isinstance(truth, BodyTruth) else truth
            _draw_static_curve(ax, spring, scale)
            if true is not None:
                _draw_true_curve(ax, true, scale * find_true_scale(truth, per_mass=result.per_mass))
            ax.set_xlabel("travel from the origin of the law [mm]" if spring.rest_m.value else TRAVEL)
            ax.set_title("Springs over travel" if result.study.is_one_gear else spring.name)
            ax.legend(loc="best")
        grid[0, 0].set_ylabel(f"force{' / M' * result.per_mass} beyond that at rest [{unit}]")
    return grid


def _draw_static_curve(ax: Axes, spring: InterfaceEstimate, scale: float) -> None:
    """Draw a spring, dashed where no run went, with the travel of each run and the place where it rests."""
    rest_m, runs = spring.rest_m.value or 0.0, spring.at_rest
    slope = (spring.stiffness.value or 0.0) + (spring.ground_stiffness.value or 0.0)
    low, high = min(each.travelled_m[0] for each in runs), max(each.travelled_m[1] for each in runs)
    far, near = np.linspace(min(low, -rest_m), max(high, -rest_m), 401), np.linspace(low, high, 401)

    def draw(line: np.ndarray, **look: Any) -> None:
        ax.plot(1e3 * (rest_m + line), scale * (slope * line + spring.law.static_force(line)[0]), **look)

    draw(far, color=GREY, linestyle="--", linewidth=1.1)
    draw(near, color=INK, linewidth=2.0, label="springs, standing still")
    for each, color, marker in zip(runs, choose_run_colors(len(runs)), cycle("osD^v"), strict=False):
        ax.axvspan(*(1e3 * (rest_m + end) for end in each.travelled_m), color=color, alpha=0.12, linewidth=0, zorder=0)
        mark: dict[str, Any] = {"marker": marker, "markersize": 7, "markeredgecolor": "white", "linestyle": "none"}
        label = f"run {each.run!r} at rest, its travel shaded"
        draw(np.array([each.travel_m.value or 0.0]), color=color, label=label, zorder=3, **mark)


def _draw_true_curve(ax: Axes, true: GearTruth | SuspensionTruth, scale: float) -> None:
    """Draw the true spring over what is drawn of the found one."""
    line = 1e-3 * np.linspace(*ax.get_xlim(), 401) - true.law.rest_m
    if isinstance(true, GearTruth):
        stiffness = true.parameters.suspension_stiffness_n_per_m + true.parameters.ground_stiffness_n_per_m
    else:
        stiffness = true.stiffness_n_per_m
    force = stiffness * line + true.law.static_force(line)[0]
    look: dict[str, Any] = {"color": GREEN, "linewidth": 4, "alpha": 0.45, "zorder": 1.5}
    ax.plot(1e3 * (true.law.rest_m + line), scale * force, label="truth", **look)


def _find_slopes(result: AnyIdentification) -> tuple[float | None, float | None]:
    """Stiffness and damping beside the law."""
    if isinstance(result, Identification):
        return result.interfaces[0].stiffness.value, result.interfaces[0].damping.value
    if result.per_mass:
        return result.ratios.stiffness_per_mass.value, result.ratios.damping_per_mass.value
    parameters = result.parameters
    return parameters.suspension_stiffness_n_per_m.value, parameters.suspension_damping_n_s_per_m.value


def _find_motion(result: AnyIdentification) -> tuple[np.ndarray, np.ndarray]:
    """Travel and velocity of all runs."""
    if isinstance(result, PaperIdentification):
        surfaces = [run.surface for run in result.chain.runs]
        return np.concatenate([each.travel for each in surfaces]), np.concatenate([each.velocity for each in surfaces])
    return result.interfaces[0].travel, result.interfaces[0].velocity


def _draw_law(
    ax: Axes, visited: np.ndarray, scale: float, slope: float | None, law: Law, true_law: Law | None, along: str
) -> None:
    """Draw a law along travel or velocity as far as the runs went."""
    position = np.linspace(-1, 1, 401) * float(np.abs(visited).max())
    rms = float(np.sqrt(np.mean(visited**2)))
    motion = build_motion(position, along)
    nonlinear = law.force(*motion)
    coefficient, at, label = ("K₂ z", "z′ = 0", TRAVEL) if along == "travel" else ("C₂ z′", "z = 0", VELOCITY)
    ax.axvspan(-scale * rms, scale * rms, color=SHADED, zorder=0, label="up to the rms of the motion")
    if slope is not None:
        linear = slope * position
        ax.plot(scale * position, linear, color=GREY, linewidth=1.1, linestyle="--", label=coefficient)
        ax.plot(scale * position, linear + nonlinear, color=RUN_COLORS[0], label=f"{coefficient} + f")
    name = "nonlinear force f" if law.terms else "no nonlinear force"
    ax.plot(scale * position, nonlinear, color=RUN_COLORS[1], linewidth=2.2, label=name)
    if true_law is not None:
        force = true_law.force(*motion)
        ax.plot(scale * position, force, color=GREEN, linewidth=3.5, alpha=0.45, label="f, truth", zorder=1.5)
    ax.set_title(f"Force over {along}, {at}")
    ax.set_xlabel(label)
    ax.margins(x=0)
    ax.legend(loc="best")
