"""What a reader is told of a log's health, in words and as JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest
from made_health import channel_of, faulty_health, sound_health
from measured_data import SAMPLES, needs_samples

import opid
from opid.json_values import json_text
from opid.signals.health.inspection import inspect
from opid.signals.health.result import ClockHealth, Finding, Health, PairHealth, SpectralLine
from opid.signals.logs import open_log, write_log
from opid.signals.recording import Channel, Recording


@pytest.fixture(scope="module")
def faulty():
    return faulty_health()


@pytest.fixture(scope="module")
def text(faulty):
    return opid.text(replace(faulty, log="logs/faulty.h5"))


def flat(text):
    """Return a text without its line breaks."""
    return " ".join(text.split())


def row(text, name, number=0):
    """Return the cells of a channel in the table with this number."""
    return [line.split()[1:] for line in text.splitlines() if line.startswith(f"{name} ")][number]


def small(name="upper_z", **more):
    return channel_of(name, np.random.default_rng(0).standard_normal(2000), **more)


def health_with(*channels, **more):
    return Health(500.0, 4.0, 2000, channels, None, (), **more)


def test_a_clock_is_told_in_one_sentence(text):
    assert flat(text).startswith(
        "logs/faulty.h5 (what is in the log, and what is wrong with it) 2 clocks, 6 channels. "
        "Clock: fast: 120 s from 0 s on; 500 Hz from time stamps, jitter 8.3 % of the period (they are rounded to "
        "1 ms); 60000 samples; 2 gaps (the longest 3.5 s, 1755 samples lost); 12 stamps repeated; 1 stamp runs "
        "backward. Clock: slow: 120 s from 0.5 s on; 100 Hz as stated, no time stamps to check it by; 12000 samples. "
    )


def test_the_only_clock_stands_with_the_name_of_the_log():
    said = flat(opid.text(replace(sound_health(), log="run.csv")))
    title = "run.csv (what is in the log, and what is wrong with it) "
    assert said.startswith(f"{title}120 s from 0 s on; 500 Hz from time stamps, jitter 0.02 % of the period")
    assert "no gap." in said


def test_the_rounding_of_numbers_is_no_jitter():
    clock = ClockHealth("", ("upper_z",), 500.0, False, 0.0, 4.0, 2000, jitter=2e-11)
    assert "500 Hz from time stamps, no jitter; 2000 samples" in flat(
        opid.text(replace(health_with(small(), clocks=(clock,)), log="x"))
    )


def test_a_clock_without_a_name_is_told_by_its_channels():
    clocks = tuple(ClockHealth("", names, 500.0, True, 0.0, 4.0, 2000) for names in (("a", "b"), ("c",)))
    said = opid.text(replace(health_with(*map(small, "abc"), clocks=clocks), log="x"))
    assert "Clock: a, ...: 4 s" in said
    assert "Clock: c: 4 s" in said


def test_each_channel_has_its_figures(faulty, text):
    unit, mean, rms, peak, floor, step, drift = row(text, "upper_z")
    channel = faulty.channels[1]
    assert unit == "m/s^2"
    assert float(mean) == pytest.approx(channel.mean, rel=5e-3)
    assert float(rms) == pytest.approx(channel.rms, rel=5e-3)
    assert peak == "4000"
    assert float(floor) == pytest.approx(channel.noise_floor, rel=5e-2)
    assert step == "-"
    assert float(drift) == pytest.approx(channel.drift, rel=5e-2)
    assert row(text, "oil")[-2:] == ["0.062", "0.028"]
    assert row(text, "dead")[-3:] == ["-", "-", "-"]


def test_channels_have_the_numbers_of_their_file(text):
    channels = (small("upper_z", number=12), small("lower_z", number=3))
    said = opid.text(replace(health_with(*channels), log="x"))
    assert [row(said, name)[:2] for name in ("upper_z", "lower_z")] == [["12", "m/s^2"], ["3", "m/s^2"]]
    assert [each["number"] for each in replace(health_with(*channels), log="x").to_dict()["logs"][0]["channels"]] == [
        12,
        3,
    ]
    # where none is known there is no such column
    assert "no." not in text


def test_faults_have_a_table_of_their_own(text):
    assert row(text, "lower_z", 1) == ["-", "2.10%", "-", "-"]
    assert row(text, "upper_z", 1) == ["-", "-", "-", "4"]
    assert row(text, "holed", 1) == ["3000", "-", "4", "s", "-"]
    assert row(text, "dead", 1) == ["-", "-", "mute", "-"]
    assert "missing" not in opid.text(replace(sound_health(), log="run.csv"))


def test_lines_are_named(text):
    assert "Lines: hum: mains, 50 Hz, 0.28 rms; harmonic 2 of the mains (50 Hz), 0.14 rms;" in flat(text)
    assert "23.4 Hz, 0.05 rms." in flat(text)


def test_only_the_strongest_lines_are_told():
    lines = tuple(SpectralLine(10.0 * k, 1.0 / k) for k in range(1, 10))
    said = flat(opid.text(replace(health_with(small(lines=lines)), log="x")))
    assert "60 Hz, 0.17 m/s^2 rms; and 3 weaker." in said
    assert "70 Hz" not in said


def test_peaks_that_may_be_resonances_are_not_called_lines():
    lines = (SpectralLine(3.1, 0.5, resolved=False), SpectralLine(50.0, 0.1, "mains, 50 Hz", 1, resolved=False))
    said = flat(opid.text(replace(health_with(small(lines=lines)), log="x")))
    assert "Lines: upper_z: mains, 50 Hz, 0.1 m/s^2 rms. Peaks: upper_z: 3.1 Hz, 0.5 m/s^2 rms. A peak may" in said


def many(n_clocks=60, n_channels=15):
    """Return the health of a log of very many channels, most of them constant and without a unit."""
    one = small(unit="?")
    names = [[f"topic_{i}/field_{j}" for j in range(n_channels)] for i in range(n_clocks)]
    channels = [replace(one, name=name, mute=True) for own in names for name in own]
    channels[700:703] = [small(f"acc_{axis}", lines=(SpectralLine(10.0, 1.0),)) for axis in "xyz"]
    clocks = [ClockHealth(f"topic_{i}", tuple(own), 5.0, False, 0.0, 4.0, i) for i, own in enumerate(names)]
    findings = [
        Finding("fault", "mute", c.name, f"mute, all samples lie at {i}: check") for i, c in enumerate(channels)
    ]
    findings += [
        Finding("warning", "uneven_steps", "", f"the steps of {c.track!r} scatter by {c.n_samples}%: look")
        for c in clocks
    ]
    return health_with(*channels, clocks=tuple(clocks)), tuple(findings)


def test_a_log_of_very_many_channels_fits_a_page():
    health, findings = many()
    said = opid.text(replace(replace(health, findings=findings), log="x"))
    assert len(said.splitlines()) < 150
    assert "60 clocks, 900 channels" in said
    assert row(said, "topic_59") == ["15", "5", "59", "4", "-"]
    assert "and 20 clocks with fewer samples (--json lists all)" in said
    assert row(said, "acc_x")[0] == "m/s^2"
    assert "and 860 channels more, 897 of all are constant: --json lists all" in flat(said)
    assert "Lines: acc_x: 10 Hz, 1 m/s^2 rms." in said
    assert "Fault: topic_0/field_0: mute, all samples lie at 0: check (likewise topic_0/field_1," in flat(said)
    assert "and 891 more)" in flat(said)
    assert "the steps of 'topic_0' scatter by 0%: look (and 59 times likewise)" in flat(said)


def test_a_few_findings_alike_are_told_one_by_one():
    findings = tuple(Finding("warning", "spikes", name, f"{i} spike(s) of one sample") for i, name in enumerate("abc"))
    said = opid.text(replace(replace(health_with(small()), findings=findings), log="x"))
    assert "Warning: c: 2 spike(s) of one sample" in said
    assert "likewise" not in said


def test_findings_are_alike_by_their_code():
    """Not by their words: remarks of a reader say something else each, with whatever numbers."""
    remarks = [Finding("note", "remark", "", f"line {number} is left out") for number in range(5)]
    drifts = [Finding("note", "drift", f"c{number}", f"drifts {'much ' * number}") for number in range(5)]
    said = opid.text(replace(replace(health_with(small()), findings=(*remarks, *drifts)), log="x"))
    assert all(f"Note: line {number} is left out" in said for number in range(5))
    assert "Note: c0: drifts (likewise c1, c2, c3, c4)" in flat(said)


def test_pairs_tell_lag_and_band(text):
    lines = [line.split() for line in text.splitlines() if line.startswith("lower_z ")]
    assert ["lower_z", "upper_z", "1.950", "0.021", "0.5", "to", "28", "Hz"] in lines
    assert "1 pair of accelerations is not coherent" in text
    assert [line[1] for line in lines].count("dead") == 0


def test_of_many_pairs_the_first_are_told():
    pairs = tuple(PairHealth("a", f"b{i}", 1e-3, 1e-5, (1.0, 2.0)) for i in range(20))
    said = opid.text(replace(health_with(small(), pairs=pairs), log="x"))
    assert "b11" in said
    assert "b12" not in said
    assert "and 8 pairs more (--json lists all)" in said


def test_findings_come_worst_first_and_alike_ones_together(text):
    lines = [line for line in text.splitlines() if line.startswith(("Fault: ", "Warning: ", "Note: "))]
    assert [line.split(":")[0] for line in lines] == ["Fault", "Warning", "Warning", "Note"]
    assert lines[-1] == "Note: upper_z, holed: the mean is gravity: nothing to do."
    assert "'lower_z' looks like the unsprung channel" in text
    assert "Nothing is wrong." not in text
    assert "Nothing is wrong." in opid.text(replace(sound_health(), log="run.csv"))


def test_channels_without_a_unit_are_told_together():
    findings = tuple(Finding("warning", "no_unit", name, f"channel {name!r} states no unit: give it") for name in "ab")
    said = opid.text(replace(replace(health_with(small()), findings=findings), log="x"))
    assert "Warning: a, b: states no unit: give it.\n" in said


@pytest.mark.parametrize(("value", "words"), [(0.9999, "1 s"), (0.0123, "12.3 ms"), (2e-6, "2 µs"), (5e-9, "5 ns")])
def test_times_are_told_in_a_unit_that_needs_no_zeros(value, words):
    clock = ClockHealth("", ("upper_z",), 500.0, False, 0.0, 4.0, 2000, resolution_s=value)
    assert f"rounded to {words})" in flat(opid.text(replace(health_with(small(), clocks=(clock,)), log="x")))


def test_no_fault_or_warning_is_left_out_of_many_findings():
    findings = tuple(
        Finding(severity, "remark", "a", f"{severity} {number}.")
        for severity in ("fault", "warning", "note")
        for number in range(30)
    )
    said = opid.text(replace(replace(health_with(small()), findings=findings), log="x"))
    for number in range(30):
        assert f"fault {number}." in said
        assert f"warning {number}." in said
    assert "note 11." in said
    assert "note 12." not in said
    assert "and 18 notes more (--json lists all)" in said


@pytest.mark.parametrize("length", [6, 30, 70, 300])
def test_the_text_keeps_to_80_columns_with_names_of_any_length(length):
    name = "x" * length
    said = opid.text(replace(health_with(small(name, number=12345), small("upper_z", number=1)), log="run.csv"))
    assert all(len(line) <= 80 for line in said.splitlines() if line != name)
    assert name in said
    assert sum(line.split()[-7:-6] == ["m/s^2"] for line in said.splitlines()) == 2


def test_names_that_would_break_the_screen_are_spelt_out():
    said = opid.text(replace(health_with(small("up\nper\x1b[2J"), small("\udcff")), log="x"))
    assert "up\\nper\\x1b[2J  m/s^2" in said
    assert said.encode()


def test_the_json_has_every_figure_and_no_arrays(faulty):
    document = replace(faulty, log="faulty.h5").to_dict()
    assert json.loads(json_text(document)) == document
    assert document["schema"] == "opid.health/1"
    (log,) = document["logs"]
    assert {"log", "fs", "duration_s", "n_samples", "channels", "looks_unsprung", "findings"} <= set(log)
    assert set(log) == {"log", *Health.__dataclass_fields__} - {"rms_history", "files"}
    assert "overview" not in log["channels"][0]
    assert log["clocks"][0]["gaps"][0] == {"kind": "gap", "start_s": 33.0, "stop_s": 36.5}
    assert log["channels"][2]["lines"][0]["name"] == "mains, 50 Hz"
    assert log["pairs"][1]["lag_s"] is None
    assert log["pairs"][0]["coherent_band_hz"] == [0.5, 28.0]
    # what it is made of is not changed
    assert faulty.channels[0].overview is not None


@needs_samples
@pytest.mark.parametrize("name", ["sample.ulg", "sample_log_small.ulg", "ActTest_009.IDE", "SSX66115.IDE", "MPSTD.uff"])
def test_a_real_file_of_any_logger_is_told_on_a_page(name):
    for needed in ("pyulog", "idelib", "pyuff"):
        pytest.importorskip(needed)
    health = inspect(open_log(SAMPLES / name))
    said = opid.text(replace(health, log=name))
    assert len(said.splitlines()) < 250
    assert json.loads(json_text(replace(health, log=name).to_dict()))["logs"][0]["log"] == name
    if name == "ActTest_009.IDE":
        loudest = next(channel for channel in health.channels if channel.name == "Mic").lines[0]
        assert loudest.frequency_hz == pytest.approx(2791.7, abs=0.5)
        assert loudest.resolved


def test_a_short_record_is_not_called_incoherent(tmp_path):
    """Two seconds give too few averages to tell; one signal in two channels is coherent."""
    rng = np.random.default_rng(0)
    for n, words in ((512, "too short to compare 1 pair of accelerations"), (60000, "coherent band")):
        motion = rng.standard_normal(n)
        samples = np.column_stack([motion, motion + 0.1 * rng.standard_normal(n)])
        path = tmp_path / f"{n}.csv"
        write_log(Recording(samples, 256.0, (Channel("a", "m/s^2"), Channel("b", "m/s^2"))), path)
        said = " ".join(opid.text(inspect(open_log(path))).split())
        assert words in said
        assert "not coherent" not in said
