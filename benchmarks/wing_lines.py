"""Lines of the suspensions wing by room, and of the tests that belong to it: all lines of the files.

Run `python benchmarks/wing_lines.py`. A test or a helper of tests belongs to the wing if it imports modules of it, and
fewer of the other wings; one of a plot, a report or a command belongs to that.
"""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

from harness import table_head, table_row

ROOT = Path(__file__).parent.parent
WING = ROOT / "opid" / "suspensions"
FRONT = ("plots", "plot", "report", "cli")


def n_lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def n_code_lines(path: Path) -> int:
    """Lines that are neither blank, nor a comment, nor a docstring."""
    text = path.read_text(encoding="utf-8")
    prose: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            for each in body:
                if (
                    isinstance(each, ast.Expr)
                    and isinstance(each.value, ast.Constant)
                    and isinstance(each.value.value, str)
                ):
                    prose |= set(range(each.lineno, (each.end_lineno or each.lineno) + 1))
    lines = enumerate(text.splitlines(), start=1)
    return sum(bool(line.strip()) and not line.strip().startswith("#") and k not in prose for k, line in lines)


def rooms_of(path: Path) -> set[str]:
    """Return the modules of opid that a file imports, e.g. "suspensions.fitting.fit"."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [each.name for each in node.names] if isinstance(node, ast.Import) else []
        found |= {name.removeprefix("opid.") for name in names if name.startswith("opid.")}
    return found


def is_of_the_wing(path: Path) -> bool:
    """Whether a test tests this wing and no picture, page or command."""
    rooms = Counter(name.split(".")[0] for name in rooms_of(path))
    in_front = any(rooms[room] for room in FRONT) or path.name.startswith(tuple(f"test_{room}" for room in FRONT))
    return not in_front and rooms["suspensions"] > rooms["modal"] + rooms["updating"]


def rooms(base: Path) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in sorted(base.rglob("*.py")):
        room = "/".join(path.relative_to(base).parts[:-1]) or "(top)"
        found.setdefault(room, []).append(path)
    return found


def main() -> None:
    print(table_head("room of opid/suspensions", "files", "lines", "of them code"))
    total: Counter[str] = Counter()
    for room, paths in rooms(WING).items():
        counts = Counter(files=len(paths), lines=sum(map(n_lines, paths)), code=sum(map(n_code_lines, paths)))
        total += counts
        print(table_row(room, *counts.values()))
    print(table_row("together", *total.values()))
    tests = [path for path in sorted((ROOT / "tests").rglob("*.py")) if is_of_the_wing(path)]
    print(f"\n{len(tests)} test files of the wing, {sum(map(n_lines, tests))} lines, of them code ", end="")
    print(f"{sum(map(n_code_lines, tests))}:")
    for path in tests:
        print(f"- {path.relative_to(ROOT / 'tests')}: {n_lines(path)}")
    others = [path for path in sorted((ROOT / "tests").rglob("*.py")) if path not in tests]
    others = [path for path in others if any(name.startswith("suspensions") for name in rooms_of(path))]
    print(f"\n{len(others)} other test files import it too, {sum(map(n_lines, others))} lines: ", end="")
    print(", ".join(path.name for path in others))


if __name__ == "__main__":
    main()
