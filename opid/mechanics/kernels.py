"""The compiled part of mechanics: the laws on single numbers and the time step, by numba.

The functions of `opid.mechanics.steps` and of the two modules of predictions are compiled for a table of kinds of law:
for the built-in kinds numba keeps the machine code on disk, with a user's own kinds it compiles anew in each process.
"""

from __future__ import annotations

import hashlib
import inspect
import sys
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np
from numba import njit
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from opid.errors import InputError
from opid.mechanics import backbone_steps, prediction_of_one, prediction_steps, steps
from opid.mechanics import kinds as kinds_module
from opid.mechanics.kinds import BUILT_IN, LAWS, Kind
from opid.mechanics.laws import FloatArray, Law

# most parameters of a kind: an amplitude and two inner ones
N_VALUES = 3
# what is compiled into the kernels, each after what it calls
_PARTS = (
    "_force",
    "_slider_force",
    "_dot",
    "_dot_of_two",
    "_move_sliders",
    "_drive",
    "_accelerate",
    "_joint_force",
    "_places",
    "_step_matrices",
    "_by_offset_and_ground",
    "_carry",
    "_carry_covariance",
    "_balance",
    "_gain",
    "_correct",
    "_push",
    "_carried",
    "_carried_covariance",
    "_covariance_with_reading",
    "_corrected_covariance",
    "_balanced",
    "_upper",
    "_power_forces",
    "_weighted_sum",
    "_motion_of_joint",
    "_add_term",
    "_transformed_forces",
    "_receptance",
    "_fill",
    "_eliminate",
    "_newton",
    "_predict",
    "_remember",
    "_march",
    "_shapes",
)
# sums that may be taken in any order, several numbers at once
_SUMS = ("_slider_force", "_dot", "_dot_of_two", "_weighted_sum", "_motion_of_joint")
# long loops over many parameters: a product and a sum in one instruction, rounded once
_FUSED = tuple(
    name
    for name, part in vars(prediction_steps).items()
    if getattr(part, "__module__", "") == prediction_steps.__name__
)
# called once a run, or so long that a call is nothing beside them
_ONCE = (
    "_places",
    "_upper",
    "_newton",
    "_shapes",
    "_power_forces",
    "_transformed_forces",
    "_receptance",
    "_fill",
    "_eliminate",
    "_predict",
    "_remember",
    "_march",
)
_KERNELS = ("_force_many", "_structure_steps", "_predictions", "_predictions_of_one", "_backbones")


