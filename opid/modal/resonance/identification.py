"""From tests at phase resonance and response curves to backbone and law of a mode, and its interaction with others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError, refuse
from opid.estimate import Estimate
from opid.modal.forced.mode_tests import find_largest_mode
from opid.modal.linear.modes import LinearModes, ModalTest, with_sensors
from opid.modal.resonance.appropriation import Appropriation, Interaction, modal_interaction
from opid.modal.resonance.curve_fit import (
    CurveFit,
    CurvesLaw,
    describe_wrong_mass,
    find_inertia_range,
    fit_curves,
    make_curve,
    scale_shapes,
    warn_of_extrapolation,
)
from opid.modal.resonance.curves import ResponseCurve, find_curve_mode
from opid.modal.resonance.held_out import HeldOut, choose_held_out, predict_held_out
from opid.modal.resonance.law import ResonanceLaw, explain_phase, fit_states, reaches_zero
from opid.modal.resonance.result import Resonance, Resonances
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import MeasuredLevel, SteadyState, measure_levels
from opid.modal.settings import MODAL
from opid.modal.study import ModalStudy
from opid.progress import Say
from opid.provenance import ReadFile


def identify_resonance(
    study: ModalStudy,
    *,
    mode: int | None = None,
    hold_out: str | None = None,
    free_mass: bool = False,
    settings: ResonanceSettings | None = None,
    progress: Say | None = None,
) -> Resonance:
    """Identify one mode from tests at phase resonance, of one level each or of several, and from response curves.

    In each log the steady levels are found, and every level gives stiffness and damping of the mode at its amplitude,
    also where its phase is not at quadrature. The law follows from the levels as a backbone, from the steady records
    with their measured harmonics and the transients between them, from the points of response curves, and from records
    and curves together where they agree.

    Args:
        study: linear modes, and tests with the use "resonance", or response curves, or both.
        mode: number of the mode, from 1; where None, that of tests and curves.
        hold_out: a response curve that no law sees and the law of the others predicts: its name, or "highest" for that
            of the largest displacement; none where None.
        free_mass: whether the scale of the shape is found from the response curves, for shapes that are not
            mass-normalised: the curves then show a modal mass of 1.
        settings: where a level is steady and which levels and points count; where left out, the usual ones with the
            `gain_tolerance` of the study.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: neither such a test nor a curve, tests of several modes, no steady level that counts, a force of
            wrong polarity, or no such curve to hold out.
        NotDeterminedError: the curves do not tell the scale of the shape.
    """
    _require_study(study)
    held = _assign_modes(study)
    if mode is None and len(held) > 1:
        listed = ", ".join(map(str, held))
        raise InputError(f"the tests hold the modes {listed}: choose one with mode, like {next(iter(held))}")
    number = next(iter(held)) if mode is None else _require_mode(study, held, mode)
    wanted = _Wanted(mode, hold_out, free_mass)
    chosen = settings or ResonanceSettings(gain_tolerance=study.gain_tolerance)
    return _identify_mode(study, held[number], wanted, chosen, progress or (lambda step: None))


def identify_resonances(
    study: ModalStudy,
    *,
    hold_out: str | None = None,
    free_mass: bool = False,
    settings: ResonanceSettings | None = None,
    progress: Say | None = None,
) -> Resonances:
    """Identify all modes that the tests at phase resonance and the response curves of a study hold.

    A mode that cannot be read does not keep the others back: its reason stands beside them.

    Args:
        study: as in `identify_resonance`. Each test and each curve is of the mode that it names, or of the one that it
            moves most.
        hold_out: "highest", as in `identify_resonance`; of modes with response curves only.
        free_mass: as in `identify_resonance`.
        settings: as in `identify_resonance`.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: neither such a test nor a curve, or none of the modes can be read.
    """
    _require_study(study)
    say = progress or (lambda step: None)
    chosen = settings or ResonanceSettings(gain_tolerance=study.gain_tolerance)
    every = _assign_modes(study)
    asked = _Wanted(None, hold_out, free_mass)
    faults: dict[int, str] = {}
    if len(every) == 1:
        found = [_identify_mode(study, next(iter(every.values())), asked, chosen, say)]
    else:
        found, faults = _identify_each(study, every, asked, chosen, say)
    if not found:
        refuse([f"mode {number}: {fault}" for number, fault in faults.items()], study.source)
    return Resonances(study.title, tuple(found), faults, {**asdict(asked), "study": str(study.source or "")})


def _identify_each(
    study: ModalStudy, every: Mapping[int, _Measurements], asked: _Wanted, chosen: ResonanceSettings, say: Say
) -> tuple[list[Resonance], dict[int, str]]:
    """Return the modes that could be read, and why the others could not be, by their number."""
    found: list[Resonance] = []
    faults: dict[int, str] = {}
    for number, own in sorted(every.items()):
        say(f"mode {number}")
        has_curves = bool(own.curves)
        wanted = _Wanted(number, asked.hold_out if has_curves else None, asked.free_mass and has_curves)
        try:
            found.append(_identify_mode(study, own, wanted, chosen, say))
        except (InputError, NotDeterminedError) as error:
            faults[number] = str(error)
    return found, faults


@dataclass(frozen=True)
class _Wanted:
    """What is asked for, with fields as the arguments of `identify_resonance`."""

    mode: int | None
    hold_out: str | None
    free_mass: bool


@dataclass(frozen=True)
class _Measurements:
    """The tests and the curves of one mode."""

    mode: int
    tests: tuple[ModalTest, ...]
    curves: tuple[ResponseCurve, ...]

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The files that they were read from, each once."""
        of_tests = [file for test in self.tests for file in test.recording.files]
        return tuple(dict.fromkeys([*of_tests, *(file for curve in self.curves for file in curve.files)]))


