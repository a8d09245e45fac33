"""DataFrames, xarray and SEP 5 dictionaries: what goes out comes back, what is unclear is refused."""

import numpy as np
import pandas
import pytest
import xarray

from opid.errors import InputError
from opid.signals import (
    frame_of,
    recording_from_frame,
    recording_from_sep005,
    recording_from_xarray,
    sep005_of,
    xarray_of,
)
from opid.signals.recording import Channel, Recording

N = 400
RNG = np.random.default_rng(5)
DATA = RNG.standard_normal((N, 2))
TIME = np.arange(N) / 500
G = 9.80665
RUN = Recording(
    DATA, 1 / 0.0037, (Channel("lower z", "m/s^2"), Channel("Rad/ü", "rad/s")), start_s=0.1 + 0.2, history=("tested",)
)
WAYS = [
    (frame_of, recording_from_frame),
    (xarray_of, recording_from_xarray),
    (lambda run: xarray_of(run).T, recording_from_xarray),
    (sep005_of, recording_from_sep005),
]


@pytest.mark.parametrize(("out", "back"), WAYS)
def test_what_goes_out_comes_back_to_the_last_bit(out, back):
    again = back(out(RUN))
    np.testing.assert_array_equal(again.samples, RUN.samples)
    assert (again.fs, again.start_s, again.channels) == (RUN.fs, RUN.start_s, RUN.channels)
    if out is not sep005_of:
        assert again.history == RUN.history


@pytest.mark.parametrize(("out", "back"), WAYS[:2])
def test_what_was_stated_of_the_whole_is_not_believed_of_a_part(out, back):
    part = out(RUN).iloc[100::2] if out is frame_of else out(RUN)[100::2, :]
    again = back(part)
    np.testing.assert_array_equal(again.samples, RUN.samples[100::2])
    assert again.fs == pytest.approx(RUN.fs / 2, rel=1e-9)
    assert again.start_s == pytest.approx(RUN.time_s[100], abs=1e-9)


def test_what_goes_out_may_be_changed():
    frame, array, [channel, _] = frame_of(RUN), xarray_of(RUN), sep005_of(RUN)
    frame.iloc[0, 0] = array[0, 0] = channel["data"][0] = 7.0
    assert RUN.samples[0, 0] == DATA[0, 0]


# ---- pandas --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("index", "start_s"),
    [
        (TIME + 3, 3.0),
        (pandas.Index(TIME * 1e3 + 3000, name="time [ms]"), 3.0),
        (pandas.Index(np.arange(0, 2 * N, 2) + 3000, name="t [ms]"), 3.0),
        (pandas.to_timedelta(TIME + 3, unit="s"), 3.0),
        (pandas.Timestamp("2024-05-01 12:00:00.123456789") + pandas.to_timedelta(TIME, unit="s"), 0.0),
        (pandas.Timestamp("2024-05-01", tz="Europe/Vienna") + pandas.to_timedelta(TIME, unit="s"), 0.0),
    ],
)
def test_every_index_of_times(index, start_s):
    run = recording_from_frame(pandas.DataFrame({"a [g]": DATA[:, 0]}, index=index))
    assert (run.fs, run.start_s, run.channels) == (500.0, start_s, (Channel("a", "m/s^2"),))
    np.testing.assert_array_equal(run.samples[:, 0], DATA[:, 0] * G)
    assert run.history == ("from a DataFrame", "a: g -> m/s^2, times 9.80665")


