"""Check measured backbones against the structure and each other: frequencies, numbers of modes, sensors, shapes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from opid.errors import InputError
from opid.mechanics.backbones.family import refuse_unseen
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.structure import modal_assurance
from opid.signals.recording import FloatArray
from opid.updating.measured import MeasuredBackbone, by_mode
from opid.updating.settings import UPDATING
from opid.updating.structure.affine import AffineStructure
from opid.updating.structure.reduction import lowest_modes


def day_faults(backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Yield which modes have curves with a day and others without one, which then may be of any day."""
    for mode, curves in by_mode(backbones).items():
        without = [one.name for one in curves if not one.day]
        if 0 < len(without) < len(curves):
            yield (
                f"{_name_backbones(without)} of mode {mode} has no day, and others of this mode have one: name the day "
                "of each, or of none"
            )


def _name_backbones(names: Sequence[str]) -> str:
    """Return "backbone 'a'", or "each of 3 backbones ('a' and 2 others)"."""
    return f"backbone {names[0]!r}" if len(names) == 1 else f"each of {len(names)} backbones ({shortened(names)})"


def joint_fault(modes: JointedModes, mode: int) -> list[str]:
    """Return one clause if a mode, counted from 1, extends no joint, so that no law of the joints changes it."""
    size = np.abs(modes.at_joints).max(axis=0, initial=0.0)
    fraction = float(size[mode - 1] / max(float(size.max(initial=0.0)), 1e-300))
    if not modes.joints or fraction > UPDATING.least_extension:
        return []
    others = np.flatnonzero(size > UPDATING.least_extension * size.max()) + 1
    return [
        f"mode {mode} extends no joint (only {fraction:.1g} of the largest extension), so that the law of the joints "
        f"does not change it: take another mode, such as {', '.join(map(str, others[:3]))}"
    ]


