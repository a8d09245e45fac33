"""What commands that write show of their work, and what they do with an older result: the same options everywhere."""

import io
import json
import re
import sys
import time

import click
import pytest
from cli_runs import CHANNELS, commands, opid, refused

from opid.cli.group import progress

# a campaign goes on where an earlier run ended, in the same folder
WRITING = {
    words: each
    for words, each in commands()
    if any(option.name == "out" for option in each.params) and words[1] != "campaign"
}
REPORTING = {words: each for words, each in WRITING.items() if words[1] != "simulate"}
GIVEN = {
    "compare": ("flight_1", "flight_2", "--out"),
    "decay": ("log.csv", "--channel", "az", "--out"),
    "demo": ("--out",),
    "identify": ("study.toml", "--out"),
    "inspect": ("log.csv", "--out"),
    "law": ("bench.csv", "--force", "load", "--travel", "stroke", "--out"),
    "modal": ("study.toml", "--out"),
    "simulate": (),
    "update": ("study.toml", "--out"),
}
OLDER = {"inspect": "log.png", "compare": "comparison.json", "simulate": "truth.json"}


def options_of(command):
    return {name for each in command.params for name in each.opts}


def test_every_command_that_writes_has_the_options():
    assert {words[1] for words in WRITING} == set(GIVEN)
    for each in WRITING.values():
        assert "--overwrite" in options_of(each)
        assert "--force" in options_of(each)  # of `opid law` it is the column of the force
        assert "--quiet" in options_of(each)
    for each in REPORTING.values():
        assert {"--json", "--quiet", "--verbose", "--no-figures", "--png"} <= options_of(each)


@pytest.mark.parametrize("words", WRITING, ids=" ".join)
def test_an_older_result_is_not_overwritten(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = OLDER.get(words[1], "result.json" if words[1] != "demo" else "report/result.json")
    older = tmp_path / "older" / name
    older.parent.mkdir(parents=True)
    older.write_text("mine", encoding="utf-8")
    option = "--overwrite" if words[1] == "law" else "--force"
    done = opid(*words[1:], *GIVEN[words[1]], "older")
    refused(done, f"older has {name} already: choose another folder, or overwrite with {option}")
    assert done.stdout == ""
    assert [path for path in (tmp_path / "older").rglob("*") if path.is_file()] == [older]
    assert older.read_text(encoding="utf-8") == "mine"


def test_every_option_has_a_word_for_its_value_and_a_sentence():
    for words, each in commands():
        told = opid(*words[1:], "--help").output
        assert "RANGE" not in told
        assert [option.opts for option in each.params if isinstance(option, click.Option) and not option.help] == []
        assert [line for line in told.splitlines() if line.split("  ")[-1].lstrip().startswith("Of ")] == [], words


def test_other_files_in_the_folder_are_no_older_result_and_stay(tmp_path):
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    first = opid("simulate", "taxi", tmp_path, "--duration", 2, "--fs", 256)
    assert first.exit_code == 0, first.output
    before = (tmp_path / "heavy.csv").read_bytes()
    refused(opid("simulate", "taxi", tmp_path, "--duration", 2, "--fs", 256, "--seed", 2), "heavy.csv, light.csv, ")
    assert (tmp_path / "heavy.csv").read_bytes() == before
    again = opid("simulate", "taxi", tmp_path, "--duration", 2, "--fs", 256, "--seed", 2, "--force", "--quiet")
    assert (again.exit_code, again.output) == (0, "")
    assert (tmp_path / "heavy.csv").read_bytes() != before
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"


@pytest.mark.usefixtures("few_figures")
def test_the_result_is_shown_as_asked(field_test, tmp_path):
    command = ("identify", field_test / "study.toml", "--law", "arctan_velocity", "--out", tmp_path / "out")
    as_json = opid(*command, "--json", "--quiet")
    assert (as_json.exit_code, as_json.stderr) == (0, "")
    assert as_json.stdout == (tmp_path / "out" / "result.json").read_text(encoding="utf-8")
    quiet = opid(*command, "--quiet", "--force")
    assert (quiet.exit_code, quiet.output) == (0, "")
    told = opid(*command, "--verbose", "--force")
    assert told.exit_code == 0
    assert "sprung mass M2" in told.stdout
    steps = [line.split(" s  ")[1] for line in told.stderr.splitlines()]
    assert [step for step in steps if step in ("model", "intervals", "figure law_ladder")] == [
        "model",
        "intervals",
        "figure law_ladder",
    ]
    assert f"opened {field_test / 'heavy.csv'}: CSV with " in told.stderr
    assert any(step.startswith("each gear alone (gear): law arctan_velocity, ") for step in steps)
    refused(opid(*command, "--verbose", "--quiet"), "give one of them")


class Terminal(io.StringIO):
    """What is written, line by line as it is drawn over."""

    def isatty(self):
        return True

    def drawn(self):
        return self.getvalue().split("\r")[1:]


def test_the_step_is_drawn_again_while_it_takes_its_time(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress() as say:
        say("law search")
        while sum("law search (" in line for line in sys.stderr.drawn()) < 2:
            time.sleep(0.05)
    assert sys.stderr.drawn()[-1] == ""
    assert sys.stderr.drawn()[-2].strip() == ""
    assert len({len(line) for line in sys.stderr.drawn()[:-1]}) == 1


def test_no_step_is_drawn_where_nobody_looks(monkeypatch):
    monkeypatch.setattr(sys, "stderr", Terminal())
    with progress(quiet=True) as say:
        say("law search")
    monkeypatch.setattr(Terminal, "isatty", lambda self: False)
    with progress() as say:
        say("law search")
    assert sys.stderr.getvalue() == ""


def test_a_report_has_no_figures_where_none_are_wanted(field_test, tmp_path):
    command = ("identify", field_test / "study.toml", "--law", "arctan_velocity", "--out", tmp_path / "out")
    (tmp_path / "out").mkdir()
    for name in ("law_ladder.png", "mine.png"):
        (tmp_path / "out" / name).write_bytes(b"older")
    done = opid(*command, "--no-figures")
    assert done.exit_code == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"mine.png", "report.html", "result.json"}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "sprung mass" in page
    assert "<script" not in page


def test_figures_are_files_where_they_are_wanted(field_test, tmp_path):
    command = ("identify", field_test / "study.toml", "--law", "arctan_velocity", "--out", tmp_path / "out")
    assert opid(*command, "--png").exit_code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    names = {path.stem for path in (tmp_path / "out").glob("*.png")}
    assert names == set(re.findall(r'data-chart="(\w+)"', page))
    assert all(path.read_bytes()[1:4] == b"PNG" for path in (tmp_path / "out").glob("*.png"))
    # a later report without them leaves none of an older result
    assert opid(*command, "--force").exit_code == 0
    assert list((tmp_path / "out").glob("*.png")) == []
    assert "give one of them" in opid(*command, "--png", "--no-figures").stderr


@pytest.mark.usefixtures("few_figures")
def test_what_is_not_determined_is_shown_as_json_too(field_test, tmp_path):
    done = opid("identify", field_test / "heavy.csv", *CHANNELS, "--json", "--out", tmp_path / "out")
    refused(done, "not determined", status=1)
    assert json.loads(done.stdout)["not_determined"]
