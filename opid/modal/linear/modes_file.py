"""Linear modes in a file, .npz or .csv, and two checks of their scale: unit normalisation and percent."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from opid.errors import FileError, InputError, count_repeats, meant_by, nearest, require
from opid.modal.linear.modes import ACCELERATION, LinearModes
from opid.modal.settings import MODAL
from opid.signals.files import read_table_text, split_rows, write_whole
from opid.signals.logs.archives import read_archive
from opid.signals.recording import FloatArray

VARIANTS = {
    "frequency_hz": ("frequency", "frequencies", "freq", "fn", "natural_frequency", "natural_frequencies"),
    "damping_ratio": ("damping_ratio", "damping_ratios", "modal_damping_ratio", "zeta", "zetas"),
    "shapes": ("shapes", "shape", "mode_shapes", "mode_shape", "modeshapes", "phi"),
    "sensors": ("sensors", "sensor", "sensor_names", "channels", "channel_names"),
}
"""Names that a file may use for each quantity, without regard to case and blanks; frequencies with or without Hz."""

ROWS = ("frequency_hz", "damping_ratio")  # the rows of a CSV file that are not sensors


def read_modes(path: str | os.PathLike[str]) -> LinearModes:
    """Return the linear modes that a file holds.

    Args:
        path: an .npz file with the arrays `frequency_hz`, `damping_ratio`, `shapes` (sensors x modes) and `sensors`; or
            a .csv file with a header and the rows `frequency_hz`, `damping_ratio` and one for each sensor. A row has
            its name first, then one value for each mode, separated by comma, semicolon or tab (a decimal comma needs
            one of the latter two). The damping of a mode of 0 Hz may be left empty. Or a universal file (.uff, .unv;
            needs pyuff) with normal modes and their modal masses (dataset 55), whose sensors are named by node and
            direction, like 12_z.

    Raises:
        InputError: no such file, another kind of file, an array or row that is missing or given twice, a cell that is
            not a number, complex or transposed shapes, or what `LinearModes` refuses.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     path = Path(directory, "modes.csv")
    ...     _ = path.write_text("sensor,mode 1\\nfrequency_hz,25\\ndamping_ratio,0.004\\ntip,0.5\\n")
    ...     read_modes(path).shapes.tolist()
    [[0.5]]
    """
    source = Path(path)
    kind = source.suffix.lower()
    if kind not in _READERS:
        raise FileError(f"{path} is not a file of modes: give one that ends in .npz, .csv, .uff or .unv")
    if not os.path.isfile(source):
        raise FileError(f"there is no file of modes {path}: check the name")
    try:
        return _READERS[kind](source)
    except InputError as error:
        raise FileError(f"{path}: {error}") from None
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}") from error


def write_modes(modes: LinearModes, path: str | os.PathLike[str]) -> None:
    """Write linear modes to a file that `read_modes` reads back to the last bit; a failure leaves no half file.

    Args:
        modes: the modes.
        path: a path that ends in .npz or .csv.

    Raises:
        InputError: another ending, a directory that is not there, or names of sensors that a CSV file cannot hold.
    """
    kind = Path(path).suffix.lower()
    if kind == ".npz":
        with write_whole(path, "wb") as file:
            np.savez(
                file,
                frequency_hz=modes.frequency_hz,
                damping_ratio=modes.damping_ratio,
                shapes=modes.shapes,
                sensors=np.array(modes.sensors, dtype=np.str_),
            )
    elif kind == ".csv":
        for sensor in modes.sensors:
            if _recognise(sensor, ROWS) or not sensor or sensor != sensor.strip() or "\r" in sensor or "\n" in sensor:
                raise FileError(
                    f"the sensor {sensor!r} cannot be the name of a row of {path}: rename it, or write an .npz file"
                )
        with write_whole(path) as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["sensor", *(f"mode {mode + 1}" for mode in range(modes.n_modes))])
            rows = zip((*ROWS, *modes.sensors), (modes.frequency_hz, modes.damping_ratio, *modes.shapes), strict=True)
            for name, values in rows:
                writer.writerow([name, *(repr(float(value)) for value in values)])
    else:
        raise FileError(f"cannot write modes to {path}: give a name that ends in .npz or .csv")


def looks_unit_normalised(modes: LinearModes) -> str:
    """Return a clause on how the shapes are scaled if they are scaled to 1 and not to unit modal mass; else "".

    >>> looks_unit_normalised(LinearModes([1, 2], [0, 0], [[1, 1], [0.5, -1]], ("a", "b")))
    'the largest value of every shape is 1'
    """
    if modes.n_modes < 2:  # the value 1 of a single shape may be chance
        return ""
    # Files carry four digits or more, and rigid-body modes often come from another source.
    shapes = modes.shapes[:, modes.elastic] if modes.elastic.sum() > 1 else modes.shapes
    is_motion = np.equal(modes.units, ACCELERATION)  # the size of a strain depends on the thickness of the structure
    shapes = shapes[is_motion] if is_motion.any() else shapes
    if np.allclose(np.abs(shapes).max(axis=0), 1, rtol=0, atol=1e-4):
        return "the largest value of every shape is 1"
    if np.allclose(np.linalg.norm(shapes, axis=0), 1, rtol=0, atol=1e-4):
        return "the sum of squares of every shape is 1"
    return ""


def looks_in_percent(modes: LinearModes) -> str:
    """Return a clause if the damping ratios of elastic modes look like percent, else "".

    >>> looks_in_percent(LinearModes([10.0, 20.0], [0.4, 0.6], [[0.5, 0.1]], ("a",)))
    'the damping ratio of every elastic mode is above 0.2'
    """
    elastic = modes.damping_ratio[modes.elastic]
    if elastic.size and elastic.min() > MODAL.most_damping:
        return f"the damping ratio of every elastic mode is above {MODAL.most_damping:g}"
    return ""


def _read_npz(source: Path) -> LinearModes:
    held = read_archive(source).require_plain_arrays()
    arrays = {name: held[own] for name, own in _assign_rows(list(held), tuple(VARIANTS), "array").items()}
    frequency_hz, damping_ratio, shapes = (_read_numbers(arrays[name], name) for name in (*ROWS, "shapes"))
    return _make_modes(frequency_hz.ravel(), damping_ratio.ravel(), shapes, _read_names(arrays["sensors"]))


def _read_csv(source: Path) -> LinearModes:
    text, delimiter = read_table_text(source, "sensor,mode 1,mode 2")
    cells = split_rows(text, delimiter)
    # An empty cell after a last delimiter is left out; the others stay, for each stands for a mode.
    rows = [(n, row[:-1] if row[1:] and not row[-1] else row) for n, row in enumerate(cells, start=1) if any(row)]
    if not rows:
        raise InputError("it has no cell with content: give a header, and a row for each quantity and sensor")
    header = rows[0][1]
    if len({_recognise(cell, ROWS) for cell in header} - {""}) == len(ROWS):
        raise InputError(
            "each of its rows is a mode: transpose it, so that each column is a mode and each row a sensor"
        )
    if not _recognise(header[0], ROWS):
        rows = rows[1:]  # otherwise there is no header
    names = _assign_rows([row[0] for _, row in rows], ROWS, "row", others=True)
    n_modes = next(len(row) for _, row in rows if row[0] == names["frequency_hz"]) - 1
    values = {row[0]: _read_cells(row, number, n_modes, delimiter) for number, row in rows}
    sensors = [row[0] for _, row in rows if row[0] not in names.values()]
    for sensor, n in count_repeats(sensors).items():
        raise InputError(f"{n} rows are called {sensor!r}: rename them")
    if not sensors:
        raise InputError("it has no row of a sensor: give one row of shape values for each sensor")
    if n_modes < 1:
        raise InputError(f"the row {names['frequency_hz']!r} has no values: give one for each mode")
    shapes = np.array([values[sensor] for sensor in sensors])
    frequency_hz, damping_ratio = (np.array(values[names[name]]) for name in ROWS)
    return _make_modes(frequency_hz, damping_ratio, shapes, tuple(sensors))


NORMAL_MODE = 2
"""The type of analysis of a universal file that holds a real mode with its modal mass."""

DIRECTIONS = {"r1": "x", "r2": "y", "r3": "z", "r4": "rx", "r5": "ry", "r6": "rz"}
"""The values of a node in a universal file, and what is added to its number to name a sensor."""


def _read_universal(source: Path) -> LinearModes:
    """Return the normal modes of a universal file, dataset 55: sensors are named by node and direction, like 12_z."""
    require("pyuff", "universal files", "pyuff", "uff")
    import pyuff

    try:
        file = pyuff.UFF(str(source))
        sets = [each for k, kind in enumerate(file.get_set_types()) if kind == 55 for each in [file.read_sets(k)]]
        modes = [each for each in sets if int(each.get("analysis_type", 0)) == NORMAL_MODE]
        nodes = [tuple(int(node) for node in each["node_nums"]) for each in modes]
        columns = [{key: np.asarray(each[key]) for key in DIRECTIONS if key in each} for each in modes]
        facts = [[float(each[key]) for key in ("freq", "modal_damp_vis", "modal_m")] for each in modes]
    except OSError:
        raise
    except Exception as error:  # pyuff raises nothing more specific
        raise InputError(f"it is not a valid universal file ({error}): write it again") from None
    if not modes:
        raise InputError(
            f"it has {len(sets)} dataset(s) 55 and none with normal modes (type of analysis {NORMAL_MODE}): write real "
            "modes with their modal masses, or a CSV file"
        )
    if len(set(nodes)) > 1:
        raise InputError("its modes have different nodes: give all modes the same nodes in the same order")
    if any(np.iscomplexobj(each) for several in columns for each in several.values()):
        raise InputError("its shapes are complex: give real normal modes (rotate the phase, take the real part)")
    if any(mass <= 0.0 for *_, mass in facts):
        raise InputError("a modal mass in it is 0 or missing, so that its shape has no scale: give the modal masses")
    used = [key for key in DIRECTIONS if any(key in each and each[key].any() for each in columns)]
    names = [f"{node}_{DIRECTIONS[key]}" for node in nodes[0] for key in used]
    zero = np.zeros(len(nodes[0]))
    shapes = [np.column_stack([each.get(key, zero) for key in used]).ravel() for each in columns]
    frequency_hz, damping_ratio, mass = np.array(facts).T
    return _make_modes(frequency_hz, damping_ratio, np.column_stack(shapes) / np.sqrt(mass), tuple(names))


_READERS = {".npz": _read_npz, ".csv": _read_csv, ".uff": _read_universal, ".unv": _read_universal}


def _make_modes(
    frequency_hz: FloatArray, damping_ratio: FloatArray, shapes: FloatArray, sensors: tuple[str, ...]
) -> LinearModes:
    turned = (frequency_hz.size, len(sensors))
    if shapes.shape == turned and turned[0] != turned[1]:
        raise InputError(
            f"shapes is {turned[0]} modes x {turned[1]} sensors: transpose it, so that each row is a sensor and each "
            "column a mode"
        )
    if damping_ratio.shape == frequency_hz.shape:
        # The damping of a rigid-body mode has no effect, and is often left empty.
        damping_ratio = np.where(np.isnan(damping_ratio) & (frequency_hz == 0), 0.0, damping_ratio)
    return LinearModes(frequency_hz, damping_ratio, shapes, sensors)


def _recognise(name: str, wanted: Sequence[str]) -> str:
    """Return which of the wanted quantities a name stands for, "" for none."""
    plain = name.strip().lower().replace("[hz]", "hz").replace("(hz)", "hz")
    plain = "_".join(plain.replace("-", " ").replace("_", " ").split()).removesuffix("_hz")
    return next((quantity for quantity in wanted if plain in VARIANTS[quantity]), "")


def _assign_rows(found: list[str], wanted: Sequence[str], what: str, *, others: bool = False) -> Mapping[str, str]:
    """Return the name of each wanted quantity in the file; with `others` the remaining names are sensors."""
    names: dict[str, str] = {}
    for name in found:
        quantity = _recognise(name, wanted)
        if quantity in names:
            raise InputError(f"the {what}s {names[quantity]!r} and {name!r} both stand for {quantity}: leave one out")
        if quantity:
            names[quantity] = name
    left = [name for name in found if name not in names.values()]
    for quantity in wanted:
        if quantity not in names:
            clause = nearest(quantity, left) if left else "there is none"
            is_near = bool(meant_by(quantity, left))
            hint = f"the nearest {what}: {clause}" if is_near else f"its {what}s: {clause}"
            if others and not is_near:
                hint = "give its first cell this name"
            raise InputError(f"there is no {what} {quantity!r} ({hint})")
    return names


def _read_numbers(array: np.ndarray, name: str) -> np.ndarray:
    if np.iscomplexobj(array):
        if np.any(array.imag):
            raise InputError(f"{name} is complex: give real normal modes, mass-normalised")
        array = array.real
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} holds {array.dtype} where numbers are needed: give an array of numbers")
    return array.astype(np.float64)


def _read_names(array: np.ndarray) -> tuple[str, ...]:
    if array.dtype.kind == "S":
        array = np.char.decode(array, "utf-8")
    if array.dtype.kind != "U":
        raise InputError(f"sensors holds {array.dtype} where names are needed: give an array of text")
    return tuple(str(name) for name in array.ravel())


def _read_cells(row: list[str], number: int, n_modes: int, delimiter: str) -> list[float]:
    if len(row) - 1 != n_modes:
        raise InputError(
            f"line {number} ({row[0]!r}) has {len(row) - 1} values and frequency_hz has {n_modes}: give one for each "
            "mode"
        )
    return [_read_cell(cell, row[0], number, delimiter) for cell in row[1:]]


def _read_cell(cell: str, name: str, number: int, delimiter: str) -> float:
    if not cell and _recognise(name, ("damping_ratio",)):
        return math.nan
    text = cell.replace(",", ".") if delimiter != "," else cell
    try:
        return float(text)
    except ValueError:
        pass
    try:
        complex(text.replace("i", "j").replace(" ", ""))
    except ValueError:
        raise InputError(f"line {number} ({name!r}) has {cell!r} where a number is needed: correct it") from None
    raise InputError(
        f"line {number} ({name!r}) has the complex value {cell!r}: give real normal modes, mass-normalised"
    )
