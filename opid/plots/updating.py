"""Figures of Bayesian updating: backbones, classes, the linear structure, its shapes, and posterior samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator

from opid.errors import InputError
from opid.estimate import format_number
from opid.plots.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    PALE,
    RUN_COLORS,
    VERMILION,
    WIDTH_IN,
    choose_run_colors,
    format_minus,
    house_style,
    panels,
    panels_in_rows,
    thicken,
    thin_samples,
    write_note,
)
from opid.signals.recording import FloatArray
from opid.updating.measured import MeasuredBackbone, Place
from opid.updating.result import (
    BackboneBand,
    ClassPosterior,
    DampingBand,
    ForcedResponse,
    HarmonicBand,
    LinearPosterior,
    ModeShape,
    Updating,
)
from opid.updating.structure.reduction import ReductionErrors

_COLUMNS = 3
_SMALL_COLUMNS = 5  # of small panels: fourteen sensors take three rows

_METHODS = {
    "laplace": ("o", "Laplace"),
    "transitional": ("s", "transitional MCMC"),
    "importance": ("D", "importance sampling"),
    "quadrature": ("x", "quadrature"),
}
_DECISIVE = 5.0  # a class whose log evidence lies farther below that of the best one is ruled out
_LEAST_BELOW = 0.3  # a class that is nearer to the best one stands beside it
_FEW_DECADES = 3  # an axis with more decades has a number at each of them only

_SAME_FORCE = 0.02  # curves that are closer than this fraction of the largest force would hide each other
# a dash is this many times as long as its line is wide; the line of the best class is this wide
_DASH, _WIDE = 4.0, 2.4
_N_TRUTH = 16  # the truth has about this many marks, so that other lines can be seen between them
_IN_ONE_COLUMN = 6  # a legend with more classes has two columns

LEAST_STD = 0.005  # a log evidence with a smaller standard deviation is drawn without a bar

_LEAST_PERCENT = 1e-12  # an exact frequency has this error, for it needs a place on a logarithmic axis
_HELD: dict[str, Any] = {"color": BLUE, "marker": "o", "markersize": 4, "label": "sensors and joints held"}
# this mark is hollow, so that the other one can be seen within it
_FREE: dict[str, Any] = {
    "color": VERMILION, "marker": "s", "markersize": 6, "markerfacecolor": "none", "label": "free modes",
}  # fmt: skip

_PANEL_OVER_POINTS = 1.5  # a panel of a harmonic reaches at most this many times as far as its points

_WITHIN = (0.5, 0.9, 0.99)  # the contours of the Gaussian hold these fractions of its samples
_N_RUNNING = 400  # running moments have about this many points: they are smooth
_N_SHOWN = 5  # more parameters would make the panels of their pairs too small


# ---- backbones -------------------------------------------------------------------------------------


def measured_backbones(
    measured: Sequence[MeasuredBackbone], mode: int, *, sensors: Sequence[str], axes: Any = None
) -> np.ndarray:
    """Draw the amplitude of some sensors over the frequency of phase resonance, all curves of a mode in one panel.

    Args:
        measured: the backbones, of all modes.
        mode: number of the mode, from 1.
        sensors: one panel each.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of three; those without a sensor are empty.

    Raises:
        InputError: no backbone of that mode.
    """
    curves = [curve for curve in measured if curve.mode == mode]
    if not curves:
        raise InputError(f"no backbone of mode {mode} was measured: there are {sorted({c.mode for c in measured})}")
    with house_style():
        grid = _make_grid(len(sensors), axes)
        for ax, sensor in zip(grid.ravel(), sensors, strict=False):
            factor, unit = _choose_length_unit(_find_largest(curves, sensor))
            for curve in (curve for curve in curves if sensor in curve.sensors):
                ax.plot(
                    curve.frequency_hz, factor * np.abs(_find_amplitudes(curve, sensor)),
                    color=BLUE, linewidth=0.9, alpha=0.75, marker=".", markersize=3.5,
                )  # fmt: skip
            _label_axes(ax, sensor, unit)
        grid[0, 0].annotate(
            f"mode {mode}, {len(curves)} curve{'s' * (len(curves) > 1)}", (0.04, 0.93), xycoords="axes fraction",
            fontsize=8, va="top",
        )  # fmt: skip
    return grid


def predicted_backbones(
    bands: Sequence[BackboneBand], measured: Sequence[MeasuredBackbone], mode: int, axes: Any = None
) -> np.ndarray:
    """Draw the predicted backbones of a mode with their 95 % bands over the measured points.

    Args:
        bands: the prediction, of all modes and sensors; one panel for each of this mode. A band breaks off where its
            frequencies are nan. The loop of an interaction is drawn as it would be without damping.
        measured: the backbones, of all modes.
        mode: number of the mode, from 1.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of three; those without a band are empty.

    Raises:
        InputError: no band of that mode.
    """
    own = [band for band in bands if band.mode == mode]
    if not own:
        raise InputError(f"no backbone of mode {mode} was predicted: there are {sorted({b.mode for b in bands})}")
    curves = [curve for curve in measured if curve.mode == mode]
    with house_style():
        grid = _make_grid(len(own), axes)
        for ax, band in zip(grid.ravel(), own, strict=False):
            factor, unit = _choose_length_unit(max(float(band.amplitude.max()), _find_largest(curves, band.sensor)))
            height = factor * band.amplitude
            ax.fill_betweenx(
                height, band.low_hz, band.high_hz, color=VERMILION, alpha=0.22, linewidth=0, label="95 % band"
            )
            ax.plot(band.frequency_hz, height, color=VERMILION, label="predicted")
            if band.loop is not None:
                ax.plot(
                    band.loop[1], factor * band.loop[0], color=BLUE, linewidth=0.9, linestyle="--",
                    label="loop without damping",
                )  # fmt: skip
            for number, curve in enumerate(curve for curve in curves if band.sensor in curve.sensors):
                ax.plot(
                    curve.frequency_hz, factor * np.abs(_find_amplitudes(curve, band.sensor)),
                    color=INK, linestyle="none", marker=".", markersize=3, alpha=0.6,
                    label="measured" if number == 0 else None,
                )  # fmt: skip
            _label_axes(ax, band.sensor, unit)
            if np.isfinite(band.coverage):
                ax.set_title(f"sensor {band.sensor}: {100 * band.coverage:.0f} % within")
        thicken(grid[0, 0].legend(loc="upper left", fontsize=7.5, title=f"mode {mode}", title_fontsize=8))
    return grid


def effective_damping(bands: Sequence[DampingBand], axes: Any = None) -> np.ndarray:
    """Draw the effective damping ratio of each mode over the amplitude, with 95 % bands, and the measured points.

    Args:
        bands: one panel each.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of three; those without a band are empty.
    """
    with house_style():
        grid = _make_grid(len(bands), axes)
        for ax, band in zip(grid.ravel(), bands, strict=False):
            factor, unit = _choose_length_unit(float(band.amplitude.max()))
            along = factor * band.amplitude
            ax.fill_between(
                along, 100 * band.low, 100 * band.high, color=VERMILION, alpha=0.22, linewidth=0, label="95 % band"
            )
            ax.plot(along, 100 * band.damping_ratio, color=VERMILION, label="best class")
            ax.plot(
                factor * band.measured_amplitude, 100 * band.measured, color=INK, linestyle="none", marker=".",
                markersize=3, alpha=0.6, label="measured force",
            )  # fmt: skip
            ax.set(
                xlabel=f"amplitude at sensor {band.sensor} [{unit}]", ylabel="damping ratio [%]",
                title=f"mode {band.mode}", ylim=(0.0, None),
            )  # fmt: skip
        grid[0, 0].legend()
    return grid


def forced_responses(responses: Sequence[ForcedResponse], axes: Any = None) -> np.ndarray:
    """Draw the amplitude of a sensor over the frequency at each force, with some draws and the interval of the peak.

    Args:
        responses: one panel for each mode, drive point and sensor, with its forces.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of three; those without a response are empty.
    """
    grouped: dict[tuple[int, str, str], list[ForcedResponse]] = {}
    for each in responses:
        grouped.setdefault((each.mode, each.drive, each.sensor), []).append(each)
    with house_style():
        grid = _make_grid(len(grouped), axes)
        for ax, ((mode, drive, sensor), own) in zip(grid.ravel(), grouped.items(), strict=False):
            factor, unit = _choose_length_unit(max(float(np.nanmax(each.amplitude, initial=0.0)) for each in own))
            for color, each in zip(choose_run_colors(len(own)), own, strict=True):
                for hz, amplitude in zip(each.drawn_hz, each.drawn_amplitude, strict=True):
                    ax.plot(hz, factor * amplitude, color=color, linewidth=0.6, alpha=0.2)
                ax.plot(each.frequency_hz, factor * each.amplitude, color=color, label=f"{each.force_n:g} N")
                _draw_peak(ax, each, factor, color)
            ax.set(
                title=f"mode {mode}, force at {drive}", xlabel="frequency [Hz]",
                ylabel=f"amplitude at sensor {sensor} [{unit}]", ylim=(0.0, None),
            )  # fmt: skip
            ax.xaxis.set_major_locator(MaxNLocator(nbins=5))
            thicken(ax.legend())
    return grid


def _draw_peak(ax: Axes, response: ForcedResponse, factor: float, color: Any) -> None:
    """Draw the resonance as a point with the bars of its intervals, where it has them."""
    hz, amplitude = response.peak_hz, response.peak_amplitude
    if hz.value is None or amplitude.value is None:
        return
    at = hz.value, factor * amplitude.value
    if hz.interval95 is not None and amplitude.interval95 is not None:
        ax.plot(hz.interval95, [at[1]] * 2, color=color, linewidth=1.6)
        ax.plot([at[0]] * 2, [factor * end for end in amplitude.interval95], color=color, linewidth=1.6)
    ax.plot(*at, color=color, marker="o", markersize=5, markerfacecolor="white", zorder=5)


def predicted_motions(band: BackboneBand, measured: Sequence[MeasuredBackbone], axes: Any = None) -> np.ndarray:
    """Draw the motion of each sensor over that of the controlled one with its 95 % band, over the measured points.

    Motions are nearly proportional to each other, so that their ratio shows the band and how the shape changes.

    Args:
        band: the prediction of one mode, with bands of its sensors; one small panel each. A band breaks off where it is
            nan.
        measured: the backbones, of all modes.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of five; those without a sensor are empty.

    Raises:
        InputError: the band has none of a sensor.
    """
    if not band.sensors:
        raise InputError(f"the prediction of mode {band.mode} has no band of a sensor: take the recommended form")
    curves = [one for one in measured if one.mode == band.mode and band.sensor in one.sensors]
    factor, unit = _choose_length_unit(float(band.amplitude.max()))
    n = len(band.sensors)
    columns = min(n, _SMALL_COLUMNS) if axes is None else n
    with house_style():
        grid = panels_in_rows(axes, n, columns, height_in=0.7 + 1.5 * -(-n // columns), sharex=True)
        for ax, own in zip(grid.ravel(), band.sensors, strict=False):
            low, motion, high = (each / band.amplitude for each in (own.low, own.motion, own.high))
            ax.fill_between(factor * band.amplitude, low, high, color=VERMILION, alpha=0.22, linewidth=0)
            ax.plot(factor * band.amplitude, motion, color=VERMILION, linewidth=1.2)
            for curve in (curve for curve in curves if own.sensor in curve.sensors):
                held, values = (curve.amplitude[:, curve.sensors.index(name)] for name in (band.sensor, own.sensor))
                ax.plot(
                    factor * np.abs(held), values / held, color=INK, linestyle="none", marker=".", markersize=1.5,
                    alpha=0.45,
                )  # fmt: skip
        along = f"sensor {band.sensor} [{unit}]"
        _label_small_panels(grid, columns, [own.sensor for own in band.sensors], along, "ratio of motions")
    return grid


def _label_small_panels(grid: np.ndarray, columns: int, sensors: Sequence[str], along: str, across: str) -> None:
    n = len(sensors)
    for number, (ax, sensor) in enumerate(zip(grid.ravel(), sensors, strict=False)):
        ax.set_title(f"sensor {sensor}", fontsize=8)
        ax.tick_params(labelsize=7, labelbottom=number >= n - columns)
        ax.xaxis.set_major_locator(MaxNLocator(nbins=3))
        ax.yaxis.set_major_locator(MaxNLocator(nbins=4))
    for row in grid:
        row[0].set_ylabel(across, fontsize=8)
    for ax in grid.ravel()[max(0, n - columns) : n]:
        ax.set_xlabel(along, fontsize=8)


def higher_harmonics(bands: Sequence[HarmonicBand], axes: Any = None) -> np.ndarray:
    """Draw a higher harmonic of each sensor over the amplitude of the controlled one with its 95 % band.

    Args:
        bands: those of one mode and harmonic; one small panel each. A band breaks off where it is nan, and its ends are
            not drawn where they would hide the points.
        axes: as many Axes as panels, or None for a new figure.

    Returns:
        Axes, in rows of five; those without a sensor are empty.
    """
    n = len(bands)
    columns = min(n, _SMALL_COLUMNS) if axes is None else n
    along, along_unit = _choose_length_unit(max(float(band.amplitude.max()) for band in bands))
    factor, unit = _choose_length_unit(max(float(np.abs(band.measured).max()) for band in bands))
    with house_style():
        grid = panels_in_rows(axes, n, columns, height_in=0.7 + 1.5 * -(-n // columns), sharex=True)
        for ax, band in zip(grid.ravel(), bands, strict=False):
            low, middle, high, seen = (factor * each for each in (band.low, band.predicted, band.high, band.measured))
            held = along * band.amplitude
            ax.fill_between(held, low, high, color=VERMILION, alpha=0.22, linewidth=0)
            ax.plot(held, middle, color=VERMILION, linewidth=1.2)
            ax.plot(held, seen, color=INK, linestyle="none", marker=".", markersize=1.5, alpha=0.45)
            # In an interaction a band is many times as wide as the points are far from each other.
            wide = np.abs(high - low)[np.isfinite(high - low)]
            most = _PANEL_OVER_POINTS * max(float(np.abs(seen).max()), float(np.median(wide)) if wide.size else 0.0)
            ax.set_ylim(max(ax.get_ylim()[0], -most), min(ax.get_ylim()[1], most))
        held_at = f"sensor {', '.join(dict.fromkeys(band.controlled_sensor for band in bands))} [{along_unit}]"
        across = f"harmonic {bands[0].order} [{unit}]"
        _label_small_panels(grid, columns, [band.sensor for band in bands], held_at, across)
    return grid


def _make_grid(n: int, axes: Any) -> np.ndarray:
    """Rows of three panels; those beyond the last one are empty."""
    if axes is not None:
        return panels(axes, 1, n, height_in=3.0)
    columns = min(n, _COLUMNS)
    height_in = 0.5 + (2.5 if columns > 1 else 3.0) * -(-n // columns)
    return panels_in_rows(None, n, columns, height_in=height_in)


def _find_amplitudes(curve: MeasuredBackbone, sensor: str) -> np.ndarray:
    return curve.amplitude[:, curve.sensors.index(sensor)]


def _find_largest(curves: Sequence[MeasuredBackbone], sensor: str) -> float:
    return max(
        (float(np.abs(_find_amplitudes(curve, sensor)).max()) for curve in curves if sensor in curve.sensors),
        default=0.0,
    )


def _choose_length_unit(largest: float) -> tuple[float, str]:
    """Return a factor from metres and its unit that make amplitudes easy to read."""
    if largest >= 1:
        return 1.0, "m"
    return (1e3, "mm") if largest >= 2e-5 else (1e6, "µm")


def _label_axes(ax: Axes, sensor: str, unit: str) -> None:
    ax.set(title=f"sensor {sensor}", xlabel="frequency [Hz]", ylabel=f"amplitude [{unit}]")
    ax.set_ylim(bottom=0)
    ax.xaxis.set_major_locator(MaxNLocator(nbins=5))


# ---- model classes ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class ForceBand:
    """Force of one class over the extension of the joints.

    Args:
        name: of the class.
        force: (n,) at the mean of the parameters, N.
        low: (n,) lower end of the 95 % band, N; nan where the class has no interval.
        high: (n,) upper end, N.
    """

    name: str
    force: FloatArray
    low: FloatArray
    high: FloatArray


def log_evidences(result: Updating, ax: Any = None) -> Axes:
    """Draw by how much the log evidence of every class lies below that of the best one, by every method.

    The axis is logarithmic, so that a difference of five is seen beside one of thousands; the best class stands at its
    left end. Each class has its difference beside it.

    Args:
        result: of the updating.
        ax: one Axes, or None for a new figure.
    """
    classes = result.classes
    best = max((each.log_evidence for each in classes if np.isfinite(each.log_evidence)), default=0.0)
    named: dict[str, Line2D] = {}
    farthest, has_bars = _DECISIVE, False
    with house_style():
        ax = panels(ax, 1, height_in=1.6 + 0.42 * len(classes))[0, 0]
        for row, each in enumerate(classes):
            color = RUN_COLORS[1] if each.model_class.name == result.best_class else RUN_COLORS[0]
            known = [evidence for evidence in each.evidences if np.isfinite(evidence.log_evidence)]
            ends = [_LEAST_BELOW]
            for evidence in known:
                marker, label = _METHODS.get(evidence.method, ("d", evidence.method))
                below = best - evidence.log_evidence
                look: dict[str, Any] = {"color": color, "marker": marker, "linestyle": "none", "gid": label}
                look |= {"markersize": 7, "markerfacecolor": "none", "markeredgewidth": 1.5}
                (mark,) = ax.plot([max(below, _LEAST_BELOW)], [row], **look)
                named.setdefault(label, mark)
                ends.append(below)
                if evidence.std > LEAST_STD:
                    bar = np.maximum(below + 1.96 * evidence.std * np.array([-1, 1]), _LEAST_BELOW)
                    ax.plot(bar, [row, row], color=color, linewidth=1.6, gid=label)
                    ends.append(float(bar[1]))
                    has_bars = True
            text = format_number(round(best - each.log_evidence, 2), 5) if known else "not determined"
            write_note(ax, text, (max(ends), row), (9, 0), va="center", color=color)
            farthest = max(farthest, *ends)
        line = ax.axvline(_DECISIVE, color=INK, linestyle="--", linewidth=1.0, zorder=0)
        _label_differences(ax, farthest)
        ax.set_yticks(range(len(classes)), [_format_class(each) for each in classes])
        ax.set_ylim(len(classes) - 0.5, -0.5)
        bars = " (bars: 95 % intervals)" if has_bars else ""
        ax.set_xlabel(f"log evidence below that of the best class{bars}")
        # the legend stands above the axes, for a class may lie anywhere within
        handles, labels = [*named.values(), line], [*named, f"beyond {format_number(_DECISIVE)}: decisive"]
        ax.legend(handles, labels, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(labels), fontsize=8)
    return ax


def _label_differences(ax: Axes, farthest: float) -> None:
    """Make the axis logarithmic up to the class that lies farthest below the best one."""
    decades = 10.0 ** np.arange(np.ceil(np.log10(farthest)) + 1)
    ticks = [*decades, *3 * decades] if len(decades) <= _FEW_DECADES else [*decades]
    ticks = [_LEAST_BELOW, *sorted(tick for tick in ticks if tick < 2 * farthest)]
    ax.set_xscale("log")
    # the number beside the farthest class needs room
    ax.set_xlim(_LEAST_BELOW / 1.5, farthest * (farthest / _LEAST_BELOW) ** 0.25)
    ax.xaxis.set_major_locator(FixedLocator(ticks))
    ax.xaxis.set_major_formatter(FixedFormatter(["best", *map(format_number, ticks[1:])]))
    ax.xaxis.set_minor_locator(NullLocator())


def joint_forces(
    extension: FloatArray,
    bands: Sequence[ForceBand],
    *,
    best: str,
    truth: FloatArray | None = None,
    reached: Mapping[int, float] | None = None,
    ax: Any = None,
) -> Axes:
    """Draw the nonlinear force of every class over the extension that the tests reached.

    Args:
        extension: (n,) m.
        bands: one a class.
        best: name of the best class, which alone has its band drawn.
        truth: (n,) force of a simulation, N.
        reached: extension that the tests of each mode reached, m, by its number.
        ax: one Axes, or None for a new figure.
    """
    x = 1e3 * extension
    with house_style():
        ax = panels(ax, 1, height_in=3.8)[0, 0]
        for color, band in zip(choose_run_colors(len(bands)), bands, strict=True):
            if band.name == best:
                ax.plot(x, band.force, color=color, linewidth=_WIDE, label=f"{band.name} (best)", zorder=2)
                if np.isfinite(band.low).any():
                    ax.fill_between(x, band.low, band.high, color=color, alpha=0.25, linewidth=0, label="its 95 % band")
            else:
                style = _choose_dashes(band, bands, best)
                ax.plot(x, band.force, color=color, label=band.name, zorder=3, **style)
        if truth is not None:
            ax.plot(
                x, truth, color=INK, linestyle="none", marker="o", markersize=4, markerfacecolor="white",
                markevery=max(1, len(x) // _N_TRUTH), label="truth", zorder=5,
            )  # fmt: skip
        for mode, extended in (reached or {}).items():
            ax.axvline(1e3 * extended, color=GREY, linestyle=":", linewidth=1.0)
            look: dict[str, Any] = {"xycoords": ("data", "axes fraction"), "rotation": 90, "ha": "right", "va": "top"}
            write_note(ax, f"mode {mode}", (1e3 * extended, 1), (-3, -3), fontsize=8, color=INK, **look)
        # joints that are not extended leave no range to show
        if x[-1] > x[0]:
            ax.set_xlim(float(x[0]), float(x[-1]))
        ax.set(xlabel="extension of a joint [mm]", ylabel="nonlinear force [N]")
        legend = ax.legend(loc="upper left", fontsize=8, ncols=1 if len(bands) <= _IN_ONE_COLUMN else 2)
        thicken(legend)
        for handle in legend.legend_handles:
            # the dashes of a class are too far apart for a legend
            if isinstance(handle, Line2D) and handle.is_dashed():
                handle.set_linestyle("--")
    return ax


def _choose_dashes(band: ForceBand, bands: Sequence[ForceBand], best: str) -> dict[str, Any]:
    """The style of a class that is not the best; classes with the same curve get alternating dashes."""
    largest = max(float(np.abs(each.force).max()) for each in bands)
    together = [each.name for each in bands if np.abs(each.force - band.force).max() <= _SAME_FORCE * largest]
    # the best class is a whole line below, so that it needs no dashes
    turn = sum(name != best for name in together[: together.index(band.name)])
    dashes = (turn * _DASH, (_DASH, max(1, len(together) - 1) * _DASH))
    return {"linestyle": dashes, "linewidth": _WIDE if best in together else 1.5}


def _format_class(each: ClassPosterior) -> str:
    name, law = each.model_class.name, each.model_class.law_in_words
    return name if name == law else f"{name}: {law}"


# ---- the linear structure --------------------------------------------------------------------------


def linear_updating(linear: LinearPosterior, axes: Any = None) -> np.ndarray:
    """Draw frequency error and MAC of every identified mode before and after linear updating (Song Table 2).

    Args:
        linear: phase I.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    modes = linear.modes
    position = np.arange(len(modes))
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
                bars = ax.bar(position + shift, values, width=0.38, color=color, label=label)
                ax.bar_label(bars, [_format_value(value) for value in values], fontsize=7.5, padding=2)
            ax.margins(y=0.14)
            ax.set_xticks(position, [f"mode {mode.mode}" for mode in modes])
        grid[0, 0].axhline(0, color=INK, linewidth=0.9)
        grid[0, 0].set_ylabel("frequency error [%]")
        grid[0, 1].set_ylabel("MAC with the tests")
        thicken(grid[0, 0].legend(loc="best"))
    return grid


