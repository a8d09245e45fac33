"""An `AffineStructure` from matrices of a finite-element code and names.

The files are npz, Matrix Market, MATLAB or Harwell-Boeing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from opid.errors import FileError, InputError, count_repeats, list_names, nearest, refuse
from opid.provenance import read_content
from opid.signals.files import read_table, read_text, write_whole
from opid.signals.logs.apart import ReadingEndedError, read_apart
from opid.signals.logs.archives import read_archive, read_array, require_memory
from opid.updating.structure.affine import AffineStructure, matrix_faults, name_faults, structure_faults

Source = str | os.PathLike[str]

PART = "part_"  # prefix of the name of a matrix that a parameter multiplies: part_E_steel for E_steel
MARKET = (".mtx", ".mtx.gz")
BOEING = (".hb", ".rsa", ".rua")
_MOST_ENDS = 8  # cells of a row of joints, which has two or three
_MOST_NAMES = 1_000_000  # more than a structure of matrices that are solved here has
NAMES = ("dofs", "sensors", "joints")  # arrays that a file may hold beside matrices
PIECES = ("data", "indices", "indptr")  # arrays of a sparse matrix in npz, by rows as in scipy
_SPARSE = {
    "csr": (sparse.csr_matrix, PIECES),
    "csc": (sparse.csc_matrix, PIECES),
    "bsr": (sparse.bsr_matrix, PIECES),
    "coo": (sparse.coo_matrix, ("data", "row", "col")),
    "dia": (sparse.dia_matrix, ("data", "offsets")),
}
_BYTES = 8  # of a number
_HB_WIDTH, _HB_COUNTS = 14, (14, 28, 42)  # rows, columns and entries in the third line of a Harwell-Boeing file


def read_structure(
    matrices: Source | Mapping[str, Source],
    *,
    sensors: Sequence[str] | None = None,
    joints: Mapping[str, Sequence[str]] | None = None,
    dofs: Source | Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
) -> AffineStructure:
    """Read the matrices of a structure, K = stiffness + sum theta_NAME part_NAME, in SI units.

    One file holds all of them: npz (each matrix dense, or sparse in the three arrays of `PIECES`) or MATLAB up to
    version 7 (full or sparse). Or each has its file: Matrix Market (.mtx, .mtx.gz), Harwell-Boeing (.hb, .rsa, .rua),
    scipy's sparse .npz, or .npy. The names are `mass`, `stiffness` (of the parts that are not updated, if any) and
    `part_NAME` for each parameter. A file may also hold `dofs` (n_dof), `sensors` (n_sensors) and `joints` (n_joints,
    3: name, one end, other end) as text; the other end of a joint to the ground is empty. Nothing is unpickled.

    Args:
        matrices: the file, or a file for each matrix by its name.
        sensors: names of the degrees of freedom that are measured; those in the file where left out.
        joints: the two ends of each nonlinear joint, or the only one of a joint to the ground, by its name; those in
            the file where left out.
        dofs: names of the degrees of freedom, or a text file with one name on each line, or a CSV file: its column
            "dof", or all its columns joined by a space ("12 UX"). Where left out, those in the file, or "1", "2", ...
        parameters: names of the parts that are updated; the others join the stiffness as they are. All where left out.

    Raises:
        InputError: a file that is missing, damaged, or of another format; a matrix that is missing, not symmetric, not
            positive or of the wrong size; sensors or joints that are not degrees of freedom; an unknown parameter.
    """
    structure, faults = checked_structure(matrices, sensors=sensors, joints=joints, dofs=dofs, parameters=parameters)
    several = list_names(dict.fromkeys(map(str, matrices.values()))) if isinstance(matrices, Mapping) else ""
    where = f"the matrices {several}" if several else str(matrices)
    # Clauses on a file as a whole name the file themselves.
    refuse(faults, None if any(where in fault for fault in faults) else Path(where))
    assert structure is not None  # otherwise it would have been refused
    return structure


def checked_structure(
    matrices: Source | Mapping[str, Source],
    *,
    sensors: Sequence[str] | None = None,
    joints: Mapping[str, Sequence[str]] | None = None,
    dofs: Source | Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
) -> tuple[AffineStructure | None, list[str]]:
    """Return the structure that `read_structure` reads, or None, and everything that is wrong with it, one clause each.

    Args:
        matrices: the file, or a file for each matrix; it and `sensors`, `joints`, `dofs` and `parameters` are those of
            `read_structure`.
    """
    faults: list[str] = []
    found = (
        _read_each(matrices, faults) if isinstance(matrices, Mapping) else _try_to(faults, _read_one, Path(matrices))
    )
    if found is None:
        return None, faults
    faults += _find_missing(found, unread=bool(faults))
    read = {
        name: _try_to(faults, _to_matrix, name, value)
        for name, value in found.items()
        if name in ("mass", "stiffness") or name.startswith(PART)
    }
    whole = {name: matrix for name, matrix in read.items() if matrix is not None}
    parts = {name.removeprefix(PART): matrix for name, matrix in whole.items() if name.startswith(PART)}
    # The names of parts that cannot be read count here, too.
    held = [name.removeprefix(PART) for name in found if name.startswith(PART)]
    for name in parameters or ():
        if name not in held:
            hint = nearest(name, held) if held else f"the files have no matrix {PART}NAME"
            faults.append(f"there is no matrix {PART + name!r} for the parameter {name!r}: {hint}")
    n_dof = whole["mass"].shape[0] if "mass" in whole else None
    names = _try_to(faults, _read_dof_names, dofs if dofs is not None else found.get("dofs"), n_dof)
    seen = _try_to(faults, _to_texts, "sensors", sensors if sensors is not None else found.get("sensors", ()))
    ends = _try_to(faults, _read_joint_ends, joints if joints is not None else found.get("joints", {}))
    for name, matrix in whole.items():
        size = matrix.shape[0]
        if size != (n_dof or size):
            shapes = f"{name!r} has shape {matrix.shape} and 'mass' {whole['mass'].shape}"
            faults.append(f"{shapes}: export both for the same degrees of freedom")
        label = f"stiffness part {name.removeprefix(PART)!r}" if name.startswith(PART) else name
        faults += matrix_faults(label, matrix, names if names and len(names) == size else _number_dofs(size))
    if names:
        wrong = name_faults(names, names[:1] if seen is None else seen, ends or {})
        faults += [f"with the names of {dofs}, {fault}" for fault in wrong] if _is_file(dofs) else wrong
    if faults:
        return None, faults
    chosen = {name: parts[name] for name in (parts if parameters is None else parameters)}
    fixed = [part for name, part in parts.items() if name not in chosen]
    stiffness = sum(fixed, whole.get("stiffness", sparse.csr_matrix(whole["mass"].shape)))
    structure = AffineStructure(whole["mass"], stiffness, chosen, names, seen, ends)
    faults += structure_faults(structure)
    return (None if faults else structure), faults


def write_structure(path: Source, structure: AffineStructure) -> None:
    """Write a structure to an npz file that `read_structure` reads: sparse matrices, names, sensors, joints.

    Args:
        path: path of the file; its ending should be .npz.
        structure: the structure to write.

    Raises:
        InputError: the file cannot be written.
    """
    matrices = {"mass": structure.mass, "stiffness": structure.stiffness}
    matrices |= {PART + name: part for name, part in structure.parts.items()}
    arrays = {f"{name}_{piece}": getattr(matrix, piece) for name, matrix in matrices.items() for piece in PIECES}
    arrays["dofs"] = np.array(structure.dofs, dtype=np.str_)
    arrays["sensors"] = np.array(structure.sensors, dtype=np.str_)
    ends = [(name, *own, *[""] * (2 - len(own))) for name, own in structure.joints.items()]
    arrays["joints"] = np.array(ends, dtype=np.str_).reshape(len(ends), 3)
    with write_whole(path, "wb") as file:
        np.savez_compressed(file, **arrays)


def _read_one(path: Path) -> dict[str, Any]:
    if path.name.lower().endswith((*MARKET, *BOEING)):
        raise FileError(f'{path} holds one matrix: give a file for each, {{"mass": ..., "stiffness": ...}}')
    kind = path.suffix.lower()
    if kind not in (".npz", ".mat"):
        raise FileError(f"{path} has an unknown format: give .npz, .mat, or .mtx for each matrix")
    if kind == ".npz":
        return _join_arrays(path, _open_file(path, _read_npz))
    return _open_file(path, partial(_read_by_library, _read_matlab))


def _read_each(files: Mapping[str, Source], faults: list[str]) -> dict[str, Any]:
    found = {name: _try_to(faults, _read_matrix_file, Path(file)) for name, file in files.items()}
    return {name: matrix for name, matrix in found.items() if matrix is not None}


def _read_matrix_file(path: Path) -> Any:
    readers: dict[str, Callable[[Path], Any]] = {
        **dict.fromkeys(MARKET, partial(_read_by_library, _read_market)),
        **dict.fromkeys(BOEING, partial(_read_by_library, _read_harwell_boeing)),
        ".npz": _read_sparse_npz,
        ".npy": read_array,
    }
    for ending, read in readers.items():
        if path.name.lower().endswith(ending):
            return _open_file(path, read)
    raise FileError(f"{path} has an unknown format for a matrix: give .mtx, .mtx.gz, .hb, .npz or .npy")


def _try_to(faults: list[str], make: Callable[..., Any], *given: Any) -> Any:
    """Return `make(*given)`; None, with its error added to the faults, where it raises an InputError."""
    try:
        return make(*given)
    except InputError as error:
        faults.append(str(error))
        return None


def _open_file(path: Path, read: Callable[[Path], Any]) -> Any:
    import zlib

    if not os.path.isfile(path):
        raise FileError(f"there is no file {path}: check the name and the folder")
    try:
        return read(path)
    except InputError as error:
        raise FileError(f"{path}: {error}") from None
    except MemoryError:
        raise FileError(f"{path} needs more memory than there is: reduce the structure") from None
    except (OSError, ValueError, TypeError, KeyError, EOFError, OverflowError, zlib.error, IndexError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileError(f"{path} cannot be read ({reason}): export it again") from None


def _read_by_library(reader: Callable[[Path], Any], path: Path) -> Any:
    """Return what a reader makes of a file in a process of its own: a damaged file can end scipy's parsers, and it."""
    try:
        return read_apart(f"{reader.__module__}:{reader.__name__}", path)
    except (ReadingEndedError, RuntimeError) as error:
        raise ValueError(str(error)) from None