def law_arrays(*laws: Law) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Return laws as the compiled functions take them: one table with the terms of all.

    Args:
        laws: any laws.

    Returns:
        The row at which each law begins and, at the end, the number of rows, (n_laws + 1,);
        the code of each term, (n_terms,); its values, (n_terms, 3), filled up with ones.

    >>> from opid.mechanics.laws import default_law
    >>> law_arrays(default_law("arctan_velocity"))
    (array([0, 1]), array([0]), array([[4.e+02, 2.e-02, 1.e+00]]))
    """
    terms = [term for law in laws for term in law.terms]
    firsts = np.cumsum([0, *(len(law.terms) for law in laws)], dtype=np.int64)
    code_of = {name: code for code, name in enumerate(LAWS)}
    codes = np.array([code_of[term.name] for term in terms], dtype=np.int64)
    values = np.ones((len(terms), N_VALUES))
    for row, term in zip(values, terms, strict=True):
        row[: len(term.values)] = term.values
    return firsts, codes, values


def force_kernel(codes: NDArray[np.int64], values: FloatArray, z: FloatArray, v: FloatArray) -> FloatArray:
    """Return the force of one law, N, (n,).

    Args:
        codes: of the terms, as `law_arrays` gives them.
        values: of the terms.
        z: (n,) extension, m.
        v: (n,) its rate, m/s.
    """
    return _kernel("_force_many", codes)(codes, values, z, v)


def runge_kutta_4(codes: NDArray[np.int64]) -> Any:
    """Return the compiled time step of a structure, `opid.mechanics.steps._structure_steps`.

    It takes (matrices, joints, forces, step_s, steps_per_sample, x, v, positions), as `opid.mechanics.response` makes
    them, and returns displacement, velocity and acceleration at each sample, (n, n_dof) each, and the sliders'
    positions after the last. To look it up takes longer than a few steps: keep it.

    Args:
        codes: of the terms of all joints' laws, as `law_arrays` gives them.
    """
    return _kernel("_structure_steps", codes)


def backbones(codes: NDArray[np.int64]) -> Any:
    """Return the compiled Newton's method for backbones, `opid.mechanics.backbone_steps._backbones`.

    It takes (system, sensors, harmonics, law, transform, amplitudes), as `opid.mechanics.backbones` makes them.

    Args:
        codes: of the terms of all joints' laws, as `law_arrays` gives them.
    """
    return _kernel("_backbones", codes)


def predictions(
    joints: tuple[Any, ...],
    accelerance: FloatArray,
    by_mass: FloatArray,
    reading: FloatArray,
    by_reading: FloatArray,
    drive: FloatArray,
    by_drive: FloatArray,
    measured: FloatArray,
    by_measured: FloatArray,
    step_s: float,
    start: FloatArray,
    covariance_start: FloatArray,
    noise: FloatArray,
    ground: bool,
    sensitivity: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return innovation and spread (n_interfaces, n), derivatives of the first, and motion (3, n_interfaces, n).

    Args:
        joints: stiffness, damping, ground stiffness (n_interfaces, 3); rows, codes, number of inner values and values
            of the laws.
        accelerance: (n_interfaces, n_interfaces), 1/kg.
        by_mass: (n_directions, n_interfaces, n_interfaces) directions of the accelerance.
        reading: (n_interfaces, n_interfaces) what the sensor of the row reads of a force on the column, 1/kg.
        by_reading: (n_directions, n_interfaces, n_interfaces) the same directions of that.
        drive: (2 n - 1, n_interfaces), m/s^2.
        by_drive: (2 n - 1, n_directions, n_interfaces) directions of the drive.
        measured: (n, n_interfaces), m/s^2.
        by_measured: (n, n_directions, n_interfaces) directions of the measured.
        step_s: s.
        start: (n_states,) z, v, [x, w], offset of the drive, offset of the measured, of all interfaces each.
        covariance_start: (n_states, n_states).
        noise: (4, n_interfaces) rms of drive and measured, and what their offsets walk in a step, m/s^2.
        ground: whether x and w are states.
        sensitivity: whether derivatives are wanted, (n_interfaces, n_parameters, n); else there are none.
    """
    n = drive.shape[1]
    # nothing is corrected where the state is certain and nothing disturbs it
    correct = bool(covariance_start.any() or noise[[0, 2, 3]].any())
    # the kernels follow z, v, both offsets, [x - z, w - v]
    into = np.eye(start.size)
    if ground:
        into = into[np.arange(6 * n).reshape(6, n)[[0, 1, 4, 5, 2, 3]].ravel()]
        into[4 * n :, : 2 * n] = -np.eye(2 * n)
    states = (into @ start, into[:, : start.size - 2 * n].copy(), into @ covariance_start @ into.T)
    rest = (drive, by_drive, measured, by_measured, step_s, *states, noise)
    if n == 1 and np.array_equal(reading, accelerance) and np.array_equal(by_reading, by_mass):
        # None, not False: numba leaves out what is behind it
        kernel = _kernel("_predictions_of_one", joints[2])
        found = kernel(joints, accelerance, by_mass, *rest, ground or None, correct, sensitivity)
    else:
        kernel = _kernel("_predictions", joints[2])
        # directions last: the innermost loops go over them
        ways = [np.ascontiguousarray(each.transpose(1, 2, 0)) for each in (by_mass, by_reading)]
        found = kernel(joints, accelerance, ways[0], reading, ways[1], *rest, ground, correct, sensitivity)
    innovation, spread, changes, motion = found
    # made sample by sample: rows of a whole record, a power of two apart, would share few places of the cache
    return innovation, spread, changes.transpose(1, 2, 0), motion


