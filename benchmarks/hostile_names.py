"""Names that a user can give, turned hostile: what every command makes of each of them in every text field.

Run `python benchmarks/hostile_names.py --jobs 2`, which takes hours, or `--commands identify law --names script
mathematics`; `--chromium` opens the pages, too, and tells whether a script ran or a request was made.

Each command runs on small inputs whose names (titles, runs, channels, interfaces, sensors, joints,
classes, tests, curves, flights, columns, files, folders) are all replaced by one hostile name, with a number behind it
so that they differ; where that is refused, each field alone is replaced, too. A field is refused in one sentence, or
correct: the page shows the name to the letter wherever it showed the harmless one, has no element and no handler more
than with that, nothing that steers a terminal is printed, no glyph is missing in a picture, and nothing is written
beside the folder of the result.
"""

import argparse
import contextlib
import csv
import io
import json
import os
import re
import shlex
import shutil
import sys
import tempfile
import tomllib
import unicodedata
import warnings
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import tomli_w

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from click.testing import CliRunner
from harness import run_all, table_head, table_row
from interrupted_runs import LAW, MADE_BY
from small_folders import SHORT, write_bench, write_hit

from opid import cli
from opid.errors import escape_invisible
from opid.plots.style import format_units
from opid.report.formulas import write_plain

NAMES = {
    "script": "<script>document.title='owned'</script>",
    "end of script": "</script><script>document.title='owned'</script>",
    "image": "<img src=http://127.0.0.1:9/x onerror=\"document.title='owned'\">",
    "style": "</style><style>body{display:none}</style>",
    "attribute": "x\" onmouseover=\"document.title='owned'\" y='",
    "template": "{{ 7*7 }}{% raw %}${7*7}",
    "markup of charts": "<b>b</b><a href='javascript:alert(1)'>a</a>%{x}%{meta}<br>",
    "mathematics": r"$\frac$",
    "true mathematics": r"$\alpha_1$ and $x^2$",
    "unbalanced": r"5$ \$ \\$",
    "right to left": "مرحبا שלום",
    "bidi override": "abc\u202egnp.exe\u2066x",
    "10,000 characters": "Long name " + 999 * "lengthy wo",
    "10,000 without a blank": 10_000 * "x",
    "emoji": "✈️🛬👩‍🔧",
    "CJK": "前起落架 주날개 みぎ",
    "combining": "Z̸̢̛a̸l̷g̵o̴" + 30 * "\u0301",
    "lines and tabs": "one\ntwo\tthree\r\nfour",
    "ANSI": "\x1b[31mred\x1b[0m\x1b]0;owned\x07\x9b2J",
    "control": "a\x01b\x7fc\u200bd\u2028e",
    "quotes": '"it\'s" `so` “it”',
    "backslashes": "C:\\new\\table\\0 \\n \\u0041",
    "percent": "%s %d %(x)s %n 100%",
    "braces": "{0} {name} {} {run!r}",
    "formula": "=1+1",
    "formula with a command": "@SUM(1+9)*cmd|' /C calc'!A0",
    "units": "a*b^2 kg^1/2 x^3",
    "private use": "\ue000\ue010\\text{<script>document.title='owned'</script>}\ue011",
    "path": "../x",
    "root": "/etc/passwd",
    "reserved": "CON",
    "dots": "..",
    "empty": "",
    "spaces": "   ",
    "option": "--help",
    "underscore": "_x",
}
ALONE = ("empty", "spaces", "dots", "reserved", "option")
"""Names that a number would make harmless: they stand alone, in one field after the other."""

BENIGN = "qz{}qz"
"""The harmless name that stands in the place of the hostile one at first; no page holds it otherwise."""


@dataclass(frozen=True)
class Command:
    """A command with the folders that it reads, and the names in them that a user can give, by field.

    Args:
        words: of the command, without --out; the names stand in them as they are in `fields`.
        needs: folders and files that it reads.
        fields: {what is named: its name in the harmless input}.
        files: {the same of files and folders: path, from the folder of the inputs}.
        figures: whether it has figures.
    """

    words: tuple[str, ...]
    needs: tuple[str, ...]
    fields: dict[str, str] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
    figures: bool = True


