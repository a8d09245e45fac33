"""NumPy archives: arrays by name become channels; what promises too much or would run code is not read."""

import os
import zipfile

import numpy as np
import pytest

from opid.errors import InputError
from opid.signals.log import LogSettings
from opid.signals.logs import open_log, read_log
from opid.signals.recording import Channel

N, FS = 300, 256.0
T = np.arange(N) / FS
RNG = np.random.default_rng(3)
LOWER, UPPER = RNG.standard_normal((2, N))


@pytest.fixture
def npz(tmp_path):
    def write(*, compressed=True, **arrays):
        path = tmp_path / "run.npz"
        (np.savez_compressed if compressed else np.savez)(path, **arrays)
        return path

    return write


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(
    "arrays",
    [
        {"time": T, "lower": LOWER, "upper": UPPER, "units": np.array(["g", "g"])},
        {"fs": FS, "lower": LOWER, "upper": UPPER, "units": np.array("g")},
        {"dt": np.array([1 / FS]), "lower": LOWER[:, None], "upper": UPPER, "unit": np.array([b"g"])},
        {"t": T, "data": np.stack([LOWER, UPPER], 1), "names": np.array(["lower", "upper"]), "units": np.array(["g"])},
        {"t": T, "data": np.asfortranarray([LOWER, UPPER]), "names": np.array(["lower [g]", "upper [g]"])},
        {"fs": FS, "lower [g]": LOWER, "upper [g]": UPPER, "comment": np.array("a run"), "range": np.array([16, 16])},
        {"fs": FS, "lower [g]": LOWER, "upper [g]": UPPER, "meta": np.array({"bearing": "new"})},  # an object
    ],
)
def test_arrays_are_channels_and_time_or_rate_the_clock(npz, arrays, compressed):
    run = read_log(npz(compressed=compressed, **arrays))
    assert (run.fs, run.channels) == (FS, (Channel("lower", "m/s^2"), Channel("upper", "m/s^2")))
    np.testing.assert_allclose(run.samples, 9.80665 * np.stack([LOWER, UPPER], axis=1))


def test_the_fields_of_a_record_array_are_arrays(npz):
    rows = np.array(list(zip(T, LOWER, strict=True)), dtype=[("time", float), ("lower [g]", float)])
    run = read_log(npz(run=rows))
    assert (run.fs, run.names) == (FS, ("lower",))
    np.testing.assert_allclose(run.channel("lower"), 9.80665 * LOWER)


def test_settings_say_what_the_file_does_not(npz):
    run = read_log(npz(clock=1000 * T, a=LOWER), LogSettings(time="clock", time_unit="ms", unit="g"))
    assert (run.fs, run.channels) == (FS, (Channel("a", "m/s^2"),))


class Spy:
    def __reduce__(self):
        return os.putenv, ("OPID_NPZ_SPY", "ran")


def test_pickles_are_never_read(npz):
    path = npz(lower=np.array([Spy(), 1.0], dtype=object))
    with pytest.raises(InputError, match=r"run\.npz holds no signals as numbers; .* Python objects: lower\. Save"):
        open_log(path)
    path.write_bytes(path.read_bytes().replace(b"lower", b"uppe]"))  # the pickle stays, the directory is damaged
    with pytest.raises(InputError, match=r"run\.npz"):
        open_log(path)


def test_an_array_of_objects_is_named_even_where_a_time_stands_beside(npz):
    with pytest.raises(InputError, match="Python objects: lower"):
        open_log(npz(time=T, lower=LOWER.astype(object)))
    (remark,) = open_log(npz(time=T, upper=UPPER, lower=LOWER.astype(object))).remarks
    assert remark == "'lower' holds Python objects and is not read"


def header(shape):
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}"
    return b"\x93NUMPY\x01\x00" + (len(text) + 1).to_bytes(2, "little") + text.encode() + b"\n"


@pytest.mark.parametrize("shape", ["(1000000000000,)", "(301,)", "(-2,)", "(3, 100, 2)"])
def test_a_shape_that_the_file_cannot_hold_is_refused(tmp_path, shape):
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("lower.npy", header(shape) + LOWER.tobytes())
    with pytest.raises(InputError, match=r"run\.npz: its array 'lower' has the shape"):
        open_log(path)
