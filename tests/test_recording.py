"""A recording is a sound, read-only value."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from opid.errors import InputError
from opid.signals.recording import Channel, Recording, recording_from_arrays

UPPER = (Channel("upper_z", "m/s^2"),)


def ramp(n_samples=100, fs=50.0, start_s=0.0):
    return recording_from_arrays(
        [np.arange(n_samples), -np.arange(n_samples)], ["lower_z", "upper_z"], fs=fs, start_s=start_s
    )


def test_channels_by_name():
    run = ramp()
    np.testing.assert_array_equal(run.channel("upper_z"), -np.arange(100))
    assert run.unit("upper_z") == "m/s^2"
    assert run.names == ("lower_z", "upper_z")


def test_the_time_axis():
    run = ramp(n_samples=5, fs=10.0, start_s=2.0)
    np.testing.assert_allclose(run.time_s, [2.0, 2.1, 2.2, 2.3, 2.4])
    assert run.duration_s == 0.5


def test_the_samples_are_a_read_only_copy():
    source = np.zeros((10, 1))
    run = Recording(source, fs=1.0, channels=UPPER)
    source[:] = 1.0
    assert not run.samples.any()
    with pytest.raises(ValueError, match="read-only"):
        run.samples[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        run.channel("upper_z")[0] = 1.0


@pytest.mark.parametrize(
    ("samples", "fs", "channels", "words"),
    [
        (np.zeros(10), 1.0, UPPER, "n_samples, n_channels"),
        (np.zeros((10, 2)), 1.0, UPPER, "one column for each channel"),
        (np.zeros((10, 0)), 1.0, (), "one column for each channel"),
        (np.zeros((1, 1)), 1.0, UPPER, "at least two"),
        (np.zeros((10, 1)), 0.0, UPPER, "that of a recorder is 0.0001 to"),
        (np.zeros((10, 1)), np.nan, UPPER, "that of a recorder is 0.0001 to"),
        (np.zeros((10, 2)), 1.0, UPPER * 2, "'upper_z' stands 2 times"),
        (np.array([[0.0], [np.nan]]), 2.0, UPPER, "'upper_z' has 1 value.* first at 0.5000 s"),
    ],
)
def test_what_is_no_recording_is_refused(samples, fs, channels, words):
    with pytest.raises(InputError, match=words):
        Recording(samples, fs=fs, channels=channels)


def test_an_unknown_channel_names_the_nearest():
    with pytest.raises(InputError, match="did you mean 'upper_z'"):
        ramp().channel("uper_z")


def test_arrays_of_different_lengths_are_refused():
    with pytest.raises(InputError, match="one length"):
        recording_from_arrays([[0.0, 1.0], [0.0]], ["a", "b"], fs=1.0)


def test_one_unit_for_all_arrays_or_one_for_each():
    arrays, names = [[0.0, 1.0], [2.0, 3.0]], ["tip", "force"]
    assert [each.unit for each in recording_from_arrays(arrays, names, fs=1.0, unit="m").channels] == ["m", "m"]
    run = recording_from_arrays(arrays, names, fs=1.0, unit=("m/s^2", "N"))
    assert (run.unit("tip"), run.unit("force")) == ("m/s^2", "N")
    with pytest.raises(InputError, match="2 arrays and 3 units"):
        recording_from_arrays(arrays, names, fs=1.0, unit=["m", "m", "N"])
    with pytest.raises(InputError, match="2 arrays and 1 names"):
        recording_from_arrays(arrays, ["tip"], fs=1.0)
    with pytest.raises(InputError, match="unit holds None"):
        recording_from_arrays(arrays, names, fs=1.0, unit=["m/s^2", None])


@given(first=st.integers(0, 90), length=st.integers(2, 9), start_s=st.floats(-100, 100))
def test_a_section_takes_the_samples_from_start_to_before_stop(first, length, start_s):
    run = ramp(start_s=start_s)
    part = run.section(round(start_s + first / 50, 3), round(start_s + (first + length) / 50, 3))
    np.testing.assert_array_equal(part.channel("lower_z"), np.arange(first, first + length))
    assert part.start_s == pytest.approx(start_s + first / 50)
    assert part.history != run.history


def test_a_section_without_bounds_is_the_whole_run():
    np.testing.assert_array_equal(ramp().section().samples, ramp().samples)


def test_a_section_outside_the_run_is_refused():
    with pytest.raises(InputError, match=r"runs from 0 s to 1\.98 s"):
        ramp().section(start_s=3.0)
