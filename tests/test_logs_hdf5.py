"""HDF5 logs: opid's own layout to the last bit, the layouts of others, and files that lie."""

from contextlib import suppress
from dataclasses import replace

import h5py
import numpy as np
import pytest

from opid.errors import InputError
from opid.signals.log import BLOCK_VALUES, LogSettings
from opid.signals.logs import open_log, read_log, write_log
from opid.signals.recording import Channel, Recording

N, FS = 600, 512.0
RNG = np.random.default_rng(5)
DATA = RNG.standard_normal((N, 3))
RUN = Recording(
    RNG.standard_normal((N, 3)) * 1e-3,
    fs=1 / 0.0037,
    channels=(Channel("lower z [raw]", "m/s^2"), Channel("Rad/ü", "N"), Channel("", "rad/s")),
    start_s=0.1 + 0.2,
    history=("tested", "twice"),
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5"


def described(log):
    return [
        (track.fs, track.n_samples, [(channel.name, channel.unit) for channel in track.channels])
        for track in log.tracks
    ]


# ---- opid's own layout ---------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ["h5", "hdf5", "hdf"])
def test_what_is_written_reads_back_to_the_last_bit(tmp_path, ending):
    path = tmp_path / f"run.{ending}"
    write_log(RUN, path)
    again = read_log(path)
    np.testing.assert_array_equal(again.samples, RUN.samples)
    assert (again.fs, again.start_s, again.channels) == (RUN.fs, RUN.start_s, RUN.channels)


def test_the_layout_is_as_documented(path):
    write_log(RUN, path)
    with h5py.File(path) as file:
        group = file["recording"]
        np.testing.assert_array_equal(group["samples"][()], RUN.samples)
        assert (group.attrs["fs"], group.attrs["start_s"], group.attrs["opid_layout"]) == (RUN.fs, RUN.start_s, 1)
        assert [text.decode() for text in group.attrs["history"]] == list(RUN.history)
        assert [text.decode() for text in group.attrs["names"]] == list(RUN.names)


def test_the_history_is_read_back_before_what_is_done_now(path):
    write_log(RUN, path)
    assert read_log(path).history[: len(RUN.history)] == RUN.history
    many = replace(RUN, history=tuple(f"step {k} " + 200 * "x" for k in range(400)))
    write_log(many, path)
    assert read_log(path).history[:400] == many.history


def test_more_channels_than_rows_and_long_names_read_back(path):
    channels = tuple(Channel(f"{number} {'long ' * 40}", "m") for number in range(400))
    run = Recording(RNG.standard_normal((2, 400)), fs=3.0, channels=channels)
    write_log(run, path)
    again = read_log(path)
    np.testing.assert_array_equal(again.samples, run.samples)
    assert again.channels == channels


def test_several_recordings_in_a_file_stay_apart(path, tmp_path):
    write_log(RUN, tmp_path / "one.h5")
    with h5py.File(path, "w") as file, h5py.File(tmp_path / "one.h5") as one:
        one.copy("recording", file, "heavy")
        one.copy("recording", file, "light")
    log = open_log(path)
    assert [track.name for track in log.tracks] == ["heavy", "light"]
    run = read_log(path, channels=["light/Rad/ü"])
    np.testing.assert_array_equal(run.samples[:, 0], RUN.samples[:, 1])


def test_a_name_that_hdf5_does_not_hold_is_refused(path):
    with pytest.raises(InputError, match="HDF5 does not hold the names"):
        write_log(Recording(np.zeros((3, 1)), fs=1.0, channels=(Channel("a\0b", "N"),)), path)
    assert not path.exists()


@pytest.mark.parametrize(
    ("attribute", "value", "message"),
    [
        ("opid_layout", 2, "has layout 2 of opid, known is 1"),
        ("fs", 0.0, "states a rate of 0 Hz"),
        ("fs", -512.0, "states a rate of -512 Hz"),
        ("fs", np.nan, "states a rate of nan Hz"),
        ("fs", 1e12, r"states a rate of 1e\+12 Hz: give the true one as fs_hz"),
        ("start_s", np.inf, "begins at inf s"),
        ("names", ["a"], r"with 1 name\(s\) and 3 unit\(s\)"),
        ("names", None, r"with 0 name\(s\)"),
        ("fs", None, "states no fs"),
        ("fs", "fast", "states no fs"),
    ],
)
def test_a_header_at_fault_is_found_out(path, attribute, value, message):
    write_log(RUN, path)
    with h5py.File(path, "a") as file:
        del file["recording"].attrs[attribute]
        if value is not None:
            file["recording"].attrs[attribute] = value
    with pytest.raises(InputError, match=message) as raised:
        read_log(path)
    assert "run.h5" in str(raised.value)


# ---- the layouts of others -----------------------------------------------------------------------


def test_datasets_of_one_length_are_channels(path):
    with h5py.File(path, "w") as file:
        file.attrs["sampling_rate"] = FS
        group = file.create_group("taxi")
        for number, unit in enumerate([b"g", "m/s^2"]):
            group[f"a{number}"] = DATA[:, number].astype(np.float32)
            group[f"a{number}"].attrs["units" if number else "unit"] = unit
        group["adc [V]"] = np.arange(N, dtype=np.int16)
        group["range"] = [0.0, 16.0, 2.0]
        group["operator"] = "nobody"
    log = open_log(path)
    assert described(log) == [(FS, N, [("a0", "g"), ("a1", "m/s^2"), ("adc", "V")])]
    (block,) = log.tracks[0].blocks([2, 1], 10, 20)
    np.testing.assert_array_equal(block.samples, np.stack([np.arange(10, 20), DATA[10:20, 1].astype(np.float32)], 1))


@pytest.mark.parametrize("transposed", [False, True])
@pytest.mark.parametrize(("name", "value"), [("fs", FS), ("dt", 1 / FS), ("Fs", [512])])
def test_a_matrix_is_a_channel_a_column(path, transposed, name, value):
    with h5py.File(path, "w") as file:
        file["data"] = DATA.T if transposed else DATA
        file["data"].attrs[name] = value
        file["data"].attrs["units"] = "g"
    log = open_log(path)
    assert described(log) == [(FS, N, [("data_1", "g"), ("data_2", "g"), ("data_3", "g")])]
    (block,) = log.tracks[0].blocks([2, 0], 590, None)
    np.testing.assert_array_equal(block.samples, DATA[590:, [2, 0]])


def test_the_names_say_which_dimension_is_the_time(path):
    with h5py.File(path, "w") as file:
        file["data"] = RNG.standard_normal((20, 30))
        file["data"].attrs.update({"names": [f"s{k} [g]" for k in range(30)], "fs": 10})
    assert open_log(path).tracks[0].n_samples == 20
    assert open_log(path).names[-1] == "s29"


def test_a_dataset_of_times_is_the_stamps(path):
    with h5py.File(path, "w") as file:
        file["a"], file["b"] = DATA[:, 0], DATA[:, 1:]
        file["Time"] = np.arange(N) * 2.0
        file["Time"].attrs["unit"] = "ms"
        file["calibration"] = np.ones(50)
    assert described(open_log(path)) == [(None, N, [("a", None), ("b_1", None), ("b_2", None)])]
    assert read_log(path, LogSettings(unit="g")).fs == 500.0
    assert read_log(path, LogSettings(unit="g", time_unit="s")).fs == 0.5
    assert read_log(path, LogSettings(unit="g", fs_hz=100)).fs == 100.0
    named = LogSettings(unit="g", names=("clock", "p", "q", "r", "s"))
    with pytest.raises(InputError, match="has 4 column"):
        open_log(path, named)
    assert open_log(path, LogSettings(names=("clock", "p", "q [N]", "r"))).names == ("p", "q", "r")


def test_the_time_may_be_named(path):
    with h5py.File(path, "w") as file:
        file["a"], file["clock"] = DATA[:, 0], np.arange(N) / 100
    for time in ("clock", 2):
        assert read_log(path, LogSettings(unit="g", time=time)).fs == 100.0
    with pytest.raises(InputError, match=r"has no time 'clok'.*did you mean 'clock'"):
        open_log(path, LogSettings(time="clok"))


def test_a_group_for_each_sensor_of_one_clock_is_one_track(path):
    with h5py.File(path, "w") as file:
        for number in range(3):
            group = file.create_group(f"sensor {number}")
            group.attrs.update({"fs": FS, "t0": 2.5})
            group["data"] = DATA[:, number]
        file["slow/data"], file["slow/fs"] = DATA[:100, 0], 51.2
    log = open_log(path)
    assert [[channel.name for channel in track.channels] for track in log.tracks] == [
        ["sensor 0", "sensor 1", "sensor 2"],
        ["slow"],
    ]
    assert [(track.fs, track.n_samples, track.start_s) for track in log.tracks] == [(FS, N, 2.5), (51.2, 100, 0.0)]


def test_without_rate_and_stamps_the_rate_is_asked_for(path):
    with h5py.File(path, "w") as file:
        file["a"] = DATA[:, 0]
    with pytest.raises(InputError, match="neither a rate nor time stamps: give fs_hz"):
        read_log(path, LogSettings(unit="g"))
    assert read_log(path, LogSettings(unit="g", fs_hz=50)).fs == 50.0


def test_nothing_but_the_file_itself_is_opened(path, tmp_path):
    write_log(RUN, tmp_path / "other.h5")
    (tmp_path / "raw.bin").write_bytes(DATA.tobytes())
    with h5py.File(path, "w") as file:
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/recording/samples")
        layout = h5py.VirtualLayout((N, 3), dtype="f8")
        layout[:] = h5py.VirtualSource("other.h5", "recording/samples", (N, 3))
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("outside", (N, 3), dtype="f8", external=[(str(tmp_path / "raw.bin"), 0, DATA.nbytes)])
    with pytest.raises(InputError, match=r"only links to data elsewhere \(/elsewhere, /outside, /virtual\), which are"):
        open_log(path)


def test_a_group_that_holds_itself_ends(path):
    with h5py.File(path, "w") as file:
        file["a"] = DATA[:, 0]
        file["a"].attrs["unit"] = "g"
        file.attrs["fs"] = FS
        file["group/loop"] = file["/"]
        file["soft"] = h5py.SoftLink("/a")
    assert described(open_log(path)) == [(FS, N, [("a", "g")])]


def test_types_that_are_no_numbers_are_left_out(path):
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = FS
        file["a"] = DATA[:, 0]
        file["complex"] = DATA[:, 0] + 1j
        file["table"] = np.zeros(N, dtype=[("x", "f8"), ("y", "i4")])
        file["text"] = ["word"] * N
        file["cube"] = np.zeros((4, 4, N))
        file.create_dataset("empty", (0, 3), dtype="f8")
        file["nothing"] = h5py.Empty("f8")
        file["reference"] = file["a"].ref
        file.attrs["reference"] = file["a"].ref
    assert open_log(path).names == ("a",)


# ---- files that lie ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "message"),
    [((10**12,), "its header is damaged"), ((10**12, 2), "header is damaged"), ((4000, 3999), "header is damaged")],
)
def test_a_dataset_that_was_never_written_is_refused(path, shape, message):
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = FS
        file.create_dataset("a", shape, dtype="f8", chunks=(1000, 2)[: len(shape)])
    with pytest.raises(InputError, match=message):
        read_log(path, LogSettings(unit="g"))