def reduction_figure(errors: ReductionErrors, axes: Any = None, *, free: ReductionErrors | None = None) -> np.ndarray:
    """Draw frequency error and MAC of the reduced structure against the whole one, mode by mode (Song Fig. 7).

    A cross is the MAC with the mode that a reduced mode is most like, where that is another one than that of its
    number: the order has changed.

    Args:
        errors: of the reduction with sensors and joints held.
        axes: two Axes, or None for a new figure.
        free: of the reduction with free modes, drawn beside it.

    Returns:
        (1, 2) Axes.
    """
    crosses: list[Line2D] = []
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.0)
        left, right = grid[0]
        for each, style in zip((errors, free), (_HELD, _FREE), strict=True):
            if each is None:
                continue
            number = np.arange(1, len(each.frequency_hz) + 1)
            left.plot(number, np.maximum(100 * np.abs(each.relative), _LEAST_PERCENT), linewidth=1.0, **style)
            right.plot(number, each.mac, linewidth=1.0, **style)
            other = (each.nearest > 0) & (each.nearest != number)
            if other.any():
                crosses += right.plot(
                    number[other], each.nearest_mac[other], color=style["color"], marker="x", linestyle="none",
                    label="with the mode that it is most like",
                )  # fmt: skip
        left.set(yscale="log", ylabel="frequency error [%]")
        right.axhline(1, color=GREY, linewidth=0.9, linestyle="--")
        right.set(ylim=(-0.03, 1.05), ylabel="MAC")
        for ax in grid[0]:
            ax.set_xlabel("mode")
            ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        # the legends stand above the axes, for an error may lie anywhere within
        above: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0, 1), "fontsize": 8}
        thicken(left.legend(ncols=2, **above))
        if crosses:
            right.legend(handles=crosses[:1], **above)
    return grid