def _require_study(study: ModalStudy) -> None:
    if not isinstance(study, ModalStudy):
        raise InputError(f"study is of type {type(study).__name__}: give a ModalStudy, as read_study makes one")


def _assign_modes(study: ModalStudy) -> dict[int, _Measurements]:
    """Return the tests and the curves of each mode, by its number, the modes in the order of the tests."""
    given = study.of_use("resonance")
    if not given and not study.curves:
        raise InputError(
            'no test has use = "resonance", and there are no [[curves]]: give the use to the logs of force '
            "appropriation, or name files of response curves"
        )
    candidates = study.nonlinear or [int(each) + 1 for each in np.flatnonzero(study.modes.elastic)]
    of_tests = [each.mode or find_largest_mode(each.test, candidates) for each in given]
    of_curves = [find_curve_mode(each, study.modes, candidates) for each in study.curves]
    return {
        number: _Measurements(
            number,
            tuple(each.test for each, own in zip(given, of_tests, strict=True) if own == number),
            tuple(each for each, own in zip(study.curves, of_curves, strict=True) if own == number),
        )
        for number in dict.fromkeys([*of_tests, *of_curves])
    }


def _require_mode(study: ModalStudy, held: Mapping[int, _Measurements], mode: int) -> int:
    study.modes.index(mode)
    if mode not in held:
        raise InputError(f"no test holds mode {mode}: they hold {', '.join(map(str, sorted(held)))}")
    return mode


