"""The matrices of virtual backbones in the files of other finite-element codes."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from opid.signals.files import written_whole
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import PART


def replace_matrices(structure: AffineStructure, directory: Path, kind: Literal["mat", "mtx"]) -> None:
    """Put matrices of another kind in the place of structure.npz, as another finite-element code would give them.

    Args:
        structure: of the study that was written.
        directory: of its study.toml.
        kind: "mat" for structure.mat of MATLAB, "mtx" for a Matrix Market file of each matrix and dofs.txt.
    """
    from scipy.io import mmwrite, savemat

    found = {"mass": structure.mass, "stiffness": structure.stiffness}
    found |= {f"{PART}{name}": part for name, part in structure.parts.items()}
    if kind == "mat":
        named = {name: matrix.tocsc() for name, matrix in found.items()}
        with written_whole(directory / "structure.mat", "wb") as file:
            # a cell array, which MATLAB has for texts of several lengths
            savemat(file, {**named, "dofs": np.array(structure.dofs, dtype=object)}, do_compression=True)
        given = 'matrices = "structure.mat"'
    else:
        for name, matrix in found.items():
            with written_whole(directory / f"{name}.mtx", "wb") as file:
                mmwrite(file, matrix)
        with written_whole(directory / "dofs.txt") as file:
            file.write("".join(f"{name}\n" for name in structure.dofs))
        files = ", ".join(f'{name} = "{name}.mtx"' for name in found)
        given = f'matrices = {{ {files} }}\ndofs = "dofs.txt"'
    path = directory / "study.toml"
    text = path.read_text(encoding="utf-8").replace('matrices = "structure.npz"', given, 1)
    with written_whole(path) as file:
        file.write(text)
    (directory / "structure.npz").unlink()
