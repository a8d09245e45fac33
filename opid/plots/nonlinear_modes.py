"""Figures of nonlinear modes: sine beats, restoring forces, orders, force appropriation, decays, and truth tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from opid.estimate import format_percent
from opid.mechanics.truth import ModeTruth
from opid.modal.decay.free_decay import Decay
from opid.modal.decay.law import DecayLaw
from opid.modal.forced.mode_fit import ForceCurve, ModeFit
from opid.modal.forced.restoring_fit import OrderRung
from opid.modal.forced.system_fit import LawTrial, SystemFit
from opid.modal.linear.modes import ACCELERATION
from opid.modal.model import TruthTest
from opid.modal.resonance.appropriation import Appropriation, Interaction
from opid.modal.resonance.curve_fit import CurveFit
from opid.modal.resonance.held_out import HeldOut
from opid.modal.resonance.result import Resonance
from opid.modal.result import ModalIdentification
from opid.plots.modes import number_modes
from opid.plots.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    PALE,
    RUN_COLORS,
    SKY,
    VERMILION,
    house_style,
    name_rows,
    panels,
    plain_numbers,
    thicken,
)

# a value is well known if half of its interval is below this fraction of the range of the better half of the values
KNOWN = 0.5
ROOM_OF_DECAY = 0.08  # a panel leaves this fraction of the range of the well-known values above and below them
N_PERIODS = 5  # this many periods of the strongest line are shown on either side of the largest acceleration
AROUND = 256  # the period at the peak is looked for in this many samples to either side
ROOM = 2.0  # the panel at the peak is this many times as high as the peaks of measurement and nonlinear model
LEAST_SHOWN = 1e-4  # the spectrum is shown down to this fraction of its peak
N_CRESTS, LEAST_CRESTS = 400, 40  # this many points stand for many samples or lines; fewer than 40 show no shape
N_SHOWN = 6  # at most this many modal harmonics are drawn, each in a colour of the palette
_AMPLITUDE = "\N{SQUARE ROOT}kg"


def sine_beats(result: ModalIdentification, mode: int, axes: Any = None) -> np.ndarray:
    """Draw the tests that a mode was fitted to in its modal coordinate, in time and in frequency.

    Args:
        result: the identification.
        mode: number of the mode, from 1; one that was fitted.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    fit = next(fit for fit in result.fits if fit.mode == mode)
    tests = [test for test in result.tests if test.name in fit.tests]
    # the highest level lies below the others
    tests.sort(key=lambda test: -float(np.abs(test.modal_acceleration(mode)).max()))
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.3, width_in=7.4)
        over_time, over_frequency = grid[0]
        low, high = _find_range(result, fit)
        for color, test in zip(_choose_colors(len(tests)), tests, strict=True):
            motion = test.modal_acceleration(mode)
            over_time.plot(np.arange(motion.size) / test.fs, motion, color=color, linewidth=0.7, label=test.name)
            frequency, amplitude = compute_fourier_amplitude(motion, test.fs)
            seen = (frequency >= low) & (frequency <= high)
            over_frequency.plot(frequency[seen], amplitude[seen], color=color, linewidth=1.1, label=test.name)
        over_frequency.axvspan(*fit.band_hz, color=PALE, alpha=0.35, linewidth=0, zorder=0, label="fitted band")
        every = enumerate(result.modes.frequency_hz, start=1)
        number_modes(over_frequency, {n: hz for n, hz in every if max(low, 1e-9) <= hz <= high}, own=mode)
        over_frequency.set(yscale="log", xlim=(low, high))
        top = over_frequency.get_ylim()[1]
        over_frequency.set_ylim(top / 3e4, top)
        over_time.set(xlabel="time [s]", ylabel=f"modal acceleration [m/s² {_AMPLITUDE}]")
        over_time.set_title(f"Mode {mode}, {len(tests)} tests")
        over_frequency.set(xlabel="frequency [Hz]", ylabel=f"Fourier amplitude [m/s² {_AMPLITUDE}/Hz]")
        over_frequency.set_title("modes by number", fontweight="normal", pad=14)
        handles, labels = over_frequency.get_legend_handles_labels()
        thicken(over_time.legend(handles, labels, loc="upper right", fontsize=7.5, ncols=1 + len(tests) // 6))
    return grid


def mode_restoring_force(fit: ModeFit, axes: Any = None, *, truth: ModeTruth | None = None) -> np.ndarray:
    """Draw the stiffness and the damping force of a mode with its band, and its frequency and damping over amplitude.

    Args:
        fit: of the mode.
        truth: of a simulated test.
        axes: six Axes, or None for a new figure.

    Returns:
        (2, 3) Axes: stiffness above, damping below; whole force, nonlinear part, what it makes of the mode.
    """
    amplitude = fit.stiffness_curve.position
    with house_style():
        grid = panels(axes, 2, 3, height_in=5.2, width_in=8.6)
        _draw_force_row(grid[0], fit.stiffness_curve, f"q [{{}}m {_AMPLITUDE}]", "stiffness force", "k₀ q")
        kind = fit.joint_estimates.kind
        note = "" if kind is None else f", {kind.name} by its loss"
        _draw_force_row(grid[1], fit.damping_curve, f"q′ [{{}}m/s {_AMPLITUDE}]", "damping force", "c₀ q′", note)
        factor, prefix = _choose_prefix(amplitude)
        for ax, name, scale, values, label in (
            (grid[0, 2], "frequency_hz", 1, fit.frequency_at_hz, "natural frequency [Hz]"),
            (grid[1, 2], "damping_ratio", 100, fit.damping_at, "damping ratio [%]"),
        ):
            linear = scale * getattr(fit, name)
            ax.axhline(linear, color=BLUE, linestyle="--", linewidth=1.1, label="linear, as given")
            ax.plot(factor * amplitude, scale * values, color=VERMILION, linewidth=2.0, label="over amplitude")
            if truth is not None:
                at, known = np.asarray(truth.amplitude), scale * np.asarray(getattr(truth, name))
                shown = at <= 1.02 * amplitude[-1]
                dots = {"color": GREEN, "linewidth": 0, "marker": ".", "markersize": 6}
                ax.plot(factor * at[shown], known[shown], **dots, label="truth, other modes at rest")
            ax.set(xlabel=f"amplitude of q [{prefix}m {_AMPLITUDE}]", ylabel=label)
            thicken(ax.legend(loc="best", fontsize=7.5))
        grid[1, 2].set_ylim(bottom=0)
        orders = f"N_s = {fit.stiffness_order}, N_d = {fit.damping_order}"
        grid[0, 0].set_title(", ".join([f"Mode {fit.mode}: {orders}", *fit.joint_estimates.terms]))
        grid[0, 1].set_title("nonlinear part, 95 %", fontweight="normal")
    return grid


def modal_orders(fit: ModeFit, ax: Any = None) -> Axes:
    """Draw the misfit that each pair of orders leaves on tests that were left out.

    Args:
        fit: of a mode whose orders were searched.
        ax: one Axes, or None for a new figure.
    """
    rungs = sorted(fit.orders, key=lambda rung: (rung.stiffness_order, rung.damping_order))
    ax = _draw_trials(ax, [f"{rung.stiffness_order}, {rung.damping_order}" for rung in rungs], rungs)
    with house_style():
        ax.set_ylabel("N_s, N_d", labelpad=10)
        ax.set(xlabel="misfit where left out [% of the modal force]", title=f"Mode {fit.mode}: orders tried")
    return ax


def law_trials(fit: SystemFit, ax: Any = None) -> Axes:
    """Draw the misfit that each form of the law of one or several modes leaves on tests that were left out.

    Args:
        fit: of modes that were fitted by simulation.
        ax: one Axes, or None for a new figure.
    """
    labels = [each.terms.replace("; ", "\n") for each in fit.trials]
    rows = max(label.count("\n") + 1 for label in labels)
    ax = _draw_trials(ax, labels, fit.trials, row_in=0.1 + 0.16 * rows)
    with house_style():
        modes = " and ".join(str(mode) for mode in fit.modes)
        ax.set(
            xlabel="misfit where left out [% of the motion]",
            ylabel="terms",
            title=f"Mode{'s' * (len(fit.modes) > 1)} {modes}: laws tried, by their terms beside the linear ones",
        )
    return ax


def _draw_trials(ax: Any, labels: Sequence[str], trials: Sequence[OrderRung | LawTrial], row_in: float = 0.19) -> Axes:
    """Draw the errors of forms of a law with their standard errors, the chosen one in red."""
    with house_style():
        ax = panels(ax, 1, height_in=1.2 + row_in * len(trials), width_in=5.6)[0, 0]
        for row, trial in enumerate(trials):
            color = VERMILION if trial.chosen else INK
            error, std = 100 * trial.error, 100 * trial.error_std
            ax.plot([max(error - std, error / 3), error + std], [row, row], color=color, linewidth=1.2)
            ax.plot([error], [row], marker="o", markersize=6, color=color, linestyle="none")
        ax.set_xscale("log")
        plain_numbers(ax.xaxis)
        chosen = [trial.chosen for trial in trials]
        name_rows(ax, labels, [VERMILION if each else INK for each in chosen], chosen=chosen)
    return ax


def compute_fourier_amplitude(samples: np.ndarray, fs: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the lines of a transient record and its Fourier amplitude |X| there, the unit of the samples per Hz.

    >>> frequency, amplitude = compute_fourier_amplitude(np.r_[1.0, np.zeros(7)], 4.0)
    >>> frequency.tolist(), amplitude.tolist()
    ([0.0, 0.5, 1.0, 1.5, 2.0], [0.25, 0.25, 0.25, 0.25, 0.25])
    """
    return np.fft.rfftfreq(samples.size, 1 / fs), np.abs(np.fft.rfft(samples)) / fs


def _draw_force_row(row: np.ndarray, curve: ForceCurve, along: str, name: str, symbol: str, note: str = "") -> None:
    """The whole force beside the linear one, and the nonlinear part alone, with their band."""
    factor, prefix = _choose_prefix(curve.position)
    x = factor * curve.position
    whole, part = row[0], row[1]
    for ax, base in ((whole, curve.linear), (part, 0.0 * curve.linear)):
        ax.fill_between(x, base + curve.low, base + curve.high, color=VERMILION, alpha=0.25, linewidth=0)
        ax.plot(x, base, color=BLUE, linestyle="--", linewidth=1.1, label=f"linear, {symbol}")
        ax.plot(x, base + curve.force, color=VERMILION, linewidth=1.8, label=f"with nonlinear part{note}")
        ax.set_xlabel(along.format(prefix))
    whole.set_ylabel(f"{name} [N/{_AMPLITUDE}]")
    thicken(whole.legend(loc="upper left", fontsize=7.5))


def _choose_colors(n: int) -> list[Any]:
    if n <= 3:
        return [SKY, BLUE, INK][:n]
    return [colormaps["viridis"](0.85 * (1 - level / (n - 1))) for level in range(n)]


def _find_range(result: ModalIdentification, fit: ModeFit) -> tuple[float, float]:
    """A range of frequency with the fitted band and both neighbours in it."""
    below, above = result.modes.neighbours_hz(fit.mode)
    width = fit.band_hz[1] - fit.band_hz[0]
    low = max(below, fit.frequency_hz - 4 * width) if below else fit.band_hz[0]
    high = min(above, fit.frequency_hz + 4 * width) if np.isfinite(above) else fit.band_hz[1]
    room = 0.15 * (max(high, fit.band_hz[1]) - min(low, fit.band_hz[0]))
    return max(min(low, fit.band_hz[0]) - room, 0.0), max(high, fit.band_hz[1]) + room


def _choose_prefix(values: np.ndarray) -> tuple[float, str]:
    """A factor and the prefix of the unit that make values easy to read."""
    largest = float(np.abs(values).max())
    for factor, prefix in ((1.0, ""), (1e3, "m"), (1e6, "µ")):
        if largest * factor >= 1:
            return factor, prefix
    return 1e9, "n"


# ---- force appropriation ----------------------------------------------------------------------------


def backbone(appropriation: Appropriation, axes: Any = None, *, found: Resonance | None = None) -> np.ndarray:
    """Draw frequency and damping ratio of phase resonance over the amplitude of the mode (Fig. 11 of Pacini).

    Args:
        appropriation: all levels; those that did not lock are hollow.
        axes: two Axes, or None for a new figure.
        found: what a measured appropriation shows: its levels corrected to quadrature, and its law with a 95 % band.

    Returns:
        (1, 2) Axes.
    """
    amplitude = 1e6 * appropriation.amplitude
    index = appropriation.modes.index(appropriation.mode)
    linear = (appropriation.modes.frequency_hz[index], 100 * appropriation.modes.damping_ratio[index])
    values_of, held = (appropriation.frequency_hz, 100 * appropriation.damping_ratio), appropriation.locked
    if found is not None:
        amplitude, values_of = 1e6 * found.amplitude, (found.resonance_hz, 100 * found.damping_ratio)
    law = None if found is None else found.records_law
    dots: dict[str, Any] = {"color": VERMILION, "linestyle": "none", "marker": "o", "markersize": 4}
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.3)
        labels = ("frequency at phase resonance [Hz]", "damping ratio [%]")
        for ax, values, low, label in zip(grid[0], values_of, linear, labels, strict=True):
            ax.axhline(low, color=BLUE, linestyle="--", linewidth=1.1, label="linear")
            for word, shown, face in ((appropriation.held_word, held, VERMILION), ("not locked", ~held, "white")):
                if shown.any() or shown is held:
                    ax.plot(amplitude[shown], values[shown], **dots, markerfacecolor=face, label=word)
            ax.set(xlabel="amplitude of q [µm √kg]", ylabel=label)
        if law is not None:
            scaled = (law.frequency_hz, law.frequency_std_hz), (100 * law.damping_ratio, 100 * law.damping_std)
            for ax, (curve, std) in zip(grid[0], scaled, strict=True):
                ax.plot(1e6 * law.amplitude, curve, color=INK, linewidth=1.1, label="law")
                ends = curve - 1.96 * std, curve + 1.96 * std
                ax.fill_between(1e6 * law.amplitude, *ends, color=GREY, alpha=0.35, linewidth=0)
        count = str(held.size) if held.all() else f"{int(held.sum())} of {held.size}"
        grid[0, 0].set_title(f"Mode {appropriation.mode}: {count} {appropriation.held_word} levels")
        thicken(grid[0, 0].legend(loc="best"))
    return grid


def response_curves(curves: Sequence[CurveFit], axes: Any = None) -> np.ndarray:
    """Draw amplitude and phase of response curves over frequency, beside those that a law makes of the same forces.

    Args:
        curves: the curves, each in a colour of its own.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.6)
        for color, each in zip(_choose_colors(len(curves)), curves, strict=True):
            curve = each.curve
            label = f"{curve.name}: {np.median(curve.force_n):.3g} N"
            dots: dict[str, Any] = {"color": color, "linestyle": "none", "marker": "o", "markersize": 3.5}
            line: dict[str, Any] = {"color": color, "linewidth": 1.1}
            grid[0, 0].plot(curve.frequency_hz, curve.amplitude, **dots, label=label)
            grid[0, 0].plot(curve.frequency_hz, np.abs(each.response), **line)
            grid[0, 1].plot(curve.frequency_hz, curve.phase_deg, **dots)
            grid[0, 1].plot(curve.frequency_hz, np.degrees(np.angle(each.response)), **line)
        grid[0, 0].set(xlabel="frequency [Hz]", ylabel="acceleration [m/s²]", yscale="log")
        grid[0, 1].set(xlabel="frequency [Hz]", ylabel="phase over the force [°]")
        thicken(grid[0, 0].legend(loc="best", fontsize=7.5))
    return grid


def held_out_curve(found: HeldOut, axes: Any = None) -> np.ndarray:
    """Draw a response curve that no law has seen beside its prediction: amplitude with its 95 % band, and phase.

    Args:
        found: the curve and its prediction.
        axes: two Axes, or None for a new figure.

    Returns:
        (1, 2) Axes.
    """
    curve, response = found.fit.curve, found.fit.response
    order = np.argsort(curve.frequency_hz)
    hz = curve.frequency_hz[order]
    dots: dict[str, Any] = {"color": "black", "linestyle": "none", "marker": "o", "markersize": 3.5}
    line: dict[str, Any] = {"color": RUN_COLORS[0], "linewidth": 1.2}
    with house_style():
        grid = panels(axes, 1, 2, height_in=3.6)
        low, high = found.low[order], found.high[order]
        grid[0, 0].fill_between(hz, low, high, color=RUN_COLORS[0], alpha=0.2, linewidth=0, label="95 % band")
        grid[0, 0].plot(hz, np.abs(response[order]), **line, label="by the law of the other curves")
        grid[0, 0].plot(hz, curve.amplitude[order], **dots, label=f"{curve.name}, measured")
        grid[0, 1].plot(hz, np.degrees(np.angle(response[order])), **line)
        grid[0, 1].plot(hz, curve.phase_deg[order], **dots)
        grid[0, 0].set(xlabel="frequency [Hz]", ylabel="acceleration [m/s²]")
        grid[0, 1].set(xlabel="frequency [Hz]", ylabel="phase over the force [°]")
        thicken(grid[0, 0].legend(loc="best", fontsize=7.5))
    return grid


def sensor_harmonics(appropriation: Appropriation, sensor: str, ax: Any = None) -> Axes:
    """Draw the harmonics of a sensor over the level, the even ones dashed (Fig. 13a of Pacini).

    Args:
        appropriation: all levels.
        sensor: its name.
        ax: one Axes, or None for a new figure.

    Raises:
        InputError: no such sensor.
    """
    appropriation.modes.row(sensor)
    heights = np.abs(appropriation.sensors[:, appropriation.modes.sensors.index(sensor)])
    with house_style():
        ax = panels(ax, 1, height_in=3.3, width_in=5.2)[0, 0]
        for harmonic, (color, values) in enumerate(zip(RUN_COLORS, heights.T, strict=False), start=1):
            style = "--" if harmonic % 2 == 0 else "-"
            ax.plot(np.arange(1, len(heights) + 1), values, color=color, linestyle=style, label=f"harmonic {harmonic}")
        ax.set_yscale("log")
        ax.set_ylim(bottom=max(1e-6 * float(heights.max()), 0.5 * float(heights[heights > 0].min())))
        _label_levels(ax)
        ax.set(ylabel=_name_reading(appropriation.modes.unit(sensor)), title=f"Harmonics at {sensor}")
        thicken(ax.legend(loc="best", fontsize=7.5, ncols=2))
    return ax


def modal_harmonics(interaction: Interaction, ax: Any = None) -> Axes:
    """Draw the modal harmonics that anywhere exceed the wanted fraction of the target's fundamental (Pacini Fig. 13b).

    Args:
        interaction: what the appropriation shows.
        ax: one Axes, or None for a new figure.
    """
    fractions = interaction.fractions.copy()
    fractions[:, interaction.target - 1, 0] = 0.0
    largest = fractions.max(axis=0)
    order = np.argsort(-largest, axis=None)[:N_SHOWN]
    highest = list(zip(*np.unravel_index(order, largest.shape), strict=True))
    index = np.arange(1, len(fractions) + 1)
    with house_style():
        ax = panels(ax, 1, height_in=3.3, width_in=5.2)[0, 0]
        ax.axhline(1.0, color=INK, linewidth=1.4, label=f"mode {interaction.target}, harmonic 1")
        shown = [each for each in highest if largest[each] > interaction.least_fraction] or highest[:1]
        for color, (mode, harmonic) in zip(RUN_COLORS, shown, strict=False):
            label = f"mode {mode + 1}, harmonic {harmonic + 1}"
            ax.plot(index, fractions[:, mode, harmonic], color=color, label=label)
        ax.axhline(interaction.least_fraction, color=GREY, linestyle="--", linewidth=1.0, label="needed")
        # The legend must not hide the line of the mode itself, which ends at 1 where nothing interacts.
        ax.set_ylim(0, max(1.3, ax.get_ylim()[1]))
        _label_levels(ax)
        ax.set(ylabel="fraction of the fundamental", title="Interaction" if interaction.flagged else "No interaction")
        thicken(ax.legend(loc="best", fontsize=7.5))
    return ax


def harmonic_shape(interaction: Interaction, ax: Any = None) -> Axes:
    """Draw the MAC of a harmonic's deflection shape with the shapes of the mode and of others (Fig. 13c of Pacini).

    Args:
        interaction: what the appropriation shows.
        ax: one Axes, or None for a new figure.
    """
    index = np.arange(1, interaction.mac.size + 1)
    with house_style():
        ax = panels(ax, 1, height_in=3.3, width_in=5.2)[0, 0]
        ax.plot(index, interaction.mac, color=VERMILION, label=f"mode {interaction.mode}")
        ax.plot(index, interaction.mac_of_others, color=GREY, label="any other mode, at most")
        ax.axhline(interaction.least_assurance, color=INK, linestyle="--", linewidth=1.0, label="needed")
        ax.set_ylim(0, 1.05)
        _label_levels(ax)
        ax.set(ylabel="MAC", title=f"Shape of harmonic {interaction.harmonic}")
        thicken(ax.legend(loc="best", fontsize=7.5))
    return ax


def _label_levels(ax: Axes) -> None:
    ax.set_xlabel("level, in the order in which they were driven")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))