def mode_faults(modes: JointedModes, backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Yield which modes of backbones are not there, or do not move the joints or the controlled sensor."""
    for mode, curves in by_mode(backbones).items():
        if mode > modes.n_modes:
            names = ", ".join(repr(curve.name) for curve in curves)
            yield f"backbone {names} is of mode {mode}, and the structure has {modes.n_modes} modes: correct the number"
            continue
        yield from joint_fault(modes, mode)
        for sensor in dict.fromkeys(curve.controlled_sensor for curve in curves):
            try:
                if sensor in modes.sensors:
                    refuse_unseen(modes, mode - 1, modes.sensors.index(sensor))
            except InputError as error:
                yield str(error)


def nominal_modes(structure: AffineStructure, n_modes: int) -> JointedModes:
    """Return the lowest modes of the nominal structure at its sensors, `n_modes` or all there are."""
    eigenvalue, shapes = lowest_modes(structure.mass, structure.stiffness_at({}), min(n_modes, structure.n_dof))
    at_sensors, names = shapes[structure.sensor_indices], tuple(structure.joints)
    return JointedModes(eigenvalue, at_sensors, structure.joint_rows @ shapes, structure.sensors, names)


def backbone_faults(structure: AffineStructure | JointedModes, backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Yield what is wrong with backbones against the structure and against each other, one clause for equal faults.

    The faults are: frequencies far from any mode, or from the one that is named; the shape of another mode; curves of
    one mode that begin far from each other; modes whose curves begin in the wrong order.

    Args:
        structure: the structure of the study, or its modes.
        backbones: the backbones that were measured on it.
    """
    # The right mode may lie above the highest that is named.
    n_modes = max((curve.mode for curve in backbones), default=0) + UPDATING.modes_above
    try:
        modes = structure if isinstance(structure, JointedModes) else nominal_modes(structure, n_modes)
    except InputError:
        return  # `structure_faults` names the reason
    alike: dict[tuple[int, str], list[MeasuredBackbone]] = {}
    for curve in backbones:
        alike.setdefault((curve.mode, _describe_misplaced(modes, curve)), []).append(curve)
    for (_, fault), curves in alike.items():
        if fault:
            yield f"{_describe_start(curves)}{fault}"
    placed = [curve for (_, fault), curves in alike.items() for curve in curves if not fault]
    yield from mode_faults(modes, placed)
    if len(placed) == len(backbones):
        yield from _find_crossings(backbones)


def warn_of_overlaps(backbones: Sequence[MeasuredBackbone]) -> list[str]:
    """Return one warning for each two neighbouring modes whose frequencies overlap.

    An overlap is not an error: at different amplitudes, a mode that stiffens passes the frequency at which another one
    began.
    """
    hz = {mode: np.concatenate([one.frequency_hz for one in curves]) for mode, curves in by_mode(backbones).items()}
    return [
        f"the backbones of mode {low} reach up to {hz[low].max():.4g} Hz and those of mode {high} down to "
        f"{hz[high].min():.4g} Hz: they overlap, as modes may at different amplitudes; check whether a curve has the "
        "number of another mode or has jumped to it"
        for low, high in pairwise(hz)
        if hz[low].max() >= hz[high].min()
    ]


# ---- copies ----------------------------------------------------------------------------------------

_MOST_DIGITS = 12  # Digits beyond these come from conversions of units.


def warn_of_copies(backbones: Sequence[MeasuredBackbone]) -> list[str]:
    """Return one warning for each set of curves of a mode that are the same measurement.

    Curves are copies if all columns that they share agree within the digits with which they are written; one column of
    a motion or force may differ by a constant factor, for a sensor has another gain; a factor of the frequency is the
    offset of another test. Repeated tests scatter by more than their digits. Where digits are so few that tests might
    agree by chance, curves are copies only if they come from files of equal content.
    """
    found = []
    for mode, curves in by_mode(backbones).items():
        sets: list[tuple[list[str], str]] = []
        for one, other in combinations(curves, 2):
            if (copy := _compare_curves(one, other)) is None:
                continue
            known = next((names for names, _ in sets if one.name in names), None)
            if known is None:
                sets.append(([one.name, other.name], copy.words))
            elif other.name not in known:
                known.append(other.name)
        for names, words in sets:
            listed = f"{', '.join(map(repr, names[:-1]))} and {names[-1]!r}"
            found.append(
                f"the curves {listed} of mode {mode} are one measurement: they agree in all digits{words}, and each "
                "counts as a test of its own, which makes intervals too narrow; leave all but one out"
            )
    return found


@dataclass(frozen=True)
class _Copy:
    """What distinguishes two curves that are one measurement."""

    rescaled: str = ""  # the column that differs by a factor
    factor: float = 1.0

    @property
    def words(self) -> str:
        return f" but for a factor of {self.factor:.4g} in {self.rescaled}" if self.rescaled else ""


def _compare_curves(one: MeasuredBackbone, other: MeasuredBackbone) -> _Copy | None:
    """Return what distinguishes two curves that are copies; None if they are different measurements."""
    pairs = _list_columns(one, other)
    if one.frequency_hz.size != other.frequency_hz.size or len(pairs) < 2:
        return None
    copy, log_chance = _Copy(), 0.0
    for name, scatter, first, second in pairs:
        errors = [_find_rounding(each) for each in (first, second)]
        sizes = np.abs(first), np.abs(second)
        with_sign = first * second
        # Rounding leaves a range of factors at each point; a copy has one that lies in all ranges.
        low = float(np.max(np.maximum(sizes[1] - errors[1], 0.0) / (sizes[0] + errors[0])))
        inner = sizes[0] - errors[0]
        high = float(np.min((sizes[1] + errors[1])[inner > 0] / inner[inner > 0], initial=np.inf))
        is_turned = bool((with_sign < 0).any())
        if low > high or (is_turned and (with_sign > 0).any()):
            return None
        if is_turned or not low <= 1.0 <= high:
            if copy.rescaled or first is one.frequency_hz:
                return None
            middle = 0.5 * (low + high)
            copy = _Copy(name, -middle if is_turned else middle)
        if scatter > 0:
            unit = 2 * np.maximum(errors[0], errors[1]) / np.maximum(sizes[0], 1e-300)
            log_chance += float(np.sum(np.log(np.minimum(unit / scatter, 1.0))))
    files = [{each.sha256 for each in curve.files[:1]} for curve in (one, other)]
    is_same_file = bool(files[0] & files[1]) and not copy.rescaled
    return copy if is_same_file or log_chance < np.log(UPDATING.rare) else None


def _list_columns(one: MeasuredBackbone, other: MeasuredBackbone) -> list[tuple[str, float, FloatArray, FloatArray]]:
    """Return name, scatter between repeated tests and values of each column that both curves have.

    The controlled amplitude has no scatter: tests may be held at the same ones.
    """
    frequency, motion = UPDATING.repeated_frequency, UPDATING.repeated_motion
    found = [("the frequency", frequency, one.frequency_hz, other.frequency_hz)]
    for sensor in (each for each in one.sensors if each in other.sensors):
        scatter = 0.0 if sensor in (one.controlled_sensor, other.controlled_sensor) else motion
        # The signs are those against the controlled sensor.
        first, second = (
            each.amplitude[:, each.sensors.index(sensor)]
            * np.sign(each.amplitude[:, each.sensors.index(each.controlled_sensor)])
            for each in (one, other)
        )
        found.append((f"sensor {sensor!r}", scatter, first, second))
    if one.force_n is not None and other.force_n is not None:
        found.append(("the force", motion, one.force_n, other.force_n))
    return found


def _find_rounding(values: FloatArray) -> FloatArray:
    """Return the largest rounding error of each value of a column, by the digits with which all of it is written.

    Columns are written with the same number of digits, or with the same number of decimals.
    """
    size = np.abs(values)
    power = np.floor(np.log10(np.maximum(size, 1e-300)))
    units = [_find_unit(values, each) for each in (power, np.full_like(power, power.max()))]
    return 0.5 * np.maximum(*units) + 10.0**-_MOST_DIGITS * size


def _find_unit(values: FloatArray, power: FloatArray) -> FloatArray:
    """Return units of which all values are multiples, as few digits as possible below powers of ten."""
    unit = 10.0**power
    for _ in range(_MOST_DIGITS):
        if (np.abs(values / unit - np.round(values / unit)) <= 10.0**-_MOST_DIGITS * np.abs(values) / unit).all():
            break
        unit = unit / 10
    return unit


# ---- modes of curves -------------------------------------------------------------------------------


def _describe_misplaced(modes: JointedModes, curve: MeasuredBackbone) -> str:
    """Return the end of a clause on a curve whose mode is not there, lies elsewhere or has another shape; else ""."""
    mode, hz = curve.mode, modes.frequency_hz
    if mode > modes.n_modes:
        return f", and the structure has {modes.n_modes} modes"
    lowest, own = float(curve.frequency_hz[0]), float(hz[mode - 1])
    fastest = float(np.max(2 * np.pi * curve.frequency_hz[:, None] * np.abs(curve.amplitude)))
    if fastest > UPDATING.most_velocity_m_per_s:
        return (
            f", and its sensors reach {fastest:.3g} m/s there, which no structure endures: check the unit of the "
            "amplitudes"
        )
    apart = np.array([_find_ratio(lowest, each) for each in hz])
    like = _find_likeness(modes, curve)
    nearest, best = int(np.argmin(apart)), int(np.argmax(like))
    is_another = like[best] >= UPDATING.alike and best != mode - 1 and apart[best] <= UPDATING.farthest
    counted = "(modes are counted from 1, rigid ones too)"
    if apart[mode - 1] <= UPDATING.farthest:
        if not (is_another and like[mode - 1] < UPDATING.unlike):
            return ""
        return (
            f", and the shape is that of mode {best + 1} of the structure at {hz[best]:.4g} Hz (MAC above "
            f"{UPDATING.alike:g}), not that of mode {mode} at {own:.4g} Hz (MAC below {UPDATING.unlike:g}): check the "
            f"number of the mode {counted}"
        )
    if is_another:
        return (
            f", and mode {mode} of the structure lies at {own:.4g} Hz: shape and frequency are those of "
            f"mode {best + 1} at {hz[best]:.4g} Hz {counted}"
        )
    if apart[nearest] > UPDATING.farthest:
        far = f", far from any mode of the structure (the nearest is mode {nearest + 1} at {hz[nearest]:.4g} Hz)"
    else:
        far = f", and that mode of the structure lies at {own:.4g} Hz (the nearest is mode {nearest + 1} at "
        far += f"{hz[nearest]:.4g} Hz)"
    asked = "they may be in rad/s; " if _find_ratio(lowest / max(own, 1e-12), 2 * np.pi) <= 2 else ""
    return f"{far}: {asked}check the unit of the frequencies, the number of the mode, and the structure"


def _describe_start(curves: Sequence[MeasuredBackbone]) -> str:
    first = sorted(float(curve.frequency_hz[0]) for curve in curves)
    if len(curves) == 1:
        return f"backbone {curves[0].name!r} of mode {curves[0].mode} begins at {first[0]:.4g} Hz"
    span = " to ".join(dict.fromkeys(f"{each:.4g}" for each in (first[0], first[-1])))
    names = shortened([curve.name for curve in curves])
    return f"{len(curves)} backbones of mode {curves[0].mode} ({names}) begin at {span} Hz"


def shortened(names: Sequence[str]) -> str:
    """Return names in quotes; where there are more than two, the first and the number of the others.

    >>> shortened(["a", "b"]), shortened(["a", "b", "c"])
    ("'a' and 'b'", "'a' and 2 others")
    """
    if len(names) <= 2:
        return " and ".join(map(repr, names))
    return f"{names[0]!r} and {len(names) - 1} others"


def _find_likeness(modes: JointedModes, curve: MeasuredBackbone) -> FloatArray:
    """Return the modal assurance of the shape of the lowest point with each mode; 0 for fewer than three sensors."""
    if len(curve.sensors) < 3:
        return np.zeros(modes.n_modes)
    shapes = modes.at_sensors[[modes.sensors.index(sensor) for sensor in curve.sensors]]
    return modal_assurance(curve.amplitude[0], shapes)[0]


def _find_crossings(backbones: Sequence[MeasuredBackbone]) -> Iterator[str]:
    """Yield which curves of one mode do not begin together, and which modes are in the wrong order."""
    middle: dict[int, float] = {}
    for mode, curves in by_mode(backbones).items():
        middle[mode] = float(np.median([curve.frequency_hz[0] for curve in curves]))
        for curve in curves:
            if _find_ratio(curve.frequency_hz[0], middle[mode]) > 1 + UPDATING.apart:
                yield (
                    f"backbone {curve.name!r} begins at {curve.frequency_hz[0]:.4g} Hz where the others of mode {mode} "
                    f"begin near {middle[mode]:.4g} Hz: check whether it belongs to another mode"
                )
    for low, high in pairwise(middle):
        if middle[low] >= middle[high]:
            yield (
                f"the backbones of mode {low} begin at {middle[low]:.4g} Hz and those of mode {high} at "
                f"{middle[high]:.4g} Hz, so they cross: give the higher frequency the higher number"
            )


def _find_ratio(one: float, other: float) -> float:
    """Return the ratio of two frequencies, the larger over the smaller."""
    return max(one, other) / max(min(one, other), 1e-12)
