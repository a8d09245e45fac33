"""The pages against the code: numbers that come from it, commands that it takes, and the README run as written."""

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from hashlib import sha256
from pathlib import Path

import pytest
from cli_runs import commands, parsed

from opid.mechanics.laws.kinds import BUILT_IN
from opid.suspensions.settings import Verdicts

ROOT = Path(__file__).parent.parent
PAGES = ("README.md", "CHANGELOG.md", "docs/suspension.md", "docs/whole_aircraft.md")
SEARCHED = [kind for kind in BUILT_IN if kind.searched and not kind.bench_only]


def numbers(page, before, after):
    """Return the numbers that stand between two pieces of text, wherever lines break."""
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    return [int(each) for each in re.findall(rf"{before}(\d+){after}", text)]


@pytest.mark.parametrize("page", PAGES)
def test_pages_count_the_kinds_that_are_searched(page):
    told = numbers(page, "", " kinds")
    assert told
    assert set(told) == {len(SEARCHED)}


def test_the_page_says_when_a_value_is_too_loosely_known():
    told = numbers("docs/whole_aircraft.md", "known worse than to ", " %")
    assert len(told) == 3
    assert set(told) == {round(100 * Verdicts().loosely_known)}


def test_the_page_says_when_a_structure_is_refused():
    told = numbers("docs/whole_aircraft.md", "Refused\\*\\* above ", " times")
    assert told == [Verdicts().refused]


def test_every_file_of_the_estimator_stands_in_the_table_of_the_way_to_an_answer():
    table = (ROOT / "docs" / "recording_to_answer.md").read_text(encoding="utf-8")
    wing = ROOT / "opid" / "suspensions"
    folders = ("", "model/", "fitting/", "law_search/", "answer/")
    paths = [path for folder in folders for path in wing.glob(f"{folder}[a-z]*.py")]
    files = {".".join(path.relative_to(wing).with_suffix("").parts) for path in paths}
    assert len(files) > 25
    assert {each for each in files if f"`{each}`" not in table} == set()


@pytest.mark.parametrize(("page", "wing"), [("nonlinear_modal_models", "modal"), ("bayesian_updating", "updating")])
def test_the_modules_of_a_table_of_steps_are_there(page, wing):
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"^\| step \|.*module.*\n(?:\|.*\n)+", text, re.MULTILINE)
    named = [name for row in table.splitlines()[2:] for name in re.findall(r"`([\w.]+)`", row.split("|")[3])]
    assert len(named) > 8
    for name in named:
        whole = name if name.startswith("opid.") else f"opid.{wing}.{name}"
        path = ROOT.joinpath(*whole.split("."))
        assert path.is_dir() or path.with_suffix(".py").is_file(), name


def test_every_benchmark_stands_in_their_table_with_the_first_words_of_its_file():
    folder = ROOT / "benchmarks"
    firsts = {
        path.name: " ".join(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))).split("\n\n")[0].split())
        for path in folder.glob("*.py")
    }
    table = (folder / "README.md").read_text(encoding="utf-8")
    assert dict(re.findall(r"(?m)^\| `(\w+\.py)` \| (.*) \|$", table)) == firsts


# ---- the README, run as written --------------------------------------------------------------------

MOST_WORDS = 1100
INSTALLED = {
    "opid": f'exec "{sys.executable}" -m opid "$@"',
    "python": f'exec "{sys.executable}" "$@"',
    "pip": "exit 0",
    "pytest": "exit 0",
    "activate": 'PATH="$PWD/.venv/bin:$PATH"',
}
"""What the installation makes in `.venv/bin`. CI itself installs into a new environment and runs the tests."""


