"""The estimator as the benchmarks call it: the only file of them that changes when its names do."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import date
from typing import Any

import numpy as np

from opid.signals.recording import Recording
from opid.suspensions.identification import identify as identify_study
from opid.suspensions.paper.chain import PaperChain
from opid.suspensions.paper.result import PaperIdentification
from opid.suspensions.result import Identification
from opid.suspensions.sensor_facts import IDEAL_PAIR, SensorPair
from opid.suspensions.study import MeasuredInterface, PointMass, Run, StructureSettings, Study, study_of_gear

AnyStudy = Study
GearIdentification = Identification | PaperIdentification
AircraftIdentification = Identification
GearStudy = Study
GearRun = Run

__all__ = ["aircraft_study", "gear_study", "identify"]


def gear_study(
    title: str,
    runs: Iterable[tuple[str, Recording, float]],
    *,
    sprung: str = "upper_z",
    unsprung: str = "lower_z",
    sensors: SensorPair = IDEAL_PAIR,
    repeatability: float | None = None,
) -> Study:
    """Return the study of one gear from (name, recording, mass change in kg) of each run."""
    told = tuple(Run(name, recording, change_kg) for name, recording, change_kg in runs)
    return study_of_gear(
        title, sprung=sprung, unsprung=unsprung, runs=told, sensors=sensors, repeatability=repeatability
    )


def aircraft_study(
    title: str,
    interfaces: Iterable[MeasuredInterface],
    runs: Iterable[tuple[str, Recording, tuple[PointMass, ...]]],
    structure: StructureSettings,
    *,
    date: date | None = None,
) -> Study:
    """Return the study of an aircraft from (name, recording, loading) of each run, the same struts in all."""
    told = tuple(Run(name, recording, loading) for name, recording, loading in runs)
    return Study(title, tuple(interfaces), told, structure, repeatability=0.0, date=date)


def identify(
    study: Study,
    *,
    method: str = "model",
    law: str | None = None,
    ground: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Any:
    """Identify a study of a gear or of an aircraft."""
    return identify_study(study, method=method, law=law, ground=ground, progress=progress)


def residual_over_noise(found: GearIdentification) -> float:
    """Return what an identification leaves over the noise of the sensors."""
    return found.residual_over_noise


def printed_mass_kg(found: GearIdentification) -> float:
    """Return the mass by the paper's chain as printed on the strongest pair of peaks; NaN without a pair."""
    pair = _chain(found).strongest_pair
    return pair.as_printed.sprung_mass_kg if pair and pair.as_printed else np.nan


def stiffness_per_mass(found: GearIdentification) -> tuple[float, float]:
    """Return K2/M2 of the first two runs, each by complex least squares on its own lines, 1/s^2."""
    first, second, *_ = (run.complex_fit.value[0] for run in _chain(found).runs)
    return first, second


def _chain(found: GearIdentification) -> PaperChain:
    return found.chain if isinstance(found, PaperIdentification) else found.paper_chain
