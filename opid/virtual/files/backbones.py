"""Virtual backbones on disk: matrices, one CSV file a curve, the study that names them, and the truth behind them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from opid.json_values import json_text, plain
from opid.mechanics.laws.law import Law
from opid.signals.directory import made_directory
from opid.signals.files import written_whole
from opid.studies.study_file import write_study
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.matrices_file import PART
from opid.updating.study import UpdatingStudy
from opid.virtual.files.truth import read_truth_file

TRUTH_SCHEMA = "opid.updating-truth/1"


def updating_truth_json(
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
    return plain(
        {
            "schema": TRUTH_SCHEMA,
            "structure": structure,
            "linear": dict(linear),
            "law": {term.name: term.amplitude for term in law.terms},
            "settings": dict(settings or {}),
        }
    )


def write_updating_field_test(
    study: UpdatingStudy,
    directory: str | os.PathLike[str],
    *,
    truth: Mapping[str, Any],
    matrices: Literal["npz", "mat", "mtx"] = "npz",
) -> Path:
    """Write matrices, backbones, study.toml and truth.json, and return the path of the study.

    Args:
        study: what was measured, and the classes to compare.
        directory: made if it is not there.
        truth: of `updating_truth_json`.
        matrices: "npz" for structure.npz, "mat" for structure.mat of MATLAB, "mtx" for a Matrix Market file of each
            matrix and dofs.txt.

    Raises:
        InputError: a place that cannot be written to, or what `write_study` refuses.
    """
    target = made_directory(directory)
    write_study(study, target / "study.toml")
    if matrices != "npz" and isinstance(study.structure, AffineStructure):
        _in_other_files(study.structure, target, matrices)
    with written_whole(target / "truth.json") as file:
        file.write(json_text(truth))
    return target / "study.toml"


def read_updating_truth(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the truth.json of simulated backbones.

    Args:
        path: the file.

    Raises:
        InputError: no such file, or none of `opid simulate backbones`' making.
    """

    def check(truth: dict[str, Any]) -> None:
        for name in ("linear", "law"):
            truth[name] = {str(key): float(value) for key, value in truth[name].items()}

    return read_truth_file(
        path, schema=TRUTH_SCHEMA, what="simulated backbones", command="opid simulate backbones", check=check
    )


def _in_other_files(structure: AffineStructure, directory: Path, kind: str) -> None:
    """Put matrices of another kind in the place of structure.npz, as another finite-element code would give them."""
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