def _format_value(value: float) -> str:
    """A number of three digits, at most three of them decimals."""
    return format_minus(format_number(value, 3) if abs(value) >= 1 and value != 1 else f"{value:.3f}")


# ---- shapes ----------------------------------------------------------------------------------------

_SHAPES: dict[str, dict[str, Any]] = {
    # the line of the measured shape is wide, so that it is seen behind that of an equal one
    "measured": {"color": INK, "marker": "o", "linewidth": 3.6, "markersize": 9},
    "structure": {"color": VERMILION, "marker": "s", "linewidth": 1.4, "markersize": 4.5},
    "initial": {"color": BLUE, "marker": "^", "linewidth": 1.2, "linestyle": "--", "markersize": 5.5},
}
_LARGEST_MOTION = 0.2  # the largest motion of a shape is drawn as this fraction of the size of the sketch
_AXES: dict[str, int] = {"x": 0, "y": 1, "z": 2}
# x goes to the right and back, y to the left and back, z upwards: an isometric view from the front
_ISOMETRIC = np.array([[np.sqrt(0.75), -np.sqrt(0.75), 0.0], [0.5, 0.5, 1.0]])


def mode_shape(shape: ModeShape, places: Mapping[str, Place] | None = None, ax: Any = None) -> Axes:
    """Draw the measured shape of a mode beside those of the structure: as a sketch of its sensors, or as bars.

    Args:
        shape: the shape.
        places: where the sensors are, by their names; without them the figure has bars.
        ax: one Axes, or None for a new figure.
    """
    found = {"measured": shape.measured, "structure": shape.structure, "initial": shape.initial}
    drawn = {name: values for name, values in found.items() if values is not None}
    words = {
        "measured": "measured",
        "initial": "initial",
        "structure": "updated" if "initial" in drawn else "structure",
    }
    with house_style():
        if places:
            ax = panels(ax, 1, height_in=4.6)[0, 0]
            _sketch_shapes(ax, shape.sensors, drawn, words, places)
        else:
            ax = panels(ax, 1, height_in=3.2)[0, 0]
            position, width = np.arange(len(shape.sensors)), 0.8 / len(drawn)
            for number, (name, values) in enumerate(drawn.items()):
                shift = (number - 0.5 * (len(drawn) - 1)) * width
                ax.bar(position + shift, values, width=0.92 * width, color=_SHAPES[name]["color"], label=words[name])
            ax.axhline(0, color=INK, linewidth=0.9)
            ax.set_xticks(position, list(shape.sensors))
            ax.grid(False, axis="x")
            ax.set(xlabel="sensor", ylabel="shape of unit length")
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(drawn), fontsize=8)
    return ax


