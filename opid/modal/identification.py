"""From a modal study to the nonlinear modal model (Pacini Fig. 4), with what it rests on."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError, refuse
from opid.estimate import Estimate
from opid.modal.decay.fit import DecayLaw
from opid.modal.decay.free_decay import Decay, decay_of, law_of_decays
from opid.modal.doubts import (
    doubts_of_modes,
    doubts_of_other_shifts,
    doubts_of_records,
    doubts_of_truth_tests,
    nothing_nonlinear,
    require_modes,
)
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.mode_tests import largest_mode, tests_beside, tests_of_mode
from opid.modal.linear.level_shifts import LevelShift, level_shifts, nonlinear_modes
from opid.modal.linear.modes import LinearModes, condition_number, modal_assurance
from opid.modal.model import NonlinearModalModel
from opid.modal.result import ModalIdentification, ModeFit, TruthTest
from opid.modal.study import THRESHOLDS, ModalStudy
from opid.modal.truth_tests import truth_test

logger = logging.getLogger(__name__)

Say = Callable[[str], None]


@dataclass(frozen=True)
class _DecayDoubt:
    """What to doubt of the free decays of a mode, or why they give nothing."""

    mode: int
    sentence: str


def identify_modes(study: ModalStudy, *, progress: Say | None = None) -> ModalIdentification:
    """Identify the nonlinear modal model of a structure and try it on the truth tests.

    Each nonlinear mode is fitted by itself to the tests that move it, in its band (`fit_coefficients`); free decays
    give the law of a mode that no forced test moves. The modes together, with their laws, are the model.

    Args:
        study: linear modes, which are nonlinear, and the tests.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: shapes that cannot filter modes, or tests that cannot be used; everything is said at once.
        NotDeterminedError: no mode is named as nonlinear and there are no levels to compare. Where levels were compared
            the result has them, and says in `not_determined` why there is no law.
    """
    if not isinstance(study, ModalStudy):
        raise InputError(f"study is of type {type(study).__name__}: give a ModalStudy, as read_study makes one")
    say = progress or (lambda step: None)
    require_modes(study.modes)
    shifts = _shifts(study, say)
    nonlinear = study.nonlinear or tuple(sorted({*nonlinear_modes(shifts), *_named(study)}))
    if not nonlinear and not shifts:
        raise NotDeterminedError(nothing_nonlinear(shifts))
    study = replace(study, nonlinear=nonlinear)
    decays, of_decays, doubts = _decays(study, say)
    fits, more = _fits(study, of_decays, doubts, say)
    say("the records")
    of_records = list(doubts_of_records(study))
    truth_tests, unstable = _truth_tests(study, fits, of_decays, say)
    return ModalIdentification(
        title=study.title,
        modes=study.modes,
        drive_point=study.drive_point,
        tests=tuple(each.test for each in study.tests),
        fits=fits,
        model=model_of(study.modes, fits, of_decays),
        truth_tests=truth_tests,
        decays=decays,
        shifts=shifts,
        condition_number=condition_number(study.modes),
        auto_mac=modal_assurance(study.modes.shapes),
        warnings=(
            *of_records,
            *doubts_of_modes(study.modes),
            *doubts_of_other_shifts(shifts, nonlinear),
            *(doubt.sentence for doubt in doubts),
            *more,
            *doubts_of_truth_tests(study, fits, of_decays, truth_tests),
            *unstable,
        ),
        not_determined=_not_determined(study, shifts),
        settings=_settings(study)
        | {name: getattr(study, name) for name in THRESHOLDS}
        | {"nonlinear": list(nonlinear), "study": str(study.source or "")},
        decay_laws=of_decays,
    )


def _named(study: ModalStudy) -> set[int]:
    """Modes that tests are said to be for."""
    return {each.mode for each in study.of_use("fit", "decay") if each.mode is not None}


def _not_determined(study: ModalStudy, shifts: Sequence[LevelShift]) -> str:
    """Why there is no law at all: nothing to fit, or nothing that shifts."""
    if study.nonlinear and study.of_use("fit", "decay"):
        return ""
    if not study.nonlinear:
        return nothing_nonlinear(shifts)
    modes = ", ".join(str(mode) for mode in study.nonlinear)
    return f'no test has use = "fit" or "decay", which mode(s) {modes} need: give sine beats or free decays'


def _fits(
    study: ModalStudy, of_decays: Mapping[int, DecayLaw], of_failed: Sequence[_DecayDoubt], say: Say
) -> tuple[tuple[ModeFit, ...], list[str]]:
    """The fits of the modes that forced tests move, and what to doubt about the choice of tests."""
    fits, faults, doubts = [], [], []
    given = study.of_use("fit")
    for mode in study.nonlinear if study.of_use("fit", "decay") else ():
        say(f"mode {mode}")
        tests = tests_of_mode(given, mode, study.nonlinear)
        if not tests and mode in of_decays:
            continue
        if not tests and (tests := tests_beside(given, mode)):
            names = ", ".join(repr(test.name) for test in tests)
            doubts.append(f"mode {mode} has no test of its own and is fitted to those of other modes ({names})")
        try:
            fits.append(fit := fit_mode(tests, mode, **_settings(study)))
            told = "mode %d: orders %d and %d, %.3g of the modal force is left on %d lines"
            logger.info(told, mode, fit.stiffness_order, fit.damping_order, fit.residual_share, fit.n_lines)
        except InputError as error:
            failed = "; ".join(doubt.sentence for doubt in of_failed if doubt.mode == mode)
            faults.append(f"mode {mode}: {error}" + (f" ({failed})" if failed else ""))
    refuse(faults, study.source)
    doubts += [
        f"mode {fit.mode} has corrections of frequency and damping that were found with other linear properties than "
        "those of the study: the model keeps the study's"
        for fit in fits
        if (1 in fit.stiffness or 1 in fit.damping) and not corrects(fit, study.modes)
    ]
    return tuple(fits), doubts


def _settings(study: ModalStudy) -> dict[str, Any]:
    return {
        "stiffness_order": study.stiffness_order,
        "damping_order": study.damping_order,
        "free_linear": study.free_linear,
    }


def _shifts(study: ModalStudy, say: Say) -> tuple[LevelShift, ...]:
    tests = [each.test for each in study.of_use("level")]
    if len(tests) < 2:
        return ()
    say("levels")
    return level_shifts(tests, frequency_threshold=study.frequency_threshold, damping_threshold=study.damping_threshold)


def _decays(study: ModalStudy, say: Say) -> tuple[tuple[Decay, ...], dict[int, DecayLaw], list[_DecayDoubt]]:
    """Free decays of the nonlinear modes, the law that each mode's decays give together, and what failed."""
    decays: list[Decay] = []
    doubts: list[_DecayDoubt] = []
    for each in study.of_use("decay") if study.nonlinear else ():
        mode = each.mode or largest_mode(each.test, study.nonlinear)
        say(f"free decay {each.test.name}")
        try:
            decays.append(
                decay_of(each.test, mode, stiffness_order=study.stiffness_order, damping_order=study.damping_order)
            )
        except NotDeterminedError as error:
            doubts.append(_DecayDoubt(mode, f"free decay {each.test.name!r} of mode {mode}: {error}"))
    laws = {}
    for mode in study.nonlinear:
        own = [decay for decay in decays if decay.mode == mode]
        doubts += [
            _DecayDoubt(mode, f"free decay {decay.name!r} of mode {mode}: {doubt}")
            for decay in own
            for doubt in decay.warnings
        ]
        if own:
            try:
                laws[mode] = law_of_decays(
                    own, stiffness_order=study.stiffness_order, damping_order=study.damping_order
                )
            except NotDeterminedError as error:
                doubts.append(_DecayDoubt(mode, f"the free decays of mode {mode} give no law: {error}"))
                continue
            doubts += [
                _DecayDoubt(mode, f"the free decays of mode {mode} together: {doubt}") for doubt in laws[mode].warnings
            ]
    return tuple(decays), laws, doubts


