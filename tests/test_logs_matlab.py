"""MATLAB files of all versions: the rules by which signals are found, and files that are at fault."""

import struct
import zlib
from contextlib import suppress

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from opid.errors import InputError
from opid.signals.log import BLOCK_VALUES, LogSettings
from opid.signals.logs import open_log, read_log

N, FS = 600, 512.0
RNG = np.random.default_rng(5)
DATA = RNG.standard_normal((N, 3))
TIME = np.arange(N) / 100


def cells(*texts):
    return np.array(texts, dtype=object)


def save_73(path, variables):
    """Write as MATLAB 7.3 does: matrices transposed, texts as 16-bit numbers, cells as references, a block before."""

    def put(group, name, value):
        if isinstance(value, dict):
            own = group.create_group(name)
            own.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, each in value.items():
                put(own, key, each)
            return own
        if isinstance(value, str):
            codes = np.frombuffer(value.encode("utf-16-le"), dtype=np.uint16).reshape(-1, 1)
            own = group.create_dataset(name, data=codes)
            own.attrs["MATLAB_class"] = np.bytes_("char")
            return own
        value = np.asarray(value)
        if value.dtype == object:
            refs = [put(group.file.require_group("#refs#"), f"{name}{k}", each).ref for k, each in enumerate(value)]
            own = group.create_dataset(name, data=np.array(refs, dtype=h5py.ref_dtype)[:, np.newaxis])
            own.attrs["MATLAB_class"] = np.bytes_("cell")
            return own
        matrix = value.reshape(-1, 1) if value.ndim < 2 else value
        own = group.create_dataset(name, data=matrix.T)
        own.attrs["MATLAB_class"] = np.bytes_("double")
        return own

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            put(file, name, value)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + struct.pack("<H", 0x0200) + b"IM")


def save_5(path, variables):
    savemat(path, variables)


def save_7(path, variables):
    savemat(path, variables, do_compression=True, oned_as="column")


def save_4(path, variables):
    savemat(path, variables, format="4")


every = pytest.mark.parametrize("save", [save_4, save_5, save_7, save_73])
structs = pytest.mark.parametrize("save", [save_5, save_7, save_73])


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mat"


def described(log):
    return [
        (track.fs, track.n_samples, sorted((channel.name, channel.unit) for channel in track.channels))
        for track in log.tracks
    ]


def values(log, name):
    track, column = log.find(name)
    return np.concatenate([block.samples[:, 0] for block in track.blocks([column])])


@every
def test_a_vector_of_times_and_what_has_its_length(path, save):
    save(path, {"t": TIME, "az": DATA[:, 0], "M": DATA, "side": DATA.T, "range": np.arange(5.0), "g": 9.81})
    log = open_log(path)
    names = ["M_1", "M_2", "M_3", "az", "side_1", "side_2", "side_3"]
    assert described(log) == [(None, N, [(name, None) for name in names])]
    np.testing.assert_array_equal(values(log, "az"), DATA[:, 0])
    np.testing.assert_array_equal(values(log, "M_2"), DATA[:, 1])
    np.testing.assert_array_equal(values(log, "side_3"), DATA[:, 2])
    run = read_log(path, LogSettings(unit="g"), channels=["az", "side_3"])
    assert run.fs == 100.0
    np.testing.assert_array_equal(run.channel("side_3"), DATA[:, 2] * 9.80665)


@every
@pytest.mark.parametrize(("name", "value"), [("fs", FS), ("Fs", FS), ("srate", FS), ("dt", 1 / FS), ("Ts", 1 / FS)])
def test_a_rate_or_an_interval(path, save, name, value):
    save(path, {name: value, "data": DATA, "limits": [0.0, 1.0]})
    assert described(open_log(path)) == [(FS, N, [("data_1", None), ("data_2", None), ("data_3", None)])]


@structs
def test_names_and_units(path, save):
    save(path, {"Fs": FS, "data": DATA.T, "names": cells("a", "b", "c [g]"), "units": cells("m/s^2", "N", "")})
    assert described(open_log(path)) == [(FS, N, [("a", "m/s^2"), ("b", "N"), ("c", "g")])]


@structs
def test_a_struct_with_the_usual_fields(path, save):
    save(path, {"run": {"time": TIME * 1e3, "data": DATA, "names": cells("time [ms]", "a", "b", "c"), "units": "g"}})
    assert described(open_log(path)) == [(None, N, [("a", "g"), ("b", "g"), ("c", "g")])]
    assert read_log(path, LogSettings(time_unit="ms")).fs == 100.0