def test_units_of_a_frame_argument_before_name_before_attributes():
    frame = pandas.DataFrame(DATA, index=TIME, columns=["a [mm]", "b"])
    frame.attrs["units"] = {"a": "km", "b": "g"}
    assert [each.unit for each in recording_from_frame(frame).channels] == ["m", "m/s^2"]
    np.testing.assert_array_equal(recording_from_frame(frame, units={"a": "m"}).channel("a"), DATA[:, 0])
    assert [each.unit for each in recording_from_frame(frame, units="N").channels] == ["N", "N"]


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (pandas.DataFrame({"a [g]": DATA[:, 0]}), "index of the DataFrame is no time"),
        (pandas.DataFrame({"a": DATA[:, 0]}, index=TIME), "channel 'a' states no unit: give `units`"),
        (pandas.DataFrame({"a [furlong]": DATA[:, 0]}, index=TIME), "'a': the unit 'furlong' is not known"),
        (pandas.DataFrame({"a [g]": ["x"] * N}, index=TIME), "'a' does not hold numbers only"),
        (pandas.DataFrame({"a [g]": DATA[:, 0]}, index=["x"] * N), "the time is of type"),
        (pandas.DataFrame({"a [g]": DATA[:, 0]}, index=TIME**2), "sample .*: the time"),
        (pandas.DataFrame({"a [g]": DATA[:, 0]}, index=pandas.Index(TIME, name="t [m]")), "no unit of time"),
        (pandas.DataFrame(DATA, index=TIME, columns=["a [g]", "a [m]"]), "the channel name 'a' stands 2 times"),
        (pandas.DataFrame({"a [g]": [1.0]}, index=[0.0]), r"the time has 1 stamp"),
        (pandas.DataFrame({"a [g]": []}, index=pandas.DatetimeIndex([])), r"the time has 0 stamp"),
        (pandas.DataFrame(index=TIME), "a DataFrame holds no channels"),
        (pandas.DataFrame({"a [g]": np.where(TIME == 0, np.nan, 1)}, index=TIME), "not finite"),
    ],
)
def test_a_frame_at_fault_is_refused(frame, message):
    with pytest.raises(InputError, match=message):
        recording_from_frame(frame)


# ---- xarray --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("time", "start_s"),
    [
        (("time", TIME + 3), 3.0),
        (("time", (TIME + 3) * 1e3, {"units": "ms"}), 3.0),
        (np.datetime64("2024-05-01", "ns") + (TIME * 1e9).astype("m8[ns]"), 0.0),
    ],
)
def test_a_dataset_is_a_channel_a_variable(time, start_s):
    held = {"a": ("time", DATA[:, 0], {"units": "g"}), "b [N]": ("time", DATA[:, 1]), "gain": 2.0}
    run = recording_from_xarray(xarray.Dataset(held, coords={"time": time}))
    assert (run.fs, run.start_s) == (500.0, start_s)
    assert run.channels == (Channel("a", "m/s^2"), Channel("b", "N"))
    np.testing.assert_array_equal(run.samples, DATA * [G, 1])


@pytest.mark.parametrize("units", ["g", {"a": "g", "b": "g"}])
def test_units_of_an_array_in_its_attributes(units):
    coords = {"time": TIME, "channel": ["a", "b"]}
    array = xarray.DataArray(DATA, dims=("time", "channel"), coords=coords, attrs={"units": units})
    np.testing.assert_array_equal(recording_from_xarray(array).samples, DATA * G)
    np.testing.assert_array_equal(recording_from_xarray(array, units="m/s^2").samples, DATA)
    one = xarray.DataArray(DATA[:, 0], dims="time", coords={"time": TIME}, name="z", attrs={"units": "g"})
    assert recording_from_xarray(one).names == ("z",)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (xarray.DataArray(DATA, dims=("time", "channel")), "the array has no time"),
        (xarray.DataArray(DATA, dims=("time", "place"), coords={"time": TIME}), r"dimensions \('time', 'place'\)"),
        (xarray.DataArray(DATA, dims=("time", "channel"), coords={"time": TIME}), "'channel_1' states no unit"),
        (xarray.Dataset(coords={"time": TIME}), "holds no channels"),
    ],
)
def test_an_array_at_fault_is_refused(array, message):
    with pytest.raises(InputError, match=message):
        recording_from_xarray(array)


# ---- SEP 5 ---------------------------------------------------------------------------------------


def channel(**more):
    return {"name": "a", "unit_str": "g", "data": DATA[:, 0], "fs": 500} | more


