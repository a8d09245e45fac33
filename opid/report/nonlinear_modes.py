"""The report of a nonlinear modal model: modes, level shifts, decays, coefficients and truth tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from opid import plots
from opid.errors import list_names
from opid.estimate import Estimate, format_number, format_percent
from opid.mechanics.truth import ModalTruth, ModeTruth
from opid.modal.decay.free_decay import Decay
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.forced.system_fit import SystemFit
from opid.modal.joint_terms import JointEstimates
from opid.modal.linear.frequency_response import (
    ModeIndicator,
    cmif,
    measured_response,
    resynthesised,
    weigh_response,
)
from opid.modal.linear.modes import ACCELERATION
from opid.modal.model import TruthTest
from opid.modal.power_laws import unit_of
from opid.modal.result import ModalIdentification
from opid.modal.study import THRESHOLDS, ModalStudy
from opid.report.document import (
    Block,
    Column,
    Document,
    Figure,
    Paragraph,
    Row,
    Table,
    build_columns,
    build_warnings,
    format_count,
    write_options,
)
from opid.report.estimates import build_estimate_row, format_estimate, tabulate_estimates
from opid.report.sketch import sketch_modes
from opid.result import SummaryRow

N_SENSORS_SHOWN = 3  # at most this many sensors of a truth test are drawn
N_LINES = 4000  # the mode indicator of the linear modes is computed at this many frequencies
ABOVE_MODES = 1.15  # the mode indicators reach this many times the highest natural frequency
MOST_SENSORS = 8  # the text shows at most this many sensors of a truth test, the page all of them
MOST_ZOOMED = 5  # more panels of single modes in a row would be too narrow

_AMPLITUDE = Column("q", "m kg^1/2")

PACINI = "B. R. Pacini, Industrial applications of nonlinear modal modeling: two case studies."


def build_document(result: ModalIdentification, truth: ModalTruth | None = None) -> Document:
    """Return the report of a nonlinear modal model."""
    known = [str(fit.mode) for fit in result.fits]
    known += [f"{mode} (by free decays)" for mode in result.modes_by_decays_alone]
    worst = max((each.nrmse_nonlinear for test in result.truth_tests for each in test.sensors.values()), default=None)
    errors = (
        "" if worst is None else f"; in the truth tests no sensor is farther off than {format_percent(worst, 2)} (rms)"
    )
    return Document(
        result.title or "Nonlinear modal model",
        format_count(result.modes.n_modes, "mode"),
        f"Modelled as nonlinear: {', '.join(known) or 'none'}{errors}.",
        result.not_determined,
        (
            Paragraph(_say_basis(result)),
            *(
                table
                for table in (_tabulate_modes(result), _tabulate_shifts(result), _tabulate_decays(result))
                if table.rows
            ),
            *_tabulate_coefficients(result, _choose_truth(truth)),
            *(_tabulate_truth_test(test, first=result.drive_point) for test in result.truth_tests),
            build_warnings(result.all_warnings),
        ),
        lambda: list_figures(result, truth),
        write_command(result),
        source="study",
        reference=f"The method is that of {PACINI}",
        sketch=sketch_modes(result),
    )


def _say_basis(result: ModalIdentification) -> str:
    modes = result.modes
    rigid = modes.n_modes - int(np.count_nonzero(modes.elastic))
    points = list(dict.fromkeys(point for test in result.tests for point in test.drive_points))
    at = f", force at {list_names(map(repr, points))}" if points else ", no force"
    return (
        f"{modes.n_modes} modes ({rigid} rigid), {len(modes.sensors)} sensors{at}; condition number of the shapes "
        f"{format_number(result.condition_number, 3)}."
    )


def _tabulate_modes(result: ModalIdentification) -> Table:
    rows = []
    for fit in result.fits:
        of_fit = (
            ", ".join([str(fit.stiffness_order), str(fit.damping_order), *fit.joint_estimates.terms]),
            f"{format_number(fit.band_hz[0], 4)} .. {format_number(fit.band_hz[1], 4)}",
            format_percent(fit.residual_fraction, 2),
        )
        top = f"top, {format_number(fit.stiffness_curve.position[-1], 3)}"
        for index, label, more in ((0, "zero", of_fit), (-1, top, ("",) * len(of_fit))):
            frequency, damping = fit.frequency_at_hz[index], fit.damping_at[index]
            mode = str(fit.mode) if index == 0 else ""
            rows.append((mode, label, f"{frequency:.2f} Hz", format_percent(damping, 3), *more))
    return Table(
        (
            *build_columns("mode"),
            _AMPLITUDE,
            *build_columns("frequency", "damping", "N_s, N_d", "band [Hz]", "misfit", left=()),
        ),
        tuple(rows),
        note="Natural frequency and damping ratio at zero amplitude, and at the top, the largest modal displacement q "
        "fitted." + _say_delays(result),
    )


def _say_delays(result: ModalIdentification) -> str:
    told = []
    for fit in result.fits:
        value, std = format_estimate(fit.delay_s, 1e6)
        told += [f"{value} µs (mode {fit.mode}, standard deviation {std} µs)"] if fit.delay_s.value is not None else []
    return f" The delay of the accelerations after the forces is {list_names(told)}." if told else ""


def _tabulate_shifts(result: ModalIdentification) -> Table:
    rows = []
    for shift in result.shifts:
        frequency, damping = _find_lowest(shift.frequency_hz), _find_lowest(shift.damping_ratio)
        rows.append(
            (
                str(shift.mode),
                "-" if frequency is None else f"{frequency:.2f} Hz",
                _format_percent(shift.frequency_shift, digits=2),
                "-" if damping is None else format_percent(damping, 3),
                _format_percent(shift.damping_shift, digits=0),
                ("yes" if shift.nonlinear else "no") if shift.determined else "cannot tell",
            )
        )
    return Table(
        build_columns("mode", "frequency", "frequency shift", "damping", "damping shift", "nonlinear"),
        tuple(rows),
        note="Frequency and damping are those at the lowest level, shifts those from there to the highest level."
        + _say_thresholds(result),
    )


def _say_thresholds(result: ModalIdentification) -> str:
    frequency, damping = (result.settings.get(name) for name in ("frequency_threshold", "damping_threshold"))
    if frequency is None or damping is None:
        return ""
    return (
        f" A mode is nonlinear where its frequency shifts by more than {format_percent(frequency, 3)} or its "
        f"damping ratio by more than {format_percent(damping, 3)}, by three standard errors."
    )


def _tabulate_decays(result: ModalIdentification) -> Table:
    """Frequency and damping of each free decay at its largest amplitude, and at zero by its law."""
    rows: list[Row] = []
    for decay in result.decays:
        low, damping = decay.frequency_low_hz.value, decay.damping_low.value
        zero = (
            "-" if low is None else f"{low:.2f} Hz",
            "-" if damping is None else format_percent(damping, 3),
        )
        top = (f"{decay.frequency_hz[0]:.2f} Hz", format_percent(decay.damping_ratio[0], 3))
        mode = "-" if decay.mode is None else str(decay.mode)
        rows.append((decay.name, mode, "zero", *zero, format_percent(decay.residual_fraction, 2)))
        rows.append(("", "", f"top, {format_number(decay.amplitude[0], 3)}", *top, ""))
    heads = build_columns("frequency", "damping", "left over", left=())
    return Table(
        (*build_columns("free decay", "mode"), _AMPLITUDE, *heads),
        tuple(rows),
        note="At zero amplitude by the law of the decay, and at the top, its largest amplitude, as measured.",
    )


def _tabulate_coefficients(result: ModalIdentification, truth: ModalTruth | None) -> Iterator[Block]:
    rows = [row for fit in result.fits for row in _list_mode_rows(fit, truth)]
    rows += [row for system in result.systems for row in _list_system_rows(system)]
    rows += [row for mode in sorted(result.decay_laws) for row in _list_decay_rows(result, mode, truth)]
    decays = " Free decays give k₀ and c₀ themselves: there these are k1 and c1." if result.decay_laws else ""
    if truth:
        decays += " The tests were simulated: truth, error, and whether the interval held the truth, are known."
    if any(system.couplings for system in result.systems):
        decays += (
            " A product k q₁₀² q₁₈ of the potential pulls mode 18 with k q₁₀² and mode 10 with 2 k q₁₀ q₁₈; q₁₈ / q₁₀ "
            "is the stretch of their joint by a unit of the one over that of the other."
        )
    if rows:
        yield tabulate_estimates(
            rows,
            truth,
            "Coefficients",
            legend="q″ + c₀ q′ + k₀ q + Σ kₙ q |q|ⁿ⁻¹ + Σ cₙ q′ |q′|ⁿ⁻¹ = φᵀ f, mass-normalised shapes φ. The interval "
            "holds the value with 95 % if the model holds. Of several powers none means much alone; the force curve "
            f"below does.{decays}",
        )


def _choose_truth(truth: ModalTruth | None) -> ModalTruth | None:
    """The truth if it has coefficients to compare with, as only joints with power laws have."""
    return truth if truth and any(law.k or law.c for law in truth.nonlinear.values()) else None


def _list_mode_rows(fit: ModeFit, truth: ModalTruth | None) -> Iterator[Row]:
    free = "k0 and c0 corrected (k1, c1)" if fit.free_linear else "k0 and c0 as given"
    damping = f"{format_percent(fit.damping_ratio, 3)} of critical damping"
    yield (f"Mode {fit.mode}, {fit.frequency_hz:.2f} Hz, {damping}: {free}{_say_joint(fit.joint_estimates, 'k0')}",)
    yield from list_power_rows(fit.mode, fit.stiffness, fit.damping, truth, lowest=1)
    yield from _list_joint_rows(fit.joint_estimates.list_rows())


def _say_joint(joint: JointEstimates, rest: str) -> str:
    """A clause on a joint of a named kind, whose stiffness before it slides is in the coefficient `rest`."""
    return f"; {joint.named.words}, whose stiffness before it slides is in {rest}" if joint.named else ""


def _list_joint_rows(rows: Iterable[SummaryRow]) -> Iterator[Row]:
    for row in rows:
        yield build_estimate_row(row.name.split(".")[-1].replace("_", " "), row.unit, row.estimate)


def _list_system_rows(system: SystemFit) -> Iterator[Row]:
    """The products by which modes drive each other, and the corrections of the modes that are driven."""
    if not system.couplings:
        return
    yield (f"Modes {' and '.join(str(mode) for mode in system.modes)} together: products in their potential",)
    for each in system.couplings:
        yield build_estimate_row(each.product.name, each.product.unit, each.coefficient)
    for mode, ratio in system.ratios.items():
        yield build_estimate_row(f"q{mode} / q{system.modes[0]}", "1", ratio)
    for mode, law in system.driven.items():
        for letter, estimates in (("k", law.stiffness), ("c", law.damping)):
            for power, estimate in estimates.items():
                yield build_estimate_row(f"{letter}{power}, q{mode}", unit_of(letter, power), estimate)
        for row in law.joint_estimates.list_rows():
            yield build_estimate_row(f"{row.name.replace('_', ' ')}, q{mode}", row.unit, row.estimate)


def _list_decay_rows(result: ModalIdentification, mode: int, truth: ModalTruth | None) -> Iterator[Row]:
    """The coefficients of a mode by its free decays; k1 and c1 are k0 and c0 themselves, whose truth is unknown."""
    law = result.decay_laws[mode]
    names = [decay.name for decay in result.decays if decay.mode == mode]
    many = f"{len(names)} free decays together" if len(names) > 1 else f"free decay {names[0]!r}" if names else "decays"
    of_joint = _say_joint(law.joint_estimates, "k1")
    yield (f"Mode {mode} by {many}, {law.frequency_low_hz.value or 0:.2f} Hz: k1 and c1 are k0 and c0{of_joint}",)
    yield from list_power_rows(mode, law.stiffness, law.damping, truth, lowest=2)
    yield from _list_joint_rows(law.joint_estimates.list_rows())


def list_power_rows(
    mode: int,
    stiffness: Mapping[int, Estimate],
    damping: Mapping[int, Estimate],
    truth: ModalTruth | None,
    *,
    lowest: int,
) -> Iterator[Row]:
    """A row for each power; from the power `lowest` on the truth is known."""
    true = truth.nonlinear.get(mode) if truth else None
    for letter, estimates, known in (("k", stiffness, true and true.k), ("c", damping, true and true.c)):
        # a power that the true law lacks is zero; only a joint with a power law has coefficients
        for power, estimate in sorted(estimates.items()):
            value = known.get(power, 0.0) if known and power >= lowest else None
            yield build_estimate_row(f"{letter}{power}", unit_of(letter, power), estimate, value)


def _tabulate_truth_test(test: TruthTest, *, first: str | None) -> Table:
    """The errors of a truth test: at the drive point first, then from the worst sensor to the best."""
    band = (
        ""
        if test.band_hz is None
        else f", {format_number(test.band_hz[0], 4)} to {format_number(test.band_hz[1], 4)} Hz"
    )
    rows = [
        (
            name,
            f"{each.peak_ratio_nonlinear:.3f}",
            f"{each.peak_ratio_linear:.3f}",
            format_percent(each.nrmse_nonlinear, 3),
            format_percent(each.nrmse_linear, 3),
        )
        for name, each in ((name, test.sensors[name]) for name in sorted(test.worst_sensors, key=lambda s: s != first))
    ]
    return Table(
        build_columns("sensor", "peak, nonlinear", "peak, linear", "error, nonlinear", "error, linear"),
        tuple(rows),
        f"Truth test {test.name!r}{band}",
        "Peak of the model over the measured peak, and rms error over the rms of the measurement, nonlinear and linear "
        "model.",
        most_in_text=MOST_SENSORS,
    )


def write_command(result: ModalIdentification, options: Mapping[str, Any] | None = None) -> list[str]:
    """Return the words of the command that gives this result."""
    given = _find_changed_settings(result) if options is None else options
    words = ["opid", "modal", str(result.settings.get("study") or "STUDY.toml")]
    words += write_options({name: f"{value:g}" for name, value in given.items() if name != "free_linear"})
    if given.get("free_linear") is not None:
        words.append("--free-linear" if given["free_linear"] else "--fixed-linear")
    return words


def _find_changed_settings(result: ModalIdentification) -> dict[str, Any]:
    names = ("stiffness_order", "damping_order", "free_linear", *THRESHOLDS)
    given = {name: result.settings[name] for name in names if result.settings.get(name) is not None}
    return {name: value for name, value in given.items() if value != getattr(ModalStudy, name)}


def _find_lowest(estimates: tuple[Estimate, ...]) -> float | None:
    return next((each.value for each in estimates if each.value is not None), None)


def _format_percent(shift: Estimate, *, digits: int) -> str:
    # adding 0 turns -0 into 0
    return "-" if shift.value is None else f"{round(100 * shift.value, digits) + 0.0:+.{digits}f} %"


# ---- figures ----------------------------------------------------------------------------------------


def list_figures(result: ModalIdentification, truth: ModalTruth | None) -> Iterator[Figure]:
    """Yield the figures, in the order of the work, for which the result has data."""
    yield Figure(
        "auto_mac",
        "Are the shapes independent?",
        "Modal assurance criterion of the shapes against each other. Two modes with a high value "
        "are distinguished by few sensors only, and mix in the modal filter.",
        lambda: plots.auto_mac(result),
    )
    if result.drive_point is not None:
        yield Figure(
            "mode_indicators",
            "What the linear modes explain",
            "Complex mode indicator function of the level tests (in colour, the lowest level first) and of the linear "
            "modes (dashed). They should agree at the lowest level; a peak that moves and widens with the level is a "
            "nonlinear mode."
            if result.shifts
            else "Complex mode indicator function of the linear modes.",
            lambda: _draw_indicators(result),
        )
    if result.shifts:
        yield Figure(
            "level_shifts",
            "Which modes are nonlinear",
            "Change of natural frequency and damping ratio from the lowest level to the highest, with 95 % intervals. "
            "Beyond the thresholds (dashed), by three standard errors, a mode counts as nonlinear.",
            lambda: plots.level_shift_figures(
                result.shifts, **{name: result.settings[name] for name in THRESHOLDS if name in result.settings}
            ),
        )
    for fit in result.fits:
        yield from _list_mode_figures(result, fit, truth)
    for system in result.systems:
        name = "_".join(str(mode) for mode in system.modes)
        left = ", ".join(
            f"{format_percent(each, 2)} of the motion of mode {mode}" for mode, each in system.missed.items()
        )
        yield Figure(
            f"modes_{name}_laws",
            f"Mode{'s' * (len(system.modes) > 1)} {name.replace('_', ' and ')}: which law",
            "Misfit on tests that were left out, of laws fitted by simulation. The fewest terms are chosen that "
            f"predict as well as the best. Of the motion they leave {left}.",
            lambda system=system: plots.law_trials(system),  # type: ignore[misc]
        )
    for number, decay in enumerate(result.decays, start=1):
        yield Figure(
            f"decay_{number}",
            f"Free decay {decay.name}",
            "The record with the amplitude that was followed, and natural frequency and damping ratio over it, beside "
            "those of the law that the decays of this mode give together. Wiggles are noise or a second mode.",
            _draw_decay(result, decay),
        )
    for number, test in enumerate(result.truth_tests, start=1):
        yield from _list_truth_test_figures(result, number, test)


def _list_mode_figures(result: ModalIdentification, fit: ModeFit, truth: ModalTruth | None) -> Iterator[Figure]:
    known = (
        " Green dots are the truth of the simulation: frequency and damping of this mode while all others are at rest."
        if _find_true_mode(fit, truth)
        else ""
    )

    yield Figure(
        f"mode_{fit.mode}_tests",
        f"Mode {fit.mode}: the tests it was fitted to",
        "Its modal acceleration in time and frequency. A good beat has its energy between the neighbouring modes "
        "(dashed) and has decayed at its end.",
        lambda: plots.sine_beats(result, fit.mode),
    )
    yield Figure(
        f"mode_{fit.mode}_force",
        f"Mode {fit.mode}: restoring force, frequency and damping",
        "Stiffness force over displacement and damping force over velocity, whole and nonlinear part alone with its "
        "95 % band, and what they make of natural frequency and damping ratio. Beyond the drawn range the law is an "
        f"extrapolation.{known}",
        lambda: plots.mode_restoring_force(fit, truth=_find_true_mode(fit, truth)),
    )
    if fit.orders:
        yield Figure(
            f"mode_{fit.mode}_orders",
            f"Mode {fit.mode}: how many powers",
            "Misfit on tests that were left out. The fewest powers are chosen that predict as well as the best.",
            lambda: plots.modal_orders(fit),
        )


def _list_truth_test_figures(result: ModalIdentification, number: int, test: TruthTest) -> Iterator[Figure]:
    yield Figure(
        f"truth_test_{number}",
        f"Truth test {test.name}",
        "No fit has seen this test. Measured (black, grey), nonlinear model (red), linear model (blue) under the "
        "measured force. Left: the whole record; where it has too many periods to draw, its upper and lower envelope, "
        "the measured one as a grey area. Middle: around the largest measured acceleration. Right: over frequency; "
        "where there are too many lines to draw, the largest of each group of neighbouring ones. Dashed lines are the "
        "nonlinear modes.",
        lambda: plots.truth_test(
            test,
            sensors=_choose_sensors(result, test),
            nonlinear_hz=[result.modes.frequency_hz[mode - 1] for mode in result.model.laws],
        ),
    )
    yield Figure(
        f"truth_test_{number}_errors",
        f"Truth test {test.name}: every sensor",
        "Rms error of both models over the rms of the measurement.",
        lambda: plots.truth_test_figures(test),
    )


def _draw_decay(result: ModalIdentification, decay: Decay) -> Callable[[], Any]:
    law = None if decay.mode is None else result.decay_laws.get(decay.mode)
    return lambda: plots.free_decay_figure(decay, law=law)


def _draw_indicators(result: ModalIdentification) -> Any:
    measured = _compute_measured_indicators(result)
    top = ABOVE_MODES * float(result.modes.frequency_hz.max())
    elastic = result.modes.frequency_hz[result.modes.elastic]
    frequency = np.linspace(0.5 * float(elastic.min()), top, N_LINES)
    response = resynthesised(result.modes, np.union1d(frequency, elastic), str(result.drive_point))
    made = cmif([weigh_response(response, result.modes)])
    marked = {mode: float(result.modes.frequency_hz[mode - 1]) for mode in sorted(result.model.laws)}
    zoomed = list(marked)[:MOST_ZOOMED] if measured else []
    return plots.mode_indicators(measured, made, marked=marked, zoomed=zoomed)


def _compute_measured_indicators(result: ModalIdentification) -> dict[str, ModeIndicator]:
    names = {name for shift in result.shifts for name in shift.levels}
    # A response belongs to one force.
    single = [test for test in result.tests if test.name in names and len(test.forces) == 1]
    tests = sorted(single, key=lambda test: float(np.abs(test.forces[0].samples).max()))
    return {test.name: cmif([weigh_response(measured_response([test]), test.modes)]) for test in tests}


def _choose_sensors(result: ModalIdentification, test: TruthTest) -> list[str]:
    """The drive point, the sensor that moves most in the model, and the one with the largest error."""
    names = list(test.sensors)
    moving = [name for name in names if test.nonlinear.unit(name) == ACCELERATION] or names
    moves_most = max(moving, key=lambda name: float(np.abs(test.nonlinear.channel(name)).max()))
    drive = [result.drive_point] if result.drive_point in names else []
    return list(dict.fromkeys([*drive, moves_most, test.worst_sensors[0]]))[:N_SENSORS_SHOWN]


def _find_true_mode(fit: ModeFit, truth: ModalTruth | None) -> ModeTruth | None:
    known = truth.nonlinear.get(fit.mode) if truth else None
    return known if known and known.amplitude else None
