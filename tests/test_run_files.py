"""Channels as tables, several recorders, rates and clocks: what a study file makes of the files of a run."""

import numpy as np
import pytest

from opid.errors import InputError
from opid.signals.log import ChannelSettings, LogSettings
from opid.signals.logs import write_log
from opid.signals.recording import recording_from_arrays
from opid.studies.run_files import RunFiles, Source, read_run
from opid.studies.study_file import read_study, write_study
from opid.studies.suspension_study import find_log_readings, study_from_logs
from opid.suspensions.sensor_facts import SensorFacts
from opid.suspensions.settings import RunSettings
from opid.suspensions.study import Run, study_of_gear

NAMES = ["lower_z", "upper_z"]


def log(seed, fs=512.0, n_samples=1024):
    return recording_from_arrays(np.random.default_rng(seed).standard_normal((2, n_samples)), NAMES, fs=fs)


def both_recorders(tmp_path, *, shift_s=0.0, fs=(512.0, 1000.0)):
    """One motion, the wheel in m/s^2 in one file, the airframe in another: counts, upside down, another clock."""
    t = [np.arange(round(20 * rate)) / rate for rate in fs]
    tones = [(1.7, 0.4), (11.3, 1.0), (31.0, 2.0)]
    wheel = sum(np.cos(2 * np.pi * f * t[0] + p) for f, p in tones)
    body = sum(np.cos(2 * np.pi * f * (t[1] + shift_s) + p) for f, p in tones)
    counts = np.round(-body / 9.80665 * 2000)
    write_log(recording_from_arrays([wheel], ["lower_z"], fs=fs[0]), tmp_path / "heavy.csv")
    rows = "".join(f"{stamp:.6f},{count:.0f}\n" for stamp, count in zip(t[1], counts, strict=True))
    (tmp_path / "heavy_airframe.csv").write_text("time [s],az\n" + rows)


MIXED = """\
[channels]
unsprung = "lower_z"

[channels.sprung]
file = "{run}_airframe.csv"
channel = "az"
unit = "g"
scale = 5e-4
sign = -1
shift_s = 0.25
gain_tolerance = 0.02
corner_hz = 0.3

[[runs]]
name = "heavy"
log = "heavy.csv"
mass_change_kg = 0
"""


def test_one_study_mixes_recorders(tmp_path):
    both_recorders(tmp_path, shift_s=0.25)
    (tmp_path / "study.toml").write_text(MIXED)
    taxi = read_study(tmp_path / "study.toml")
    assert (taxi.unsprung, taxi.sprung) == ("lower_z", "sprung")
    run = taxi.runs[0].recording
    assert run.fs == 512.0
    assert run.start_s == 0.25
    # the same motion once in each sensor: equal but for the counts
    assert np.abs(run.channel("sprung") - run.channel("lower_z"))[200:-200].max() < 0.02
    assert any("resampled from 1000 Hz to 512 Hz" in line for line in run.history)
    assert any("shifted by 0.25 s" in line for line in run.history)
    assert taxi.interfaces[0].facts.sprung == SensorFacts(gain_tolerance=0.02, corner_hz=0.3)
    assert taxi.interfaces[0].facts.unsprung == SensorFacts()


def test_a_run_may_differ_and_the_rate_may_be_asked_for(tmp_path):
    both_recorders(tmp_path)
    (tmp_path / "heavy_airframe.csv").rename(tmp_path / "other.csv")
    text = (
        "fs_hz = 256\n"
        + MIXED.replace("shift_s = 0.25\n", "shift_tolerance_s = 0\n")
        + '[runs.channels.sprung]\nfile = "other.csv"\n'
    )
    (tmp_path / "study.toml").write_text(text)
    taxi = read_study(tmp_path / "study.toml")
    assert taxi.fs == 256.0
    run = taxi.runs[0].recording
    assert np.abs(run.channel("sprung") - run.channel("lower_z"))[200:-200].max() < 0.02


