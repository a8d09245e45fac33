"""Figures of a body on several suspensions: its plan, its structure, each suspension, and its motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from opid.errors import NotDeterminedError
from opid.estimate import Estimate, format_number, with_std
from opid.mechanics.laws.law import Law
from opid.mechanics.truth import BodyTruth
from opid.plots.style import (
    BEHIND,
    BLUE,
    GREEN,
    GREY,
    INK,
    PALE,
    SHADED,
    SKY,
    TRAVEL,
    VELOCITY,
    VERMILION,
    build_motion,
    choose_run_colors,
    figure_of,
    find_true_scale,
    format_law,
    format_minus,
    format_units,
    house_style,
    name_rows,
    panels,
    panels_in_rows,
    plain_numbers,
    require_answer,
    smooth_lines,
    thicken,
    write_note,
)
from opid.plots.texts import LONGEST_NAMES, shorten
from opid.suspensions.answer.model_error import LeftOutSpectrum
from opid.suspensions.result import BodyRatios, Candidate, Identification, InterfaceEstimate, RunResidual

# a structure that leaves a larger residual over noise is drawn here; its number is written beside it
FARTHEST_DRAWN = 1e4
# the residual is averaged over lines within this width
SMOOTHING_HZ = 0.5
# measured and predicted accelerations are shown over a stretch of this length
SHOWN_S = 4.0
# an estimate of so many standard deviations is clearly different from zero
_CLEAR = 5.0


def plan_view(result: Identification, ax: Any = None, *, truth: BodyTruth | None = None) -> Axes:
    """Draw the body from above: suspensions, sensors, the centre of gravity with its intervals, and the loadings.

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.
        truth: of a simulated aircraft: its centre of gravity is drawn too.
    """
    with house_style():
        ax = panels(ax, 1, height_in=4.6)[0, 0]
        for name, (x, y, sensor_x, sensor_y) in result.places.items():
            ax.plot([y, sensor_y], [x, sensor_x], color=PALE, linewidth=1.2, zorder=1)
            # the ring hides no sensor that stands near it
            ax.plot([y], [x], marker="o", markersize=11, color=INK, markerfacecolor="none", markeredgewidth=1.8)
            write_note(ax, shorten(name, LONGEST_NAMES[1]), (y, x), (0, -16), fontweight="bold", ha="center")
            _draw_sensor(ax, sensor_x, sensor_y)
        for name, (x, y) in list_further_sensors(result).items():
            _draw_sensor(ax, x, y)
            write_note(ax, shorten(name, LONGEST_NAMES[1]), (y, x), (8, 0), color=BLUE, va="center")
        _draw_loadings(ax, result)
        _draw_centre_of_gravity(ax, result, truth)
        _scale_axes(ax)
        ax.set_xlabel("y, to the left [m]")
        ax.set_ylabel("x, forward [m]")
        ax.set_title("From above")
        handles = [
            Line2D([], [], marker="o", markersize=9, color=INK, markerfacecolor="none", linestyle="none"),
            Line2D([], [], marker="^", markersize=7, color=BLUE, linestyle="none"),
        ]
        drawn, labels = ax.get_legend_handles_labels()
        named = ["suspension", "sensor on the body", *labels]
        legend = ax.legend([*handles, *drawn], named, loc="upper left", bbox_to_anchor=(1.03, 1.0), labelspacing=1.1)
        for handle in legend.legend_handles:
            if isinstance(handle, Line2D):
                handle.set_markersize(min(handle.get_markersize(), 9.0))
    return ax


def structure_candidates(result: Identification, ax: Any = None) -> Axes:
    """Draw what each structure leaves, over the noise: of the runs it was fitted to, and of runs left out.

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.
    """
    candidates, explained = result.candidates, result.settings.verdicts.explained
    with house_style():
        ax = panels(ax, 1, height_in=1.4 + 0.5 * len(candidates))[0, 0]
        ax.axvspan(1e-3, explained, color=SHADED, zorder=0)
        ax.axvline(explained, color=INK, linestyle="--", linewidth=1)
        found = [value for candidate in candidates for value in _list_levels(candidate)] or [1.0]
        for row, candidate in enumerate(candidates):
            _draw_candidate(ax, row, candidate, max(found))
        ax.set_xscale("log")
        ax.set_xlim(min(0.8, *found) / 1.1, max(4.0, *found) * 3.0)
        plain_numbers(ax.xaxis)
        labels = [candidate.label + _format_laws(candidate) for candidate in candidates]
        chosen = [candidate.recommended for candidate in candidates]
        name_rows(ax, labels, [VERMILION if each else INK for each in chosen], chosen=chosen, fontsize=8)
        ax.set_xlabel(f"residual over the noise of the sensors; up to {format_number(explained)} it is noise")
        ax.set_title("Structures on the same data")
        dot: dict[str, Any] = {"marker": "o", "markersize": 7, "color": GREY, "linestyle": "none"}
        handles = [Line2D([], [], label="fitted runs", **dot)]
        if any(candidate.left_out_over_noise is not None for candidate in candidates):
            handles.append(Line2D([], [], label="runs left out", markerfacecolor="white", **dot))
        figure_of(ax).legend(handles=handles, loc="outside lower center", ncols=2)
    return ax


def suspension_parameters(result: Identification, axes: Any = None, *, truth: BodyTruth | None = None) -> np.ndarray:
    """Draw stiffness, damping and the amplitudes of the laws of all suspensions, with 95 % intervals about them.

    Args:
        result: the identification.
        axes: as many Axes as there are quantities, or None for a new figure.
        truth: of a simulated aircraft: drawn as diamonds.

    Returns:
        (n_rows, n_columns) Axes, those of the last row that are not needed switched off.
    """
    quantities = list(_list_quantities(result, truth))
    columns = min(len(quantities), 3)
    rows = -(-len(quantities) // columns)
    names = [interface.name for interface in result.interfaces]
    with house_style():
        grid = panels_in_rows(axes, len(quantities), columns, height_in=0.7 + (1.1 + 0.45 * len(names)) * rows)
        for ax, quantity in zip(grid.ravel(), quantities, strict=False):
            _draw_quantity(ax, quantity, names)
        bar = Line2D([], [], color=BLUE, marker="o", markersize=4, label="95 % interval; ± one standard deviation")
        true, _ = grid[0, 0].get_legend_handles_labels()
        figure_of(grid).legend(handles=[bar, *true], loc="outside lower center", ncols=2)
    return grid


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
            _draw_forces(row, result, interface, _find_true_law(interface, truth, result.per_mass))
        grid[-1, 0].set_xlabel(VELOCITY)
        grid[-1, 1].set_xlabel(TRAVEL)
        for ax in grid[0]:
            thicken(ax.legend(loc="upper left", fontsize=7, handlelength=1.4, labelspacing=0.3))
    return grid


def predicted_accelerations(
    result: Identification, axes: Any = None, *, run: str | None = None, start_s: float | None = None
) -> np.ndarray:
    """Draw some seconds of what each sensor on the body read and of what the model said it would, offsets removed.

    The difference of both has a panel and a scale of its own, for a good model leaves a thousandth of the motion.

    Args:
        result: the identification.
        axes: two Axes a sensor, or None for a new figure.
        run: name of the run; the first where left out.
        start_s: first time; where left out the stretch is around the largest reading.

    Returns:
        (n_sensors, 2) Axes.

    Raises:
        NotDeterminedError: the fit was refused.
    """
    require_answer(result)
    shown = next((each for each in result.runs if each.name == run), result.runs[0])
    begin = _find_loudest(shown) if start_s is None else start_s
    part = (shown.time_s >= begin) & (shown.time_s <= begin + SHOWN_S)
    names = list_sensor_names(result, len(shown.measured))
    with house_style():
        look: dict[str, Any] = {"sharex": True, "width_ratios": [3, 2]}
        grid = panels(axes, len(names), 2, height_in=0.7 + 1.55 * len(names), **look)
        for row, name, measured, predicted in zip(grid, names, shown.measured, shown.predicted, strict=True):
            # an accelerometer may have an offset that the model does not know
            read = measured - float(np.mean(measured - predicted))
            left, time = read - predicted, shown.time_s[part]
            row[0].plot(time, read[part], color=PALE, linewidth=3.5, label="measured")
            row[0].plot(time, predicted[part], color=BLUE, linewidth=1.0, label="predicted")
            row[0].set_title(name)
            row[0].set_ylabel("acceleration [m/s²]")
            row[1].plot(time, 1e3 * left[part], color=VERMILION, linewidth=0.8, label="measured less predicted")
            row[1].set_title(f"{format_number(1e3 * float(left.std()), 2)} mm/s² rms", fontweight="normal")
            row[1].set_ylabel("difference [mm/s²]")
            for ax in row:
                ax.margins(x=0)
        handles = [line for ax in grid[0] for line in ax.lines]
        figure = figure_of(grid)
        thicken(
            figure.legend(handles, [str(line.get_label()) for line in handles], loc="outside lower center", ncols=3)
        )
        for ax in grid[-1]:
            ax.set_xlabel(f"time [s], run {shown.name!r}")
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
    names = list_sensor_names(result, max(len(run.residual) for run in result.runs))
    columns = 1 if len(names) < 4 else 2
    rows = -(-len(names) // columns)
    with house_style():
        grid = panels_in_rows(axes, len(names), columns, height_in=0.7 + 1.75 * rows, sharex=True, sharey=True)
        for index, (ax, name) in enumerate(zip(grid.ravel(), names, strict=False)):
            for run, color in zip(result.runs, choose_run_colors(len(result.runs)), strict=True):
                lines = smooth_lines(run.frequency_hz, run.residual[index], SMOOTHING_HZ)
                ax.plot(*lines, color=color, linewidth=1.2, label=f"run {run.name!r}")
            ax.axhline(1.0, color=INK, linestyle="--", linewidth=1, label="noise")
            ax.set_title(name)
            ax.margins(x=0)
        grid[0, 0].set_yscale("log")
        # noise alone is to look flat: the range goes at least from a half to two
        low, high = grid[0, 0].get_ylim()
        grid[0, 0].set_ylim(min(low, 0.5), max(high, 2.0))
        plain_numbers(grid[0, 0].yaxis)
        for row in grid:
            row[0].set_ylabel("residual over noise")
        for ax in grid[-1]:
            ax.set_xlabel("frequency [Hz]")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        thicken(figure_of(grid).legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 5)))
    return grid


def left_out_spectra(result: Identification, axes: Any = None) -> np.ndarray:
    """Draw the spectrum of each run as measured and as the other runs predict it, with the stated band and the error.

    Args:
        result: the identification.
        axes: one Axes a run and sensor (one more if they are an odd number), or None for a new figure.

    Returns:
        (n_rows, 2) Axes, run by run, those that are not needed switched off.

    Raises:
        NotDeterminedError: the fit was refused, or no run is predicted by others.
    """
    require_answer(result)
    if not result.left_out:
        raise NotDeterminedError(
            "no run is predicted by the others: that is asked of two runs or more that leave more than noise"
        )
    shown = [(left, index) for left in result.left_out for index in range(len(left.spectra))]
    names = list_sensor_names(result, len(shown))
    # the band may reach down to nothing
    lowest = 0.5 * min(float(each.min()) for left, index in shown for each in _list_lines(left.spectra[index]))
    with house_style():
        rows = -(-len(shown) // 2)
        grid = panels_in_rows(axes, len(shown), 2, height_in=0.9 + 2.4 * rows, sharex=True, sharey=True)
        for ax, (left, index) in zip(grid.ravel(), shown, strict=False):
            sensor, spectrum = "" if result.study.is_one_gear else f", {names[index]}", left.spectra[index]
            _draw_left_out_spectrum(ax, spectrum, lowest)
            ax.set_title(f"run {result.runs[left.run].name!r}{sensor}")
            inside = float(np.average(spectrum.inside, weights=np.diff(spectrum.edges_hz)))
            ax.set_title(f"{100 * inside:.0f} % inside", loc="right", fontweight="normal", fontsize=8.5)
        grid[0, 0].set_xscale("log")
        grid[0, 0].set_ylim(lowest)
        grid[0, 0].set_yscale("log")
        for row in grid:
            row[0].set_ylabel("rms of a band [m/s²]")
        plain_numbers(grid[0, 0].xaxis)
        for ax in grid[-1]:
            ax.set_xlabel("frequency [Hz]")
        handles, labels = grid[0, 0].get_legend_handles_labels()
        thicken(figure_of(grid).legend(handles, labels, loc="outside lower center", ncols=len(labels)))
    return grid


def _list_lines(spectrum: LeftOutSpectrum) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return spectrum.measured_m_per_s2, spectrum.predicted_m_per_s2, spectrum.error_m_per_s2


def _draw_left_out_spectrum(ax: Axes, spectrum: LeftOutSpectrum, lowest: float) -> None:
    """Draw one sensor in one run, band by band."""
    edges, predicted, stated = spectrum.edges_hz, spectrum.predicted_m_per_s2, spectrum.stated_m_per_s2
    band: dict[str, Any] = {"color": SKY, "alpha": 0.35, "label": "predicted, with the band for 95 % of the lines"}
    ax.stairs(predicted + stated, edges, baseline=np.maximum(predicted - stated, lowest), fill=True, **band)
    looks = ((INK, 2.2), (BLUE, 1.2), (VERMILION, 1.0))
    for label, values, (color, width) in zip(
        ("measured", "predicted", "error"), _list_lines(spectrum), looks, strict=True
    ):
        ax.stairs(values, edges, baseline=None, label=label, color=color, linewidth=width)
    ax.set_xlim(edges[0], edges[-1])


def list_further_sensors(result: Identification) -> dict[str, tuple[float, float]]:
    """Return the (x, y) of the sensors on the body beside those of the suspensions, by the names of their channels."""
    return {sensor.channel: (sensor.x_m, sensor.y_m) for sensor in result.study.sensors}


def list_sensor_names(result: Identification, n_sensors: int) -> list[str]:
    """Return what the sensors on the body are called: after their suspensions, then the further ones.

    Of pairs the means come first, then the suspensions that are in none.
    """
    names = [f"above {interface.name}" for interface in result.interfaces]
    if result.structure == "pair":
        pairs = [candidate.interfaces for candidate in result.candidates if candidate.kind == "pair"]
        paired = {name for pair in pairs for name in pair}
        names = [f"mean above {', '.join(pair)}" for pair in pairs]
        names += [f"above {interface.name}" for interface in result.interfaces if interface.name not in paired]
    elif result.structure == "rigid_body":
        names += list_further_sensors(result)
    return [*names[:n_sensors], *(f"sensor {index + 1}" for index in range(len(names), n_sensors))]


# ---- from above ------------------------------------------------------------------------------------


def _scale_axes(ax: Axes) -> None:
    """Give both axes one scale, and turn the nose upward; the narrower side is at least 0.6 times the other."""
    ax.margins(0.12)
    (low_y, high_y), (low_x, high_x) = ax.get_xlim(), ax.get_ylim()
    wide, high = max(high_y - low_y, 0.6 * (high_x - low_x)), max(high_x - low_x, 0.6 * (high_y - low_y))
    middle_y, middle_x = (low_y + high_y) / 2, (low_x + high_x) / 2
    ax.set_xlim(middle_y + wide / 2, middle_y - wide / 2)
    ax.set_ylim(middle_x - high / 2, middle_x + high / 2)
    ax.set_aspect("equal", adjustable="box")


def _draw_sensor(ax: Axes, x: float, y: float) -> None:
    ax.plot([y], [x], marker="^", markersize=9, color=BLUE, markeredgecolor="white", linestyle="none", zorder=6)


def _draw_loadings(ax: Axes, result: Identification) -> None:
    colors = choose_run_colors(len(result.runs))
    for run, color in zip(result.runs, colors, strict=True):
        for index, (mass_kg, x, y) in enumerate(run.loading):
            label = f"carried in run {run.name!r}" if index == 0 else None
            size = float(np.clip(5 + 0.4 * np.sqrt(abs(mass_kg)), 6, 18))
            face = color if mass_kg >= 0 else "white"
            square: dict[str, Any] = {"marker": "s", "markersize": size, "markerfacecolor": face, "linestyle": "none"}
            ax.plot([y], [x], color=color, alpha=0.6, label=label, zorder=2, **square)
            write_note(
                ax,
                format_minus(f"{format_number(mass_kg, has_sign=True)} kg"),
                (y, x),
                (0, 0.5 * size + 4),
                color=color,
                ha="center",
            )


def _draw_centre_of_gravity(ax: Axes, result: Identification, truth: BodyTruth | None) -> None:
    assert isinstance(result.ratios, BodyRatios)  # one gear has no centre of gravity
    x, y = result.ratios.x_cg_m, result.ratios.y_cg_m
    if truth is not None:
        true = truth.parameters
        label = "centre of gravity, truth"
        ring: dict[str, Any] = {"marker": "o", "markersize": 15, "markerfacecolor": "none", "linestyle": "none"}
        ax.plot([true.y_cg_m], [true.x_cg_m], color=GREEN, alpha=0.7, markeredgewidth=3, label=label, **ring)
    if x.value is None or y.value is None:
        return
    for estimate, fixed, along in ((x, y.value, "x"), (y, x.value, "y")):
        if estimate.interval95 is not None:
            ends, held = list(estimate.interval95), [fixed, fixed]
            ax.plot(*((held, ends) if along == "x" else (ends, held)), color=VERMILION, linewidth=2, zorder=4)
    meaning = "± one standard deviation,\nlines: 95 % intervals"
    text = f"centre of gravity\nx = {_format_spread(x, 1.0)} m\ny = {_format_spread(y, 1.0)} m\n{meaning}"
    ax.plot([y.value], [x.value], marker="x", markersize=8, color=VERMILION, linestyle="none", label=text, zorder=5)


# ---- structures ------------------------------------------------------------------------------------


def _format_laws(candidate: Candidate) -> str:
    """Lines with the laws of a structure, two at most and shortened: the figure needs its room."""
    laws = [format_law(law) for law in candidate.law.split("; ") if law]
    laws = [law if len(law) <= 34 else law[:32] + "…" for law in laws]
    return "".join(f"\n{law}" for law in (laws if len(laws) < 3 else [laws[0], f"and {len(laws) - 1} other laws"]))


def _list_levels(candidate: Candidate) -> Iterator[float]:
    for value in (candidate.residual_over_noise, candidate.left_out_over_noise):
        if value is not None and np.isfinite(value) and value > 0:
            yield min(float(value), FARTHEST_DRAWN)


def _draw_candidate(ax: Axes, row: int, candidate: Candidate, farthest: float) -> None:
    color = VERMILION if candidate.recommended else INK if candidate.explains else GREY
    inside, outside = candidate.residual_over_noise, candidate.left_out_over_noise
    if not np.isfinite(inside):
        write_note(ax, "no fit", (max(farthest, 1.0), row), (0, 0), va="center", ha="right", color=GREY)
        return
    ends = list(_list_levels(candidate))
    ax.plot(ends, [row] * len(ends), color=color, linewidth=1)
    if outside is not None and np.isfinite(outside):
        ax.plot([ends[-1]], [row], marker="o", markersize=8, color=color, markerfacecolor="white", linestyle="none")
    ax.plot(ends[:1], [row], marker="o", markersize=5.5, color=color, linestyle="none")
    text = (
        format_number(inside, 3)
        if outside is None
        else f"{format_number(inside, 3)}, left out {format_number(outside, 3)}"
    )
    write_note(ax, text, (max(ends), row), (9, 0), va="center", color=color, fontsize=8, bbox=BEHIND)


# ---- suspension by suspension ----------------------------------------------------------------------


@dataclass(frozen=True)
class _Quantity:
    """One panel: a quantity of every suspension, and its true values."""

    title: str
    label: str
    scale: float
    estimates: tuple[Estimate, ...]
    true: tuple[float | None, ...]


def _list_quantities(result: Identification, truth: BodyTruth | None) -> Iterator[_Quantity]:
    known = [None if truth is None else truth.interfaces.get(each.name) for each in result.interfaces]
    scale = find_true_scale(truth, per_mass=result.per_mass)
    for key, title, unit, per_mass in (
        ("stiffness", "Stiffness K", "kN/m", "1/s^2"),
        ("damping", "Damping C", "kN s/m", "1/s"),
    ):
        suffix = "n_per_m" if key == "stiffness" else "n_s_per_m"
        true = tuple(None if each is None else scale * getattr(each, f"{key}_{suffix}") for each in known)
        values = tuple(getattr(each, key) for each in result.interfaces)
        shown = (f"{title} / M", f"[{format_units(per_mass)}]", 1.0) if result.per_mass else (title, f"[{unit}]", 1e-3)
        yield _Quantity(*shown, values, true)
    amplitudes = {
        (term.name, parameter.name): parameter.unit
        for interface in result.interfaces
        for term in interface.law.terms
        for parameter in term.kind.parameters
        if parameter.role == "amplitude"
    }
    for (kind, parameter), unit in amplitudes.items():
        values = tuple(each.law_estimates.get(kind, {}).get(parameter, Estimate()) for each in result.interfaces)
        laws = [{} if each is None else each.law.parameters.get(kind, {}) for each in known]
        true = tuple(scale * law[parameter] if parameter in law else None for law in laws)
        per = f"{unit}/kg" if result.per_mass else unit
        what = parameter.partition("_")[0]
        yield _Quantity(kind.replace("_", " ").capitalize(), f"{what} [{format_units(per)}]", 1.0, values, true)


def _draw_quantity(ax: Axes, quantity: _Quantity, names: list[str]) -> None:
    """Draw intervals and truths about each estimate, in percent of it: beside values of 470 kN/m they would vanish.

    Where an estimate is not clearly different from zero, they are in its unit.
    """
    known = [each for each in quantity.estimates if each.value is not None]
    is_percent = bool(known) and all(abs(each.value or 0.0) > _CLEAR * (each.std or 0.0) for each in known)
    is_labelled = False
    for index, (estimate, true) in enumerate(zip(quantity.estimates, quantity.true, strict=True)):
        if estimate.value is None:
            text = "–" if true is None else f"–, truth {format_number(quantity.scale * true, 4)}"
            write_note(ax, text, (0.5, index), (0, 0), xycoords=("axes fraction", "data"), color=GREY, ha="center")
            continue
        factor = 100 / abs(estimate.value) if is_percent and estimate.value else quantity.scale
        ends = [0.0]
        if estimate.interval95 is not None:
            ends = [factor * (end - estimate.value) for end in estimate.interval95]
            ax.plot(ends, [index, index], color=BLUE, linewidth=2)
            ax.plot(ends, [index, index], color=BLUE, marker="|", markersize=8, linestyle="none")
        ax.plot([0.0], [index], color=BLUE, marker="o", markersize=4, linestyle="none")
        if true is not None:
            label = None if is_labelled else "truth"
            here = [factor * (true - estimate.value)]
            ax.plot(here, [index], color=GREEN, marker="D", markersize=6, linestyle="none", label=label, zorder=4)
            is_labelled = True
        text = _format_spread(estimate, quantity.scale)
        write_note(ax, text, (0.0, index), (0, 7), ha="center", fontsize=8)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.8)
    ax.margins(x=0.15)
    ax.grid(False, axis="y")
    what, _, rest = quantity.label.partition("[")
    unit = rest.rstrip("]")
    ax.set_title(f"{quantity.title}{f', {what.strip()}' if what else ''} [{unit}]")
    ax.set_xlabel(f"from the estimate [{'%' if is_percent else unit}]")
    if not known:
        ax.set_xticks([])


def _format_spread(estimate: Estimate, scale: float) -> str:
    assert estimate.value is not None
    return format_minus(with_std(scale * estimate.value, scale * estimate.std if estimate.std else None))


# ---- in motion -------------------------------------------------------------------------------------


def _find_true_law(interface: InterfaceEstimate, truth: BodyTruth | None, per_mass: bool) -> Law | None:
    true = None if truth is None else truth.interfaces.get(interface.name)
    return None if true is None else true.law.scaled(find_true_scale(truth, per_mass=per_mass))


def _draw_forces(row: np.ndarray, result: Identification, interface: InterfaceEstimate, true: Law | None) -> None:
    unit, scale = ("m/s²", 1.0) if result.per_mass else ("kN", 1e-3)
    group = dict.fromkeys((interface.name, *interface.shared_with))
    together = [name for name in group if name in result.places] or [interface.name]
    for ax, along, visited, slope, factor in (
        (row[0], "velocity", interface.velocity, interface.damping.value, 1.0),
        (row[1], "travel", interface.travel, interface.stiffness.value, 1e3),
    ):
        line = np.linspace(-1.0, 1.0, 401) * (float(np.abs(visited).max()) if visited.size else 0.0)
        motion = build_motion(line, along)
        rms = factor * float(np.sqrt(np.mean(visited**2))) if visited.size else 0.0
        ax.axvspan(-rms, rms, color=SHADED, zorder=0, label="up to the rms of the motion")
        nonlinear, symbol = interface.law.force(*motion), "C z′" if along == "velocity" else "K z"
        if slope is not None:
            linear = slope * line
            # without f both lines are the same: the dashed one is then seen on the wide one
            ax.plot(factor * line, scale * linear, color=INK, linewidth=1.1, linestyle="--", label=symbol, zorder=2.5)
            ax.plot(factor * line, scale * (linear + nonlinear), color=SKY, linewidth=3.2, label=f"{symbol} + f")
        ax.plot(factor * line, scale * nonlinear, color=VERMILION, linewidth=2.0, label="nonlinear part f")
        if true is not None:
            force = scale * true.force(*motion)
            ax.plot(factor * line, force, color=GREEN, linewidth=4, alpha=0.45, label="f, truth", zorder=1.5)
        ax.margins(x=0)
    row[0].set_ylabel(f"force{' / M' * result.per_mass} [{unit}]")
    row[0].set_title(", ".join(together))
    row[1].set_title(f"law: {format_law(interface.law.name)}", fontweight="normal")


def _find_loudest(run: RunResidual) -> float:
    """The begin of the stretch around the largest reading."""
    peak = float(run.time_s[int(np.argmax(np.abs(run.measured).max(axis=0)))])
    return max(float(run.time_s[0]), min(peak - 0.5 * SHOWN_S, float(run.time_s[-1]) - SHOWN_S))