def _identify_mode(
    study: ModalStudy, own: _Measurements, wanted: _Wanted, chosen: ResonanceSettings, say: Say
) -> Resonance:
    orders: dict[str, Any] = {"stiffness_order": study.stiffness_order, "damping_order": study.damping_order}
    if wanted.hold_out is not None and not own.curves:
        raise InputError(f"mode {own.mode} has no response curve to hold out: give [[curves]], or leave hold_out away")
    stated = chosen.gain_tolerance
    own, modes, mass, chosen = _scale(study, own, wanted, chosen)
    levels = _identify_levels(own.tests, own.mode, orders, chosen, say) if own.tests else None
    found = _read_curves(study, own, modes, levels, orders, wanted.hold_out, chosen, say)
    reasons = (levels.reason if levels else "", found.law.reason if found.law else "")
    records_law = levels.records_law if levels else None
    curves_law = found.law.law if found.law else None
    return Resonance(
        title=study.title,
        mode=own.mode,
        modes=modes,
        drive_point=study.drive_point or own.tests[0].drive_point or "",
        appropriation=levels.appropriation if levels else None,
        states=levels.states if levels else (),
        level_tests=levels.names if levels else (),
        level_start_s=np.array(levels.start_s if levels else ()),
        level_stop_s=np.array(levels.stop_s if levels else ()),
        left_out=levels.left_out if levels else (),
        backbone_law=levels.backbone_law if levels else None,
        records_law=records_law,
        curves_law=curves_law,
        joint_law=found.joint_law,
        curve_states=found.law.states if found.law else (),
        curve_fits=found.fits,
        curve_check=found.law.check if found.law else None,
        held_out=found.held_out,
        modal_mass=mass,
        interaction=levels.interaction if levels else None,
        warnings=(*_warn_of_named(study, own.mode), *(levels.warnings if levels else ()), *found.warnings),
        not_determined="; ".join(filter(None, reasons)) if records_law is None and curves_law is None else "",
        settings={
            **orders,
            **asdict(wanted),
            "gain_tolerance": stated,
            "study": str(study.source or ""),
        },
        read_files=own.files,
    )


def _warn_of_named(study: ModalStudy, mode: int) -> Iterator[str]:
    """Warn of what a study names for the law of a mode and this law cannot have."""
    named = [f"the joint {study.memory}"] if study.memory and mode in (study.nonlinear or (mode,)) else []
    products = ", ".join(each.name for each in study.find_couplings(mode))
    named += [f"the coupling(s) {products}"] if products else []
    if named:
        yield (
            f"{' and '.join(named)} that the study names {'is' if len(named) == 1 and not products else 'are'} left "
            "out: the law of tests at phase resonance and of response curves has powers of one mode only; give "
            "`opid modal` sine beats or free decays of it"
        )


def _scale(
    study: ModalStudy, own: _Measurements, wanted: _Wanted, chosen: ResonanceSettings
) -> tuple[_Measurements, LinearModes, Estimate, ResonanceSettings]:
    """Return measurements, modes and settings with the scale of the shape that the curves show, and the modal mass.

    Nothing changes, and the mass is empty, where the scale is known.
    """
    if not wanted.free_mass:
        return own, study.modes, Estimate(), chosen
    if not own.curves:
        raise InputError(
            f"mode {own.mode} has no response curve that shows its modal mass: give [[curves]], or mass-normalised "
            "shapes"
        )
    assert study.drive_point is not None  # A study with curves has one.
    name = wanted.hold_out
    left = None if name is None else choose_held_out(own.curves, name, study.modes, own.mode)
    seen = [each for each in own.curves if each is not left]
    modes, mass = scale_shapes(seen, modes=study.modes, mode=own.mode, drive_point=study.drive_point, settings=chosen)
    tests = tuple(replace(each, modes=modes) for each in own.tests)
    unknown = float(mass.std or 0.0) / float(mass.value or 1.0)
    known = replace(chosen, gain_tolerance=float(np.hypot(chosen.gain_tolerance, unknown)))
    return replace(own, tests=tests), modes, mass, known


@dataclass(frozen=True, eq=False)
class _Curves:
    """What the response curves of a mode give, with fields as in `Resonance`."""

    law: CurvesLaw | None = None
    joint_law: ResonanceLaw | None = None
    fits: tuple[CurveFit, ...] = ()
    held_out: HeldOut | None = None
    warnings: tuple[str, ...] = ()


