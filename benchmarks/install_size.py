"""Size of opid with what it needs, alone and with the extra `all`, each in a fresh environment.

    python benchmarks/install_size.py

Sums of file sizes in site-packages, MB of 1e6 bytes, without pip itself; pip downloads what is needed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parent.parent
LARGEST = 8


def main() -> None:
    """Print one table for each choice of extras."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--no-compile", action="store_true", help="without bytecode, as pip's option")
    options = ["--no-compile"] if parser.parse_args().no_compile else []
    for extras in ("", "[all]"):
        sizes = install(f"{ROOT}{extras}", options)
        largest = sorted(sizes, key=lambda name: -sizes[name])[:LARGEST]
        print(f"opid{extras}: {sum(sizes.values()) / 1e6:.0f} MB")
        print("".join(f"  {name:20} {sizes[name] / 1e6:6.0f} MB\n" for name in largest))


def install(what: str, options: list[str]) -> dict[str, int]:
    """Return the bytes of each entry of the site-packages of an environment with this alone."""
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        (python,) = [path for path in Path(folder).glob("*/python*") if path.stem == "python"]
        subprocess.run([python, "-m", "pip", "install", "--quiet", *options, what], check=True)
        (site,) = Path(folder).rglob("site-packages")
        entries = [each for each in site.iterdir() if not each.name.startswith("pip")]
        return {each.name: size(each) for each in entries}


def size(path: Path) -> int:
    """Return the bytes of a file, or of all files below a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(each.lstat().st_size for each in files if each.is_file())


if __name__ == "__main__":
    main()
