"""A simulated field test of a whole aircraft on disk: its logs, the study that names them, and the truth."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any

from opid.json_values import json_text, plain
from opid.mechanics.laws.law import law_from_parameters
from opid.signals.directory import made_directory
from opid.signals.files import written_whole
from opid.studies.study_file import write_study
from opid.suspensions.result import BodyParameters
from opid.suspensions.study import (
    BodySensor,
    MeasuredInterface,
    PointMass,
    Run,
    StructureSettings,
    Study,
)
from opid.virtual.files.truth import read_truth_file
from opid.virtual.taxi_tests.taxiing_aircraft import AircraftTest

TRUTH_SCHEMA = "opid.body-truth/1"
_SLOPES = {
    "stiffness_n_per_m": "suspension_stiffness_n_per_m",
    "damping_n_s_per_m": "suspension_damping_n_s_per_m",
}


def body_truth_json(test: AircraftTest, *, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what is true of a simulated field test of an aircraft, under the names of result.json.

    Args:
        test: the field test; its first run is the reference.
        settings: what it was simulated with, kept as they are.

    Returns:
        `schema`, `parameters` {name: value}, `interfaces` {gear: {x_m, y_m, stiffness_n_per_m, damping_n_s_per_m, law
        {name, parameters}}}, `loadings` {run: rows of mass_kg, x_m, y_m}, `settings`.
    """
    airframe = test.runs[0].airframe
    return plain(
        {
            "schema": TRUTH_SCHEMA,
            "parameters": {
                "sprung_mass_kg": airframe.mass_kg,
                "roll_inertia_kg_m2": airframe.ixx_kg_m2,
                "pitch_inertia_kg_m2": airframe.iyy_kg_m2,
                "x_cg_m": airframe.x_cg_m,
                "y_cg_m": airframe.y_cg_m,
            },
            "interfaces": {
                gear.name: {
                    "x_m": gear.x_m,
                    "y_m": gear.y_m,
                    **{name: getattr(gear, field) for name, field in _SLOPES.items()},
                    "law": {"name": gear.law.name, "parameters": gear.law.parameters},
                }
                for gear in airframe.gears
            },
            "loadings": {
                name: [[each.mass_kg, each.x_m, each.y_m] for each in loading]
                for name, loading in zip(run_names(len(test.runs)), test.loadings, strict=True)
            },
            "settings": dict(settings or {}),
        }
    )


def study_of_aircraft(
    test: AircraftTest,
    *,
    title: str,
    shared: Sequence[Sequence[str]] = (),
    position_tolerance_m: float = 0.0,
    noise_m_per_s2: float | None = None,
    day: date | None = None,
) -> Study:
    """Return the study of a simulated field test of an aircraft: what its owner knows of it.

    Args:
        test: the field test; its first run is the reference.
        title: of the study.
        shared: names of gears that are to share stiffness, damping and law.
        position_tolerance_m: how well the places are said to be known.
        noise_m_per_s2: what the rms noise of the sensors is said to be; None where it is not known.
        day: of the runs.
    """
    first = test.runs[0]
    interfaces = []
    for gear in first.airframe.gears:
        upper, lower = f"{gear.name}_upper_z", f"{gear.name}_lower_z"
        place = first.places_m[upper]
        beside = () if place == (gear.x_m, gear.y_m) else place
        interfaces.append(MeasuredInterface(gear.name, upper, lower, gear.x_m, gear.y_m, *beside))
    paired = {channel for interface in interfaces for channel in (interface.sprung, interface.unsprung)}
    return Study(
        title=title,
        interfaces=tuple(interfaces),
        runs=tuple(
            Run(name, run.recording, tuple(PointMass(each.mass_kg, each.x_m, each.y_m) for each in loading))
            for name, run, loading in zip(run_names(len(test.runs)), test.runs, test.loadings, strict=True)
        ),
        structure=StructureSettings(
            shared=tuple(tuple(group) for group in shared),
            position_tolerance_m=position_tolerance_m,
            noise_m_per_s2=noise_m_per_s2,
        ),
        sensors=tuple(BodySensor(name, *place) for name, place in first.places_m.items() if name not in paired),
        date=day,
    )


def write_aircraft_test(
    test: AircraftTest,
    directory: str | os.PathLike[str],
    *,
    title: str,
    settings: Mapping[str, Any] | None = None,
    **facts: Any,
) -> Path:
    """Write a log for each run, study.toml and truth.json, and return the path of the study.

    Args:
        test: the field test; its first run is the reference.
        directory: made if it is not there.
        title: of the study.
        settings: as in `body_truth_json`.
        facts: as in `study_of_aircraft`.

    Raises:
        InputError: a place that cannot be written to, or what no study can be.
    """
    study = study_of_aircraft(test, title=title, **facts)
    target = made_directory(directory)
    write_study(study, target / "study.toml")
    with written_whole(target / "truth.json") as file:
        file.write(json_text(body_truth_json(test, settings=settings)))
    return target / "study.toml"


def read_body_truth(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read the truth.json of a simulated aircraft.

    Args:
        path: the file.

    Raises:
        InputError: no such file, or none of `body_truth_json`'s making.
    """

    def check(truth: dict[str, Any]) -> None:
        truth["parameters"] = {each.name: float(truth["parameters"][each.name]) for each in fields(BodyParameters)}
        for gear in truth["interfaces"].values():
            gear |= {name: float(gear[name]) for name in _SLOPES}
            law_from_parameters(gear["law"]["name"], gear["law"]["parameters"])

    return read_truth_file(
        path, schema=TRUTH_SCHEMA, what="a simulated aircraft", command="opid simulate aircraft", check=check
    )


def run_names(n_runs: int) -> list[str]:
    """Return what the runs of a field test are called: the reference, and those with loadings.

    Args:
        n_runs: number of runs.

    >>> run_names(2), run_names(3)
    (['reference', 'loaded'], ['reference', 'loaded_1', 'loaded_2'])
    """
    further = ["loaded"] if n_runs == 2 else [f"loaded_{number}" for number in range(1, n_runs)]
    return ["reference", *further][:n_runs]
