"""Figures of the runs: the records, their double integration, the transmissibility, and what the model leaves over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.errors import InputError
from opid.estimate import format_number
from opid.plots.style import (
    GREEN,
    GREY,
    INK,
    PALE,
    RUN_COLORS,
    TRAVEL,
    choose_run_colors,
    format_run,
    format_units,
    house_style,
    panels,
    plain_numbers,
    require_answer,
    smooth_lines,
    thicken,
    write_note,
)
from opid.signals.recording import Recording
from opid.signals.spectra import cross_spectra
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.law_search.pursuit import LawStep
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.paper.spectral_equation import JointFit
from opid.suspensions.paper.transmissibility import suspension_transmissibility
from opid.suspensions.result import GearRatios

# the residual spectrum is averaged over lines within this width
SMOOTHING_HZ = 0.25
# a transmissibility is shown between these frequencies
LOWEST_HZ, HIGHEST_HZ = 0.25, 40.0


def clock_lags(result: AnyIdentification, axes: Any = None) -> np.ndarray:
    """Draw the lags by which the clocks of two recorders were matched, one panel for each match.

    Args:
        result: an identification of runs with several recorders.
        axes: one Axes a match, or None for a new figure.

    Returns:
        (n_matches, 1) Axes.

    Raises:
        InputError: no run whose clocks were matched.
    """
    found = [(run, match) for run in result.study.runs for match in run.clocks]
    if not found:
        raise InputError("no clocks were matched in these runs: draw runs whose channels come from several files")
    with house_style():
        grid = panels(axes, len(found), height_in=0.6 + 1.9 * len(found), sharex=True, sharey=True)
        colors = choose_run_colors(len(found))
        for ax, (run, match), color in zip(grid[:, 0], found, colors, strict=True):
            name = f"{run.name}: {', '.join(match.channels)} behind {match.pair[0]}, less {match.drift_ppm:+.0f} ppm"
            ax.plot(match.at_s, 1e3 * match.lag_s, ".", color=color)
            ax.axhline(0.0, color=GREY, linewidth=0.8)
            ax.set_title(name)
            ax.set_ylabel("lag [ms]")
        grid[-1, 0].set_xlabel("time [s]")
    return grid


def accelerations(result: AnyIdentification, axes: Any = None) -> np.ndarray:
    """Draw the acceleration of the spindle and of the airframe, one panel a run.

    Args:
        result: the identification.
        axes: one Axes a run, or None for a new figure.

    Returns:
        (n_runs, 1) Axes.
    """
    runs = result.study.runs
    with house_style():
        grid = panels(axes, len(runs), height_in=0.6 + 1.9 * len(runs), sharex=True, sharey=True)
        for ax, run, color in zip(grid[:, 0], runs, choose_run_colors(len(runs)), strict=True):
            for samples, shade, width, name in (
                (run.recording.channel(result.study.unsprung), PALE, 0.5, "spindle (unsprung)"),
                (run.recording.channel(result.study.sprung), color, 0.7, "airframe (sprung)"),
            ):
                label = f"{name}, {np.std(samples):.2f} m/s² rms"
                ax.plot(run.recording.time_s, samples - np.mean(samples), color=shade, linewidth=width, label=label)
            ax.set_title(format_run(run))
            ax.set_ylabel("acceleration − mean [m/s²]")
            ax.margins(x=0)
            thicken(ax.legend(loc="upper right", ncols=2))
        grid[-1, 0].set_xlabel("time [s]")
    return grid


def integration(run: RunEvidence, axes: Any = None) -> np.ndarray:
    """Draw the relative displacement by the paper's literal recipe against sound integration.

    Above both on one scale, below the sound one alone: mean removal before each integration leaves a parabola that
    hides the motion (see `opid.signals.motion`).

    Args:
        run: one run of the evidence.
        axes: two Axes, or None for a new figure.

    Returns:
        (2, 1) Axes.
    """
    literal, sound = run.printed.motion, run.motion
    inside = sound.interior
    with house_style():
        grid = panels(axes, 2, height_in=4.2, sharex=True, height_ratios=[3, 2])
        above, below = grid[:, 0]
        for ax in (above, below):
            if ax is above:
                label = f"mean removed before each integration, {_format_rms_mm(literal.displacement)} rms"
                ax.plot(run.time_s, 1e3 * literal.displacement, color=RUN_COLORS[1], label=label)
            label = (
                f"band above {format_number(sound.high_pass_hz)} Hz, {_format_rms_mm(sound.displacement[inside])} rms"
            )
            travel = 1e3 * sound.displacement[inside]
            ax.plot(run.time_s[inside], travel, color=RUN_COLORS[0], linewidth=0.7, label=label)
            ax.set_ylabel(TRAVEL)
            ax.margins(x=0.01)
        above.set_title(f"Relative displacement z = x₂ − x₁ of run {run.name!r}, integrated twice")
        thicken(above.legend(loc="best"))
        below.set_title("The same, the sound integration alone")
        below.set_xlabel("time [s]")
    return grid


def recording(run: Recording, axes: Any = None) -> np.ndarray:
    """Draw time history and power spectral density of every channel of a recording.

    Args:
        run: the recording.
        axes: (n_channels, 2) Axes, or None for a new figure.

    Returns:
        (n_channels, 2) Axes.
    """
    with house_style():
        n_channels = len(run.channels)
        grid = panels(axes, n_channels, 2, height_in=0.7 + 1.9 * n_channels, sharex="col", width_ratios=[3, 2])
        for (time_ax, psd_ax), channel in zip(grid, run.channels, strict=True):
            samples = run.channel(channel.name)
            time_ax.plot(run.time_s, samples, color=RUN_COLORS[0], linewidth=0.6)
            rms, unit = format_number(float(np.std(samples)), 3), format_units(channel.unit)
            time_ax.set_title(f"{channel.name}, {rms} {unit} rms")
            time_ax.set_ylabel(f"[{unit}]")
            time_ax.margins(x=0)
            _draw_density(psd_ax, samples, run.fs, channel.unit)
        grid[0, 1].set_title("power spectral density")
        grid[-1, 0].set_xlabel("time [s]")
        grid[-1, 1].set_xlabel("frequency [Hz]")
    return grid


def _draw_density(ax: Axes, samples: np.ndarray, fs: float, unit: str) -> None:
    spectra = cross_spectra((samples - samples.mean())[:, np.newaxis], fs=fs)
    frequency_hz, density = spectra.frequency_hz[1:], spectra.density[1:, 0, 0].real
    ax.set_xscale("log")
    ax.set_ylabel(f"[({format_units(unit)})²/Hz]")
    if not np.any(density > 0):
        ax.text(0.5, 0.5, "mute: nothing to show", color=GREY, ha="center", transform=ax.transAxes)
        return
    ax.set_yscale("log")
    ax.plot(frequency_hz, density, color=INK, linewidth=0.8)
    ax.margins(x=0)


def _format_rms_mm(displacement: np.ndarray) -> str:
    return f"{format_number(1e3 * float(np.sqrt(np.mean(displacement**2))), 3)} mm"


# ---- over frequency ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Suspension:
    """A linear suspension, per unit of the reference mass."""

    stiffness: float
    damping: float
    ground: float
    inverse_mass: float

    def compute_transmissibility(self, mass_change_kg: float, frequency_hz: np.ndarray) -> np.ndarray:
        """The transmissibility at the mass of one run."""
        scale = 1 / (1 + self.inverse_mass * mass_change_kg)
        return suspension_transmissibility(
            frequency_hz,
            stiffness_per_mass=scale * self.stiffness,
            damping_per_mass=scale * self.damping,
            ground_stiffness_per_mass=scale * self.ground,
        )


def transmissibilities(result: AnyIdentification, axes: Any = None) -> np.ndarray:
    """Draw |T|, its phase and its coherence, one column a run (Iwaniec & Uhl 2007, Figs. 8 and 9).

    Args:
        result: the identification.
        axes: 3 Axes a run, or None for a new figure.

    Returns:
        (3, n_runs) Axes.
    """
    chain, suspension = result.paper_chain, _find_suspension(result)
    n_runs = len(chain.runs)
    with house_style():
        shared: dict[str, Any] = {"sharex": True, "sharey": "row", "height_ratios": [3, 1.4, 1.1]}
        grid = panels(axes, 3, n_runs, height_in=6.8, width_in=max(5.4, 3.7 * n_runs), **shared)
        for column, run, color in zip(grid.T, chain.runs, choose_run_colors(n_runs), strict=True):
            _draw_transmissibility(column, run, suspension, color, chain.band_hz, has_law=not result.is_refused)
        grid[0, 0].set_ylabel("|T| = |X₂/X₁|")
        grid[1, 0].set_ylabel("phase [°]")
        grid[2, 0].set_ylabel("coherence")
    return grid


def _draw_transmissibility(
    column: np.ndarray,
    run: RunEvidence,
    suspension: _Suspension | None,
    color: str,
    band_hz: tuple[float, float],
    *,
    has_law: bool,
) -> None:
    magnitude, phase, coherence = column
    measured, beneath = run.T, run.T_without_force
    highest = min(HIGHEST_HZ, 0.4 * run.fs)
    shown = (measured.frequency_hz >= LOWEST_HZ) & (measured.frequency_hz <= highest)
    frequency_hz = measured.frequency_hz[shown]
    fitted_at = np.geomspace(LOWEST_HZ, highest, 400)
    averages = f"{measured.spectra.n_averages:.1f} averages"
    lines: list[tuple[str, np.ndarray, np.ndarray, dict[str, Any]]] = [
        (f"measured, {averages}", frequency_hz, measured.value[shown], {"color": GREY, "linewidth": 0.9})
    ]
    if has_law:
        subtracted, look = run.T_subtracted.value[shown], {"color": color, "linewidth": 1.0, "alpha": 0.45}
        lines.append(("force subtracted (the paper)", frequency_hz, subtracted, look))
        taken_out, look = beneath.value[shown], {"color": color, "linewidth": 1.6}
        lines.append(("force taken out (conditioned)", frequency_hz, taken_out, look))
    if suspension is not None:
        fitted = suspension.compute_transmissibility(run.mass_change_kg, fitted_at)
        lines.append(("fitted suspension", fitted_at, fitted, {"color": INK, "linestyle": "--", "linewidth": 1.0}))
    for label, frequency, value, style in lines:
        magnitude.plot(frequency, np.abs(value), label=label, **style)
        if "paper" not in label:
            # the phase goes from 0 down to -180 degrees, so that the circle is cut at +90
            phase.plot(frequency, np.degrees(np.angle(1j * value)) - 90, **style)
    peaks = ([peak.frequency_hz for peak in run.peaks], [peak.magnitude for peak in run.peaks])
    marks = {"marker": "v", "linestyle": "none", "color": GREEN, "markersize": 5}
    magnitude.plot(*peaks, label="peaks of the measured |T|", **marks)
    coherence.plot(frequency_hz, measured.coherence[shown], color=GREY, linewidth=0.9, label="spindle alone (ordinary)")
    if has_law:
        coherence.plot(frequency_hz, beneath.coherence[shown], color=color, label="spindle and force (multiple)")
    magnitude.set_xscale("log")
    magnitude.set_yscale("log")
    plain_numbers(magnitude.yaxis)
    magnitude.set_title(format_run(run))
    magnitude.legend(loc="lower left")
    phase.set_yticks([-180, -90, 0])
    phase.set_ylim(-225, 45)
    coherence.set_ylim(0, 1.05)
    coherence.set_xlabel("frequency [Hz]")
    coherence.set_xlim(LOWEST_HZ, highest)
    ticks = [tick for tick in (0.5, 1, 2, 5, 10, 20, 40) if tick <= highest]
    coherence.set_xticks(ticks, [format_number(tick) for tick in ticks], minor=False)
    coherence.legend(loc="lower left")
    for ax in column:
        ax.axvspan(*band_hz, color="#F6F6F6", zorder=0)


def printed_transmissibilities(result: AnyIdentification, ax: Any = None) -> Axes:
    """Draw |T| of all runs as printed on one Axes, with the matched peaks and their numbers in Table 3.

    As Figs. 8 and 9 of Iwaniec & Uhl (2007).

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.
    """
    chain = result.paper_chain
    colors = {run.name: color for run, color in zip(chain.runs, choose_run_colors(len(chain.runs)), strict=True)}
    highest = min(HIGHEST_HZ, 0.4 * chain.runs[0].fs)
    with house_style():
        ax = panels(ax, 1, height_in=4.2)[0, 0]
        for run in chain.runs:
            T, color = run.printed.T, colors[run.name]
            shown = (T.frequency_hz > 0) & (T.frequency_hz <= highest)
            ax.plot(T.frequency_hz[shown], np.abs(T.value[shown]), color=color, linewidth=0.9, label=format_run(run))
        for number, pair in enumerate(chain.table_3, start=1):
            for peak, color in (
                (pair.match.reference, colors[chain.reference.name]),
                (pair.match.changed, colors[pair.run_name]),
            ):
                face = color if pair.match.credible else "white"
                at = (peak.frequency_hz, peak.magnitude)
                ax.plot(*at, marker="v", markersize=6, linestyle="none", color=color, markerfacecolor=face)
                write_note(ax, str(number), at, (0, 6), ha="center", color=color, fontweight="bold")
        label = f"T(0) = {chain.static_transmissibility:.3g}"
        ax.axhline(chain.static_transmissibility, color=INK, linestyle="--", linewidth=0.8, label=label)
        ax.set_xscale("log")
        ax.set_yscale("log")
        plain_numbers(ax.xaxis)
        plain_numbers(ax.yaxis)
        ax.margins(x=0)
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylabel("|T| = |X₂/X₁|, force subtracted")
        ax.set_title("The chain as printed: transmissibilities and matched peaks")
        thicken(ax.legend(loc="lower left"))
    return ax


def _find_suspension(result: AnyIdentification) -> _Suspension | None:
    """The linear suspension by all runs; None where it is refused or not determined."""
    if isinstance(result, PaperIdentification):
        joint = result.joint
        return None if result.is_refused else _Suspension(*joint.ratios, joint.inverse_mass)
    ratios, mass = result.ratios, result.parameters.sprung_mass_kg.value
    assert isinstance(ratios, GearRatios)  # a body has no such chain
    stiffness, damping = ratios.stiffness_per_mass.value, ratios.damping_per_mass.value
    if stiffness is None or damping is None:
        return None
    return _Suspension(stiffness, damping, ratios.ground_stiffness_per_mass.value or 0.0, 1 / mass if mass else 0.0)


def equation_residual(result: AnyIdentification, ax: Any = None) -> Axes:
    """Draw the residual of the fitted equation, as the white sensor noise that would explain it, line by line.

    Args:
        result: the identification.
        ax: one Axes, or None for a new figure.

    Raises:
        NotDeterminedError: the fit was refused.
    """
    require_answer(result)
    fit, ladder, floor = _find_fit(result)
    linear = next((step.fit for step in ladder if step.law_name == "linear"), None)
    names = [run.name for run in result.study.runs]
    with house_style():
        ax = panels(ax, 1, height_in=3.4)[0, 0]
        if linear is not None and fit.law_name != "linear":
            for i in range(len(names)):
                label = "linear law" if i == 0 else None
                ax.plot(*_compute_noise_lines(linear, i), color=PALE, linewidth=1.1, label=label)
        for i, (name, color) in enumerate(zip(names, choose_run_colors(len(names)), strict=True)):
            ax.plot(*_compute_noise_lines(fit, i), color=color, linewidth=1.3, label=f"{fit.law_name}, {name}")
        floor *= 1e3
        ax.axhline(
            floor, color=INK, linestyle="--", linewidth=1, label=f"sensor noise floor, {format_number(floor, 2)} mm/s²"
        )
        ax.set_yscale("log")
        plain_numbers(ax.yaxis)
        ax.margins(x=0)
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylabel("unexplained [mm/s² rms]")
        ax.set_title("What the model of the sprung mass leaves over")
        thicken(ax.legend(loc="best", ncols=2))
    return ax


def _find_fit(result: AnyIdentification) -> tuple[Fit | JointFit, Sequence[LawStep[Any]], float]:
    """The fit of all runs, the laws that were tried, and the noise floor of the sensors."""
    if isinstance(result, PaperIdentification):
        return result.joint, result.ladder, result.chain.noise_floor_m_per_s2
    return result.evidence[0].fit, result.evidence[0].ladder, result.evidence[0].noise


def _compute_noise_lines(fit: Fit | JointFit, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequency and rms of the white noise on each channel, mm/s^2, that would make the residual of each line."""
    if isinstance(fit, JointFit):
        frequency_hz, residual = fit.frequency_hz[index], fit.residual[index]
    else:
        frequency_hz = fit.model.runs[index].omega / (2 * np.pi)
        lines = np.abs(fit.errors.lines[index].reshape(-1, frequency_hz.size))
        residual = fit.model.level * np.sqrt(np.mean(lines**2, axis=0) / 2)
    middle, rms = smooth_lines(frequency_hz, residual, SMOOTHING_HZ)
    return middle, 1e3 * rms
