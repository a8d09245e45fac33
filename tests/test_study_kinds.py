"""One reader and one writer for every kind of study file: which kind a file is, and which command takes it."""

import shlex
import tomllib
from copy import deepcopy
from importlib import import_module

import numpy as np
import pytest
import tomli_w
from cli_runs import opid as run, refused
from made_body import short_test
from made_chain import curve_of, small_chain
from made_modal import small_study

import opid
from opid.errors import InputError
from opid.modal.study import ModalStudy
from opid.signals.recording import recording_from_arrays
from opid.studies.study_file import KINDS
from opid.studies.suspension_study import find_log_readings
from opid.suspensions.bench.record import BenchStudy
from opid.suspensions.study import Run, Study, study_of_gear
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.study import UpdatingStudy
from opid.virtual.taxi_tests.taxiing import taxi_study

GEAR = "[channels]\nsprung = 'a'\nunsprung = 'b'\n[[runs]]\nname = 'one'\nlog = 'none.csv'\nmass_change_kg = 0\n"
BODY = "[[interfaces]]\nname = 'nose'\nx_m = 1\ny_m = 0\n[[runs]]\nname = 'one'\nlog = 'none.csv'\n[structure]\n"
MODAL = "[modes]\nfile = 'none.npz'\n[channels]\nforce = 'c'\n[[tests]]\nlog = 'none.csv'\n"
BACKBONES = "[structure]\nmatrices = 'none.npz'\n[[backbones]]\nfile = 'none.csv'\n[[classes]]\nlaw = 'cubic'\n"
BENCH = "[bench]\nlog = 'none.csv'\nforce = 'load'\ntravel = 'stroke'\n[channels]\nload = 1\n"
TEXTS = {"gear": GEAR, "body": BODY, "bench": BENCH, "modal": MODAL, "backbones": BACKBONES}
COMMAND = {"gear": "identify", "body": "identify", "bench": "law", "modal": "modal", "backbones": "update"}
SUBJECT = {"identify": "suspensions", "law": "a test bench", "modal": "modal tests", "update": "backbones"}
RECORD = {"identify": Study, "law": BenchStudy, "modal": ModalStudy, "update": UpdatingStudy}
PYPROJECT = "[build-system]\nrequires = []\n[project]\nname = 'x'\n[tool.ruff]\n"


def written(place, text, name="study.toml"):
    path = place / name
    path.write_text(text, encoding="utf-8")
    return path


def columns(path):
    return sorted(zip(*(line.split(",") for line in path.read_text(encoding="utf-8").splitlines()), strict=True))


def gear_study():
    samples = np.random.default_rng(0).standard_normal((2, 1024))
    recording = recording_from_arrays(samples, ("lower", "upper"), fs=512.0, unit="m/s^2")
    return study_of_gear("a gear", sprung="upper", unsprung="lower", runs=(Run("heavy", recording, 0.0),))


def body_study():
    return taxi_study(short_test(), title="an aircraft")


def bench_study():
    rng = np.random.default_rng(1)
    samples = [0.01 * rng.standard_normal(512), 100 * rng.standard_normal(512), np.arange(512) % 7 > 0]
    recording = recording_from_arrays(samples, ("stroke", "load", "held"), fs=512.0, unit=("m", "N", "1"))
    return BenchStudy(
        "a damper", recording, "load", "stroke", counted="held", candidates=("dahl_friction",), most_terms=1
    )


def backbone_study():
    return UpdatingStudy(
        title="a chain",
        structure=small_chain(),
        backbones=(curve_of(),),
        classes=(ModelClass("cubic", (UncertainTerm("cubic_stiffness", (6.8e7,), (Prior(),)),)),),
    )


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.subject)
def test_record_and_module_of_each_kind_are_where_their_names_say(kind):
    module, name = f"opid.{kind.record}".rsplit(".", 1)
    record = getattr(import_module(module), name)
    assert record is RECORD[kind.command]
    # `read_study` and `write_study` compare this name with that of the record
    assert f"{record.__module__}.{record.__qualname__}" == f"opid.{kind.record}"
    own = import_module(f"opid.studies.{kind.module}")
    assert callable(own.build_study)
    assert callable(own.write_files)


