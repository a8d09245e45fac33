"""Text and page of any result. A table says which module reports which kind of result."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import os
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import unescape
from importlib import import_module
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from opid.errors import InputError, escape_invisible
from opid.json_values import json_text
from opid.mechanics.truth import BodyTruth, GearTruth, ModalTruth, Truth, UpdatingTruth
from opid.progress import Say
from opid.provenance import read_content, traced
from opid.report.as_text import lay_out_text
from opid.report.document import Block, Document, Figure, Remarks, Table, end_sentence
from opid.report.formulas import write_html
from opid.result import Result
from opid.signals.files import PATIENCE_S, reserve_directory

_LEVEL = 4
"""Of the compression of the script: 6 takes twice as long, 50 ms of each page, and saves 55 kB of 1.53 MB."""

_QUOTED = re.compile(r"""((?<![\w\\])'(?:[^'\\\n]|\\.)*'(?!\w)|(?<![\w\\])"(?:[^"\\\n]|\\.)*"(?!\w))""")
"""A name as Python writes it, where a quotation mark in it stands behind a backslash."""

_LETTERS = "[\u0590-\u08ff\ufb1d-\ufdff\ufe70-\ufefc]+"
_RIGHT_TO_LEFT = re.compile(f"{_LETTERS}(?:[ .,'-]+{_LETTERS})*")

Chart = dict[str, Any]
"""A chart of Plotly as JSON: traces, axes, shapes and the entries of its legend."""


@dataclass(frozen=True)
class KindOfResult:
    """One kind of result.

    Args:
        result: its class in `opid`, by the full name, so that no wing is loaded to know the kind of a result.
        module: in `opid.report`, with `build_document`.
        truths: the records of a simulation with which it is compared.
    """

    result: str
    module: str
    truths: tuple[type, ...] = ()


KINDS = (
    KindOfResult("suspensions.result.Identification", "suspensions.identification", (GearTruth, BodyTruth)),
    KindOfResult("suspensions.paper.result.PaperIdentification", "suspensions.identification", (GearTruth, BodyTruth)),
    KindOfResult("suspensions.own_structure.StructureIdentification", "suspensions.structure"),
    KindOfResult("suspensions.bench.law.BenchLaw", "suspensions.bench"),
    KindOfResult("suspensions.sensing.result.Sensing", "suspensions.sensing"),
    KindOfResult("suspensions.wheel.result.WheelIdentification", "suspensions.wheel"),
    KindOfResult("suspensions.flights.comparison.Comparison", "suspensions.comparison"),
    KindOfResult("suspensions.flights.campaign.Campaign", "suspensions.campaign"),
    KindOfResult("suspensions.flights.fleet.Fleet", "suspensions.fleet"),
    KindOfResult("suspensions.planning.result.PlanResult", "suspensions.plan"),
    KindOfResult("signals.health.result.Health", "health"),
    KindOfResult("signals.health.result.Inspection", "health"),
    KindOfResult("modal.decay.free_decay.Decay", "decay"),
    KindOfResult("modal.linear.fitted_modes.FittedModes", "linear_modes"),
    KindOfResult("modal.linear.stages.ModeStages", "linear_modes"),
    KindOfResult("modal.result.ModalIdentification", "nonlinear_modes", (ModalTruth,)),
    KindOfResult("modal.resonance.result.Resonance", "resonance", (ModalTruth,)),
    KindOfResult("modal.resonance.result.Resonances", "resonance", (ModalTruth,)),
    KindOfResult("updating.result.Updating", "updating", (UpdatingTruth,)),
)


def text(result: Result, truth: Truth | None = None) -> str:
    """Return a result as text for a terminal of 80 columns: the numbers, what limits them, and the warnings.

    Args:
        result: of any kind.
        truth: of a simulation: shown beside each estimate.

    Raises:
        InputError: what is no result, or a truth that is none of such a result.
    """
    return lay_out_text(build_document(result, truth))