# ---- free decays ------------------------------------------------------------------------------------


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
    factor, unit = _choose_unit(float(decay.amplitude.max()), decay.amplitude_unit)
    shown = decay if law is None else law
    with house_style():
        grid = panels(axes, 1, 3, height_in=3.0, width_in=9.0)
        _draw_record(grid[0, 0], decay)
        of_law: list[tuple[np.ndarray, ...] | None] = [None, None]
        if law is not None:
            of_law = [(law.frequency_hz, law.frequency_std_hz), (law.damping_ratio, law.damping_std)]
        for ax, name, std, low, scale, label, curve in (
            (
                *(grid[0, 1], "frequency_hz", decay.frequency_std_hz, shown.frequency_low_hz, 1),
                *("natural frequency [Hz]", of_law[0]),
            ),
            (grid[0, 2], "damping_ratio", decay.damping_std, shown.damping_low, 100, "damping ratio [%]", of_law[1]),
        ):
            over = None
            if curve is not None and law is not None:
                over = factor * law.amplitude, scale * curve[0], scale * curve[1]
            lowest = None if low.value is None else scale * low.value
            _draw_over_amplitude(ax, factor * decay.amplitude, scale * getattr(decay, name), scale * std, lowest, over)
            ax.set(xlabel=f"amplitude [{unit}]", ylabel=label)
        thicken(grid[0, 1].legend(loc="best", fontsize=7.5))
    return grid


