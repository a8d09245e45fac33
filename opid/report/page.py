"""A page that opens offline: its figures as PNG, and a template filled in."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from importlib.metadata import version
from typing import Any

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


def rendered(template: str, images: Mapping[str, bytes], **values: Any) -> str:
    """Return a template of this package filled in, with the figures inside.

    Args:
        template: name of its file.
        images: PNG by the name of the figure: `source` in the template.
        values: what else it names.
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    from opid.plots.style import pretty

    def text(name: str) -> str:
        return resources.files("opid.report").joinpath("templates", name).read_text(encoding="utf-8")

    environment = Environment(
        loader=FunctionLoader(text), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["pretty"] = pretty
    source = {name: "data:image/png;base64," + base64.b64encode(image).decode() for name, image in images.items()}
    return environment.get_template(template).render(source=source, version=version("opid"), **values)
