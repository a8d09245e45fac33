"""The arrows of ARCHITECTURE.md, held by walking the syntax tree of every file."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "opid"
MODULES = sorted(PACKAGE.rglob("*.py"))

# Each room, and the rooms it may import from beside itself. Wings are not in each other's rows.
GROUND = {"errors", "estimate"}
MAY_IMPORT = {
    "errors": set(),
    "estimate": set(),
    "signals": GROUND,
    "mechanics": GROUND | {"signals"},
    "identify": GROUND | {"signals", "mechanics"},
    "modal": GROUND | {"signals", "mechanics"},
    "updating": GROUND | {"signals", "mechanics"},
    "plots": GROUND | {"signals", "mechanics", "identify", "modal", "updating"},
    "report": GROUND | {"signals", "mechanics", "identify", "modal", "updating", "plots"},
    "cli": GROUND | {"signals", "mechanics", "identify", "modal", "updating", "plots", "report", "__init__"},
}
# `import opid` names everything and loads nothing; `python -m opid` is the command.
MAY_IMPORT["__init__"] = GROUND
MAY_IMPORT["__main__"] = {"cli"}

HEAVY = ("matplotlib", "pysindy", "numba", "scipy.signal")

modules = pytest.mark.parametrize("path", MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix())


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def room_of(path):
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imports(path, tree):
    """Yield each import of a module as its full name, `from . import x` included, with its line."""
    package = ("opid", *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((f"{stem}.{alias.name}", node.lineno) for alias in node.names)


def test_the_walk_finds_the_package():
    assert PACKAGE / "errors.py" in MODULES
    assert {room_of(path) for path in MODULES} <= set(MAY_IMPORT)


def test_every_way_of_importing_is_seen():
    code = "import a.b\nfrom opid.plots import c\nfrom . import d\ndef f():\n    from ..clock import e\n"
    found = imports(PACKAGE / "signals" / "logs" / "x.py", ast.parse(code))
    expected = ["a.b", "opid.plots.c", "opid.signals.logs.d", "opid.signals.clock.e"]
    assert sorted(name for name, _ in found) == sorted(expected)


@modules
def test_imports_follow_the_arrows(path):
    room = room_of(path)
    for name, line in imports(path, tree_of(path)):
        parts = name.split(".")
        if parts[0] != "opid":
            continue
        target = parts[1] if len(parts) > 1 and parts[1] in MAY_IMPORT else "__init__"
        assert target == room or target in MAY_IMPORT[room], f"line {line}: {room} may not import {name}"


@modules
def test_no_import_reaches_upward(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom):
            assert node.level <= 1, f"line {node.lineno}: write the import from opid"


@modules
def test_matplotlib_stays_in_plots(path):
    if room_of(path) != "plots":
        for name, line in imports(path, tree_of(path)):
            assert name.split(".")[0] != "matplotlib", f"line {line}"


@modules
def test_pysindy_is_imported_only_where_it_is_used(path):
    tree = tree_of(path)
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    inside = {line for function in functions for _, line in imports(path, function)}
    for name, line in imports(path, tree):
        assert name.split(".")[0] != "pysindy" or line in inside, f"line {line}: import it in the function"


@modules
def test_the_library_prints_nothing_and_silences_no_warnings(path):
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called != "print" or room_of(path) == "cli", f"line {node.lineno}: return it instead"
            assert not re.search(r"\b(filterwarnings|simplefilter|catch_warnings)$", called), f"line {node.lineno}"


@modules
def test_nothing_is_done_at_import(path):
    for node in tree_of(path).body:
        assert not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)), f"line {node.lineno}"
        assert not isinstance(node, ast.For | ast.While | ast.With), f"line {node.lineno}"


def test_import_opid_loads_nothing_heavy():
    code = f"import sys, opid; print(*[name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def arguments(node):
    """Return the argument names of a function, or the field names of a dataclass."""
    if isinstance(node, ast.FunctionDef):
        spec = node.args
        every = [*spec.posonlyargs, *spec.args, *spec.kwonlyargs, spec.vararg, spec.kwarg]
        return [each.arg for each in every if each is not None and each.arg not in ("self", "cls")]
    if not any("dataclass" in ast.unparse(decorator) for decorator in node.decorator_list):
        return []
    fields = [each for each in node.body if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)]
    return [each.target.id for each in fields if "ClassVar" not in ast.unparse(each.annotation)]


def public_definitions(tree):
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
            yield node


@modules
def test_every_argument_is_documented(path):
    if room_of(path) == "cli":
        return  # click's options carry their own help
    missing = [
        f"{node.name}: {name}"
        for node in public_definitions(tree_of(path))
        for name in arguments(node)
        if not name.startswith("_") and not re.search(rf"\b{name}\b", ast.get_docstring(node) or "")
    ]
    assert missing == []


@modules
def test_every_public_name_has_a_docstring(path):
    assert ast.get_docstring(tree_of(path)) or not path.read_text(encoding="utf-8").strip()
    missing = [node.name for node in public_definitions(tree_of(path)) if not ast.get_docstring(node)]
    assert missing == []


def test_every_module_stands_in_the_picture():
    picture = (PACKAGE.parent / "ARCHITECTURE.md").read_text(encoding="utf-8")
    missing = [path.name for path in MODULES if path.name != "__init__.py" and path.name not in picture]
    assert missing == []
