"""Whatever opid raises is one of three: bad input or usage, not determined, or an end from outside.

`tests/test_spoiled_inputs.py` shows how a command ends by each of them. Here the syntax tree of every file is walked: a
`raise` of another class is caught in its own file, or stands in `REASONS`. An `assert` is left out: it tells mypy what
the code before it has made sure of.
"""

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "opid"
SOURCES = {
    each.relative_to(PACKAGE).as_posix(): each.read_text(encoding="utf-8") for each in sorted(PACKAGE.rglob("*.py"))
}

ROOTS = {
    *("InputError", "NotDeterminedError"),
    *("click.ClickException", "click.UsageError", "click.BadParameter"),
    "error.reword",  # the same class with another message
    "SystemExit",  # the system ends the command
}
"""The classes that may reach the command line, with all that derive from them."""

REASONS = {
    ("json_values.py", "ValueError"): "`result.load_document` and `virtual.truth_file` make an InputError of it",
    ("plots/charts/artists.py", "UnknownArtistError"): "a figure of opid holds what no chart shows: a fault of opid",
    ("plots/charts/surfaces.py", "UnknownArtistError"): "a figure of opid holds what no chart shows: a fault of opid",
    ("signals/log.py", "ValueError"): "`signals.logs` makes an InputError of whatever a reader of a format raises",
    ("signals/logs/lvm.py", "IndexError"): "`signals.logs` makes an InputError of whatever a reader of a format raises",
    ("signals/logs/apart.py", "ReadingEndedError"): "`signals.logs` makes an InputError of whatever a reader raises",
    ("plots/comparison.py", "ValueError"): "a program asks a plot for a quantity that the result has not",
    ("plots/style.py", "ValueError"): "a program hands over as many Axes as the figure does not have",
    ("signals/logs/apart.py", "answer"): "the exception that the process which reads has sent, as if raised here",
    ("signals/logs/apart.py", "block"): "an InputError or the library's own, kept until its block is asked for",
    ("signals/logs/apart.py", "AssertionError"): "nobody can call it: what it stands for runs in the other process",
}
"""Raises of another kind, by file and what is raised, with the reason why no command ends by them."""


def name_of(node):
    """Return the name of what is raised: of `InputError("x")` that of its class, of a variable its own."""
    return ast.unparse(node.func if isinstance(node, ast.Call) else node)


def find_bases(trees):
    """Return {name of a class of opid: the names of its bases}."""
    return {
        node.name: {ast.unparse(each) for each in node.bases}
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }


def find_allowed(bases):
    """Return the roots, and the names of all classes of opid that derive from them."""
    allowed = set(ROOTS)
    while more := {name for name, own in bases.items() if allowed & own} - allowed:
        allowed |= more
    return allowed


def find_makers(trees):
    """Return {name of a function: what it says that it returns}: one may make the error that another raises."""
    return {
        node.name: ast.unparse(node.returns)
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and node.returns is not None
    }


def find_tuples(trees):
    """Return {name: its classes} of tuples of exceptions that handlers name, such as `NO_FIT`."""
    return {
        ast.unparse(node.targets[0]): set(map(ast.unparse, node.value.elts))
        for tree in trees
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)
    }


@cache
def read_tuples():
    return find_tuples(map(ast.parse, SOURCES.values()))


def classes_in(node):
    """Return the names of the classes that a handler of exceptions, or an annotation, names."""
    if isinstance(node, ast.Name) and node.id in read_tuples():
        return read_tuples()[node.id]
    if isinstance(node, ast.BinOp):
        return classes_in(node.left) | classes_in(node.right)
    if isinstance(node, ast.Tuple):
        return set().union(*map(classes_in, node.elts))
    if isinstance(node, ast.Subscript):  # a list of errors
        return classes_in(node.slice)
    return {ast.unparse(node)} if node is not None else set()


def find_kept(tree, name):
    """Return the classes of an exception that a variable keeps: by its annotation, or by what caught it."""
    caught = {
        node.name: classes_in(node.type)
        for node in ast.walk(tree)
        if isinstance(node, ast.ExceptHandler) and node.name is not None
    }
    found = set(caught.get(name, ()))
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign | ast.arg):
            target = node.target if isinstance(node, ast.AnnAssign) else node.arg
            if node.annotation is not None and name == (target if isinstance(target, str) else ast.unparse(target)):
                found |= classes_in(node.annotation)
        elif isinstance(node, ast.Assign) and name in map(ast.unparse, node.targets):
            found |= caught.get(ast.unparse(node.value), set())
    return found - {"None"}


