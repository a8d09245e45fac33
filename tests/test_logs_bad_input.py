"""Bad input of every format: one clear error that names the file, never another exception, a hang or a guess.

The tables grow with the formats: `small_logs.py` makes a small sound log of each.
"""

import io
import os
import pickle
import struct
import subprocess
import sys
import zipfile
import zlib

import numpy as np
import pytest
from small_logs import SAME, VALUES, WRITERS, all_of, ended_after, small_log

from opid.errors import InputError
from opid.signals.logs import apart, formats, open_log, read_log

every_format = pytest.mark.parametrize("ending", WRITERS)

# Where less than the whole file is a sound log: lines of text, and flight logs, which end where the power did.
CUT_IS_SOUND = {".csv", ".tsv", ".txt", ".dat", ".asc", ".lvm", ".ulg"}


@pytest.fixture(autouse=True)
def _no_hang(monkeypatch):
    monkeypatch.setattr(apart, "BOUNDS", apart.ReadingBounds(seconds=5))
    with ended_after(60):
        yield


def refused(path):
    """Return the one sentence with which a file is refused, or fail."""
    with pytest.raises(InputError) as caught:
        all_of(path)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def read_or_refused(path):
    """Return the values of each track, or None where the file is refused as it should be."""
    try:
        return all_of(path)
    except InputError:
        refused(path)
        return None


def test_every_ending_has_a_small_log():
    assert set(formats()) == set(WRITERS) | set(SAME)


@pytest.mark.parametrize("ending", [*WRITERS, *SAME])
def test_the_small_logs_are_sound(tmp_path, ending):
    path = tmp_path / f"run{ending}"
    path.write_bytes(small_log(ending))
    (samples,) = all_of(path)
    scale = 4.0 if formats()[ending].name == "WAV" else 1.0  # its full scale is 1
    np.testing.assert_allclose(scale * samples, VALUES, atol=1e-4 if scale != 1 else 1e-9)


@every_format
@pytest.mark.parametrize("percent", [0, 1, 10, 40, 90, 99])
def test_a_log_that_is_cut_off(tmp_path, ending, percent):
    whole = small_log(ending)
    n = len(whole) * percent // 100
    path = tmp_path / f"run{ending}"
    path.write_bytes(whole[:n])
    if ending not in CUT_IS_SOUND or n == 0:
        refused(path)
    elif (found := read_or_refused(path)) is not None:
        (samples,) = found
        whole_rows = max(0, len(samples) - (ending != ".ulg"))  # the last number of a text may have lost digits
        if whole_rows == 0:  # nor is it known how many columns a header had that is cut off
            return
        np.testing.assert_array_equal(samples[:whole_rows], VALUES[:whole_rows])
        assert len(samples) <= percent * len(VALUES) // 100 + 1


@every_format
def test_another_content_than_the_ending_says(tmp_path, ending):
    whole = small_log(ending)
    path = tmp_path / f"run{ending}"
    random = np.random.default_rng(2).integers(0, 256, 4096).astype(np.uint8).tobytes()
    png = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4s2I5B", 13, b"IHDR", 8, 8, 8, 2, 0, 0, 0)
    contents = {
        "random": random,
        "random behind the magic": whole[:16] + random,
        "zeros": bytes(4096),
        "picture": png + struct.pack(">I", zlib.crc32(png[12:])) + random,
        "archive": b"PK\x03\x04" + random,
        "pickle": pickle.dumps({"a": 1.0, "b": [2.0] * 100}, protocol=4),
        "gzip": b"\x1f\x8b\x08\x00" + random,
        "words": b"The bearing was replaced on Tuesday.\nNothing was measured.\n" * 40,
    }
    for content in contents.values():
        path.write_bytes(content)
        refused(path)


@every_format
def test_a_wrong_magic(tmp_path, ending):
    form = formats()[ending]
    if not form.magic:
        pytest.skip(f"{form.name} files begin with nothing of their own")
    path = tmp_path / f"run{ending}"
    path.write_bytes(b"NOTMAGIC" + small_log(ending)[8:])
    assert f"is no {form.name} file" in refused(path)


@every_format
def test_the_log_of_another_format(tmp_path, ending):
    path = tmp_path / f"run{ending}"
    own = formats()[ending]
    for other in WRITERS:
        form = formats()[other]
        alike = form.name == own.name or (form.text and own.text) or {form.name, own.name} == {"HDF5", "MATLAB"}
        if not alike:
            path.write_bytes(small_log(other))
            refused(path)


