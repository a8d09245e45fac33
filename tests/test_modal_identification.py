from dataclasses import replace

import numpy as np
import pytest
from made_beats import C2, FOUR, FREQUENCY, FS, K3, OMEGA, ZETA, beat, beats, measured, softening

import opid
from opid.errors import InputError, NotDeterminedError
from opid.mechanics.rig import rig_run
from opid.modal.forced import mode_tests
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.mode_tests import (
    check_shapes,
    find_band,
    find_interactions,
    find_largest_mode,
)
from opid.modal.identification import identify_modes
from opid.modal.linear.modes import LinearModes, delay_forces, modal_test
from opid.modal.model import NonlinearModalModel, modal_response, truth_test
from opid.modal.power_laws import power_law
from opid.modal.settings import MODAL
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.recording import Channel, Recording
from opid.signals.resampling import resampled
from opid.virtual.modal_tests.bolted_structures import case_study_2

LEVELS = (5.0, 16.0, 33.0, 55.0)
ORDERS = {"stiffness_order": 3, "damping_order": 3}
# mode 3 softens as in `softening`, mode 2 hardens
BOTH = NonlinearModalModel(FOUR, {2: power_law({3: 2e10}, {}), 3: power_law({3: K3}, {2: C2})})


def study(tests, nonlinear=(3,), **settings):
    return ModalStudy("small", FOUR, nonlinear, tuple(tests), "a", **settings)


@pytest.fixture(scope="module")
def two_modes():
    rng = np.random.default_rng(2)
    tests = [StudyTest(test) for test in beats(BOTH, rng, LEVELS)]
    for level in (10.0, 40.0):
        force = beat(level, frequency_hz=90.0)
        tests.append(StudyTest(measured(BOTH, force, rng, name=f"second {level:g} N")))
    tests.append(StudyTest(measured(BOTH, beat(45.0), rng, name="truth"), "truth"))
    return tests


def test_from_tests_to_model_and_truth(two_modes):
    found = identify_modes(study(two_modes, (2, 3), **ORDERS, free_linear=False))
    of = {fit.mode: fit for fit in found.fits}
    assert of[2].tests == ("second 10 N", "second 40 N")
    assert len(of[3].tests) == 4
    assert abs(of[3].stiffness[3].value / K3 - 1) < 0.003
    assert abs(of[2].stiffness[3].value / 2e10 - 1) < 0.1
    assert found.condition_number == pytest.approx(np.linalg.cond(FOUR.shapes))
    assert [each.name for each in found.truth_tests] == ["truth"]
    for sensor in found.truth_tests[0].sensors.values():
        assert sensor.nrmse_nonlinear < 0.02 < sensor.nrmse_linear
    assert set(found.model.laws) == {2, 3}
    assert not found.warnings


def test_tests_are_given_to_the_mode_that_they_move(two_modes):
    fits = [each for each in two_modes if each.use == "fit"]
    assert find_largest_mode(fits[0].test, (2, 3)) == 3
    assert find_largest_mode(fits[-1].test, (2, 3)) == 2
    assert mode_tests.select_tests(fits, 4, (2, 3, 4)) == ()
    # nobody's own tests: those that move it at all
    assert mode_tests.select_tests_beside(fits, 4)
    named = [replace(each, mode=2) for each in fits]
    assert len(mode_tests.select_tests(named, 2, (2, 3))) == len(fits)
    assert mode_tests.select_tests(named, 3, (2, 3)) == ()


def test_the_band_ends_before_the_neighbours(two_modes):
    tests = [each.test for each in two_modes[:4]]
    low, high = find_band(tests, 3)
    assert 105.0 <= low < FREQUENCY * 0.97 < FREQUENCY < high <= 165.0


def test_each_test_may_have_linear_modes_of_its_own():
    shifted = LinearModes(
        FOUR.frequency_hz * [1, 1, 0.99, 1], FOUR.damping_ratio * [1, 1, 1.1, 1], FOUR.shapes, FOUR.sensors
    )
    world = NonlinearModalModel(shifted, {3: power_law({3: K3}, {2: C2})})
    tests = [StudyTest(test) for test in beats(world, np.random.default_rng(4), LEVELS)]
    found = identify_modes(study(tests, **ORDERS, free_linear=False))
    assert abs(found.fits[0].stiffness[3].value / K3 - 1) < 0.003
    # with the modes of the study instead they are a percent off, and the free linear columns say so
    stale = [replace(each, test=replace(each.test, modes=FOUR)) for each in tests]
    corrected = identify_modes(study(stale, **ORDERS)).fits[0]
    assert corrected.free_linear
    k1 = (2 * np.pi * 0.99 * FREQUENCY) ** 2 - OMEGA**2
    assert abs(corrected.stiffness[1].value / k1 - 1) < 0.02
    assert abs(corrected.stiffness[3].value / K3 - 1) < 0.02


