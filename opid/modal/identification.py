"""From a modal study to the nonlinear modal model (Pacini Fig. 4), with what it rests on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError
from opid.modal.doubts import doubts_of_modes, doubts_of_truth_tests, nothing_nonlinear
from opid.modal.free_decay import Decay
from opid.modal.level_shifts import LevelShift, level_shifts, nonlinear_modes
from opid.modal.mode_fit import fit_mode
from opid.modal.mode_tests import tests_of_mode
from opid.modal.model import NonlinearModalModel
from opid.modal.modes import LinearModes, condition_number, modal_assurance
from opid.modal.result import ModalIdentification, ModeFit, TruthTest
from opid.modal.study import ModalStudy
from opid.modal.truth_test import truth_test
from opid.signals.tables import refuse

Say = Callable[[str], None]


def identify_modes(study: ModalStudy, *, progress: Say | None = None) -> ModalIdentification:
    """Identify the nonlinear modal model of a structure and try it on the truth tests.

    Each nonlinear mode is fitted by itself to the tests that move it, in its band (`fit_coefficients`); free decays
    give the law of a mode that no forced test moves. The modes together, with their laws, are the model.

    Args:
        study: linear modes, which are nonlinear, and the tests.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: shapes that cannot filter modes, or tests that cannot be used; everything is said at once.
        NotDeterminedError: no mode is named as nonlinear and the level tests show none.
    """
    say = progress or (lambda step: None)
    shifts = _shifts(study, say)
    nonlinear = study.nonlinear or nonlinear_modes(shifts)
    if not nonlinear:
        raise NotDeterminedError(nothing_nonlinear(shifts))
    study = replace(study, nonlinear=nonlinear)
    decays, of_decays, doubts = _decays(study, say)
    fits, faults = [], []
    for mode in nonlinear:
        say(f"mode {mode}")
        tests = tests_of_mode(study.of_use("fit"), mode, nonlinear)
        if not tests and mode in of_decays:
            continue
        try:
            fits.append(fit_mode(tests, mode, **_settings(study)))
        except InputError as error:
            faults.append(f"mode {mode}: {error}")
    refuse(faults, study.source)
    model = _model(study.modes, fits, of_decays)
    truth_tests, unstable = _truth_tests(study, fits, of_decays, say)
    return ModalIdentification(
        title=study.title,
        modes=study.modes,
        drive_point=study.drive_point,
        tests=tuple(each.test for each in study.tests),
        fits=tuple(fits),
        model=model,
        truth_tests=truth_tests,
        decays=decays,
        shifts=shifts,
        condition_number=condition_number(study.modes),
        auto_mac=modal_assurance(study.modes.shapes),
        warnings=(*doubts_of_modes(study.modes), *doubts, *doubts_of_truth_tests(study, fits), *unstable),
        not_determined="",
        settings=_settings(study) | {"nonlinear": list(nonlinear), "study": str(study.source or "")},
    )


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
    return level_shifts(tests)


def _decays(study: ModalStudy, say: Say) -> tuple[tuple[Decay, ...], Mapping[int, Decay], list[str]]:
    return (), {}, []


def _model(modes: LinearModes, fits: Sequence[ModeFit], of_decays: Mapping[int, Decay]) -> NonlinearModalModel:
    """The modes with their laws; corrections of k0 and c0 move frequency and damping of the mode."""
    frequency, damping = modes.frequency_hz.copy(), modes.damping_ratio.copy()
    laws = {fit.mode: fit.law for fit in fits}
    for fit in fits:
        k1, c1 = (float(each[1].value or 0.0) if 1 in each else 0.0 for each in (fit.stiffness, fit.damping))
        place = fit.mode - 1
        if not k1 and not c1:
            continue
        stiffness = modes.stiffness()[place] + k1
        omega = np.sqrt(max(stiffness, 0.0))
        frequency[place] = omega / (2 * np.pi)
        damping[place] = (modes.damping()[place] + c1) / (2 * omega)
    return NonlinearModalModel(replace(modes, frequency_hz=frequency, damping_ratio=damping), laws)


def _truth_tests(
    study: ModalStudy, fits: Sequence[ModeFit], of_decays: Mapping[int, Decay], say: Say
) -> tuple[tuple[TruthTest, ...], list[str]]:
    done, unstable = [], []
    for each in study.of_use("truth"):
        say(f"truth test {each.test.name}")
        try:
            done.append(truth_test(_model(each.test.modes, fits, of_decays), each.test))
        except InputError as error:
            unstable.append(str(error))
    return tuple(done), unstable
