"""What virtual sensors give: time histories with bands, static values, and cycles of the strut forces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from opid.estimate import Estimate
from opid.json_values import plain
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import Channel, FloatArray, Recording
from opid.suspensions.sensing.settings import SensingSettings

SCHEMA = "opid.sensing/1"

Quantity = Literal["strut_force", "strut_load", "tyre_force", "travel", "travel_velocity", "acceleration", "velocity"]
"""The quantities of virtual sensors: forces in N (per unit of mass m/s^2), and motion in m, m/s and m/s^2."""


@dataclass(frozen=True, eq=False)
class VirtualSensor:
    """A quantity along a record, with the standard deviation of each sample.

    Args:
        name: name of its channel in the log that is written.
        quantity: the quantity.
        place: name of its interface, or of a place on the body; empty for one gear.
        unit: SI unit.
        value: (n,) likeliest values.
        std: (n,) standard deviations: noise of the sensors, their tolerances, and uncertainty of the parameters.
    """

    name: str
    quantity: Quantity
    place: str
    unit: str
    value: FloatArray
    std: FloatArray

    @property
    def rms(self) -> Estimate:
        """Rms over the record, about zero for a motion and about the mean for a force; its error is at most this."""
        size = float(np.sqrt(np.mean((self.value - (self.value.mean() if "force" in self.quantity else 0.0)) ** 2)))
        return Estimate.normal(size, float(np.sqrt(np.mean(self.std**2))))

    @property
    def largest(self) -> Estimate:
        """The value that is farthest from zero."""
        k = int(np.argmax(np.abs(self.value)))
        return Estimate.normal(float(self.value[k]), float(self.std[k]))


@dataclass(frozen=True, eq=False)
class Rainflow:
    """Cycles of a strut force by their range, counted by ASTM E1049.

    Args:
        place: name of the interface.
        edges_n: (n_bins + 1,) edges of the ranges, N, or per unit of mass.
        cycles: (n_bins,) number of cycles of the likeliest force; half cycles count one half.
        std: (n_bins,) standard deviation of the number over the forces that the readings allow.
        least_range_n: ranges below this are as small as the band: their cycles may be those of noise.
    """

    place: str
    edges_n: FloatArray
    cycles: FloatArray
    std: FloatArray
    least_range_n: float


@dataclass(frozen=True)
class StaticValue:
    """A value of a suspension at rest in this record.

    Args:
        place: name of the interface.
        load_n: static force on the body, N; empty where the weight is unknown or statics does not determine it.
        travel_m: static travel from the position of rest in the reference run, m.
    """

    place: str
    load_n: Estimate
    travel_m: Estimate


@dataclass(frozen=True, eq=False, repr=False)
class Sensing(Result):
    """Virtual sensors along one record.

    Args:
        title: title of the study.
        run: name of the record.
        fs: sampling rate, Hz.
        start_s: time of the first sample, s.
        per_mass: whether forces are per unit of mass, because the result has no mass.
        sensors: the virtual sensors.
        static: values at rest, for each interface.
        rainflow: cycles of the strut forces.
        over_noise: residual of the readings of this record over the noise of the sensors, for each fit.
        widened: factor on the noise of the sensors, because the model leaves more than that in this record.
        unmeasured_m_per_s2: rms acceleration of the body by unmeasured forces, which the bands hold; 0 for none.
        warnings: the warnings, one sentence each.
        settings: tuned numbers.
        seed: seed of the draws.
        files: the files that it was made from.
    """

    title: str
    run: str
    fs: float
    start_s: float
    per_mass: bool
    sensors: tuple[VirtualSensor, ...]
    static: tuple[StaticValue, ...]
    rainflow: tuple[Rainflow, ...]
    over_noise: tuple[float, ...]
    widened: float
    unmeasured_m_per_s2: float
    warnings: tuple[str, ...]
    settings: SensingSettings
    seed: int
    files: tuple[ReadFile, ...] = ()

    def sensor(self, name: str) -> VirtualSensor:
        """Return the virtual sensor of a channel.

        Args:
            name: name of the channel.

        Raises:
            InputError: there is no such channel.
        """
        return self.sensors[self.to_recording().index(name) // 2]

    def to_recording(self) -> Recording:
        """Return all virtual sensors as a recording; the channel NAME_std after each has its standard deviation."""
        columns = np.stack([column for each in self.sensors for column in (each.value, each.std)], axis=1)
        channels = [Channel(f"{each.name}{end}", each.unit) for each in self.sensors for end in ("", "_std")]
        history = ("computed by virtual sensors; NAME_std is one standard deviation of NAME",)
        return Recording(columns, self.fs, tuple(channels), self.start_s, history, self.files)

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return rms of each virtual sensor, its value farthest from zero, and the values at rest."""
        return tuple(self._rows())

    def _rows(self) -> Iterator[SummaryRow]:
        force = "m/s^2" if self.per_mass else "N"
        for each in self.sensors:
            yield SummaryRow.of(f"{each.name}.rms", each.rms, each.unit)
            yield SummaryRow.of(f"{each.name}.largest", each.largest, each.unit)
        for rest in self.static:
            prefix = f"{rest.place}." if rest.place else ""
            yield SummaryRow.of(f"{prefix}static_load_n", rest.load_n, force)
            yield SummaryRow.of(f"{prefix}static_travel_m", rest.travel_m, "m")

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json: numbers and cycles; the time histories are in the log."""
        return plain(
            {
                "schema": SCHEMA,
                "title": self.title,
                "run": self.run,
                "fs": self.fs,
                "start_s": self.start_s,
                "n_samples": len(self.sensors[0].value),
                "per_mass": self.per_mass,
                "sensors": [
                    {
                        "name": each.name,
                        "quantity": each.quantity,
                        "place": each.place,
                        "unit": each.unit,
                        "rms": asdict(each.rms),
                        "largest": asdict(each.largest),
                    }
                    for each in self.sensors
                ],
                "static": [asdict(each) for each in self.static],
                "rainflow": [asdict(each) for each in self.rainflow],
                "over_noise": self.over_noise,
                "widened": self.widened,
                "unmeasured_m_per_s2": self.unmeasured_m_per_s2,
                "warnings": self.warnings,
                "settings": asdict(self.settings),
                "seed": self.seed,
            }
        )

    def _write_headline(self) -> str:
        return f"{len(self.sensors)} virtual sensors along {self.run!r}, {len(self.sensors[0].value) / self.fs:.4g} s"
