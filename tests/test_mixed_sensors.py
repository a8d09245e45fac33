"""Lasers and strain gauges beside accelerometers, or alone, are sensors of modal tests like accelerometers."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_beam import (
    ACCELEROMETERS,
    FREQUENCY_HZ,
    FS,
    GAUGES,
    LAW,
    SOFT,
    beam,
    driven,
    record,
    strike,
)
from made_resonance import MODE, held_study, requires_truth_inside

from opid.errors import InputError
from opid.mechanics.rig import FORCE
from opid.mechanics.structure import modal_assurance
from opid.modal.decay.free_decay import decay_of
from opid.modal.forced.equation import mode_lines
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.mode_tests import check_shapes
from opid.modal.identification import identify_modes, warn_of_records
from opid.modal.linear.frequency_response import cmif, forced_record, measured_response, resynthesised, weigh_response
from opid.modal.linear.modes import (
    LinearModes,
    condition_number,
    modal_filter,
    modal_test,
    weigh_sensors,
    weighted_shapes,
    with_sensors,
)
from opid.modal.linear.modes_file import looks_unit_normalised, write_modes
from opid.modal.linear.response_fit import fit_modes
from opid.modal.model import NonlinearModalModel, modal_response, simulate, truth_test
from opid.modal.resonance.curves import ResponseCurve
from opid.modal.resonance.identification import identify_resonance
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.conversion import recording_of
from opid.signals.logs import open_log, write_log
from opid.signals.motion import differentiate
from opid.signals.recording import Channel
from opid.studies.study_file import read_study, write_study

MIXED = ("a", "c", "e", "laser", "ruler", "gauge_1", "gauge_2")
LEVELS_N = (50, 120, 200)


def elastic(modes):
    """Return the modes without heave, which strains nothing."""
    kept = modes.elastic
    return replace(
        modes,
        frequency_hz=modes.frequency_hz[kept],
        damping_ratio=modes.damping_ratio[kept],
        shapes=modes.shapes[:, kept],
    )


@cache
def study(sensors):
    """Three beats to fit and one between them as the truth test."""
    tests = [StudyTest(driven(strike(newton), sensors, name=f"beat_{newton}", seed=newton)) for newton in LEVELS_N]
    tests.append(StudyTest(driven(strike(150), sensors, name="truth", seed=9), "truth"))
    return ModalStudy(
        "Beam", beam(*sensors), (SOFT,), tuple(tests), stiffness_order=3, damping_order=2, gain_tolerance=0.0
    )


# ---- from readings to modal accelerations --------------------------------------------------------------


def test_the_second_derivative_of_a_sine_is_exact_but_for_the_ends():
    time = np.arange(400) / 100
    twice = differentiate(3.0 + 2.0 * time + np.sin(9 * time), fs=100.0, times=2)
    np.testing.assert_allclose(twice[40:-40], -81 * np.sin(9 * time)[40:-40], atol=0.5)


def test_the_second_derivative_of_noise_has_no_steps_at_its_ends():
    """A line has omega^4 times the power of white noise; with two first derivatives it would have more than twice."""
    n, powers = 4000, []
    hz = np.fft.rfftfreq(n)
    band = (hz > 0.03) & (hz < 0.06)
    for seed in range(30):
        noise = np.random.default_rng(seed).standard_normal(n)
        ways = differentiate(noise, fs=1.0, times=2), differentiate(differentiate(noise, fs=1.0), fs=1.0)
        powers.append([np.mean(np.abs(np.fft.rfft(each)[band]) ** 2) for each in ways])
    once, twice = np.mean(powers, axis=0) / np.mean((2 * np.pi * hz[band]) ** 4) / n
    assert once == pytest.approx(1.0, abs=0.3)
    assert twice > 2.0


@pytest.mark.parametrize("sensors", [MIXED, (*GAUGES,)])
def test_the_filter_gives_back_the_modes(sensors):
    modes = beam("a", *GAUGES) if sensors == (*GAUGES,) else beam(*sensors)
    modes = elastic(modes) if sensors == (*GAUGES,) else modes
    force = strike(100)
    test = driven(force, sensors, modes, noise=0.0)
    motion = modal_response(NonlinearModalModel(beam("a"), {SOFT: LAW}), force, fs=FS, drive_point="a").acceleration
    motion = motion[:, -modes.n_modes :]
    np.testing.assert_allclose(test.acceleration, motion, atol=5e-3 * np.abs(motion).max())
    assert set(test.units) == {"m/s^2", "strain/s^2"} if sensors == MIXED else {"strain/s^2"}
    assert test.modes.unit("a") == "m/s^2"
    assert (
        test.recording.history[-1]
        == f"{', '.join(each for each in GAUGES if each in sensors)}: strains differentiated twice"
    )


def test_the_weights_do_not_depend_on_the_unit_of_the_shapes():
    """In micrometres for each micrometre of the mode or in strains: the filter of the weighted rows is the same."""
    modes = driven(strike(10), MIXED).modes
    gauges = np.equal(modes.units, "strain/s^2")
    scaled = replace(modes, shapes=modes.shapes * np.where(gauges, 1e-6, 1.0)[:, None])
    assert condition_number(scaled) == pytest.approx(condition_number(modes))
    assert condition_number(modes) < 5
    np.testing.assert_allclose(modal_filter(scaled)[:, gauges], 1e6 * modal_filter(modes)[:, gauges])
    np.testing.assert_allclose(modal_filter(scaled)[:, ~gauges], modal_filter(modes)[:, ~gauges])
    mac = [modal_assurance(weighted_shapes(each)) for each in (modes, scaled)]
    np.testing.assert_allclose(*mac)
    elastic_rms = [np.sqrt(np.mean(weighted_shapes(modes)[own][:, 1:] ** 2)) for own in (gauges, ~gauges)]
    assert elastic_rms[0] == pytest.approx(elastic_rms[1])


def test_sensors_of_one_kind_are_not_weighted():
    motions = beam(*ACCELEROMETERS)
    assert weigh_sensors(motions).tolist() == [1.0] * 5
    np.testing.assert_array_equal(modal_filter(motions), np.linalg.pinv(motions.shapes))
    assert condition_number(motions) == np.linalg.cond(motions.shapes)
    strains = with_sensors(elastic(driven(strike(10), GAUGES, elastic(beam("a", *GAUGES))).modes), (*GAUGES,))
    np.testing.assert_array_equal(modal_filter(strains), np.linalg.pinv(strains.shapes))


def test_noise_is_that_at_the_frequency_of_the_mode():
    """White noise of a strain is blue after two derivatives: a line at f has (2 pi f)^4 times its power."""
    rng, n, std = np.random.default_rng(4), 12288, 1e-9
    modes = elastic(beam("a", *GAUGES))
    given = record(strike(1e-9), GAUGES, noise=0.0)
    samples = given.samples.copy()
    samples[:, :4] = std * rng.standard_normal((n, 4))
    test = modal_test(replace(given, samples=samples), modes, name="t", force="force", drive_point="a")
    lines = mode_lines(test, 1, (80.0, 100.0))
    row = modal_filter(with_sensors(test.modes, test.sensors))[0]
    expected = (2 * np.pi * 90.0) ** 2 * std * np.sqrt(n) * np.sqrt(np.sum(row**2))
    assert lines.noise_inertia == pytest.approx(expected, rel=0.03)
    assert np.sqrt(np.mean(np.abs(lines.inertia) ** 2)) == pytest.approx(expected, rel=0.1)


def test_shapes_of_motions_alone_show_that_they_are_scaled_to_one():
    modes = driven(strike(10), MIXED).modes
    largest = np.abs(modes.shapes[:5]).max(axis=0)
    assert looks_unit_normalised(modes) == ""
    scaled = replace(modes, shapes=modes.shapes / largest * np.r_[np.ones(5), 900.0, 900.0][:, None])
    assert looks_unit_normalised(scaled) == "the largest value of every shape is 1"


# ---- fit and truth test --------------------------------------------------------------------------------


def test_mixed_sensors_give_the_model_that_accelerometers_give():
    mixed, alone = (identify_modes(study(sensors)) for sensors in (MIXED, (*ACCELEROMETERS,)))
    for result in (mixed, alone):
        (fit,) = result.fits
        assert fit.stiffness[3].holds(-9e9)
        assert fit.damping[2].holds(20.0)
        assert fit.misfit == pytest.approx(1.0, abs=0.1)
        assert fit.stiffness[3].std < 5e-4 * 9e9
        assert result.warnings == ()
    (test,) = mixed.truth_tests
    assert test.measured.unit("gauge_1") == test.nonlinear.unit("gauge_1") == "strain/s^2"
    for sensor in ("a", "c", "e"):
        figures, other = test.sensors[sensor], alone.truth_tests[0].sensors[sensor]
        assert figures.nrmse_nonlinear == pytest.approx(other.nrmse_nonlinear, rel=0.2)
    for sensor in ("laser", "ruler", "gauge_1", "gauge_2"):  # whose noise two derivatives raise
        assert test.sensors[sensor].nrmse_nonlinear < 0.15
        assert test.sensors[sensor].nrmse_linear > 2.0


def test_strains_alone_give_the_law_where_they_separate_the_modes():
    modes = elastic(beam("a", *GAUGES))
    tests = [driven(strike(newton), GAUGES, modes, name=f"{newton}", seed=newton) for newton in LEVELS_N]
    fit = fit_mode(tests, SOFT - 1, stiffness_order=3, damping_order=2, gain_tolerance=0.0)
    assert fit.stiffness[3].holds(-9e9)
    assert fit.damping[2].holds(20.0)
    # the noise of second derivatives at the mode is that of 90 Hz, not of the lines above the modes
    assert fit.stiffness[3].std < 5e-4 * 9e9
    assert fit.misfit == pytest.approx(1.0, abs=0.1)
    assert fit.warnings == ()
    with pytest.raises(InputError, match="mode 1 does not move the sensors 'gauge_1'"):
        driven(strike(10), GAUGES, beam("a", *GAUGES))


def test_a_truth_test_compares_strains_without_noise():
    test = driven(strike(150), MIXED, noise=0.0)
    found = truth_test(NonlinearModalModel(test.modes, {SOFT: LAW}), test)
    assert max(each.nrmse_nonlinear for each in found.sensors.values()) < 5e-3


def test_a_simulation_reads_in_the_units_of_its_sensors():
    modes = driven(strike(10), MIXED).modes
    response = simulate(NonlinearModalModel(modes), strike(10), fs=FS, drive_point="a")
    assert [response.unit(each) for each in ("a", "ruler", "gauge_1")] == ["m/s^2", "m/s^2", "strain/s^2"]


def test_a_wrong_sign_of_a_gauge_is_named():
    given = record(strike(100), MIXED)
    samples = given.samples * np.where(np.equal(given.names, "gauge_2"), -1.0, 1.0)
    test = modal_test(replace(given, samples=samples), beam(*MIXED), name="t", force="force", drive_point="a")
    check = check_shapes(test, SOFT, (80.0, 100.0))
    assert check.outside > 0.1
    assert check.cause == "with the opposite sign of 'gauge_2' it would be 0 %"
    assert check_shapes(driven(strike(100), MIXED), SOFT, (80.0, 100.0)).outside < 0.01


def test_a_free_decay_is_followed_by_strains_as_by_accelerations():
    modes = elastic(beam("a", *GAUGES))
    by_strains = decay_of(driven(strike(200), GAUGES, modes), SOFT - 1, start_s=0.9)
    by_motions = decay_of(driven(strike(200), (*ACCELEROMETERS,)), SOFT, start_s=0.9)
    both = [each.frequency_low_hz for each in (by_strains, by_motions)]
    for each in both:
        assert each.holds(FREQUENCY_HZ[SOFT - 1])
    assert by_strains.amplitude[0] == pytest.approx(by_motions.amplitude[0], rel=0.02)


def test_a_level_at_resonance_is_measured_by_strains_and_displacements():
    """Two accelerations of each of the levels are made displacements, and one of these a strain."""
    given = held_study()
    (test,) = given.tests
    whole = test.test.recording
    names = test.test.sensors[-2:]
    samples, channels, shapes = whole.samples.copy(), list(whole.channels), given.modes.shapes.copy()
    for name, unit, factor in zip(names, ("m", "strain"), (1.0, 0.02), strict=True):
        column = whole.index(name)
        spectrum, hz = np.fft.rfft(samples[:, column]), np.fft.rfftfreq(whole.n_samples, 1 / whole.fs)
        spectrum = np.where(hz > 5.0, spectrum / -((2 * np.pi * np.maximum(hz, 5.0)) ** 2), 0.0)
        samples[:, column] = factor * np.fft.irfft(spectrum, whole.n_samples)
        channels[column] = Channel(name, unit)
        shapes[given.modes.sensors.index(name)] *= factor
    modes = replace(given.modes, shapes=shapes)
    changed = replace(whole, samples=samples, channels=tuple(channels))
    own = modal_test(changed, modes, name="levels", force=FORCE, drive_point=given.drive_point)
    found = identify_resonance(replace(given, modes=modes, tests=(StudyTest(own, "resonance", MODE),)))
    requires_truth_inside(found.law)
    before = identify_resonance(given)
    assert found.resonance_hz[-1] == pytest.approx(before.resonance_hz[-1], rel=1e-5)
    assert max(state.outside for state in found.states) < 0.01


# ---- study files ----------------------------------------------------------------------------------------


def test_what_is_written_is_read_back(tmp_path):
    ours = study(MIXED)
    write_study(ours, tmp_path / "study.toml")
    assert sorted(each.name for each in tmp_path.glob("modes*")) == ["modes.npz"]
    back = read_study(tmp_path / "study.toml")
    assert back.modes.units == ours.modes.units == (*("m/s^2",) * 5, *("strain/s^2",) * 2)
    for one, other in zip(ours.tests, back.tests, strict=True):
        np.testing.assert_array_equal(other.test.acceleration, one.test.acceleration)
        assert other.test.readings.channels == one.test.readings.channels
        assert other.test.times_differentiated == (0, 0, 0, 1, 2, 2, 2)


def test_second_derivatives_are_taken_as_they_are(tmp_path):
    given = driven(strike(50), MIXED)
    write_log(given.recording, tmp_path / "derived.csv")
    assert "gauge_1 [strain/s^2]" in (tmp_path / "derived.csv").read_text(encoding="utf-8")
    derived = recording_of(open_log(tmp_path / "derived.csv"))
    test = modal_test(derived, beam(*MIXED), name="t", force="force", drive_point="a")
    np.testing.assert_allclose(test.acceleration, given.acceleration, rtol=0, atol=1e-9)
    assert test.recording is derived
    assert test.units == given.units


def test_a_clipped_displacement_is_seen_before_it_is_differentiated():
    given = record(strike(100), MIXED)
    column = given.index("ruler")
    samples = given.samples.copy()
    samples[:, column] = np.minimum(samples[:, column], 0.5 * samples[:, column].max())
    test = modal_test(replace(given, samples=samples), beam(*MIXED), name="t", force="force", drive_point="a")
    (warning,) = warn_of_records(ModalStudy("clipped", beam(*MIXED), (SOFT,), (StudyTest(test),)))
    assert "of the samples of 'ruler' in test 't' are clipped" in warning


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A folder with modes.csv and beat.csv, whose channels have many units, one of them a voltage."""
    place = tmp_path_factory.mktemp("logs")
    write_modes(beam(*MIXED), place / "modes.csv")
    given = record(strike(50), MIXED)
    raw = np.column_stack([given.time_s, given.samples * [1, 1, 1, 1e3, 1e6, 1e6, 1e6, 1]])
    header = "time [s],a [m/s^2],c [m/s^2],e [m/s^2],laser [mm/s],ruler [µm],bridge [V],gauge_2 [µm/m],force [N]"
    lines = [header, *(",".join(f"{value:.9g}" for value in values) for values in raw)]
    (place / "beat.csv").write_text("\n".join(lines), encoding="utf-8")
    return place


