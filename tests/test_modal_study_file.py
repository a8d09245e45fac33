"""Study files of modal tests: read back what was written, and everything that is wrong said at once."""

from dataclasses import replace

import numpy as np
import pytest
from made_modal import FS, LAW, SENSORS, SOFT, beat, measured, small_modes, small_study

from opid.errors import InputError
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.identification import identify_modes, warn_of_records
from opid.modal.linear.modes import modal_test
from opid.modal.linear.modes_file import write_modes
from opid.modal.model import NonlinearModalModel, simulate
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.logs import write_log
from opid.signals.recording import Channel, Recording
from opid.studies.study_file import read_study, write_study

MODES = '[modes]\nfile = "modes.csv"\ndrive_point = "case_x"\n'
TEST = '\n[[tests]]\nlog = "beat.csv"\nforce = "force"\n'


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A directory with modes.csv, beat.csv, and decay.csv, the same without a force; not to be changed."""
    place = tmp_path_factory.mktemp("logs")
    write_modes(small_modes(), place / "modes.csv")
    record = measured(beat(5))
    write_log(record, place / "beat.csv")
    write_log(Recording(record.samples[:, :6], fs=record.fs, channels=record.channels[:6]), place / "decay.csv")
    return place


def study_of(place, text, name="study.toml"):
    path = place / name
    path.write_text(text, encoding="utf-8")
    return read_study(path)


def refused(place, text, *words):
    with pytest.raises(InputError) as caught:
        study_of(place, text, "refused.toml")
    for word in words:
        assert word in str(caught.value)
    return str(caught.value)


def test_what_is_written_is_read_back(tmp_path):
    study = small_study()
    write_study(study, tmp_path / "study.toml")
    said = []
    back = read_study(tmp_path / "study.toml", progress=said.append)
    assert said == ["beat_2.csv", "beat_5.csv", "beat_10.csv", "strong.csv"]
    names = ("title", "nonlinear", "drive_point", "stiffness_order", "damping_order", "free_linear")
    assert [getattr(back, name) for name in names] == [getattr(study, name) for name in names]
    assert back.source == tmp_path / "study.toml"
    np.testing.assert_array_equal(back.modes.shapes, study.modes.shapes)
    for ours, theirs in zip(study.tests, back.tests, strict=True):
        assert (ours.test.name, ours.use, ours.mode) == (theirs.test.name, theirs.use, theirs.mode)
        np.testing.assert_allclose(theirs.test.acceleration, ours.test.acceleration, rtol=0, atol=1e-9)
        np.testing.assert_allclose(theirs.test.force, ours.test.force, rtol=0, atol=1e-9)


def test_modes_of_a_test_of_its_own_are_written_and_read(tmp_path):
    modes = small_modes()
    other = replace(modes, frequency_hz=1.01 * modes.frequency_hz)
    tests = (
        StudyTest(modal_test(measured(beat(2)), modes, name="one", force="force", drive_point="case_x"), "fit", SOFT),
        StudyTest(modal_test(measured(beat(5)), other, name="two", force="force", drive_point="case_x"), "fit", SOFT),
    )
    write_study(ModalStudy("shifted", modes, (SOFT,), tests, "case_x"), tmp_path / "study.toml")
    assert (tmp_path / "modes_two.npz").is_file()
    back = read_study(tmp_path / "study.toml")
    assert back.tests[0].test.modes is back.modes
    assert back.tests[1].test.modes is not back.modes


def test_many_samples_are_written_as_hdf5(tmp_path, monkeypatch):
    monkeypatch.setattr("opid.studies.modal_study.LARGEST_CSV", 100)
    study = small_study()
    write_study(study, tmp_path / "study.toml")
    assert (tmp_path / "strong.h5").is_file()
    back = read_study(tmp_path / "study.toml")
    np.testing.assert_array_equal(back.tests[3].test.acceleration, study.tests[3].test.acceleration)


def test_the_use_of_a_test_follows_from_its_force(logs):
    study = study_of(logs, MODES + f"nonlinear = [{SOFT}]\n" + TEST + '\n[[tests]]\nlog = "decay.csv"\n')
    assert [(each.test.name, each.use) for each in study.tests] == [("beat", "fit"), ("decay", "decay")]
    assert study.title == "study"
    assert study.free_linear is None


@pytest.mark.parametrize("inside", [True, False])
def test_orders_stand_in_modes_or_beside_it(logs, inside):
    given = f"nonlinear = [{SOFT}]\nstiffness_order = 3\ndamping_order = 2\nfree_linear = true\n"
    drive = 'drive_point = "case_x"\n'
    file = '[modes]\nfile = "modes.csv"\n'
    study = study_of(logs, (file + drive + given if inside else drive + given + file) + TEST)
    assert (study.nonlinear, study.stiffness_order, study.damping_order, study.free_linear) == ((SOFT,), 3, 2, True)
    assert study.drive_point == "case_x"


@pytest.mark.parametrize("inside", [True, False])
def test_thresholds_stand_in_modes_or_beside_it_and_are_written_where_they_differ(logs, tmp_path, inside):
    given = "frequency_threshold = 0.01\ndamping_threshold = 1\n"
    study = study_of(logs, (MODES + given if inside else given + MODES) + f"nonlinear = [{SOFT}]\n" * inside + TEST)
    assert (study.frequency_threshold, study.damping_threshold) == (0.01, 1)
    write_study(study, tmp_path / "study.toml")
    assert "frequency_threshold = 0.01" in (tmp_path / "study.toml").read_text(encoding="utf-8")
    assert read_study(tmp_path / "study.toml").frequency_threshold == 0.01
    usual = small_study()
    assert (usual.frequency_threshold, usual.damping_threshold) == (0.002, 0.15)
    write_study(usual, tmp_path / "usual.toml")
    assert "threshold" not in (tmp_path / "usual.toml").read_text(encoding="utf-8")


def test_both_places_at_once_are_refused(logs):
    refused(logs, "damping_order = 2\n" + MODES + "damping_order = 3\n" + TEST, "'damping_order'", "give it once")


def test_a_stretch_of_the_log_and_channels_by_other_names(logs, tmp_path):
    record = measured(beat(5))
    names = [f"ch{place}" for place in range(6)] + ["load cell"]
    table = np.column_stack([record.time_s, record.samples[:, :6] / 9.80665, record.samples[:, 6] / 1e3])
    header = ",".join(["time [s]", *names])
    np.savetxt(tmp_path / "raw.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")
    write_modes(small_modes(), tmp_path / "modes.csv")
    channels = "".join(f'{name} = {{ channel = "ch{k}", unit = "g" }}\n' for k, name in enumerate(SENSORS))
    channels += 'force = { channel = "load cell", unit = "kN" }\n'
    text = MODES + f"nonlinear = [{SOFT}]\n[channels]\n{channels}" + TEST.replace("beat", "raw")
    study = study_of(tmp_path, text + "start_s = 0.1\nstop_s = 5.0\n")
    test = study.tests[0].test
    whole = study_of(logs, MODES + f"nonlinear = [{SOFT}]\n" + TEST).tests[0].test
    inside = slice(round(0.1 * whole.fs), None)
    assert test.recording.n_samples == round(4.9 * whole.fs)
    np.testing.assert_allclose(test.force, whole.force[inside][: test.force.size], atol=1e-6)
    np.testing.assert_allclose(test.acceleration, whole.acceleration[inside][: len(test.force)], atol=1e-6)


def test_all_faults_are_said_at_once(logs):
    text = refused(
        logs,
        '[modes]\nfile = "modes.csv"\ndrivepoint = "case_x"\nnonlinear = ["a"]\nfree_linear = 1\n'
        '[[tests]]\nlog = "beat.csv"\nuse = "fitt"\n[[tests]]\nforce = 3\n',
        "'drivepoint'",
        "did you mean 'drive_point'",
        "'nonlinear' in [modes] holds 'a', give a list of whole numbers",
        "'free_linear' in [modes] is 1, give true or false",
        "'use' in [[tests]] number 1 is 'fitt'",
        "'force' in [[tests]] number 2 is 3",
        "[[tests]] number 2 lacks 'log'",
    )
    assert "6 faults" in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ("lacks 'modes'", "lacks 'tests'")),
        (MODES + TEST.replace("beat.csv", "bet.csv"), ("test 'bet'", "did you mean 'beat.csv'")),
        (MODES + TEST.replace('"force"', '"forc"'), ("there is no channel 'forc'", "did you mean 'force'")),
        (MODES.replace("case_x", "case_z") + TEST, ("no sensor 'case_z'",)),
        ('[modes]\nfile = "modes.csv"\n' + TEST, ("lacks 'drive_point'", "'beat'")),
        (MODES.replace("modes.csv", "mode.csv") + TEST, ("mode.csv",)),
        (MODES + "nonlinear = [9]\n" + TEST, ("mode 9", "from 1 to 4")),
        (MODES + "nonlinear = [1]\n" + TEST, ("rigid-body mode",)),
        (MODES + "stiffness_order = 7\n" + TEST, ("stiffness_order is 7",)),
        (MODES + "freelinear = true\n" + TEST, ("unknown key 'freelinear' (did you mean 'free_linear'?)",)),
        (MODES + "damping_threshold = 0\n" + TEST, ("damping_threshold is 0", "give a fraction above 0")),
        (MODES + "frequency_threshold = nan\n" + TEST, ("is nan, give a number",)),
        (MODES + 'frequency_threshold = "0.2 %"\n' + TEST, ("'frequency_threshold' in [modes]", "give a number")),
        (MODES + TEST + 'use = "truth"\n', ("no test to identify from",)),
        (MODES + TEST + TEST, ("2 tests are called 'beat'",)),
        (MODES + "[channels.case_x]\nfile = 'a.csv'\n" + TEST, ("unknown key 'file'",)),
        (MODES + "[channels]\ncase_x = true\n" + TEST, ("'case_x' in [channels] is True",)),
        (MODES + '[channels.force]\nunit = "furlong"\n' + TEST, ("furlong",)),
        (MODES + '[channels.force]\nunit = "g"\n' + TEST, ("force channel 'force'", "m/s^2")),
        (MODES + TEST.replace('"force"', '"case_y"'), ("force channel 'case_y'",)),
        (
            MODES + '[log]\nclock = "sun"\n' + TEST,
            ("'clock' in [log] is 'sun', give one of 'auto', 'stamps', 'own_times', 'reconstructed'",),
        ),
        (MODES + '\n[[tests]]\nlog = "decay.csv"\nuse = "level"\n', ("use = 'level' and no force",)),
        (MODES + TEST + "start_s = 50.0\n", ("test 'beat'",)),
    ],
)
def test_what_is_wrong_is_said(logs, text, words):
    refused(logs, text, *words)


def test_free_decays_need_no_drive_point(logs):
    study = study_of(logs, '[modes]\nfile = "modes.csv"\n[[tests]]\nlog = "decay.csv"\nuse = "decay"\n')
    assert study.drive_point is None
    assert repr(study).startswith(f"ModalStudy: {study.title}\n  mode 1: 0 Hz")


def test_a_log_without_the_sensors_is_refused(logs, tmp_path):
    record = measured(beat(5))
    write_log(Recording(record.samples[:, 6:], fs=record.fs, channels=record.channels[6:]), tmp_path / "beat.csv")
    write_modes(small_modes(), tmp_path / "modes.csv")
    refused(tmp_path, MODES + TEST, "none of the sensors", "[channels]")


def test_a_dead_sensor_is_refused_and_a_clipped_one_is_told(tmp_path):
    record = measured(beat(5))
    write_modes(small_modes(), tmp_path / "modes.csv")
    dead = record.samples.copy()
    dead[:, 2] = 0.125
    write_log(Recording(dead, fs=record.fs, channels=record.channels), tmp_path / "beat.csv")
    refused(tmp_path, MODES + TEST, "'lid_x' is mute")
    limit = 0.5 * np.abs(record.samples[:, 0]).max()
    clipped = record.samples.copy()
    clipped[:, 0] = np.clip(clipped[:, 0], -limit, limit)
    write_log(Recording(clipped, fs=record.fs, channels=record.channels), tmp_path / "beat.csv")
    told = list(warn_of_records(study_of(tmp_path, MODES + f"nonlinear = [{SOFT}]\n" + TEST)))
    assert len(told) == 1
    assert "'case_x' in test 'beat' are clipped" in told[0]


def test_a_sound_study_has_no_warnings():
    assert list(warn_of_records(small_study())) == []


def test_a_name_that_is_no_file_name_is_refused(tmp_path):
    test = modal_test(measured(beat(2)), small_modes(), name="a/b", force="force", drive_point="case_x")
    study = ModalStudy("x", small_modes(), (SOFT,), (StudyTest(test),), "case_x")
    with pytest.raises(InputError, match="one plain word"):
        write_study(study, tmp_path / "study.toml")


def two_shakers(level, *, seed=0, law=LAW):
    """Return what the sensors record under two shakers, of which the second starts later and is weaker."""
    force = np.column_stack([beat(level), 0.6 * np.roll(beat(level, cycles=18), 40)])
    model = NonlinearModalModel(small_modes(), {SOFT: law})
    motion = simulate(model, force, fs=FS, drive_point=("case_x", "lid_y"))
    samples = np.column_stack([motion.samples, force])
    samples = samples + 0.003 * samples.std(axis=0) * np.random.default_rng(seed).standard_normal(samples.shape)
    channels = (*motion.channels, Channel("shaker_1", "N"), Channel("shaker_2", "N"))
    return Recording(samples, fs=FS, channels=channels)


SHAKERS = 'forces = { shaker_1 = "case_x", shaker_2 = "lid_y" }\n'


def test_each_test_has_its_own_drive_points(logs, tmp_path):
    write_modes(small_modes(), tmp_path / "modes.csv")
    for level in (3, 8):
        write_log(two_shakers(level), tmp_path / f"both_{level}.csv")
    write_log(measured(beat(5)), tmp_path / "beat.csv")
    file = '[modes]\nfile = "modes.csv"\n'
    tests = "".join(f'\n[[tests]]\nlog = "both_{level}.csv"\n{SHAKERS}' for level in (3, 8))
    study = study_of(tmp_path, file + f"nonlinear = [{SOFT}]\n" + tests + TEST + 'drive_point = "case_x"\n')
    assert [each.test.drive_points for each in study.tests] == [*2 * [("case_x", "lid_y")], ("case_x",)]
    assert [each.use for each in study.tests] == 3 * ["fit"]
    write_study(study, tmp_path / "back.toml")
    back = read_study(tmp_path / "back.toml")
    for ours, theirs in zip(study.tests, back.tests, strict=True):
        np.testing.assert_allclose(theirs.test.modal_force(SOFT), ours.test.modal_force(SOFT), rtol=0, atol=1e-9)


def test_a_truth_test_has_an_initial_condition(logs, tmp_path):
    write_modes(small_modes(), tmp_path / "modes.csv")
    start = {"displacement": np.array([0.0, 0.0, 2e-4, 0.0]), "velocity": np.array([0.0, 0.0, 0.0, 0.02])}
    model = NonlinearModalModel(small_modes(), {SOFT: LAW})
    motion = simulate(model, beat(5), fs=FS, drive_point="case_x", **start)
    samples = np.column_stack([motion.samples, beat(5)])
    write_log(Recording(samples, fs=FS, channels=(*motion.channels, Channel("force", "N"))), tmp_path / "moves.csv")
    for level in (2, 8):
        write_log(measured(beat(level), seed=level), tmp_path / f"beat_{level}.csv")
    tests = "".join(TEST.replace("beat.csv", f"beat_{level}.csv") for level in (2, 8))
    moves = TEST.replace("beat.csv", "moves.csv") + 'use = "truth"\n'
    given = "displacement = { 3 = 2e-4 }\nvelocity = { 4 = 0.02 }\n"
    orders = f"nonlinear = [{SOFT}]\nstiffness_order = 3\ndamping_order = 2\n"
    study = study_of(tmp_path, MODES + orders + tests + moves + given)
    write_study(study, tmp_path / "back.toml")
    assert read_study(tmp_path / "back.toml").tests[2].displacement == {3: 2e-4}
    missed = [
        max(each.nrmse_nonlinear for each in identify_modes(of).truth_tests[0].sensors.values())
        for of in (study, study_of(tmp_path, MODES + orders + tests + moves))
    ]
    assert missed[0] < 0.02 < 0.3 < missed[1]
    refused(tmp_path, MODES + tests + given, "an initial condition, which a simulation needs")
    refused(tmp_path, MODES + tests + moves + "velocity = { 9 = 0.1 }\n", "initial condition of mode 9, give 1 to 4")


def test_two_shakers_give_the_law_that_was_simulated():
    modes = small_modes()
    force = {"shaker_1": "case_x", "shaker_2": "lid_y"}
    records = {level: two_shakers(level, seed=level) for level in (2, 4, 8)}
    tests = [StudyTest(modal_test(each, modes, name=f"b{level}", force=force)) for level, each in records.items()]
    tests.append(StudyTest(modal_test(two_shakers(7, seed=9), modes, name="truth", force=force), "truth"))
    found = identify_modes(ModalStudy("two shakers", modes, (SOFT,), tests, stiffness_order=3, damping_order=2))
    k3 = found.fits[0].stiffness[3]
    assert abs(k3.value + 1.5e11) < 3 * k3.std
    assert k3.std < 0.03 * 1.5e11
    assert max(each.nrmse_nonlinear for each in found.truth_tests[0].sensors.values()) < 0.03
    alone = [
        modal_test(each, modes, name=f"b{n}", force="shaker_1", drive_point="case_x") for n, each in records.items()
    ]
    only = fit_mode(alone, SOFT, stiffness_order=3, damping_order=2)
    assert only.residual_fraction > 5 * found.fits[0].residual_fraction, "the second shaker counts"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TEST + 'forces = { force = "case_x" }\n', ("has 'force' and 'forces'", "give one")),
        ('\n[[tests]]\nlog = "decay.csv"\ndrive_point = "case_x"\n', ("'drive_point' and no 'force'",)),
        ('\n[[tests]]\nlog = "beat.csv"\nforces = { force = "case_q" }\n', ("test 'beat'", "no sensor 'case_q'")),
        ('\n[[tests]]\nlog = "beat.csv"\nforces = { forze = "case_x" }\n', ("no channel 'forze'",)),
        ('\n[[tests]]\nlog = "beat.csv"\nforces = { force = 3 }\n', ("the name of a sensor in quotes",)),
        (TEST + 'drive_point = "case_q"\n', ("test 'beat'", "no sensor 'case_q'")),
    ],
)
def test_wrong_forces_are_said(logs, text, words):
    refused(logs, MODES + text, *words)


def test_resonance_has_one_force():
    test = modal_test(two_shakers(3), small_modes(), name="both", force={"shaker_1": "case_x", "shaker_2": "lid_y"})
    with pytest.raises(InputError, match="2 forces: one force is in phase"):
        ModalStudy("x", small_modes(), (SOFT,), (StudyTest(test, "resonance", SOFT),))
