"""What commands that write show of their work, and what they do with an older result: the same options everywhere."""

import json
import re
import subprocess
import sys

import click
import pytest
from cli_runs import CHANNELS, commands, lines_drawn, opid, refused, run_on_terminal

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
    "law": ("bench.csv", "--force-channel", "load", "--travel-channel", "stroke", "--out"),
    "modal": ("study.toml", "--out"),
    "modes": ("log.csv", "--drive-point", "az", "--band", "1", "9", "--out"),
    "plan": ("guess.toml", "--target", "sprung_mass=0.5%", "--out"),
    "resonance": ("study.toml", "--out"),
    "sense": ("study.toml", "study_result", "--out"),
    "simulate": (),
    "update": ("study.toml", "--out"),
    "wheel": ("study.toml", "study_result", "--out"),
}
OLDER = {"inspect": "log.png", "compare": "comparison.json", "simulate": "truth.json"}


def options_of(command):
    return {name for each in command.params for name in each.opts}


def test_every_command_that_writes_has_the_options():
    assert {words[1] for words in WRITING} == set(GIVEN)
    for each in WRITING.values():
        (force,) = [option for option in each.params if "--force" in option.opts]
        assert (force.name, force.is_flag, force.opts) == ("overwrite", True, ["--force"])
        assert {"--json", "--quiet", "--verbose"} <= options_of(each)
    (campaign,) = (each for words, each in commands() if words[1:] == ("campaign",))
    for each in (*REPORTING.values(), campaign):
        assert {"--force", "--json", "--quiet", "--verbose", "--no-figures", "--png"} <= options_of(each)


@pytest.mark.parametrize("words", WRITING, ids=" ".join)
def test_an_older_result_is_not_overwritten(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = OLDER.get(words[1], "result.json" if words[1] != "demo" else "report/result.json")
    older = tmp_path / "older" / name
    older.parent.mkdir(parents=True)
    older.write_text("mine", encoding="utf-8")
    done = opid(*words[1:], *GIVEN[words[1]], "older")
    refused(done, f"older has {name} already: choose another folder, or overwrite with --force")
    assert done.stdout == ""
    assert [path for path in (tmp_path / "older").rglob("*") if path.is_file()] == [older]
    assert older.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("name", [".opid.part", ".out.part", ".opid.part/deeper"])
def test_the_name_of_a_result_that_is_not_complete_is_refused(name, field_test, tmp_path):
    done = opid("inspect", field_test / "heavy.csv", "--out", tmp_path / name)
    refused(done, "under hidden names that end in .part", "choose another name")
    assert list(tmp_path.iterdir()) == []


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


# ---- the line of progress ----------------------------------------------------------------------------

LONG = "a step with a long name, " * 20
STEPS = f"""
import sys, time
from opid.cli.output import progress
from opid.progress import Step
with progress(quiet="quiet" in sys.argv) as say:
    say("law search")
    time.sleep(3.6)
    for part in (0.0, 0.25, 0.5):
        say(Step("class 1", part))
        time.sleep(0.6)
    for part in (0.25, 0.5):
        say(Step("class 2", part))
        time.sleep(1.2)
    say("model [/red] {{elapsed}}")
    say({LONG!r})
print("done", file=sys.stderr)
"""
SERIES = """
import time
from opid.cli.output import progress
from opid.progress import Step
with progress() as say:
    for number in range(3):
        say(Step(f"test {number + 1}", number / 3))
        time.sleep(0.7)
"""


def test_a_step_is_drawn_with_its_time_every_second_and_with_a_bar_where_it_is_counted():
    shown, _ = run_on_terminal("-c", STEPS)
    *lines, end = lines_drawn(shown)
    assert end == "done"
    assert shown.count("\n") == 1  # The line of progress is drawn over and leaves nothing.
    seconds = [*dict.fromkeys(line for line in lines if line.endswith("law search"))]
    # A busy machine draws fewer seconds, and later ones.
    assert seconds == sorted(seconds)
    assert seconds[0] == "00:00 law search"
    assert re.fullmatch(r"00:0[1-9] law search", seconds[-1])
    bars = [line for line in lines if "class 1" in line]
    assert re.fullmatch(r"00:00   0%\| {20}\| \? left: class 1", bars[0])
    assert re.fullmatch(r"00:0[1-9]  50%\|█{10} {10}\| 00:0\d left: class 1", bars[-1])
    # What was done before the first word of it says nothing about the time that is left.
    other = [line for line in lines if "class 2" in line]
    assert re.fullmatch(r"00:00  25%\|█{5} {15}\| \S+ left: class 2", other[0])
    assert re.fullmatch(r"00:0[1-9]  50%\|█{10} {10}\| 00:0[1-9] left: class 2", other[-1])
    assert "00:00 model [/red] {elapsed}" in lines
    longest = next(line for line in lines if "long name" in line)
    assert f"00:00 {LONG}".startswith(longest)
    assert 70 < len(longest) <= max(map(len, lines)) <= 80


def test_tests_of_a_series_share_one_bar():
    shown, _ = run_on_terminal("-c", SERIES)
    last = next(line for line in lines_drawn(shown) if "test 3" in line)
    assert re.fullmatch(r"00:0[1-9]  67%\|█{13}\S? +\| 00:0\d left: test 3", last)


def test_no_step_is_drawn_where_nobody_looks():
    assert run_on_terminal("-c", STEPS, "quiet")[0].split() == ["done"]
    done = subprocess.run([sys.executable, "-c", STEPS], capture_output=True, text=True, check=True)
    assert done.stderr.split() == ["done"]


def test_a_command_on_a_terminal_leaves_its_text_alone(field_test, tmp_path):
    command = ("-m", "opid", "inspect", field_test / "heavy.csv")
    shown, told = run_on_terminal(*command, cwd=tmp_path)
    assert "00:00 heavy.csv" in lines_drawn(shown)
    assert "\n" not in shown
    assert re.search(r"\r +\r+$", shown)  # The line is erased.
    assert "heavy.csv" in told
    assert "\r" not in told
    said, same = run_on_terminal(*command, "--verbose", cwd=tmp_path)
    assert same == told
    assert any(line.endswith(" s  heavy.csv") for line in said.splitlines())
    assert all(re.match(r" *\d+\.\d s  \S", line) for line in said.splitlines())
    assert run_on_terminal(*command, "--quiet", cwd=tmp_path) == ("", "")