def _read_curves(
    study: ModalStudy,
    own: _Measurements,
    modes: LinearModes,
    levels: _Levels | None,
    orders: dict[str, Any],
    hold_out: str | None,
    chosen: ResonanceSettings,
    say: Say,
) -> _Curves:
    if not own.curves:
        return _Curves()
    say("the response curves")
    assert study.drive_point is not None  # A study with curves has one.
    place: dict[str, Any] = {"modes": modes, "mode": own.mode, "drive_point": study.drive_point}
    left = None if hold_out is None else choose_held_out(own.curves, hold_out, modes, own.mode)
    seen = [each for each in own.curves if each is not left]
    of_curves = fit_curves(seen, **place, **orders, settings=chosen)
    records_law = levels.records_law if levels else None
    joint_law, warnings = _join_laws(of_curves, levels, orders, chosen)
    by = records_law or of_curves.law
    is_prediction = records_law is not None
    fits = tuple(
        make_curve(by, curve, **place, is_prediction=is_prediction) if by else CurveFit.without_law(curve)
        for curve in seen
    )
    held_out = None
    if left is not None and (law := joint_law or by) is not None:
        say("the curve that is held out")
        held_out = predict_held_out(left, seen, law, **place, **orders, settings=chosen)
        warnings += [*_warn_of_held_out(held_out, chosen)]
    if records_law is not None:
        warnings += [*warn_of_extrapolation(records_law, seen, **place)]
    return _Curves(of_curves, joint_law, fits, held_out, (*_warn_of_curves(of_curves, chosen), *warnings))


def _join_laws(
    of_curves: CurvesLaw, levels: _Levels | None, orders: dict[str, Any], chosen: ResonanceSettings
) -> tuple[ResonanceLaw | None, list[str]]:
    """Return the law of levels and curves together, None without both, and a warning where they disagree."""
    if levels is None or levels.records_law is None or of_curves.law is None:
        return None, []
    if not _agree(levels.records_law, of_curves.law, chosen):
        return None, [
            "the law by the response curves contradicts that by the levels, so they are not fitted together: "
            "check the units of the curves, and whether the structure was the same"
        ]
    states = [*levels.states, *levels.moving, *of_curves.states]
    return fit_states(states, chosen, **orders, systematic=levels.outside), []


def _warn_of_held_out(found: HeldOut, settings: ResonanceSettings) -> Iterator[str]:
    name = found.fit.curve.name
    if found.reason:
        yield f"{name!r} is not predicted: {found.reason}"
    elif found.resonance_hz.interval95 is None:
        yield (
            f"the resonance of {name!r} is told without an interval: many of the laws that the other curves allow have "
            "none there; record levels between them"
        )
    elif found.widened > settings.disbelief:
        yield (
            f"the same prediction of {found.fitted[-1]!r} from the curves below it was off by {found.widened:.1f} "
            f"standard deviations, so the intervals of {name!r} are widened by this factor: the powers do not go on as "
            "the lower levels show them"
        )


@dataclass(frozen=True, eq=False)
class _Levels:
    """What the logs of levels give, with fields as in `Resonance`."""

    appropriation: Appropriation
    states: tuple[SteadyState, ...]
    moving: tuple[SteadyState, ...]  # the motions of the transients that count
    names: tuple[str, ...]
    start_s: tuple[float, ...]
    stop_s: tuple[float, ...]
    left_out: tuple[str, ...]
    outside: float
    backbone_law: ResonanceLaw | None
    records_law: ResonanceLaw | None
    reason: str
    interaction: Interaction | None
    warnings: tuple[str, ...]