def _read_npz(path: Path) -> dict[str, Any]:
    return read_archive(path).require_plain_arrays()


def _read_sparse_npz(path: Path) -> Any:
    """Return the matrix that `scipy.sparse.save_npz` wrote."""
    arrays = _read_npz(path)
    kind = arrays["format"].item() if "format" in arrays else b""
    kind = kind.decode() if isinstance(kind, bytes) else kind
    if kind not in _SPARSE:
        raise InputError("it holds no sparse matrix: write it with scipy.sparse.save_npz")
    names = _SPARSE[kind][1]
    missing = [name for name in (*names, "shape") if name not in arrays]
    if missing or arrays["shape"].dtype.kind not in "iu" or arrays["shape"].shape != (2,):
        lacking = f"it lacks {missing[0]}" if missing else "its shape is not two whole numbers"
        raise InputError(f"{lacking}: write it with scipy.sparse.save_npz")
    shape = tuple(arrays["shape"].tolist())
    _require_room(shape[0], shape[1], arrays["data"].size)
    try:
        return _make_sparse(kind, {name: arrays[name] for name in names}, shape)
    except InputError as error:
        raise InputError(f"it cannot be read, its arrays {error}") from None


def _read_market(path: Path) -> Any:
    """Return the matrix of a Matrix Market file, whose header must fit into the memory."""
    from scipy.io import mminfo, mmread

    n_rows, n_columns, n_entries, kind, *_ = mminfo(path)
    # The number of entries of a full matrix is a product, which wraps around in 64 bits.
    _require_room(n_rows, n_columns, n_rows * n_columns if kind == "array" else n_entries)
    return mmread(path)


