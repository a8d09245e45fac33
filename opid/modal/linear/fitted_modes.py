"""The linear modes that were found in measured frequency responses, and their content in result.json.

A fit of the responses gives residues: how far each sensor moves in a mode under a force at a drive point. At the drive
point itself a residue is the square of the shape there, so those of all modes are positive. That gives the scale of the
shapes and the modal masses; where the signs contradict it, the force acted elsewhere, and there is no scale.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from opid.errors import InputError, NotDeterminedError, list_names
from opid.estimate import Estimate, format_percent
from opid.json_values import plain
from opid.modal.linear.frequency_response import FrequencyResponse
from opid.modal.linear.modes import LinearModes, with_units
from opid.modal.settings import MODAL
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray

SCHEMA = "opid.modes/1"


@dataclass(frozen=True)
class ResponseFitSettings:
    """How linear modes are found in frequency responses.

    Args:
        highest_order: highest order of the poles; two thirds of them are mathematical.
        same_frequency: a pole is that of the order before if its frequency differs by less, relative ...
        same_damping: ... and its damping ratio by less, relative.
        same_mode: two poles are of one mode if they are closer than this multiple of its damping ratio, relative.
        fewest_orders: a mode stands in so many orders; of a noisy response a mathematical pole stays for three or four.
        most_damping: poles with a larger damping ratio describe no mode of a structure.
        most_steps: steps of a fit at the most; it takes three to ten.
        least_step: a fit ends where its next step is shorter than this many standard deviations of the unknowns.
        least_damped: damping of a step after one that did not help, over the diagonal of the normal equations ...
        most_damped: ... and the damping from which no step helps any more.
        n_weightings: how often the noise of the lines is estimated and the fit repeated.
        lines_per_cell: number of neighbouring lines whose noise may be correlated: a mode is some lines wide.
        least_std: a mode whose largest residue is below so many standard deviations is left out.
        least_coherence: median coherence about a resonance below which the records differ by more than noise: that of
            joints that slip was 0.984 to 0.998, that of linear modes with noise of 1 % above 0.9999.
        near: half of the width about a resonance, in damping ratios, in which it is taken.
        most_left: rms fraction of the responses that the modes may leave before nothing is reported, and of one
            sensor before its shape is withheld.
        warned_left: that fraction of one sensor, beyond its noise, from which on there is a warning.
        farthest_turn: phase at the highest mode, rad, up to which a delay of one sensor is searched: three samples of a
            recorder whose band ends at a third of its rate.
        turns: steps of that search for each radian; between them the delay is refined.
        least_part: residue at a drive point over the largest one of its mode, from which on a negative one says that
            the force acted elsewhere: residues near zero may have either sign.
        gain: relative standard deviation of a residue by the calibrations of force and acceleration, each good to 1 %.
        complexity: standard deviation of a natural frequency, over the square of its damping ratio: damping couples
            modes, whose frequencies without damping are others by about so much.
        left_at_end: relative standard deviation of a damping ratio by what a record still holds when it ends, a
            thousandth of its peak, and by a weak window of the recorder.
    """

    highest_order: int = 60
    same_frequency: float = 0.002
    same_damping: float = 0.1
    same_mode: float = 0.5
    fewest_orders: int = 8
    most_damping: float = 0.2
    most_steps: int = 60
    least_step: float = 1e-4
    least_damped: float = 1e-4
    most_damped: float = 1e6
    n_weightings: int = 3
    lines_per_cell: int = 8
    least_std: float = 6.0
    least_coherence: float = 0.999
    near: float = 2.0
    most_left: float = 0.3
    warned_left: float = 0.02
    farthest_turn: float = 6.3
    turns: int = 8
    least_part: float = 0.05
    gain: float = 0.014
    complexity: float = 2.0
    left_at_end: float = 0.002


RESPONSE_FIT = ResponseFitSettings()


@dataclass(frozen=True)
class SensorMisfit:
    """What the modes leave of the responses of one sensor.

    Args:
        unexplained: rms fraction of its responses that the modes leave.
        noise: rms fraction that noise leaves.
    """

    unexplained: float
    noise: float

    @property
    def excess(self) -> float:
        """The fraction that is left beyond noise, 0 where noise explains all of it."""
        if self.unexplained <= MODAL.most_misfit * self.noise:
            return 0.0
        return float(np.sqrt(self.unexplained**2 - self.noise**2))


@dataclass(frozen=True, eq=False)
class FittedResidues:
    """What a fit of the responses found, of which shapes and masses are made.

    Args:
        poles: (n_modes, 2) frequency (Hz) and damping ratio.
        pole_std: (n_modes, 2) their relative standard deviations.
        residues: (n_drives, n_sensors, n_modes).
        residue_std: their standard deviations.
        residue_errors: their errors by what the modes leave about each mode beyond noise; 0 where noise explains it.
        misfits: what the modes leave of each sensor.
        responses: the measured responses in the band, by drive point.
        fitted: those of the modes.
        units: unit of the second derivative of each sensor's reading.
        band_hz: the band of the fit.
        delay_s: delay of all sensors behind the force.
        sensor_delay_s: delay of each sensor after the others; empty where none is asked for.
        unexplained: rms fraction of each response that the modes leave, by drive point, without withheld sensors.
    """

    poles: FloatArray
    pole_std: FloatArray
    residues: FloatArray
    residue_std: FloatArray
    residue_errors: FloatArray
    misfits: tuple[SensorMisfit, ...]
    responses: tuple[FrequencyResponse, ...]
    fitted: tuple[FrequencyResponse, ...]
    units: tuple[str, ...]
    band_hz: tuple[float, float]
    delay_s: Estimate
    sensor_delay_s: tuple[Estimate, ...]
    unexplained: tuple[float, ...]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return self.responses[0].sensors

    @property
    def drives(self) -> list[int]:
        """The sensor at each drive point."""
        return [self.sensors.index(each.drive_point) for each in self.responses]

    @property
    def widened_std(self) -> FloatArray:
        """Standard deviations of the residues that hold what the modes leave of a sensor beyond its noise.

        What is left about a mode out of phase with it is as large as what the residue takes in phase.
        """
        excess = np.array([each.excess for each in self.misfits])[:, np.newaxis] * np.abs(self.residues)
        return np.sqrt(self.residue_std**2 + excess**2 + self.residue_errors**2)


@dataclass(frozen=True, eq=False, repr=False)
class FittedModes(Result):
    """Linear modes of measured frequency responses, with intervals.

    Args:
        frequency_hz: natural frequency of each mode, Hz.
        damping_ratio: its fraction of critical damping.
        modal_mass_kg: its modal mass where its shape is 1 at the drive point; that at which it moves most clearly.
            Empty without a scale.
        shapes: (n_sensors, n_modes) mass-normalised shapes, kg^-1/2; that of a strain gauge is 1/m kg^-1/2. Without a
            scale they are 1 at their largest sensor; nan of a sensor that the modes do not explain.
        shape_std: their standard deviations, without that of the calibrations.
        has_scale: whether the shapes are mass-normalised: the responses do not contradict the drive points.
        sensors: names of the sensors.
        units: unit of the second derivative of each sensor's reading, m/s^2, or strain/s^2 of a strain gauge.
        band_hz: the band of the fit.
        delay_s: delay of the accelerations behind the force.
        sensor_delay_s: delay of each sensor after the others; empty where the responses ask for none.
        unexplained: rms fraction of each response that the modes leave, by drive point, without withheld sensors.
        misfits: what they leave of the responses of each sensor, and what noise leaves.
        drive_candidates: for each drive point, the sensors in which the modes have positive masses as there.
        responses: the measured responses in the band.
        fitted: those of the modes.
        warnings: one sentence each.
        settings: the options of `opid modes` by their names, and `logs`; empty if another program made the result.
        files: the files that the records were read from.
    """

    frequency_hz: tuple[Estimate, ...]
    damping_ratio: tuple[Estimate, ...]
    modal_mass_kg: tuple[Estimate, ...]
    shapes: FloatArray
    shape_std: FloatArray
    sensors: tuple[str, ...]
    units: tuple[str, ...]
    band_hz: tuple[float, float]
    delay_s: Estimate
    sensor_delay_s: tuple[Estimate, ...]
    unexplained: tuple[float, ...]
    misfits: tuple[SensorMisfit, ...]
    has_scale: bool
    drive_candidates: tuple[tuple[str, ...], ...]
    responses: tuple[FrequencyResponse, ...]
    fitted: tuple[FrequencyResponse, ...]
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[ReadFile, ...] = ()

    @property
    def modes(self) -> LinearModes:
        """The modes as a study takes them, without the sensors that have no shape.

        Raises:
            NotDeterminedError: the shapes have no scale.
        """
        if not self.has_scale:
            raise NotDeterminedError(
                "the shapes are not mass-normalised, which a study needs, because it is not known where the force "
                "acted: name the sensor at the drive point, and see the warnings of these modes"
            )
        return self._make_modes([bool(np.isfinite(row).all()) for row in self.shapes])

    @property
    def relative_modes(self) -> LinearModes:
        """The modes with all sensors, zero where one has no shape, and with any scale."""
        return self._make_modes([True] * len(self.sensors))

    def _make_modes(self, kept: Sequence[bool]) -> LinearModes:
        frequency_hz, damping = (
            np.array([each.value for each in several]) for several in (self.frequency_hz, self.damping_ratio)
        )
        sensors, units = (
            tuple(each for each, keep in zip(several, kept, strict=True) if keep)
            for several in (self.sensors, self.units)
        )
        known = LinearModes(frequency_hz, damping, np.nan_to_num(self.shapes[np.flatnonzero(kept)]), sensors)
        return with_units(known, dict(zip(sensors, units, strict=True)))

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return frequency, damping ratio and modal mass of each mode."""
        return tuple(
            SummaryRow.of(f"{name}.{number}", each, unit)
            for number, three in enumerate(
                zip(self.frequency_hz, self.damping_ratio, self.modal_mass_kg, strict=True), start=1
            )
            for name, each, unit in zip(
                ("frequency_hz", "damping_ratio", "modal_mass_kg"), three, ("Hz", "1", "kg"), strict=True
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, which docs/schemas/modes-1.schema.json describes."""
        found = {name: getattr(self, name) for name in ("band_hz", "sensors", "units", "unexplained", "warnings")}
        found |= {"has_scale": self.has_scale, "drive_candidates": self.drive_candidates}
        found["misfits"] = [asdict(each) for each in self.misfits]
        for name in ("frequency_hz", "damping_ratio", "modal_mass_kg", "sensor_delay_s"):
            found[name] = [asdict(each) for each in getattr(self, name)]
        found["delay_s"] = asdict(self.delay_s)
        shapes = {"shapes": self.shapes.tolist(), "shape_std": self.shape_std.tolist()}
        drives = [each.drive_point for each in self.responses]
        return plain({"schema": SCHEMA, **found, **shapes, "drive_points": drives, "settings": self.settings})

    def _write_headline(self) -> str:
        low_hz, high_hz = self.band_hz
        return f"{len(self.frequency_hz)} modes from {low_hz:g} to {high_hz:g} Hz"


def shape_modes(found: FittedResidues, settings: ResponseFitSettings) -> FittedModes:
    """Return the modes of fitted residues: shapes, modal masses, intervals, and what limits them.

    Raises:
        InputError: the residues at a drive point are negative.
        NotDeterminedError: no mode moves a drive point.
    """
    signs = _find_signs(found, settings)
    contradicted = _find_contradicted(found, signs)
    withheld: NDArray[np.bool_] = np.array([each.excess > settings.most_left for each in found.misfits])
    lost_drives = [drive for drive in dict.fromkeys(found.drives) if withheld[drive]]
    has_scale = not (contradicted or lost_drives)
    kept, shaped = _shape_to_scale(found, settings) if has_scale else _shape_without_scale(found)
    unlike = _find_unlike(found, kept, shaped.shapes, settings)
    apart = shaped.misfits > MODAL.most_misfit
    frequencies, ratios = _give_poles(found, kept, settings)
    frequencies, ratios, masses = (
        tuple(each.without_interval() if low else each for each, low in zip(several, unlike.tolist(), strict=True))
        for several in (frequencies, ratios, shaped.masses)
    )
    masses = tuple(each.without_interval() if off else each for each, off in zip(masses, apart.tolist(), strict=True))
    candidates = tuple(_list_candidates(found, own) for own in signs)
    warnings = (
        *_warn_of_sensors(found, withheld, settings),
        *_warn_of_drive_points(found, contradicted, candidates, lost_drives),
        *_warn_of_modes(found, kept, unlike, apart, settings),
    )
    for each in (shaped.shapes, shaped.std):
        each[withheld] = np.nan
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
                "force or that sensor counts in the other direction, so give one of them sign = -1"
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
    kept: NDArray[np.int64] = np.flatnonzero(np.max(own / of_own, axis=0) >= settings.least_std)
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


def _shape_without_scale(found: FittedResidues) -> tuple[NDArray[np.int64], _Shapes]:
    """Return all modes with shapes that are 1 at their largest sensor, by the drive point that moves each most."""
    kept = np.arange(len(found.poles))
    shapes, stds = np.empty((len(found.sensors), kept.size)), np.empty((len(found.sensors), kept.size))
    for mode in kept:
        residues, own = found.residues[..., mode], found.widened_std[..., mode]
        best = int(np.argmax(np.max(np.abs(residues) / own, axis=1)))
        largest = residues[best, int(np.argmax(np.abs(residues[best])))]
        shapes[:, mode], stds[:, mode] = residues[best] / largest, own[best] / abs(largest)
    return kept, _Shapes(shapes, stds, (Estimate(),) * kept.size, np.ones(kept.size))


def _give_poles(
    found: FittedResidues, kept: NDArray[np.int64], settings: ResponseFitSettings
) -> tuple[tuple[Estimate, ...], tuple[Estimate, ...]]:
    """Return natural frequencies and damping ratios with their intervals."""
    relative = found.pole_std.copy()
    relative[:, 0] = np.hypot(relative[:, 0], settings.complexity * found.poles[:, 1] ** 2)
    left_at_end = max(settings.left_at_end, *(each.left_at_end for each in found.responses))
    relative[:, 1] = np.hypot(relative[:, 1], left_at_end)
    frequencies, ratios = (
        tuple(Estimate.normal(value, value * std) for value, std in zip(own, of.tolist(), strict=True))
        for own, of in zip(found.poles[kept].T.tolist(), relative[kept].T, strict=True)
    )
    return frequencies, ratios


def _find_unlike(
    found: FittedResidues, kept: NDArray[np.int64], shapes: FloatArray, settings: ResponseFitSettings
) -> NDArray[np.bool_]:
    """Return at which modes the records differ by more than noise, at the sensor that the mode moves most."""
    unlike = np.zeros(kept.size, dtype=bool)
    for response in found.responses:
        if response.coherence is None:
            continue
        for column, (own_hz, ratio) in enumerate(found.poles[kept].tolist()):
            coherence = response.coherence[:, int(np.argmax(np.abs(shapes[:, column])))]
            near = _median_near(coherence, response.frequency_hz, own_hz, settings.near * ratio)
            unlike[column] |= near < settings.least_coherence
    return unlike


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
    for name, misfit, is_lost in zip(found.sensors, found.misfits, withheld, strict=True):
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
    for sensor in lost:
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


def _median_near(coherence: FloatArray, frequency_hz: FloatArray, own_hz: float, width: float) -> float:
    """Return the median of the lines within a relative width of a frequency, at least of the nearest one."""
    off = np.abs(frequency_hz / own_hz - 1)
    return float(np.median(coherence[off <= max(width, float(off.min()))]))
