"""The estimator as the benchmarks call it: the only file of them that changes when its names do."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import date
from typing import Any

import numpy as np

from opid.mechanics.airframe import Loading
from opid.signals.recording import Recording
from opid.suspensions.identification import identify_body
from opid.suspensions.one_gear.identification import identify_study, strongest_pair
from opid.suspensions.one_gear.result import PARAMETERS, Identification
from opid.suspensions.one_gear.study import Run, Study
from opid.suspensions.result import BodyIdentification
from opid.suspensions.sensor_facts import IDEAL_PAIR, SensorPair
from opid.suspensions.study import BodyStudy, LoadedRun, MeasuredInterface, PointMass, StructureSettings

AnyStudy = Study | BodyStudy
GearIdentification = Identification
AircraftIdentification = BodyIdentification
GEAR_PARAMETERS = PARAMETERS
GearStudy = Study
GearRun = Run


def gear_study(
    title: str,
    runs: Iterable[tuple[str, Recording, float]],
    *,
    sprung: str = "upper_z",
    unsprung: str = "lower_z",
    sensors: SensorPair = IDEAL_PAIR,
) -> Study:
    """Return the study of one gear from (name, recording, mass change in kg) of each run."""
    told = tuple(Run(name, recording, change_kg) for name, recording, change_kg in runs)
    return Study(title, sprung=sprung, unsprung=unsprung, runs=told, sensors=sensors)


def aircraft_study(
    title: str,
    interfaces: Iterable[MeasuredInterface],
    runs: Iterable[tuple[str, Recording, Iterable[Loading]]],
    structure: StructureSettings,
    *,
    date: date | None = None,
) -> BodyStudy:
    """Return the study of an aircraft from (name, recording, loading) of each run."""
    told = tuple(
        LoadedRun(name, recording, tuple(PointMass(each.mass_kg, each.x_m, each.y_m) for each in loading))
        for name, recording, loading in runs
    )
    return BodyStudy(title, tuple(interfaces), told, structure, date=date)


def identify(
    study: AnyStudy,
    *,
    method: str = "model",
    law: str | None = None,
    ground: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Any:
    """Identify a study of a gear or of an aircraft; of the aircraft no ground spring is fitted today."""
    if isinstance(study, BodyStudy):
        return identify_body(study, law=law, progress=progress)
    return identify_study(study, method=method, law=law, ground=ground, progress=progress)


def residual_over_noise(found: Any) -> float:
    """Return what an identification leaves over the noise of the sensors."""
    one_gear = "unexplained_over_floor" in found.diagnostics
    return float(found.diagnostics["unexplained_over_floor"] if one_gear else found.residual_over_noise)


def printed_mass_kg(found: GearIdentification) -> float:
    """Return the mass by the paper's printed formula on the strongest pair of peaks; NaN without a pair."""
    pair = strongest_pair(found.evidence.pairs)
    return pair.as_printed.sprung_mass_kg if pair and pair.as_printed else np.nan


def stiffness_per_mass(found: GearIdentification) -> tuple[float, float]:
    """Return K2/M2 of the first two runs, each by complex least squares on its own lines, 1/s^2."""
    first, second = (run.complex_fit.value[0] for run in found.evidence.runs)
    return first, second