def build_document(result: Result, truth: Truth | None = None) -> Document:
    """Return the report of a result, from which its text and its page are made.

    Raises:
        InputError: what is no result, or a truth that is none of such a result.
    """
    kind = _find_kind(result)
    make: Callable[..., Document] = import_module(f"opid.report.{kind.module}").build_document
    if truth is None:
        return make(result)
    if not isinstance(truth, kind.truths):
        known = " or ".join(f"a {each.__name__}" for each in kind.truths)
        remedy = f"{known}, not with a {type(truth).__name__}" if known else "no truth: leave it out"
        raise InputError(f"a result of type {type(result).__name__} is compared with {remedy}")
    return make(result, truth)


def write_report(
    result: Result,
    directory: str | os.PathLike[str],
    truth: Truth | None = None,
    *,
    command: Sequence[str] | None = None,
    figures: bool = True,
    png: bool = False,
    progress: Say | None = None,
) -> Path:
    """Write result.json and report.html, and return the path of the page.

    Everything is made before the first file is written, and the files appear together. Files of an older report are
    replaced, those of its figures deleted, and any other file in the directory stays. The numbers of a comparison stand
    in comparison.json.

    Args:
        result: of any kind.
        directory: made if it is not there.
        truth: of a simulation: shown beside the estimates.
        command: words of the command that gave the result; where left out, of one that gives the same.
        figures: whether the page has them.
        png: whether each figure is written as a PNG file, too; where not, those of an older report are deleted.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: what is no result, a truth that is none of such a result, or a place that cannot be written to.
    """
    document = build_document(result, truth)
    every = tuple(document.details())
    pictures = [block for block in every if isinstance(block, Figure)]
    charts, images = draw_figures(pictures if figures else [], png=png, progress=progress)
    shown = [block for block in every if figures or not isinstance(block, Figure)]
    words = document.command if command is None else command
    target = Path(directory)
    stale = {f"{each.name}.png" for each in pictures} | _find_pictures(target / document.page_file)
    for chart in charts.values():
        for trace in chart["data"]:
            if "link" in trace:
                trace["link"] = _link_to(Path(trace["link"]), target)
    page = lay_out_page(
        document, (*document.blocks, *shown), charts, None if words is None else shlex.join(words), directory=target
    )
    contents = {f"{name}.png": image for name, image in images.items()}
    contents[document.page_file] = page.encode("utf-8", "backslashreplace")
    contents[document.data_file] = json_text(traced(result.to_dict(), result.files)).encode("utf-8", "backslashreplace")
    with (
        reserve_directory(directory, wait_s=PATIENCE_S) as reserved,
        # the figures of an older report would show another result
        reserved.replace_files(last=document.data_file, stale=stale) as folder,
    ):
        for name, content in contents.items():
            (folder / name).write_bytes(content)
    return target / document.page_file


def _find_pictures(page: Path) -> set[str]:
    """Return the names of the PNG files that an older page may have beside it: those of its charts."""
    try:
        names = re.findall(r'data-chart="([^"/\\]+)"', read_content(page).decode("utf-8"))
    except (OSError, ValueError):
        return set()
    return {f"{unescape(name)}.png" for name in names}


def _link_to(path: Path, directory: Path) -> str:
    """Return the address of a file for a page in a directory, so that both may be moved together."""
    return quote(Path(os.path.relpath(path, directory)).as_posix())


def _find_kind(result: Result) -> KindOfResult:
    names = [f"{each.__module__}.{each.__qualname__}" for each in type(result).__mro__]
    for kind in KINDS:
        if f"opid.{kind.result}" in names:
            return kind
    kinds = ", ".join(kind.result.rpartition(".")[2] for kind in KINDS)
    raise InputError(f"a {type(result).__name__} is no result of opid: give one of {kinds}")


def draw_figures(
    figures: Sequence[Figure], *, png: bool = False, progress: Say | None = None
) -> tuple[dict[str, Chart], dict[str, bytes]]:
    """Return the chart of each figure by its name, and its PNG file where that is wanted."""
    from opid.plots.charts.figure import build_chart
    from opid.plots.style import figure_of, png as png_of

    charts: dict[str, Chart] = {}
    images: dict[str, bytes] = {}
    for figure in figures:
        if progress is not None:
            progress(f"figure {figure.name}")
        drawn = figure_of(figure.draw())
        charts[figure.name] = build_chart(drawn)
        if png:
            images[figure.name] = png_of(drawn)
    return charts, images


