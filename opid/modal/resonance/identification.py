"""From measured tests at phase resonance to the backbone of a mode, its interaction with others, and its law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.modal.forced.mode_tests import find_largest_mode
from opid.modal.linear.modes import ModalTest, with_sensors
from opid.modal.resonance.appropriation import Appropriation, Interaction, modal_interaction
from opid.modal.resonance.law import ResonanceLaw, fit_states
from opid.modal.resonance.result import Resonance
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import MeasuredLevel, SteadyState, measure_levels
from opid.modal.study import ModalStudy
from opid.progress import Say


def identify_resonance(
    study: ModalStudy,
    *,
    mode: int | None = None,
    settings: ResonanceSettings | None = None,
    progress: Say | None = None,
) -> Resonance:
    """Identify one mode from tests at phase resonance, of one level each or of several.

    In each log the steady levels are found, and every level gives stiffness and damping of the mode at its amplitude,
    also where its phase is not at quadrature. The law follows from the levels as a backbone, and from the steady
    records with their measured harmonics and the transients between them.

    Args:
        study: linear modes, and tests with the use "resonance".
        mode: number of the mode, from 1; where None, that of the tests.
        settings: where a level is steady and which levels count; the usual ones where left out.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: no such test, tests of several modes, no steady level that counts, or a force of wrong polarity.
    """
    if not isinstance(study, ModalStudy):
        raise InputError(f"study is of type {type(study).__name__}: give a ModalStudy, as read_study makes one")
    chosen, say = settings or ResonanceSettings(), progress or (lambda step: None)
    tests, number = _choose_tests(study, mode)
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
    orders: dict[str, Any] = {"stiffness_order": study.stiffness_order, "damping_order": study.damping_order}
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
    backbone_law, records_law = laws if laws else (None, None)
    interaction = _check_interaction(appropriation)
    return Resonance(
        title=study.title,
        mode=number,
        modes=study.modes,
        drive_point=appropriation.drive_point,
        appropriation=appropriation,
        states=states,
        level_tests=tuple(test.name for test, _ in kept),
        level_start_s=np.array([each.start_s for _, each in kept]),
        level_stop_s=np.array([each.stop_s for _, each in kept]),
        left_out=left_out,
        backbone_law=backbone_law,
        records_law=records_law,
        interaction=interaction,
        warnings=tuple(_list_warnings(kept, left_out, outside, records_law, interaction, chosen)),
        not_determined=reason,
        settings={**orders, "mode": mode, "study": str(study.source or "")},
        read_files=tuple(dict.fromkeys(file for test in tests for file in test.recording.files)),
    )


def _choose_tests(study: ModalStudy, mode: int | None) -> tuple[list[ModalTest], int]:
    given = study.of_use("resonance")
    if not given:
        raise InputError('no test has use = "resonance": give it to the logs of force appropriation')
    elastic = [int(each) + 1 for each in np.flatnonzero(study.modes.elastic)]
    of_mode = [each.mode or find_largest_mode(each.test, study.nonlinear or elastic) for each in given]
    if mode is not None:
        study.modes.index(mode)
    number = of_mode[0] if mode is None else mode
    if mode is None and len({*of_mode}) > 1:
        listed = ", ".join(str(each) for each in sorted({*of_mode}))
        raise InputError(f"the tests hold the modes {listed}: choose one with mode, like {of_mode[0]}")
    tests = [each.test for each, held in zip(given, of_mode, strict=True) if held == number]
    if not tests:
        raise InputError(f"no test holds mode {number}: they hold {', '.join(map(str, sorted({*of_mode})))}")
    return tests, number


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
            "is near, or the shapes are not those of this structure; the intervals hold an error of this size"
        )
    yield from left_out[: settings.most_named]
    if len(left_out) > settings.most_named:
        yield f"{len(left_out) - settings.most_named} more levels are left out"
    if interaction is not None and interaction.flagged:
        yield f"{interaction.statement} The law of one mode does not hold where modes interact"
    if law is None:
        return
    phase = law.force_phase_deg
    if law.n_states == len(kept):
        yield (
            "levels at quadrature alone do not show a phase between force and accelerations: the intervals assume a "
            f"standard deviation of {settings.unseen_phase_deg:g} degrees; keep the transients between the levels "
            "in the logs"
        )
    if abs(phase.value or 0.0) > max(settings.warned_phase_deg, settings.hidden_sigma * (phase.std or 0.0)):
        yield (
            f"the transients show that the force is {phase.value:.1f} degrees ahead of what moves the mode (standard "
            f"deviation {phase.std:.1g}): the law is corrected for it; check delay and filters of the force channel"
        )
    if law.misfit > settings.warned_misfit:
        yield (
            f"the law misses the records by {law.misfit:.1f} standard deviations of their noise: powers of one mode do "
            "not describe it; the intervals are widened by this factor"
        )