def _require_room(n_rows: int, n_columns: int, n_entries: int) -> None:
    """Refuse a matrix that does not fit into the memory: three numbers an entry, and a pointer for each row."""
    require_memory(_BYTES * (3 * n_entries + max(n_rows, n_columns) + 1))


def _read_harwell_boeing(path: Path) -> Any:
    """Return the matrix of a Harwell-Boeing text file, with both triangles of a symmetric one."""
    import io

    from scipy.io import hb_read

    lines = read_content(path).decode("latin-1").splitlines()
    kind = lines[2][:3].upper()
    _require_room(*(int(lines[2][start : start + _HB_WIDTH]) for start in _HB_COUNTS))
    # scipy reads matrices that are not symmetric, and exponents with an E.
    if kind == "RSA":
        lines[2] = f"RUA{lines[2][3:]}"
    body = "\n".join([lines[0], *(line.upper().replace("D", "E") for line in lines[1:])])
    matrix = sparse.csr_matrix(hb_read(io.StringIO(body + "\n")))
    return matrix + matrix.T - sparse.diags(matrix.diagonal()) if kind == "RSA" else matrix


def _read_matlab(path: Path) -> dict[str, Any]:
    from scipy.io import loadmat

    try:
        found = loadmat(path, appendmat=False)
    except NotImplementedError:
        raise InputError("it is a MATLAB file of version 7.3: save it with '-v7'") from None
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _join_arrays(path: Path, arrays: dict[str, Any]) -> dict[str, Any]:
    """Return the arrays of a npz file, with each sparse matrix made of its arrays."""
    found = dict(arrays)
    for key in arrays:
        name = key.removesuffix("_indptr")
        if name == key:
            continue
        missing = [piece for piece in PIECES if f"{name}_{piece}" not in arrays]
        if missing:
            raise FileError(f"{path}: the sparse matrix {name!r} lacks {name}_{missing[0]}: store all of {PIECES}")
        pieces = {piece: np.ravel(found.pop(f"{name}_{piece}")) for piece in PIECES}
        try:
            matrix = _make_sparse("csr", pieces, (len(pieces["indptr"]) - 1,) * 2)
        except InputError as error:
            raise FileError(f"{path}: the arrays of {name!r} {error}") from None
        found[name] = matrix
    return found


