"""What the site shows beside the pages in docs/: the pages at the root, the notebooks, and the reference.

mkdocs calls the two functions below (`hooks` in mkdocs.yml). The reference of Python names and of laws is made from
opid itself, so that none is forgotten.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from html import unescape
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from griffe import Extension, Object
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import opid
from opid.mechanics.laws.kinds import LAWS

ROOT = Path(__file__).parent.parent
PAGES = {"index.md": "README.md"} | {
    name: name for name in ("VISION.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md")
}
NAMESPACES = {
    name: "names_of_laws" if name == "laws" else name
    for name in (
        "signals",
        "laws",
        "mechanics",
        "suspensions",
        "modal",
        "updating",
        "virtual",
        "plots",
        "campaigns",
        "planning",
    )
}


@event_priority(100)  # before the plugin that turns notebooks into pages
def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the pages that do not stand in docs/."""
    contents = {place: (ROOT / name).read_text(encoding="utf-8") for place, name in PAGES.items()}
    contents |= {
        "reference/command_line.md": COMMAND_LINE,
        "reference/laws.md": _laws(),
        "reference/python.md": "# opid\n\n" + "\n\n".join(_section("opid", opid)),
    }
    for name, page in NAMESPACES.items():
        module = import_module(f"opid.{name}")
        contents[f"reference/{page}.md"] = "\n\n".join([f"# opid.{name}", *_section(f"opid.{name}", module)])
    for place, content in contents.items():
        files.append(File.generated(config, place, content=content))
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        files.append(File(f"notebooks/{notebook.name}", str(ROOT), config.site_dir, config.use_directory_urls))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links between the root and docs/ hold on the site, where both are one folder."""
    folder = "docs/" if page.file.src_uri in PAGES else "../"
    return re.sub(rf"\]\({re.escape(folder)}", "](", markdown)


def on_page_content(html: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Typeset the formulas of notebooks, which the extension for Markdown does not see."""
    if not page.file.src_uri.endswith(".ipynb"):
        return html
    parts = re.split(r"(<(pre|code|script|style|svg)\b.*?</\2>)", html, flags=re.DOTALL)
    # `split` yields text, an element that is no prose, and its name, in turn
    parts[::3] = [FORMULA.sub(_math_ml, part) for part in parts[::3]]
    del parts[2::3]
    return "".join(parts)


FORMULA = re.compile(r"\$\$(?P<block>[^$]+)\$\$|\$(?P<inline>[^$\n]+)\$")
COMMAND_LINE = """# Command line

::: mkdocs-click
    :module: opid.cli
    :command: main
    :prog_name: opid
    :depth: 1
    :style: plain
"""


def _math_ml(found: re.Match[str]) -> str:
    return convert(unescape(found["block"] or found["inline"]), display="block" if found["block"] else "inline")


def _laws() -> str:
    lines = [
        "# Laws",
        "The nonlinear part of a suspension's force over the travel $z$ and its rate $\\dot z$. A law is one of these "
        "kinds, or a sum of them; `opid.register_kind` adds your own.",
    ]
    for kind in LAWS.values():
        rows = [f"| `{each.name}` | {each.unit} | {each.default:g} | {each.role} |" for each in kind.parameters]
        table = "\n".join(["| parameter | unit | default | role |", "|---|---|---|---|", *rows])
        lines += [f"## {kind.name}", f"$${kind.latex}$$", table]
    return "\n\n".join(lines)


def _section(place: str, module: ModuleType) -> Iterator[str]:
    """Yield the text of a namespace and, of each of its public names, where mkdocstrings finds it."""
    yield inspect.getdoc(module) or ""
    file = Path(str(module.__file__))
    tree = ast.parse((stub if (stub := file.with_suffix(".pyi")).exists() else file).read_text(encoding="utf-8"))
    homes = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            home = f"{module.__package__}.{node.module}" if node.level else node.module
            homes |= {each.name: f"{home}.{each.name}" for each in node.names}
    names = sorted(set(module.__all__) & set(homes), key=str.lower)
    for name in names:
        if callable(getattr(module, name)):
            yield f"::: {homes[name]}"
    values = [f"- `{name}`" for name in names if not callable(getattr(module, name))]
    yield "\n".join(["## Values", "", *values] if values else [])


class ExamplesAsCode(Extension):
    """Examples of docstrings stand after `>>>` without a heading: the site shows them as code."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Put a fence around each paragraph that begins with `>>>`."""
        if obj.docstring:
            obj.docstring.value = re.sub(r"^>>> (?:.+\n?)+", "```pycon\n\\g<0>\n```\n", obj.docstring.value, flags=re.M)
