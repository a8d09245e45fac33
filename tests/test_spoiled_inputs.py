"""Files beside a study, spoiled in every way of `spoilers`: they are read, or refused in one sentence that names them.

The same examples are drawn each time; `benchmarks/spoiled_inputs.py` runs such files through every command, and
`benchmarks/fuzz_readers.py` searches for as long as one likes. What either of them found is a
file of `tests/corpus`, or stands below by itself.
"""

import json
import os
import random
import warnings
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import pytest
from cli_runs import opid, refused
from hypothesis import HealthCheck, Phase, given, settings
from made_chain import curve_of, small_chain
from made_flights import body_result
from scipy import sparse
from scipy.io import hb_write, mmwrite
from small_logs import ended_after
from spoilers import OF_FORMAT, PLACES, put_nothing, put_unreadable, spoil, spoiled
from test_planning import FILE
from test_updating_study_file import STUDY

from opid.campaigns.campaign_file import read_rows
from opid.cli import group
from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.truth import UpdatingTruth
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.modes_file import read_modes, write_modes
from opid.modal.resonance.curve_file import read_curve
from opid.planning.guess import read_guess
from opid.provenance import traced
from opid.signals.recording import recording_from_arrays
from opid.studies.modal_study import read_decays
from opid.studies.stored_fits import read_fits
from opid.studies.study_file import read_study
from opid.studies.suspension_study import read_loading
from opid.suspensions.flights.dataset import read_dataset
from opid.suspensions.flights.result_file import read_flight
from opid.updating.measured import MeasuredBackbone, SensorHarmonic, read_backbone, write_backbone
from opid.updating.structure.matrices_file import read_structure, write_structure
from opid.virtual.truth_file import read_truth, tabulate_truth

# what fails is not made smaller, which takes minutes where a line has megabytes
BOUNDED = settings(
    max_examples=60,
    derandomize=True,
    database=None,
    suppress_health_check=[*HealthCheck],
    phases=[Phase.generate],
)
MODES = LinearModes([20.0, 31.0, 55.0], [0.004, 0.01, 0.006], np.arange(1.0, 13.0).reshape(4, 3), ("a", "b", "c", "d"))
CURVE = "frequency_hz,amplitude [m/s^2],phase [deg],force [N]\n" + "".join(
    f"{10 + 0.1 * k},{2 / (1 + (k - 10) ** 2)},{90 + 8 * (k - 10)},1.5\n" for k in range(20)
)
LOADING = "mass_kg,x_m,y_m\n200,1.5,0\n120,-0.5,0.25\n"
FLIGHTS = "tail,flight,date,study,temperature_c\nA,f1,2026-01-12,f1/study.toml,-3\nA,f2,2026-02-09,f2/study.toml,2\n"
LAW = Law((Term("cubic_stiffness", (6.8e7,)),))
TRUTH = UpdatingTruth({"E": 1.0}, {"end": LAW}, "a chain", {"seed": 1})


@dataclass(frozen=True)
class Reader:
    """A file that a user hands over: its name, how it is written and read."""

    name: str
    write: object
    read: object

    def make(self, folder):
        path = folder / self.name
        self.write(path)
        return path


def write_chain(path):
    write_structure(path.with_name("structure.npz"), small_chain())
    write_backbone(curve_of(), path.with_name("first.csv"))
    path.write_text(STUDY)


def write_market(path):
    mmwrite(path, sparse.coo_matrix(small_chain().mass))


def write_labels(path):
    write_structure(path.with_name("structure.npz"), small_chain())
    path.write_text("node,dof\n" + "".join(f"{node},{dof}\n" for node, dof in enumerate(small_chain().dofs)))


def read_with_labels(path):
    return read_structure(path.with_name("structure.npz"), dofs=path)


