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
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(file.parent))
    return module
