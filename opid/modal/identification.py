"""From a modal study to the nonlinear modal model (Pacini Fig. 4) with its fits, truth tests and warnings."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from opid.errors import InputError, NotDeterminedError, refuse
from opid.mechanics.laws.law import LINEAR, Law, TermSet
from opid.mechanics.structure import modal_assurance
from opid.modal.couplings import Product, Reach, is_stable_beyond
from opid.modal.decay.free_decay import Decay, decay_of, law_of_decays
from opid.modal.decay.law import DecayLaw
from opid.modal.forced.equation import mode_lines
from opid.modal.forced.mode_fit import ModeFit, fit_mode
from opid.modal.forced.mode_tests import find_largest_mode, select_tests, select_tests_beside
from opid.modal.forced.system import correct_modes
from opid.modal.forced.system_fit import SystemFit, fit_system
from opid.modal.joint_terms import ModalJoint
from opid.modal.linear.level_shifts import LevelShift, level_shifts, nonlinear_modes
from opid.modal.linear.modes import LinearModes, condition_number, delay_forces, weighted_shapes, with_sensors
from opid.modal.linear.modes_file import looks_in_percent, looks_unit_normalised
from opid.modal.model import NonlinearModalModel, TruthTest, truth_test
from opid.modal.power_laws import hold_unstable, list_held, read_linear
from opid.modal.result import ModalIdentification
from opid.modal.settings import MODAL, SIMULATED
from opid.modal.study import THRESHOLDS, ModalStudy
from opid.progress import Say

logger = logging.getLogger(__name__)


def identify_modes(study: ModalStudy, *, progress: Say | None = None) -> ModalIdentification:
    """Identify the nonlinear modal model of a structure and try it on the truth tests.

    Each nonlinear mode is fitted by itself to the tests that move it, in its band (`fit_coefficients`). Free decays
    give the law of a mode that no forced test moves. The modes together, with their laws, are the model.

    Args:
        study: linear modes, the numbers of the nonlinear ones, and the tests.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: shapes that cannot filter modes, or tests that cannot be used; one error names all of them.
        NotDeterminedError: no mode is named as nonlinear and there are no levels to compare. Where levels were compared
            but show no law, the result holds the comparison, and its `not_determined` gives the reason.
    """
    if not isinstance(study, ModalStudy):
        raise InputError(f"study is of type {type(study).__name__}: give a ModalStudy, as read_study makes one")
    percent = looks_in_percent(study.modes)
    if percent:
        raise InputError(f"{percent}: give fractions of critical damping, 0.004 for 0.4 %")
    say = progress or (lambda step: None)
    shifts = _compare_levels(study, say)
    named = {each.mode for each in study.of_use("fit", "decay") if each.mode is not None}
    nonlinear = study.nonlinear or tuple(sorted({*nonlinear_modes(shifts), *named}))
    if not nonlinear and not shifts:
        raise NotDeterminedError(
            'no mode is named as nonlinear: name some (nonlinear = [7, 11]), or give two tests with use = "level"'
        )
    study = replace(study, nonlinear=nonlinear)
    decays, decay_laws, of_decays = _fit_decays(study, say)
    fits, of_fits = _fit_modes(study, decay_laws, of_decays, say)
    fits, systems, of_systems = _fit_systems(study, fits, say)
    modelled = {*nonlinear, *(mode for each in systems for mode in each.modes)}
    say("the records")
    of_records = list(warn_of_records(study))
    truth_tests, unstable = _run_truth_tests(study, fits, decay_laws, systems, say)
    model = make_model(study.modes, fits, decay_laws, systems)
    return ModalIdentification(
        title=study.title,
        modes=study.modes,
        drive_point=study.drive_point,
        tests=tuple(each.test for each in study.tests),
        fits=fits,
        model=model,
        truth_tests=truth_tests,
        decays=decays,
        shifts=shifts,
        condition_number=condition_number(study.modes),
        auto_mac=modal_assurance(weighted_shapes(study.modes)),
        warnings=(
            *of_records,
            *_warn_of_modes(study.modes),
            *(
                f"mode {shift.mode} shifts with the level and is modelled as linear: name it in nonlinear, or use "
                "the model only where this mode hardly moves"
                for shift in shifts
                if shift.nonlinear and shift.mode not in modelled
            ),
            *(sentence for _, sentence in of_decays),
            *of_fits,
            *of_systems,
            *_warn_of_amplitudes(study, fits, decay_laws, systems, model),
            *_warn_of_truth_tests(truth_tests),
            *unstable,
        ),
        not_determined=_explain_no_law(study, shifts),
        settings=_list_orders(study)
        | {name: getattr(study, name) for name in ("free_linear", "memory", "gain_tolerance", *THRESHOLDS)}
        | {"nonlinear": list(nonlinear), "study": str(study.source or "")},
        decay_laws=decay_laws,
        systems=systems,
    )


def make_model(
    modes: LinearModes,
    fits: Sequence[ModeFit],
    decay_laws: Mapping[int, DecayLaw] | None = None,
    systems: Sequence[SystemFit] = (),
) -> NonlinearModalModel:
    """Return the modes with their laws; corrections of k0 and c0 change the frequency and damping of their mode.

    A correction that was found with other linear properties is not used, for tests may have modes of their own.
    Modes that no forced test moves take their law from `decay_laws`, which are stored by the number of the mode.
    `systems` add the couplings of modes, and correct those that are driven. Powers that become unstable beyond the
    tests are held there (`hold_unstable`), and so are couplings (`is_stable_beyond`).
    """
    laws = {fit.mode: fit.law for fit in fits}
    corrections = {
        fit.mode: (read_linear(fit.stiffness), read_linear(fit.damping)) for fit in fits if _is_fitted_to(fit, modes)
    }
    for system in systems:
        if _is_fitted_to(system.fit, modes):
            corrections |= {
                mode: (read_linear(law.stiffness), read_linear(law.damping)) for mode, law in system.driven.items()
            }
    joints = {fit.mode: fit.joint for fit in fits}
    for system in systems:
        laws |= {mode: law.law for mode, law in system.driven.items() if law.law.terms}
        joints |= {mode: law.joint for mode, law in system.driven.items()}
    for mode, law in (decay_laws or {}).items():
        if mode not in laws:
            laws[mode], joints[mode] = law.law, law.joint
            index = modes.index(mode)
            corrections[mode] = (
                read_linear(law.stiffness) - float(modes.stiffness()[index]),
                read_linear(law.damping) - float(modes.damping()[index]),
            )
    corrected = correct_modes(modes, corrections)
    held = {mode: _hold_law(law, modes, corrected, mode, joints[mode]) for mode, law in laws.items()}
    return NonlinearModalModel(
        corrected,
        held,
        {mode: joint for mode, joint in joints.items() if joint.sliders or joint.law.terms},
        {product: value for system in systems for product, value in _list_couplings(system).items()},
        _find_reach(systems, corrected, held, joints),
    )


def _list_couplings(system: SystemFit) -> dict[Product, float]:
    return {each.product: float(each.coefficient.value or 0.0) for each in system.couplings}


def _find_reach(
    systems: Sequence[SystemFit],
    modes: LinearModes,
    laws: Mapping[int, TermSet],
    joints: Mapping[int, ModalJoint],
) -> Reach | None:
    """Return how far the tests moved the modes whose couplings become unstable beyond them; None without such modes."""
    stiffness = modes.stiffness()
    for mode, joint in joints.items():
        # Beyond the tests all slip of a joint is over.
        stiffness[modes.index(mode)] -= joint.stuck_stiffness
    displacement: dict[int, float] = {}
    velocity: dict[int, float] = {}
    for system in systems:
        couplings = _list_couplings(system)
        coupled = sorted({mode for product in couplings for mode in product.modes})
        largest = {mode: joints[mode].largest for mode in coupled}
        speed = {mode: 2 * np.pi * float(modes.frequency_hz[modes.index(mode)]) * largest[mode] for mode in coupled}
        reach = Reach(largest, speed)
        if coupled and not is_stable_beyond(couplings, (stiffness, modes.damping()), laws, reach):
            displacement |= largest
            velocity |= speed
    return Reach(displacement, velocity) if displacement else None


def _hold_law(law: Law, given: LinearModes, corrected: LinearModes, mode: int, joint: ModalJoint) -> TermSet:
    """Return the law of a mode, held where it is unstable beyond its tests; beside it all slip of the joint is over."""
    index = given.index(mode)
    linear = float(corrected.stiffness()[index]) - joint.stuck_stiffness, float(corrected.damping()[index])
    speed = 2 * np.pi * float(given.frequency_hz[index]) * joint.largest
    return hold_unstable(law, linear, (joint.largest, speed))


def warn_of_records(study: ModalStudy) -> Iterator[str]:
    """Yield warnings about the records: missing sensors, clipped channels, a single test of levels."""
    for each in study.tests:
        test = each.test
        missing = [sensor for sensor in test.modes.sensors if sensor not in test.sensors]
        if missing:
            yield (
                f"test {test.name!r} lacks {len(missing)} of {len(test.modes.sensors)} sensors "
                f"({', '.join(repr(name) for name in missing[:6])}): its modes are filtered with the condition number "
                f"{condition_number(with_sensors(test.modes, test.sensors)):.1f}"
            )
        if clipped := test.clipped:
            worst = max(clipped, key=lambda name: clipped[name])
            others = f" and {len(clipped) - 1} more channel(s)" if len(clipped) > 1 else ""
            yield (
                f"{100 * clipped[worst]:.2g} % of the samples of {worst!r}{others} in test {test.name!r} are clipped: "
                "measure again with a larger range"
            )
    if len(study.of_use("level")) == 1:
        yield 'there is only one test with use = "level": give two or more, at different levels, to compare them'


def _list_orders(study: ModalStudy) -> dict[str, Any]:
    return {"stiffness_order": study.stiffness_order, "damping_order": study.damping_order}


def _explain_no_law(study: ModalStudy, shifts: Sequence[LevelShift]) -> str:
    """Return why there is no law at all (no test to fit, or no mode that shifts), or "" where there is one."""
    if study.nonlinear and study.of_use("fit", "decay"):
        return ""
    if not study.nonlinear:
        return (
            f"none of {len(shifts)} modes shifts with the level beyond its thresholds: the structure is linear at "
            "these levels; excite it harder, or name the modes to fit (nonlinear = [7, 11])"
        )
    modes = ", ".join(str(mode) for mode in study.nonlinear)
    return (
        f'no test has use = "fit" or "decay", which mode(s) {modes} need: give sine beats or free decays '
        "(`opid resonance` reads tests at phase resonance)"
    )


def _compare_levels(study: ModalStudy, say: Say) -> tuple[LevelShift, ...]:
    tests = [each.test for each in study.of_use("level")]
    if len(tests) < 2:
        return ()
    say("levels")
    return level_shifts(tests, **{name: getattr(study, name) for name in THRESHOLDS})


def _fit_modes(
    study: ModalStudy, decay_laws: Mapping[int, DecayLaw], of_decays: Sequence[tuple[int, str]], say: Say
) -> tuple[tuple[ModeFit, ...], list[str]]:
    """Return the fits of the modes that forced tests move, and warnings about the choice of tests."""
    fits, faults, warnings = [], [], []
    given = study.of_use("fit")
    for mode in study.nonlinear if study.of_use("fit", "decay") else ():
        say(f"mode {mode}")
        tests = select_tests(given, mode, study.nonlinear)
        if not tests and mode in decay_laws:
            continue
        if not tests and (tests := select_tests_beside(given, mode)):
            names = ", ".join(repr(test.name) for test in tests)
            warnings.append(f"mode {mode} has no test of its own and is fitted to those of other modes ({names})")
        try:
            known: dict[str, Any] = {"free_linear": study.free_linear, "gain_tolerance": study.gain_tolerance}
            fits.append(fit := fit_mode(tests, mode, **_list_orders(study), **known))
            found = "mode %d: orders %d and %d leave %.3g of the modal force unexplained on %d lines"
            logger.info(found, mode, fit.stiffness_order, fit.damping_order, fit.residual_fraction, fit.n_lines)
        except InputError as error:
            failed = "; ".join(sentence for of_mode, sentence in of_decays if of_mode == mode)
            faults.append(f"mode {mode}: {error}" + (f" ({failed})" if failed else ""))
    refuse(faults, study.source)
    warnings += [
        f"the corrections of frequency and damping of mode {fit.mode} were found with other linear properties than "
        "those of the study: the model keeps the frequency and damping of the study"
        for fit in fits
        if (1 in fit.stiffness or 1 in fit.damping) and not _is_fitted_to(fit, study.modes)
    ]
    return tuple(fits), warnings


def _fit_systems(
    study: ModalStudy, fits: tuple[ModeFit, ...], say: Say
) -> tuple[tuple[ModeFit, ...], tuple[SystemFit, ...], list[str]]:
    """Return the fits, those by simulation where powers or a single mode are not enough, these, and warnings."""
    done: list[ModeFit] = []
    systems: list[SystemFit] = []
    warnings: list[str] = []
    taken: set[int] = set()
    for fit in fits:
        others = taken & _list_involved(study, fit)
        found = None if others else _try_system(study, fit, say, warnings)
        if others and (asked := _name_asked(study, fit.mode)):
            warnings.append(
                f"{asked} that the study names {'are' if study.find_couplings(fit.mode) else 'is'} left out: mode(s) "
                f"{', '.join(map(str, sorted(others)))} are already fitted together with other modes; fit them in a "
                f"study of their own, in which mode {fit.mode} is the only nonlinear one"
            )
        done.append(found.fit if found else fit)
        if found:
            taken |= set(found.modes)
            systems.append(found)
            warnings += found.warnings
    fitted = {fit.mode for fit in fits}
    warnings += [
        f"the coupling(s) {_name_products(study.find_couplings(mode))} that the study names are left out: no forced "
        f'test moves mode {mode}, and free decays do not show what drives what; give it a test with use = "fit"'
        for mode in study.nonlinear
        if mode not in fitted and study.find_couplings(mode)
    ]
    return tuple(done), tuple(systems), warnings


def _name_asked(study: ModalStudy, mode: int) -> str:
    """Return what a study names beside powers for a mode, "" for nothing."""
    products = study.find_couplings(mode)
    of_couplings = [f"the coupling(s) {_name_products(products)}"] if products else []
    return " and ".join([*of_couplings, *([f"the joint {study.memory}"] if study.memory else [])])


def _name_products(products: Sequence[Product]) -> str:
    return ", ".join(each.name for each in products)


def _list_involved(study: ModalStudy, fit: ModeFit) -> set[int]:
    """Return a mode and those that it drives, by the study or else by its tests."""
    named = {mode for each in study.find_couplings(fit.mode) for mode in each.modes}
    seen = {each.other for each in fit.interactions} if study.couplings is None else set()
    return {fit.mode} | named | seen


def _try_system(study: ModalStudy, fit: ModeFit, say: Say, warnings: list[str]) -> SystemFit | None:
    """Return the law of a mode by simulation, where powers of one mode are not enough; None where they are."""
    search_own = study.stiffness_order is None and study.damping_order is None
    products, involved, asked = study.find_couplings(fit.mode), _list_involved(study, fit), _name_asked(study, fit.mode)
    if len(involved) == 1 and not asked and not (search_own and fit.misfit > SIMULATED.excess):
        return None
    delay_s = float(fit.delay_s.value or 0.0) if fit.is_delayed else 0.0
    tests = [each.test for each in study.tests if each.test.name in fit.tests]
    tests = [delay_forces(test, delay_s) for test in tests] if delay_s else tests
    names = " and ".join(str(mode) for mode in sorted(involved))
    lost = f"; {asked} that the study names {'are' if products else 'is'} left out" if asked else ""
    if not all(_is_fitted_to(fit, test.modes) for test in tests):
        warnings.append(
            f"mode(s) {names} are not fitted by simulation, for their tests have different linear modes: give the "
            f"tests of a mode one set of modes{lost}"
        )
        return None
    say(f"mode{'s' * (len(involved) > 1)} {names} by simulation")
    try:
        found = fit_system(
            tests,
            fit,
            () if study.couplings is not None else fit.interactions,
            products=products or None,
            memory=study.memory,
            search_own=search_own,
            free_linear=study.free_linear is not False,
            gain_tolerance=study.gain_tolerance,
        )
    except InputError as error:
        warnings.append(f"mode {fit.mode}: {error}{lost}")
        return None
    if not found.is_good:
        left = ", ".join(f"{100 * each:.0f} % of that of mode {mode}" for mode, each in found.missed.items())
        warnings.append(
            f"no law that was tried explains the motion of mode{'s' * (len(involved) > 1)} {names} ({left} is left): "
            f"do not use the model where it moves; look for a mode or a state that the linear modes lack"
            + (f"; {found.dropped}" if found.dropped else lost)
        )
        return None
    warnings += [found.dropped] if found.dropped else []
    # Powers alone are known better from the equation, which is linear in them.
    return found if found.couplings or found.fit.joint_estimates.terms else None


def _fit_decays(study: ModalStudy, say: Say) -> tuple[tuple[Decay, ...], dict[int, DecayLaw], list[tuple[int, str]]]:
    """Return free decays of the nonlinear modes, the law of all decays of each mode, and warnings by mode."""
    decays: list[Decay] = []
    warnings: list[tuple[int, str]] = []
    for each in study.of_use("decay") if study.nonlinear else ():
        mode = each.mode or find_largest_mode(each.test, study.nonlinear)
        say(f"free decay {each.test.name}")
        try:
            known: dict[str, Any] = {"memory": study.memory, "gain_tolerance": study.gain_tolerance}
            decays.append(decay_of(each.test, mode, **_list_orders(study), **known))
        except NotDeterminedError as error:
            warnings.append((mode, f"free decay {each.test.name!r} of mode {mode}: {error}"))
    laws = {}
    for mode in study.nonlinear:
        own = [decay for decay in decays if decay.mode == mode]
        warnings += [
            (mode, f"free decay {decay.name!r} of mode {mode}: {text}") for decay in own for text in decay.warnings
        ]
        if own:
            try:
                laws[mode] = law_of_decays(own, **_list_orders(study), memory=study.memory)
            except NotDeterminedError as error:
                warnings.append((mode, f"the free decays of mode {mode} give no law: {error}"))
                continue
            # The law of a single decay repeats warnings of that decay.
            of_decays = {text for decay in own for text in decay.warnings}
            of_law = [text for text in laws[mode].warnings if text not in of_decays]
            warnings += [(mode, f"the free decays of mode {mode} together: {text}") for text in of_law]
    return tuple(decays), laws, warnings


def _is_fitted_to(fit: ModeFit, modes: LinearModes) -> bool:
    """Return whether a fit was made with the linear properties of these modes, so that its corrections hold here."""
    given = (modes.frequency_hz[fit.mode - 1], modes.damping_ratio[fit.mode - 1])
    return bool(np.allclose(given, (fit.frequency_hz, fit.damping_ratio), rtol=1e-9, atol=0.0))


def _run_truth_tests(
    study: ModalStudy,
    fits: Sequence[ModeFit],
    decay_laws: Mapping[int, DecayLaw],
    systems: Sequence[SystemFit],
    say: Say,
) -> tuple[tuple[TruthTest, ...], list[str]]:
    done, unstable = [], []
    delay_s = _combine_delays(fits)
    for each in study.of_use("truth"):
        say(f"truth test {each.test.name}")
        try:
            model = make_model(each.test.modes, fits, decay_laws, systems)
            numbers = range(1, each.test.modes.n_modes + 1)
            start = [[given.get(mode, 0.0) for mode in numbers] for given in (each.displacement, each.velocity)]
            test = delay_forces(each.test, delay_s) if delay_s else each.test
            done.append(truth_test(model, test, displacement=start[0], velocity=start[1]))
        except InputError as error:
            unstable.append(str(error))
    return tuple(done), unstable


def _combine_delays(fits: Sequence[ModeFit]) -> float:
    """Return the mean delay of the fits that show one, weighted by their variances, s; 0 where none does."""
    late = [fit.delay_s for fit in fits if fit.is_delayed]
    weights = np.array([float(each.std or 1.0) ** -2 for each in late])
    return float(weights @ [float(each.value or 0.0) for each in late] / weights.sum()) if late else 0.0


def _warn_of_modes(modes: LinearModes) -> Iterator[str]:
    condition = condition_number(modes)
    if condition > MODAL.most_condition:
        yield (
            f"the shapes have the condition number {condition:.0f} (9 is good): the modal filter amplifies noise and "
            "errors of the shapes by this factor; add sensors or leave out modes"
        )
    looks = looks_unit_normalised(modes)
    if looks:
        yield f"the shapes do not look mass-normalised: {looks}"


def _warn_of_amplitudes(
    study: ModalStudy,
    fits: Sequence[ModeFit],
    decay_laws: Mapping[int, DecayLaw],
    systems: Sequence[SystemFit],
    model: NonlinearModalModel,
) -> Iterator[str]:
    """Warn of truth tests that move a mode beyond the amplitudes that its law was fitted to."""
    reached = {fit.mode: (fit.joint.largest, fit.band_hz) for fit in fits}
    known = {mode: law.joint.largest for each in systems for mode, law in each.driven.items() if mode in model.laws}
    for mode, largest in ({mode: law.joint.largest for mode, law in decay_laws.items()} | known).items():
        natural = float(study.modes.frequency_hz[mode - 1])
        reached.setdefault(mode, (largest, (0.8 * natural, 1.2 * natural)))
    for each, (mode, (largest, band)) in product(study.of_use("truth"), reached.items()):
        try:
            times = mode_lines(each.test, mode, band).largest_q / largest
        except InputError as error:
            yield f"the amplitude of mode {mode} in truth test {each.test.name!r} is not known: {error}"
            continue
        if times > MODAL.extrapolated:
            which = _say_held(model, mode)
            yield (
                f"truth test {each.test.name!r} moves mode {mode} {times:.2g} times as far as the tests that its law "
                f"was fitted to: the force there is an extrapolation{which}; fit tests of this level"
            )


def _say_held(model: NonlinearModalModel, mode: int) -> str:
    """Return a clause on what is held of a mode, "" where nothing is."""
    powers = " and of ".join(list_held(model.laws.get(mode, LINEAR)))
    has_couplings = model.reach is not None and mode in model.reach.displacement
    held = [f"powers of {powers}"] * bool(powers) + ["couplings"] * has_couplings
    return f", with its {' and its '.join(held)} held where they would become unstable" if held else ""


def _warn_of_truth_tests(done: Sequence[TruthTest]) -> Iterator[str]:
    """Warn of truth tests that the model does not explain."""
    for test in done:
        missed = {name: figures.nrmse_nonlinear for name, figures in test.sensors.items()}
        worst = max(missed, key=lambda name: missed[name])
        median = float(np.median(list(missed.values())))
        if missed[worst] > MODAL.most_missed:
            yield (
                f"truth test {test.name!r}: the nonlinear model misses {100 * missed[worst]:.0f} % of the motion of "
                f"{worst!r} (median of all sensors {100 * median:.0f} %): find the cause before you use the model there"
            )