READERS = {
    "matrices": Reader("structure.npz", lambda path: write_structure(path, small_chain()), read_structure),
    "matrix": Reader(
        "mass.mtx", write_market, lambda path: read_structure({"mass": path, "stiffness": path}, sensors=["1"])
    ),
    "sparse": Reader(
        "mass.npz",
        lambda path: sparse.save_npz(path, sparse.coo_matrix(small_chain().mass)),
        lambda path: read_structure({"mass": path, "stiffness": path}, sensors=["1"]),
    ),
    "labels": Reader("dofs.csv", write_labels, read_with_labels),
    "modes npz": Reader("modes.npz", lambda path: write_modes(MODES, path), read_modes),
    "modes csv": Reader("modes.csv", lambda path: write_modes(MODES, path), read_modes),
    "backbone": Reader(
        "first.csv",
        lambda path: write_backbone(curve_of(), path),
        lambda path: read_backbone(path, mode=1, controlled_sensor="tip"),
    ),
    "curve": Reader("curve.csv", lambda path: path.write_text(CURVE), lambda path: read_curve(path, sensor="a")),
    "loading": Reader("loading.csv", lambda path: path.write_text(LOADING), read_loading),
    "flights": Reader("flights.csv", lambda path: path.write_text(FLIGHTS), read_rows),
    "truth": Reader(
        "truth.json",
        lambda path: path.write_text(json.dumps(tabulate_truth(TRUTH))),
        lambda path: read_truth(path, UpdatingTruth),
    ),
    "study": Reader("study.toml", write_chain, read_study),
    "guess": Reader("guess.toml", lambda path: path.write_text(FILE), read_guess),
    "result": Reader(
        "result.json",
        lambda path: path.write_text(json.dumps(body_result(np.random.default_rng(1), day="2026-03-01"))),
        lambda path: read_flight(path, "one"),
    ),
}


def read_or_refuse(read, path):
    """Read a file, and check that a refusal is one sentence that names it and warns of nothing beside."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            read(path)
        except InputError as error:
            said = group.as_line(str(error))
            assert path.name in said, said
            assert len(said) <= 1503


@pytest.mark.parametrize("name", READERS)
def test_a_spoiled_file_is_read_or_refused(name, tmp_path):
    reader = READERS[name]
    path = reader.make(tmp_path)
    whole = path.read_bytes()

    @BOUNDED
    @given(spoiled(whole, path.suffix))
    def check(change):
        path.write_bytes(change[0])
        read_or_refuse(reader.read, path)

    with ended_after(120):
        check()


@pytest.fixture(scope="module")
def result(identified):
    """The content of a result.json."""
    return json.dumps(traced(identified.result.to_dict(), ()))


@pytest.mark.parametrize("read", [lambda path: read_flight(path, "one"), read_fits], ids=["flight", "fits"])
def test_a_spoiled_result_is_read_or_refused(result, read, tmp_path):
    path = tmp_path / "result.json"

    @BOUNDED
    @given(spoiled(result.encode(), ".json"))
    def check(change):
        path.write_bytes(change[0])
        read_or_refuse(read, path)

    with ended_after(120):
        check()


@pytest.mark.parametrize("put", PLACES)
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file_is_refused(name, put, tmp_path):
    if put is put_unreadable and getattr(os, "geteuid", lambda: 1)() == 0:
        pytest.skip("root reads everything")
    reader = READERS[name]
    path = reader.make(tmp_path)
    put(path)
    with ended_after(20), pytest.raises(InputError) as caught:
        reader.read(path)
    assert path.name in str(caught.value)
    assert put is put_nothing or "did you mean" not in str(caught.value)


@pytest.mark.parametrize("ending", OF_FORMAT)
def test_every_spoiler_works(ending, tmp_path):
    sound = {path.suffix: path.read_bytes() for each in READERS.values() for path in [each.make(tmp_path)]}[ending]
    rng = random.Random(1)
    changed = {name: content for content, names in (spoil(sound, ending, rng) for _ in range(400)) for name in names}
    assert {each.__name__ for each in OF_FORMAT[ending]} <= changed.keys()


# ---- what was found ----------------------------------------------------------------------------------

CORPUS = sorted(path for path in (Path(__file__).parent / "corpus").rglob("*") if path.is_file())
"""Small files that once broke a reader, and others of each kind of `spoilers`: a folder for each reader, named so."""


def read_matrix(path):
    """Read a file that is one of the matrices of a structure."""
    return read_structure({"mass": path, "stiffness": path})


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_each_file_of_the_corpus_is_read_or_refused(path, tmp_path):
    """Python's parser, with which numpy reads headers, raises many kinds of exceptions, and zipfile an IndexError."""
    reader = READERS.get(path.parent.name.replace("_", " "), Reader("mass.npy", Path.touch, read_matrix))
    read = reader.make(tmp_path)
    read.write_bytes(path.read_bytes())
    with ended_after(60):
        read_or_refuse(reader.read, read)


