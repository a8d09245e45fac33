"""The compiled part of mechanics: the laws on single numbers and the time steps, by numba.

`docs/kernels.md` has the map: which function calls which, and how to add one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.core.errors import NumbaError
from numpy.typing import NDArray

from opid.errors import InputError
from opid.mechanics.kernels.backbone_steps import CYCLIC, backbone_slopes, backbones
from opid.mechanics.kernels.compilation import code_of
from opid.mechanics.kernels.prediction_steps import _predict_samples
from opid.mechanics.kernels.steps import remembered_along, structure_steps
from opid.mechanics.laws.kinds import BUILT_IN, Kind
from opid.mechanics.laws.law import FloatArray, Law, Term, TermSet

__all__ = [
    "CYCLIC",
    "backbone_slopes",
    "backbones",
    "check_compiles",
    "code_of",
    "law_arrays",
    "predictor",
    "remembered_along",
    "structure_steps",
]


class LawArrays(NamedTuple):
    """Laws in the form that the compiled functions take: one table with the terms of all laws.

    Args:
        firsts: (n_laws + 1,) row at which each law begins and, at the end, the number of rows.
        codes: (n_terms,) code of each term, see `code_of`.
        values: (n_terms, 14) by columns:
            0 to 2: amplitude times `Term.loading`, and two inner values, 1 where there is none;
            3 to 7: the rest position of the law, and there the force for unit amplitude and its derivatives by z and
            by both inner values; all are 0 for a term with memory;
            8 and 9: the fourth inner value, 0 where there is none, and the third one, 1 where there is none;
            10 to 13: `Term.loading` at rest, and the derivatives of its logarithm by that position and by both inner
            values.
        memories: (n_terms, 4) first memory of a term and their number; first state of a prediction that represents them
            and their number: one for each memory, or one for the mean of those that slip. The first memory is -1 where
            there is none. Faint terms have no states; their first memory is -2 - q, where q is its index among the
            memories of all faint terms.
        elements: (n_memories, 7) u of each memory and its limit, see `opid.laws.Kind`; h' / v of one that slips and its
            derivatives by three inner values, otherwise zero; its weight.
        elements_followed: the same for the memories of faint terms.
    """

    firsts: NDArray[np.int64]
    codes: NDArray[np.int64]
    values: FloatArray
    memories: NDArray[np.int64]
    elements: FloatArray
    elements_followed: FloatArray


def law_arrays(*laws: Law | TermSet) -> LawArrays:
    """Return laws in the form that the compiled functions take.

    >>> from opid.mechanics.laws.law import default_law
    >>> law_arrays(default_law("arctan_velocity")).values[:, :4].tolist()
    [[400.0, 0.02, 1.0, 0.0]]
    """
    firsts = np.cumsum([0, *(len(law.terms) for law in laws)], dtype=np.int64)
    terms = [(term, law.rest_m, k >= len(law.terms) - law.n_faint) for law in laws for k, term in enumerate(law.terms)]
    codes = np.array([code_of(term.name) for term, _, _ in terms], dtype=np.int64)
    values, memories = np.ones((len(terms), 14)), np.tile(np.array([-1, 0, -1, 0]), (len(terms), 1))
    elements: tuple[list[FloatArray], list[FloatArray]] = [], []
    n_states = 0
    for row, (term, rest_m, is_faint) in enumerate(terms):
        values[row, : min(3, len(term.values))] = term.values[:3]
        values[row, 8:10] = (*term.values[4:], 0.0)[0], (*term.values[3:], 1.0)[0]
        values[row, 10:] = term.loading(rest_m)
        values[row, 0] *= values[row, 10]
        if term.kind.memory is None:
            # A kind may divide zero by zero at rest before it replaces the result.
            with np.errstate(all="ignore"):
                shape, by_z, _, first, second = term.evaluate(np.array(rest_m), np.array(0.0))
            values[row, 3:8] = rest_m, shape, by_z, first, second
        else:
            own, begun = _list_elements(term), len(elements[is_faint])
            n_own = 0 if is_faint else 1 if term.kind.slips else len(own)
            memories[row] = -2 - begun if is_faint else begun, len(own), n_states, n_own
            n_states += n_own
            values[row, 3:8] = 0.0
            elements[is_faint].extend(own)
    return LawArrays(firsts, codes, values, memories, *(np.array(each).reshape(-1, 7) for each in elements))


def _list_elements(term: Term) -> list[FloatArray]:
    """Return the rows of `LawArrays.elements` for a term."""
    kind, rows = term.kind, []
    for u, weight in zip(kind.elements, kind.weights, strict=True):
        slopes = (0.0, 0.0, 0.0, 0.0)
        if kind.slips and kind.memory is not None:
            slope, _, _, *by_inner = kind.memory(0.0, 1.0, *(*term.inner, 1.0, 1.0)[:3], u)
            slopes = (slope, *by_inner)
        rows.append(np.array([u, kind.limit, *slopes, weight], dtype=np.float64))
    return rows


def predictor(
    joints: tuple[Any, ...],
    accelerance: FloatArray,
    drive: FloatArray,
    measured: FloatArray,
    *,
    step_s: float,
    covariance_start: FloatArray,
    noise: FloatArray,
    ground: bool,
    sensitivity: bool,
    reading: FloatArray | None = None,
    by_mass: FloatArray | None = None,
    by_reading: FloatArray | None = None,
    of_travel: FloatArray | None = None,
    by_drive: FloatArray | None = None,
    by_measured: FloatArray | None = None,
) -> Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Return a function of the start state, (n_states,): z, v, [d, e], both offsets, each of all interfaces.

    It gives innovation and spread (n_interfaces, n), derivatives of the innovation, and motion (3, n_interfaces, n).

    Args:
        joints: stiffness, damping, ground stiffness and, with ground, stiffness at rest with that of the law
            (n_interfaces, 4); rows, codes, number of inner values, and the other fields of `LawArrays`.
        accelerance: (n_interfaces, n_interfaces) accelerance, 1/kg.
        drive: (2 n - 1, n_interfaces) accelerations below the suspensions at half steps, m/s^2.
        measured: (n, n_interfaces) readings on the body, m/s^2.
        step_s: time step, s.
        covariance_start: (n_states, n_states) covariance of the start state.
        noise: (7, n_interfaces) noise, see `opid.mechanics.driven.Noise.table`.
        ground: whether d and e are states.
        sensitivity: whether derivatives are wanted, (n_interfaces, n_parameters, n); otherwise there are none.
        reading: (n_interfaces, n_interfaces) reading of the sensor of the row for a unit force on the column, 1/kg; the
            accelerance where left out.
        by_mass: (n_directions, n_interfaces, n_interfaces) directions of the accelerance; none where left out.
        by_reading: (n_directions, n_interfaces, n_interfaces) the same directions of the reading; `by_mass` where left
            out.
        of_travel: (n_interfaces, n_interfaces) reading of the sensor of the row for a unit travel of the column, 1/s^2;
            zero where left out.
        by_drive: (2 n - 1, n_directions, n_interfaces) directions of the drive; none where left out.
        by_measured: (n, n_directions, n_interfaces) directions of the readings; none where left out.
    """
    n = drive.shape[1]
    reading = accelerance if reading is None else reading
    by_mass = np.zeros((0, n, n)) if by_mass is None else by_mass
    by_reading = by_mass if by_reading is None else by_reading
    of_travel = np.zeros((n, n)) if of_travel is None else of_travel
    # The directions are the last axis, because the innermost loops go over them.
    of_mass, of_reading = (np.ascontiguousarray(each.transpose(1, 2, 0)) for each in (by_mass, by_reading))
    by_drive = np.zeros((len(drive), 0, n)) if by_drive is None else by_drive
    by_measured = np.zeros((len(measured), 0, n)) if by_measured is None else by_measured
    # A correction is not needed where the state is certain and undisturbed.
    correct = bool(covariance_start.any() or noise[[0, 2, 3, 4, 5]].any())
    unmeasured = bool(noise[5].any())
    # The kernel orders its states as z, v, the memories of the laws, both offsets, [d, e], [w].
    n_start = len(covariance_start)
    order = np.arange(n_start).reshape(-1, n)
    offsets = order[[4, 5, 2, 3]] if ground else order[2:]
    memory_start = memory_starts(joints)
    n_given = n_start + memory_start.size
    into = np.zeros((n_given + n * unmeasured, n_start))
    into[: 2 * n] = np.eye(2 * n, n_start)
    into[2 * n + memory_start.size : n_given] = np.eye(n_start)[offsets.ravel()]
    covariance = into @ covariance_start @ into.T
    covariance[n_given:, n_given:] = np.diag(noise[5, : n * unmeasured] ** 2)
    of_memory = np.arange(2 * n, 2 * n + memory_start.size)
    covariance[of_memory, of_memory] = memory_start**2 if correct else 0.0
    # The kernel for one interface has room for few states.
    single = n == 1 and memory_start.size <= 1 and not (ground and unmeasured)
    begun = into[:, : n_start - 2 * n].copy()

    def predictions(start: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        # For None, unlike 1 or False, numba compiles a kernel of its own without the code for the other case.
        innovation, spread, changes, motion = _predict_samples(
            None if single else n,
            ((0.0,) * memory_start.size or None) if single else (),
            (ground or None) if single else ground,
            (unmeasured or None) if single else unmeasured,
            joints, accelerance, of_mass, reading, of_reading, of_travel, drive, by_drive, measured, by_measured,
            step_s, into @ start, begun, covariance, noise, correct, sensitivity,
        )  # fmt: skip
        # Samples come first in the kernel: rows of a whole record, a power of two apart, would fall on few cache lines.
        return innovation, spread, changes.transpose(1, 2, 0), motion

    return predictions


def memory_starts(joints: tuple[Any, ...]) -> FloatArray:
    """Return the standard deviations of the memories where a record begins, one for each state."""
    codes, memories = joints[2], joints[5]
    rows = np.flatnonzero(memories[:, 0] >= 0)
    return np.repeat([BUILT_IN[code].memory_start for code in codes[rows]], memories[rows, 3]).astype(np.float64)


def check_compiles(kind: Kind) -> None:
    """Compile the function of a kind.

    Raises:
        InputError: numba cannot compile it.
    """
    try:
        values = njit(kind.function, error_model="numpy")(0.001, 0.02, 1.0, 1.0)
    except NumbaError as error:
        # The first line of the message only names the step that failed.
        reason = [*str(error).splitlines(), ""][1].strip()
        raise InputError(
            f"numba cannot compile the function of {kind.name!r} ({reason}): write it with numpy alone, without calls "
            "of other functions"
        ) from None
    if len(values) != 5:
        raise InputError(f"the function of {kind.name!r} returns {len(values)} values: give five")
