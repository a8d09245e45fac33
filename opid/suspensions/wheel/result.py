"""What is found of wheel, tyre and road: the lower half of the model of a gear."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from opid.estimate import Estimate, Estimates
from opid.json_values import plain
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.recording import FloatArray
from opid.suspensions.wheel.settings import WheelSettings

SCHEMA = "opid.wheel/1"

REFERENCE_CYCLES_PER_M = 0.1
"""Spatial frequency n0 at which ISO 8608 states how rough a road is, cycles/m."""

_NOTHING = Estimate()
_CLASSES = "ABCDEFGH"
_ROUGHNESS_OF_A = 16e-6


@dataclass(frozen=True)
class WheelParameters(Estimates):
    """Wheel, tyre and the shape of the road's spectrum; empty where they are not determined.

    Where a value is too uncertain to be given, its interval is.

    Args:
        unsprung_mass_kg: M1; without a sprung mass, per kg of it.
        tyre_stiffness_n_per_m: K1, or per kg of the sprung mass.
        tyre_damping_n_s_per_m: C1, or per kg of the sprung mass.
        hop_frequency_hz: natural frequency of the wheel between tyre and strut, with the mean slopes of the strut.
        hop_damping_ratio: damping ratio of that motion.
        footprint_m: length over which the tyre averages the road.
        road_slope: exponent w of the road's spectrum Gd(n) = Gd(n0) (n/n0)^-w.
    """

    unsprung_mass_kg: Estimate = _NOTHING
    tyre_stiffness_n_per_m: Estimate = _NOTHING
    tyre_damping_n_s_per_m: Estimate = _NOTHING
    hop_frequency_hz: Estimate = _NOTHING
    hop_damping_ratio: Estimate = _NOTHING
    footprint_m: Estimate = _NOTHING
    road_slope: Estimate = _NOTHING


@dataclass(frozen=True, eq=False)
class RunRoad(Estimates):
    """The road of one run.

    Args:
        run: name of the run.
        speed_m_per_s: speed at the beginning, mean speed, and speed at the end of the run.
        roughness_m3: Gd(n0), displacement spectrum at n0 = 0.1 cycles/m.
        road_class: classes of ISO 8608 that its interval reaches, "B" or "B to C"; empty if nothing is determined.
        frequency_hz: (n_lines,) lines that were compared.
        measured: (n_lines,) mean spectrum of the rate of the force through the tyre, (N/s)^2/Hz, or per kg^2.
        fitted: (n_lines,) the same by the fitted road and tyre.
        n_blocks: (n_lines,) number of blocks that each line was compared in; others were too slow for it.
    """

    run: str
    speed_m_per_s: tuple[float, float, float]
    roughness_m3: Estimate
    road_class: str
    frequency_hz: FloatArray
    measured: FloatArray
    fitted: FloatArray
    n_blocks: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class WheelIdentification(Result):
    """Unsprung mass, tyre and road of a gear.

    Args:
        title: title of the study.
        per_mass: whether mass, stiffness and damping are per kg of the sprung mass, which is not determined.
        parameters: wheel, tyre and slope of the road.
        roads: the road of each run.
        stiffening: relative change of the tyre stiffness for a doubled speed; empty at a steady speed.
        stiffer_by_load: relative change of the tyre stiffness from the loading of the first run to that most unlike it;
            empty if all runs have one loading.
        bounds: relative standard deviations of M1, K1 and C1 below which no estimator comes on a Gaussian road under a
            linear strut (Cramer and Rao); friction in the strut tells a little more. None if nothing is determined.
        unusual: probability of the most unusual part of the normalised periodogram, times the number of parts.
        n_lines: number of lines that were compared, over all blocks and runs.
        not_determined: why nothing is given; None if something is.
        warnings: the warnings, one sentence each.
        settings: tuned numbers.
        seed: seed of the probes.
        files: the files that it was made from.
    """

    title: str
    per_mass: bool
    parameters: WheelParameters
    roads: tuple[RunRoad, ...]
    stiffening: Estimate
    stiffer_by_load: Estimate
    bounds: tuple[float, float, float] | None
    unusual: float
    n_lines: int
    not_determined: str | None
    warnings: tuple[str, ...]
    settings: WheelSettings
    seed: int
    files: tuple[ReadFile, ...] = ()

    @property
    def units(self) -> dict[str, str]:
        """Units of the parameters, by name."""
        mass, stiffness, damping = ("1", "1/s^2", "1/s") if self.per_mass else ("kg", "N/m", "N s/m")
        return {
            "unsprung_mass_kg": mass,
            "tyre_stiffness_n_per_m": stiffness,
            "tyre_damping_n_s_per_m": damping,
            "hop_frequency_hz": "Hz",
            "hop_damping_ratio": "1",
            "footprint_m": "m",
            "road_slope": "1",
        }

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return wheel, tyre, slope of the road and the roughness of each run."""
        return tuple(self._rows())

    def _rows(self) -> Iterator[SummaryRow]:
        units = self.units
        for name, estimate in self.parameters.items():
            yield SummaryRow.of(name, estimate, units[name])
        for road in self.roads:
            yield SummaryRow.of(f"{road.run}.roughness_m3", road.roughness_m3, "m^3")

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json."""
        units = self.units
        return plain(
            {
                "schema": SCHEMA,
                "title": self.title,
                "per_mass": self.per_mass,
                "parameters": {
                    name: asdict(estimate) | {"unit": units[name]} for name, estimate in self.parameters.items()
                },
                "roads": [asdict(each) for each in self.roads],
                "stiffening": asdict(self.stiffening),
                "stiffer_by_load": asdict(self.stiffer_by_load),
                "bounds": self.bounds,
                "unusual": self.unusual,
                "n_lines": self.n_lines,
                "not_determined": self.not_determined,
                "warnings": self.warnings,
                "settings": asdict(self.settings),
                "seed": self.seed,
            }
        )

    def _write_headline(self) -> str:
        return f"{self.title or 'without a title'} (wheel, tyre and road)"


def classify_road(interval_m3: tuple[float, float]) -> str:
    """Return the classes of ISO 8608 that an interval of Gd(n0) reaches, as "B" or "B to C".

    Class A has up to 32e-6 m^3, and each further one ends at four times that of the one before (ISO 8608:2016,
    table C.1). Smoother roads count as A, rougher ones as H.

    Args:
        interval_m3: lower and upper end, m^3.

    >>> classify_road((50e-6, 90e-6)), classify_road((50e-6, 200e-6))
    ('B', 'B to C')
    """
    steps = np.log(np.array(interval_m3) / _ROUGHNESS_OF_A) / np.log(4.0)
    first, last = (_CLASSES[int(np.clip(np.round(step), 0, len(_CLASSES) - 1))] for step in steps)
    return first if first == last else f"{first} to {last}"
