"""The linear modes that were found in measured frequency responses, and their content in result.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from opid.estimate import Estimate
from opid.json_values import plain
from opid.modal.linear.frequency_response import FrequencyResponse
from opid.modal.linear.modes import LinearModes, with_units
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray

SCHEMA = "opid.modes/1"


@dataclass(frozen=True, eq=False, repr=False)
class FittedModes(Result):
    """Linear modes of measured frequency responses, with intervals.

    Args:
        frequency_hz: natural frequency of each mode, Hz.
        damping_ratio: its fraction of critical damping.
        modal_mass_kg: its modal mass where its shape is 1 at the drive point; that at which it moves most clearly.
        shapes: (n_sensors, n_modes) mass-normalised shapes, kg^-1/2; that of a strain gauge is 1/m kg^-1/2.
        shape_std: their standard deviations, without that of the calibrations.
        sensors: names of the sensors.
        units: unit of the second derivative of each sensor's reading, m/s^2, or strain/s^2 of a strain gauge.
        band_hz: the band of the fit.
        delay_s: delay of the accelerations behind the force.
        unexplained: rms fraction of each response that the modes leave, by drive point.
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
    unexplained: tuple[float, ...]
    responses: tuple[FrequencyResponse, ...]
    fitted: tuple[FrequencyResponse, ...]
    warnings: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    files: tuple[ReadFile, ...] = ()

    @property
    def modes(self) -> LinearModes:
        """The modes as a study takes them."""
        frequency_hz, damping = (
            np.array([each.value for each in several]) for several in (self.frequency_hz, self.damping_ratio)
        )
        known = LinearModes(frequency_hz, damping, self.shapes, self.sensors)
        return with_units(known, dict(zip(self.sensors, self.units, strict=True)))

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
        for name in ("frequency_hz", "damping_ratio", "modal_mass_kg"):
            found[name] = [asdict(each) for each in getattr(self, name)]
        found["delay_s"] = asdict(self.delay_s)
        shapes = {"shapes": self.shapes.tolist(), "shape_std": self.shape_std.tolist()}
        drives = [each.drive_point for each in self.responses]
        return plain({"schema": SCHEMA, **found, **shapes, "drive_points": drives, "settings": self.settings})

    def _write_headline(self) -> str:
        low_hz, high_hz = self.band_hz
        return f"{len(self.frequency_hz)} modes from {low_hz:g} to {high_hz:g} Hz"