def test_the_corpus_is_small_and_has_every_reader():
    assert {each.parent.name for each in CORPUS} == {name.replace(" ", "_") for name in (*READERS, "matrix")}
    assert all(each.stat().st_size <= 4096 for each in CORPUS)
    assert sum(each.stat().st_size for each in CORPUS) <= 150_000


def test_pointers_of_a_sparse_matrix_that_fall_are_refused(tmp_path):
    """scipy checks no pointers whose last one is below zero."""
    path = READERS["matrices"].make(tmp_path)
    arrays = dict(np.load(path))
    for name, wrong in (
        ("mass_indptr", -arrays["mass_indptr"]),
        ("mass_indptr", arrays["mass_indptr"].astype(float)),
        ("mass_indices", arrays["mass_indices"] - 9),
        ("mass_indices", arrays["mass_indices"] + (1 << 30)),
        ("mass_indptr", arrays["mass_indptr"][:0]),
        ("mass_data", np.zeros(4, dtype=[("a", "f8")])),
        ("mass_data", np.full(4, 1e300)),
        ("mass_data", np.full(4, np.inf)),
    ):
        np.savez(path, **arrays | {name: wrong})
        with pytest.raises(InputError, match=r"structure\.npz"):
            read_structure(path)


@pytest.mark.parametrize("schema", [[1], {}, 1, True, "opid.identification/99", "x" * 10_000])
def test_a_schema_that_is_none_is_refused(schema, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(json.dumps({"schema": schema}))
    with pytest.raises(InputError, match=r"where .opid.identification.1. is needed") as caught:
        read_fits(path)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("number", "words"),
    [
        ("9" * 400, "a whole number of 400 digits"),
        ("1e999", "no number without an end"),
        ("NaN", "no number without an end"),
        ("1e300", "no result has a number beyond 1e"),
    ],
)
def test_numbers_that_no_result_has_are_refused(number, words, tmp_path):
    path = tmp_path / "result.json"
    path.write_text(f'{{"schema": "opid.identification/1", "parameters": {number}}}')
    with pytest.raises(InputError, match=words):
        read_fits(path)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e300", "1e-300"])
def test_numbers_that_no_study_has_are_refused(value, tmp_path):
    path = tmp_path / "guess.toml"
    path.write_text(FILE.replace("sprung_mass_kg = 1850", f"sprung_mass_kg = {value}"))
    with pytest.raises(InputError, match=r"'sprung_mass_kg' in .*, give a number"):
        read_guess(path)


@pytest.mark.parametrize("value", ["1e-60", "-1e60", "1e300"])
def test_a_size_that_no_study_has_is_told_with_both_ends(value, tmp_path):
    path = tmp_path / "guess.toml"
    path.write_text(FILE.replace("sprung_mass_kg = 1850", f"sprung_mass_kg = {value}"))
    with pytest.raises(InputError, match=r"whose size is not between 1e-50 and 1e\+50, give a number"):
        read_guess(path)


