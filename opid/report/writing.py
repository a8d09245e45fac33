"""Text and page of any result. A table says which module reports which kind of result."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

from opid.errors import InputError
from opid.json_values import json_text
from opid.mechanics.truth import BodyTruth, GearTruth, ModalTruth, Truth, UpdatingTruth
from opid.provenance import traced
from opid.report.as_text import as_text
from opid.report.document import Block, Document, Figure, Remarks, Sketch, Table, ended
from opid.result import Result
from opid.signals.files import write_together

Chart = dict[str, Any]
"""A chart of Plotly as JSON: traces, axes, shapes and the entries of its legend."""


@dataclass(frozen=True)
class KindOfResult:
    """One kind of result.

    Args:
        result: its class in `opid`, by the full name, so that no wing is loaded to know the kind of a result.
        module: in `opid.report`, with `document_of`.
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
    KindOfResult("suspensions.flights.comparison.Comparison", "suspensions.comparison"),
    KindOfResult("signals.health.result.Health", "health"),
    KindOfResult("signals.health.result.Inspection", "health"),
    KindOfResult("modal.decay.free_decay.Decay", "decay"),
    KindOfResult("modal.result.ModalIdentification", "nonlinear_modes", (ModalTruth,)),
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
    return as_text(document_of(result, truth))


def document_of(result: Result, truth: Truth | None = None) -> Document:
    """Return the report of a result, from which its text and its page are made.

    Raises:
        InputError: what is no result, or a truth that is none of such a result.
    """
    kind = _kind_of(result)
    make: Callable[..., Document] = import_module(f"opid.report.{kind.module}").document_of
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
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json and report.html, and return the path of the page.

    Everything is made before the first file is written, and the files appear together. Files of an older report are
    replaced, any other file in the directory stays. The numbers of a comparison stand in comparison.json.

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
    document = document_of(result, truth)
    every = tuple(document.details())
    pictures = [block for block in every if isinstance(block, Figure)]
    charts, images = draw_figures(pictures if figures else [], png=png, progress=progress)
    shown = [block for block in every if figures or not isinstance(block, Figure)]
    words = document.command if command is None else command
    html = as_page(document, (*document.blocks, *shown), charts, None if words is None else shlex.join(words))
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = html.encode("utf-8", "backslashreplace")
    # result.json is the last file, so that it never exists without its report
    contents[document.data_file] = json_text(traced(result.to_dict(), result.files)).encode("utf-8", "backslashreplace")
    write_together(directory, contents)
    # the figures of an older report would show another result
    for figure in () if images else pictures:
        Path(directory, f"{figure.name}.png").unlink(missing_ok=True)
    return Path(directory) / "report.html"


def _kind_of(result: Result) -> KindOfResult:
    names = [f"{each.__module__}.{each.__qualname__}" for each in type(result).__mro__]
    for kind in KINDS:
        if f"opid.{kind.result}" in names:
            return kind
    kinds = ", ".join(kind.result.rpartition(".")[2] for kind in KINDS)
    raise InputError(f"a {type(result).__name__} is no result of opid: give one of {kinds}")


def draw_figures(
    figures: Sequence[Figure], *, png: bool = False, progress: Callable[[str], None] | None = None
) -> tuple[dict[str, Chart], dict[str, bytes]]:
    """Return the chart of each figure by its name, and its PNG file where that is wanted."""
    from opid.plots.charts.figure import chart_of
    from opid.plots.style import figure_of, png as png_of

    charts: dict[str, Chart] = {}
    images: dict[str, bytes] = {}
    for figure in figures:
        if progress is not None:
            progress(f"figure {figure.name}")
        drawn = figure_of(figure.draw())
        charts[figure.name] = chart_of(drawn)
        if png:
            images[figure.name] = png_of(drawn)
    return charts, images


def as_page(document: Document, blocks: Sequence[Block], charts: Mapping[str, Chart], command: str | None) -> str:
    """Return a document as a page that opens offline, with its charts and their script inside."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    from opid.plots.style import pretty

    def printed(text: str) -> Markup:
        return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(pretty(text)))))

    def embedded(chart: Chart) -> Markup:
        # no name of a channel can end the script or begin a comment in it
        return Markup(json.dumps(chart, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"))

    loader = PackageLoader("opid.report")
    page = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page.filters |= {"printed": printed, "ended": ended, "kind": lambda block: type(block).__name__}
    places = find_places(blocks)
    page.filters |= {"embedded": embedded, "place": lambda block: places[id(block)]}
    return page.get_template("document.html.jinja").render(
        document=document,
        blocks=blocks,
        charts=charts,
        contents=[(heading_of(block), places[id(block)]) for block in blocks if heading_of(block)],
        script=packed_script() if charts else "",
        command=command,
        version=version("opid"),
    )


def heading_of(block: Block) -> str:
    """Return the heading of a block; empty if it has none."""
    if isinstance(block, Table):
        return block.title
    return "" if isinstance(block, Remarks | Sketch) else block.heading


def find_places(blocks: Sequence[Block]) -> dict[int, str]:
    """Return the place of each block on the page, to which a link may lead, by its identity.

    >>> from opid.report.document import Paragraph
    >>> first, second = Paragraph("", "The law"), Paragraph("", "The law")
    >>> list(find_places([first, second]).values())
    ['the-law', 'the-law-2']
    """
    places: dict[int, str] = {}
    for block in blocks:
        stem = re.sub(r"\W+", "-", heading_of(block).casefold()).strip("-")
        n_before = sum(re.fullmatch(rf"{re.escape(stem)}(-\d+)?", place) is not None for place in places.values())
        places[id(block)] = f"{stem}-{n_before + 1}" if n_before else stem
    return places


@cache
def packed_script() -> str:
    """Return the script of Plotly, compressed: the page unpacks it, which makes it three times as small."""
    path = Path(str(files("plotly"))) / "package_data" / "plotly.min.js"
    return base64.b64encode(gzip.compress(path.read_bytes(), mtime=0)).decode()
