"""WAV files from the standard library, from scipy and by hand: what their samples mean, and headers that lie."""

import struct
import wave

import numpy as np
import pytest
from scipy.io import wavfile

from opid.errors import InputError
from opid.signals.log import BLOCK_VALUES, ChannelSettings, LogSettings
from opid.signals.logs import open_log, read_log

N, FS = 700, 4000
WHOLE = np.random.default_rng(5).integers(-128, 128, (N, 2))
SCALED = LogSettings(full_scale=16.0, unit="g")
G = 9.80665


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.wav"


def save_whole(path, width, fs=FS):
    """Write whole numbers of so many bytes with the standard library; the largest 128 * 256^(width - 1)."""
    values = WHOLE * 256 ** (width - 1)
    raw = (values + 128 if width == 1 else values).astype("<i8").ravel().view(np.uint8).reshape(-1, 8)[:, :width]
    with wave.open(str(path), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(width)
        file.setframerate(fs)
        file.writeframes(raw.tobytes())


def chunk(name, content, order="<"):
    return name + struct.pack(order + "I", len(content)) + content + b"\0" * (len(content) % 2)


def form(code=1, channels=2, fs=FS, frame=4, bits=16, order="<"):
    return struct.pack(order + "HHIIHH", code, channels, fs, fs * frame % 2**32, frame, bits)


def riff(*chunks, name=b"RIFF", order="<"):
    content = b"WAVE" + b"".join(chunks)
    return name + struct.pack(order + "I", len(content) & 0xFFFFFFFF) + content


SAMPLES = (WHOLE * 256).astype("<i2").tobytes()
GOOD = riff(chunk(b"fmt ", form()), chunk(b"data", SAMPLES))


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_whole_numbers_are_parts_of_the_full_scale(path, width):
    save_whole(path, width)
    log = open_log(path, SCALED)
    assert (log.format, log.names, log.tracks[0].fs, log.tracks[0].n_samples) == (
        "WAV",
        ("channel_1", "channel_2"),
        FS,
        N,
    )
    run = read_log(path, SCALED)
    np.testing.assert_array_equal(run.samples, WHOLE / 128 * 16 * G)
    assert {channel.unit for channel in run.channels} == {"m/s^2"}
    (block,) = log.tracks[0].blocks([1], 600, 650)
    np.testing.assert_array_equal(block.samples[:, 0], WHOLE[600:650, 1] / 8)


@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("columns", [1, 2])
def test_floats_are_taken_as_they_are(path, kind, columns):
    data = np.random.default_rng(1).standard_normal((N, 2))[:, :columns].astype(kind)
    wavfile.write(path, 48_000, data)
    run = read_log(path, LogSettings(full_scale=1.0, unit="m/s^2", names=("z", "x")[:columns]))
    np.testing.assert_array_equal(run.samples, data)
    assert (run.fs, run.names) == (48_000, ("z", "x")[:columns])


def test_big_endian_extensible_and_strange_chunks(path):
    extra = struct.pack("<HHI", 22, 16, 3) + struct.pack("<H", 1) + bytes(14)
    plain = chunk(b"data", SAMPLES)
    extensible = chunk(b"fmt ", form(0xFFFE) + extra)
    remark = chunk(b"bext", b"odd")
    big = chunk(b"data", (WHOLE * 256).astype(">i2").tobytes(), ">")
    files = [
        riff(extensible, plain),
        riff(remark, chunk(b"fmt ", form()), chunk(b"iXML", b"<a/>"), plain, remark),
        riff(chunk(b"fmt ", form(order=">"), ">"), big, name=b"RIFX", order=">"),
        riff(
            chunk(b"ds64", struct.pack("<QQQI", 0, len(SAMPLES), N, 0)),
            chunk(b"fmt ", form()),
            b"data\xff\xff\xff\xff" + SAMPLES,
            name=b"RF64",
        ),
    ]
    for content in files:
        path.write_bytes(content)
        np.testing.assert_array_equal(read_log(path, SCALED).samples, WHOLE / 128 * 16 * G)


def test_24_bits_big_endian(path):
    raw = (WHOLE * 65536).astype(">i4").view(np.uint8).reshape(-1, 4)[:, 1:].tobytes()
    fmt = form(frame=6, bits=24, order=">")
    path.write_bytes(riff(chunk(b"fmt ", fmt, ">"), chunk(b"data", raw, ">"), name=b"RIFX", order=">"))
    np.testing.assert_array_equal(read_log(path, SCALED).samples, WHOLE / 128 * 16 * G)


def test_a_unit_without_a_full_scale_is_refused(path):
    path.write_bytes(GOOD)
    with pytest.raises(InputError, match=r"run\.wav holds fractions of its full scale: give full_scale in \[log\]"):
        open_log(path, LogSettings(unit="g"))
    with pytest.raises(InputError, match="states no unit"):
        read_log(path)
    own = {"z": ChannelSettings("channel_2", unit="g", scale=16.0, sign=-1)}
    np.testing.assert_array_equal(read_log(path, channels=own).samples[:, 0], WHOLE[:, 1] / -128 * 16 * G)


def test_names_must_be_as_many_as_channels(path):
    path.write_bytes(GOOD)
    with pytest.raises(InputError, match=r"has 2 channel\(s\), names in \[log\] are 1"):
        open_log(path, LogSettings(names=("z",)))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (riff(chunk(b"fmt ", form(code=6)), chunk(b"data", SAMPLES)), r"compressed samples \(A-law\)"),
        (riff(chunk(b"fmt ", form(code=99)), chunk(b"data", SAMPLES)), "of kind 99"),
        (riff(chunk(b"fmt ", form(channels=0)), chunk(b"data", SAMPLES)), "states 0 channels"),
        (riff(chunk(b"fmt ", form(fs=0)), chunk(b"data", SAMPLES)), "states a rate of 0 Hz"),
        (riff(chunk(b"fmt ", form(fs=4_000_000_000)), chunk(b"data", SAMPLES)), r"states a rate of 4e\+09 Hz"),
        (riff(chunk(b"fmt ", form(frame=0)), chunk(b"data", SAMPLES)), "do not fit"),
        (riff(chunk(b"fmt ", form(frame=5)), chunk(b"data", SAMPLES)), "do not fit"),
        (riff(chunk(b"fmt ", form(bits=24)), chunk(b"data", SAMPLES)), "do not fit"),
        (riff(chunk(b"fmt ", form(channels=60_000)), chunk(b"data", SAMPLES)), "do not fit"),
        (riff(chunk(b"data", SAMPLES), chunk(b"fmt ", form())), "before its format is stated"),
        (riff(chunk(b"fmt ", form()[:10]), chunk(b"data", SAMPLES)), "format chunk of 10 bytes"),
        (riff(chunk(b"fmt ", form())), "no samples"),
        (riff(chunk(b"fmt ", form()), b"data" + struct.pack("<I", 0) + SAMPLES), "did not close it"),
        (
            riff(chunk(b"fmt ", form()), b"data" + struct.pack("<I", 2**32 - 1) + SAMPLES),
            "says that it holds 4294967295",
        ),
        (riff(chunk(b"fmt ", form()), chunk(b"data", b"")), "holds no samples"),
        (GOOD[:8] + b"AVI " + GOOD[12:], "is no WAV file, though it begins like one"),
        (b"fLaC" + GOOD, "is no WAV file"),
    ],
)
def test_a_header_at_fault_is_found_out(path, content, message):
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as raised:
        read_log(path, SCALED)
    assert "run.wav" in str(raised.value)


