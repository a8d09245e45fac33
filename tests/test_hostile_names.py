"""Names of the user in figures, pages, terminals and files: shown as they are, and never taken for anything else.

`benchmarks/hostile_names.py` tries many more, in every text field of every command.
"""

import io
import json
import re
import threading
import tomllib
import unicodedata
from html.parser import HTMLParser
from http.server import HTTPServer
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w
from chromium import needs_chromium, start_chromium
from cli_runs import opid, refused
from markupsafe import escape
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import LogFormatterSciNotation
from scripts import ROOT

from opid.errors import INVISIBLE, escape_invisible
from opid.json_values import json_text
from opid.mechanics.laws.kinds import LAWS
from opid.plots.charts.figure import build_chart
from opid.plots.modes import mode_indicators
from opid.plots.style import format_units, house_style, panels, png
from opid.plots.texts import LACKING, PlainPowers, find_written_text, shorten
from opid.report.as_text import lay_out_text
from opid.report.document import Column, Document, Figure, Paragraph, Table, build_columns
from opid.report.formulas import embed_formula, write_html
from opid.report.writing import draw_figures, lay_out_page

SCRIPT = (
    "</script><script>document.title='owned'</script><img src=http://127.0.0.1:9/x onerror=\"document.title='owned'\">"
)
IN_FORMULA = "\ue010\\text{<script>document.title='owned'</script>}\ue011"
MATHEMATICS = r"$\frac$ $5 {{ 7*7 }} %{x}"
OTHER = "前起落架 ✈️ مرحبا"
LONG = "a run " + 500 * "of very many words "
STEERING = "\x1b[31mred\x1b]0;owned\x07\x9b2J\u202e abc"


class Page(HTMLParser):
    """Texts and scripts of a page, as a browser reads them."""

    def __init__(self, html):
        super().__init__()
        self.texts, self.scripts, self.handlers, self.inside = [], [], [], ""
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.inside = tag
        self.handlers += [key for key, _ in attributes if key.startswith("on")]
        if tag in ("img", "iframe", "object", "embed", "base", "form", "link"):
            self.handlers.append(tag)

    def handle_endtag(self, tag):
        self.inside = ""

    def handle_data(self, text):
        if self.inside == "script":
            self.scripts.append(text)
        elif self.inside != "style":
            self.texts.append(text)

    @property
    def text(self):
        return " ".join("".join(self.texts).split())


def draw(names, *, title="", rows=None):
    """Return Axes with one line for each name in the legend, as a figure of opid draws them."""
    with house_style():
        (ax,) = panels(None, 1, height_in=3).ravel()
        for k, name in enumerate(names):
            ax.plot([0, 1], [k, k + 1], label=name)
        ax.set_title(title or names[0])
        if rows:
            ax.set_yticks(range(len(rows)), rows)
        ax.legend()
    return ax


# ---- figures -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", [r"$\frac$", r"5$ \$ \\$", "$a$ and $b$", OTHER, "a\u0301\u202ex", "\x1b[31m", LONG, "_x"]
)
def test_a_figure_draws_any_name_without_a_warning(name):
    ax = draw([f"run {name!r}", f"other {name}"], title=name, rows=[name, "b"])
    assert png(ax.get_figure())[1:4] == b"PNG"  # a missing glyph is a warning, and a warning an error
    ax.get_figure().savefig(io.BytesIO())  # outside the house style
    shown = [each.get_text() for each in (*ax.get_legend().get_texts(), ax._left_title, *ax.get_yticklabels())]
    assert not any(each in text for each in "\x1b\u202e" for text in shown)
    assert all(len(text) <= 84 for text in shown)


def test_a_dollar_is_a_dollar():
    ax = draw(["$\\alpha$ 5$"])
    assert ax.get_title(loc="left") == "$\\alpha$ 5$"
    assert not ax._left_title.get_parse_math()


def test_a_long_name_keeps_its_beginning_and_its_end():
    assert shorten("run 7, " + "x" * 500 + " flap 20", 40) == f"run 7, {'x' * 16}…{'x' * 8} flap 20"
    assert shorten("short", 10) == "short"
    # two names that differ at the end only still do
    ax = draw([f"{LONG}{k}" for k in (1, 2)])
    assert len({each.get_text() for each in ax.get_legend().get_texts()}) == 2


def test_what_no_font_has_is_a_square_in_a_picture_and_itself_on_a_page():
    name = "a\u0378\u0379b"  # two places that Unicode has not given
    ax = draw([name], rows=[name, "b"])
    text = ax.get_legend().get_texts()[0]
    assert (text.get_text(), find_written_text(text)) == (f"a{LACKING}{LACKING}b", name)
    chart = build_chart(ax.get_figure())
    assert chart["legend"][0]["text"] == name == chart["data"][0]["meta"]
    assert chart["layout"]["yaxis"]["ticktext"] == [name, "b"]


