"""A real operational log with real faults becomes sound recordings through the study file of docs/logs.md alone."""

import re
from pathlib import Path

import numpy as np
import pytest
from measured_data import DATA, measured

from opid.signals.log import ChannelSettings, LogSettings
from opid.signals.logs import read_log
from opid.studies.study_file import read_study

ROOT = Path(__file__).parents[1]
LOGS = DATA / "wobble_landcruiser"
G = 9.80665


@pytest.fixture(scope="module")
def axle(tmp_path_factory):
    directory = tmp_path_factory.mktemp("axle")
    (text,) = re.findall(r"```toml\n(title = \"Solid front axle.*?)```", (ROOT / "docs" / "logs.md").read_text(), re.S)
    for log in measured(LOGS.name).glob("*_sensors.csv"):
        (directory / log.name).symlink_to(log)
    (directory / "study.toml").write_text(text)
    return read_study(directory / "study.toml")


def test_the_rate_is_that_of_the_slope_and_one_for_both_runs(axle):
    raw = np.loadtxt(LOGS / "20211027T145614_sensors.csv", delimiter=",")
    slope = np.polyfit(np.arange(len(raw)), raw[:, 0], 1)[0]
    assert axle.fs == pytest.approx(1 / slope, rel=1e-9)
    first, second = (run.recording for run in axle.runs)
    assert first.fs == second.fs
    assert any(line.startswith("rate 117.348527 Hz reconstructed") for line in second.history)
    assert any("resampled from 117.348527 Hz" in line for line in second.history)


def test_a_section_has_the_rate_of_the_whole(axle):
    settings = LogSettings(names=tuple(f"c{k}" for k in range(25)), time="c0", time_unit="s", clock="reconstructed")
    wanted = {"az": ChannelSettings("c15", unit="g")}
    log = LOGS / "20211027T145614_sensors.csv"
    whole = read_log(log, settings, channels=wanted)
    part = read_log(log, settings, channels=wanted, start_s=5, stop_s=15)
    assert part.fs == whole.fs
    first = round((part.start_s - whole.start_s) * whole.fs)
    np.testing.assert_array_equal(part.samples, whole.samples[first : first + part.n_samples])


def test_gravity_is_where_it_belongs(axle):
    for run in axle.runs:
        for side in ("unsprung", "sprung"):
            assert run.recording.unit(side) == "m/s^2"
            assert run.recording.channel(side).mean() == pytest.approx(G, rel=0.07), (run.name, side)
        assert run.recording.unit("steering") == "rad/s"


def test_values_are_the_counts(axle):
    raw = np.loadtxt(LOGS / "20211027T145614_sensors.csv", delimiter=",")
    first = axle.runs[0].recording
    assert first.n_samples == len(raw)
    np.testing.assert_allclose(first.channel("unsprung"), raw[:, 15] * 16 / 32767 * G, rtol=2e-6)
    np.testing.assert_allclose(first.channel("steering"), np.radians(raw[:, 6] * 2000 / 32767), rtol=2e-6)