def _sketch_shapes(
    ax: Axes,
    sensors: Sequence[str],
    drawn: Mapping[str, FloatArray],
    words: Mapping[str, str],
    places: Mapping[str, Place],
) -> None:
    """Draw sensors at rest in grey, and each shape as their motion, joined from neighbour to neighbour."""
    rest = np.array([places[sensor].position for sensor in sensors])
    along = np.eye(3)[[_AXES[places[sensor].direction] for sensor in sensors]]
    size = float(np.linalg.norm(np.ptp(rest, axis=0)))
    largest = max(float(np.abs(values).max()) for values in drawn.values())
    scale = _LARGEST_MOTION * (size or 1.0) / (largest or 1.0)
    joined = _join_neighbours(rest)
    _draw_lines(ax, rest, joined, color=PALE, linewidth=1.2, marker="o", markersize=3.5)
    for name, values in drawn.items():
        moved = rest + scale * values[:, None] * along
        style = _SHAPES[name]
        ends = np.stack([rest, moved], axis=1).reshape(-1, 3)
        pairs = np.arange(len(ends)).reshape(-1, 2)
        _draw_lines(ax, ends, pairs, color=style["color"], linewidth=0.7, alpha=0.55)
        hollow = {"markerfacecolor": "white"} if name != "measured" else {}
        _draw_lines(ax, moved, joined, label=words[name], **style, **hollow)
    flat = rest @ _ISOMETRIC.T
    for sensor, at in zip(sensors, flat, strict=True):
        write_note(ax, sensor, (float(at[0]), float(at[1])), (4, -9), fontsize=8, color=GREY)
    corner = rest.min(axis=0) - 0.12 * (size or 1.0)
    for name, axis in _AXES.items():
        tip = corner + 0.1 * (size or 1.0) * np.eye(3)[axis]
        _draw_lines(ax, np.array([corner, tip]), np.array([[0, 1]]), color=GREY, linewidth=1.0)
        x, y = _ISOMETRIC @ tip
        write_note(ax, name, (float(x), float(y)), (2, 1), fontsize=8, color=GREY)
    ax.set_aspect("equal")
    ax.grid(False)
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_visible(False)


