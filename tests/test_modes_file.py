import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from opid.errors import InputError
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.modes_file import looks_in_percent, looks_unit_normalised, read_modes, write_modes

ENDINGS = pytest.mark.parametrize("ending", ["npz", "csv"])

TABLE = """sensor,mode 1,mode 2,mode 3
frequency_hz,0,25.5,31
damping_ratio,0,0.004,0.006
nose,0.5,0.3,-0.2
tail,0.5,-0.3,0.7
"""


def some_modes(n_sensors=24, n_modes=18, seed=0):
    rng = np.random.default_rng(seed)
    frequency = np.concatenate([np.zeros(6), np.sort(rng.uniform(20, 500, n_modes - 6))])
    sensors = tuple(f"{100 + k // 3}:{'+x+y+z'[2 * (k % 3) : 2 * (k % 3) + 2]}" for k in range(n_sensors))
    return LinearModes(frequency, rng.uniform(0, 0.02, n_modes), rng.standard_normal((n_sensors, n_modes)) / 7, sensors)


def same(one, other):
    pairs = ((getattr(one, name), getattr(other, name)) for name in ("frequency_hz", "damping_ratio", "shapes"))
    return one.sensors == other.sensors and all(np.array_equal(first, second) for first, second in pairs)


@ENDINGS
def test_modes_come_back_to_the_last_bit(tmp_path, ending):
    modes = some_modes()
    path = tmp_path / f"modes.{ending}"
    write_modes(modes, path)
    assert same(read_modes(path), modes)


names = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=8)


@settings(max_examples=30)
@given(
    sensors=st.lists(names.map(lambda name: "s" + name), min_size=1, max_size=4, unique=True),
    value=st.floats(1e-50, 1e50) | st.floats(-1e50, -1e-50),
)
def test_any_number_and_any_name_come_back(tmp_path_factory, sensors, value):
    modes = LinearModes([3.0], [0.1], np.full((len(sensors), 1), value), tuple(sensors))
    directory = tmp_path_factory.mktemp("modes")
    for ending in ("csv", "npz"):
        path = directory / f"modes.{ending}"
        write_modes(modes, path)
        assert same(read_modes(path), modes)


@pytest.mark.parametrize(
    "text",
    [
        TABLE,
        TABLE.replace(",", ";"),
        TABLE.replace(",", "\t"),
        TABLE.replace(",", ";").replace(".", ","),
        TABLE.replace(",", ";\t").replace("\t", " "),
        "\ufeff" + TABLE.replace("\n", "\r\n"),
        TABLE.replace("sensor,mode 1", "Name,#1").replace("frequency_hz", "Frequency [Hz]"),
        TABLE.replace("damping_ratio,0,", "zeta,,"),
        TABLE.replace("\n", ",\n") + "\n,,,\n\n",
        TABLE.split("\n", 1)[1],
        "sensor,a,b,c\ntail,0.5,-0.3,0.7\ndamping_ratio,0,0.004,0.006\nnose,0.5,0.3,-0.2\nfn,0,25.5,31\n",
    ],
)
def test_tables_are_read_however_they_are_spelled(tmp_path, text):
    path = tmp_path / "modes.csv"
    path.write_bytes(text.encode())
    modes = read_modes(path)
    assert modes.frequency_hz.tolist() == [0.0, 25.5, 31.0]
    assert modes.damping_ratio.tolist() == [0.0, 0.004, 0.006]
    assert modes.row("tail").tolist() == [0.5, -0.3, 0.7]
    assert set(modes.sensors) == {"nose", "tail"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "one column"),
        ("a b c\n1 2 3\n", "one column"),
        (TABLE.replace("damping_ratio", "damping_raito"), "no row 'damping_ratio'.*did you mean 'damping_raito'"),
        (TABLE.replace("frequency_hz", "omega_rad_s"), "no row 'frequency_hz'"),
        (TABLE + "fn,1,2,3\n", "both stand for frequency_hz"),
        (TABLE + "tail,1,2,3\n", "2 rows are called 'tail'"),
        (TABLE.replace("25.5", "about 25"), "line 2 .'frequency_hz'. has 'about 25' where a number"),
        (TABLE.replace("-0.3", "-0.3+0.1j"), "line 5 .'tail'. has the complex value.*real normal modes"),
        (TABLE.replace("-0.3", "-0.3+0.1i"), "real normal modes"),
        (TABLE.replace(",0.7", ""), "line 5 .'tail'. has 2 values and frequency_hz has 3"),
        (TABLE.replace("0.004", "0.4").replace("0.006", "1.6"), "0.004, not 0.4 %"),
        (TABLE.replace("0.004", ""), "not finite"),
        (TABLE[: TABLE.index("nose")], "no row of a sensor"),
        ("mode,frequency_hz,damping_ratio,nose\n1,25,0.004,0.5\n2,30,0.004,0.5\n", "each of its rows is a mode"),
        ("sensor,\nfrequency_hz,\ndamping_ratio,\nnose,\n", "has no values"),
    ],
)
def test_a_faulty_table_is_refused_with_the_place(tmp_path, text, words):
    path = tmp_path / "modes.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as error:
        read_modes(path)
    assert str(path) in str(error.value)


