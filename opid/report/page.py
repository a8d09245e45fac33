"""A page that opens offline: what stands on it, its figures as PNG, and a template filled in."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from opid.report.document import Block, Document, Figure, ended

if TYPE_CHECKING:
    from jinja2 import Environment

Truth = Mapping[str, Any]
# takes a result, returns Axes
Draw = Callable[[Any, Truth | None], Any]


@dataclass(frozen=True)
class Picture:
    """One figure of the report.

    Args:
        name: of its PNG file, without the ending.
        heading: what it is about.
        text: what to see in it.
        draw: makes it from the result and the truth of a simulated run.
    """

    name: str
    heading: str
    text: str
    draw: Draw


@dataclass(frozen=True)
class Page:
    """What the page of a result shows.

    Args:
        template: name of its file.
        title: headline.
        pictures: in their order.
        content: what the template names beside what every page has.
        warnings: what to doubt, one sentence each.
        not_determined: why there is no answer; empty or None if there is one.
        command: words of the command line that gives the result again; None where no command does.
        python: lines of Python that give it again; empty where a command is enough.
        data_file: name of the file beside the page that has all numbers.
    """

    template: str
    title: str
    pictures: tuple[Picture, ...] = ()
    content: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    not_determined: str | None = None
    command: Sequence[str] | None = None
    python: str = ""
    data_file: str = "result.json"


def drawn(
    pictures: Sequence[Picture], result: Any, truth: Truth | None, *, progress: Callable[[str], None] | None = None
) -> dict[str, bytes]:
    """Return the figures of a report as PNG, by their names.

    Args:
        pictures: to draw.
        result: that they show.
        truth: of a simulation: shown beside it.
        progress: called with the name of each figure as it is drawn.
    """
    from opid.plots.style import figure_of, png

    say = progress or (lambda step: None)
    images: dict[str, bytes] = {}
    for picture in pictures:
        say(f"figure {picture.name}")
        images[picture.name] = png(figure_of(picture.draw(result, truth)))
    return images


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


def rendered(page: Page, images: Mapping[str, bytes], *, command: str | None, **values: Any) -> str:
    """Return a page as HTML, with the figures inside.

    Args:
        page: what it shows.
        images: PNG by the name of the figure.
        command: the line that gives the result again, or None.
        values: what else every template may name.
    """
    environment = _environment()
    source = {name: "data:image/png;base64," + base64.b64encode(image).decode() for name, image in images.items()}
    values |= {"page": page, "source": source, "command": command, "version": version("opid")}
    return environment.get_template(page.template).render(**values, **page.content)


def as_page(document: Document, blocks: Sequence[Block], images: Mapping[str, bytes], command: str | None) -> str:
    """Return a document as a page that opens offline, with its figures inside.

    Args:
        document: of any result.
        blocks: what stands between its answer and how to do it again.
        images: PNG by the name of the figure.
        command: the line that gives the result again, or None.
    """
    source = {name: "data:image/png;base64," + base64.b64encode(image).decode() for name, image in images.items()}
    return (
        _environment()
        .get_template("document.html.jinja")
        .render(document=document, blocks=blocks, source=source, command=command, version=version("opid"))
    )


def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    from opid.plots.style import pretty

    def text(name: str) -> str:
        return resources.files("opid.report").joinpath("templates", name).read_text(encoding="utf-8")

    environment = Environment(
        loader=FunctionLoader(text), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"pretty": pretty, "ended": ended, "kind": lambda block: type(block).__name__}
    return environment
