"""The linear modes that were found in measured frequency responses, and their content in result.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from opid.errors import NotDeterminedError
from opid.estimate import Estimate
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
        split_distance: two poles that are tried in the place of one begin as far to either side of it, in damping
            ratios: from within its width the search finds either order.
        split_width: they are fitted to the lines that are as near to it, in damping ratios: its flanks tell its
            damping, and farther away other modes count more.
        split_left: they are two modes if they leave less than this fraction of what one leaves beyond noise about it:
            two close modes left less than 1e-5, and two poles of one mode that stiffens 0.07 to 0.2 ...
        split_part: ... if the lesser has residues of at least this part of the other's: that of two close modes was
            0.65, and of a broad pole that explains what a nonlinear neighbour leaves at most 0.003 ...
        split_alike: ... and if the MAC of their shapes is below this: two poles that explain one mode with a nonlinear
            joint have one shape.
        doubled: modes with such a MAC that are nearer than this, in damping ratios, are one that two poles explain.
        hidden_part: residue and damping of a mode whose frequency moves as it decays are off by so many times the
            part that its pole leaves of it ...
        hidden_shift: ... and its frequency by so many times this, over the width: the pole follows the mean of the
            shift. `benchmarks/adversary.py` prints springs that stiffen and soften, for which both hold.
        fewest_lines: lines in that width from which on they are tried: two poles have 4 unknowns.
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
        least_at_drive: so is one whose residue at the drive points is, where shapes have a scale: the mass is one over
            it, and those of 6 to 8 deviations, which noise had raised above 6, were up to 42 % off.
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
    split_distance: float = 0.5
    split_width: float = 8.0
    split_left: float = 0.03
    split_part: float = 0.05
    split_alike: float = 0.8
    doubled: float = 4.0
    hidden_part: float = 1.5
    hidden_shift: float = 2.0
    fewest_lines: int = 16
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
    least_at_drive: float = 10.0
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
            scale they are 1 at the largest of their sensors; nan of a sensor that is clipped, or that the modes do not
            explain.
        shape_std: their standard deviations, without that of the calibrations; nan where records differ, or where one
            mode was found as two poles.
        has_scale: whether the shapes are mass-normalised: the responses do not contradict the drive points, whose
            sensors have shapes, and no force is clipped.
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
    def each_stage(self) -> tuple[FittedModes, ...]:
        """These modes alone: all records are of one stage (`ModeStages` has several)."""
        return (self,)

    @property
    def modes(self) -> LinearModes:
        """The modes as a study takes them, without the sensors that have no shape.

        Raises:
            NotDeterminedError: the shapes have no scale.
        """
        if not self.has_scale:
            raise NotDeterminedError(
                "the shapes are not mass-normalised, which a study needs: the warnings of these modes say why, and "
                "what to do"
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
