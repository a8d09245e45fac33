"""A real operational log with real faults becomes sound recordings through the study file of docs/logs.md alone."""

import re
from pathlib import Path

import numpy as np
import pytest

from opid.identify.study_file import read_study

ROOT = Path(__file__).parents[1]
LOGS = ROOT.parent / "shared" / "data" / "wobble_landcruiser"
G = 9.80665


@pytest.fixture(scope="module")
def axle(tmp_path_factory):
    if not LOGS.is_dir():
        pytest.skip("the measured logs are not here")
    directory = tmp_path_factory.mktemp("axle")
    (text,) = re.findall(r"```toml\n(title = \"Solid front axle.*?)```", (ROOT / "docs" / "logs.md").read_text(), re.S)
    for log in LOGS.glob("*_sensors.csv"):
        (directory / log.name).symlink_to(log)
    (directory / "study.toml").write_text(text)
    return read_study(directory / "study.toml")


def test_the_rate_is_that_of_the_slope_and_one_for_both_runs(axle):
    # independently: (rows - 1) over (last stamp - first), 116.95 and 117.32
    assert axle.fs == pytest.approx(116.73, abs=0.02)
    first, second = (run.recording for run in axle.runs)
    assert first.fs == second.fs
    assert any("117.349 Hz reconstructed" in line.replace("117.348527", "117.349") for line in second.history)
    assert any("resampled from 117.34" in line for line in second.history)
    assert first.duration_s == pytest.approx(3799 / 116.73, abs=0.1)


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
