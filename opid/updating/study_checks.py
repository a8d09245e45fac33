"""Do measured backbones fit the structure that they are said to be of: frequencies, numbers of modes, stiffness."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from opid.errors import InputError
from opid.mechanics.backbones import refuse_unseen
from opid.mechanics.jointed_modes import JointedModes
from opid.signals.recording import FloatArray
from opid.updating.measured import MeasuredBackbone
from opid.updating.reduction import lowest_modes
from opid.updating.structure import AffineStructure

FARTHEST = 3.0
"""Ratio of frequencies beyond which no updating of stiffness explains them: a factor of nine."""

ALIKE = 0.8
"""Modal assurance from which a measured shape is that of a mode."""

APART = 0.1
"""Share by which curves of one mode may begin at different frequencies."""

N_ABOVE = 8
"""Modes beyond the highest that is named, to look for the right one in."""


LEAST_EXTENSION = 1e-3
"""Of the largest extension that any mode gives a joint: below it the joints' law does not show in a mode."""


def sensor_faults(backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Yield where curves of one mode have different sensors: both phases compare shapes entry by entry.

    Args:
        backbones: all of a study.
    """
    first: dict[int, MeasuredBackbone] = {}
    for curve in backbones:
        other = first.setdefault(curve.mode, curve)
        if curve.sensors == other.sensors:
            continue
        for one, two in ((curve, other), (other, curve)):
            lacking = [name for name in two.sensors if name not in one.sensors]
            if lacking:
                yield (
                    f"backbone {one.name!r} of mode {one.mode} lacks the sensor(s) {', '.join(lacking)} of "
                    f"{two.name!r}: give all curves of a mode the same sensors, leave out those that one lacks"
                )
        if set(curve.sensors) == set(other.sensors):
            yield (
                f"backbone {curve.name!r} of mode {curve.mode} has the sensors of {other.name!r} in another order: "
                "give all curves of a mode the same order"
            )


def joint_fault(modes: JointedModes, mode: int) -> list[str]:
    """Return one clause where a mode extends no joint, so that no law of the joints changes it.

    Args:
        modes: of the structure.
        mode: number of the mode, from 1.
    """
    size = np.abs(modes.at_joints).max(axis=0, initial=0.0)
    share = float(size[mode - 1] / max(float(size.max(initial=0.0)), 1e-300))
    if not modes.joints or share > LEAST_EXTENSION:
        return []
    others = np.flatnonzero(size > LEAST_EXTENSION * size.max()) + 1
    return [
        f"mode {mode} extends no joint ({share:.1g} of the largest extension), so that their law does not change it: "
        f"take another mode, such as {', '.join(map(str, others[:3]))}"
    ]


def mode_faults(modes: JointedModes, backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Yield what is wrong with the modes that backbones name: not there, still at the joints or the controlled sensor.

    Args:
        modes: of the structure.
        backbones: measured on it.
    """
    for mode in sorted({curve.mode for curve in backbones}):
        if mode > modes.n_modes:
            names = ", ".join(repr(curve.name) for curve in backbones if curve.mode == mode)
            yield f"backbone {names} is of mode {mode}, and the structure has {modes.n_modes}"
            continue
        yield from joint_fault(modes, mode)
        held = dict.fromkeys(curve.controlled_sensor for curve in backbones if curve.mode == mode)
        for sensor in held:
            try:
                if sensor in modes.sensors:
                    refuse_unseen(modes, mode - 1, modes.sensors.index(sensor))
            except InputError as error:
                yield str(error)


def structure_faults(structure: AffineStructure) -> Iterator[str]:
    """Yield what is wrong with the matrices as a whole: mass or nominal stiffness that are not positive.

    Args:
        structure: of the study.
    """
    if (worst := _least_eigenvalue(structure.mass)) <= 0:
        yield f"the mass matrix is not positive (eigenvalue {worst:.3g} kg): export it again"
    # a structure that floats has zeros, and rounding makes them negative
    stiffness = structure.stiffness_at({})
    largest = float(np.abs(stiffness.diagonal()).max(initial=0.0))
    if (worst := _least_eigenvalue(stiffness, 1e-9 * largest)) < -1e-8 * largest:
        yield f"the stiffness matrix is not positive (eigenvalue {worst:.3g} N/m): look for a wrong sign"


def nominal_modes(structure: AffineStructure, n_modes: int) -> JointedModes:
    """Return the lowest modes of the nominal structure at its sensors.

    Args:
        structure: of the study.
        n_modes: how many, or all there are.
    """
    eigenvalue, shapes = lowest_modes(structure.mass, structure.stiffness_at({}), min(n_modes, structure.n_dof))
    rows = [structure.dofs.index(sensor) for sensor in structure.sensors]
    names = tuple(structure.joints)
    return JointedModes(eigenvalue, shapes[rows], structure.joint_rows @ shapes, structure.sensors, names)


def backbone_faults(structure: AffineStructure, backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Yield what is wrong with backbones against the structure and against each other.

    Frequencies that are far from any mode, or from the one that is named; curves of one mode that begin far from each
    other; modes whose curves cross.

    Args:
        structure: of the study.
        backbones: measured on it.
    """
    n_modes = max((curve.mode for curve in backbones), default=0) + N_ABOVE
    try:
        modes = nominal_modes(structure, n_modes)
    except InputError:
        return  # told by `structure_faults`
    wrong = []
    for curve in backbones:
        fault = _frequency_fault(modes, curve)
        wrong += [curve.name] * bool(fault)
        yield from fault
    yield from mode_faults(modes, [curve for curve in backbones if curve.name not in wrong])
    if not wrong:
        yield from _crossings(backbones)


def _frequency_fault(modes: JointedModes, curve: MeasuredBackbone) -> list[str]:
    """At most one clause: the mode that is named is not there, or lies elsewhere."""
    if curve.mode > modes.n_modes:
        return [f"backbone {curve.name!r} is of mode {curve.mode}, and the structure has {modes.n_modes}"]
    lowest = float(curve.frequency_hz[0])
    hz = modes.frequency_hz
    if _far(lowest, hz[curve.mode - 1]) <= FARTHEST:
        return []
    nearest = int(np.argmin([_far(lowest, each) for each in hz]))
    begins = f"backbone {curve.name!r} of mode {curve.mode} begins at {lowest:.4g} Hz"
    like = _likeness(modes, curve)
    best = int(np.argmax(like))
    if like[best] >= ALIKE and best != curve.mode - 1 and _far(lowest, hz[best]) <= FARTHEST:
        return [
            f"{begins}, and mode {curve.mode} of the structure lies at {hz[curve.mode - 1]:.4g} Hz: its shape and "
            f"frequency are those of mode {best + 1} at {hz[best]:.4g} Hz (modes are counted from 1, rigid ones too)"
        ]
    if _far(lowest, hz[nearest]) > FARTHEST:
        told = f"far from any mode of the structure (the nearest is mode {nearest + 1} at {hz[nearest]:.4g} Hz)"
    else:
        told = f"and that mode of the structure lies at {hz[curve.mode - 1]:.4g} Hz (the nearest is mode {nearest + 1} "
        told += f"at {hz[nearest]:.4g} Hz)"
    return [f"{begins}, {told}: look at the unit of the frequencies, the number of the mode, and the matrices"]


def _likeness(modes: JointedModes, curve: MeasuredBackbone) -> FloatArray:
    """Modal assurance of the shape of the lowest point with each mode; zeros where few sensors say nothing."""
    rows = [modes.sensors.index(sensor) for sensor in curve.sensors]
    shape, shapes = curve.amplitude[0], modes.at_sensors[rows]
    size = np.sum(shape**2) * np.sum(shapes**2, axis=0)
    if len(rows) < 3:
        return np.zeros(modes.n_modes)
    return np.divide((shape @ shapes) ** 2, size, out=np.zeros_like(size), where=size > 0)


def _crossings(backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Curves of one mode that do not begin together, and modes in the wrong order."""
    begins: dict[int, dict[str, float]] = {}
    for curve in backbones:
        begins.setdefault(curve.mode, {})[curve.name] = float(curve.frequency_hz[0])
    middle: Mapping[int, float] = {mode: float(np.median(list(curves.values()))) for mode, curves in begins.items()}
    for mode, curves in sorted(begins.items()):
        for name, lowest in curves.items():
            if _far(lowest, middle[mode]) > 1 + APART:
                yield (
                    f"backbone {name!r} begins at {lowest:.4g} Hz where the others of mode {mode} begin near "
                    f"{middle[mode]:.4g} Hz: is it of another mode?"
                )
    order = sorted(middle)
    for low, high in pairwise(order):
        if middle[low] >= middle[high]:
            yield (
                f"the backbones of mode {low} begin at {middle[low]:.4g} Hz and those of mode {high} at "
                f"{middle[high]:.4g} Hz: they cross, the higher mode has the higher frequency"
            )


def _far(one: float, other: float) -> float:
    """The ratio of two frequencies, the larger over the smaller."""
    return max(one, other) / max(min(one, other), 1e-12)


def _least_eigenvalue(matrix: object, shift: float = 0.0) -> float:
    """An eigenvalue that is negative if any is, else a positive number: by the signs of the pivots (Sylvester)."""
    from scipy import sparse
    from scipy.sparse.linalg import eigsh, splu

    found = sparse.csc_matrix(matrix)
    n = found.shape[0]
    if n <= 2:
        return float(np.linalg.eigvalsh(found.toarray())[0])
    try:
        factors = splu(
            found + shift * sparse.identity(n, format="csc"),
            permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True},
        )  # fmt: skip
    except RuntimeError:  # singular
        return 0.0
    if (factors.U.diagonal() > 0).all() and (factors.perm_r == factors.perm_c).all():
        return 1.0
    return float(eigsh(found, k=1, which="SA", return_eigenvectors=False, tol=1e-4)[0])