SAMPLES = ("--samples", "1000", "--sampler", "transitional")
TAXI = {"title": "Two virtual taxi runs, seed 1", "run": "heavy", "channel": "upper_z", "other channel": "lower_z"}
COMMANDS = {
    "identify": Command(
        ("identify", "taxi/study.toml", *LAW), ("taxi",), TAXI, {"log": "taxi/heavy.csv", "folder": "taxi"}
    ),
    "identify logs": Command(
        ("identify", "taxi/heavy.csv", "taxi/light.csv", "--sprung", "upper_z", "--unsprung", "lower_z",
         "--mass-change=-220", *LAW),
        ("taxi",), {"channel": "upper_z", "other channel": "lower_z"}, {"log": "taxi/heavy.csv"},
    ),
    "identify paper": Command(
        ("identify", "taxi/study.toml", "--method", "paper"), ("taxi",), TAXI, {"log": "taxi/heavy.csv"}
    ),
    "identify body": Command(
        ("identify", "aircraft/study.toml", *LAW), ("aircraft",),
        {"title": "A virtual aircraft on three gears, seed 1", "interface": "nose", "other interface": "left",
         "run": "loaded", "channel": "nose_upper_z", "sensor of the body": "tail_z"},
        {"log": "aircraft/loaded.csv"},
    ),
    "identify law": Command(("identify", "taxi/study.toml", "--law", "no_law"), ("taxi",), {"law": "no_law"}),
    "inspect": Command(
        ("inspect", "taxi/heavy.csv"), ("taxi",), {"channel": "upper_z", "other channel": "lower_z"},
        {"log": "taxi/heavy.csv"},
    ),
    "inspect study": Command(
        ("inspect", "aircraft/loaded.csv", "--study", "aircraft/study.toml"), ("aircraft",),
        {"title": "A virtual aircraft on three gears, seed 1", "interface": "nose", "run": "loaded",
         "channel": "nose_upper_z"}, {"log": "aircraft/loaded.csv"},
    ),
    "sense": Command(
        ("sense", "taxi/study.toml", "identified", "--run", "heavy"), ("taxi", "identified"), TAXI,
        {"result": "identified"},
    ),
    "sense body": Command(
        ("sense", "aircraft/study.toml", "identified_body", "--run", "loaded", "--place", "seat=1,0"),
        ("aircraft", "identified_body"),
        {"interface": "nose", "run": "loaded", "channel": "nose_upper_z", "place": "seat"},
    ),
    "wheel": Command(("wheel", "driven/study.toml", "identified"), ("taxi", "identified", "driven"), TAXI),
    "compare": Command(
        ("compare", "identified_body", "identified_body_2"), ("identified_body", "identified_body_2"),
        {"interface": "nose", "other interface": "left", "title": "A virtual aircraft on three gears, seed 1"},
        {"result": "identified_body_2"},
    ),
    "plan": Command(
        ("plan", "taxi/study.toml", "--target", "sprung_mass=50%", *LAW, "--mass-change", "-200", "--duration", "20"),
        ("taxi",), TAXI,
    ),
    "law": Command(
        ("law", "bench.csv", "--force-channel", "load", "--travel-channel", "stroke"), ("bench.csv",),
        {"force": "load", "travel": "stroke"}, {"log": "bench.csv"},
    ),
    "law study": Command(
        ("law", "bench/study.toml"), ("bench.csv", "bench"),
        {"title": "A bench", "force": "load", "travel": "stroke"}, {"log": "bench/bench.csv"},
    ),
    "decay": Command(
        ("decay", "hit.csv", "--channel", "az", "--stiffness-order", "1", "--damping-order", "1"), ("hit.csv",),
        {"channel": "az"}, {"log": "hit.csv"},
    ),
    "modes": Command(
        ("modes", "beats/impact_1.csv", "--drive-point", "case_x", "--force-channel", "hammer", "--band", "50", "500"),
        ("beats",), {"sensor": "case_x", "other sensor": "lid_x", "force": "hammer"}, {"log": "beats/impact_1.csv"},
    ),
    "modes of stages": Command(
        ("modes", "beats/impact_1.csv", "beats/impact_2.csv", "--drive-point", "case_x", "--force-channel", "hammer",
         "--stage", "first", "--stage", "second", "--band", "50", "500"),
        ("beats",), {"sensor": "case_x", "stage": "first", "other stage": "second"},
    ),
    "modal": Command(
        ("modal", "beats/study.toml"), ("beats",),
        {"title": "A mode with cubic softening and quadratic damping", "sensor": "case_x", "other sensor": "lid_x",
         "force": "hammer", "test": "beat one", "other test": "a sweep"},
        {"log": "beats/beat_3_level_2.csv", "modes": "beats/modes.npz"},
    ),
    "resonance": Command(
        ("resonance", "levels/study.toml"), ("levels",),
        {"title": "A mode with cubic softening and quadratic damping", "sensor": "lid_x", "other sensor": "case_x",
         "force": "hammer", "test": "levels", "curve": "curve one"},
        {"curve file": "levels/curve_1.csv"},
    ),
    "update": Command(
        ("update", "wing/study.toml", *SAMPLES), ("wing",),
        {"title": "Virtual backbones of a wing-engine structure, seed 1", "backbone": "mode 7, curve 1",
         "class": "class 1", "other class": "class 2", "joint": "9-10"},
        {"backbone file": "wing/mode_8_curve_1.csv"},
    ),
    "campaign": Command(
        ("campaign", "fleet/fleet.toml", "--workers", "1"), ("fleet",),
        {"title": "A fleet", "flight": "f1", "tail": "AB", "column": "temperature_c", "run": "heavy"},
        {"folder of a flight": "fleet/f2"},
    ),
    "simulate": Command(("simulate", "taxi", "simulated", *SHORT), (), {"folder": "simulated"}, figures=False),
}  # fmt: skip