def _draw_lines(ax: Axes, points: FloatArray, pairs: np.ndarray, **style: Any) -> None:
    """Draw lines between pairs of points in space, as one line with gaps."""
    flat = points @ _ISOMETRIC.T
    gaps = np.full((len(pairs), 1, 2), np.nan)
    ax.plot(*np.concatenate([flat[pairs], gaps], axis=1).reshape(-1, 2).T, **style)


def _join_neighbours(points: FloatArray) -> np.ndarray:
    """Return the pairs of points that a tree of the shortest lines joins (Prim's algorithm)."""
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    nearest, shortest, pairs = np.zeros(len(points), dtype=int), distance[0].copy(), []
    left = set(range(1, len(points)))
    while left:
        new = min(left, key=lambda point: shortest[point])
        left.remove(new)
        pairs.append((nearest[new], new))
        closer = distance[new] < shortest
        nearest[closer], shortest[closer] = new, distance[new][closer]
    return np.array(pairs)


# ---- posterior samples -----------------------------------------------------------------------------


def parameter_samples(
    samples: FloatArray, labels: Sequence[str], *, truth: Sequence[float | None] | None = None, axes: Any = None
) -> np.ndarray:
    """Draw histograms of the parameters and scatters of their pairs, with the Gaussian of the same mean and covariance.

    Histograms are densities, as the Gaussians beside them; the contours hold 50, 90 and 99 % of the Gaussian (Song et
    al. 2021, Figs. 6 and 8 to 10).

    Args:
        samples: (n_samples, n_parameters); the first five parameters are drawn.
        labels: of the parameters, for the axes.
        truth: value of each parameter in a simulation; None where it has none.
        axes: n x n Axes, or None for a new figure.

    Returns:
        (n, n) Axes, those above the diagonal empty.
    """
    shown = np.asarray(samples, dtype=np.float64)[:, :_N_SHOWN]
    n = shown.shape[1]
    known = [None] * n if truth is None else list(truth)[:n]
    with house_style():
        grid = panels(axes, n, n, height_in=1.0 + 2.0 * n, width_in=max(WIDTH_IN, 2.2 * n))
        for (row, column), ax in np.ndenumerate(grid):
            if column > row:
                ax.set_axis_off()
                continue
            if row == column:
                _draw_histogram(ax, shown[:, row], known[row])
            else:
                _draw_pair(ax, shown[:, [column, row]], (known[column], known[row]))
                if column == 0:
                    ax.set_ylabel(labels[row])
            ax.xaxis.set_major_locator(MaxNLocator(nbins=5))
            if row == n - 1:
                ax.set_xlabel(labels[column])
        grid[0, 0].set_ylabel("density")
        thicken(grid[0, 0].legend(loc="best", fontsize=7.5))
    return grid