HEAD = '[modes]\nfile = "modes.csv"\ndrive_point = "a"\nnonlinear = [2]\n'
BEAT = '[[tests]]\nlog = "beat.csv"\nforce = "force"\n'


def study_of(place, channels, *, head=HEAD, beat=BEAT):
    path = place / "study.toml"
    path.write_text(f"{head}\n{channels}\n{beat}", encoding="utf-8")
    return read_study(path)


def test_a_study_file_states_the_unit_of_a_gauge(logs):
    stated = study_of(logs, '[channels.gauge_1]\nchannel = "bridge"\nunit = "ustrain"')
    (test,) = stated.tests
    expected = driven(strike(50), MIXED)
    largest = np.abs(expected.acceleration).max()
    np.testing.assert_allclose(test.test.acceleration, expected.acceleration, rtol=0, atol=1e-5 * largest)
    assert stated.modes is not test.test.modes
    assert stated.modes.units == test.test.modes.units


@pytest.mark.parametrize(
    ("channels", "head", "words"),
    [
        (
            'gauge_1 = { channel = "bridge" }',
            HEAD,
            "'gauge_1' of test 'beat' is in V where an acceleration, a velocity",
        ),
        (
            'gauge_1 = { channel = "bridge", unit = "%" }',
            HEAD,
            "is in 1 where an acceleration, a velocity, a displacement",
        ),
        ('gauge_1 = { channel = "bridge", unit = "count" }', HEAD, "is in 1 where an acceleration, a velocity"),
        (
            'gauge_1 = { channel = "bridge", unit = "strain" }',
            HEAD,
            "swings by a strain of .*, and more than 0.05 breaks",
        ),
        (
            'gauge_1 = { channel = "bridge", unit = "ustrain" }',
            HEAD.replace('"a"', '"gauge_2"'),
            "the force acts at 'gauge_2', which reads a strain: name a sensor that reads the motion there",
        ),
    ],
)
def test_what_is_no_strain_is_refused(logs, channels, head, words):
    with pytest.raises(InputError, match=words):
        study_of(logs, f"[channels]\n{channels}", head=head)