@pytest.mark.parametrize(
    ("samples", "fs", "words"),
    [
        ([0.0, 1e300], 10.0, "has values up to 1e.300, which nothing measures"),
        ([0.0, 1e-300], 10.0, "has values up to 1e-300, which nothing measures"),
        ([0.0, 1.0], 1e300, "that of a recorder is"),
        ([0.0, 1.0], np.nan, "that of a recorder is"),
        (
            [0.0, 1.0],
            1e-13,
            r"fs is 1e-13 Hz, and that of a recorder is 0.0001 to 1e\+10 Hz: check the unit",
        ),
    ],
)
def test_a_recording_of_what_nothing_measures_is_refused(samples, fs, words):
    with pytest.raises(InputError, match=words):
        recording_from_arrays([samples], ["a"], fs=fs)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"covariance": lambda old: old[:-1]}, "do not belong together"),
        ({"covariance": lambda old: [row[:-1] for row in old]}, "do not belong together"),
        ({"covariance": lambda old: [[-each for each in row] for row in old]}, "a covariance that is none"),
        (
            {"covariance": lambda old: [[1e3 * each * (i == 0) + each for each in row] for i, row in enumerate(old)]},
            "none",
        ),
        ({"vector": lambda old: [*old[:4], -old[4], *old[5:]]}, "1/kg, which is not positive"),
        ({"noise_m_per_s2": lambda old: [[0.0], old[1]]}, "has a noise that is not positive"),
        ({"names": lambda old: [each.replace("_mass", "_mess") for each in old]}, "names no 'inverse_mass'"),
        ({"repeatability": lambda old: -0.1}, "has the repeatability -0.1, which is negative"),
        ({"groups": lambda old: [*old, *old]}, "has groups of other interfaces than its own"),
        ({"motion_rms": lambda old: [[0.0, 1.0]]}, "has a motion that is not positive"),
        ({"motion_rms": lambda old: []}, "do not belong together"),
        ({"rate_hz": lambda old: -1.0}, "has the rate -1 Hz, which is not positive"),
        ({"runs": lambda old: []}, "do not belong together"),
    ],
)
def test_a_fit_that_is_none_gives_no_forces(change, words, result, field_test, tmp_path):
    document = json.loads(result)
    (fit,) = document["fits"]
    assert fit["names"][4] == "inverse_mass"
    document["fits"] = [fit | {name: make(fit[name]) for name, make in change.items()}]
    (tmp_path / "result.json").write_text(json.dumps(document))
    refused(opid("sense", field_test / "study.toml", tmp_path / "result.json", "--out", tmp_path / "out"), words)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("value", -1850.0, "interval95 is .*, which does not hold the value"),
        ("std", -3.0, "std is -3.0 where a positive number is needed"),
        ("interval95", [9e9, 1e10], "does not hold the value"),
    ],
)
def test_a_mass_that_is_none_is_not_compared(name, value, words, result, tmp_path):
    document = json.loads(result)
    document["parameters"]["sprung_mass_kg"][name] = value
    (tmp_path / "result.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=words):
        read_flight(tmp_path / "result.json", "one")


def test_many_names_take_no_time(tmp_path):
    """It was the square of their number: minutes for an archive of some thousand bytes."""
    path = READERS["matrices"].make(tmp_path)
    arrays = dict(np.load(path))
    np.savez_compressed(path, **arrays | {"joints": np.arange(150_000.0).reshape(-1, 3)})
    with ended_after(60), pytest.raises(InputError, match=r"structure\.npz"):
        read_structure(path)


def test_a_frequency_that_is_nearly_zero_is_none():
    with pytest.raises(InputError, match="give 0 for rigid-body modes"):
        LinearModes([1e-300, 20.0], [0.0, 0.01], np.ones((2, 2)), ("a", "b"))


def test_a_study_of_decays_is_refused_before_it_is_read_on(tmp_path):
    (tmp_path / "study.toml").write_text('modes = ""\n[[tests]]\nlog = "a.csv"\n')
    with pytest.raises(InputError, match="'modes' in the study is ''"):
        read_decays(tmp_path / "study.toml", [], print)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no such pipes")
def test_a_pipe_in_a_dataset_is_refused(tmp_path):
    part = tmp_path / "tail=D-001" / "part-00000.parquet"
    part.parent.mkdir()
    os.mkfifo(part)
    with ended_after(20), pytest.raises(InputError, match="a pipe"):
        read_dataset(tmp_path)


@pytest.mark.parametrize("is_repeated", [False, True])
def test_many_rows_of_modes_take_no_time(is_repeated, tmp_path):
    """It was the square of their number, in the file and in the modes themselves: 95 s for 40,000 rows."""
    path = tmp_path / "modes.csv"
    names = [f"s{number}" for number in range(60_000)]
    names[-1] = names[-2] if is_repeated else names[-1]
    path.write_text("name,1\nfrequency_hz,20\ndamping_ratio,0.01\n" + "".join(f"{name},1\n" for name in names))
    with ended_after(60):
        if is_repeated:
            with pytest.raises(InputError, match=r"modes\.csv: 2 rows are called 's59998': rename them"):
                read_modes(path)
        else:
            assert read_modes(path).sensors == tuple(names)


def test_many_harmonics_take_no_time():
    names = tuple(f"s{number}" for number in range(50_000))
    amplitude = np.outer(np.linspace(1e-3, 2e-3, 10), np.ones(len(names)))
    harmonics = tuple(SensorHarmonic(name, 3, np.full(10, 1e-4)) for name in names)
    with ended_after(60), pytest.raises(InputError, match=r"harmonic 3 of 's49999' .* is given twice"):
        MeasuredBackbone("a", 1, "s0", np.full(10, 20.0), amplitude, names, harmonics=(*harmonics, harmonics[-1]))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("labels", "dof\n" + "x" * 200_000 + "\n"),
        ("modes csv", "name,1\nfrequency_hz," + "1" * 200_000 + "\n"),
        ("loading", "mass_kg,x_m,y_m\n1,2," + "3" * 200_000 + "\n"),
        ("flights", "flight\n" + "x" * 200_000 + "\n"),
        ("labels", 'dof\n"a\n'),
    ],
)
def test_a_cell_that_is_none_is_refused(name, text, tmp_path):
    """A cell may be shorter than the longest line and longer than any that Python's csv takes."""
    path = READERS[name].make(tmp_path)
    path.write_text(text)
    with pytest.raises(InputError, match=r"line \d is no row of a table \(.*\): mend this line") as caught:
        READERS[name].read(path)
    assert path.name in str(caught.value)


