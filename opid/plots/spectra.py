"""Figures in the frequency domain: transmissibility, and what the fitted equation leaves over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opid.plots.style import (
    GREEN,
    GREY,
    INK,
    PALE,
    house_style,
    panels,
    plain_numbers,
    require_answer,
    run_colors,
    run_title,
    thick,
)
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.law_search.pursuit import LawStep
from opid.suspensions.paper.chain import RunEvidence
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.paper.spectral_equation import JointFit
from opid.suspensions.paper.transmissibility import suspension_transmissibility
from opid.suspensions.result import GearRatios

__all__ = ["equation_residual", "transmissibilities"]

# width over which the residual spectrum is averaged, Hz
SMOOTHING_HZ = 0.25
LOWEST_HZ, HIGHEST_HZ = 0.25, 40.0


@dataclass(frozen=True)
class _Suspension:
    """A linear suspension, per unit of the reference mass."""

    stiffness: float
    damping: float
    ground: float
    inverse_mass: float

    def transmissibility(self, mass_change_kg: float, frequency_hz: np.ndarray) -> np.ndarray:
        """That at the mass of one run."""
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
    chain, suspension = result.paper_chain, _suspension(result)
    n_runs = len(chain.runs)
    with house_style():
        grid = panels(
            axes,
            3,
            n_runs,
            height_in=6.8,
            width_in=max(5.4, 3.7 * n_runs),
            sharex=True,
            sharey="row",
            height_ratios=[3, 1.4, 1.1],
        )
        for column, run, color in zip(grid.T, chain.runs, run_colors(n_runs), strict=True):
            _transmissibility(column, run, suspension, color, chain.band_hz, with_law=not result.is_refused)
        grid[0, 0].set_ylabel("|T| = |X₂/X₁|")
        grid[1, 0].set_ylabel("phase [°]")
        grid[2, 0].set_ylabel("coherence")
    return grid


def _transmissibility(
    column: np.ndarray,
    run: RunEvidence,
    suspension: _Suspension | None,
    color: str,
    band_hz: tuple[float, float],
    *,
    with_law: bool,
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
    if with_law:
        subtracted, look = run.T_subtracted.value[shown], {"color": color, "linewidth": 1.0, "alpha": 0.45}
        lines.append(("force subtracted (the paper)", frequency_hz, subtracted, look))
        taken_out, look = beneath.value[shown], {"color": color, "linewidth": 1.6}
        lines.append(("force taken out (conditioned)", frequency_hz, taken_out, look))
    if suspension is not None:
        fitted = suspension.transmissibility(run.mass_change_kg, fitted_at)
        lines.append(("fitted suspension", fitted_at, fitted, {"color": INK, "linestyle": "--", "linewidth": 1.0}))
    for label, frequency, value, style in lines:
        magnitude.plot(frequency, np.abs(value), label=label, **style)
        if "paper" not in label:
            # from 0 down to -180 degrees: cut at +90, where nothing is
            phase.plot(frequency, np.degrees(np.angle(1j * value)) - 90, **style)
    magnitude.plot(
        [peak.frequency_hz for peak in run.peaks],
        [peak.magnitude for peak in run.peaks],
        marker="v",
        linestyle="none",
        color=GREEN,
        markersize=5,
        label="peaks of the measured |T|",
    )
    coherence.plot(frequency_hz, measured.coherence[shown], color=GREY, linewidth=0.9, label="spindle alone (ordinary)")
    if with_law:
        coherence.plot(frequency_hz, beneath.coherence[shown], color=color, label="spindle and force (multiple)")
    magnitude.set_xscale("log")
    magnitude.set_yscale("log")
    plain_numbers(magnitude.yaxis)
    magnitude.set_title(run_title(run))
    magnitude.legend(loc="lower left")
    phase.set_yticks([-180, -90, 0])
    phase.set_ylim(-225, 45)
    coherence.set_ylim(0, 1.05)
    coherence.set_xlabel("frequency [Hz]")
    coherence.set_xlim(LOWEST_HZ, highest)
    ticks = [tick for tick in (0.5, 1, 2, 5, 10, 20, 40) if tick <= highest]
    coherence.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
    coherence.legend(loc="lower left")
    for ax in column:
        ax.axvspan(*band_hz, color="#F6F6F6", zorder=0)


def _suspension(result: AnyIdentification) -> _Suspension | None:
    """What all runs tell of the linear suspension; None where it is refused or not determined."""
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
    fit, ladder, floor = _fit_of(result)
    linear = next((step.fit for step in ladder if step.law_name == "linear"), None)
    names = [run.name for run in result.study.runs]
    with house_style():
        ax = panels(ax, 1, height_in=3.4)[0, 0]
        if linear is not None and fit.law_name != "linear":
            for i in range(len(names)):
                label = "linear law" if i == 0 else None
                ax.plot(*_noise_lines(linear, i), color=PALE, linewidth=1.1, label=label)
        for i, (name, color) in enumerate(zip(names, run_colors(len(names)), strict=True)):
            ax.plot(*_noise_lines(fit, i), color=color, linewidth=1.3, label=f"{fit.law_name}, {name}")
        floor *= 1e3
        ax.axhline(floor, color=INK, linestyle="--", linewidth=1, label=f"sensor noise floor, {floor:.2g} mm/s²")
        ax.set_yscale("log")
        plain_numbers(ax.yaxis)
        ax.margins(x=0)
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylabel("unexplained [mm/s² rms]")
        ax.set_title("What the model of the sprung mass leaves over")
        thick(ax.legend(loc="best", ncols=2))
    return ax


def _fit_of(result: AnyIdentification) -> tuple[Fit | JointFit, Sequence[LawStep[Any]], float]:
    """The fit of all runs, the laws that were tried, and the noise floor of the sensors."""
    if isinstance(result, PaperIdentification):
        return result.joint, result.ladder, result.chain.noise_floor_m_per_s2
    return result.evidence[0].fit, result.evidence[0].ladder, result.evidence[0].noise


def _noise_lines(fit: Fit | JointFit, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequency and rms of the white noise on each channel, mm/s^2, that would make the residual of each line."""
    if isinstance(fit, JointFit):
        frequency_hz, residual = fit.frequency_hz[index], fit.residual[index]
    else:
        frequency_hz = fit.model.runs[index].omega / (2 * np.pi)
        residual = fit.model.level * fit.errors.lines[index].ravel() / np.sqrt(2)
    n = max(1, round(SMOOTHING_HZ / float(frequency_hz[1] - frequency_hz[0])))
    power = np.convolve(np.abs(residual) ** 2, np.ones(n), "valid") / n
    middle = np.convolve(frequency_hz, np.ones(n), "valid") / n
    return middle, 1e3 * np.sqrt(power)