NO_CHANNELS = {
    ".csv": b"time [s]\n0\n1\n",
    ".wav": struct.pack("<4sI4s4sIHHIIHH4sI", b"RIFF", 36, b"WAVE", b"fmt ", 16, 1, 0, 256, 0, 0, 16, b"data", 0),
    ".tdms": struct.pack("<4sIIQQI", b"TDSm", 2, 4713, 4, 4, 0),
    ".ulg": b"ULog\x01\x12\x35\x01" + bytes(8),
    ".uff": b"    -1\n   151\nmodel\n    -1\n",
}


@pytest.mark.parametrize(
    "ending", sorted(ending for ending, form in formats().items() if form.needs and ending != ".mat")
)
def test_a_library_that_is_missing(tmp_path, monkeypatch, ending):
    file = tmp_path / f"log{ending}"
    file.write_bytes(small_log(ending))
    form = formats()[ending]
    module = {"npTDMS": "nptdms", "python-calamine": "python_calamine"}.get(form.needs, form.needs)
    (tmp_path / f"{module}.py").write_text("raise ModuleNotFoundError(__name__)")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(apart, "_idle", [])
    with pytest.raises(InputError, match=r"not installed: run `\S+ -m pip install") as caught:
        open_log(file)
    assert f"'.[{form.extra}]'" in str(caught.value)
    assert form.needs in str(caught.value)


@pytest.mark.parametrize("ending", NO_CHANNELS)
def test_no_channels(tmp_path, ending):
    small_log(ending)
    path = tmp_path / f"run{ending}"
    path.write_bytes(NO_CHANNELS[ending])
    refused(path)


def test_no_channels_in_what_others_write(tmp_path):
    h5py, pyarrow = pytest.importorskip("h5py"), pytest.importorskip("pyarrow")
    from pyarrow import parquet
    from scipy.io import savemat

    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["fs"] = 256.0
    savemat(tmp_path / "b.mat", {"remark": "nothing was measured"})
    parquet.write_table(pyarrow.table({"remark": ["nothing"]}), tmp_path / "c.parquet")
    for name in ("a.h5", "b.mat", "c.parquet"):
        refused(tmp_path / name)


@every_format
def test_directories_and_links(tmp_path, ending):
    content = small_log(ending)
    directory = tmp_path / f"directory{ending}"
    directory.mkdir()
    assert "is a directory" in refused(directory)
    sound = tmp_path / f"run{ending}"
    sound.write_bytes(content)
    link, dangling, loop = (tmp_path / f"{name}{ending}" for name in ("link", "dangling", "loop"))
    link.symlink_to(sound)
    np.testing.assert_array_equal(all_of(link), all_of(sound))
    dangling.symlink_to(tmp_path / "nothing")
    refused(dangling)
    loop.symlink_to(loop)
    refused(loop)


@every_format
@pytest.mark.parametrize("change", ["grows", "is cut", "is written anew", "is removed"])
def test_a_log_that_changes_while_it_is_read(tmp_path, ending, change):
    content = small_log(ending)
    path = tmp_path / f"run{ending}"
    path.write_bytes(content)
    os.utime(path, ns=(0, 0))
    (track,) = open_log(path).tracks
    if change == "is removed":
        path.unlink()
    else:
        path.write_bytes({"grows": content + content[-200:], "is cut": content[:-200]}.get(change, content))
    with pytest.raises(InputError, match=path.name):
        list(track.blocks())


@every_format
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may read everything")
def test_a_log_that_may_not_be_read(tmp_path, ending):
    path = tmp_path / f"run{ending}"
    path.write_bytes(small_log(ending))
    path.chmod(0)
    assert "check the file and its rights" in refused(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b",".join(b"%d" % i for i in range(1_000_000)) + b"\n" + b"0," * 999_999 + b"0\n", "column"),
        (b"time [s],a [g]\n" + b"1" * 3_000_000 + b"\n", ""),
        (b"time [s],a [g]\n0,1\n1,\xff\xfe\n", ""),
        (b"time [s],a [g]\n0,1\n1,2\n\x00\x00\x00\x00", ""),
    ],
    ids=["a million columns", "a number of a million digits", "no text of any encoding", "zeros at the end"],
)
def test_texts_that_no_logger_writes(tmp_path, content, words):
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    assert words in refused(path)


def test_a_device_is_no_log():
    with pytest.raises(InputError, match="is a directory or a device"):
        read_log("/dev/zero")


# ---- what fuzzing found ----------------------------------------------------------------------------


def overwritten(content, at, new):
    return content[:at] + new + content[at + len(new) :]


def circle_of_groups(content):
    """The first data group of an MDF 4 names itself as the next: read for ever."""
    at = content.index(b"##DG")
    return overwritten(content, at + 24, struct.pack("<Q", at))