def _make_sparse(kind: str, pieces: Mapping[str, Any], shape: tuple[int, int]) -> Any:
    """Return the sparse matrix of arrays by their names, whose pointers must be whole numbers inside it."""
    data, *pointers = pieces.values()
    if data.dtype.kind not in "iuf" or any(each.dtype.kind not in "iu" for each in pointers) or min(shape) < 1:
        kinds = ", ".join(f"{name} {each.dtype}" for name, each in pieces.items())
        raise InputError(
            f"do not make a sparse matrix of the shape {shape} ({kinds}): store numbers, and whole numbers as pointers"
        )
    if "indptr" in pieces and (pieces["indptr"].ndim != 1 or (np.diff(pieces["indptr"]) < 0).any()):
        # scipy does not check pointers that end below zero
        raise InputError("do not make a sparse matrix (indptr falls): store it again")
    try:
        matrix = _SPARSE[kind][0]((data, tuple(pointers)) if kind == "coo" else (data, *pointers), shape=shape)
        if "indptr" in pieces:
            matrix.check_format(full_check=True)
    except (ValueError, TypeError, OverflowError, IndexError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"do not make a sparse matrix ({reason}): store it again") from None
    return matrix


def _to_matrix(name: str, value: Any) -> sparse.csr_matrix:
    value = value if sparse.issparse(value) else np.asarray(value)
    if value.dtype.kind not in "iuf":
        raise InputError(f"{name!r} does not hold real numbers (type {value.dtype}): give a real matrix")
    if value.ndim != 2 or value.shape[0] != value.shape[1] or not value.shape[0]:
        raise InputError(f"{name!r} has shape {value.shape}: give a square matrix")
    return sparse.csr_matrix(value, dtype=np.float64)