def test_runs_of_two_rates_are_put_at_the_lower_one(tmp_path):
    write_log(log(0, fs=512.0, n_samples=4096), tmp_path / "heavy.csv")
    write_log(log(1, fs=500.0, n_samples=4000), tmp_path / "light.csv")
    taxi = study_from_logs(
        [tmp_path / "heavy.csv", tmp_path / "light.csv"], sprung="upper_z", unsprung="lower_z", mass_changes_kg=[-220]
    )
    assert [run.recording.fs for run in taxi.runs] == [500.0, 500.0]
    assert taxi.runs[0].recording.history[-1] == "resampled from 512 Hz to 500 Hz"
    np.testing.assert_array_equal(taxi.runs[1].recording.samples, log(1, fs=500.0, n_samples=4000).samples)


def test_fast_runs_are_reduced(tmp_path):
    write_log(log(0, fs=5000.0, n_samples=20000), tmp_path / "heavy.csv")
    taxi = study_from_logs([tmp_path / "heavy.csv"], sprung="upper_z", unsprung="lower_z", mass_changes_kg=[])
    assert taxi.fs == 500.0
    assert "resampled from 5000 Hz to 500 Hz" in taxi.runs[0].recording.history
    files = RunFiles("heavy", {name: Source(tmp_path / "heavy.csv", ChannelSettings(name)) for name in NAMES}, 0.0)
    for settings, fs in ((RunSettings(reduced_above_hz=6000.0), 5000.0), (RunSettings(reduced_to_hz=1000.0), 1000.0)):
        assert read_run(files, settings=settings).recording.fs == fs


def test_settings_for_inspect(tmp_path):
    shared = '[log]\nclock = "reconstructed"\nnames = ["t", "az"]\n'
    light = (
        '[[runs]]\nname = "light"\nlog = "heavy.csv"\nmass_change_kg = -220\n'
        "[runs.channels.sprung]\noffset = 0.5\nlog = { fs_hz = 100 }\n"
    )
    (tmp_path / "study.toml").write_text(shared + MIXED + light)
    source = tmp_path / "study.toml"
    study_says = LogSettings(names=("t", "az"), clock="reconstructed")
    (tmp_path / "elsewhere").mkdir()

    # a file of two runs is read as the first says; no log needs to be there, and any path to it will do
    (wheel,) = find_log_readings(source, tmp_path / "elsewhere" / ".." / "heavy.csv")
    assert (wheel.settings, wheel.channels) == (study_says, {"lower_z": ChannelSettings("lower_z")})
    assert wheel.runs == ("heavy", "light")
    # the second recorder's, with and without what a run changes of it
    (body,) = find_log_readings(source, tmp_path / "heavy_airframe.csv")
    assert (body.settings, body.runs) == (study_says, ("heavy",))
    assert (body.channels["sprung"].scale, body.channels["sprung"].offset) == (5e-4, 0.0)
    (body,) = find_log_readings(source, tmp_path / "light_airframe.csv")
    assert (body.settings, body.runs) == (LogSettings(fs_hz=100), ("light",))
    assert body.channels["sprung"].offset == 0.5
    (other,) = find_log_readings(source, tmp_path / "other.csv")
    assert (other.settings, other.channels, other.runs) == (study_says, None, ())
    # what no file can be called is no log of this name either
    source.write_text(MIXED.replace('"heavy.csv"', r'"\u0000.csv"'))
    assert find_log_readings(source, tmp_path / "heavy.csv")[0].runs == ()
    source.write_text(MIXED.replace("sign = -1", "sign = 3"))
    with pytest.raises(InputError, match=r"study.toml: \[channels.sprung\]: sign is 3"):
        find_log_readings(source, tmp_path / "heavy.csv")