def running_moments(samples: FloatArray, labels: Sequence[str], axes: Any = None) -> np.ndarray:
    """Draw how mean and standard deviation settle as samples come in (Song et al. 2021, Figs. 6b and 8b).

    Args:
        samples: (n_samples, n_parameters) in the order in which they were drawn, chain after chain; the first five
            parameters are drawn.
        labels: of the parameters, for the axes.
        axes: n x 2 Axes, or None for a new figure.

    Returns:
        (n, 2) Axes.
    """
    shown = np.asarray(samples, dtype=np.float64)[:, :_N_SHOWN]
    count = np.arange(1, len(shown) + 1)
    # moments about the mean of all samples lose no digits
    centre = shown.mean(axis=0)
    mean = np.cumsum(shown - centre, axis=0) / count[:, None]
    square = np.cumsum((shown - centre) ** 2, axis=0) / count[:, None]
    deviation = np.sqrt(np.maximum(square - mean**2, 0.0))
    thin = thin_samples(len(shown), _N_RUNNING)
    with house_style():
        grid = panels(axes, shown.shape[1], 2, height_in=0.9 + 1.5 * shown.shape[1], sharex="all")
        for row, label in enumerate(labels[: shown.shape[1]]):
            for ax, values in zip(grid[row], ((mean + centre)[:, row], deviation[:, row]), strict=True):
                ax.plot(count[thin], values[thin], color=BLUE)
                ax.axhline(values[-1], color=INK, linestyle="--", linewidth=0.9)
            grid[row, 0].set_ylabel(label)
        for ax, title in zip(grid[0], ("Mean", "Standard deviation"), strict=True):
            ax.set_title(title)
        for ax in grid[-1]:
            ax.set_xlabel("samples")
    return grid