@structs
def test_a_struct_for_each_sensor(path, save):
    sensors = {f"s{k}": {"data": DATA[:, k], "unit": "g", "name": f"gear {k}"} for k in range(3)}
    save(path, {"fs": FS, **sensors})
    assert described(open_log(path)) == [(FS, N, [("gear 0", "g"), ("gear 1", "g"), ("gear 2", "g")])]


def headed(*names, **of_file):
    variables = {"File_Header": {"NumberOfChannels": str(len(names)), "Comment": "run 3", **of_file}}
    for number, (name, unit) in enumerate(names, start=1):
        variables[f"Channel_{number}_Data"] = TIME if name == "Time" else DATA[:, number - 1]
        variables[f"Channel_{number}_Header"] = {"SignalName": name, "Unit": unit, "MaxLevel": "100", "Correction": "1"}
    return variables


@structs
@pytest.mark.parametrize("rate", ["512", "512,0", 512.0])
def test_data_and_headers_side_by_side(path, save, rate):
    save(path, headed(("lower", "g"), ("upper", "m/s^2"), ("lower", "mm"), SampleFrequency=rate))
    run = read_log(path)
    assert (run.fs, run.names) == (512.0, ("lower", "upper", "lower (2)"))
    np.testing.assert_allclose(run.samples, DATA * [9.80665, 1.0, 1e-3])


@structs
def test_a_channel_whose_header_says_time_is_the_time(path, save):
    save(path, headed(("Time", "s"), ("lower", "g"), SampleFrequency="100"))
    run = read_log(path)
    assert (run.fs, run.names) == (100.0, ("lower",))
    np.testing.assert_allclose(run.channel("lower"), 9.80665 * DATA[:, 1])


@structs
def test_a_header_without_names_leaves_that_of_its_channel(path, save):
    save(path, {"Channel_1_Data": DATA[:, 0], "Channel_1_Header": {"Unit": "g", "SampleFrequency": "51.2"}})
    run = read_log(path)
    assert (run.fs, run.names) == (51.2, ("Channel_1",))


def test_an_array_of_structs(path):
    elements = [{"data": DATA[:, k], "unit": "g", "fs": FS if k else 256.0} for k in range(3)]
    savemat(path, {"ch": np.array(elements, dtype=object)})
    assert described(open_log(path)) == [(256.0, N, [("ch_1", "g")]), (FS, N, [("ch_2", "g"), ("ch_3", "g")])]


@every
def test_the_settings_override_what_is_found(path, save):
    save(path, {"Fs": FS, "clock": TIME, "t": np.arange(N) / 7, "z": DATA[:, 0]})
    assert read_log(path, LogSettings(unit="g", time="clock"), channels=["z"]).fs == 100.0
    assert read_log(path, LogSettings(unit="g", fs_hz=50), channels=["z"]).fs == 50.0
    names = LogSettings(names=("p", "q", "r [N]"))
    assert described(open_log(path, names)) == [(None, N, [("p", None), ("r", "N")])]
    with pytest.raises(InputError, match="did you mean 'clock'"):
        open_log(path, LogSettings(time="clocks"))


@every
@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, 1e12])
def test_an_absurd_rate_is_refused(path, save, rate):
    save(path, {"fs": rate, "z": DATA[:, 0]})
    with pytest.raises(InputError, match=r"run\.mat states a rate of .* Hz: give the true one as fs_hz"):
        open_log(path)
    assert read_log(path, LogSettings(fs_hz=10, unit="g")).fs == 10.0


@every
def test_a_file_without_signals_is_refused(path, save):
    save(path, {"name": "nothing", "answer": 42.0})
    with pytest.raises(InputError, match="holds no vectors or matrices of numbers"):
        open_log(path)


@structs
def test_what_is_no_number_is_left_out(path, save):
    held = {"fs": FS, "z": DATA[:, 0], "note": "x" * N, "cube": np.zeros((2, 3, 4)), "c": DATA[:, 0] + 1j}
    save(path, held | {"empty": np.zeros((0, 3)), "list": cells("a", "b"), "flag": np.arange(N) % 2 == 0})
    assert described(open_log(path)) == [(FS, N, [("flag", None), ("z", None)])]


@every
@pytest.mark.parametrize("part", [0.005, 0.02, 0.1, 0.5, 0.9, 0.999])
def test_a_file_that_is_cut_off_is_refused(path, save, part):
    save(path, {"fs": FS, "M": DATA})
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content))])
    with pytest.raises(InputError, match=r"run\.mat"):
        read_log(path, LogSettings(unit="g"))


@pytest.mark.parametrize(
    "content", [b"\xff\xd8\xff\xe0 a picture" * 100, b"time,a\n0,1\n", bytes(5000), b"PK\x03\x04" * 99]
)
def test_another_file_under_the_name_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"run\.mat"):
        open_log(path)