def test_a_file_that_is_read_in_two_ways_has_two_readings(tmp_path):
    text = MIXED.replace('file = "{run}_airframe.csv"\n', "log = { fs_hz = 100 }\n")
    (tmp_path / "study.toml").write_text(text)
    wheel, body = find_log_readings(tmp_path / "study.toml", tmp_path / "heavy.csv")
    assert (wheel.settings, list(wheel.channels)) == (LogSettings(), ["lower_z"])
    assert (body.settings, list(body.channels)) == (LogSettings(fs_hz=100), ["sprung"])
    (tmp_path / "study.toml").write_text(text + "[runs.channels]\nunsprung = 3\n")
    assert find_log_readings(tmp_path / "study.toml", tmp_path / "heavy.csv")[0].channels == {
        "lower_z": ChannelSettings(3)
    }


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("scale = 5e-4", "scal = 5e-4", r"\[channels.sprung\] has an unknown key 'scal' .did you mean 'scale'"),
        ("scale = 5e-4", "scale = 0.0", "scale is 0.0: give a finite number other than 0"),
        ('unit = "g"', 'unit = "parsec"', "the unit 'parsec' is not known"),
        ('unit = "g"', "", "channel 'az' states no unit"),
        ("sign = -1", "sign = 2", "sign is 2: give 1 or -1"),
        (
            'unsprung = "lower_z"',
            "unsprung = 3",
            "there is no channel number 3 in .*heavy.csv: it has 1",
        ),
        ("[channels]", '[log]\nclok = "stamps"\n[channels]', r"\[log\] has an unknown key 'clok'"),
        (
            "[channels]",
            "[sensors.sprung]\ncorner_hz = 0.2\n[channels]",
            "'corner_hz' stands in .channels.sprung. and in",
        ),
        ("{run}_airframe", "{run}_airfram", "there is no file .*heavy_airfram.csv: did you mean 'heavy_airframe.csv'"),
        ("shift_s = 0.25", "shift_s = 100.0", "share no time"),
    ],
)
def test_what_is_wrong_with_a_channel_is_named(tmp_path, old, new, words):
    both_recorders(tmp_path)
    assert old in MIXED
    (tmp_path / "study.toml").write_text(MIXED.replace(old, new))
    with pytest.raises(InputError, match=words):
        read_study(tmp_path / "study.toml")


# ---- what must not be lost on the way to one clock ------------------------------------------------------


def noisy(fs, seconds, seed=0):
    rng = np.random.default_rng(seed)
    return np.convolve(rng.standard_normal(round(fs * seconds) + 50), np.hanning(51), mode="valid")


def test_spikes_are_mended_before_a_filter_can_smear_them(tmp_path):
    sound = [noisy(5000.0, 20.0, seed) for seed in (0, 1)]
    spiky = [sound[0], sound[1].copy()]
    spiky[1][np.arange(30) * 3000 + 1000] += 400.0
    for name, arrays in (("sound", sound), ("spiky", spiky)):
        write_log(recording_from_arrays(arrays, ["lower_z", "upper_z"], fs=5000.0), tmp_path / f"{name}.csv")
    sides = {"sprung": "upper_z", "unsprung": "lower_z", "mass_changes_kg": []}
    clean, mended = (study_from_logs([tmp_path / f"{name}.csv"], **sides).runs[0] for name in ("sound", "spiky"))
    assert mended.recording.fs == 500.0
    departure = mended.recording.samples - clean.recording.samples
    assert np.abs(departure).max() < 0.01 * clean.recording.samples.std()
    assert "upper_z: 30 spike(s) mended" in mended.recording.history
    assert any("30 spike(s)" in f.message or "30 spikes" in f.message for f in mended.findings)