def _identify_levels(
    tests: Sequence[ModalTest], number: int, orders: dict[str, Any], chosen: ResonanceSettings, say: Say
) -> _Levels:
    found: list[tuple[ModalTest, MeasuredLevel]] = []
    for test in tests:
        say(f"levels of {test.name}")
        found += [(test, each) for each in measure_levels(test, number, chosen)]
    steady = [(test, each) for test, each in found if each.is_steady]
    kept = [(test, each) for test, each in steady if not each.fault]
    left_out = tuple(
        f"the level of {test.name!r} from {each.start_s:.3g} to {each.stop_s:.3g} s is left out: {each.fault}"
        for test, each in steady
        if each.fault
    ) + tuple(filter(None, (_name_unsettled(test, number, found, chosen) for test in tests)))
    _require_levels(tests, number, [each for _, each in kept], left_out)
    appropriation = _gather_levels(tests, number, kept)
    states = tuple(each.state for _, each in kept)
    outside = float(np.median([each.outside for each in states]))
    say("the law")
    moving = _choose_transients([each for _, each in found], chosen)
    # Levels at quadrature alone do not show the phase of the force.
    trusted = chosen if moving else replace(chosen, phase_tolerance_deg=chosen.unseen_phase_deg)
    reason = ""
    laws: list[ResonanceLaw] = []
    try:
        by_records = fit_states([*states, *moving], trusted, **orders, systematic=outside)
        seen = by_records.force_phase_deg
        laws = [
            fit_states(states, trusted, **orders, measured_waves=False, systematic=outside, known_phase_deg=seen),
            by_records,
        ]
    except NotDeterminedError as error:
        reason = str(error)
    if laws and outside > MODAL.most_outside:
        laws = []
        reason = (
            f"{outside:.0%} of the motion at the sensors has none of the shapes: check the order, signs and units of "
            "the sensors, and whether a mode is missing"
        )
    if laws and moving and (reason := _find_wrong_mass([*states, *moving], laws[1], number, chosen)):
        laws = []
    if laws and (reason := next(filter(None, (explain_phase(law, chosen) for law in laws)), "")):
        laws = []
    backbone_law, records_law = laws if laws else (None, None)
    interaction = _check_interaction(appropriation)
    return _Levels(
        appropriation=appropriation,
        states=states,
        moving=tuple(moving),
        names=tuple(test.name for test, _ in kept),
        start_s=tuple(each.start_s for _, each in kept),
        stop_s=tuple(each.stop_s for _, each in kept),
        left_out=left_out,
        outside=outside,
        backbone_law=backbone_law,
        records_law=records_law,
        reason=reason,
        interaction=interaction,
        warnings=tuple(_list_warnings(kept, left_out, outside, records_law, interaction, chosen)),
    )


def _name_unsettled(
    test: ModalTest, mode: int, found: Sequence[tuple[ModalTest, MeasuredLevel]], settings: ResonanceSettings
) -> str:
    """Return that the force goes on after the last steady level of a log, as in a level that never settles, or ""."""
    stops = [each.stop_s for own, each in found if own is test and each.is_steady]
    assert test.force is not None
    if not stops:
        return ""
    period_s = 1.0 / float(test.modes.frequency_hz[test.modes.index(mode)])
    # The last steady stretch may end within a frame of the next step of the voltage.
    begin_s, end_s = stops[-1] + settings.frame_periods * period_s, test.force.size / test.fs
    if end_s - begin_s < settings.window_periods * period_s:
        return ""
    n = round(settings.window_periods * period_s * test.fs)
    at_stop = round(stops[-1] * test.fs)
    if np.std(test.force[-n:]) < settings.still_driven * np.std(test.force[max(at_stop - n, 0) : at_stop]):
        return ""
    return (
        f"the level of {test.name!r} from {begin_s:.3g} s to the end at {end_s:.3g} s is left out: its amplitude or "
        "frequency drifts throughout; hold it longer"
    )


