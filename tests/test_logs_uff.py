"""Universal files: written by pyuff, by hand and by others, and what is said of one that is at fault."""

import numpy as np
import pytest
import pyuff
from measured_data import SAMPLES, needs_samples

from opid.errors import InputError
from opid.signals.log import LogSettings
from opid.signals.logs import open_log, read_log, write_log
from opid.signals.recording import Channel, Recording

N, FS = 600, 512.0
RNG = np.random.default_rng(5)
DATA = RNG.standard_normal((N, 3))
RUN = Recording(
    RNG.standard_normal((N, 3)) * 1e-3,
    fs=1 / 0.0037,
    channels=(Channel("lower z", "m/s^2"), Channel("Rad/ü", "N"), Channel("q", "rad/s")),
    start_s=0.1 + 0.2,
    history=("tested",),
)


def data_set(data, *, unit="g", name="NONE", node=1, binary=0, func_type=1, dt=1 / FS, **more):
    """A time history, as pyuff wants it."""
    given = {
        "type": 58,
        "binary": binary,
        "func_type": func_type,
        "id1": name,
        "rsp_node": node,
        "rsp_dir": 3,
        "ref_dir": 0,
        "ref_node": 0,
        "data": np.asarray(data),
        "x": np.arange(len(data)) * dt,
        "abscissa_min": 0.0,
        "abscissa_inc": dt,
        "abscissa_spacing": 1,
        "num_pts": len(data),
        "abscissa_spec_data_type": 17,
        "abscissa_axis_units_lab": "s",
        "ordinate_spec_data_type": 12,
        "ordinate_axis_units_lab": unit,
        "orddenom_spec_data_type": 0,
        "z_axis_spec_data_type": 0,
        "z_axis_value": 0,
        **more,
    }
    return given


@pytest.fixture
def written(tmp_path):
    """Write data sets, return the file: pyuff writes the text, the binary numbers are put in by hand."""

    def write(*sets, name="run.uff"):
        path = tmp_path / name
        path.write_bytes(b"".join(one(each) for each in sets))
        return path

    def one(given):
        # pyuff's own writer of 58b leaves its files open
        binary = given["binary"]
        path = tmp_path / "one"
        pyuff.UFF(str(path)).write_sets([{**given, "binary": 0}], mode="overwrite")
        text = path.read_bytes()
        path.unlink()
        if not binary:
            return text
        numbers = given["data"].astype("<f8" if binary == 1 else ">f8").tobytes()
        lines = text.splitlines(keepends=True)
        lines[1] = b"%6db%6d%6d%12d%12d%6d%6d%12d%12d\n" % (58, binary, 2, 11, len(numbers), 0, 0, 0, 0)
        return b"".join(lines[:13]) + numbers + b"    -1\n"

    return write


@pytest.mark.parametrize("binary", [0, 1, 2], ids=["ascii", "little", "big"])
@pytest.mark.parametrize("ending", [".uff", ".unv", ".58", ".bak"])
def test_sets_of_one_clock_are_channels_of_one_track(written, binary, ending):
    sets = [data_set(DATA[:, k], name=f"gear {k}", node=k + 1, binary=binary) for k in range(3)]
    log = open_log(written(*sets, name=f"run{ending}"))
    assert (log.format, log.names, len(log.tracks)) == ("UFF58", ("gear 0", "gear 1", "gear 2"), 1)
    track = log.tracks[0]
    assert (track.fs, track.n_samples, track.channels[1].unit) == (FS, N, "g")
    (block,) = track.blocks([2, 0], 100, 250)
    np.testing.assert_allclose(block.samples, DATA[100:250, [2, 0]], rtol=0 if binary else 1e-11)


@pytest.mark.parametrize("fs", [512.0, 65536.0, 44100.0, 117.0, 1652.892562])
def test_a_rate_whose_period_has_six_digits_is_the_plain_number_behind_it(written, fs):
    read = open_log(written(data_set(DATA[:, 0], dt=1 / fs))).tracks[0].fs
    assert read == fs if fs == round(fs) else abs(read / fs - 1) < 5e-6