def model_of(
    modes: LinearModes, fits: Sequence[ModeFit], of_decays: Mapping[int, DecayLaw] | None = None
) -> NonlinearModalModel:
    """Return the modes with their laws; corrections of k0 and c0 move frequency and damping of the mode they belong to.

    A correction found with other linear properties (tests may have modes of their own) is left aside.

    Args:
        modes: all modes, linear.
        fits: of those that forced tests move.
        of_decays: laws of those that only free decays show, by the number of the mode.
    """
    free = of_decays or {}
    stiffness, damping = modes.stiffness(), modes.damping()
    laws = {fit.mode: fit.law for fit in fits}
    for fit in fits:
        if corrects(fit, modes):
            stiffness[fit.mode - 1] += _first(fit.stiffness)
            damping[fit.mode - 1] += _first(fit.damping)
    for mode in free.keys() - laws.keys():
        laws[mode] = free[mode].law
        stiffness[mode - 1], damping[mode - 1] = _first(free[mode].stiffness), _first(free[mode].damping)
    omega = np.sqrt(np.maximum(stiffness, 0.0))
    ratio = np.where(omega > 0, damping / np.maximum(2 * omega, np.finfo(float).tiny), modes.damping_ratio)
    return NonlinearModalModel(replace(modes, frequency_hz=omega / (2 * np.pi), damping_ratio=ratio), laws)


def corrects(fit: ModeFit, modes: LinearModes) -> bool:
    """Whether the corrections of a fit belong to the linear properties that these modes have.

    Args:
        fit: of one mode.
        modes: all modes.
    """
    place = fit.mode - 1
    given = (modes.frequency_hz[place], modes.damping_ratio[place])
    return bool(np.allclose(given, (fit.frequency_hz, fit.damping_ratio), rtol=1e-9, atol=0.0))


def _first(coefficients: Mapping[int, Estimate]) -> float:
    """The coefficient of the power 1, 0 where it was not fitted."""
    return float(coefficients[1].value or 0.0) if 1 in coefficients else 0.0


def _truth_tests(
    study: ModalStudy, fits: Sequence[ModeFit], of_decays: Mapping[int, DecayLaw], say: Say
) -> tuple[tuple[TruthTest, ...], list[str]]:
    done, unstable = [], []
    for each in study.of_use("truth"):
        say(f"truth test {each.test.name}")
        try:
            done.append(truth_test(model_of(each.test.modes, fits, of_decays), each.test))
        except InputError as error:
            unstable.append(str(error))
    return tuple(done), unstable