def check_compiles(kind: Kind) -> None:
    """Compile the function of a kind.

    Args:
        kind: of a user.

    Raises:
        InputError: numba cannot compile it.
    """
    try:
        values = njit(kind.function, error_model="numpy")(0.001, 0.02, 1.0, 1.0)
    except NumbaError as error:
        # the first line only names the step that failed
        reason = [*str(error).splitlines(), ""][1].strip()
        raise InputError(
            f"numba cannot compile the function of {kind.name!r} ({reason}): write it with numpy alone, no helpers"
        ) from None
    if len(values) != 5:
        raise InputError(f"the function of {kind.name!r} returns {len(values)} values: give five")


def built_in_kernel(name: str) -> Any:
    """Return a compiled function for the built-in kinds.

    Args:
        name: of the function.
    """
    return _compiled(BUILT_IN)[name]


def __getattr__(name: str) -> Any:
    # a part that another compiled module inlines, for the built-in kinds
    if name in _PARTS:
        return built_in_kernel(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _kernel(name: str, codes: NDArray[np.int64]) -> Any:
    own = codes.size > 0 and codes.max() >= len(BUILT_IN)
    return _compiled(tuple(LAWS.values()))[name] if own else built_in_kernel(name)


@cache
def _compiled(kinds: tuple[Kind, ...]) -> dict[str, Any]:
    """Return the kernels with these kinds in place of `_evaluate`; each is compiled at its first call.

    numba renews its cache when the file of a kernel changes, but not when kinds.py does, or another file with functions
    that are compiled in: the digest in the name of the kernels keeps old code apart.
    """
    modules = (backbone_steps, prediction_of_one, prediction_steps, steps)
    names: dict[str, Any] = {name: value for module in modules for name, value in vars(module).items()}
    names["_evaluate"] = _evaluation(kinds)
    sources = "".join(inspect.getsource(module) for module in (kinds_module, *modules, sys.modules[__name__]))
    digest = hashlib.sha256(sources.encode()).hexdigest()[:12]

    def with_names(name: str) -> FunctionType:
        copy = FunctionType(names[name].__code__, names, name)
        copy.__qualname__ = f"{name}_{digest}"
        return copy

    # inlined: as calls, with their many arrays, they take longer than what they compute
    for name in _PARTS:
        names[name] = njit(
            with_names(name), error_model="numpy", fastmath=_freedom(name), forceinline=name not in _ONCE
        )
    for name in _KERNELS:
        names[name] = njit(with_names(name), error_model="numpy", fastmath=_freedom(name), cache=kinds == BUILT_IN)
    return {name: names[name] for name in (*_PARTS, *_KERNELS)}


def _freedom(name: str) -> set[str] | bool:
    """What the compiler may do beyond the letter of the arithmetic."""
    if name in _SUMS:
        return {"reassoc", "nsz", "contract"}
    return {"contract"} if name in _FUSED else False


def _evaluation(kinds: tuple[Kind, ...]) -> Any:
    """Return a compiled (code, z, v, a, b) -> force for unit amplitude and derivatives.

    Compiled code cannot index a tuple of functions, so the choice is written out, one line a kind; inlined into one
    function it compiles five times faster than a chain of functions.
    """
    names: dict[str, Any] = {
        f"kind_{code}": njit(kind.function, error_model="numpy", inline="always") for code, kind in enumerate(kinds)
    }
    choices = "".join(f"    if code == {code}: return kind_{code}(z, v, a, b)\n" for code in range(len(kinds)))
    nothing = "    return np.nan, np.nan, np.nan, np.nan, np.nan\n"
    exec(f"def evaluate(code, z, v, a, b):\n{choices}{nothing}", {"np": np}, names)
    chosen = FunctionType(names["evaluate"].__code__, {"np": np, **names})
    return njit(chosen, error_model="numpy", forceinline=True)
