"""Text and page of any result. A table says which module reports which kind of result."""

from __future__ import annotations

import base64
import os
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from opid.errors import InputError
from opid.json_values import json_text
from opid.mechanics.truth import BodyTruth, GearTruth, ModalTruth, Truth, UpdatingTruth
from opid.provenance import traced
from opid.report.as_text import as_text
from opid.report.document import Block, Document, Figure, ended
from opid.result import Result
from opid.signals.files import write_together


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
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Everything is made before the first file is written, and the files appear together. Files of an older report are
    replaced, any other file in the directory stays. The numbers of a comparison stand in comparison.json.

    Args:
        result: of any kind.
        directory: made if it is not there.
        truth: of a simulation: shown beside the estimates.
        command: words of the command that gave the result; where left out, of one that gives the same.
        figures: whether they are drawn; where not, those of an older report are deleted.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: what is no result, a truth that is none of such a result, or a place that cannot be written to.
    """
    document = document_of(result, truth)
    every = tuple(document.details())
    pictures = [block for block in every if isinstance(block, Figure)]
    images = draw_pictures(pictures if figures else [], progress=progress)
    shown = [block for block in every if figures or not isinstance(block, Figure)]
    words = document.command if command is None else command
    html = as_page(document, (*document.blocks, *shown), images, None if words is None else shlex.join(words))
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = html.encode("utf-8", "backslashreplace")
    # result.json is the last file, so that it never exists without its report
    contents[document.data_file] = json_text(traced(result.to_dict(), result.files)).encode("utf-8", "backslashreplace")
    write_together(directory, contents)
    # the figures of an older report would show another result
    for figure in () if figures else pictures:
        Path(directory, f"{figure.name}.png").unlink(missing_ok=True)
    return Path(directory) / "report.html"


def _kind_of(result: Result) -> KindOfResult:
    names = [f"{each.__module__}.{each.__qualname__}" for each in type(result).__mro__]
    for kind in KINDS:
        if f"opid.{kind.result}" in names:
            return kind
    kinds = ", ".join(kind.result.rpartition(".")[2] for kind in KINDS)
    raise InputError(f"a {type(result).__name__} is no result of opid: give one of {kinds}")


def draw_pictures(figures: Sequence[Figure], *, progress: Callable[[str], None] | None = None) -> dict[str, bytes]:
    """Return figures as PNG, by their names."""
    from opid.plots.style import figure_of, png

    images: dict[str, bytes] = {}
    for figure in figures:
        if progress is not None:
            progress(f"figure {figure.name}")
        images[figure.name] = png(figure_of(figure.draw()))
    return images


def as_page(document: Document, blocks: Sequence[Block], images: Mapping[str, bytes], command: str | None) -> str:
    """Return a document as a page that opens offline, with its figures inside."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    from opid.plots.style import DPI, WIDTH_IN, pretty

    def printed(text: str) -> Markup:
        return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(pretty(text)))))

    loader = PackageLoader("opid.report")
    page = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page.filters |= {"printed": printed, "ended": ended, "kind": lambda block: type(block).__name__}
    source = {name: "data:image/png;base64," + base64.b64encode(image).decode() for name, image in images.items()}
    # figures get a width in proportion to their dots, which a PNG has in its head: so all letters have one size
    parts = {name: int.from_bytes(image[16:20], "big") / (DPI * WIDTH_IN) for name, image in images.items()}
    return page.get_template("document.html.jinja").render(
        document=document, blocks=blocks, source=source, parts=parts, command=command, version=version("opid")
    )
