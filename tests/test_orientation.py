"""Three-axis sensors mounted any way round: the vertical from gravity, rotations between sensors, the study file."""

import json
import math

import cli_runs
import numpy as np
import pytest
from measured_data import measured
from scipy.spatial.transform import Rotation

import opid
from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import LINEAR
from opid.signals.health.gravity import find_orientation
from opid.signals.health.inspection import inspect
from opid.signals.logs import write_log
from opid.signals.orientation import align_sensors, angle_between, follow_attitude, state_orientation
from opid.signals.recording import recording_from_arrays
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Mounting, Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run, taxi_test

FS, AXES = 128.0, ("imu_x", "imu_y", "imu_z")
UP = np.array([0.0, 0.0, 9.80665])


def moving(seed, *, rest_s=6.0, run_s=20.0, braking=0.5):
    """Motion forward, left and up, gravity included, (n, 3): rest, then a run that brakes."""
    rng = np.random.default_rng(seed)
    n_rest, n = round(rest_s * FS), round((rest_s + run_s) * FS)
    motion = rng.standard_normal((n, 3)) * [0.5, 0.5, 1.5] - [braking, 0.0, 0.0]
    motion[:n_rest] = 0.0
    return motion + UP + 0.005 * rng.standard_normal((n, 3))


def inspected(samples, names=AXES, unit="m/s^2"):
    return inspect(recording_from_arrays([*samples.T], list(names), fs=FS, unit=unit))


def degrees_off(found, true):
    return math.degrees(math.acos(np.clip(np.dot(found.vertical, true), -1, 1)))


@pytest.mark.parametrize("seed", range(5))
def test_gravity_at_rest_tells_the_vertical_whichever_way_a_sensor_is_turned(seed):
    turn = Rotation.from_quat(np.random.default_rng([seed, 1]).standard_normal(4))
    found = find_orientation(inspected(turn.inv().apply(moving(seed))), AXES)
    assert found.method == "rest"
    assert found.rest_s == ((0.0, 6.0),)
    assert degrees_off(found, turn.inv().apply([0, 0, 1])) < 0.01
    assert found.gravity_m_per_s2 == pytest.approx(9.807, abs=1e-3)
    assert not found.has_slipped
    levelled = found.level(turn.inv().apply(moving(seed)))
    assert np.allclose(levelled[:, 0], moving(seed)[:, 2] - 9.80665, atol=2e-3)


def test_without_rest_the_mean_is_taken_and_the_interval_holds_the_braking():
    found = find_orientation(inspected(moving(0, rest_s=0.0, braking=0.9)), AXES)
    assert found.method == "mean"
    assert 4.0 < degrees_off(found, [0, 0, 1]) < 2.45 * math.degrees(found.std_rad)


def test_a_reading_other_than_gravity_widens_the_interval():
    sound, off = (find_orientation(inspected(moving(0) * gain), AXES) for gain in (1.0, 1.03))
    assert off.gain_error == pytest.approx(0.03, abs=1e-3)
    assert off.std_rad > 3 * sound.std_rad


def test_a_sensor_that_moved_between_two_rests_is_reported():
    samples = moving(0)
    samples = np.vstack([samples, Rotation.from_euler("x", 3, degrees=True).apply(samples[:768])])
    health = inspected(samples)
    found = health.orientations["imu"]
    assert found.has_slipped
    assert math.degrees(found.moved_rad) == pytest.approx(3.0, abs=0.05)
    assert found.std_rad > math.radians(1.5)
    assert "3.0 degrees between the first and the last rest" in next(
        each.message for each in health.findings if each.code == "sensor_moved"
    )


@pytest.mark.parametrize(
    ("samples", "names", "axes", "words"),
    [
        (moving(0) - UP, AXES, AXES, "the sensor is AC-coupled; state its upward direction"),
        (moving(0) + 9.0, AXES, AXES, "false offset"),
        (moving(0) * [1, 1, 0] + [0, 0, 1], AXES, AXES, "is mute, so it is no axis"),
        (moving(0), AXES, AXES[:2], "give three different channels"),
        (moving(0), AXES, (*AXES[:2], "imu_w"), "was not inspected"),
    ],
)
def test_what_is_no_three_axis_sensor_is_refused(samples, names, axes, words):
    with pytest.raises(InputError, match=words):
        find_orientation(inspected(samples, names), axes)