def test_free_decays_give_the_law_where_no_force_was_measured(monkeypatch):
    rng = np.random.default_rng(6)
    n = round(3 * FS)
    motion = modal_response(softening(FOUR, 3), np.r_[beat(60.0, whole_s=0.76), np.zeros(n)], fs=FS, drive_point="a")
    ringing = motion.acceleration[round(0.76 * FS) :] @ FOUR.shapes.T
    noisy = ringing + 0.005 * ringing.std(axis=0) * rng.standard_normal(ringing.shape)
    channels = tuple(Channel(name, "m/s^2") for name in FOUR.sensors)
    decay = modal_test(Recording(noisy, fs=FS, channels=channels), FOUR, name="decay")
    truth = measured(softening(FOUR, 3), beat(45.0), rng, name="truth")
    given = study([StudyTest(decay, "decay"), StudyTest(truth, "truth")], stiffness_order=3, damping_order=2)
    found = identify_modes(given)
    assert not found.fits
    assert [each.mode for each in found.decays] == [3]
    law = found.decay_laws[3]
    assert law.stiffness == found.decays[0].stiffness  # one decay: its own law
    assert found.model.laws[3].terms == law.law.terms
    assert abs(found.decays[0].damping_low.value / ZETA - 1) < 0.1
    done = found.truth_tests[0].sensors["a"]
    assert done.nrmse_nonlinear < 0.1 < done.nrmse_linear

    # a warning that the law of a single decay repeats stands once
    of_decay = replace(found.decays[0], warnings=("too little range",))
    of_law = replace(law, warnings=("too little range", "of both"))
    monkeypatch.setattr("opid.modal.identification.decay_of", lambda *_, **__: of_decay)
    monkeypatch.setattr("opid.modal.identification.law_of_decays", lambda *_, **__: of_law)
    assert [each for each in identify_modes(given).all_warnings if "decay" in each] == [
        "free decay 'decay' of mode 3: too little range",
        "the free decays of mode 3 together: of both",
    ]


def test_the_thresholds_of_the_study_decide_which_modes_are_nonlinear(two_modes):
    levels = [replace(each, use="level", mode=None) for each in two_modes[:4:3]]
    fits = [each for each in two_modes if each.use == "fit"][1:3]
    found = identify_modes(study([*levels, *fits], (), **ORDERS, free_linear=False))
    assert [shift.mode for shift in found.shifts if shift.nonlinear] == [3]
    assert found.settings["frequency_threshold"] == 0.002
    blunt = {"frequency_threshold": 0.5, "damping_threshold": 1.0}
    nothing = identify_modes(study([*levels, *fits], (), **ORDERS, **blunt))
    assert nothing.not_determined.startswith("none of 3 modes shifts")
    assert len(nothing.shifts) == 3


def test_levels_alone_give_the_shifts_and_say_what_is_missing(two_modes):
    levels = [replace(each, use="level", mode=None) for each in two_modes[:4:3]]
    found = identify_modes(study(levels, ()))
    assert [shift.mode for shift in found.shifts if shift.nonlinear] == [3]
    assert found.not_determined.startswith('no test has use = "fit" or "decay", which mode(s) 3 need')
    assert not found.fits


def test_a_turned_and_an_exchanged_sensor_are_named():
    rng = np.random.default_rng(9)
    sensors = tuple("abcdefgh")
    right = replace(FOUR, shapes=rng.standard_normal((8, 4)) * 0.4, sensors=sensors)
    test = measured(softening(right, 3), beat(40.0), rng)
    band = (100.0, 140.0)
    assert check_shapes(test, 3, band).outside < 0.01
    for row, words in ((3, "with the opposite sign of 'd'"), (6, "with the opposite sign of 'g'")):
        turned = right.shapes * np.where(np.arange(8) == row, -1.0, 1.0)[:, None]
        check = check_shapes(replace(test, modes=replace(right, shapes=turned)), 3, band)
        assert check.outside > 0.1
        assert check.cause.startswith(words)
    exchanged = replace(right, shapes=right.shapes[[0, 4, 2, 3, 1, 5, 6, 7]])
    check = check_shapes(replace(test, modes=exchanged), 3, band)
    assert check.cause.startswith("with 'b' and 'e' exchanged")
    assert MODAL.warned_outside < check.outside < MODAL.most_outside
    wrong = modal_test(test.recording, exchanged, name="beat", force="force", drive_point="a")
    check = check_shapes(wrong, 3, band)
    (warning,) = check.warnings
    assert not check.faults
    assert "is no sum of the mode shapes: with 'b' and 'e' exchanged it would be 0 %" in warning
    many = replace(right, shapes=right.shapes[::-1])
    check = check_shapes(replace(test, modes=many), 3, band)
    (fault,) = check.faults
    assert not check.warnings
    assert "check the order, signs, gains and units of the sensors" in fault