def _draw_record(ax: Axes, decay: Decay) -> None:
    ax.plot(decay.time_s, decay.signal, color=PALE, linewidth=0.6, label="record")
    for sign in (1, -1):
        label = "amplitude" if sign > 0 else None
        ax.plot(decay.time_s, sign * decay.envelope, color=VERMILION, linewidth=1.4, label=label)
    ax.set(xlabel="time [s]", ylabel=f"[{_format_unit(decay.signal_unit)}]")
    ax.set_title(decay.name if decay.mode is None else f"{decay.name}, mode {decay.mode}")
    thicken(ax.legend(loc="upper right", fontsize=7.5))


def _draw_over_amplitude(
    ax: Axes,
    amplitude: np.ndarray,
    values: np.ndarray,
    std: np.ndarray,
    low: float | None,
    law: tuple[np.ndarray, np.ndarray, np.ndarray] | None,
) -> None:
    """Draw the measured values with their band, the law, and its limit; the heights suit the well-known values."""
    known = _find_known(values, std)
    below, above = values - 1.96 * std, values + 1.96 * std
    ax.fill_between(amplitude, below, above, color=VERMILION, alpha=0.25, linewidth=0, label="95 %")
    ax.plot(amplitude, values, color=VERMILION, linewidth=0.7, alpha=0.4)
    ax.plot(amplitude, np.where(known, values, np.nan), color=VERMILION, linewidth=1.6, label="measured")
    if law is not None:
        at, curve, law_std = law
        ax.fill_between(at, curve - 1.96 * law_std, curve + 1.96 * law_std, color=GREY, alpha=0.35, linewidth=0)
        ax.plot(at, curve, color=INK, linewidth=1.0, label="law")
    ends = [*below[known], *above[known]]
    if low is not None:
        ends.append(low)
        ax.axhline(low, color=BLUE, linestyle="--", linewidth=1.1, label="law, at zero amplitude")
    room = ROOM_OF_DECAY * (max(ends) - min(ends)) or ROOM_OF_DECAY * abs(ends[0]) or 1.0
    ax.set(ylim=(min(ends) - room, max(ends) + room), xscale="log")