def test_a_strain_of_two_hundred_percent_is_refused_and_an_offset_is_not():
    given = record(strike(50), MIXED)
    column = given.index("gauge_1")
    for add, factor in ((2.0, 1.0), (0.0, 2.0 / np.ptp(given.samples[:, column]))):
        samples = given.samples.copy()
        samples[:, column] = add + factor * samples[:, column]
        changed = replace(given, samples=samples)
        if factor == 1.0:
            modal_test(changed, beam(*MIXED), name="t", force="force", drive_point="a")
            continue
        with pytest.raises(InputError, match="'gauge_1' of test 't' swings by a strain of 1, and more"):
            modal_test(changed, beam(*MIXED), name="t", force="force", drive_point="a")


def test_a_sensor_is_of_one_kind_in_all_tests():
    one, given = driven(strike(50), MIXED), record(strike(50), MIXED)
    channels = tuple(Channel(each.name, "m/s^2") if each.name == "gauge_1" else each for each in given.channels)
    other = modal_test(replace(given, channels=channels), beam(*MIXED), name="two", force="force", drive_point="a")
    with pytest.raises(InputError, match=r"'gauge_1' is in strain/s\^2 in test 'beat' and in m/s\^2 in another one"):
        ModalStudy("two kinds", beam(*MIXED), (SOFT,), (StudyTest(one), StudyTest(other)))