@pytest.mark.parametrize("span", [(0.5, 2e3), (1e-7, 1e-3), (2.0, 9.0), (1e-3, 1e9)])
def test_powers_of_ten_are_those_of_matplotlib(span):
    """Raised digits in the place of its mathematics: the same numbers at the same ticks."""
    ax = Drawing().subplots()
    ax.set_yscale("log")
    ax.set_ylim(*span)
    theirs, ours = LogFormatterSciNotation(), PlainPowers()
    lowered = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
    places = ax.yaxis.get_majorticklocs()
    for formatter in (theirs, ours):
        formatter.set_axis(ax.yaxis)
        formatter.set_locs(places)
    assert len(places) > 1
    for place in places:
        their, our = theirs(place), ours(place)
        assert "$" not in our
        found = re.search(r"(?:([\d.]+)\\times)?10\^\{(-?\d+)\}", their)
        assert (found is None) == (our == "")
        if found:
            factor, _, power = our.rpartition("×")
            assert (factor, power.removeprefix("10").translate(lowered)) == (found[1] or "", found[2])


def test_every_axes_that_is_drawn_on_is_mended():
    """An Axes that is made by other means than `panels` is given to `take_axes`, or its powers stay mathematics."""
    made = re.compile(r"\.(?:subplots|add_subplot|add_axes|subplot_mosaic|twinx|inset_axes)\(")
    for path in (ROOT / "opid" / "plots").glob("*.py"):
        source = path.read_text(encoding="utf-8")
        assert not made.search(source) or "take_axes(" in source, path.name


def test_a_log_axis_of_a_figure_of_its_own_shape_has_plain_powers():
    frequency = np.linspace(10, 400, 50)
    response = SimpleNamespace(frequency_hz=frequency, value=np.logspace(-1, 2, 50)[:, None])
    flat = mode_indicators({"$\\frac$": response}, response, marked={1: 100.0}, zoomed=[1])
    ax = flat[0]
    texts = ax.yaxis.get_major_formatter().format_ticks(ax.yaxis.get_majorticklocs())
    assert {"10⁰", "10¹"} <= set(texts)
    assert png(ax.get_figure())[1:4] == b"PNG"


def test_axes_of_the_user_keep_their_mathematics():
    ax, other = Drawing().subplots(1, 2)
    other.set_title("$x^2$")
    with house_style():
        panels(ax, 1, height_in=2)[0, 0].set_title("$5")
    assert (other.get_title(), other.title.get_parse_math()) == ("$x^2$", True)


# ---- pages -------------------------------------------------------------------------------------------


def page_of(*names, directory):
    """Return a page that has the names in every kind of block."""
    drawn = Figure("picture", names[0], names[-1], lambda: draw(list(names)))
    columns = (Column("name", align="left"), Column(names[0]))
    table = Table(columns, tuple((name, "1 N/m^2") for name in names), names[0], names[-1], is_filtered=True)
    blocks = (Paragraph(f"Of {names[0]!r}.", names[0]), table, drawn)
    document = Document(names[0], names[-1], f"The answer of {names[0]!r} is 5 m/s^2.", blocks=blocks)
    charts, _ = draw_figures([drawn])
    return document, lay_out_page(document, blocks, charts, f"opid {names[0]}", directory=directory)


@pytest.mark.parametrize(
    "name", [SCRIPT, MATHEMATICS, IN_FORMULA, OTHER, LONG, "a*b^2 `c`", '"it\'s"', "</style>", STEERING]
)
def test_a_page_shows_a_name_to_the_letter_and_runs_nothing_of_it(name, tmp_path):
    harmless, page = (Page(page_of(each, "other", directory=tmp_path)[1]) for each in ("harmless", name))
    assert (len(page.scripts), page.handlers) == (len(harmless.scripts), harmless.handlers)
    assert page.text.count(" ".join(escape_invisible(name).split())) >= 4
    assert {"m/s²", "N/m²"} <= set(re.findall(r"\w+/\w[²³]", page.text))


@pytest.mark.parametrize("name", ['"it\'s" `so`', "it's `so`", '"so" `so`', "C:\\`so`\\", "5 m^2 `so`"])
def test_a_name_in_a_sentence_is_kept_to_its_end(name, tmp_path):
    html = page_of(name, "other", directory=tmp_path)[1]
    assert f"The answer of {escape(repr(name))} is 5 m/s²." in html.replace("<bdi>", "").replace("</bdi>", "")