@pytest.mark.parametrize("command", SUBJECT)
@pytest.mark.parametrize("kind", TEXTS)
def test_a_command_takes_its_own_kind_of_study_and_names_the_command_of_another(tmp_path, kind, command):
    path = written(tmp_path, TEXTS[kind], "my study.toml")
    said = refused(run(command, path, "--out", tmp_path / "out"))
    right = COMMAND[kind]
    words = f"{path} is a study of {SUBJECT[right]}: use `opid {right} {shlex.quote(str(path))}`"
    if right == command:
        assert "none." in said or "lacks" in said or "neither" in said  # of what is in the study
        assert "use `opid" not in said
    else:
        assert said == f"Error: {words}"
        with pytest.raises(InputError) as caught:
            opid.read_study(path, kind=RECORD[command])
        assert str(caught.value) == words
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", SUBJECT)
@pytest.mark.parametrize(
    ("text", "has"),
    [
        (PYPROJECT, "it has 'build-system', 'project', 'tool'; "),
        ("", "it has no keys; "),
        ("title = 'x'\n[log]\n", "it has 'title', 'log'; "),
        ("".join(f"key_{k} = 1\n" for k in range(30)), "'key_7', ...; "),
        ("runs = []\ntests = []\n", "it has 'runs', 'tests'; "),
    ],
)
def test_a_file_that_is_no_study_is_told_what_each_kind_needs(tmp_path, command, text, has):
    path = written(tmp_path, text, "pyproject.toml")
    said = refused(run(command, path))
    assert said.startswith(f"Error: {path} is no study: ")
    assert has in said
    assert "as a study of suspensions it lacks 'channels', give a table [channels]" in said
    for subject, table in (("a test bench", "bench"), ("modal tests", "modes"), ("backbones", "structure")):
        assert f"as a study of {subject} it lacks '{table}', give a table [{table}]" in said


def test_what_each_kind_needs_is_said_in_one_sentence(tmp_path):
    path = written(tmp_path, PYPROJECT, "pyproject.toml")
    with pytest.raises(InputError) as caught:
        opid.read_study(path)
    assert str(caught.value) == (
        f"{path} is no study: it has 'build-system', 'project', 'tool'; "
        "as a study of suspensions it lacks 'channels', give a table [channels], and lacks 'runs', give one table "
        "[[runs]] for each log; as a study of a test bench it lacks 'bench', give a table [bench]; "
        "as a study of modal tests it lacks 'modes', give a table [modes], and lacks 'tests', "
        "give one table [[tests]] for each log; as a study of backbones it lacks 'structure', give a table "
        "[structure], and lacks 'backbones', give one table [[backbones]] for each file, and lacks 'classes', give "
        "one table [[classes]] for each candidate law"
    )


@pytest.mark.parametrize(
    ("text", "record", "words"),
    [
        ("[[run]]\nname = 'x'\n", Study, "unknown key 'run' (did you mean 'runs'?)"),
        ("[mode]\n[[test]]\n", ModalStudy, "unknown key 'test' (did you mean 'tests'?)"),
        ("[structur]\n[[clases]]\n", UpdatingStudy, "unknown key 'clases' (did you mean 'classes'?)"),
        ("[benc]\nforce = 'x'\n", BenchStudy, "unknown key 'benc' (did you mean 'bench'?)"),
        ("bench = 3\n", BenchStudy, "'bench' in the study is 3"),
        ("[bench]\ntime = 3\n", BenchStudy, "[bench] has an unknown key 'time'"),
        ("[structure]\nmatrices = 'x'\n", UpdatingStudy, "lacks 'backbones'"),
        ("[channels]\nsprung = 'a'\n", Study, "lacks 'runs'"),
        ("runs = 3\n", Study, "'runs' in the study is 3"),
        ("interfaces = []\nstructure = {}\nruns = []\nnoise = {}\n", Study, "unknown key 'noise'"),
        ("tests = []\nmodes = {}\nruns = []\n", ModalStudy, "unknown key 'runs'"),
    ],
)
def test_a_study_with_slips_is_of_the_kind_that_is_meant(tmp_path, text, record, words):
    path = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        opid.read_study(path, kind=record)
    assert words in str(caught.value)