def test_other_spacings_and_lengths_are_further_tracks(written):
    log = open_log(
        written(
            data_set(DATA[:, 0], name="a"),
            data_set(DATA[:, 1], name="b", dt=1 / 256),
            data_set(DATA[:300, 1], name="c"),
            data_set(DATA[:, 2], name="d"),
        )
    )
    assert [[each.name for each in track.channels] for track in log.tracks] == [["a", "d"], ["b"], ["c"]]
    assert [(track.fs, track.n_samples) for track in log.tracks] == [(512.0, N), (256.0, N), (512.0, 300)]
    assert len({track.name for track in log.tracks}) == 3


def test_an_uneven_abscissa_gives_stamps(written):
    stamps = np.arange(N) / 100
    log = open_log(written(data_set(DATA[:, 0], abscissa_spacing=0, x=stamps)))
    (block,) = log.tracks[0].blocks()
    assert log.tracks[0].fs is None
    np.testing.assert_allclose(block.stamps, stamps, atol=1e-5)
    np.testing.assert_allclose(block.samples[:, 0], DATA[:, 0], atol=1e-10)
    assert read_log(log.path).fs == 100.0


def test_channels_without_a_telling_name_go_by_node_and_direction(written):
    path = written(*[data_set(DATA[:, k], name="Acceleration", node=k + 7) for k in range(2)])
    assert open_log(path).names == ("7+Z", "8+Z")
    assert open_log(path, LogSettings(names=("a", "b [N]"))).names == ("a", "b")
    with pytest.raises(InputError, match="2 channel"):
        open_log(path, LogSettings(names=("a",)))


def test_a_unit_that_no_label_states_is_that_of_the_settings(written):
    path = written(data_set(DATA[:, 0], name="a", unit="NONE"))
    with pytest.raises(InputError, match="states no unit"):
        read_log(path)
    np.testing.assert_allclose(read_log(path, LogSettings(unit="g")).samples[:, 0], DATA[:, 0] * 9.80665, rtol=1e-10)
    assert read_log(path, LogSettings(unit="g", fs_hz=100)).fs == 100.0


def test_only_time_histories_are_read(written):
    spectrum = data_set(np.abs(DATA[:, 0]), func_type=9, name="psd", abscissa_spec_data_type=18)
    response = data_set(DATA[:, 0] + 1j * DATA[:, 1], func_type=4, name="frf", abscissa_spec_data_type=18)
    with pytest.raises(InputError, match=r"but 1 x power spectral density, 1 x frequency response function: export"):
        open_log(written(spectrum, response))
    assert open_log(written(spectrum, data_set(DATA[:, 0], name="a"))).names == ("a",)


def test_a_file_without_functions_says_what_it_holds(tmp_path):
    path = tmp_path / "nodes.unv"
    path.write_text("    -1\n   151\nmodel\nNONE\nNONE\n    -1\n    -1\n    15\n    -1\n")
    with pytest.raises(InputError, match="holds no time histories, but 1 x data set 151, 1 x data set 15: export"):
        open_log(path)


def test_what_is_written_reads_back_to_the_last_bit(tmp_path):
    path = tmp_path / "run.uff"
    write_log(RUN, path)
    again = read_log(path)
    np.testing.assert_array_equal(again.samples, RUN.samples)
    assert (again.fs, again.start_s, again.channels) == (RUN.fs, RUN.start_s, RUN.channels)


def test_what_is_written_is_sound_for_pyuff(tmp_path):
    path = tmp_path / "run.uff"
    write_log(RUN, path)
    file = pyuff.UFF(str(path))
    assert file.get_set_types().tolist() == [58, 58, 58]
    second = file.read_sets(1)
    np.testing.assert_array_equal(second["data"], RUN.samples[:, 1])
    assert (second["id1"], second["ordinate_axis_units_lab"], second["func_type"]) == ("Rad/ü", "N", 1)
    np.testing.assert_allclose(second["x"], RUN.time_s, rtol=1e-6)
    assert second["n_bytes"] == 8 * N


def test_an_exact_rate_that_the_header_belies_is_not_believed(tmp_path):
    path = tmp_path / "run.uff"
    write_log(RUN, path)
    path.write_bytes(path.read_bytes().replace(b"3.700000E-03", b"2.000000E-03"))
    assert read_log(path).fs == 500.0


