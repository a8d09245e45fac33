"""What is true of virtual backbones, and their matrices in the files of other finite-element codes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from opid.mechanics.laws.law import Law
from opid.signals.files import written_whole
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import PART
from opid.virtual.files.truth import TruthKind


def _check(truth: dict[str, Any]) -> None:
    for name in ("linear", "law"):
        truth[name] = {str(key): float(value) for key, value in truth[name].items()}


UPDATING_TRUTH = TruthKind("opid.updating-truth/1", "simulated backbones", "opid simulate backbones", _check)


def updating_truth(
    law: Law, linear: Mapping[str, float], *, structure: str = "", settings: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return what is true of virtual backbones.

    Args:
        law: of the joints, a sum of springs with one coefficient each.
        linear: true factors of the linear structure by name.
        structure: what was tested, in one sentence.
        settings: what it was simulated with, kept as they are.

    Returns:
        `schema`, `structure`, `linear` {name: factor}, `law` {kind: coefficient in SI units}, `settings`.
    """
    return UPDATING_TRUTH.content(
        settings, structure=structure, linear=dict(linear), law={term.name: term.amplitude for term in law.terms}
    )


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