ARRAYS = {
    "frequency_hz": np.array([0.0, 25.0, 30.0]),
    "damping_ratio": np.array([np.nan, 0.004, 0.006]),
    "shapes": np.arange(1.0, 7.0).reshape(2, 3),
    "sensors": np.array(["nose", "tail"]),
}


def test_arrays_of_other_programs_are_read(tmp_path):
    path = tmp_path / "modes.npz"
    given = {**ARRAYS, "sensors": np.array([b"nose", b"tail"]), "shapes": ARRAYS["shapes"].astype(complex)}
    given["frequency_hz"] = given["frequency_hz"][None, :]  # a MATLAB row
    given["phi"] = given.pop("shapes")
    np.savez(path, **given)
    modes = read_modes(path)
    assert modes.sensors == ("nose", "tail")
    assert modes.damping_ratio[0] == 0  # that of a rigid-body mode says nothing
    np.testing.assert_array_equal(modes.shapes, ARRAYS["shapes"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"shapes": ARRAYS["shapes"].T}, "3 modes x 2 sensors: transpose it"),
        ({"shapes": ARRAYS["shapes"] + 0.1j}, "complex: give real normal modes"),
        ({"sensors": np.array(["nose", "tail"], dtype=object)}, "Python objects"),
        ({"sensors": np.array([1, 2])}, "sensors holds int64 where names"),
        ({"frequency_hz": np.array(["0", "25", "30"])}, "frequency_hz holds"),
        ({"damping_ratio": None}, "no array 'damping_ratio'"),
        ({"damping_ratio": None, "damping_ratoi": ARRAYS["damping_ratio"]}, "did you mean 'damping_ratoi'"),
        ({"zeta": ARRAYS["damping_ratio"]}, "both stand for damping_ratio"),
        ({"damping_ratio": np.array([0.0, np.nan, 0.1])}, "not finite"),
    ],
)
def test_faulty_arrays_are_refused(tmp_path, change, words):
    path = tmp_path / "modes.npz"
    np.savez(path, **{name: value for name, value in {**ARRAYS, **change}.items() if value is not None})
    with pytest.raises(InputError, match=words):
        read_modes(path)