FAR = 10**11
HEAD = "%%MatrixMarket matrix"


@pytest.mark.parametrize(
    "text",
    [
        f"{HEAD} array real general\n{FAR} 1\n1.0\n",
        f"{HEAD} array real general\n{FAR} {10 * FAR}\n1.0\n",
        f"{HEAD} coordinate real general\n{FAR} {FAR} 1\n1 1 1.0\n",
        f"{HEAD} coordinate real symmetric\n4 4 {FAR}\n1 1 1.0\n",
    ],
)
def test_a_matrix_market_file_that_says_more_than_there_is_room_for_is_refused(text, tmp_path):
    """One of 75 bytes asked the system for 745 GB, and the answer named no file."""
    path = tmp_path / "mass.mtx"
    path.write_text(text)
    with pytest.raises(InputError, match=r"mass\.mtx: its arrays would take .* GB"):
        read_structure({"mass": path, "stiffness": path})


@pytest.mark.parametrize("kind", ["coo", "dia", "csc"])
def test_a_sparse_archive_that_says_more_than_there_is_room_for_is_refused(kind, tmp_path):
    path = tmp_path / "mass.npz"
    sparse.save_npz(path, sparse.eye(4, format=kind))
    np.savez(path, **dict(np.load(path)) | {"shape": np.array([FAR, FAR])})
    with pytest.raises(InputError, match=r"mass\.npz: its arrays would take .* GB"):
        read_structure({"mass": path, "stiffness": path})