def test_a_correction_stays_with_the_linear_properties_it_was_found_with():
    own = LinearModes(
        FOUR.frequency_hz * [1, 1, 1.001, 1], FOUR.damping_ratio * [1, 1, 1.05, 1], FOUR.shapes, FOUR.sensors
    )
    tests = [replace(test, modes=own) for test in beats(softening(FOUR, 3), np.random.default_rng(7), LEVELS)]
    found = identify_modes(study([StudyTest(test) for test in tests], **ORDERS, free_linear=True))
    assert found.model.modes.frequency_hz[2] == pytest.approx(FREQUENCY, rel=1e-12)
    assert any("the model keeps the frequency and damping of the study" in warning for warning in found.warnings)


@pytest.mark.parametrize("fs", [480.0, 720.0])
def test_powers_do_not_fold_back_at_low_rates(fs):
    fine = beats(softening(FOUR, 3), np.random.default_rng(8), LEVELS, fs=7200.0)
    tests = [
        modal_test(resampled(test.recording, fs), FOUR, name=test.name, force="force", drive_point="a") for test in fine
    ]
    fit = fit_mode(tests, 3, **ORDERS, free_linear=False)
    assert abs(fit.stiffness[3].value / K3 - 1) < 0.01
    assert any("are sampled too slowly for its third harmonic" in warning for warning in fit.warnings)


def test_what_is_wrong_is_said_for_all_modes_at_once(two_modes):
    fits = [replace(each, mode=3) for each in two_modes[:4]]
    with pytest.raises(InputError, match=r"mode 4: .*moves mode 4 more than the other modes"):
        identify_modes(study(fits, (3, 4), **ORDERS))
    quiet = [replace(each, use="level", mode=None) for each in two_modes[:1]]
    with pytest.raises(NotDeterminedError, match="no mode is named as nonlinear"):
        identify_modes(study(quiet, ()))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"nonlinear": (9,)}, "nonlinear names mode 9, give numbers from 1 to 4"),
        ({"nonlinear": (1,)}, r"mode 1, a rigid-body mode \(0 Hz\)"),
        ({"nonlinear": (3, 3)}, "name each mode once"),
        ({"stiffness_order": 7}, r"stiffness_order is 7, give 1 \(linear\) to 5"),
        ({"damping_threshold": -0.1}, r"damping_threshold is -0.1, give a fraction above 0"),
    ],
)
def test_a_study_that_cannot_be_is_refused(two_modes, change, words):
    with pytest.raises(InputError, match=words):
        replace(study(two_modes), **change)


def test_a_truth_test_beyond_the_fit_is_doubted(two_modes):
    fits = [each for each in two_modes[:3] if each.use == "fit"]
    found = identify_modes(study([*fits, two_modes[-1]], **ORDERS, free_linear=False))
    assert any("the force there is an extrapolation" in warning for warning in found.warnings)


def test_a_mode_that_answers_at_twice_the_frequency_is_named():
    force = beat(250.0, frequency_hz=400.0, fs=4096.0, beat_s=0.3, whole_s=1.3)
    told = {}
    for coupling in (None, 0.0):
        case = case_study_2(coupling_n_per_m2=coupling, shaker=None)
        run = rig_run(case.rig, force, fs=4096.0, rng=np.random.default_rng(0))
        test = modal_test(run.recording, case.modes, name="beat", force="force", drive_point=case.drive_point)
        told[coupling] = list(find_interactions(test, 10, (370.0, 430.0)))
    assert told[0.0] == []
    assert len(told[None]) == 1
    assert told[None][0].product.name == "k q10^2 q18"
    assert told[None][0].sentence.startswith("mode 18 moves at 2 times the frequency of mode 10 in test 'beat'")


def test_a_truth_test_is_compared_with_the_delay_of_the_fits():
    model, modes = softening(FOUR, 3), FOUR
    rng = np.random.default_rng(4)
    late = [delay_forces(test, -2e-4) for test in [*beats(model, rng), measured(model, beat(35.0), rng, name="truth")]]
    uses = [*["fit"] * (len(late) - 1), "truth"]
    given = [StudyTest(test, use) for test, use in zip(late, uses, strict=True)]
    found = identify_modes(ModalStudy("late", modes, (3,), given, stiffness_order=3, damping_order=2))
    assert found.fits[0].is_delayed
    assert "the accelerations after the forces is 199.9 µs (mode 3, standard deviation 2.7 µs)." in " ".join(
        opid.text(found).split()
    )
    assert max(each.nrmse_nonlinear for each in found.truth_tests[0].sensors.values()) < 0.03
    ignored = truth_test(found.model, late[-1])
    assert min(each.nrmse_nonlinear for each in ignored.sensors.values()) > 0.1
