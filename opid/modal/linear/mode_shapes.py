"""From the residues of fitted responses to shapes, modal masses, and what speaks against them.

A residue tells how far a sensor moves in a mode under a force at a drive point. At the drive point itself it is the
square of the shape there, so those of all modes are positive. That gives the scale of the shapes and the modal masses;
where the signs contradict it, the force acted elsewhere, and there is no scale.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from opid.errors import InputError, list_names
from opid.estimate import Estimate, format_percent
from opid.mechanics.structure import modal_assurance
from opid.modal.linear.fitted_modes import FittedModes, FittedResidues, ResponseFitSettings
from opid.modal.settings import MODAL
from opid.signals.recording import FloatArray


def shape_modes(found: FittedResidues, settings: ResponseFitSettings) -> FittedModes:
    """Return the modes of fitted residues: shapes, modal masses, intervals, and what limits them.

    Raises:
        InputError: the residues at a drive point are negative.
        NotDeterminedError: no mode moves a drive point.
    """
    signs = _find_signs(found, settings)
    contradicted = _find_contradicted(found, signs)
    withheld: NDArray[np.bool_] = np.array([each.excess > settings.most_left for each in found.misfits])
    withheld |= np.isin(found.sensors, _list_clipped(found))
    counted = np.ones_like(withheld) if withheld.all() else ~withheld
    lost_drives = [drive for drive in dict.fromkeys(found.drives) if withheld[drive]]
    has_scale = not (contradicted or lost_drives or any(each.has_clipped_force for each in found.responses))
    kept, shaped = _shape_to_scale(found, settings) if has_scale else _shape_without_scale(found, counted)
    coherence = _find_coherence(found, kept, shaped.shapes, counted, settings)
    unlike = coherence < settings.least_coherence
    doubled = _find_doubled(found, kept, counted, settings)
    apart = shaped.misfits > MODAL.most_misfit
    frequencies, ratios = _give_poles(found, kept, counted, coherence, settings)
    frequencies, ratios, masses = (
        tuple(
            each.without_interval() if low else each
            for each, low in zip(several, (unlike | doubled).tolist(), strict=True)
        )
        for several in (frequencies, ratios, shaped.masses)
    )
    masses = tuple(each.without_interval() if off else each for each, off in zip(masses, apart.tolist(), strict=True))
    candidates = tuple(_list_candidates(found, own) for own in signs)
    warnings = (
        *_warn_of_sensors(found, withheld, settings),
        *_warn_of_drive_points(found, contradicted, candidates, lost_drives),
        *_warn_of_modes(found, kept, unlike, apart, settings),
        *_warn_of_doubled(found, kept, doubled),
    )
    for each in (shaped.shapes, shaped.std):
        each[withheld] = np.nan
    shaped.std[:, unlike | doubled] = np.nan
    return FittedModes(
        frequencies,
        ratios,
        masses,
        shaped.shapes,
        shaped.std,
        found.sensors,
        found.units,
        found.band_hz,
        found.delay_s,
        found.sensor_delay_s,
        found.unexplained,
        found.misfits,
        has_scale,
        candidates,
        found.responses,
        found.fitted,
        warnings,
    )


@dataclass(frozen=True, eq=False)
class _Shapes:
    """Shapes (n_sensors, n_modes) with deviations, masses, and how far drive points contradict each other."""

    shapes: FloatArray
    std: FloatArray
    masses: tuple[Estimate, ...]
    misfits: FloatArray


def _list_clipped(found: FittedResidues) -> list[str]:
    """Return the sensors that are clipped in a record."""
    return [name for name in found.sensors if any(name in each.clipped_sensors for each in found.responses)]


def _find_signs(found: FittedResidues, settings: ResponseFitSettings) -> NDArray[np.int64]:
    """Return the sign of each residue, (n_drives, n_sensors, n_modes), 0 where it is not beyond doubt."""
    size = np.abs(found.residues)
    is_clear = size >= settings.least_std * found.widened_std
    is_large = size >= settings.least_part * size.max(axis=1, keepdims=True)
    return np.where(is_clear & is_large, np.sign(found.residues), 0).astype(np.int64)


def _find_contradicted(found: FittedResidues, signs: NDArray[np.int64]) -> list[int]:
    """Return the drive points at which residues have both signs beyond doubt."""
    contradicted = []
    for d, sensor in enumerate(found.drives):
        own = signs[d, sensor]
        over = found.residues[d, sensor] / found.residue_std[d, sensor]
        if not (own > 0).any() and ((own < 0).any() or np.max(-over) > np.max(over)):
            candidates = _list_candidates(found, signs[d])
            could = f", or name the sensor where it acted: the signs allow {list_names(map(repr, candidates))}"
            raise InputError(
                "the acceleration at the drive point falls as the force grows, as if modal masses were negative: the "
                "force or that sensor counts in the other direction, so turn the sign of one of them in the logs"
                + (could if candidates else "")
            )
        if (own < 0).any():
            contradicted.append(d)
    return contradicted


def _list_candidates(found: FittedResidues, signs: NDArray[np.int64]) -> tuple[str, ...]:
    """Return the sensors whose residues, (n_sensors, n_modes), are positive beyond doubt, or in doubt."""
    return tuple(
        name for name, own in zip(found.sensors, signs, strict=True) if not (own < 0).any() and (own > 0).any()
    )


def _shape_to_scale(found: FittedResidues, settings: ResponseFitSettings) -> tuple[NDArray[np.int64], _Shapes]:
    """Return the modes that move a drive point, and their mass-normalised shapes."""
    drives, residues, stds = found.drives, found.residues, found.widened_std
    own, of_own = (
        np.stack([each[d, sensor] for d, sensor in enumerate(drives)]) for each in (residues, found.residue_std)
    )
    kept: NDArray[np.int64] = np.flatnonzero(np.max(own / of_own, axis=0) >= settings.least_at_drive)
    shapes, shape_std = np.empty((len(found.sensors), kept.size)), np.empty((len(found.sensors), kept.size))
    masses, misfits = [], []
    for column, mode in enumerate(kept):
        phi, std, misfit = _split_residues(residues[..., mode], stds[..., mode], drives)
        misfits.append(misfit)
        shapes[:, column], shape_std[:, column] = phi, std
        best = max(drives, key=lambda sensor: abs(phi[sensor]) / std[sensor])
        mass_kg = 1 / phi[best] ** 2
        masses.append(Estimate.normal(mass_kg, mass_kg * float(np.hypot(2 * std[best] / phi[best], settings.gain))))
    return kept, _Shapes(shapes, shape_std, tuple(masses), np.array(misfits))


def _shape_without_scale(found: FittedResidues, counted: NDArray[np.bool_]) -> tuple[NDArray[np.int64], _Shapes]:
    """Return all modes with shapes that are 1 at their largest sensor of those that count, by the best drive point."""
    kept = np.arange(len(found.poles))
    shapes, stds = np.empty((len(found.sensors), kept.size)), np.empty((len(found.sensors), kept.size))
    for mode in kept:
        residues, own = found.residues[..., mode], found.widened_std[..., mode]
        best = int(np.argmax(np.max(np.abs(residues) / own, axis=1)))
        largest = residues[best, int(np.argmax(np.abs(residues[best]) * counted))]
        shapes[:, mode], stds[:, mode] = residues[best] / largest, own[best] / abs(largest)
    return kept, _Shapes(shapes, stds, (Estimate(),) * kept.size, np.ones(kept.size))


def _give_poles(
    found: FittedResidues,
    kept: NDArray[np.int64],
    counted: NDArray[np.bool_],
    coherence: FloatArray,
    settings: ResponseFitSettings,
) -> tuple[tuple[Estimate, ...], tuple[Estimate, ...]]:
    """Return natural frequencies and damping ratios with their intervals.

    What the modes leave about each beyond noise is in them, and by how much the records differ there. Of both, which
    are a part of the response, `hidden_part` is the error of the width, and `hidden_shift` that of the frequency.
    """
    size = np.stack([np.mean(np.abs(each.value[:, counted]) ** 2, axis=0) for each in found.responses])[..., np.newaxis]
    left, whole = (np.sum(each[:, counted] ** 2 / size, axis=(0, 1)) for each in (found.residue_errors, found.residues))
    differing = settings.hidden_part**2 * (1 / coherence - 1)
    fraction = np.sqrt((left / np.maximum(whole, 1e-300))[kept] + differing)
    poles = found.poles[kept]
    hidden = np.stack([settings.hidden_shift * fraction * poles[:, 1], fraction], axis=1)
    relative = np.hypot(found.pole_std[kept], hidden)
    relative[:, 0] = np.hypot(relative[:, 0], settings.complexity * poles[:, 1] ** 2)
    left_at_end = max(settings.left_at_end, *(each.left_at_end for each in found.responses))
    relative[:, 1] = np.hypot(relative[:, 1], left_at_end)
    frequencies, ratios = (
        tuple(Estimate.normal(value, value * std) for value, std in zip(own, of.tolist(), strict=True))
        for own, of in zip(poles.T.tolist(), relative.T, strict=True)
    )
    return frequencies, ratios


def _find_coherence(
    found: FittedResidues,
    kept: NDArray[np.int64],
    shapes: FloatArray,
    counted: NDArray[np.bool_],
    settings: ResponseFitSettings,
) -> FloatArray:
    """Return the lowest coherence about each mode, at the sensor that counts and moves most; 1 of a single record."""
    lowest = np.ones(kept.size)
    for response in found.responses:
        if response.coherence is None:
            continue
        for column, (own_hz, ratio) in enumerate(found.poles[kept].tolist()):
            coherence = response.coherence[:, int(np.argmax(np.abs(shapes[:, column]) * counted))]
            near = _median_near(coherence, response.frequency_hz, own_hz, settings.near * ratio)
            lowest[column] = min(lowest[column], max(near, np.finfo(float).eps))
    return lowest


def _find_doubled(
    found: FittedResidues, kept: NDArray[np.int64], counted: NDArray[np.bool_], settings: ResponseFitSettings
) -> NDArray[np.bool_]:
    """Return which modes have a near neighbour of the same shape, as one mode has whose frequency moves in a record."""
    doubled = np.zeros(kept.size, dtype=bool)
    for one, other in combinations(range(kept.size), 2):
        (first_hz, first_ratio), (hz, ratio) = found.poles[kept[[one, other]]]
        shapes = np.stack([found.residues[:, counted, kept[k]].ravel() for k in (one, other)], axis=1)
        is_near = abs(first_hz - hz) < settings.doubled * max(first_hz * first_ratio, hz * ratio)
        if is_near and modal_assurance(shapes)[0, 1] > settings.split_alike:
            doubled[[one, other]] = True
    return doubled


def _split_residues(
    residues: FloatArray, stds: FloatArray, drives: Sequence[int]
) -> tuple[FloatArray, FloatArray, float]:
    """Return the shape whose products with itself at the drive points are the residues, its deviations, and the misfit.

    The misfit is that of the several drive points, an rms in standard deviations, 1 where there is one. Where it is
    larger than 1 the standard deviations grow with it.

    Args:
        residues: (n_drives, n_sensors) of one mode.
        stds: their standard deviations.
        drives: the sensor at each drive point.

    """
    over = [residues[d, sensor] / stds[d, sensor] for d, sensor in enumerate(drives)]
    best = int(np.argmax(over))
    begun = residues[best] / np.sqrt(residues[best, drives[best]])
    found = optimize.least_squares(lambda phi: ((phi[drives][:, np.newaxis] * phi - residues) / stds).ravel(), begun)
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    freedom = residues.size - found.x.size
    misfit = float(np.sqrt(2.0 * found.cost / freedom)) if freedom else 1.0
    std = np.sqrt(np.diag(covariance)) * max(misfit, 1.0)
    return found.x * np.sign(found.x[np.argmax(np.abs(found.x))]), std, misfit


def _warn_of_sensors(
    found: FittedResidues, withheld: NDArray[np.bool_], settings: ResponseFitSettings
) -> Iterator[str]:
    """Yield which sensors are late, and which the modes do not explain."""
    for name, delay in zip(found.sensors, found.sensor_delay_s, strict=True):
        if delay.value is not None:
            side = "after" if delay.value > 0 else "before"
            yield (
                f"sensor {name!r} comes {1e6 * abs(delay.value):.3g} µs {side} the others (standard deviation "
                f"{1e6 * (delay.std or 0.0):.2g} us), which the fit corrects: look for a filter in its channel, or for "
                "a recorder of its own"
            )
    clipped, and_masses = _list_clipped(found), ", and with them modal masses and the scale of all shapes"
    for name, misfit, is_lost in zip(found.sensors, found.misfits, withheld, strict=True):
        if name in clipped:
            yield (
                f"sensor {name!r} is clipped in a record, so that its shapes are withheld"
                f"{and_masses if found.sensors.index(name) in found.drives else ''}: leave that record out, or measure "
                "with a larger range"
            )
            continue
        left = (
            f"the modes leave {format_percent(misfit.unexplained, 2)} of the responses of sensor {name!r}, where noise "
            f"leaves {format_percent(misfit.noise, 2)}, "
        )
        check = "see whether it is loose, clipped or on another clock, and whether a mode is missing in the band"
        if is_lost:
            yield left + f"so that its shapes are withheld: {check}"
        elif misfit.excess > settings.warned_left:
            yield left + f"and the standard deviations of its shapes hold the difference: {check}"


def _warn_of_drive_points(
    found: FittedResidues, contradicted: Sequence[int], candidates: Sequence[Sequence[str]], lost: Sequence[int]
) -> Iterator[str]:
    """Yield why shapes have no scale: a force that acted elsewhere, or a drive point whose sensor is not explained."""
    withheld = "so that neither modal masses nor mass-normalised shapes are given"
    for d in contradicted:
        name = found.responses[d].drive_point
        could = (
            f"the signs allow {list_names(map(repr, candidates[d]))}"
            if candidates[d]
            else "the signs allow none of the sensors"
        )
        yield (
            f"the force did not act at {name!r}, or not in its direction: where a force acts, all modes have residues "
            "of one sign, and an anti-resonance lies between any two of them; there the signs differ, "
            f"{withheld}; {could}, so name the sensor at the drive point, or see whether signs of sensors are right"
        )
    for name in (each.drive_point for each in found.responses if each.has_clipped_force):
        yield (
            f"the force at {name!r} is clipped in a record, {withheld}: leave that record out, or measure with a "
            "larger range"
        )
    clipped = _list_clipped(found)
    for sensor in (each for each in lost if found.sensors[each] not in clipped):
        yield f"the modes do not explain sensor {found.sensors[sensor]!r} at the drive point, {withheld}"


def _warn_of_modes(
    found: FittedResidues,
    kept: NDArray[np.int64],
    unlike: NDArray[np.bool_],
    apart: NDArray[np.bool_],
    settings: ResponseFitSettings,
) -> Iterator[str]:
    """Yield what limits the modes, one sentence each."""
    names = list_names([repr(each.drive_point) for each in found.responses])
    lost = [f"{found.poles[mode, 0]:.4g}" for mode in range(len(found.poles)) if mode not in kept]
    if lost:
        yield (
            f"{len(lost)} mode(s) at {', '.join(lost)} Hz are left out, because they hardly move {names}, where the "
            "force acts, so that their modal masses are unknown: drive the structure at a further point"
        )
    if apart.any():
        where = ", ".join(f"{own_hz:.4g}" for own_hz in found.poles[kept][apart, 0])
        yield (
            f"the responses to forces at {names} do not belong to one shape at {where} Hz, so that no interval is "
            "given for the modal masses: check which force acted where, and the gains and signs of the sensors there"
        )
    if unlike.any():
        low = ", ".join(f"{own_hz:.4g}" for own_hz in found.poles[kept][unlike, 0])
        yield (
            f"the records differ about {low} Hz by more than the noise of a good test (the coherence is below "
            f"{settings.least_coherence:g}), so that no interval is given there: noise does that, and then harder hits "
            "or more of them help; so do joints that slip, where softer hits help, and a structure that moved"
        )
    measured = [response for response in found.responses if response.n_averages]
    if any(response.level_ratio < MODAL.least_level_ratio for response in measured):
        yield (
            f"the forces at a drive point have nearly one height (the factor is below {MODAL.least_level_ratio:g}), so "
            "that nothing shows whether the structure is linear, and all values are those of this level: add records "
            "of another height"
        )


def _warn_of_doubled(found: FittedResidues, kept: NDArray[np.int64], doubled: NDArray[np.bool_]) -> Iterator[str]:
    """Yield that modes near each other have one shape."""
    if doubled.any():
        where = ", ".join(f"{own_hz:.4g}" for own_hz in found.poles[kept][doubled, 0])
        yield (
            f"the modes at {where} Hz lie near each other and have one shape at these sensors, so that no interval is "
            "given there: a single mode whose frequency moves as it decays looks so, and softer hits help; two modes "
            "need sensors at which they differ"
        )


def _median_near(coherence: FloatArray, frequency_hz: FloatArray, own_hz: float, width: float) -> float:
    """Return the median of the lines within a relative width of a frequency, at least of the nearest one."""
    off = np.abs(frequency_hz / own_hz - 1)
    return float(np.median(coherence[off <= max(width, float(off.min()))]))