def test_a_response_curve_of_a_strain_is_refused():
    curve = ResponseCurve("steps", "gauge_1", [89.0, 90.0], [1.0, 2.0], [80.0, 90.0], 1.0)
    with pytest.raises(InputError, match="curve 'steps' is of 'gauge_1', which reads a strain"):
        ModalStudy("curve", beam(*MIXED), (SOFT,), (StudyTest(driven(strike(50), MIXED)),), curves=(curve,))


def test_strains_of_modes_are_sensors():
    with pytest.raises(InputError, match="strains names 'gage', no sensor of the shapes: did you mean 'gauge'"):
        LinearModes([10.0], [0.01], [[0.3], [0.4]], ("a", "gauge"), ("gage",))
    known = LinearModes([10.0], [0.01], [[0.3], [0.4]], ("a", "gauge"), ("gauge",))
    assert known.units == ("m/s^2", "strain/s^2")
    assert with_sensors(known, ["a"]).units == ("m/s^2",)


# ---- frequency responses --------------------------------------------------------------------------------


def test_a_mode_indicator_counts_strains_like_motions():
    """Where the shapes of the gauges are in other units, the weighted indicator is the same."""
    modes = driven(strike(10), MIXED).modes
    gauges = np.equal(modes.units, "strain/s^2")
    found = []
    for scale in (1.0, 1e6):
        scaled = replace(modes, shapes=modes.shapes * np.where(gauges, scale, 1.0)[:, None])
        response = resynthesised(scaled, np.linspace(50, 300, 20), "a")
        found.append(cmif([weigh_response(response, scaled)]).value)
    np.testing.assert_allclose(*found, rtol=1e-9)