def test_a_formula_that_is_none_is_a_text():
    html = write_html(f"the law {IN_FORMULA} \ue010\\frac\ue011", str)
    assert html == r"the law \text{&lt;script&gt;document.title=&#x27;owned&#x27;&lt;/script&gt;} \frac"
    assert "href" not in write_html("\ue010\\href{javascript:alert(1)}{x}\ue011", str).replace("\\href", "")
    assert [law for law in LAWS.values() if not write_html(embed_formula(law.latex), str).startswith("<math")] == []


def test_names_from_right_to_left_are_kept_apart_from_the_numbers_beside_them(tmp_path):
    html = page_of("مرحبا بك", "other", directory=tmp_path)[1]
    assert "<bdi>مرحبا بك</bdi>" in html


def test_only_units_are_raised_where_a_name_may_stand():
    assert format_units("a*b^2, x^2y, kg^1/2, N s/m^3, (m/s^2)^2", only=True) == "a*b^2, x^2y, √kg, N s/m³, (m/s²)^2"


@pytest.fixture(scope="module")
def browser():
    yield from start_chromium()


@needs_chromium
def test_in_a_browser_no_script_of_a_name_runs_and_nothing_is_asked_for(browser, tmp_path):
    """The policy of the page holds here, as for any reader; `Reader` switches it off."""
    html = page_of(SCRIPT, IN_FORMULA, MATHEMATICS, OTHER, directory=tmp_path)[1]
    # even a script that had got into the page would not run
    asked = []
    server = HTTPServer(("127.0.0.1", 0), lambda request, *_: asked.append(request))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    more = f"<script>document.title='owned'</script><img src=http://127.0.0.1:{server.server_port}/y></main>"
    (tmp_path / "page.html").write_text(html.replace("</main>", more), encoding="utf-8")
    page = browser.new_context().new_page()
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto((tmp_path / "page.html").as_uri())
    page.locator("[data-chart]").scroll_into_view_if_needed()
    page.locator("[data-drawn=yes]").wait_for()
    assert page.title() == SCRIPT
    server.shutdown()
    server.server_close()
    assert (asked, faults) == ([], [])
    entries = page.locator(".legend button").all_inner_texts()
    assert MATHEMATICS in entries
    assert OTHER in entries
    title = "".join(page.locator(".annotation-text").first.all_text_contents())
    assert title.replace(" ", "") == shorten(SCRIPT).replace(" ", "")  # in lines that the panel has room for
    # what a spreadsheet would take for a formula is a text in the CSV of a chart
    trace = {"name": "=1+1", "x": [0], "y": [1]}
    csv = page.evaluate("trace => csv({data: [trace], layout: {}})", trace)
    assert csv.splitlines()[1].startswith('"\'=1+1",')
    page.context.close()


# ---- terminals ---------------------------------------------------------------------------------------


def test_a_terminal_is_not_steered():
    assert escape_invisible(STEERING) == r"\x1b[31mred\x1b]0;owned\x07\x9b2J\u202e abc"
    assert escape_invisible("é 前 ✈ مرحبا\n\t") == "é 前 ✈ مرحبا\n\t"
    table = Table((Column("name", align="left"), Column("mass")), (("one\ntwo\tthree", "5"),))
    text = lay_out_text(Document(STEERING, "", STEERING, blocks=(Paragraph(STEERING), table)))
    assert not set("\x1b\x07\x9b\u202e") & set(text)
    assert "one\\ntwo\\tthree  5".replace("  ", "     ").split() == text.splitlines()[-1].split()


def test_a_table_is_as_wide_as_it_is_shown():
    columns = build_columns("channel", *(f"value {number}" for number in range(7)))
    rows = ((4 * "a\x01b", *7 * ("1.25",)), ("\U0001f469\u200d\U0001f527", *7 * ("12.5",)))
    text = lay_out_text(Document("names", "", "", None, (Table(columns, rows),)))
    assert max(map(len, text.splitlines())) <= 80
    assert 4 * "a\\x01b" in text
    prose = lay_out_text(Document("names", "", 30 * "ab\x01c ", None, (Paragraph(30 * "ab\x01c "),)))
    assert max(map(len, prose.splitlines())) <= 80
    head, row = lay_out_text(
        Document("names", "", "", None, (Table(build_columns("a\nb", "c\td"), (("x", "1"),)),))
    ).splitlines()[-2:]
    assert (head, row.split()) == ("a\\nb  c\\td", ["x", "1"])
    assert "\U0001f469\u200d\U0001f527" in text


def test_json_holds_any_name_and_steers_no_terminal():
    text = json_text({"name": STEERING, "x": "\x7f\ue000前"})
    assert not set("\x1b\x07\x9b\u202e\x7f") & set(text)
    assert json.loads(text) == {"name": STEERING, "x": "\x7f\ue000前"}


