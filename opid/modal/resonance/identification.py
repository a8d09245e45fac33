"""From tests at phase resonance and response curves to backbone and law of a mode, and its interaction with others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.modal.forced.mode_tests import find_largest_mode
from opid.modal.linear.modes import ModalTest, with_sensors
from opid.modal.resonance.appropriation import Appropriation, Interaction, modal_interaction
from opid.modal.resonance.curve_fit import CurveFit, CurvesLaw, describe_wrong_mass, fit_curves, make_curve
from opid.modal.resonance.curves import ResponseCurve, find_curve_mode
from opid.modal.resonance.law import ResonanceLaw, check_states, fit_states
from opid.modal.resonance.result import Resonance
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import MeasuredLevel, SteadyState, measure_levels
from opid.modal.settings import MODAL
from opid.modal.study import ModalStudy
from opid.progress import Say


def identify_resonance(
    study: ModalStudy,
    *,
    mode: int | None = None,
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
        settings: where a level is steady and which levels and points count; the usual ones where left out.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: neither such a test nor a curve, tests of several modes, no steady level that counts, or a force of
            wrong polarity.
    """
    if not isinstance(study, ModalStudy):
        raise InputError(f"study is of type {type(study).__name__}: give a ModalStudy, as read_study makes one")
    chosen, say = settings or ResonanceSettings(), progress or (lambda step: None)
    tests, curves, number = _choose_measurements(study, mode)
    orders: dict[str, Any] = {"stiffness_order": study.stiffness_order, "damping_order": study.damping_order}
    levels = _identify_levels(tests, number, orders, chosen, say) if tests else None
    records_law = levels.records_law if levels else None
    of_curves = None
    fits: tuple[CurveFit, ...] = ()
    joint_law, warnings = None, list(levels.warnings if levels else ())
    if curves:
        say("the response curves")
        assert study.drive_point is not None  # A study with curves has one.
        place: dict[str, Any] = {"modes": study.modes, "mode": number, "drive_point": study.drive_point}
        of_curves = fit_curves(curves, **place, **orders, settings=chosen)
        warnings += _warn_of_curves(of_curves, chosen)
        if of_curves.law is not None and records_law is not None and levels is not None:
            if _agree(records_law, of_curves.law, chosen):
                states = [*levels.states, *levels.moving, *of_curves.states]
                joint_law = fit_states(states, chosen, **orders, systematic=levels.outside)
            else:
                warnings.append(
                    "the law by the response curves contradicts that by the levels, so they are not fitted together: "
                    "check the units of the curves, and whether the structure was the same"
                )
        by = records_law or of_curves.law
        is_prediction = records_law is not None
        fits = tuple(
            make_curve(by, curve, **place, is_prediction=is_prediction) if by else CurveFit.without_law(curve)
            for curve in curves
        )
    reasons = (levels.reason if levels else "", of_curves.reason if of_curves else "")
    has_law = records_law is not None or (of_curves is not None and of_curves.law is not None)
    return Resonance(
        title=study.title,
        mode=number,
        modes=study.modes,
        drive_point=study.drive_point or tests[0].drive_point or "",
        appropriation=levels.appropriation if levels else None,
        states=levels.states if levels else (),
        level_tests=levels.names if levels else (),
        level_start_s=np.array(levels.start_s if levels else ()),
        level_stop_s=np.array(levels.stop_s if levels else ()),
        left_out=levels.left_out if levels else (),
        backbone_law=levels.backbone_law if levels else None,
        records_law=records_law,
        curves_law=of_curves.law if of_curves else None,
        joint_law=joint_law,
        curve_states=of_curves.states if of_curves else (),
        curve_fits=fits,
        curve_check=of_curves.check if of_curves else None,
        interaction=levels.interaction if levels else None,
        warnings=tuple(warnings),
        not_determined="" if has_law else "; ".join(filter(None, reasons)),
        settings={**orders, "mode": mode, "study": str(study.source or "")},
        read_files=tuple(
            dict.fromkeys(
                file
                for files in (*(test.recording.files for test in tests), *(curve.files for curve in curves))
                for file in files
            )
        ),
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
    )
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


def _find_wrong_mass(states: Sequence[SteadyState], law: ResonanceLaw, mode: int, settings: ResonanceSettings) -> str:
    """Return why levels and transients give no law although their motions do: a modal mass of another unit.

    The transients are not free enough of other motion for more than that.
    """
    found = check_states(states, np.zeros(len(states), dtype=np.complex128), law).inertia
    inertia, std = float(found.value or 0.0), settings.hidden_sigma * float(found.std or 0.0)
    low, high = MODAL.mass_range
    if low - std < inertia < high + std:
        return ""
    return describe_wrong_mass(inertia, "the levels and the transients between them show", mode, settings)


def _choose_measurements(study: ModalStudy, mode: int | None) -> tuple[list[ModalTest], list[ResponseCurve], int]:
    """Return the tests and the curves of one mode, and its number."""
    given = study.of_use("resonance")
    if not given and not study.curves:
        raise InputError(
            'no test has use = "resonance", and there are no [[curves]]: give the use to the logs of force '
            "appropriation, or name files of response curves"
        )
    candidates = study.nonlinear or [int(each) + 1 for each in np.flatnonzero(study.modes.elastic)]
    of_tests = [each.mode or find_largest_mode(each.test, candidates) for each in given]
    of_curves = [find_curve_mode(each, study.modes, candidates) for each in study.curves]
    held = [*of_tests, *of_curves]
    if mode is not None:
        study.modes.index(mode)
    number = held[0] if mode is None else mode
    if mode is None and len({*held}) > 1:
        listed = ", ".join(str(each) for each in sorted({*held}))
        raise InputError(f"the tests hold the modes {listed}: choose one with mode, like {held[0]}")
    tests = [each.test for each, own in zip(given, of_tests, strict=True) if own == number]
    curves = [each for each, own in zip(study.curves, of_curves, strict=True) if own == number]
    if not tests and not curves:
        raise InputError(f"no test holds mode {number}: they hold {', '.join(map(str, sorted({*held})))}")
    return tests, curves, number


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
            "force and accelerations have opposite signs; give sign = -1 for the force, or for all accelerations, in "
            "[channels]"
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
    errors = np.abs([each.state.phase_error_deg for _, each in kept])
    at_point = max(abs(each.level.phase_error_deg) for _, each in kept)
    n_off = int(np.sum(errors > settings.quadrature_deg))
    if n_off:
        yield (
            f"at {n_off} of {errors.size} levels the mode is off quadrature, by up to {errors.max():.1f} degrees (the "
            f"drive point by up to {at_point:.1f}): frequency and damping are corrected by the force in phase"
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
            f"deviation {phase.std:.1g}): the law is corrected for it; check delay and filters of the force channel"
        )
    if law.is_withheld:
        yield (
            f"the law by the {source} extrapolates to a negative stiffness or damping at zero amplitude, which no "
            "structure at rest has, and no interval is given for it: record lower levels, and use the law within these "
            "amplitudes only"
        )
    if law.misfit > settings.warned_misfit:
        yield (
            f"the law by the {source} misses them by {law.misfit:.1f} standard deviations of their noise: powers of "
            "one mode do not describe it; the intervals are widened by this factor"
        )