def _find_missing(found: Mapping[str, Any], *, unread: bool) -> Iterator[str]:
    """Yield matrices that are missing or unknown; files that could not be read (`unread`) have a clause already."""
    matrices = [name for name in found if name not in NAMES]
    of_parts = [name for name in matrices if name.startswith(PART)]
    if "mass" not in found and not unread:
        yield f"there is no matrix 'mass': {nearest('mass', matrices) if matrices else 'the file has no matrix'}"
    for name in matrices:
        if name not in ("mass", "stiffness", *of_parts):
            yield (
                f"{name!r} is not a known name of a matrix: {nearest(name, ['mass', 'stiffness', *NAMES, *of_parts])}; "
                f"a matrix that a parameter multiplies is called {PART}NAME"
            )
    if not unread and not of_parts and "stiffness" not in matrices:
        yield f"there is neither a matrix 'stiffness' nor a {PART}NAME: give at least one of them"


def _number_dofs(n_dof: int) -> tuple[str, ...]:
    return tuple(str(number) for number in range(1, n_dof + 1))


def _read_dof_names(given: Any, n_dof: int | None) -> tuple[str, ...]:
    """Return the names of the degrees of freedom from a list or a file, or their numbers."""
    if given is None:
        return _number_dofs(n_dof or 0)
    of_file = _is_file(given)
    names = _read_labels(Path(given), n_dof) if of_file else _to_texts("dofs", given)
    if n_dof is not None and len(names) != n_dof:
        raise InputError(
            f"{given if of_file else 'dofs'} names {len(names)} degrees of freedom, the matrices have {n_dof}: give "
            "one name for each row"
        )
    return names


def _is_file(given: object) -> bool:
    return isinstance(given, str | os.PathLike)


def _read_labels(path: Path, n_dof: int | None) -> tuple[str, ...]:
    """Return the labels of a text or CSV file; if it has one line too many, the first is a header."""
    if not os.path.isfile(path):
        raise FileError(f"there is no file {path}: check the name and the folder")
    try:
        if path.suffix.lower() != ".csv":
            return tuple(line.strip() for line in read_text(path).splitlines() if line.strip())
        table, _ = read_table(path, ",")
    except (OSError, InputError) as error:
        raise FileError(f"{path} cannot be read as text ({error}): save the labels as UTF-8") from None
    rows = [row for row in table if any(row)]
    header = [cell.lower() for cell in rows[0]] if rows else []
    column = header.index("dof") if "dof" in header else None
    if column is not None or (n_dof is not None and len(rows) == n_dof + 1):
        rows = rows[1:]
    if column is not None and any(len(row) <= column for row in rows):
        raise FileError(f"{path} has lines without the column 'dof': give every line all columns")
    return tuple(" ".join(row) if column is None else row[column] for row in rows)


def _to_texts(name: str, given: Any) -> tuple[str, ...]:
    """Return the text of a list, a numpy array, or a MATLAB cell array or character matrix; numbers become text."""
    if isinstance(given, str):
        raise InputError(f"{name} is the text {given!r}: give a list of names")
    array = np.asarray(given)
    if array.size > _MOST_NAMES:
        raise InputError(f"{name} holds {array.size} entries: give at most {_MOST_NAMES}, each with a name")
    cells = [cell for entry in np.ravel(array) for cell in np.ravel(np.asarray(entry))]
    for cell in cells:
        if not isinstance(cell, str | int | np.integer | float) or cell != cell:
            raise InputError(f"{name} holds {cell!r}: give names")
    return tuple((f"{cell:g}" if isinstance(cell, float) else str(cell)).strip() for cell in cells)


def _read_joint_ends(given: Any) -> dict[str, tuple[str, ...]]:
    """Return the ends of the joints by name, from a table or from rows of name, one end, other end or nothing."""
    if isinstance(given, Mapping):
        rows = [(name, *((ends,) if isinstance(ends, str) else ends)) for name, ends in given.items()]
    else:
        texts = _to_texts("joints", given)
        width = np.shape(given)[-1] if texts else 3
        if np.ndim(given) > 2 or width > _MOST_ENDS:
            raise InputError(f"joints has the shape {np.shape(given)}: give a row of name, end and other end for each")
        rows = [texts[start : start + width] for start in range(0, len(texts), width)]
    for name in count_repeats(str(row[0]) for row in rows):
        raise InputError(f"two joints are called {name!r}: give each a name of its own")
    return {str(name): tuple(str(end) for end in ends if end != "") for name, *ends in rows}