def test_an_axis_that_is_no_acceleration_is_refused():
    with pytest.raises(InputError, match="is in rad/s: give three accelerations"):
        find_orientation(inspected(moving(0), unit=["m/s^2", "rad/s", "m/s^2"]), AXES)


@pytest.mark.parametrize("vertical", [[0, 0], [0, 0, 0], [0, 0, math.nan]])
def test_a_stated_vertical_is_a_direction(vertical):
    with pytest.raises(InputError, match="give"):
        state_orientation(AXES, vertical)


def test_a_gyroscope_tells_the_attitude_and_its_zero_does_not_matter():
    t = np.arange(0, 20, 1 / FS)
    pitch = 0.03 * np.sin(2 * np.pi * 0.7 * t)
    readings = Rotation.from_rotvec(np.outer(pitch, [0, 1, 0])).inv().apply(np.tile([1.0, 0.0, 9.80665], (t.size, 1)))
    rates = np.outer(np.gradient(pitch, t), [0, 1, 0]) + np.array([0.01, 0.02, 0.3])
    level = state_orientation(AXES, [0, 0, 1], std_rad=0.01)
    assert np.std(level.level(readings)[:, 0]) > 0.02
    attitude = follow_attitude(rates, fs=FS, vertical=level.vertical)
    assert np.std(level.level(readings, attitude)[:, 0]) < 0.002
    with pytest.raises(InputError, match="give an array"):
        follow_attitude(rates[:, :2], fs=FS, vertical=level.vertical)
    with pytest.raises(InputError, match="degrees of roll and pitch, and at most 30 are accepted: check their unit"):
        follow_attitude(np.degrees(rates), fs=FS, vertical=level.vertical)


def slow(n_directions, seed=0):
    """Slow motion of a body in some directions, (n, 3)."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.standard_normal((round(60 * FS), 3)), axis=0) / FS
    walk[:, n_directions:] = 0.0
    return walk


@pytest.mark.parametrize("seed", range(3))
def test_a_shared_motion_tells_how_two_sensors_are_turned(seed):
    turn = Rotation.from_quat(np.random.default_rng([seed, 2]).standard_normal(4))
    noise = 0.001 * np.random.default_rng([seed, 3]).standard_normal((2, round(60 * FS), 3))
    motion = slow(3, seed)
    found = align_sensors(motion + noise[0], turn.inv().apply(motion) + noise[1], fs=FS)
    off = (turn.inv() * Rotation.from_matrix(found.rotation)).magnitude()
    assert math.degrees(off) < 0.2
    assert off < 4 * found.std_rad
    assert found.coherence > 0.99


def test_one_line_of_motion_needs_the_verticals():
    turn = Rotation.from_euler("z", 40, degrees=True)
    noise = 0.001 * np.random.default_rng(4).standard_normal((2, round(60 * FS), 3))
    first, second = slow(1) + noise[0], turn.inv().apply(slow(1)) + noise[1]
    with pytest.raises(NotDeterminedError, match="along one line"):
        align_sensors(first, second, fs=FS)
    found = align_sensors(first, second, fs=FS, verticals=([0, 0, 1], [0, 0, 1]))
    assert (turn.inv() * Rotation.from_matrix(found.rotation)).magnitude() < math.radians(0.2)


def test_sensors_that_share_no_motion_are_told_their_coherence():
    with pytest.raises(
        NotDeterminedError, match=r"do not share a motion: their coherence is 0\.\d\d from 0.4 to 2.1 Hz"
    ):
        align_sensors(slow(3, 1), slow(3, 2), fs=FS)
    with pytest.raises(InputError, match="at least 10 s"):
        align_sensors(slow(3)[:100], slow(3)[:100], fs=FS)


def test_inspect_tells_the_orientation(tmp_path):
    turn = Rotation.from_euler("xz", [90, 40], degrees=True)
    shared = moving(0)
    columns = np.hstack([shared, turn.inv().apply(shared)])
    names = [f"{stem}_a{axis}" for stem in ("floor", "wheel") for axis in "xyz"]
    write_log(recording_from_arrays([*columns.T], names, fs=FS), tmp_path / "log.csv")
    done = cli_runs.opid("inspect", str(tmp_path / "log.csv"))
    assert "floor_a: the vertical is (0.000, 0.000, 1.000) in its axes" in done.output.replace("\n             ", " ")
    assert "wheel_a against floor_a: turned by" in done.output.replace("\n             ", " ")
    as_json = json.loads(cli_runs.opid("inspect", str(tmp_path / "log.csv"), "--json").stdout)["logs"][0]
    assert as_json["orientations"]["wheel_a"]["method"] == "rest"
    found = as_json["alignments"][0]
    assert (found["first"], found["second"]) == ("floor_a", "wheel_a")
    assert (turn.inv() * Rotation.from_matrix(found["rotation"])).magnitude() < math.radians(0.2)


def test_the_picture_shows_the_axes_from_the_side():
    turn = Rotation.from_euler("x", 90, degrees=True)
    health = inspected(turn.inv().apply(moving(0)))
    ax = opid.plots.orientation_picture(health).ravel()[0]
    ends = {text.get_text(): text.xy for text in ax.texts}
    assert ends["y"] == pytest.approx((0, 1), abs=0.01)  # the axis that gravity acts along points up
    assert ends["x"] == pytest.approx((1, 0), abs=0.01)
    assert ends["z"] == pytest.approx((0, 0), abs=0.01)
    with pytest.raises(InputError, match="no three-axis sensor"):
        opid.plots.orientation_picture(inspected(moving(0) - UP))


# ---- studies ---------------------------------------------------------------------------------------

TURNS = {"lower_z": (2.0, -1.0, 0.5), "upper_z": (0.3, 1.2, -2.0)}


def mountings(**fields):
    return {name: Mounting(turn, **fields) for name, turn in TURNS.items()}


def taxied(tmp_path, *, sprung="", unsprung="", heavy=None, light=None, ends="", **settings):
    """Write the logs of a taxi test and the study of its owner; return the test and the path of the study."""
    usual = {"duration_s": 16.0, "fs": 128.0, "standstill_s": 6.0, "fore_aft_ratio": 0.3} | settings
    gear = LandingGear(law=LINEAR)
    tests = [
        taxi_test(gear, rng=np.random.default_rng(3), mountings=each or mountings(), **usual) for each in (heavy, light)
    ]
    for name, run in (("heavy", tests[0].heavy), ("light", tests[1].light)):
        write_log(run.recording, tmp_path / f"{name}.csv")
    (tmp_path / "study.toml").write_text(f"""