def test_files_that_hold_no_modes_are_refused(tmp_path):
    for name, content, words in (
        ("a.npz", b"no zip", "no valid .npz"),
        ("b.npz", b"PK\x03\x04 cut off", "no valid .npz"),
        ("c.npz", b"", "no valid .npz"),
        ("d.csv", b"sensor,\xff\xfe\n", "not UTF-8"),
        ("e.txt", b"", "npz, .csv, .uff or .unv"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=words):
            read_modes(tmp_path / name)
    with open(tmp_path / "one.npz", "wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match="one array and no names"):
        read_modes(tmp_path / "one.npz")
    with pytest.raises(InputError, match="there is no file"):
        read_modes(tmp_path / "none.csv")


@ENDINGS
def test_a_failed_write_leaves_nothing(tmp_path, ending):
    with pytest.raises(InputError, match="no directory"):
        write_modes(some_modes(), tmp_path / "missing" / f"modes.{ending}")
    with pytest.raises(InputError, match=r"npz or \.csv"):
        write_modes(some_modes(), tmp_path / "modes.mat")
    assert list(tmp_path.iterdir()) == []


def test_a_table_refuses_sensors_that_would_be_other_rows(tmp_path):
    for name in ("frequency", "zeta", " tip", "two\nlines"):
        modes = LinearModes([1.0], [0.1], [[1.0]], (name,))
        with pytest.raises(InputError, match=r"write an \.npz file"):
            write_modes(modes, tmp_path / "modes.csv")
        write_modes(modes, tmp_path / "modes.npz")
        assert read_modes(tmp_path / "modes.npz").sensors == (name,)


def test_unit_normalised_shapes_are_told_from_mass_normalised_ones():
    modes = some_modes()
    assert looks_unit_normalised(modes) == ""
    for norm, words in (
        (np.abs(modes.shapes).max(axis=0), "largest value"),
        (np.linalg.norm(modes.shapes, axis=0), "sum"),
    ):
        scaled = LinearModes(modes.frequency_hz, modes.damping_ratio, (modes.shapes / norm).round(6), modes.sensors)
        assert words in looks_unit_normalised(scaled)
    assert looks_unit_normalised(LinearModes([1.0], [0.0], [[1.0]], ("a",))) == ""


def test_damping_in_percent_is_suspected():
    shapes = np.ones((1, 3))
    assert looks_in_percent(LinearModes([0, 10, 20], [0, 0.4, 0.6], shapes, ("a",)))
    assert not looks_in_percent(LinearModes([0, 10, 20], [0.9, 0.01, 0.6], shapes, ("a",)))
    assert not looks_in_percent(LinearModes([0, 0, 0], [0.9, 0.3, 0.6], shapes, ("a",)))


def universal(path, *, mass_kg=2.0, analysis=2, drop=False):
    """Write three modes at four nodes, of which z alone moves, as a universal file; return their shapes."""
    pyuff = pytest.importorskip("pyuff")
    rng, sets, shapes = np.random.default_rng(0), [], []
    for number in range(3):
        shapes.append(rng.standard_normal(4))
        nodes = [1, 2, 3, 14 + (drop and number)]
        text = {f"id{k}": "NONE" for k in range(1, 6)}
        still = np.zeros(4)
        own = {
            "r1": still,
            "r2": still,
            "r3": shapes[-1],
            "node_nums": nodes,
            "freq": 10.0 + number,
            "mode_n": number + 1,
        }
        sets.append(
            pyuff.prepare_55(
                model_type=1, analysis_type=analysis, data_ch=3, spec_data_type=8, data_type=2, n_data_per_node=3,
                load_case=1, modal_m=mass_kg, modal_damp_vis=0.01, modal_damp_his=0.0, **text, **own,
            )
        )  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return np.column_stack(shapes)


def test_normal_modes_of_a_universal_file_are_read(tmp_path):
    shapes = universal(tmp_path / "modes.unv")
    modes = read_modes(tmp_path / "modes.unv")
    assert modes.sensors == ("1_z", "2_z", "3_z", "14_z")
    np.testing.assert_allclose(modes.shapes, shapes / np.sqrt(2.0), rtol=1e-4)
    np.testing.assert_allclose(modes.frequency_hz, [10.0, 11.0, 12.0], rtol=1e-4)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"mass_kg": 0.0}, "a modal mass in it is 0 or missing"), ({"drop": True}, "its modes have different nodes")],
)
def test_bad_universal_files_of_modes_are_refused(tmp_path, options, words):
    universal(tmp_path / "modes.uff", **options)
    with pytest.raises(InputError, match=words):
        read_modes(tmp_path / "modes.uff")


def test_what_is_no_universal_file_of_modes_is_refused(tmp_path):
    pytest.importorskip("pyuff")
    (tmp_path / "modes.uff").write_text("nothing\n")
    with pytest.raises(InputError, match=r"none with normal modes|not a valid universal file"):
        read_modes(tmp_path / "modes.uff")
