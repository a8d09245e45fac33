"""Matrices of a finite-element code (npz, Matrix Market, MATLAB), names of degrees of freedom -> `AffineStructure`."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from opid.errors import InputError, nearest
from opid.signals.files import written_whole
from opid.updating.structure import AffineStructure
from opid.updating.study_checks import structure_faults

Source = str | os.PathLike[str]

PART = "part_"
"""What the name of a matrix begins with that a parameter multiplies: part_E_steel for E_steel."""
NAMES = ("dofs", "sensors", "joints")
"""What a file may hold beside matrices."""
PIECES = ("data", "indices", "indptr")
"""Of a sparse matrix in npz, row by row as scipy has them: mass_data, mass_indices, mass_indptr."""


def read_structure(
    matrices: Source | Mapping[str, Source],
    *,
    sensors: Sequence[str] | None = None,
    joints: Mapping[str, Sequence[str]] | None = None,
    dofs: Source | Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
) -> AffineStructure:
    """Read the matrices of a structure, K = stiffness + sum theta_NAME part_NAME, in SI units.

    One file holds all of them: npz (each matrix dense, or sparse in the three pieces of `PIECES`) or MATLAB up to
    version 7 (full or sparse). Or each has its file: Matrix Market (.mtx, .mtx.gz), scipy's sparse .npz, or .npy. The
    names are `mass`, `stiffness` (of what is not updated; none where there is none) and `part_NAME` for each parameter.
    A file may also hold `dofs` (n_dof), `sensors` (n_sensors) and `joints` (n_joints, 3: name, one end, other end) as
    text. Nothing is unpickled.

    Args:
        matrices: the file, or a file for each matrix by its name.
        sensors: names of the degrees of freedom that are measured; those in the file where left out.
        joints: the two ends of each nonlinear joint, by its name; those in the file where left out.
        dofs: names of the degrees of freedom, or a text file with one a line, or a CSV file: its column "dof", or all
            its columns joined by a space ("12 UX"). Where left out those in the file, or else "1", "2", ...
        parameters: names of the parts that are updated; the others join the stiffness as they are. All where left out.

    Raises:
        InputError: a file that is missing, damaged, or of another format; a matrix that is missing, not symmetric, not
            positive or of the wrong size; sensors or joints that are no degrees of freedom; an unknown parameter.
    """
    found = _read_each(matrices) if isinstance(matrices, Mapping) else _read_one(Path(matrices))
    where = "the matrices" if isinstance(matrices, Mapping) else str(matrices)
    unknown = [name for name in found if name not in ("mass", "stiffness", *NAMES) and not name.startswith(PART)]
    if "mass" not in found:
        held = [name for name in found if name not in NAMES]
        hint = nearest("mass", held) if held else "there is no matrix in it"
        raise InputError(f"{where}: there is no matrix 'mass': {hint}")
    if unknown:
        raise InputError(
            f"{where}: {unknown[0]!r} is no matrix that is known: {nearest(unknown[0], _known(found))}; a matrix that "
            f"a parameter multiplies is called {PART}NAME"
        )
    mass = _matrix(where, "mass", found["mass"])
    parts = {name[len(PART) :]: _matrix(where, name, value) for name, value in found.items() if name.startswith(PART)}
    stiffness = _matrix(where, "stiffness", found["stiffness"]) if "stiffness" in found else None
    if stiffness is None and not parts:
        raise InputError(f"{where}: there is neither a matrix 'stiffness' nor a {PART}NAME: give at least one of them")
    _check_sizes(where, mass, {"stiffness": stiffness, **{PART + name: part for name, part in parts.items()}})
    stiffness = sparse.csr_matrix(mass.shape) if stiffness is None else stiffness
    parts, fixed = _chosen(where, parts, parameters)
    structure = AffineStructure(
        mass,
        sum(fixed, stiffness),
        parts,
        _dof_names(where, dofs if dofs is not None else found.get("dofs"), mass.shape[0]),
        _texts(where, "sensors", sensors if sensors is not None else found.get("sensors", ())),
        _joint_ends(where, joints if joints is not None else found.get("joints", {})),
    )
    for fault in structure_faults(structure):
        raise InputError(f"{where}: {fault}")
    return structure


def write_structure(path: Source, structure: AffineStructure) -> None:
    """Write a structure to an npz file that `read_structure` reads: sparse matrices, names, sensors, joints.

    Args:
        path: of the file; its ending should be .npz.
        structure: to write.

    Raises:
        InputError: the file cannot be written.
    """
    matrices = {"mass": structure.mass, "stiffness": structure.stiffness}
    matrices |= {PART + name: part for name, part in structure.parts.items()}
    arrays = {f"{name}_{piece}": getattr(matrix, piece) for name, matrix in matrices.items() for piece in PIECES}
    arrays["dofs"] = np.array(structure.dofs, dtype=np.str_)
    arrays["sensors"] = np.array(structure.sensors, dtype=np.str_)
    ends = [(name, *pair) for name, pair in structure.joints.items()]
    arrays["joints"] = np.array(ends, dtype=np.str_).reshape(len(ends), 3)
    with written_whole(path, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)


def _read_one(path: Path) -> dict[str, Any]:
    """Everything that a npz or MATLAB file holds, by name."""
    kind = path.suffix.lower()
    if kind == ".npz":
        return _joined(path, _opened(path, _npz))
    if kind == ".mat":
        return _opened(path, _matlab)
    if path.name.lower().endswith((".mtx", ".mtx.gz")):
        raise InputError(f'{path} holds one matrix: give a file for each, {{"mass": ..., "stiffness": ...}}')
    raise InputError(f"{path} is of no format that is known: give .npz, .mat, or .mtx for each matrix")


def _read_each(files: Mapping[str, Source]) -> dict[str, Any]:
    """One matrix from each file."""
    found = {}
    for name, file in files.items():
        path, kind = Path(file), Path(file).suffix.lower()
        if path.name.lower().endswith((".mtx", ".mtx.gz")):
            found[name] = _opened(path, _market)
        elif kind == ".npz":
            found[name] = _opened(path, _sparse_npz)
        elif kind == ".npy":
            found[name] = _opened(path, lambda each: np.load(each, allow_pickle=False))
        else:
            raise InputError(f"{path} is of no format that is known for a matrix: give .mtx, .mtx.gz, .npz or .npy")
    return found


def _opened(path: Path, read: Callable[[Path], Any]) -> Any:
    """What a reader makes of a file, its complaints in a sentence."""
    import zipfile
    import zlib

    if not path.is_file():
        raise InputError(f"there is no file {path}: check the name and the folder")
    try:
        return read(path)
    except NotImplementedError:
        raise InputError(f"{path} is a MATLAB file of version 7.3: save it with '-v7'") from None
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error, IndexError) as error:
        if "allow_pickle" in str(error):
            raise InputError(
                f"{path} holds pickled objects, which are never opened: save names as text, np.array(names, dtype=str)"
            ) from None
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path} cannot be read ({reason}): export it again") from None


def _npz(path: Path) -> dict[str, Any]:
    # opened here, for numpy leaves a damaged file open
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _sparse_npz(path: Path) -> Any:
    with path.open("rb") as file:
        return sparse.load_npz(file)


def _market(path: Path) -> Any:
    from scipy.io import mmread

    return mmread(path)


def _matlab(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    return {name: value for name, value in loadmat(path, appendmat=False).items() if not name.startswith("__")}


def _joined(path: Path, arrays: dict[str, Any]) -> dict[str, Any]:
    """Arrays of a npz file with the pieces of sparse matrices put together."""
    found = dict(arrays)
    for key in arrays:
        name = key.removesuffix("_indptr")
        if name == key:
            continue
        missing = [piece for piece in PIECES if f"{name}_{piece}" not in arrays]
        if missing:
            raise InputError(f"{path}: the sparse matrix {name!r} lacks {name}_{missing[0]}: store all of {PIECES}")
        data, indices, indptr = (np.ravel(found.pop(f"{name}_{piece}")) for piece in PIECES)
        size = len(indptr) - 1
        try:
            matrix = sparse.csr_matrix((data, indices, indptr), shape=(size, size))
            matrix.check_format(full_check=True)
        except ValueError as error:
            raise InputError(f"{path}: the pieces of {name!r} are no sparse matrix ({error}): store it again") from None
        found[name] = matrix
    return found


def _matrix(where: str, name: str, value: Any) -> sparse.csr_matrix:
    """One matrix, real and of two dimensions."""
    if not sparse.issparse(value):
        value = np.asarray(value)
        if value.dtype.kind not in "iuf":
            raise InputError(f"{where}: {name!r} holds no real numbers (type {value.dtype}): give a real matrix")
    elif value.dtype.kind not in "iuf":
        raise InputError(f"{where}: {name!r} holds no real numbers (type {value.dtype}): give a real matrix")
    if value.ndim != 2 or value.shape[0] != value.shape[1] or not value.shape[0]:
        raise InputError(f"{where}: {name!r} has shape {value.shape}: give a square matrix")
    return sparse.csr_matrix(value, dtype=np.float64)


def _check_sizes(where: str, mass: sparse.csr_matrix, others: Mapping[str, sparse.csr_matrix | None]) -> None:
    for name, matrix in others.items():
        if matrix is not None and matrix.shape != mass.shape:
            raise InputError(
                f"{where}: {name!r} has shape {matrix.shape} and 'mass' {mass.shape}: export both for the same degrees "
                "of freedom"
            )


def _chosen(
    where: str, parts: dict[str, sparse.csr_matrix], parameters: Sequence[str] | None
) -> tuple[dict[str, sparse.csr_matrix], list[sparse.csr_matrix]]:
    """Parts that are updated, in the order asked for, and those that are not."""
    if parameters is None:
        return parts, []
    for name in parameters:
        if name not in parts:
            hint = nearest(name, parts) if parts else "there is none at all"
            raise InputError(f"{where}: there is no matrix {PART + name!r} for the parameter {name!r}: {hint}")
    return {name: parts[name] for name in parameters}, [part for name, part in parts.items() if name not in parameters]


def _known(found: Mapping[str, Any]) -> list[str]:
    return ["mass", "stiffness", *NAMES, *(name for name in found if name.startswith(PART))]


def _dof_names(where: str, given: Any, n_dof: int) -> tuple[str, ...]:
    """Names of the degrees of freedom from a list, a file, or by number."""
    if given is None:
        return tuple(str(place) for place in range(1, n_dof + 1))
    if isinstance(given, str | os.PathLike):
        where = str(given)
        names = _label_lines(Path(given), n_dof)
    else:
        names = _texts(where, "dofs", given)
    if len(names) != n_dof:
        raise InputError(
            f"{where} names {len(names)} degrees of freedom, the matrices have {n_dof}: give one name for each row"
        )
    return names


def _label_lines(path: Path, n_dof: int) -> tuple[str, ...]:
    """Labels of a text or CSV file; a first line too many is a header."""
    if not path.is_file():
        raise InputError(f"there is no file {path}: check the name and the folder")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as text ({error}): save the labels as UTF-8") from None
    if path.suffix.lower() != ".csv":
        return tuple(line.strip() for line in text.splitlines() if line.strip())
    rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines()) if any(map(str.strip, row))]
    header = [cell.lower() for cell in rows[0]] if rows else []
    column = header.index("dof") if "dof" in header else None
    if column is not None or len(rows) == n_dof + 1:
        rows = rows[1:]
    if column is not None and any(len(row) <= column for row in rows):
        raise InputError(f"{path} has lines without the column 'dof': give every line all columns")
    return tuple(" ".join(row) if column is None else row[column] for row in rows)


def _texts(where: str, name: str, given: Any) -> tuple[str, ...]:
    """Text of a list, a numpy array, or a MATLAB cell array or character matrix; numbers become text."""
    if isinstance(given, str):
        raise InputError(f"{where}: {name} is the text {given!r}: give a list of names")
    cells = [cell for entry in np.ravel(np.asarray(given)) for cell in np.ravel(np.asarray(entry))]
    for cell in cells:
        if not isinstance(cell, str | int | np.integer | float) or cell != cell:
            raise InputError(f"{where}: {name} holds {cell!r}: give names")
    return tuple((f"{cell:g}" if isinstance(cell, float) else str(cell)).strip() for cell in cells)


def _joint_ends(where: str, given: Any) -> dict[str, tuple[str, str]]:
    """Joints by name from a table or from rows of name, one end, other end."""
    if isinstance(given, Mapping):
        rows = [(name, *((ends,) if isinstance(ends, str) else ends)) for name, ends in given.items()]
    else:
        texts = _texts(where, "joints", given)
        width = np.shape(given)[-1] if texts else 3
        rows = [texts[start : start + width] for start in range(0, len(texts), width)]
    for row in rows:
        if len(row) != 3:
            raise InputError(f"{where}: the joint {row[0]!r} lies between {list(row[1:])}: name two degrees of freedom")
    names = [str(row[0]) for row in rows]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{where}: the joint {name!r} stands twice: give each a name of its own")
    return {str(name): (str(one), str(other)) for name, one, other in rows}