def test_lengths_that_lie_are_found_out(path):
    savemat(path, {"z": DATA[:, 0]})
    content = path.read_bytes()
    for old, new in ((N, 10**9), (8 * N, 2**31 - 8), (8 * N, 2**32 - 8)):
        path.write_bytes(content.replace(struct.pack("<I", old), struct.pack("<I", new), 1))
        with pytest.raises(InputError, match=r"run\.mat"):
            read_log(path, LogSettings(fs_hz=1, unit="g"))
    with h5py.File(path, "w") as file:
        file.create_dataset("z", (1, 10**12), dtype="f8", chunks=(1, 1000))
        file["fs"] = FS
    with pytest.raises(InputError, match="its header is damaged"):
        read_log(path)


@pytest.mark.parametrize("packed", [False, True])
def test_cells_within_cells_without_end_are_refused(path, packed):
    def element(kind, content):
        return struct.pack("<II", kind, len(content)) + content

    flags = struct.pack("<IIII", 6, 8, 1, 0) + struct.pack("<IIii", 5, 8, 1, 1)
    matrix = (
        struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, 1, 1) + element(1, b"") + element(9, bytes(8))
    )
    parts, size = [matrix], len(matrix)
    for level in range(50_000):
        name = element(1, b"names\0\0\0") if level == 49_999 else element(1, b"")
        parts.append(flags + name + struct.pack("<II", 14, size))
        size += len(parts[-1])
    whole = element(14, b"".join(reversed(parts)))
    whole = element(15, zlib.compress(whole)) if packed else whole
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + whole)
    with pytest.raises(InputError, match=r"run\.mat is no sound MATLAB file"):
        open_log(path)


def test_a_variable_that_stands_twice_is_refused(path):
    savemat(path, {"z": DATA[:, 0]})
    content = path.read_bytes()
    path.write_bytes(content + content[128:])
    with pytest.raises(InputError, match="2 variables called 'z'"):
        open_log(path)


@pytest.mark.parametrize("save", [save_4, save_5, save_7])
def test_bytes_at_random_never_crash_the_reader(path, save):
    save(path, {"fs": FS, "M": DATA[:40], "names": "abc"})
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    for seed in range(80):
        rng = np.random.default_rng(seed)
        damaged = content.copy()
        damaged[rng.integers(0, content.size, 6)] = rng.integers(0, 256, 6)
        path.write_bytes(damaged.tobytes())
        with suppress(InputError):
            for track in open_log(path).tracks:
                list(track.blocks())


def test_a_long_log_of_version_73_is_read_in_slices(path):
    n = BLOCK_VALUES // 4 + 1000
    with h5py.File(path, "w") as file:
        file["fs"] = [[FS]]
        file["m"] = np.arange(4 * n, dtype=np.float32).reshape(4, n)
    blocks = [block.samples for block in open_log(path).tracks[0].blocks([3])]
    assert len(blocks) == 2
    np.testing.assert_array_equal(np.concatenate(blocks)[:, 0], np.arange(3 * n, 4 * n, dtype=np.float32))


def test_a_class_of_any_length_is_not_read(path):
    """MATLAB writes texts of fixed length; those of any length may lie of it."""
    with h5py.File(path, "w") as file:
        file["z"], file["fs"] = DATA[:, :1].T, [[FS]]
        file["note"] = np.array([[104], [105]], dtype=np.uint16)
        file["note"].attrs["MATLAB_class"] = "char"
    content = bytearray(path.read_bytes())
    at = content.index(struct.pack("<IQ", 4, content.index(b"GCOL")))
    content[at : at + 4] = struct.pack("<I", 1 << 31)
    path.write_bytes(content)
    assert described(open_log(path)) == [(FS, N, [("z", None)])]


def test_a_text_of_no_dimensions_is_refused(path):
    """The program ended where scipy made a text of it."""
    savemat(path, {"z": DATA[:, 0], "s": {"names": cells("a", "b")}})
    dims = struct.pack("<IIii", 5, 8, 1, 1)
    content = bytearray(path.read_bytes())
    at = content.rindex(dims)
    content[at + 4 : at + 8] = bytes(4)
    path.write_bytes(content)
    with pytest.raises(InputError, match="the library that reads it broke down"):
        open_log(path)


@structs
def test_one_text_with_the_units_of_time_and_channels(path, save):
    """Measured logs have it in a struct: units = 's, m/s^2'."""
    time = np.arange(400) / 200.0
    save(path, {"HIdata": {"time": time, "acc1": np.sin(time), "acc2": np.cos(time), "units": "s, m/s^2"}})
    log = read_log(path)
    assert log.fs == pytest.approx(200.0)
    assert [(each.name, each.unit) for each in log.channels] == [("acc1", "m/s^2"), ("acc2", "m/s^2")]