def test_clipping_in_a_chosen_stretch_is_told_although_the_rate_falls(tmp_path):
    lower = np.clip(noisy(5000.0, 20.0), -8.0, 8.0)
    write_log(
        recording_from_arrays([lower, noisy(5000.0, 20.0, 1)], ["lower_z", "upper_z"], fs=5000.0), tmp_path / "a.csv"
    )
    text = '[channels]\nunsprung = "lower_z"\nsprung = "upper_z"\n'
    text += '[[runs]]\nname = "a"\nlog = "a.csv"\nmass_change_kg = 0\n'
    (tmp_path / "study.toml").write_text(text + "start_s = 1\nstop_s = 19\n")
    findings = read_study(tmp_path / "study.toml").runs[0].findings
    assert any(f.channel == "lower_z" and "clipped" in f.message for f in findings)


def test_a_study_with_a_standstill_and_a_third_channel_reads_back_whole(tmp_path):
    still = np.zeros(5120) + 1e-3 * np.random.default_rng(0).standard_normal(5120)
    arrays = [np.concatenate([still, noisy(512.0, 20.0, seed)]) for seed in range(3)]
    whole = recording_from_arrays(arrays, [*NAMES, "lower_x"], fs=512.0)
    taxi = study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=(Run("a", whole, 0.0),))
    write_study(taxi, tmp_path / "study.toml")
    back = read_study(tmp_path / "study.toml").runs[0].recording
    assert back.names == ("lower_z", "upper_z", "lower_x")
    np.testing.assert_array_equal(back.samples, taxi.runs[0].recording.samples)


def test_settings_of_one_recorder_do_not_rule_another(tmp_path):
    both_recorders(tmp_path, fs=(512.0, 1000.0))
    text = "[log]\nfs_hz = 512\n" + MIXED.replace("shift_s = 0.25\n", "shift_tolerance_s = 0\nlog = {}\n")
    (tmp_path / "study.toml").write_text(text)
    run = read_study(tmp_path / "study.toml").runs[0].recording
    assert np.abs(run.channel("sprung") - run.channel("lower_z"))[200:-200].max() < 0.02


def test_dated_logs_share_their_time(tmp_path):
    t = np.arange(10240) / 512.0
    x = np.cos(2 * np.pi * 1.7 * t) + np.cos(2 * np.pi * 9.1 * t)
    for name, late in (("heavy", 0.0), ("heavy_airframe", 0.5)):
        stamps = np.datetime64("2026-05-01T12:00:00.000000") + np.round(1e6 * (t + late)).astype("timedelta64[us]")
        values = np.cos(2 * np.pi * 1.7 * (t + late)) + np.cos(2 * np.pi * 9.1 * (t + late))
        column = "lower_z" if name == "heavy" else "az"
        rows = "".join(f"{stamp},{value:.9f}\n" for stamp, value in zip(stamps, values, strict=True))
        (tmp_path / f"{name}.csv").write_text(f"time,{column} [g]\n{rows}")
    text = MIXED.replace("shift_s = 0.25\n", "").replace("scale = 5e-4\n", "").replace("sign = -1\n", "")
    (tmp_path / "study.toml").write_text(text)
    run = read_study(tmp_path / "study.toml").runs[0].recording
    assert run.start_s == pytest.approx(0.5)
    assert np.abs(run.channel("sprung") - run.channel("lower_z"))[200:-200].max() < 1e-3 * 9.8 * x.std()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("fs_hz = 0\n" + MIXED, "'fs_hz' in the study is 0, give a positive rate"),
        (MIXED + "[runs.channels.sprung]\ngain_tolerance = 0.05\n", "'gain_tolerance' stands in .runs.channels"),
        (MIXED.replace("[[runs]]", "[channels.third]\nchannel = 1\ncorner_hz = 1\n[[runs]]"), "'corner_hz' stands"),
        (MIXED.replace("[[runs]]", "[channels.lower_z]\nchannel = 1\n[[runs]]"), "are both called"),
        (MIXED.replace("sign = -1", "sign = 3"), r"\[channels.sprung\]: sign is 3"),
        ("[log]\nnames = [1, 2]\n" + MIXED, r"'names' in \[log\] holds 1, give a list of names"),
        (MIXED + "start_s = nan\n", r"'start_s' in \[\[runs\]\] 'heavy' is nan, give a number"),
        (
            MIXED.replace('"lower_z"', "{channel = 1}").replace('"az"', '"lower_z"')
            .replace('file = "{run}_airframe.csv"\n', "").replace("shift_s = 0.25\n", ""),
            "'unsprung' and 'sprung' are both channel",
        ),
    ],
)  # fmt: skip
def test_silent_guesses_are_refused(tmp_path, text, words):
    both_recorders(tmp_path)
    (tmp_path / "study.toml").write_text(text)
    with pytest.raises(InputError, match=words):
        read_study(tmp_path / "study.toml")