def find_fields(trees):
    """Return {name of a field of a record: the classes of its annotation}."""
    return {
        ast.unparse(each.target): classes_in(each.annotation) - {"None"}
        for tree in trees
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        for each in node.body
        if isinstance(each, ast.AnnAssign)
    }


def find_faults(path, tree, bases, makers, kept_in_fields):
    """Yield (what, line) of each raise in a file that may be neither raised nor is caught in it."""
    allowed = find_allowed(bases)
    caught = set().union(
        *(classes_in(node.type) for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) and node.type)
    )
    for node in ast.walk(tree):
        if not isinstance(node, ast.Raise) or node.exc is None:
            continue  # what is raised again has been raised elsewhere
        for each in node.exc.values if isinstance(node.exc, ast.BoolOp) else [node.exc]:
            name = name_of(each)
            made = makers.get(name)
            if isinstance(each, ast.Subscript):
                kept = find_kept(tree, ast.unparse(each.value))
            elif isinstance(each, ast.Name):
                kept = find_kept(tree, name)
            elif isinstance(each, ast.Attribute):  # of a record, which may stand in another file
                kept = kept_in_fields.get(each.attr, set())
            else:
                kept = set()
            is_allowed = name in allowed or made in allowed or bool(kept and kept <= allowed)
            is_caught = not caught.isdisjoint({name, *bases.get(name, ())})
            if not is_allowed and not is_caught and (path, name) not in REASONS:
                yield name, node.lineno


def find_all(sources):
    trees = {path: ast.parse(source) for path, source in sources.items()}
    bases, makers, fields = (find(trees.values()) for find in (find_bases, find_makers, find_fields))
    return [
        f"{path}, line {line}: {what}"
        for path, tree in trees.items()
        for what, line in find_faults(path, tree, bases, makers, fields)
    ]


def test_whatever_is_raised_is_one_of_three():
    assert find_all(SOURCES) == []


def test_every_reason_is_needed():
    raised = {
        (path, name_of(node.exc))
        for path, source in SOURCES.items()
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Raise) and node.exc is not None
    }
    assert raised >= REASONS.keys()


@pytest.mark.parametrize(
    "code",
    [
        "raise ValueError('x')",
        "raise KeyError",
        "def f() -> ValueError:\n    return ValueError()\nraise f()",
        "class OwnError(Exception):\n    pass\nraise OwnError",
        "try:\n    f()\nexcept (OSError, InputError) as error:\n    kept = error\nraise kept",
        "failed: OSError | InputError | None = None\nraise failed",
        "raise failed or RuntimeError('x')",
        "try:\n    raise ValueError\nexcept KeyError:\n    pass",
    ],
)
def test_the_walk_finds_each_of_them(code):
    assert len(find_all({"new.py": code})) >= 1


@pytest.mark.parametrize(
    "code",
    [
        "raise InputError('x')",
        "class OwnError(InputError):\n    pass\nclass Further(OwnError):\n    pass\nraise Further('x')",
        "def f() -> InputError:\n    return InputError('x')\nraise f()",
        "try:\n    f()\nexcept InputError as error:\n    kept = error\nraise kept or NotDeterminedError('x')",
        "def f(refused: list[NotDeterminedError]):\n    raise refused[0]",
        "try:\n    raise ValueError\nexcept ValueError:\n    pass",
        "try:\n    f()\nexcept BaseException:\n    raise",
    ],
)
def test_the_walk_leaves_what_is_right(code):
    assert find_all({"new.py": code}) == []


@pytest.mark.parametrize("path", sorted(SOURCES))
def test_an_error_that_names_its_file_says_so_by_its_class(path):
    """A command puts the names of its files before an InputError, and a FileError has them already."""
    named = [
        f"line {node.lineno}: {ast.unparse(each.value)}"
        for node in ast.walk(ast.parse(SOURCES[path]))
        if isinstance(node, ast.Call) and name_of(node) == "InputError"
        for each in ast.walk(node)
        if isinstance(each, ast.FormattedValue) and ast.unparse(each.value).split(".")[-1] in ("path", "file")
    ]
    assert named == []