repeatability = 0.0
[channels.unsprung]
axes = ["lower_x", "lower_y", "lower_z"]
{unsprung}
[channels.sprung]
axes = ["upper_x", "upper_y", "upper_z"]
{sprung}
[[runs]]
name = "heavy"
log = "heavy.csv"
mass_change_kg = 0
[[runs]]
name = "light"
log = "light.csv"
mass_change_kg = {tests[0].mass_change_kg}
{ends}
""")
    return tests[0], tmp_path / "study.toml"


def test_a_study_of_three_axes_gives_the_vertical_motion_and_what_leaks_in(tmp_path):
    test, path = taxied(tmp_path)
    study = opid.read_study(path)
    run = study.runs[0]
    assert run.recording.start_s == 6.0
    true = test.heavy.truth.section(6.0)
    for side, channel in (("sprung", "upper_z"), ("unsprung", "lower_z")):
        assert degrees_off(run.orientations[side], mountings()[channel].vertical) < 0.1
        error = run.recording.channel(side) - true.channel(channel)
        assert np.std(error) < 0.01
    leaks = study.leaks()
    assert [leak[0] for leak in leaks] == [f"{side}_across_{k}" for side in ("unsprung", "sprung") for k in (1, 2)]
    assert all(tolerance == pytest.approx(run.orientations["sprung"].std_rad, rel=0.1) for *_, tolerance in leaks)
    assert study.sensor_facts().sprung[0].gain_tolerance == 0.0
    assert any(f.code == "orientation" and f.channel == "sprung" for f in run.findings)


def test_the_mass_of_sensors_at_any_angle(tmp_path):
    test, path = taxied(tmp_path, heavy=mountings(zeros_m_per_s2=(0.03, -0.02, 0.02)))
    result = opid.identify(opid.read_study(path), law="linear")
    mass = result.parameters.sprung_mass_kg
    assert mass.holds(test.heavy.gear.sprung_mass_kg)
    assert mass.value == pytest.approx(test.heavy.gear.sprung_mass_kg, rel=0.01)


def test_a_study_of_three_axes_is_written_and_read_back(tmp_path):
    study = opid.read_study(taxied(tmp_path)[1])
    (tmp_path / "copy").mkdir()
    opid.write_study(study, tmp_path / "copy" / "study.toml")
    copy = opid.read_study(tmp_path / "copy" / "study.toml")
    assert copy.leaks() == study.leaks()
    assert np.allclose(copy.runs[0].recording.channel("sprung"), study.runs[0].recording.channel("sprung"), atol=1e-5)


def test_sensors_that_were_bent_between_runs_have_their_own_leaks_in_each(tmp_path):
    bent = {
        name: Mounting(tuple((Rotation.from_euler("y", 1, degrees=True) * Rotation.from_rotvec(turn)).as_rotvec()))
        for name, turn in TURNS.items()
    }
    test, path = taxied(tmp_path, light=bent)
    study = opid.read_study(path)
    assert len(study.leaks()) == 8
    assert not study.runs[1].recording.channel("sprung_across_1 of heavy").any()
    assert study.runs[0].recording.channel("sprung_across_1 of heavy").any()
    assert any("1.0 degrees from that of another run" in each.message for each in study.runs[0].findings)
    mass = opid.identify(study, law="linear").parameters.sprung_mass_kg
    assert mass.holds(test.heavy.gear.sprung_mass_kg)


def test_a_gain_that_gravity_shows_is_fitted(tmp_path):
    _, path = taxied(tmp_path, heavy=mountings(gains=(1.02, 1.02, 1.02)), light=mountings(gains=(1.02, 1.02, 1.02)))
    facts = opid.read_study(path).sensor_facts()
    assert facts.sprung[0].gain_tolerance == pytest.approx(0.02, abs=2e-3)


def test_a_gyroscope_takes_the_pitch_out(tmp_path):
    pitching = {"pitch_rad_s2_per_m": 0.05, "upper_sensor": Sensor(noise_m_per_s2=1e-4)}
    with_rates = mountings(gyroscope_rad_per_s=0.0005)
    errors = []
    for key in ("", 'gyroscope = ["upper_rate_x", "upper_rate_y", "upper_rate_z"]'):
        test, path = taxied(tmp_path, sprung=key, heavy=with_rates, light=with_rates, **pitching)
        run = opid.read_study(path).runs[0].recording
        assert run.start_s == 6.0
        true = test.heavy.truth.section(6.0).channel("upper_z")
        others = np.stack([true, run.channel("sprung_across_1"), run.channel("sprung_across_2")], axis=1)
        own = run.channel("sprung") - run.channel("sprung").mean()
        left = own - others @ np.linalg.lstsq(others - others.mean(axis=0), own, rcond=None)[0]
        errors.append(np.std(left))
    assert errors[1] < 0.5 * errors[0]


def test_ac_coupled_sensors_need_their_vertical(tmp_path):
    coupled = {side: Sensor(corner_hz=0.2) for side in ("lower_sensor", "upper_sensor")}
    _, path = taxied(tmp_path, **coupled)
    with pytest.raises(InputError, match=r"'unsprung': the axes .* AC-coupled; state its upward direction") as caught:
        opid.read_study(path)
    assert str(caught.value).count("AC-coupled") == 2  # one for each run
    stated = {
        side: f"vertical = {mountings()[channel].vertical.tolist()}\ntilt_tolerance_deg = 1.5"
        for side, channel in (("sprung", "upper_z"), ("unsprung", "lower_z"))
    }
    study = opid.read_study(taxied(tmp_path, **stated, **coupled)[1])
    assert study.runs[0].orientations["sprung"].method == "stated"
    assert {tolerance for *_, tolerance in study.leaks()} == {math.radians(1.5)}


def test_a_stated_vertical_that_gravity_contradicts_is_reported(tmp_path):
    study = opid.read_study(taxied(tmp_path, sprung="vertical = [0, 0, 1]")[1])
    codes = [each.code for each in study.runs[0].findings if each.channel == "sprung"]
    assert "false_vertical" in codes


def test_an_axis_may_have_a_table_of_its_own(tmp_path):
    _, path = taxied(tmp_path, ends="[channels.upper_y]\nsign = -1\nscale = 1.1\n")
    own = opid.read_study(path).runs[0]
    _, path = taxied(tmp_path)
    plain = opid.read_study(path).runs[0]
    one, other = (np.array(each.orientations["sprung"].vertical) for each in (own, plain))
    assert one / one[0] == pytest.approx(other / other[0] * [1, -1.1, 1], rel=0.02)
    assert own.recording.names == plain.recording.names


def test_rates_that_are_no_angular_rates_are_refused(tmp_path):
    with_rates = mountings(gyroscope_rad_per_s=0.001)
    key = 'gyroscope = ["upper_rate_x", "upper_rate_y", "upper_rate_z"]'
    unit = '[channels.upper_rate_y]\nunit = "g"\n'
    with pytest.raises(InputError, match=r"rate 'sprung.rate_y' is in m/s.2: give angular rates"):
        opid.read_study(taxied(tmp_path, sprung=key, ends=unit, heavy=with_rates, light=with_rates)[1])


def test_two_telephones_call_their_axes_alike(tmp_path):
    _, path = taxied(tmp_path)
    for name in ("heavy", "light"):
        whole = opid.read_log(tmp_path / f"{name}.csv")
        for stem in ("lower", "upper"):
            columns = [whole.channel(f"{stem}_{axis}") for axis in "xyz"]
            phone = recording_from_arrays(columns, ["ax", "ay", "az"], fs=whole.fs)
            write_log(phone, tmp_path / f"{name}_{stem}.csv")
    text = path.read_text()
    for stem in ("lower", "upper"):
        axes = f'axes = ["{stem}_x", "{stem}_y", "{stem}_z"]'
        on_one_clock = "shift_tolerance_s = 0"
        text = text.replace(axes, f'axes = ["ax", "ay", "az"]\nfile = "{{run}}_{stem}.csv"\n{on_one_clock}')
    one = opid.read_study(path)
    path.write_text(text)
    two = opid.read_study(path)
    for side in ("sprung", "unsprung"):
        assert np.allclose(one.runs[0].recording.channel(side), two.runs[0].recording.channel(side), atol=1e-6)


def test_what_is_left_of_the_clocks_of_two_telephones_is_fitted(tmp_path):
    """Their match names the axes of a telephone; the lag and the drift that are fitted are those of its vertical."""
    _, path = taxied(tmp_path)
    for name in ("heavy", "light"):
        whole = opid.read_log(tmp_path / f"{name}.csv")
        for stem in ("lower", "upper"):
            columns = [whole.channel(f"{stem}_{axis}") for axis in "xyz"]
            write_log(recording_from_arrays(columns, list("xyz"), fs=whole.fs), tmp_path / f"{name}_{stem}.csv")
    text = path.read_text()
    for stem in ("lower", "upper"):
        axes = f'axes = ["{stem}_x", "{stem}_y", "{stem}_z"]'
        text = text.replace(axes, f'axes = ["x", "y", "z"]\nfile = "{{run}}_{stem}.csv"')
    path.write_text(text)
    clocks = opid.read_study(path).sensor_facts().clocks
    assert [(each.run_name, each.side) for each in clocks] == [("heavy", "sprung"), ("light", "sprung")]
    assert all(1e-4 < each.lag_std_s < 0.02 for each in clocks)


def test_one_sensor_of_an_aircraft_has_three_axes(tmp_path):
    run = taxi_run(
        default_aircraft(),
        rng=np.random.default_rng(1),
        duration_s=12.0,
        fs=128.0,
        standstill_s=6.0,
        mountings={"left_upper_z": Mounting((3.0, 0.5, 0.1))},
    )
    write_log(run.recording, tmp_path / "run.csv")
    interfaces = "".join(
        f'[[interfaces]]\nname = "{gear.name}"\nsprung = "{gear.name}_upper_z"\nunsprung = "{gear.name}_lower_z"\n'
        f"x_m = {gear.x_m}\ny_m = {gear.y_m}\n"
        for gear in run.airframe.gears
    )
    axes = ["left_upper_x", "left_upper_y", "left_upper_z"]
    channels = f"[channels.left_upper_z]\naxes = {axes}\n"
    (tmp_path / "study.toml").write_text(f'{interfaces}{channels}[[runs]]\nname = "run"\nlog = "run.csv"\n')
    study = opid.read_study(tmp_path / "study.toml")
    recording = study.runs[0].recording
    true = run.truth.section(recording.start_s, recording.start_s + recording.duration_s).channel("left_upper_z")
    assert np.std(recording.channel("left_upper_z") - true) < 0.02 * np.std(true)
    left = next(each for each in study.interfaces if each.name == "left")
    assert [leak.into for leak in left.facts.leaks] == ["sprung", "sprung"]


@pytest.mark.parametrize(
    ("sprung", "words"),
    [
        ("sign = -1", "'sign' and axes are given: gravity tells which way is up"),
        ("vertical = [0, 1]", "give the upward direction in the axes"),
        ("tilt_tolerance_deg = 0", "give a positive angle"),
        ('gyroscope = ["a", "a", "b"]', "give three different channels"),
        ('unit = "kg"', "give three accelerations"),
    ],
)
def test_wrong_keys_of_a_sensor_are_refused(tmp_path, sprung, words):
    _, path = taxied(tmp_path, sprung=sprung)
    with pytest.raises(InputError, match=words):
        opid.read_study(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"lower_x", "lower_y", "lower_z"', '"lower_x", "lower_y"', "axes is .*: give three different channels"),
        ('axes = ["lower_x", "lower_y", "lower_z"]', "vertical = [0, 0, 1]", "has 'vertical' and no axes"),
        ("repeatability = 0.0", 'axis = "down"', "three axes, whose vertical motion counts up: give the axis 'up'"),
        ('log = "light.csv"', 'log = "light.csv"\nchannels = { sprung = "upper_z" }', "one channel in others"),
        ('log = "light.csv"', 'log = "light.csv"\nchannels.sprung = { sign = -1 }', "'sign' and axes are given"),
    ],
)
def test_wrong_studies_of_sensors_are_refused(tmp_path, old, new, words):
    _, path = taxied(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        opid.read_study(path)


# ---- a horizontal motion -----------------------------------------------------------------------------


def shaken(tmp_path, *, heading_deg=(25.0, -140.0), across=0.2, axis="horizontal", blank=0, ends=""):
    """Write the log of a frame on a shake table, whose sensors are turned about the vertical, and its study."""
    rng, t = np.random.default_rng(5), np.arange(0.0, 40.0, 1 / FS)
    noise = np.convolve(rng.standard_normal(t.size), np.hanning(9) / 4.5, "same")
    table = np.where(t < 3.0, 0.0, noise + np.sin(2 * np.pi * 1.3 * t))
    aside = across * np.convolve(np.where(t < 3.0, 0.0, rng.standard_normal(t.size)), np.hanning(60) / 12, "same")
    frequency_hz = np.fft.rfftfreq(t.size, 1 / FS)
    swing = (1 + 0.1j * frequency_hz / 8.0) / (1 - (frequency_hz / 8.0) ** 2 + 0.1j * frequency_hz / 8.0)
    top = np.fft.irfft(np.fft.rfft(table) * swing, t.size)
    columns, names = [], []
    for name, motion, heading in zip(("lower", "upper"), (table, top), heading_deg, strict=True):
        motions = np.stack([motion, aside, np.full(t.size, 9.80665)], axis=1)
        turned = Rotation.from_euler("zx", [heading, 4.0], degrees=True).inv().apply(motions)
        turned = turned + 2e-3 * rng.standard_normal(turned.shape)
        turned[:blank] = 0.0
        columns += [*turned.T]
        names += [f"{name}_{letter}" for letter in "xyz"]
    write_log(recording_from_arrays(columns, names, fs=FS, unit="m/s^2"), tmp_path / "log.csv")
    (tmp_path / "study.toml").write_text(f"""