def two_recorders(tmp_path, *, body_starts_s, motion=None):
    """A wheel and a body that moves alike, each with its own log, whose times both begin at zero."""
    fs = 128.0
    shaking = np.convolve(np.random.default_rng(0).standard_normal(6000), np.hanning(7), "same")
    shaking = shaking if motion is None else motion(np.arange(6000) / fs)
    first = round(body_starts_s * fs)
    write_log(recording_from_arrays([shaking], ["lower_z"], fs=fs), tmp_path / "heavy.csv")
    write_log(recording_from_arrays([shaking[first:]], ["az"], fs=fs), tmp_path / "heavy_airframe.csv")
    study = MIXED.replace("shift_s = 0.25\n", "").replace("scale = 5e-4\n", "").replace("sign = -1\n", "")
    (tmp_path / "study.toml").write_text(study.replace('unit = "g"\n', ""))
    return tmp_path / "study.toml"


def test_recorders_without_a_stated_shift_are_matched(tmp_path):
    run = read_study(two_recorders(tmp_path, body_starts_s=3.25)).runs[0]
    (match,) = run.clocks
    assert match.channels == ("sprung",)
    assert match.offset_s == pytest.approx(3.25, abs=1e-3)
    assert np.std((run.recording.channel("sprung") - run.recording.channel("lower_z"))[50:-50]) < 0.05
    assert any(line == match.sentence for line in run.recording.history)
    codes = {finding.code for finding in run.findings}
    assert "matched_clocks" in codes
    assert not codes & {"several_recorders", "unknown_start"}


def test_a_stated_tolerance_of_zero_keeps_the_times_and_a_stated_one_limits_the_search(tmp_path):
    source = two_recorders(tmp_path, body_starts_s=3.25)
    text = source.read_text()
    source.write_text(text.replace("gain_tolerance", "shift_tolerance_s = 0\ngain_tolerance"))
    run = read_study(source).runs[0]
    assert run.clocks == ()
    assert "several_recorders" in {finding.code for finding in run.findings}
    source.write_text(text.replace("gain_tolerance", "shift_s = 3.0\nshift_tolerance_s = 0.5\ngain_tolerance"))
    (match,) = read_study(source).runs[0].clocks
    assert match.offset_s == pytest.approx(0.25, abs=1e-3)


def test_recorders_that_cannot_be_matched_are_refused(tmp_path):
    source = two_recorders(tmp_path, body_starts_s=3.25, motion=lambda t: np.sin(2 * np.pi * 1.7 * t))
    with pytest.raises(InputError, match="because the motion is periodic"):
        read_study(source)


@pytest.mark.parametrize(("key", "value"), [("shift_tolerance_s", -1), ("drift_tolerance_ppm", 1e6)])
def test_impossible_tolerances_of_clocks_are_named(tmp_path, key, value):
    source = two_recorders(tmp_path, body_starts_s=1.0)
    source.write_text(source.read_text().replace("gain_tolerance", f"{key} = {value}\ngain_tolerance"))
    with pytest.raises(InputError, match=f"{key} is {value}: give 0 to"):
        read_study(source)
