"""A page that opens offline: figures as PNG, and the one template filled in."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version

from opid.report.document import Block, Document, Figure, ended


def pictured(figures: Sequence[Figure], *, progress: Callable[[str], None] | None = None) -> dict[str, bytes]:
    """Return figures as PNG, by their names.

    Args:
        figures: to draw.
        progress: called with the name of each as it is drawn.
    """
    from opid.plots.style import figure_of, png

    images: dict[str, bytes] = {}
    for figure in figures:
        if progress is not None:
            progress(f"figure {figure.name}")
        images[figure.name] = png(figure_of(figure.draw()))
    return images


def as_page(document: Document, blocks: Sequence[Block], images: Mapping[str, bytes], command: str | None) -> str:
    """Return a document as a page that opens offline, with its figures inside.

    Args:
        document: of any result.
        blocks: what stands between its answer and how to do it again.
        images: PNG by the name of the figure.
        command: the line that gives the result again, or None.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup, escape

    from opid.plots.style import DPI, WIDTH_IN, pretty

    def printed(text: str) -> Markup:
        return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(pretty(text)))))

    loader = PackageLoader("opid.report")
    page = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    page.filters |= {"printed": printed, "ended": ended, "kind": lambda block: type(block).__name__}
    source = {name: "data:image/png;base64," + base64.b64encode(image).decode() for name, image in images.items()}
    # letters of all figures are of one size: a PNG says in its head how many dots it is wide
    parts = {name: int.from_bytes(image[16:20], "big") / (DPI * WIDTH_IN) for name, image in images.items()}
    return page.get_template("document.html.jinja").render(
        document=document, blocks=blocks, source=source, parts=parts, command=command, version=version("opid")
    )