OURS = MADE_BY | {
    "aircraft": ("simulate", "aircraft", "aircraft", "--duration", "20", "--fs", "128"),
    "levels": ("simulate", "resonance", "levels", "--levels", "8", "--curves", "1"),
    "identified_body": ("identify", "aircraft/study.toml", *LAW, "--out", "identified_body", "--no-figures"),
    "identified_body_2": ("identify", "aircraft_2/study.toml", *LAW, "--out", "identified_body_2", "--no-figures"),
    "aircraft_2": ("simulate", "aircraft", "aircraft_2", "--duration", "20", "--fs", "128", "--seed", "2"),
}
BENCH = """title = "A bench"
[bench]
log = "bench.csv"
force = "load"
travel = "stroke"
"""
FLEET = 'title = "A fleet"\nflights = "flights.csv"\n[identify]\nlaw = "arctan_velocity"\n'
FLIGHTS = "tail,flight,date,study,temperature_c\nAB,f1,2026-01-12,f1/study.toml,-3\nAB,f2,2026-02-09,f2/study.toml,2\n"


# ---- small inputs ------------------------------------------------------------------------------------


def run_quietly(words):
    done = CliRunner().invoke(cli.main, [*words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    if done.exit_code not in (0, 1, 3):
        raise RuntimeError(f"opid {' '.join(words)}: {done.output}")


def make(name):
    """Make a folder or a file of the working directory that commands read, unless it is there."""
    path = Path(name)
    if path.exists():
        return
    if name in OURS:
        for needed in {"identified": ("taxi",), "identified_body": ("aircraft",),
                       "identified_body_2": ("aircraft_2",)}.get(name, ()):  # fmt: skip
            make(needed)
        run_quietly(OURS[name])
    if name in ("beats", "levels"):
        for table in path.glob("*.csv"):
            edit(table, ",force [N],case_x", ",hammer [N],case_x")
        edit(path / "study.toml", 'force = "force"', 'force = "hammer"')
    if name == "beats":
        edit(path / "study.toml", 'use = "truth"', 'use = "truth"\nname = "a sweep"')
        edit(path / "study.toml", 'level_1.csv"', 'level_1.csv"\nname = "beat one"')
    elif name == "levels":
        edit(path / "study.toml", 'use = "resonance"', 'use = "resonance"\nname = "levels"')
        edit(path / "study.toml", 'curve_1.csv"', 'curve_1.csv"\nname = "curve one"')
    elif name == "driven":
        shutil.copytree("taxi", path)
        edit(path / "study.toml", "[[runs]]", "[[runs]]\nspeed_m_per_s = 12.0")
    elif name == "bench":
        path.mkdir()
        shutil.copy("bench.csv", path)
        (path / "study.toml").write_text(BENCH)
    elif name == "fleet":
        for number in (1, 2):
            run_quietly(("simulate", "taxi", f"fleet/f{number}", *SHORT, "--seed", str(number)))
        (path / "fleet.toml").write_text(FLEET)
        (path / "flights.csv").write_text(FLIGHTS)
    elif name == "bench.csv":
        write_bench(path)
    elif name == "hit.csv":
        write_hit(path)


def edit(path, old, new):
    path.write_text(path.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")


# ---- renaming ----------------------------------------------------------------------------------------


def rename_value(value, names, rename=None):
    """Return a value of a study or a result with the old names replaced, in keys and in texts."""
    rename = rename or (lambda text: names.get(text, text))
    if isinstance(value, dict):
        return {rename(key): rename_value(each, names, rename) for key, each in value.items()}
    if isinstance(value, list):
        return [rename_value(each, names, rename) for each in value]
    return rename(value) if isinstance(value, str) else value


def rename_words(text, names):
    """Return a text of a result, which may hold a name among other words, with the old names replaced."""
    known = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    return re.sub(rf"(?<!\w)(?:{known})(?!\w)", lambda found: names[found[0]], text)


def rename_head(cell, names):
    """Return a cell of the head of a CSV file with its name replaced; what stands in brackets is the unit."""
    found = re.fullmatch(r"(.*?)(_h\d+)?( \[[^\]]*\])?", cell, re.DOTALL)
    return names.get(found[1], found[1]) + (found[2] or "") + (found[3] or "")


def rename_in(path, names):
    """Rename in one file that a command reads."""
    if path.suffix == ".toml":
        path.write_bytes(tomli_w.dumps(rename_value(tomllib.loads(path.read_text("utf-8")), names)).encode())
    elif path.suffix == ".json":
        path.write_text(
            json.dumps(rename_value(json.loads(path.read_text("utf-8")), names, partial(rename_words, names=names))),
            "utf-8",
        )
    elif path.suffix == ".csv":
        head, _, rest = path.read_text("utf-8").partition("\n")
        cells = next(csv.reader([head]))
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow([rename_head(cell, names) for cell in cells])
        if "flight" in cells:
            body = [[names.get(cell, cell) for cell in row] for row in csv.reader(rest.splitlines())]
            csv.writer(text, lineterminator="\n").writerows(body)
            rest = ""
        path.write_text(text.getvalue() + rest, "utf-8", newline="")
    elif path.suffix == ".npz":
        with np.load(path) as archive:
            arrays = dict(archive)
        for key in ("sensors", "names"):
            if key in arrays and arrays[key].dtype.kind == "U":
                arrays[key] = np.array([names.get(str(each), str(each)) for each in arrays[key]])
        np.savez(path, **arrays)


def spoil(command, originals, folder, names):
    """Copy the inputs of a command with fields renamed, and return the words of the command.

    Raises:
        OSError: the system knows no such file.
    """
    for name in command.needs:
        source = originals / name
        shutil.copytree(source, folder / name) if source.is_dir() else shutil.copy(source, folder / name)
    of_fields = {old: names[each] for each, old in command.fields.items() if each in names}
    words = [rename_word(word, of_fields) for word in command.words]
    if of_fields:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                rename_in(path, of_fields)
    for each, old in command.files.items():
        if each not in names:
            continue
        path = folder / old
        new = path.with_name(names[each] + (path.suffix if path.is_file() else ""))
        if (
            os.path.normpath(new).startswith(f"{path.parent}{os.sep}")
            and new.parent == path.parent
            and not new.exists()
        ):
            path.rename(new)
        relative = new.relative_to(folder).as_posix() if new.is_relative_to(folder) else str(new)
        for study in folder.rglob("*.toml"):
            if study.parent in (path.parent, path):
                rename_in(study, {path.name: new.name if new.parent == path.parent else relative})
        for table in folder.rglob("flights.csv"):
            edit(table, f"{path.name}/study.toml", f'"{relative.removeprefix("fleet/")}/study.toml"'.replace('""', '"'))
        words = [re.sub(rf"^{re.escape(old)}(?=/|$)", lambda _, to=relative: to, word) for word in words]
    return words


def rename_word(word, names):
    """Return a word of the command line with a name replaced, also before a "="."""
    stem, equals, rest = word.partition("=")
    return names.get(word) if word in names else names[stem] + equals + rest if equals and stem in names else word


# ---- judging -----------------------------------------------------------------------------------------


class Page(HTMLParser):
    """What a browser makes of a page: its texts and its elements, with what could run or fetch."""

    def __init__(self, html):
        super().__init__()
        self.texts, self.elements, self.charts, self._inside = [], Counter(), [], ""
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self._inside = tag
        if tag in ("script", "style", "img", "iframe", "object", "embed", "link", "base", "form", "meta", "a"):
            self.elements[tag] += 1
        for key, value in attributes:
            if key.startswith("on") or (key in ("href", "src") and re.match(r"\s*(javascript|data|http)", value or "")):
                self.elements[f"{tag} {key}={value}"] += 1
            elif key == "aria-label":
                self.texts.append(value)

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, text):
        if self._inside == "script" and text.startswith("{"):
            self.charts.append(json.loads(text))
        elif self._inside not in ("script", "style"):
            self.texts.append(text)

    @property
    def text(self):
        return "".join("".join(self.texts).split())


@dataclass
class Verdict:
    """What came of one run: "refused", "correct" or what is wrong, with its words."""

    word: str
    said: str = ""
    page: Page | None = None


def is_steering(text):
    """Whether a text has a character that steers a terminal or turns the order of its letters."""
    turns = "\u202a\u202b\u202d\u202e\u2066\u2067\u2068"
    return any((unicodedata.category(each) == "Cc" and each not in "\n\t") or each in turns for each in text)


def run(command, words, folder, *, has_figures=True):
    """Run a command in a folder, and return what came of it, without the page it should be compared with."""
    before = set(folder.parent.rglob("*"))
    given = [*words, *(("--out", "out", "--png" if has_figures else "--no-figures") if command.figures else ())]
    with warnings.catch_warnings(record=True) as warned, contextlib.chdir(folder):
        warnings.simplefilter("always")
        done = CliRunner().invoke(cli.main, given)
    said = done.output
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        return Verdict("traceback", f"{type(done.exception).__name__}: {done.exception}")
    glyphs = [str(each.message) for each in warned if "Glyph" in str(each.message) or "font" in str(each.message)]
    if glyphs:
        return Verdict("glyphs", glyphs[0])
    if is_steering(said):
        return Verdict("terminal", repr(said[:300]))
    kept = (folder / "out", folder / "simulated")
    beside = [path for path in set(folder.parent.rglob("*")) - before if not any(map(path.is_relative_to, kept))]
    if beside and command.figures:
        return Verdict("written elsewhere", str(beside[0]))
    lines = [line for line in said.splitlines() if line.startswith("Error: ")]
    if done.exit_code == 2:
        is_usage = said.startswith("Usage: ")
        is_one = len(lines) == 1 and (is_usage or len(said.strip().splitlines()) == 1)
        return Verdict("refused" if is_one else "more than one sentence", said)
    if done.exit_code not in (0, 1, 3):
        return Verdict("status", f"{done.exit_code}: {said}")
    for path in (*folder.glob("out/*.html"),):
        return Verdict("correct", said, Page(path.read_text("utf-8")))
    return Verdict("correct", said)


def squeeze(text):
    """Return a text without blanks, and with what is invisible as Python writes it."""
    return "".join(escape_invisible(text).split())


def judge(command, verdict, harmless, names, benign):
    """Compare a page with that of harmless names."""
    if verdict.word != "correct" or verdict.page is None or harmless.page is None:
        return verdict
    more = verdict.page.elements - harmless.page.elements
    if more:
        return Verdict("injection", str(more))
    for each, name in names.items():
        # in a sentence a name stands in quotation marks, as Python writes it, in a command as the shell reads it
        written = (name, repr(name)[1:-1], shlex.quote(name).strip("'"))
        # a page typesets units, and leaves the marks of its formulas out
        words = [squeeze(each) for own in written for each in (own, format_units(own, only=True), write_plain(own))]
        # a sketch breaks it into lines, and has no room for a long one
        shown = (*words, f"{squeeze(name)[:8]}") if len(name) > MOST_IN_SKETCH else words
        if benign[each] in harmless.page.text and not any(word in verdict.page.text for word in shown):
            return Verdict("not to the letter", f"{each} {name!r}")
    return verdict


def name_fields(fields, hostile):
    """Return a hostile name for each field; names that must differ have a number behind them."""
    return {each: hostile if len(fields) == 1 else f"{hostile}{number}" for number, each in enumerate(fields, start=1)}


def try_names(command, originals, work, fields, hostile, harmless, benign, pages):
    """Run a command with fields renamed, and return the verdict."""
    names = name_fields(fields, hostile)
    folder = work / "try"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    try:
        words = spoil(command, originals, folder, names)
    except (OSError, ValueError, UnicodeError) as error:
        return Verdict("impossible", str(error)[:100])
    has_figures = hostile not in map(NAMES.get, ALONE)
    verdict = judge(command, run(command, words, folder, has_figures=has_figures), harmless, names, benign)
    if pages is not None and verdict.word == "correct" and (folder / "out").is_dir():
        pages(folder / "out", verdict)
    return verdict


def try_command(name, originals, work, chosen, tell, pages):
    """Yield (field, name of the hostile name, verdict) of a command."""
    command = COMMANDS[name]
    fields = [*command.fields, *command.files]
    benign = {each: BENIGN.format(number) for number, each in enumerate(fields)}
    folder = work / "harmless"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    harmless = run(command, spoil(command, originals, folder, benign), folder)
    if harmless.word not in ("correct", "refused") or (harmless.word == "refused" and name != "identify law"):
        raise RuntimeError(f"{name} with harmless names: {harmless.word}: {harmless.said}")
    for hostile_name in chosen:
        hostile = NAMES[hostile_name]
        for group in (list(command.fields), list(command.files)):
            together = None
            if group and hostile_name not in ALONE:
                together = try_names(command, originals, work, group, hostile, harmless, benign, pages)
            if together is not None and (together.word == "correct" or len(group) == 1):
                verdicts = [(each, together) for each in group]
            else:
                verdicts = [
                    (each, try_names(command, originals, work, [each], hostile, harmless, benign, pages))
                    for each in group
                ]
                # each field alone may hold what all together do not
                if together is not None and together.word not in WORDS:
                    verdicts.append(("all", together))
            for each, verdict in verdicts:
                if verdict.word not in WORDS:
                    tell(f"{name}, {each}, {hostile_name}: {verdict.word}: {verdict.said[:300]}")
                yield each, hostile_name, verdict


@contextlib.contextmanager
def open_pages():
    """Give a function that opens the page of a result in Chromium and judges what happened there."""
    from chromium import Reader, start_chromium

    for browser in start_chromium():

        def look(out, verdict, browser=browser):
            for page in out.glob("*.html"):
                reader = Reader(browser, page)
                reader.page.mouse.move(300, 300)
                title = reader.page.title()
                requests = [each for each in reader.requests if not each.startswith(("file:", "blob:", "data:"))]
                if title == "owned" or requests or reader.errors:
                    verdict.word = "injection"
                    verdict.said = f"{title!r} {requests} {reader.errors}"[:300]
                reader.close()

        yield look


MOST_IN_SKETCH = 84
"""Letters of a name that a sketch shows."""

NAMES_OF_A_JOB = 9
"""A job runs its command with harmless names first, which takes as long as one name does."""

WORDS = ("refused", "correct", "impossible")


@dataclass(frozen=True)
class Job:
    """A command that some hostile names are tried on."""

    command: str
    names: tuple[str, ...]
    originals: Path
    chromium: bool


def run_job(job):
    """Return (command, counts of the verdicts by word, what is wrong) of a job."""
    counts, told = Counter(), []
    with tempfile.TemporaryDirectory() as work, contextlib.ExitStack() as stack:
        pages = stack.enter_context(open_pages()) if job.chromium else None
        for _, _, verdict in try_command(job.command, job.originals, Path(work), job.names, told.append, pages):
            counts[verdict.word] += 1
    return job.command, counts, told


def describe(outcome):
    command, counts, told = outcome
    return "\n".join([f"{command}: {counts.total()} tried", *told])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=[*COMMANDS])
    parser.add_argument("--names", nargs="+", choices=NAMES, default=[*NAMES])
    parser.add_argument("--chromium", action="store_true", help="open the pages in Chromium")
    parser.add_argument("--keep", type=Path, help="folder for the inputs, which a later run finds there")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args()
    counts = {name: Counter() for name in options.commands}
    with tempfile.TemporaryDirectory() as directory:
        originals = (options.keep or Path(directory)).absolute()
        originals.mkdir(exist_ok=True, parents=True)
        with contextlib.chdir(originals):
            for name in options.commands:
                for each in COMMANDS[name].needs:
                    make(each)
        jobs = [
            Job(name, tuple(options.names[first : first + NAMES_OF_A_JOB]), originals, options.chromium)
            for name in options.commands
            for first in range(0, len(options.names), NAMES_OF_A_JOB)
        ]
        for name, found, _ in run_all(run_job, jobs, describe, processes=options.jobs):
            counts[name] += found
    wrong = sorted({word for each in counts.values() for word in each} - {*WORDS})
    rows = [[name, str(each.total()), *(str(each[word]) for word in (*WORDS, *wrong))] for name, each in counts.items()]
    total = sum(counts.values(), Counter())
    rows.append(["all", str(total.total()), *(str(total[word]) for word in (*WORDS, *wrong))])
    print(table_head("command", "tried", "refused in one sentence", "correct", "no such file", *wrong))
    for row in rows:
        print(table_row(*row))
    sys.exit(any(total[word] for word in wrong))


if __name__ == "__main__":
    main()