def _find_wrong_mass(states: Sequence[SteadyState], law: ResonanceLaw, mode: int, settings: ResonanceSettings) -> str:
    """Return why levels and transients give no law although their motions do: a modal mass of another unit.

    The transients are not free enough of other motion for more than that.
    """
    least, largest = find_inertia_range(states, law)
    low, high = MODAL.mass_range
    bounds = float(least.value or 0.0), float(largest.value or np.inf)
    is_less = bounds[1] + settings.hidden_sigma * float(largest.std or 0.0) < low
    is_more = bounds[0] - settings.hidden_sigma * float(least.std or 0.0) > high
    if not is_less and not is_more:
        return ""
    inertia = float(np.sqrt(bounds[0] * bounds[1])) if 0.0 < bounds[0] < bounds[1] < np.inf else bounds[0]
    return describe_wrong_mass(inertia, "the levels and the transients between them show", mode, settings)


def _agree(one: ResonanceLaw, other: ResonanceLaw, settings: ResonanceSettings) -> bool:
    """Return whether two laws have one frequency and damping where both were fitted, and one phase of the force."""
    low = max(one.amplitude[0], other.amplitude[0])
    high = min(one.amplitude[-1], other.amplitude[-1])
    at = np.linspace(low, high, settings.n_curve) if high > low else np.zeros(0)
    far = [
        np.abs(np.interp(at, one.amplitude, mine) - np.interp(at, other.amplitude, theirs))
        / np.hypot(np.interp(at, one.amplitude, my_std), np.interp(at, other.amplitude, their_std))
        for mine, my_std, theirs, their_std in (
            (one.frequency_hz, one.frequency_std_hz, other.frequency_hz, other.frequency_std_hz),
            (one.damping_ratio, one.damping_std, other.damping_ratio, other.damping_std),
        )
    ]
    mine, theirs = one.force_phase_deg, other.force_phase_deg
    turned = abs((mine.value or 0.0) - (theirs.value or 0.0)) / np.hypot(mine.std or 0.0, theirs.std or 0.0)
    return bool(max(turned, *(float(each.max(initial=0.0)) for each in far)) < settings.hidden_sigma)


def _choose_transients(found: Sequence[MeasuredLevel], settings: ResonanceSettings) -> list[SteadyState]:
    """Return the motions of the transients that stand out from the noise, below the amplitude at which sensors clip."""
    limit = min((each.state.amplitude for each in found if each.is_clipped), default=np.inf)
    return [
        each.state
        for each in found
        if not each.is_steady
        and max(each.state.force_error, each.state.motion_error) * settings.least_signal < 1.0
        and (limit == np.inf or each.state.amplitude < settings.below_clipping * limit)
    ]


def _require_levels(
    tests: Sequence[ModalTest], mode: int, kept: Sequence[MeasuredLevel], left_out: Sequence[str]
) -> None:
    if not kept:
        why = left_out[0] if left_out else "amplitude and frequency drift throughout"
        raise InputError(
            f"no level of mode {mode} in {', '.join(repr(test.name) for test in tests)} counts: {why}; hold each level "
            "until the amplitude stands still, some 40 periods and more"
        )
    damping = np.array([each.state.damping for each in kept])
    if np.median(damping) < 0.0:
        raise InputError(
            f"at {int(np.sum(damping < 0.0))} of {damping.size} levels the force takes power out of mode {mode}: "
            "force and accelerations have opposite signs, or the force acts elsewhere than the study says; give "
            "sign = -1 for the force, or for all accelerations, in [channels], or another drive_point"
        )


def _gather_levels(
    tests: Sequence[ModalTest], mode: int, kept: Sequence[tuple[ModalTest, MeasuredLevel]]
) -> Appropriation:
    sensors = {test.sensors for test, _ in kept}
    if len(sensors) > 1:
        raise InputError("the tests have different sensors: give logs with the same sensors, or one study for each set")
    test = tests[0]
    assert test.drive_point is not None
    levels = tuple(each.level for _, each in kept)
    hz = [each.frequency_hz for each in levels]
    noise = float(np.median([each.unsteadiness for each in levels]))
    modes = with_sensors(test.modes, test.sensors)
    return Appropriation(mode, modes, test.drive_point, levels, (min(hz), max(hz)), None, noise)