@pytest.mark.parametrize("channel", [("a" * 81, "N"), ("NONE", "N"), ("a\nb", "N"), (" a", "N"), ("a [g]", "N")])
def test_names_that_the_format_does_not_hold_are_refused(tmp_path, channel):
    run = Recording(np.zeros((3, 1)), fs=1.0, channels=(Channel(*channel),))
    with pytest.raises(InputError, match="does not hold the name"):
        write_log(run, tmp_path / "run.uff")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"%10d%10d%10d" % (4, N, 1), b"%10d%10d%10d" % (4, 2 * N, 1), r"says that it holds 1200 samples, 600 are"),
        (b"%10d%10d%10d" % (4, N, 1), b"%10d%10d%10d" % (4, 10**9, 1), "its header is damaged"),
        (b"%10d%10d%10d" % (4, N, 1), b"%10d%10d%10d" % (4, 0, 1), "data set 1, says that it holds 0 samples"),
        (b"%10d%10d%10d" % (4, N, 1), b"%10d%10s%10d" % (4, b"many", 1), "header of data set 1 is damaged"),
        (b"3.700000E-03", b"0.000000E+00", "states a rate of 0 Hz"),
        (b"3.700000E-03", b"         nan", "states a rate of nan Hz"),
        (b" 3.700000E-03", b"-3.700000E-03", "states a rate of -270.27 Hz"),
        (b"3.700000E-03", b"1.000000E-12", r"states a rate of 1e\+12 Hz: give the true one as fs_hz"),
        (b"    58b", b"    99b", "no time histories, but 3 x data set 99"),
    ],
)
def test_a_header_that_lies_is_found_out(tmp_path, old, new, message):
    path = tmp_path / "run.uff"
    write_log(RUN, path)
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))
    with pytest.raises(InputError, match=message) as raised:
        read_log(path)
    assert "run.uff" in str(raised.value)


@pytest.mark.parametrize("part", [0.01, 0.04, 0.2, 0.34, 0.5, 0.9, 0.9999])
@pytest.mark.parametrize("binary", [0, 1])
def test_a_file_that_is_cut_off_is_refused(written, part, binary):
    path = written(*[data_set(DATA[:, k], name=f"gear {k}", binary=binary) for k in range(3)])
    content = path.read_bytes()
    path.write_bytes(content[: int(part * len(content)) - 2])
    with pytest.raises(InputError, match=r"cut off|begins like|is no UFF58 file"):
        read_log(path)


def test_another_file_under_the_name_is_refused(tmp_path):
    path = tmp_path / "run.uff"
    path.write_bytes(b"PK\x03\x04 and so on")
    with pytest.raises(InputError, match="is no UFF58 file, it begins like a ZIP archive"):
        open_log(path)


@needs_samples
def test_a_real_file_of_four_accelerometers():
    run = read_log(SAMPLES / "MPSTD.uff")
    assert (run.fs, run.n_samples, run.duration_s) == (3200.0, 222400, 69.5)
    assert run.names == ("MPS set1 Dof1", "MPS set1 Dof2", "MPS set1 Dof3", "MPS set1 Dof4")
    assert {channel.unit for channel in run.channels} == {"m/s^2"}
    raw = np.frombuffer((SAMPLES / "MPSTD.uff").read_bytes().split(b"\n", 13)[13][: 4 * 1000], dtype="<f4")
    np.testing.assert_array_equal(run.samples[:1000, 0], raw)


@needs_samples
def test_the_same_record_in_ascii_and_in_binary():
    text, binary = (read_log(SAMPLES / f"Sample_UFF58{kind}.uff") for kind in ("_ascii", "b_bin"))
    assert (text.fs, text.channels, text.n_samples) == (binary.fs, binary.channels, binary.n_samples)
    assert (text.fs, text.channels[0].unit, text.n_samples) == (65536.0, "Pa", 79292)
    np.testing.assert_allclose(text.samples, binary.samples, rtol=6e-6, atol=1e-12)


@needs_samples
def test_a_real_spectrum_is_refused():
    with pytest.raises(InputError, match="no time histories, but 1 x power spectral density"):
        open_log(SAMPLES / "sample_dataset58_psd.uff")