def _draw_histogram(ax: Axes, values: np.ndarray, truth: float | None) -> None:
    mean, deviation = float(values.mean()), float(values.std())
    ax.hist(values, bins="auto", range=_find_span(values), density=True, color=BLUE, alpha=0.45, label="samples")
    if deviation > 0:
        x = np.linspace(mean - 4 * deviation, mean + 4 * deviation, 300)
        density = np.exp(-0.5 * ((x - mean) / deviation) ** 2) / (np.sqrt(2 * np.pi) * deviation)
        ax.plot(x, density, color=INK, linewidth=1.2, label="Gaussian")
    if truth is not None:
        ax.axvline(truth, color=GREEN, linestyle="--", label="truth")
    ax.set_yticks([])


def _draw_pair(ax: Axes, pair: np.ndarray, truth: tuple[float | None, float | None]) -> None:
    thinned = pair[thin_samples(len(pair))]
    ax.plot(*thinned.T, linestyle="none", marker=".", markersize=2.5, color=BLUE, alpha=0.35, rasterized=True)
    mean, covariance = pair.mean(axis=0), np.cov(pair.T)
    angle = np.linspace(0, 2 * np.pi, 200)
    values, directions = np.linalg.eigh(covariance)
    circle = np.vstack([np.cos(angle), np.sin(angle)])
    ellipse = directions @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
    for within in _WITHIN:
        # the fraction exp(-r^2/2) of a Gaussian in the plane lies beyond r
        ax.plot(*(mean[:, None] + np.sqrt(-2 * np.log(1 - within)) * ellipse), color=VERMILION, linewidth=1.0)
    if truth[0] is not None and truth[1] is not None:
        ax.plot(truth[0], truth[1], marker="+", markersize=11, markeredgewidth=2, color=GREEN, linestyle="none")


def _find_span(values: np.ndarray) -> tuple[float, float]:
    """The range of the values without 0.1 % at either end, which would make the bins too wide."""
    low, high = (float(each) for each in np.quantile(values, [0.001, 0.999]))
    return (low, high) if high > low else (low - 0.5, low + 0.5)