def blocks(page):
    """Return the blocks of code of a page with their languages, in order."""
    return re.findall(r"```(\w*)\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)


def executable(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


@pytest.fixture
def newly_cloned(tmp_path):
    """A folder for a user, and an environment in which `python3 -m venv .venv` makes stand-ins (`INSTALLED`)."""
    made, shims = tmp_path / "made", tmp_path / "shims"
    made.mkdir()
    shims.mkdir()
    for name, text in INSTALLED.items():
        executable(made / name, text)
    executable(shims / "python3", f'test "$*" = "-m venv .venv" && mkdir -p .venv && cp -r "{made}" .venv/bin')
    clone = tmp_path / "clone"
    clone.mkdir()
    return clone, os.environ | {"PATH": f"{shims}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.skipif(os.name == "nt", reason="the blocks are for a shell")
def test_the_readme_runs_as_written(newly_cloned):
    clone, environment = newly_cloned
    shown = blocks("README.md")
    assert {language for language, _ in shown} == {"sh", "python", "text"}
    run = {"sh": "{}", "python": "python - <<'END'\n{}END\n", "text": ""}
    script = "set -eu\n" + "".join(run[language].format(text) for language, text in shown)
    command = ["bash", "-c", script]
    done = subprocess.run(command, cwd=clone, env=environment, capture_output=True, text=True, encoding="utf-8")
    assert (done.returncode, done.stderr) == (0, "")
    assert (clone / "demo_taxi" / "report" / "report.html").is_file()
    outs = re.findall(r"--out (\S+)|write_report\(result, \"(\S+)\"\)", script)
    folders = [option or argument for option, argument in outs]
    assert len(folders) == 4
    assert len({*folders, "demo_taxi"}) == 5
    assert all(any((clone / folder).iterdir()) for folder in folders)
    # to the byte, in the README as on the page that shows all of it
    (printed,) = (text for language, text in shown if language == "text" and "95 % interval" in text)
    assert printed in done.stdout
    (whole,) = (text for _, text in blocks("docs/suspension.md") if text.startswith("Two virtual taxi runs"))
    assert done.stdout.startswith(whole)


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= MOST_WORDS


NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LARGEST_NOTEBOOK = 500_000
"""Bytes."""


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_stored_with_their_outputs(path):
    """As docs/notebooks.py stores them: that they run is a test of its own."""
    text = path.read_text(encoding="utf-8")
    code = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
    outputs = [each for cell in code for each in cell["outputs"]]
    assert any("image/png" in each.get("data", {}) for each in outputs)
    assert {each["output_type"] for each in outputs} <= {"stream", "display_data", "execute_result"}
    assert {each["name"] for each in outputs if each["output_type"] == "stream"} <= {"stdout"}
    assert {cell["execution_count"] for cell in code} == {None}
    sources = "\0".join("".join(cell["source"]) for cell in code)
    of_outputs = json.loads(text)["metadata"]["opid"]["code_sha256"]
    assert sha256(sources.encode()).hexdigest() == of_outputs, "changed since it was run: python docs/notebooks.py"
    assert len(text.encode()) < LARGEST_NOTEBOOK


def test_the_citation_is_of_this_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    for key in ("version", "license"):
        assert f"\n{key}: {project[key]}\n" in citation


PAGES_WITH_COMMANDS = ["README.md", *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize("page", PAGES_WITH_COMMANDS)
def test_commands_in_pages_are_those_of_the_command_line(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    written = [" ".join(each.split()) for each in re.findall(r"`(opid [^`]+)`", text)]
    written += [line.strip().split(" #")[0] for _, block in blocks(page) for line in block.splitlines()]
    names = {" ".join(words) for words, _ in commands()}
    for each in written:
        command = re.sub(r"\$\w", "1", re.sub(r"\[.*?\]", "", each)).strip()
        if command.startswith("opid ") and command not in names and "--help" not in command:
            parsed(command)


@pytest.mark.parametrize("page", PAGES_WITH_COMMANDS)
def test_links_between_pages_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:)([^)\s]+)\)", text):
        path, _, anchor = target.partition("#")
        file = (ROOT / page).parent / path if path else ROOT / page
        assert file.exists(), target
        if anchor:
            headings = re.findall(r"(?m)^#+ (.*)$", file.read_text(encoding="utf-8"))
            assert anchor in {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}, target