def test_a_refusal_is_one_line_whatever_the_name_of_a_file(tmp_path):
    said = refused(opid("identify", tmp_path / "one\ntwo\tthree.toml"), "there is no study file")
    assert "one two three.toml" in said


@pytest.mark.parametrize(
    "words",
    [("identify", STEERING), ("inspect", STEERING), (STEERING,), (f"--{STEERING}",), ("identify", f"--{STEERING}")],
)
def test_a_refusal_names_what_was_given_without_its_power(words):
    done = opid(*words)
    assert done.exit_code == 2
    assert not set("\x1b\x07\x9b\u202e") & set(done.output)


# ---- a whole command ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated") / "taxi"
    assert opid("simulate", "taxi", folder, "--duration", 10, "--fs", 128).exit_code == 0
    return folder


@pytest.fixture(scope="module")
def renamed(simulated, tmp_path_factory):
    """The study of two taxi runs whose names are hostile, in a folder whose name is, too."""
    folder = tmp_path_factory.mktemp("names") / "$\\frac$ 前 {0} %s"
    folder.mkdir()
    study = tomllib.loads((simulated / "study.toml").read_text(encoding="utf-8"))
    study["title"] = SCRIPT + STEERING
    for run, name in zip(study["runs"], (MATHEMATICS + IN_FORMULA, LONG + OTHER), strict=True):
        (folder / run["log"]).write_bytes((simulated / run["log"]).read_bytes())
        run["name"] = name
    (folder / "study.toml").write_text(tomli_w.dumps(study), encoding="utf-8")
    return folder


def test_a_command_with_hostile_names_gives_what_it_gives_with_others(renamed, simulated, tmp_path):
    law = ("--law", "arctan_velocity")
    done = opid("identify", renamed / "study.toml", *law, "--out", tmp_path / "hostile", "--png")
    usual = opid("identify", simulated / "study.toml", *law, "--out", tmp_path / "usual", "--no-figures")
    assert (done.exit_code, usual.exit_code) == (0, 0)
    assert not set("\x1b\x07\x9b\u202e") & set(done.output)
    found, expected = (
        json.loads((tmp_path / each / "result.json").read_text("utf-8")) for each in ("hostile", "usual")
    )
    assert found["parameters"] == expected["parameters"]
    page = Page((tmp_path / "hostile" / "report.html").read_text(encoding="utf-8"))
    assert page.handlers == []
    for name in (MATHEMATICS, " ".join(LONG.split()), OTHER, escape_invisible(STEERING)):
        assert name in page.text
    assert sorted(tmp_path.iterdir()) == [tmp_path / "hostile", tmp_path / "usual"]


def test_a_name_that_cannot_name_a_file_is_refused_where_it_has_to(renamed, tmp_path):
    import opid as package
    from opid.errors import InputError
    from opid.studies.study_file import write_study

    study = package.read_study(renamed / "study.toml")
    with pytest.raises(InputError, match="cannot name its log"):
        write_study(study, tmp_path / "written")
    assert list(tmp_path.iterdir()) == []
    refused(opid("identify", renamed / "study.toml", "--law", "$\\frac$"), "$\\\\frac$")


# ---- what is invisible -------------------------------------------------------------------------------


def test_what_unicode_takes_for_invisible_is_escaped_and_nothing_else():
    """Unassigned characters may be either: another version of Unicode may have taken them."""
    invisible = {"Cc", "Cf", "Cs", "Co", "Zl", "Zp"}
    joiners = "\u200c\u200d"
    for code in range(0x110000):
        category = unicodedata.category(chr(code))
        is_escaped = INVISIBLE.fullmatch(chr(code)) is not None
        if category in invisible and chr(code) not in joiners:
            assert is_escaped, hex(code)
        elif category != "Cn":
            assert not is_escaped, hex(code)


@pytest.mark.parametrize(
    "code", [0x200B, 0x2060, 0xAD, 0x180E, 0xFFF9, 0xFFFB, 0xE0000, 0xE0041, 0xE007F, 0x202E, 0xD800]
)
def test_an_invisible_character_is_shown_and_read_back(code):
    name = f"a{chr(code)}b"
    text = json_text({"name": name})
    assert text.isascii()
    assert "\\u" in text
    assert json.loads(text) == {"name": name}
    assert escape_invisible(name).isascii()


def test_emoji_and_scripts_keep_what_joins_them():
    for name in (
        "\U0001f468\u200d\U0001f469\u200d\U0001f467",
        "\u2708\ufe0f",
        "\u0645\u06cc\u200c\u062e\u0648\u0627\u0647\u0645",
    ):
        assert escape_invisible(name) == name
        assert json.loads(json_text({"name": name})) == {"name": name}