def _check_interaction(appropriation: Appropriation) -> Interaction | None:
    modes = appropriation.modes
    others = modes.elastic.copy()
    others[modes.index(appropriation.mode)] = False
    if not others.any() or appropriation.drive_point not in modes.sensors:
        return None
    return modal_interaction(appropriation)


def _list_warnings(
    kept: Sequence[tuple[ModalTest, MeasuredLevel]],
    left_out: Sequence[str],
    outside: float,
    law: ResonanceLaw | None,
    interaction: Interaction | None,
    settings: ResonanceSettings,
) -> Iterator[str]:
    # The loop holds the drive point, which other modes move, too: that the mode itself is off is no fault of the loop.
    errors = np.abs([each.level.phase_error_deg for _, each in kept])
    n_off = int(np.sum(errors > settings.quadrature_deg))
    if n_off:
        of_mode = max(abs(each.state.phase_error_deg) for _, each in kept)
        yield (
            f"at {n_off} of {errors.size} levels the loop missed quadrature at the drive point, by up to "
            f"{errors.max():.1f} degrees (the mode by up to {of_mode:.1f}): frequency and damping are corrected by the "
            "force in phase"
        )
    if outside > settings.warned_outside:
        yield (
            f"{outside:.1%} of the motion at the sensors has none of the shapes (median of the levels): another mode "
            "is near, a sensor has another gain, or the shapes are not those of this structure; the intervals allow "
            "for a gain and a phase of this size"
        )
    yield from left_out[: settings.most_named]
    if len(left_out) > settings.most_named:
        yield f"{len(left_out) - settings.most_named} more levels are left out"
    if interaction is not None and interaction.flagged:
        yield f"{interaction.statement} The law of one mode does not hold where modes interact"
    if law is None:
        return
    if law.n_states == len(kept):
        yield (
            "levels at quadrature alone do not show a phase between force and accelerations: the intervals assume a "
            f"standard deviation of {settings.unseen_phase_deg:g} degrees; keep the transients between the levels "
            "in the logs"
        )
    yield from _warn_of_law(law, "transients", settings)


def _warn_of_curves(found: CurvesLaw, settings: ResonanceSettings) -> Iterator[str]:
    if found.reason:
        yield f"the response curves give no law: {found.reason}"
    if found.law is not None:
        yield from _warn_of_law(found.law, "response curves", settings)


def _warn_of_law(law: ResonanceLaw, source: str, settings: ResonanceSettings) -> Iterator[str]:
    phase = law.force_phase_deg
    if abs(phase.value or 0.0) > max(settings.warned_phase_deg, settings.hidden_sigma * (phase.std or 0.0)):
        yield (
            f"the {source} show that the force is {phase.value:.1f} degrees ahead of what moves the mode (standard "
            f"deviation {phase.std:.1g}): the law is corrected for it, and the single levels are not; check delay and "
            "filters of the force channel"
        )
    if not reaches_zero(law.amplitude):
        yield (
            f"the {source} do not reach below {law.amplitude[0] / law.amplitude[-1]:.0%} of their largest amplitude: "
            "k0 and c0 are extrapolated by powers, which a joint does not follow, and have no intervals; record lower "
            "levels, and use the law within these amplitudes only"
        )
    if law.is_withheld:
        yield (
            f"the law by the {source} extrapolates to a negative stiffness or damping at zero amplitude, which no "
            "structure at rest has, and no interval is given for it: record lower levels, and use the law within these "
            "amplitudes only"
        )
    if law.misfit > settings.warned_misfit:
        of_coefficients = ", and its coefficients have none" if law.stiffness[1].interval95 is None else ""
        yield (
            f"the law by the {source} misses them by {law.misfit:.1f} standard deviations of their noise: powers of "
            f"one mode do not describe it; the intervals are widened by this factor{of_coefficients}"
        )
