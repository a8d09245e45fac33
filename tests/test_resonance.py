"""Measured tests at phase resonance: steady levels, the law, and the worlds in which an assumption fails."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_resonance import (
    C2,
    K3,
    MODE,
    held_study,
    requires_truth_inside,
    true_curves,
    two_modes,
    with_force_turned,
    with_mode_unknown,
    with_polarity_reversed,
    with_samples,
    with_sensor_clipped,
)

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.rig import FORCE
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.resonance.identification import identify_resonance, identify_resonances
from opid.modal.resonance.law import fit_states
from opid.modal.resonance.settings import ResonanceSettings
from opid.modal.resonance.steady import Drive, SteadyState, find_steady, measure_levels
from opid.modal.study import StudyTest
from opid.report import text
from opid.signals.recording import recording_from_arrays
from opid.signals.units import STANDARD_GRAVITY

SETTINGS = ResonanceSettings()
MODES = held_study().modes
K0, C0 = (float(each[MODE - 1]) for each in (MODES.stiffness(), MODES.damping()))


# ---- a motion at one frequency -----------------------------------------------------------------------


def driven(pole_of_force, *, cycles=60, fs=1000.0, k0=(2 * np.pi * 100) ** 2, c0=8.0):
    """A linear mode under a force Re exp(p t), without noise, as a test of one sensor with the shape 0.5."""
    time = np.arange(round(cycles * fs / 100)) / fs
    force = np.exp(pole_of_force * time)
    q = 0.5 * force / (pole_of_force**2 + c0 * pole_of_force + k0)
    record = recording_from_arrays([force.real, (0.5 * pole_of_force**2 * q).real], [FORCE, "a"], fs=fs, unit="m/s^2")
    record = replace(record, channels=(replace(record.channels[0], unit="N"), record.channels[1]))
    modes = LinearModes([100.0], [c0 / (2 * np.sqrt(k0))], [[0.5]], ("a",))
    return modal_test(record, modes, name="dwell", force=FORCE, drive_point="a")


@pytest.mark.parametrize("hz", [97.0, 100.0, 101.5])
def test_a_steady_motion_has_stiffness_and_damping_at_any_phase(hz):
    (level,) = measure_levels(driven(2j * np.pi * hz), 1, SETTINGS)
    assert level.is_steady
    assert level.state.frequency_hz == pytest.approx(hz, rel=1e-7)
    assert level.state.stiffness == pytest.approx((2 * np.pi * 100) ** 2, rel=1e-5)
    assert level.state.damping == pytest.approx(8.0, rel=1e-3)


def test_a_motion_that_grows_slowly_has_the_same():
    (level,) = measure_levels(driven(0.005 + 2j * np.pi * 100.0), 1, SETTINGS)
    assert level.state.pole.real == pytest.approx(0.005, rel=0.02)
    assert level.state.damping == pytest.approx(8.0, rel=1e-3)


def test_steps_are_found_and_a_sweep_has_no_level():
    time = np.arange(12000)
    step = np.where(time < 6000, 1.0, 1.05) * np.sin(2 * np.pi / 10 * time)
    (first, second) = find_steady(step, 10.0, SETTINGS)
    # The step may lie in the last periods, where the window of a level hides it.
    assert 5900 < first[1] < 6080
    assert 6000 < second[0] < 6200
    sweep = np.exp(2e-4 * time) * np.sin(2 * np.pi / 10 * time)
    assert find_steady(sweep, 10.0, SETTINGS) == []


def test_stretches_of_one_drive_are_one_level_and_those_of_another_are_not():
    """A loop that still settles parts a level; a step of the voltage, or of the frequency, makes another one."""
    time = np.arange(9000)
    second = time >= 4500
    for change, volts, n_levels in ((1e-4, 1.0, 1), (0.0, 1.02, 2), (4e-3, 1.0, 2)):
        phase = 2 * np.pi / 10 * np.cumsum(np.where(second, 1.0 + change, 1.0))
        drive = np.where(second, volts, 1.0) * np.sin(phase)
        # Off resonance the motion lags and falls by as much as the frequency moves, in half bandwidths of 0.004.
        lag = np.where(second, np.arctan(change / 0.004), 0.0)
        motion = np.where(second, volts, 1.0) * np.cos(lag) * np.sin(phase + lag)
        found = find_steady(motion, 10.0, SETTINGS, Drive(drive, drive))
        assert len(found) == n_levels, (change, volts)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_level_is_read_once_and_a_loop_that_holds_the_drive_point_is_not_warned_of(seed):
    result = identify_resonance(held_study(seed, 40))
    assert len(result.states) == 40
    assert np.abs(result.phase_error_deg).max() > 3.0  # Other modes move the drive point, too.
    assert result.warnings == ()


def test_a_last_level_that_does_not_settle_before_the_log_ends_is_told():
    study, whole = held_study(), identify_resonance(held_study())
    before, last = whole.level_stop_s[-2], whole.level_start_s[-1]

    def cut(seconds):
        """Return the levels of the log that ends then, and those that are left out."""
        found = identify_resonance(with_samples(study, lambda samples, record: samples[: round(seconds * record.fs)]))
        return len(found.states), found.left_out

    n, (told,) = cut(last + 20 / 116)
    assert n == len(whole.states) - 1
    assert "s to the end" in told
    assert "hold it longer" in told
    # Where the log ends soon after the step of the voltage there is no such level.
    assert cut(before + 20 / 116) == (n, ())


# ---- the law -------------------------------------------------------------------------------------------


def exact_states(phase_deg=0.0, n=12, offset=0.0):
    """Motions of the cubic mode without harmonics, at amplitudes that differ, with a force of a wrong phase."""
    states = []
    for a in np.geomspace(2e-5, 5e-4, n):
        hz, zeta = true_curves(a)
        omega = 2 * np.pi * hz * (1 + offset * zeta)
        k, c = K0 + 0.75 * K3 * a**2, C0 + C2 * 8 / (3 * np.pi) * omega * a
        force = (k - omega**2 + 1j * omega * c) * a * np.exp(1j * np.radians(phase_deg))
        states.append(SteadyState("made", 1j * omega, force, np.array([a, 0j, 0j]), 1e-4, 1e-4, 1e-4))
    return states


def test_the_law_of_exact_motions_is_exact():
    law = fit_states(exact_states(), SETTINGS)
    assert sorted(law.stiffness) == [1, 3]
    assert sorted(law.damping) == [1, 2]
    assert law.stiffness[3].value == pytest.approx(K3, rel=1e-4)
    assert law.damping[2].value == pytest.approx(C2, rel=1e-4)


@pytest.mark.parametrize("phase_deg", [-40.0, 15.0, 60.0])
def test_a_force_of_any_phase_gives_the_same_law(phase_deg):
    states = [*exact_states(phase_deg, offset=2.0), *exact_states(phase_deg), *exact_states(phase_deg, offset=-2.0)]
    law = fit_states(states, SETTINGS)
    assert law.force_phase_deg.value == pytest.approx(phase_deg, abs=0.1)
    assert law.stiffness[3].value == pytest.approx(K3, rel=2e-3)
    assert law.damping[2].value == pytest.approx(C2, rel=2e-3)


def test_motions_off_resonance_show_the_phase_of_the_force():
    states = [*exact_states(4.0, offset=2.0), *exact_states(4.0), *exact_states(4.0, offset=-2.0)]
    law = fit_states(states, SETTINGS)
    assert law.force_phase_deg.value == pytest.approx(4.0, abs=0.1)
    assert law.stiffness[3].value == pytest.approx(K3, rel=2e-3)


def active_states(c0, lowest):
    """Motions of the cubic mode whose damping at small amplitude is another one."""
    return [
        replace(state, force=state.force + 1j * state.pole.imag * (c0 - C0) * state.displacement[0])
        for state in exact_states(n=24)
        if state.amplitude > lowest
    ]


def test_a_mode_that_something_else_drives_gets_no_law():
    with pytest.raises(NotDeterminedError, match="the motions show a negative damping"):
        fit_states(active_states(-0.5 * C0, 0.0), SETTINGS)


def test_a_law_that_extrapolates_to_negative_damping_has_no_interval_there():
    damping = C2 * 8 / (3 * np.pi) * 2 * np.pi * 119.0 * 2e-4
    law = fit_states(active_states(-0.5 * damping, 2e-4), SETTINGS, stiffness_order=3, damping_order=2)
    assert law.damping[1].value < 0
    assert law.damping[1].interval95 is None
    assert law.is_withheld
    assert not fit_states(exact_states(), SETTINGS).is_withheld


def test_levels_at_quadrature_alone_leave_the_phase_open():
    orders = {"stiffness_order": 3, "damping_order": 2}
    law = fit_states(exact_states(), SETTINGS, **orders)
    assert law.force_phase_deg.std == pytest.approx(SETTINGS.phase_tolerance_deg, rel=0.05)
    loose = fit_states(exact_states(), replace(SETTINGS, phase_tolerance_deg=2.0), **orders)
    assert loose.stiffness[1].std > 3 * law.stiffness[1].std


# ---- whole tests -----------------------------------------------------------------------------------------


def test_a_sound_test_gives_law_backbone_and_harmonics():
    result = identify_resonance(held_study())
    for law in (result.records_law, result.backbone_law):
        requires_truth_inside(law)
    assert result.records_law.stiffness[3].value == pytest.approx(K3, rel=3e-3)
    hz, zeta = true_curves(result.amplitude)
    np.testing.assert_allclose(result.resonance_hz, hz, rtol=2e-4)
    np.testing.assert_allclose(result.damping_ratio, zeta, rtol=0.02)
    assert result.interaction is not None
    assert not result.interaction.flagged
    assert result.appropriation.sensors.shape[1:] == (6, 5)
    json.dumps(result.to_dict(), allow_nan=False)


@pytest.mark.parametrize("phase_error_deg", [5.0, -20.0])
def test_levels_off_quadrature_are_corrected(phase_error_deg):
    result = identify_resonance(held_study(phase_error_deg=phase_error_deg))
    requires_truth_inside(result.records_law)
    assert any("missed quadrature" in text for text in result.warnings)


def test_a_hidden_phase_of_the_force_is_found_in_the_transients():
    result = identify_resonance(with_force_turned(held_study(), 5.0))
    assert result.records_law.force_phase_deg.value == pytest.approx(5.0, abs=1.0)
    for law in (result.records_law, result.backbone_law):
        requires_truth_inside(law)
    assert any("check delay and filters" in text for text in result.warnings)


def test_a_force_of_wrong_polarity_is_refused():
    with pytest.raises(InputError, match=r"sign = -1 .* or another drive_point"):
        identify_resonance(with_polarity_reversed(held_study()))


def test_levels_with_a_clipped_sensor_are_left_out():
    result = identify_resonance(with_sensor_clipped(held_study()))
    assert any("'board_x' is clipped" in text for text in result.left_out)
    requires_truth_inside(result.records_law)
    assert result.amplitude.max() < 0.9 * identify_resonance(held_study()).amplitude.max()


def test_a_mode_without_a_shape_widens_the_interval_of_damping():
    sound, hidden = (identify_resonance(each) for each in (held_study(), with_mode_unknown(held_study())))
    assert any("has none of the shapes" in text for text in hidden.warnings)
    requires_truth_inside(hidden.records_law)
    assert hidden.records_law.damping[2].std > 1.5 * sound.records_law.damping[2].std


def test_noise_alone_and_a_study_without_such_tests_are_refused():
    rng = np.random.default_rng(1)
    noise = with_samples(held_study(), lambda samples, record: rng.standard_normal(samples.shape))
    with pytest.raises(InputError, match="hold each level"):
        identify_resonance(noise)
    study = held_study()
    fitted = replace(study, tests=(replace(study.tests[0], use="fit"),))
    with pytest.raises(InputError, match='use = "resonance"'):
        identify_resonance(fitted)


@pytest.mark.parametrize("turned_deg", [0.0, 5.0])
def test_one_log_for_each_level_gives_a_law_that_holds(turned_deg):
    """Without transients nothing shows that the force was turned, so the interval holds it beforehand."""
    study = with_force_turned(held_study(), turned_deg) if turned_deg else held_study()
    (given,) = study.tests
    record, tests = given.test.recording, []
    for number, level in enumerate(each for each in measure_levels(given.test, MODE, SETTINGS) if each.is_steady):
        part = slice(round(level.start_s * record.fs), round(level.stop_s * record.fs))
        cut = replace(record, samples=record.samples[part])
        test = modal_test(cut, study.modes, name=f"level_{number}", force=FORCE, drive_point=study.drive_point)
        tests.append(StudyTest(test, "resonance", MODE))
    result = identify_resonance(replace(study, tests=tuple(tests)))
    requires_truth_inside(result.records_law)
    assert len({*result.level_tests}) > 8
    assert any("keep the transients" in text for text in result.warnings)


def with_motion(study, change, unit="m/s^2"):
    """Return the study with each channel of a unit multiplied by `change(name)`."""
    tests = []
    for each in study.tests:
        record = each.test.recording
        gains = [change(name) if record.unit(name) == unit else 1.0 for name in record.names]
        points = {force.channel: force.drive_point for force in each.test.forces}
        changed = replace(record, samples=record.samples * gains)
        tests.append(replace(each, test=modal_test(changed, each.test.modes, name=each.test.name, force=points)))
    return replace(study, tests=tuple(tests))


@pytest.mark.parametrize("factor", [4.4482, 1 / 4.4482])
def test_a_force_in_another_unit_is_told_by_the_transients(factor):
    result = identify_resonance(with_motion(held_study(), lambda name: factor, "N"))
    assert result.records_law is None
    assert "the levels and the transients between them show a modal mass of" in result.not_determined


def test_accelerations_in_g_give_no_law():
    result = identify_resonance(with_motion(held_study(), lambda name: 1 / STANDARD_GRAVITY))
    assert result.records_law is None
    assert "check the units of amplitude and force" in result.not_determined


def test_accelerometers_of_another_gain_are_within_the_interval():
    """The calibration that is believed of them, and a half more."""
    law = identify_resonance(with_motion(held_study(), lambda name: 1.015)).records_law
    assert law.stiffness[3].holds(K3)
    assert law.stiffness[3].std > 0.02 * K3


# ---- several modes -------------------------------------------------------------------------------------


def test_a_study_of_two_modes_gives_both_and_one_report():
    study = two_modes()
    with pytest.raises(InputError, match="the tests hold the modes 3, 2: choose one"):
        identify_resonance(study)
    both = identify_resonances(study)
    assert [each.mode for each in both.modes] == [2, MODE]
    requires_truth_inside(both.modes[1].law)
    linear = both.modes[0].law
    true_hz = float(study.modes.frequency_hz[1])
    assert (np.abs(linear.frequency_hz - true_hz) < 3 * linear.frequency_std_hz).all()
    assert both.only is None
    written = text(both)
    for words in ("Modes", "Mode 2: Backbone", "Mode 3: Backbone", "Mode 3: Law"):
        assert words in written
    assert {row.name.split(".")[0] for row in both.summary()} == {"mode_2", "mode_3"}
    json.dumps(both.to_dict(), allow_nan=False)


def test_a_mode_that_cannot_be_read_does_not_keep_the_others_back():
    study = two_modes()
    reversed_one = with_polarity_reversed(replace(study, tests=study.tests[1:])).tests
    both = identify_resonances(replace(study, tests=(*study.tests[:1], *reversed_one)))
    assert [each.mode for each in both.modes] == [MODE]
    assert "sign = -1" in both.faults[2]
    assert "mode 2: at" in both.not_determined
    assert identify_resonances(held_study()).only.mode == MODE
