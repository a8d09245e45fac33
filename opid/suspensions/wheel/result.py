"""What is found of wheel, tyre and road, the lower half of the model of a gear, and the tuned numbers for it."""

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

SCHEMA = "opid.wheel/1"

REFERENCE_CYCLES_PER_M = 0.1
"""Spatial frequency n0 at which ISO 8608 states how rough a road is, cycles/m."""

_NOTHING = Estimate()
_CLASSES = "ABCDEFGH"
_ROUGHNESS_OF_A = 16e-6


@dataclass(frozen=True)
class WheelSettings:
    """The tuned numbers of the estimator of wheel, tyre and road.

    Args:
        block_s: length of the blocks whose spectra are compared, s. Blocks of 2 s smeared the steep spectrum at the
            lowest lines and biased K1 by half a standard deviation; in longer ones the speed of a braking run changes.
        band_hz: lines that are compared, Hz: the bounce of the sprung mass, whose frequency depends on the tyre,
            belongs to it; without the lines from 1 to 2 Hz K1 has three times the standard deviation.
        highest_fraction: lines above this fraction of the sampling rate are not compared: the filters of loggers cut
            there.
        shortest_wave_m: shorter waves of the road are not compared: the tyre bridges them, and how it does so is known
            by one number, its footprint, only well above the footprint.
        least_steady: a block is left out if its lowest speed is less than this fraction of its highest one.
        n_speeds: number of speeds at which the spectrum of the road is averaged within a block.
        least_lines: a study with fewer lines below this wave length is refused.
        slope: usual slope of the spectrum of a road, that of ISO 8608 ...
        slope_std: ... and its standard deviation over measured roads.
        footprint_m: usual length over which a tyre averages the road ...
        footprint_std_m: ... and its standard deviation, from a light aircraft to a large one.
        most_left: a gear whose model leaves more than this times the noise of the sensors is refused: what pushes the
            body beside the strut passes for a force of the road.
        n_probes: random forces by which the mean response of the gear with its nonlinear strut is computed; with eight
            the result of another seed differs by less than a tenth of a standard deviation.
        probe_margin: the probes reach beyond the compared band by this factor, so that its edges are excited alike.
        most_rounds: most times that this response is computed anew ...
        settled_std: ... until no parameter moves by more than this fraction of its standard deviation.
        most_steps: most steps of the fit between two of them.
        largest_step: largest change of the logarithm of a mass or stiffness in one step.
        start_masses: unsprung over sprung mass at which the search begins ...
        start_tyre_hz: ... and frequency of the sprung mass on the tyre alone, Hz.
        rejected_p: the fit is rejected if the most unusual block, band or line of its normalised periodogram has a
            smaller probability, after division by their number.
        bands_per_octave: width of those bands.
        loosely_known: a warning names the values whose standard deviation exceeds this fraction of them.
        unequal_std: a tyre is called nonlinear if its stiffness changes by more standard deviations.
    """

    block_s: float = 4.0
    band_hz: tuple[float, float] = (1.0, 40.0)
    highest_fraction: float = 0.4
    shortest_wave_m: float = 0.4
    least_steady: float = 0.5
    n_speeds: int = 8
    least_lines: int = 200
    slope: float = 2.0
    slope_std: float = 0.5
    footprint_m: float = 0.25
    footprint_std_m: float = 0.15
    most_left: float = 1.5
    n_probes: int = 8
    probe_margin: float = 1.5
    most_rounds: int = 12
    settled_std: float = 0.05
    most_steps: int = 40
    largest_step: float = 0.5
    start_masses: tuple[float, ...] = (0.03, 0.06, 0.12)
    start_tyre_hz: tuple[float, ...] = (1.5, 2.5, 4.0, 6.0)
    rejected_p: float = 1e-3
    bands_per_octave: float = 2.0
    loosely_known: float = 0.25
    unequal_std: float = 2.5


@dataclass(frozen=True)
class WheelParameters(Estimates):
    """Wheel, tyre and the shape of the road's spectrum; empty where they are not determined.

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
        stiffer_by_load: relative change of the tyre stiffness from the loading of the first run to that most unlike it;
            empty if all runs have one loading.
        stiffer_by_force: relative change of the tangent stiffness of the tyre at the rms of its force, by a cubic term.
        bounds: relative standard deviations of M1, K1 and C1 below which no estimator comes on a Gaussian road under a
            linear strut (Cramer and Rao); friction in the strut tells a little more. None if nothing is determined.
        unusual: probability of the least probable block, band or line of the normalised spectra, times their number, at
            most 1.
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
    stiffer_by_load: Estimate
    stiffer_by_force: Estimate
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
                "stiffer_by_load": asdict(self.stiffer_by_load),
                "stiffer_by_force": asdict(self.stiffer_by_force),
                "bounds": self.bounds,
                "unusual": self.unusual,
                "not_determined": self.not_determined,
                "warnings": self.warnings,
                "n_lines": self.n_lines,
                "seed": self.seed,
                "settings": asdict(self.settings),
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