@pytest.mark.parametrize("shape", [np.array(4), np.array([4.0, 4.0]), np.array(["4", "4"]), np.array([4, 4, 4]), None])
def test_the_shape_of_a_sparse_archive_is_two_whole_numbers(shape, tmp_path):
    path = tmp_path / "mass.npz"
    sparse.save_npz(path, sparse.eye(4, format="coo"))
    arrays = dict(np.load(path))
    del arrays["shape"]
    np.savez(path, **arrays if shape is None else arrays | {"shape": shape})
    with pytest.raises(InputError, match=r"mass\.npz: it(s shape is not two| lacks shape).*: write it with"):
        read_structure({"mass": path, "stiffness": path})


def test_a_boeing_file_that_says_more_than_there_is_room_for_is_refused(tmp_path):
    path = tmp_path / "mass.hb"
    hb_write(str(path), sparse.csc_matrix(np.eye(4)))
    lines = path.read_text().splitlines()
    lines[2] = lines[2][:14] + f"{FAR:14d}" + lines[2][28:]
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r"mass\.hb: its arrays would take .* GB"):
        read_structure({"mass": path, "stiffness": path})


def test_a_file_of_matrices_that_takes_all_memory_is_named(monkeypatch, tmp_path):
    def ask(*_):
        raise MemoryError("Unable to allocate 745. GiB")

    path = READERS["matrix"].make(tmp_path)
    monkeypatch.setattr("opid.updating.structure.matrices_file.read_apart", ask)
    with pytest.raises(InputError, match=r"mass\.mtx needs more memory than there is"):
        READERS["matrix"].read(path)


def test_the_truth_of_another_structure_is_refused(tmp_path):
    """It was a KeyError in the middle of a report."""
    write_chain(tmp_path / "study.toml")
    truth = tmp_path / "truth.json"
    truth.write_text(json.dumps(tabulate_truth(UpdatingTruth({}, {"other": LAW}, "", {}))))
    done = opid("update", tmp_path / "study.toml", "--truth", truth, "--out", tmp_path / "out")
    refused(done, str(truth), "joints other, and the study has end")


@pytest.mark.parametrize("law", [{}, {"name": "no law"}, {"name": "cubic_stiffness", "parameters": {}}])
def test_a_truth_with_a_wrong_law_names_its_file(law, tmp_path):
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(tabulate_truth(TRUTH) | {"laws": {"end": law}}))
    with pytest.raises(InputError, match=r"truth\.json is not the truth of"):
        read_truth(path, UpdatingTruth)


def test_a_loop_of_links_is_no_study(tmp_path, monkeypatch):
    """`Path.resolve` raises a RuntimeError for it."""
    monkeypatch.chdir(tmp_path)
    Path("study.toml").symlink_to("study.toml")
    refused(opid("identify", "study.toml"), "study.toml")


def test_a_file_that_has_no_end_is_not_read(tmp_path):
    path = tmp_path / "truth.json"
    path.symlink_to("/dev/zero")
    with pytest.raises(InputError, match="a directory, a pipe or a device"):
        read_truth(path, UpdatingTruth)


# ---- how a command ends ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shown"),
    [("a\nb", "a b"), ("\x1b[31m", r"\x1b[31m"), ("x" * 5000, "x..."), ("\u202e", r"\u202e"), ("\x00", r"\x00")],
)
def test_a_refusal_is_one_line_that_a_terminal_shows(name, shown):
    done = opid("inspect", name)
    assert done.exit_code == 2
    line = done.stderr.splitlines()[-1]
    assert line.isprintable()
    assert shown in line
    assert len(line) < 1600