@pytest.mark.parametrize("size", [4, 11, 12, 19, 30, 40, 43, 44, 46, 1000, len(GOOD) - 1])
def test_a_file_that_is_cut_off_is_refused(path, size):
    path.write_bytes(GOOD[:size])
    with pytest.raises(InputError, match=r"run\.wav"):
        read_log(path, SCALED)


def test_a_file_that_shrinks_while_it_is_read(path):
    path.write_bytes(GOOD)
    track = open_log(path).tracks[0]
    path.write_bytes(GOOD[:-100])
    with pytest.raises(InputError, match="is cut off"):
        list(track.blocks())


def test_a_rate_that_is_wrong_may_be_stated(path):
    path.write_bytes(riff(chunk(b"fmt ", form(fs=0)), chunk(b"data", SAMPLES)))
    assert read_log(path, LogSettings(full_scale=1.0, unit="g", fs_hz=51.2)).fs == 51.2


def test_chunks_without_end_are_not_walked_for_ever(path):
    path.write_bytes(b"RIFF\0\0\0\0WAVE" + b"JUNK\0\0\0\0" * 50_000)
    with pytest.raises(InputError, match="has no samples"):
        open_log(path)


def test_a_long_log_is_read_in_slices(path):
    n = BLOCK_VALUES // 2 + 1000
    data = np.arange(2 * n, dtype=np.int32).reshape(n, 2)
    wavfile.write(path, FS, data)
    blocks = [block.samples for block in open_log(path).tracks[0].blocks([1])]
    assert len(blocks) == 2
    np.testing.assert_array_equal(np.concatenate(blocks)[:, 0] * 2.0**31, data[:, 1])