axis = "{axis}"
[channels.unsprung]
axes = ["lower_x", "lower_y", "lower_z"]
[channels.sprung]
axes = ["upper_x", "upper_y", "upper_z"]
[[runs]]
name = "run"
log = "log.csv"
mass_change_kg = 0
{ends}
""")
    return tmp_path / "study.toml", table, top


def test_the_direction_of_a_horizontal_motion_is_that_of_the_motion_that_both_sensors_share(tmp_path):
    path, table, top = shaken(tmp_path)
    study = opid.read_study(path)
    (run,) = study.runs
    below, above = (run.orientations[side] for side in ("unsprung", "sprung"))
    for found, heading in ((below, 25.0), (above, -140.0)):
        true = Rotation.from_euler("zx", [heading, 4.0], degrees=True).inv().apply([1.0, 0.0, 0.0])
        assert math.degrees(math.acos(min(1.0, abs(np.dot(found.along, true))))) < 1.0
    first = round(run.recording.start_s * FS)
    for side, true in (("unsprung", table), ("sprung", top)):
        read = run.recording.channel(side)
        assert abs(np.corrcoef(read, true[first : first + read.size])[0, 1]) > 0.999
    # One sign in both, although the sensors point in opposite directions.
    assert run.recording.channel("unsprung") @ table[first : first + read.size] > 0 or (
        run.recording.channel("sprung") @ top[first : first + read.size] < 0
    )
    tolerances = {channel: tolerance for channel, *_, tolerance in study.leaks()}
    assert tolerances["unsprung_across_1"] < tolerances["sprung_across_1"] < math.radians(3.0)
    assert any("it is turned by" in finding.message for finding in run.findings)


def test_a_frame_on_a_table_is_identified_from_sensors_at_any_angle(tmp_path):
    result = opid.identify(opid.read_study(shaken(tmp_path)[0]), law="linear")
    assert result.ratios.natural_frequency_hz.holds(8.0)
    assert result.ratios.natural_frequency_hz.std < 0.05
    assert result.ratios.damping_ratio.holds(0.05)


def test_rows_in_which_a_sensor_had_not_read_anything_are_left_out(tmp_path):
    run = opid.read_study(shaken(tmp_path, blank=2, ends="start_s = 0")[0]).runs[0]
    assert run.recording.start_s == pytest.approx(2 / FS)
    assert any("2 row(s) at its ends are left out" in finding.message for finding in run.findings)


@pytest.mark.parametrize(
    ("across", "old", "new", "words"),
    [
        (4.0, "", "", "times tells the direction of the motion: give the axis that points along it"),
        (0.2, 'axes = ["upper_x", "upper_y", "upper_z"]', 'channel = "upper_x"', "give the axes of both sensors"),
        (0.2, '"horizontal"', '"down"', "give the axis 'up', or 'horizontal' for one suspension"),
    ],
)
def test_horizontal_motions_without_a_direction_are_refused(tmp_path, across, old, new, words):
    path, *_ = shaken(tmp_path, across=across)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match=words):
        opid.read_study(path)


# ---- measured records ------------------------------------------------------------------------------

WOBBLE = {"passenger_knuckle": 1, "driver_knuckle": 7, "passenger_axle": 13, "driver_axle": 19}


def test_the_sensors_of_a_shake_table_are_turned_alike_in_all_records():
    """The frame was not touched between three records; one sensor is turned against the other by 7 degrees."""
    records = sorted(measured("shake_table_frame").glob("Stiff_1_story*.npz"))
    assert len(records) == 3
    found = []
    for record in records:
        data = np.load(record)
        n = min(len(data[f"{floor}_floor_acc"]) for floor in ("ground", "top"))
        names = [f"{floor}_{axis}" for floor in ("ground", "top") for axis in "xyz"]
        columns = [data[f"{floor}_floor_acc"][20:n, k] for floor in ("ground", "top") for k in range(3)]
        found.append(inspect(recording_from_arrays(columns, names, fs=120.0)))
    for health in found[1:]:
        for floor in ("ground", "top"):
            one, other = (each.orientations[floor] for each in (found[0], health))
            assert math.degrees(angle_between(one, other)) < 0.5
            assert other.method == "rest"
        turns = [Rotation.from_matrix(each.alignments[0].rotation) for each in (found[0], health)]
        assert math.degrees((turns[0].inv() * turns[1]).magnitude()) < 0.5
        assert math.degrees(turns[0].magnitude()) == pytest.approx(6.7, abs=0.3)


def test_the_sensors_of_a_vehicle_tilt_together_between_two_days():
    """On the second day the vehicle stood or braked 2 degrees otherwise, which the intervals hold, in three sensors."""
    days = []
    for path in sorted(measured("wobble_landcruiser").glob("*_sensors.csv")):
        table = np.loadtxt(path, delimiter=",")
        names = [f"{stem}_{axis}" for stem in WOBBLE for axis in "xyz"]
        columns = [0.000488296 * 9.80665 * table[:, first + k] for first in WOBBLE.values() for k in range(3)]
        days.append(inspect(recording_from_arrays(columns, names, fs=117.0)))
    alike = ("passenger_knuckle", "driver_knuckle", "driver_axle")
    tilts = []
    for stem in alike:
        one, other = (day.orientations[stem] for day in days)
        tilts.append(math.degrees(angle_between(one, other)))
        assert angle_between(one, other) < 2 * math.hypot(one.std_rad, other.std_rad)
    assert max(tilts) - min(tilts) < 0.5
    assert "passenger_axle" in days[0].orientations
    refused = next(
        each for each in days[1].findings if each.code == "no_orientation" and each.channel == "passenger_axle"
    )
    assert "false offset" in refused.message