def circle_of_no_groups(content):
    """The same, but it is no data group: only the library's count of groups went round for ever."""
    return overwritten(circle_of_groups(content), content.index(b"##DG"), b"##XX")


def vast_records(content):
    """Each record has 4 GiB of marks for invalid values: as much was allocated, for one record."""
    return overwritten(content, content.index(b"##CG") + 100, b"\xff" * 4)


def channel_outside_its_record(content):
    """The bytes of a channel lie 16 MiB behind its record: the library read there, and the program ended."""
    return overwritten(content, content.rindex(b"##CN") + 92, b"\x00\x00\xff\x00")


def circle_of_old_groups(content):
    at = int.from_bytes(content[68:72], "little")
    return overwritten(content, at + 4, content[68:72])


def unknown_message(content):
    """An unknown message, longer than what follows: the library went back by its length, for ever."""
    return content[:16] + struct.pack("<HB", 200, 0) + b"x" * 40


def heap_without_end(content):
    """The free space of a heap of HDF5 has no bytes: its library goes on by as many, for ever."""
    return overwritten(content, content.index(b"\xc0\x0f", content.index(b"GCOL")), b"\x00\x00")


def vast_page(content):
    """A page of Parquet says that it unfolds to 2 GiB: as much is allocated and filled before it is refused."""
    return overwritten(content, 11, b"\xff" * 8)


def cells_far_apart(content):
    """The last cell of a sheet stands in the last row and column that there can be: the library makes room for all."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as archive, zipfile.ZipFile(out, "w") as damaged:
        for name in archive.namelist():
            damaged.writestr(name, archive.read(name).replace(b'r="C65"', b'r="XFD1048576"'))
    return out.getvalue()


DAMAGES = [
    (".mf4", circle_of_groups),
    (".mf4", circle_of_no_groups),
    (".mf4", vast_records),
    (".mf4", channel_outside_its_record),
    (".mdf", circle_of_old_groups),
    (".ulg", unknown_message),
    (".h5", heap_without_end),
    (".parquet", vast_page),
    (".xlsx", cells_far_apart),
]


@pytest.mark.parametrize(("ending", "damage"), DAMAGES, ids=[damage.__name__ for _, damage in DAMAGES])
def test_what_fuzzing_found(tmp_path, ending, damage, monkeypatch):
    content = small_log(ending)
    path = tmp_path / f"run{ending}"
    path.write_bytes(content)
    all_of(path)  # now the library is loaded, and what still takes a second goes on for ever
    monkeypatch.setattr(apart, "BOUNDS", apart.ReadingBounds(seconds=1))
    path.write_bytes(damage(content))
    refused(path)


# ---- the process in which libraries read -----------------------------------------------------------


def test_what_one_log_does_to_its_process_leaves_others_alone(tmp_path, monkeypatch):
    sound, damaged = tmp_path / "sound.mf4", tmp_path / "damaged.mf4"
    content = small_log(".mf4")
    sound.write_bytes(content)
    damaged.write_bytes(circle_of_groups(content))
    blocks = open_log(sound).tracks[0].blocks()
    all_of(sound)  # in a second process, which has loaded the library now
    monkeypatch.setattr(apart, "BOUNDS", apart.ReadingBounds(seconds=1))
    with pytest.raises(InputError, match="takes far too long"):
        open_log(damaged)
    np.testing.assert_allclose(next(blocks).samples, VALUES, atol=1e-9)


def test_two_readings_of_one_log_and_one_that_is_given_up(tmp_path):
    path = tmp_path / "run.h5"
    path.write_bytes(small_log(".h5"))
    (track,) = open_log(path).tracks
    one, other = track.blocks([0], 0, 10), track.blocks([1], 10, 20)
    first, second = next(one), next(other)
    one.close()
    np.testing.assert_array_equal(first.samples[:, 0], VALUES[:10, 0])
    np.testing.assert_array_equal(second.samples[:, 0], VALUES[10:20, 1])
    assert list(other) == []


def test_a_process_is_used_again_and_ends_with_the_program(tmp_path):
    path = tmp_path / "run.npz"
    path.write_bytes(small_log(".npz"))
    before = {each._python.pid for each in apart._every}
    for _ in range(4):
        all_of(path)
    after = {each._python.pid for each in apart._every}
    assert len(after - before) <= 1
    program = f"""
from opid.signals.logs import apart, open_log
log = open_log({os.fspath(path)!r})
print(*(each._python.pid for each in apart._every))
"""
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert told.stderr == ""
    with pytest.raises(ProcessLookupError):
        os.kill(int(told.stdout), 0)