@pytest.mark.parametrize("made", [gear_study, body_study, bench_study, small_study, backbone_study])
def test_every_kind_is_read_as_it_was_written(tmp_path, made):
    study, again = made(), tmp_path / "again"
    again.mkdir()
    opid.write_study(study, tmp_path / "study.toml")
    back = opid.read_study(tmp_path / "study.toml")
    assert type(back) is type(study)
    assert (back.title, back.source) == (study.title, tmp_path / "study.toml")
    opid.write_study(back, again / "study.toml")
    files = sorted(path.name for path in tmp_path.iterdir() if path.is_file())
    assert files == sorted(path.name for path in again.iterdir())
    assert (again / "study.toml").read_bytes() == (tmp_path / "study.toml").read_bytes()
    for name in (name for name in files if name.endswith(".csv")):
        assert columns(again / name) == columns(tmp_path / name)


ODD = (3, -2.5, "text", True, [], [1, 2], ["a"], {}, {"a": 1}, [[1, 2]], [{"x": 1}], float("nan"))


def places(table):
    """Yield each table and list in a document, with each of its keys or numbers."""
    for key in table if isinstance(table, dict) else range(len(table)):
        yield table, key
        if isinstance(table[key], dict | list):
            yield from places(table[key])


def with_a_slip(document, rng):
    """Replace, remove, misspell or add an entry anywhere in a document."""
    found = list(places(document))
    table, key = found[rng.integers(len(found))]
    slip = rng.integers(4)
    if slip == 0 or not isinstance(key, str):
        table[key] = deepcopy(ODD[rng.integers(len(ODD))])
    elif slip == 1:
        table[key[1:]] = table.pop(key)
    elif slip == 2:
        del table[key]
    else:
        words = ("log", "axis", "name", "loading", "structure", "channels", "sensors", "mode", "shapes")
        table[words[rng.integers(len(words))]] = deepcopy(ODD[rng.integers(len(ODD))])


@pytest.mark.parametrize("made", [gear_study, body_study, bench_study, small_study, backbone_study])
def test_a_study_file_with_chance_slips_is_read_or_refused(tmp_path, made):
    path, rng = tmp_path / "study.toml", np.random.default_rng(7)
    opid.write_study(made(), path)
    text = path.read_text(encoding="utf-8")
    n_read, said = 0, []
    for n_slips in (1, 1, 2, 3) * 15:
        document = tomllib.loads(text)
        for _ in range(n_slips):
            with_a_slip(document, rng)
        path.write_text(tomli_w.dumps(document), encoding="utf-8")
        try:
            opid.read_study(path)
            n_read += 1
        except InputError as error:
            said.append(str(error))
    assert len(said) > n_read > 0
    assert [words for words in said if not words.startswith(str(path))] == []


def test_what_is_no_study_is_not_written(tmp_path):
    with pytest.raises(
        InputError, match="study is of type str: give a Study, a BenchStudy, a ModalStudy or an UpdatingStudy"
    ):
        opid.write_study("study.toml", tmp_path / "study.toml")
    assert list(tmp_path.iterdir()) == []


def test_a_study_of_another_kind_is_named_by_its_type():
    for function, study, words in (
        (opid.identify, "study.toml", "of type str: give a Study, a BenchStudy, a ModalStudy or an UpdatingStudy"),
        (opid.suspensions.law_of_bench, gear_study(), "of type Study: give a BenchStudy"),
        (opid.suspensions.identify, small_study(), "of type ModalStudy: give a Study"),
        (opid.modal.identify_modes, gear_study(), "of type Study: give a ModalStudy"),
        (opid.updating.update_study, small_study(), "of type ModalStudy: give an UpdatingStudy"),
    ):
        with pytest.raises(InputError, match=words):
            function(study)


def test_logs_are_inspected_by_a_study_of_suspensions(tmp_path):
    path = written(tmp_path, MODAL)
    with pytest.raises(InputError, match="is a study of modal tests: give one of suspensions, or none"):
        find_log_readings(path, tmp_path / "none.csv")