def test_what_sep_5_asks_for_is_there():
    for each, name in zip(sep005_of(RUN), RUN.names, strict=True):
        assert isinstance(each, dict)
        assert {"name", "unit_str", "data", "fs"} <= set(each)
        assert (each["name"], each["unit_str"], each["fs"]) == (name, RUN.unit(name), RUN.fs)
        assert isinstance(each["data"], np.ndarray)
        assert not set(each) & {"unit", "timestamp", "signal", "sample_frequency", "Fs"}


def test_stamps_in_place_of_a_rate():
    given = [channel(fs=None, time=TIME + 2), channel(name="b", unit_str="N", data=DATA[:, 1], time=TIME + 2)]
    run = recording_from_sep005(given)
    assert (run.fs, run.start_s, run.names) == (500.0, 2.0, ("a", "b"))
    np.testing.assert_array_equal(run.samples, DATA * [G, 1])


def test_channels_of_several_rates_are_brought_to_the_lowest():
    slow = np.sin(2 * np.pi * 3 * np.arange(80) / 100)
    fast = np.sin(2 * np.pi * 3 * TIME)
    run = recording_from_sep005([channel(data=fast), channel(name="b", data=slow, fs=100, start_timestamp=None)])
    assert (run.fs, run.names) == (100.0, ("a", "b"))
    np.testing.assert_allclose(run.channel("a")[10:-10], run.channel("b")[10:-10], atol=0.05 * G)


def test_the_time_of_day_goes_into_the_history():
    run = recording_from_sep005([channel(start_timestamp="2023-06-29T15:00:00.000000")])
    assert run.history[0] == "began 2023-06-29T15:00:00.000000"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (channel(), "is a list of one or more dictionaries"),
        ([], "is a list of one or more dictionaries"),
        ([[1, 2]], "channel 1 is no dictionary"),
        ([channel(), {"name": "b", "data": DATA[:, 0], "fs": 1}], "channel 2 has no key 'unit_str'"),
        ([channel(Fs=3)], "channel 1 has the key 'Fs': SEP 5 writes 'fs'"),
        ([channel(starttimestamp="x")], "'starttimestamp': SEP 5 writes 'start_timestamp'"),
        ([channel(timestamp="x")], "the key 'timestamp', which SEP 5 prohibits"),
        ([channel(fs=None)], "neither `fs` nor `time`"),
        ([channel(unit_str="")], "'a' states no unit"),
        ([channel(fs=0)], "states a rate of 0 Hz"),
        ([channel(fs=1e12)], r"states a rate of 1e\+12 Hz"),
        ([channel(data=DATA)], r"'a' has shape \(400, 2\): give one array"),
        ([channel(data=["x", "y"])], "does not hold numbers only"),
        ([channel(fs=None, time=TIME[:-1])], "'a' has 400 samples, the time 399"),
        ([channel(), channel()], "the channel name 'a' stands 2 times"),
        ([channel(start_timestamp="x"), channel(name="b", start_timestamp="y")], "began at 2 different times of day"),
    ],
)
def test_dictionaries_at_fault_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        recording_from_sep005(given)


@pytest.mark.parametrize("decimals", [None, 3])
def test_a_rate_and_a_time_of_sep_5_must_agree(decimals):
    time = 3 + np.arange(400) / 512
    time = time if decimals is None else np.round(time, decimals)
    run = recording_from_sep005([channel(fs=512, time=time)])
    assert (run.fs, run.start_s) == (512.0, 3.0)
    with pytest.raises(InputError, match=r"channel 'a' states fs 500 Hz, its time is that of 512 Hz"):
        recording_from_sep005([channel(fs=500, time=time)])
    with pytest.raises(InputError, match="sample 8: the time goes back"):
        recording_from_sep005([channel(fs=512, time=np.r_[time[:7], time[:393]])])
    with pytest.raises(InputError, match="'a' has 400 samples, the time 399"):
        recording_from_sep005([channel(fs=512, time=time[:-1])])


def test_a_short_time_on_round_stamps_tells_its_rate():
    with pytest.raises(InputError, match="states fs 100 Hz, its time is that of 50 Hz"):
        recording_from_sep005([channel(data=DATA[:5, 0], fs=100, time=np.arange(5) / 50)])
