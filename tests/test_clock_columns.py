"""A second time, a counter: no signals, unless they are named; what only rises stays a signal."""

import numpy as np
import pytest

from opid.signals.health.inspection import inspect
from opid.signals.log import ChannelSettings
from opid.signals.logs import open_log, read_log

N = 400
T = np.arange(N) / 200
RNG = np.random.default_rng(8)
Z = RNG.standard_normal(N)
WANDERING = 1e3 * np.cumsum(1 + 0.3 * RNG.random(N)) / 200


@pytest.fixture
def log(tmp_path):
    def write(names, *columns):
        path = tmp_path / "run.csv"
        np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=",".join(names), comments="", fmt="%.9g")
        return path

    return write


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("gps_time_s", T + 1000.25),
        ("gps [ms]", np.round(1000 * T) + 7),
        ("sample", np.arange(N)),
        ("counter", 5 + 2.0 * np.arange(N)),
        ("Timestamp", WANDERING),
        ("elapsed [ms]", WANDERING),
        ("rounded", np.round(1.3 * np.arange(N))),
    ],
)
def test_what_runs_with_the_time_is_no_signal(log, name, values):
    path = log(["time [s]", name, "az [m/s^2]"], T, values, Z)
    run = read_log(path)
    assert run.names == ("az",)
    shown = name.split(" [")[0]
    told = f"{shown!r} runs with the time and is not read as a signal: name it if it is one"
    assert told in run.history
    health = inspect(open_log(path))
    assert [channel.name for channel in health.channels] == ["az"]
    assert health.channels[0].number == 2  # as [channels] of a study takes it
    assert told in [each.message for each in health.findings]
    named = read_log(path, channels={"own": ChannelSettings(shown, unit="1")})
    np.testing.assert_allclose(named.channel("own"), values, rtol=1e-8)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("stroke [mm]", 3.0 * T),  # a slow ramp in a unit of its own
        ("valve", np.cumsum(RNG.random(N))),  # rises, but not as a clock
        ("time_of_flight", 2.0 + np.sin(T)),
        ("delay [ms]", np.abs(Z)),
        ("count", np.floor(np.arange(N) / 4)),
    ],
)
def test_what_only_rises_is_a_signal(log, name, values):
    names = open_log(log(["time [s]", name, "az [m/s^2]"], T, values, Z)).signals
    assert names == (name.split(" [")[0], "az")


def test_a_log_of_nothing_but_a_clock_keeps_it(log):
    assert open_log(log(["time [s]", "sample"], T, np.arange(N))).signals == ("sample",)