ENDS = {
    InputError("no number: give one"): (2, "Error: study.toml: no number: give one"),
    NotDeterminedError("too few"): (1, "Error: too few"),
    click.UsageError("no such option"): (2, "Error: no such option"),
    MemoryError(): (2, "Error: it needs more memory than there is"),
    OSError(28, "No space left on device", "out"): (2, "Error: out: No space left on device"),
    OSError(5, "Input/output error"): (2, "Error: the system refuses: Input/output error"),
    PermissionError(13, "Permission denied", "out"): (2, "Error: out: Permission denied"),
    KeyboardInterrupt(): (130, "Error: interrupted"),
}
ITSELF = [
    *(
        ValueError("two\nlines"),
        KeyError("end"),
        TypeError(),
        ZeroDivisionError(),
        RecursionError(),
        AssertionError("x"),
    ),
    *(np.linalg.LinAlgError("Singular matrix"), UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid"), StopIteration()),
    *(NotImplementedError(), RuntimeError("z" * 9000), OverflowError(), AttributeError("x"), Exception()),
]


def end_by(error, monkeypatch, *options):
    def fail(*given, **settings):
        raise error

    monkeypatch.setattr("opid.studies.schema.load", fail)
    monkeypatch.setattr("opid.studies.study_file.load", fail)
    return opid("update", "study.toml", "--out", "never", *options)


@pytest.mark.parametrize("error", ENDS, ids=lambda error: type(error).__name__)
def test_what_belongs_to_the_user_ends_as_one_of_three(error, monkeypatch, tmp_path):
    """Bad input or usage, not determined, or ended from outside."""
    monkeypatch.chdir(tmp_path)
    done = end_by(error, monkeypatch)
    status, line = ENDS[error]
    assert done.exit_code == status
    assert done.stderr.splitlines()[-1].startswith(line)


@pytest.mark.parametrize("error", ITSELF, ids=lambda error: type(error).__name__)
def test_any_other_exception_is_one_sentence_that_says_how_to_report_it(error, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    done = end_by(error, monkeypatch)
    assert done.exit_code == group.Unexpected.exit_code
    (line,) = done.stderr.splitlines()
    assert line.startswith("Error: opid itself failed in study_file.py, line ")
    assert type(error).__name__ in line
    assert "report this line" in line
    assert len(line) < 700
    assert not list(tmp_path.iterdir())


def test_a_verbose_command_shows_the_traceback(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    done = end_by(KeyError("end"), monkeypatch, "--verbose")
    assert "Traceback" in done.stderr
    assert "KeyError: 'end'" in done.stderr


@pytest.mark.parametrize("place", ["opid.cli.output.Output.reserve", "opid.signals.log.LogSettings"])
def test_a_traceback_is_shown_once_wherever_the_error_is_raised(place, monkeypatch, tmp_path):
    """It was shown only while steps were shown."""

    def fail(*_, **settings):
        raise KeyError("\x1b[31mend")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(place, fail)
    for options, n_shown in (((), 0), (("--verbose",), 1)):
        done = opid("inspect", "a.csv", "--out", "never", *options)
        assert done.exit_code == group.Unexpected.exit_code
        assert done.stderr.count("Traceback (most recent call last)") == n_shown
        assert done.stderr.splitlines()[-1].startswith("Error: opid itself failed")
        assert "\x1b" not in done.stderr


@pytest.mark.parametrize("error", [InputError("no number: give one"), OSError(28, "No space left", "out")], ids=str)
def test_what_belongs_to_the_user_has_no_traceback(error, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert "Traceback" not in end_by(error, monkeypatch, "--verbose").stderr


@pytest.mark.parametrize("kind", [[("a", "f8"), ("b", "i4")], "M8[s]", "V8"])
def test_arrays_of_records_and_of_times_are_no_matrices(kind, tmp_path):
    np.savez(tmp_path / "own.npz", mass=np.zeros((3, 3), dtype=kind), stiffness=np.eye(3))
    with pytest.raises(InputError, match="'mass' of it holds neither numbers nor text"):
        read_structure(tmp_path / "own.npz")
