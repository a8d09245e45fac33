"""Numbers in the pages that come from the code."""

import re
from pathlib import Path

import pytest

from opid.mechanics.laws.kinds import BUILT_IN
from opid.suspensions.settings import Verdicts

ROOT = Path(__file__).parent.parent
PAGES = ("README.md", "CHANGELOG.md", "docs/whole_aircraft.md")
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


def test_every_file_of_the_estimator_stands_in_the_table_of_the_picture():
    picture = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    wing = ROOT / "opid" / "suspensions"
    folders = ("", "model/", "fitting/", "law_search/", "answer/")
    paths = [path for folder in folders for path in wing.glob(f"{folder}[a-z]*.py")]
    files = {".".join(path.relative_to(wing).with_suffix("").parts) for path in paths}
    assert len(files) > 25
    assert {each for each in files if f"`{each}`" not in picture} == set()