def test_linear_modes_are_found_with_strains_and_displacements():
    pytest.importorskip("sdypy")
    force = np.zeros(16384)
    force[100:106] = np.hanning(8)[1:-1]
    # the beam hangs on soft springs, so that a displacement does not drift
    modes = replace(beam("a"), frequency_hz=[5.0, *FREQUENCY_HZ[1:]], damping_ratio=[0.05, 0.01, 0.01, 0.01])
    records = []
    for newton in (40, 80):
        given = record(newton * force, MIXED, modes=modes, noise=1e-3, seed=newton, linear=True)
        records.append(forced_record(given, name=f"{newton}", force="force", drive_point="a"))
    response = measured_response(records)
    assert response.units == (*("m/s^2",) * 5, *("strain/s^2",) * 2)
    found = fit_modes([response], band_hz=(50.0, 300.0))
    np.testing.assert_allclose(found.modes.frequency_hz, FREQUENCY_HZ[1:3], rtol=1e-5)
    true = beam(*MIXED).shapes[:, 1:3]
    true = true * np.sign(np.sum(true * found.shapes, axis=0))
    np.testing.assert_allclose(found.shapes, true, atol=0.003)
    assert found.modes.units == response.units
    assert found.to_dict()["units"] == [*response.units]
    with pytest.raises(InputError, match="acts at 'gauge_1', which reads a strain"):
        forced_record(given, name="t", force="force", drive_point="gauge_1")