def test_more_channels_than_any_logger_has_are_refused(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("a", (10**9, 10**8), dtype="f8", chunks=(1000, 1))
    with pytest.raises(InputError, match="100000000 channels, more than any logger has"):
        open_log(path)


@pytest.mark.parametrize(
    "content", [b"", b"\x89HDF", b"\x89HDF\r\n\x1a\n", b"\x89HDF\r\n\x1a\n" + bytes(5000), b"time,a"]
)
def test_another_file_under_the_name_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"run\.h5"):
        open_log(path)


@pytest.mark.parametrize("part", [0.05, 0.3, 0.5, 0.9, 0.999])
def test_a_file_that_is_cut_off_is_refused(path, part):
    write_log(RUN, path)
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    with pytest.raises(InputError, match=r"no sound HDF5 file.*truncated.*export it again"):
        open_log(path)


def test_bytes_at_random_never_crash_the_reader(path):
    write_log(RUN, path)
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        damaged = content.copy()
        damaged[rng.integers(0, 3000, 12)] = rng.integers(0, 256, 12)
        path.write_bytes(damaged.tobytes())
        with suppress(InputError):
            for track in open_log(path).tracks:
                list(track.blocks())


def test_a_long_log_is_read_in_slices(path):
    n = BLOCK_VALUES // 4 + 1000
    with h5py.File(path, "w") as file:
        file.attrs["fs"] = FS
        file["a"] = np.arange(n, dtype=np.float32)
        file["m"] = np.zeros((n, 4), dtype=np.int8)
    track = open_log(path).tracks[0]
    blocks = [block.samples for block in track.blocks()]
    assert len(blocks) == 2
    np.testing.assert_array_equal(np.concatenate(blocks)[:, 0], np.arange(n))
    assert max(block.size for block in blocks) <= BLOCK_VALUES


def texts_of_any_length(path, **more):
    """A log with names and units of any length, in attributes and in a dataset; return its bytes."""
    with h5py.File(path, "w", **more) as file:
        file.attrs.update({"fs": FS, "units": ["g", "m/s^2"], "note": "x" * 9000})
        for name in ("a", "b"):
            file[name] = DATA[:, 0]
            file[name].attrs["unit"] = "m/s^2"
        file["group/m"] = DATA[:, :2]
        file["group/names"] = ["left", "right"]
    return bytearray(path.read_bytes())


@pytest.mark.parametrize("version", ["earliest", "latest"])
def test_texts_of_any_length_are_read(path, version):
    texts_of_any_length(path, libver=version)
    assert described(open_log(path)) == [
        (FS, N, [("a", "m/s^2"), ("b", "m/s^2")]),
        (FS, N, [("left", None), ("right", None)]),
    ]
