"""Benchmarks and examples as modules: they are scripts, no part of the package."""

import importlib.util
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def script(path):
    """The module of a script such as "benchmarks/worlds.py", which finds those beside it as when it is run."""
    file = ROOT / path
    spec = importlib.util.spec_from_file_location(".".join(Path(path).with_suffix("").parts), file)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(file.parent))
    # tests/adversary has a `worlds`, too: a script takes those beside it
    beside = {each.stem for each in file.parent.glob("*.py")}
    others = {name: sys.modules.pop(name) for name in beside & set(sys.modules) if not _lies_in(file.parent, name)}
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(file.parent))
        sys.modules.update(others)
    return module


def _lies_in(folder, name):
    return Path(getattr(sys.modules[name], "__file__", None) or "").parent == folder
