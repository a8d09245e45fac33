"""The command as a user drives it: the main path from a simulation to a report, places, and interruptions."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from cli_runs import N_PICTURES, commands, opid, parsed, refused, shell
from small_folders import write_bench

from opid.mechanics.laws.kinds import LAWS
from opid.report.document import Figure
from opid.suspensions import identification

# ---- the main paths, in a process of their own -----------------------------------------------------


def test_a_user_simulates_and_identifies(tmp_path):
    done = shell("simulate", "taxi", "runs", "--duration", 20, "--fs", 256, "--seed", 3, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    names = sorted(path.name for path in (tmp_path / "runs").iterdir())
    assert names == ["heavy.csv", "light.csv", "study.toml", "truth.json"]
    assert "opid identify runs/study.toml" in done.stdout.replace("\\", "/")

    done = shell("identify", "runs/study.toml", "--truth", "runs/truth.json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    report = tmp_path / "runs_result"
    assert (report / "report.html").read_text(encoding="utf-8").count('data-chart="') == N_PICTURES
    assert (report / "report.html").stat().st_size > 200_000
    result = json.loads((report / "result.json").read_text(encoding="utf-8"))
    mass = result["parameters"]["sprung_mass_kg"]
    assert mass["value"] == pytest.approx(1850, rel=0.02)
    assert "truth" in done.stdout
    assert "runs_result" in done.stdout


def test_help_comes_without_heavy_imports():
    code = "import sys, opid.cli; print({'numpy', 'scipy', 'matplotlib', 'numba', 'jinja2'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
    told = opid("--help").output
    assert [job for job in ("identify", "law", "modal", "update", "compare") if told.count(job) < 2] == []
    for command in ((), ("demo",), ("simulate", "taxi"), ("inspect",), ("identify",)):
        assert opid(*command, "--help").exit_code == 0
    assert "version 0" in opid("--version").output


def test_an_identification_with_its_page_loads_only_what_it_needs(tmp_path, field_test):
    """SciPy's signals and statistics take half a second, as long as the law search of two short runs."""
    code = "import sys; from opid.cli import main; main(sys.argv[1:], standalone_mode=False); print(*sys.modules)"
    command = [sys.executable, "-c", code, "identify", str(field_test / "study.toml"), "--out", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = done.stdout.splitlines()[-1].split()
    assert {"opid.report.writing", "scipy.fft"} <= set(loaded)
    assert {"scipy.signal", "scipy.stats", "pysindy", "sklearn", "pandas"} & set(loaded) == set()


@pytest.mark.parametrize("words", [words for words, _ in commands()], ids=" ".join)
def test_every_help_ends_with_an_example_that_is_read(words):
    *_, title, example = opid(*words[1:], "--help").output.splitlines()
    assert title.strip() == "Example:"
    assert tuple(example.split()[: len(words)]) == words
    parsed(example)


@pytest.mark.parametrize("words", [words for words, each in commands() if hasattr(each, "commands")], ids=" ".join)
def test_summaries_are_not_cut(words):
    told = " ".join(opid(*words[1:], "--help").output.split())
    assert "..." not in told.replace("[ARGS]...", "")
    below = [each for path, each in commands() if path[:-1] == words]
    assert len(below) > 3
    for each in below:
        first_sentence = " ".join(each.help.split("\n\n")[0].split()).split(". ")[0].removesuffix(".")
        assert first_sentence in told


def test_laws_are_listed_with_formulas_and_parameters():
    told = opid("laws").output
    document = json.loads(opid("laws", "--json").output)
    assert document["schema"] == "opid.laws/1"
    assert [each["name"] for each in document["laws"]] == [kind.name for kind in LAWS.values()]
    for kind, listed in zip(LAWS.values(), document["laws"], strict=True):
        assert f"{kind.name}: {listed['formula']}\n" in told
        assert "\\" not in listed["formula"]
        assert [each["name"] for each in listed["parameters"]] == [each.name for each in kind.parameters]
        assert all(f"  {each.name} " in told for each in kind.parameters)
    n_searched = sum(each["is_searched"] and not each["is_bench_only"] for each in document["laws"])
    assert told.startswith(f"{len(LAWS)} laws, {n_searched} of them searched by `opid identify`; the columns")
    assert document["laws"][0]["formula"] == "A (2/pi) arctan(z' / s)"


def test_help_tells_studies_of_one_gear_and_of_a_body_apart():
    assert "one gear, a car, a whole aircraft" in opid("--help").output
    options = opid("identify", "--help").output.split("Options:")[1].split("\n  --")
    marked = [text.split()[0].removeprefix("--") for text in options if "One gear" in text]
    assert marked == ["method", "high-pass"]


def test_bad_input_in_a_process_of_its_own(tmp_path):
    done = shell("identify", tmp_path / "missing.toml")
    assert done.returncode == 2
    missing = tmp_path / "missing.toml"
    assert done.stderr == f"Error: there is no study file {missing}: check the name and the directory\n"


# ---- places and interruptions ----------------------------------------------------------------------


@pytest.mark.parametrize("command", [("simulate", "taxi"), ("demo", "--out"), ("identify", "study.toml", "--out")])
def test_a_file_where_a_directory_is_needed(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("taken").write_text("mine")
    refused(opid(*command, "taken"), "taken is no directory")
    refused(opid(*command, "taken/deeper"), "taken is no directory")
    assert Path("taken").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def _raise(error):
    def raising(*_, **__):
        raise error

    return raising


@pytest.mark.parametrize(
    ("error", "status", "word"),
    [
        (KeyboardInterrupt(), 130, "interrupted"),
        (PermissionError(13, "Permission denied", "/somewhere"), 2, "/somewhere: Permission denied"),
    ],
)
def test_what_goes_wrong_outside_is_a_sentence(error, status, word, field_test, tmp_path, monkeypatch):
    monkeypatch.setattr(identification, "known_noise", _raise(error))
    done = opid("identify", field_test / "study.toml", "--out", tmp_path / "out")
    refused(done, word, status=status)
    assert not (tmp_path / "out").exists()


def test_a_failure_while_drawing_leaves_no_half_report(field_test, tmp_path, monkeypatch):
    failing = Figure("broken", "", "", _raise(RuntimeError("no figure")))
    monkeypatch.setattr("opid.report.suspensions.identification.list_figures", lambda result, truth: (failing,))
    done = opid("identify", field_test / "study.toml", "--out", tmp_path / "out")
    assert done.exit_code == 70
    assert "(RuntimeError: no figure)" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("stated", ["abc", "1.5", "-5", "9" * 20, "nan", "\u0663"])
def test_a_time_of_writing_that_is_none_is_refused_before_work(stated):
    """numpy reads it, too, when it is loaded."""
    done = subprocess.run(
        [sys.executable, "-m", "opid", "laws"],
        env={**os.environ, "SOURCE_DATE_EPOCH": stated, "PYTHONUTF8": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("Error: the environment variable SOURCE_DATE_EPOCH is '")
    assert done.stderr.count("\n") == 1


def test_variables_of_libraries_that_opid_does_not_use_break_nothing(tmp_path):
    write_bench(tmp_path / "bench.csv")
    odd = {"MPLBACKEND": "none", "NUMBA_DISABLE_JIT": "1", "NUMBA_NUM_THREADS": "abc", "SOURCE_DATE_EPOCH": ""}
    words = ("law", "bench.csv", "--force-channel", "load", "--travel-channel", "stroke", "--out", "out")
    done = subprocess.run(
        [sys.executable, "-m", "opid", *words],
        env={**os.environ, **odd},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert done.stderr == ""
    assert (tmp_path / "out" / "report.html").is_file()


@pytest.mark.skipif(os.name != "posix", reason="a shell closes what a command prints to")
def test_a_closed_input_and_error_break_nothing(tmp_path):
    write_bench(tmp_path / "bench.csv")
    whole = f"{shlex.quote(sys.executable)} -m opid"
    for words, status in (("inspect bench.csv", 0), ("inspect none.csv", 2)):
        done = subprocess.run(
            f"{whole} {words} <&- 2>&-", shell=True, cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert (done.returncode, "opid itself failed" in done.stdout, done.stderr) == (status, False, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("words", ["--help", "--version", "laws --help", "laws"])
def test_a_full_disk_for_what_is_printed_is_one_sentence(words):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "opid", *words.split()], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr) == (2, "Error: the system refuses: No space left on device\n")
