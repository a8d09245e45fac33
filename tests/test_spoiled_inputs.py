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
from opid.studies.stored_fits import read_fits
from opid.studies.study_file import read_study
from opid.studies.suspension_study import read_loading
from opid.suspensions.flights.result_file import read_flight
from opid.updating.measured import read_backbone, write_backbone
from opid.updating.structure.matrices_file import read_structure, write_structure
from opid.virtual.truth_file import read_truth, tabulate_truth

# what fails is not made smaller, which takes minutes where a line has megabytes
BOUNDED = settings(
    max_examples=60,
    derandomize=True,
    database=None,
    deadline=None,
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


READERS = {
    "matrices": Reader("structure.npz", lambda path: write_structure(path, small_chain()), read_structure),
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


@pytest.mark.parametrize(
    ("samples", "fs", "words"),
    [
        ([0.0, 1e300], 10.0, "has values up to 1e.300, which nothing measures"),
        ([0.0, 1e-300], 10.0, "has values up to 1e-300, which nothing measures"),
        ([0.0, 1.0], 1e300, "give a positive sampling rate"),
        ([0.0, 1.0], np.nan, "give a positive sampling rate"),
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
        ({"vector": lambda old: [*old[:4], -old[4], *old[5:]]}, "mass or rate that is not positive"),
        ({"noise_m_per_s2": lambda old: [[0.0], old[1]]}, "noise, motion"),
        ({"motion_rms": lambda old: [[0.0, 1.0]]}, "noise, motion"),
        ({"motion_rms": lambda old: []}, "do not belong together"),
        ({"rate_hz": lambda old: -1.0}, "rate that is not positive"),
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


@pytest.mark.parametrize("kind", [[("a", "f8"), ("b", "i4")], "M8[s]", "V8"])
def test_arrays_of_records_and_of_times_are_no_matrices(kind, tmp_path):
    np.savez(tmp_path / "own.npz", mass=np.zeros((3, 3), dtype=kind), stiffness=np.eye(3))
    with pytest.raises(InputError, match="'mass' of it holds neither numbers nor text"):
        read_structure(tmp_path / "own.npz")
