"""Run notebooks and store them with their outputs: `python docs/notebooks.py`, or with the names of some of them.

What differs between two runs that find the same is left out: counts, times, addresses, temporary folders, stderr. The
hash of the code that gave the outputs is kept, so that a test sees where code was changed and not run again.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from base64 import b64decode, b64encode
from collections.abc import Iterable
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent.parent / "notebooks"
N_COLOURS = 48
NOISE = re.compile(rf"(?<= at )0x[0-9a-f]+|{re.escape(tempfile.gettempdir())}/\w+")


def store(path: Path) -> None:
    """Run a notebook where it stands and write it with its outputs."""
    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": path.parent}}
    NotebookClient(notebook, timeout=None, record_timing=False, coalesce_streams=True, resources=place).execute()
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = [_quiet(each) for each in cell.outputs if each.get("name") != "stderr"]
    notebook.metadata = {
        "kernelspec": notebook.metadata.kernelspec,
        "language_info": {"name": "python"},
        "opid": {"code_sha256": hash_of_code(cell.source for cell in notebook.cells if cell.cell_type == "code")},
    }
    nbformat.write(notebook, path)


def hash_of_code(cells: Iterable[str]) -> str:
    """The SHA-256 of the code of a notebook, cell by cell."""
    return sha256("\0".join(cells).encode()).hexdigest()


def _quiet(output: Any) -> Any:
    """An output as another run would have it."""
    if "text" in output:
        output.text = NOISE.sub("...", output.text)
        return output
    if "execution_count" in output:
        output.execution_count = None
    kinds = output.data
    if "image/png" in kinds:
        kinds["image/png"] = _smaller(kinds["image/png"])
        kinds.pop("text/plain", None)  # the size of the figure
    if "text/plain" in kinds:
        kinds["text/plain"] = NOISE.sub("...", kinds["text/plain"])
    output.metadata = {}
    return output


def _smaller(picture: str) -> str:
    """A figure in base64 with few colours: a quarter of the size, and the eye sees no difference."""
    small = BytesIO()
    image = Image.open(BytesIO(b64decode(picture))).convert("RGB")
    image.quantize(N_COLOURS, dither=Image.Dither.NONE).save(small, "PNG", optimize=True)
    return b64encode(small.getvalue()).decode()


def main(names: list[str]) -> None:
    """Run the notebooks with these names, or all."""
    os.environ.pop("MPLBACKEND", None)  # figures go into the notebook
    for path in sorted(FOLDER.glob("*.ipynb")):
        if not names or path.stem in names:
            print(path.name, file=sys.stderr)  # noqa: T201
            store(path)


if __name__ == "__main__":
    main(sys.argv[1:])