def _find_known(values: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Which values are well known, compared with the range of the better half of them."""
    better = std <= np.median(std)
    enough = max(KNOWN * float(np.ptp(values[better])), 2.0 * 1.96 * float(np.quantile(std, 0.25)))
    return 1.96 * std <= enough


def _choose_unit(largest: float, unit: str) -> tuple[float, str]:
    """A factor and a unit in which an amplitude in m or m kg^1/2 is easy to read."""
    factor, prefix = (1e3, "m") if largest >= 1e-3 else (1e6, "µ")
    return factor, prefix + _format_unit(unit)


def _format_unit(unit: str) -> str:
    return unit.replace("kg^1/2", "√kg").replace("^2", "²")


def _name_reading(unit: str) -> str:
    """The label of a sensor's axis: of a strain the second derivative is drawn."""
    return f"{'acceleration' if unit == ACCELERATION else 'second derivative'} [{_format_unit(unit)}]"


# ---- truth tests ------------------------------------------------------------------------------------


def truth_test(
    test: TruthTest, *, sensors: Sequence[str], nonlinear_hz: Sequence[float] = (), axes: Any = None
) -> np.ndarray:
    """Draw a truth test: acceleration over time, near its peak, and over frequency (Figs. 8 and 12 of Pacini).

    Args:
        test: the truth test.
        sensors: those to draw, one row each.
        nonlinear_hz: natural frequencies of the nonlinear modes, dashed lines.
        axes: three Axes a sensor, or None for a new figure.

    Returns:
        (n_sensors, 3) Axes.
    """
    with house_style():
        grid = panels(axes, len(sensors), 3, height_in=0.6 + 2.4 * len(sensors), width_in=9.4)
        for row, sensor in zip(grid, sensors, strict=True):
            _draw_sensor(row, test, sensor, nonlinear_hz)
            row[0].set(ylabel=_name_reading(test.measured.unit(sensor)), title=sensor)
            figures = test.sensors[sensor]
            peak = f"peak ×{figures.peak_ratio_nonlinear:.2f}, linear ×{figures.peak_ratio_linear:.2f}"
            error = (
                f"error {format_percent(figures.nrmse_nonlinear, 3)}, linear {format_percent(figures.nrmse_linear, 3)}"
            )
            for ax, title in ((row[1], peak), (row[2], error)):
                ax.set_title(title, fontweight="normal", fontsize=9)
        thicken(grid[0, 0].legend(loc="upper right", fontsize=7.5))
        for ax, label in zip(grid[-1], ("time [s]", "time [s], at the peak", "frequency [Hz]"), strict=True):
            ax.set_xlabel(label)
    return grid


def truth_test_figures(test: TruthTest, ax: Any = None) -> Axes:
    """Draw the errors of both models at every sensor of a truth test.

    Args:
        test: the truth test.
        ax: one Axes, or None for a new figure.
    """
    names = list(test.sensors)
    with house_style():
        ax = panels(ax, 1, height_in=3.0)[0, 0]
        for color, marker, label, values in (
            (BLUE, "s", "linear model", [100 * test.sensors[name].nrmse_linear for name in names]),
            (VERMILION, "o", "nonlinear model", [100 * test.sensors[name].nrmse_nonlinear for name in names]),
        ):
            ax.plot(range(len(names)), values, color=color, marker=marker, markersize=5, linestyle="none", label=label)
        ax.set_yscale("log")
        plain_numbers(ax.yaxis)
        ax.set_xticks(range(len(names)), names, rotation=90 * (len(names) > 8), fontsize=8 if len(names) <= 30 else 6)
        ax.set(xlabel="sensor", ylabel="rms error [% of measured rms]", title=f"Truth test {test.name!r}")
        ax.grid(False, axis="x")
        thicken(ax.legend(loc="best"))
    return ax


def _draw_sensor(row: np.ndarray, test: TruthTest, sensor: str, nonlinear_hz: Sequence[float]) -> None:
    whole, near, spectrum = row
    fs = test.measured.fs
    measured = test.measured.channel(sensor)
    # the linear model, whose curve is often the largest, lies below the others
    series = (
        (test.linear.channel(sensor), BLUE, "linear", 1),
        (measured, INK, "measured", 2),
        (test.nonlinear.channel(sensor), VERMILION, "nonlinear", 3),
    )
    time = test.measured.time_s
    peak = int(np.abs(measured).argmax())
    reach = _find_reach(measured, peak)
    close = slice(max(peak - reach, 0), peak + reach + 1)
    for values, color, label, order in series:
        settings: dict[str, Any] = {"color": color, "label": label, "zorder": order}
        # where two curves agree, a thin line is still seen on a broad one
        is_broad = label == "measured"
        _draw_whole(whole, time, values, 2 * reach // N_PERIODS, settings)
        near.plot(time[close], values[close], linewidth=2.6 if is_broad else 1.1, **settings)
        lines, height = compute_fourier_amplitude(values - values.mean(), fs)
        shown = _choose_lines(lines, test.band_hz, height)
        look = {"linewidth": 2.2, "alpha": 0.5} if is_broad else {"linewidth": 0.9, "alpha": 1}
        spectrum.plot(*_find_crests(lines[shown], height[shown]), **look, **settings)
    for hz in nonlinear_hz:
        spectrum.axvline(hz, color=GREY, linestyle="--", linewidth=0.8, zorder=0)
    spectrum.set_yscale("log")
    top = float(compute_fourier_amplitude(measured - measured.mean(), fs)[1].max())
    spectrum.set_ylim(LEAST_SHOWN * top, 4 * top)
    spectrum.set_ylabel(f"Fourier amplitude [{_format_unit(test.measured.unit(sensor))}/Hz]", fontsize=8.5)
    # a linear model that overshoots by far would flatten the other two
    highest = ROOM * max(float(np.abs(values[close]).max()) for values in (measured, test.nonlinear.channel(sensor)))
    near.set_ylim(max(near.get_ylim()[0], -highest), min(near.get_ylim()[1], highest))
    near.locator_params(axis="x", nbins=5)


def _draw_whole(ax: Axes, time: np.ndarray, values: np.ndarray, least: int, settings: dict[str, Any]) -> None:
    """Draw a whole record; if it has many periods, its envelope: of a measurement as an area, of a model as lines."""
    size = max(values.size // N_CRESTS, least)
    n = values.size // size
    if n < LEAST_CRESTS:
        ax.plot(time, values, linewidth=0.6, alpha=0.9, **settings)
        return
    blocks = values[: n * size].reshape(n, size)
    middle = time[size // 2 : n * size : size]
    low, high = blocks.min(axis=1), blocks.max(axis=1)
    if settings["label"] == "measured":
        ax.fill_between(middle, low, high, alpha=0.45, linewidth=0, **settings | {"zorder": 0.5})
        return
    for label, edge in ((settings["label"], high), (None, low)):
        ax.plot(middle, edge, linewidth=1.0, **settings | {"label": label})


def _find_crests(frequency: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The highest of each group of neighbouring lines: of very many lines, noise would fill an area."""
    size = frequency.size // N_CRESTS
    if size < 2:
        return frequency, height
    blocks = height[: size * N_CRESTS].reshape(N_CRESTS, size)
    crests = size * np.arange(N_CRESTS) + blocks.argmax(axis=1)
    return frequency[crests], height[crests]


def _find_reach(measured: np.ndarray, peak: int) -> int:
    """The number of samples to either side of the peak that hold some periods of the strongest line there."""
    near = measured[max(peak - AROUND, 0) : peak + AROUND]
    height = np.abs(np.fft.rfft(near * np.hanning(near.size)))
    strongest = max(int(height[1:].argmax()) + 1, 2)
    return max(8, round(N_PERIODS * near.size / strongest))


def _choose_lines(frequency: np.ndarray, band_hz: tuple[float, float] | None, height: np.ndarray) -> np.ndarray:
    """Which lines are drawn: those in the compared band, or without one up to the last that stands out."""
    if band_hz is not None:
        return (frequency > 0) & (frequency >= band_hz[0]) & (frequency <= band_hz[1])
    loud = np.flatnonzero(height > LEAST_SHOWN * height.max())
    return (frequency > 0) & (frequency <= frequency[loud[-1]])