def lay_out_page(
    document: Document, blocks: Sequence[Block], charts: Mapping[str, Chart], command: str | None, *, directory: Path
) -> str:
    """Return a document as a page of a directory that opens offline, with its charts and their script inside."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    from opid.plots.style import format_units

    def format_words(text: str) -> str:
        # what stands in quotation marks is a name, which stays as it is
        parts = _QUOTED.split(escape_invisible(text))
        return _isolate("".join(part if k % 2 else format_prose(part) for k, part in enumerate(map(html, parts))))

    def html(text: str) -> str:
        return str(escape(text))

    def format_prose(text: str) -> str:
        return re.sub("`([^`]+)`", r"<code>\1</code>", format_units(text, only=True))

    def format_text(text: str) -> Markup:
        return Markup(write_html(text, format_words))

    def format_cell(text: str) -> Markup:
        """A cell may be a name of the user, which has no words in another typeface."""
        return Markup(write_html(text, lambda words: _isolate(format_units(html(escape_invisible(words)), only=True))))

    def finalize(value: Any) -> Any:
        return escape_invisible(value) if type(value) is str else value

    def embed_chart(chart: Chart) -> Markup:
        # no name of a channel can end the script or begin a comment in it
        return Markup(json.dumps(chart, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))

    loader = PackageLoader("opid.report")
    page = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page.finalize = finalize
    page.filters |= {"printed": format_text, "cell": format_cell, "ended": end_sentence}
    page.filters["kind"] = lambda block: type(block).__name__
    places = find_places(blocks)
    page.filters |= {"embedded": embed_chart, "place": lambda block: places[id(block)]}
    page.filters["linked"] = lambda path: _link_to(path, directory)
    has_filter = any(isinstance(block, Table) and block.is_filtered for block in blocks)
    needed = {"charts.js": bool(charts), "tables.js": has_filter}
    scripts = [page.get_template(name).render() for name, is_needed in needed.items() if is_needed]
    return page.get_template("document.html.jinja").render(
        document=document,
        blocks=blocks,
        charts=charts,
        contents=[(find_heading(block), places[id(block)]) for block in blocks if find_heading(block)],
        script=pack_script() if charts else "",
        scripts=[Markup(each) for each in scripts],
        policy=write_policy([*scripts, *([read_script()] if charts else [])]),
        command=command,
        version=version("opid"),
    )


def _isolate(html: str) -> str:
    """Keep what is written from right to left from turning the numbers around it."""
    return _RIGHT_TO_LEFT.sub(r"<bdi>\g<0></bdi>", html)


def find_heading(block: Block) -> str:
    """Return the heading of a block; empty if it has none."""
    if isinstance(block, Table):
        return block.title
    return "" if isinstance(block, Remarks) else block.heading


def find_places(blocks: Sequence[Block]) -> dict[int, str]:
    """Return the place of each block on the page, to which a link may lead, by its identity.

    >>> from opid.report.document import Paragraph
    >>> first, second = Paragraph("", "The law"), Paragraph("", "The law")
    >>> list(find_places([first, second]).values())
    ['the-law', 'the-law-2']
    """
    places: dict[int, str] = {}
    for block in blocks:
        stem = re.sub(r"\W+", "-", find_heading(block).casefold()).strip("-")
        n_before = sum(re.fullmatch(rf"{re.escape(stem)}(-\d+)?", place) is not None for place in places.values())
        places[id(block)] = f"{stem}-{n_before + 1}" if n_before else stem
    return places


@cache
def pack_script() -> str:
    """Return the script of Plotly, compressed: the page unpacks it, which makes it three times as small."""
    return base64.b64encode(gzip.compress(read_script().encode(), _LEVEL, mtime=0)).decode()


@cache
def read_script() -> str:
    """Return the script of Plotly."""
    return (Path(str(files("plotly"))) / "package_data" / "plotly.min.js").read_text(encoding="utf-8")


def write_policy(scripts: Sequence[str]) -> str:
    """Return what a browser may do on a page: run these scripts and no other, and fetch nothing from anywhere.

    Args:
        scripts: of the page, to the letter.
    """
    digests = [base64.b64encode(hashlib.sha256(each.encode()).digest()).decode() for each in scripts]
    allowed = " ".join(f"'sha256-{each}'" for each in digests) or "'none'"
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
        "form-action 'none'"
    )
