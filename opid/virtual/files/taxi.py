"""What is true of a simulated taxi test of a gear or an aircraft, and the study that its owner would make of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from datetime import date
from typing import Any

from opid.mechanics.laws.law import Law, law_from_parameters
from opid.suspensions.result import BodyParameters, GearParameters
from opid.suspensions.study import (
    BodySensor,
    MeasuredInterface,
    PointMass,
    Run,
    StructureSettings,
    Study,
)
from opid.virtual.files.truth import TruthKind
from opid.virtual.taxi_tests.taxiing import TaxiTest

_SLOPES = {
    "stiffness_n_per_m": "suspension_stiffness_n_per_m",
    "damping_n_s_per_m": "suspension_damping_n_s_per_m",
}


def _check_gear(truth: dict[str, Any]) -> None:
    truth["parameters"] = {each.name: float(truth["parameters"][each.name]) for each in fields(GearParameters)}
    law_from_parameters(truth["law"]["name"], truth["law"]["parameters"])


def _check_body(truth: dict[str, Any]) -> None:
    truth["parameters"] = {each.name: float(truth["parameters"][each.name]) for each in fields(BodyParameters)}
    for gear in truth["interfaces"].values():
        gear |= {name: float(gear[name]) for name in _SLOPES}
        law_from_parameters(gear["law"]["name"], gear["law"]["parameters"])


GEAR_TRUTH = TruthKind("opid.truth/1", "a simulated field test", "opid simulate", _check_gear)
BODY_TRUTH = TruthKind("opid.body-truth/1", "a simulated aircraft", "opid simulate aircraft", _check_body)


def taxi_truth(test: TaxiTest, *, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what is true of a simulated taxi test, under the names of result.json.

    Args:
        test: the field test; its first run is the reference.
        settings: what it was simulated with, kept as they are.

    Returns:
        Of a gear `schema`, `parameters` {name: value}, `law` {name, parameters}, `mass_change_kg`, `settings`; of an
        aircraft `schema`, `parameters`, `interfaces` {gear: {x_m, y_m, stiffness_n_per_m, damping_n_s_per_m, law}},
        `loadings` {run: rows of mass_kg, x_m, y_m}, `settings`.
    """
    airframe = test.runs[0].airframe
    if airframe.is_one_gear:
        return GEAR_TRUTH.content(
            settings,
            parameters={each.name: getattr(test.heavy.gear, each.name) for each in fields(GearParameters)},
            law=_law_table(test.heavy.gear.law),
            mass_change_kg=test.mass_change_kg,
        )
    return BODY_TRUTH.content(
        settings,
        parameters={
            "sprung_mass_kg": airframe.mass_kg,
            "roll_inertia_kg_m2": airframe.ixx_kg_m2,
            "pitch_inertia_kg_m2": airframe.iyy_kg_m2,
            "x_cg_m": airframe.x_cg_m,
            "y_cg_m": airframe.y_cg_m,
        },
        interfaces={
            gear.name: {
                "x_m": gear.x_m,
                "y_m": gear.y_m,
                **{name: getattr(gear, field) for name, field in _SLOPES.items()},
                "law": _law_table(gear.law),
            }
            for gear in airframe.gears
        },
        loadings={
            name: [[each.mass_kg, each.x_m, each.y_m] for each in loading]
            for name, loading in zip(run_names(test), test.loadings, strict=True)
        },
    )


def taxi_study(
    test: TaxiTest,
    *,
    title: str,
    shared: Sequence[Sequence[str]] = (),
    position_tolerance_m: float = 0.0,
    noise_m_per_s2: float | None = None,
    day: date | None = None,
) -> Study:
    """Return the study of a simulated taxi test: what its owner knows of it.

    Args:
        test: the field test; its first run is the reference.
        title: of the study.
        shared: names of gears that are to share stiffness, damping and law.
        position_tolerance_m: how well the places of an aircraft are said to be known.
        noise_m_per_s2: what the rms noise of the sensors of an aircraft is said to be; None where it is not known.
        day: of the runs.
    """
    first = test.runs[0]
    is_one_gear = first.airframe.is_one_gear
    places, n_gears = first.places_m, len(first.airframe.gears)
    channels, interfaces = [*places], []
    for gear, unsprung, sprung in zip(
        first.airframe.gears, channels[:n_gears], channels[n_gears : 2 * n_gears], strict=True
    ):
        beside = () if places[sprung] == (gear.x_m, gear.y_m) else places[sprung]
        interfaces.append(MeasuredInterface(gear.name or "gear", sprung, unsprung, gear.x_m, gear.y_m, *beside))
    structure = StructureSettings(
        shared=tuple(tuple(group) for group in shared),
        position_tolerance_m=position_tolerance_m,
        noise_m_per_s2=noise_m_per_s2,
    )
    return Study(
        title=title,
        interfaces=tuple(interfaces),
        runs=tuple(
            Run(name, run.recording, tuple(PointMass(each.mass_kg, each.x_m, each.y_m) for each in loading))
            for name, run, loading in zip(run_names(test), test.runs, test.loadings, strict=True)
        ),
        structure=StructureSettings() if is_one_gear else structure,
        sensors=tuple(BodySensor(name, *places[name]) for name in channels[2 * n_gears :]),
        date=day,
    )


def run_names(test: TaxiTest) -> list[str]:
    """Return what the runs are called: the reference, and those with loadings.

    Args:
        test: the field test.
    """
    first, further = ("heavy", "light") if test.runs[0].airframe.is_one_gear else ("reference", "loaded")
    if len(test.runs) == 2:
        return [first, further]
    return [first, *(f"{further}_{number}" for number in range(1, len(test.runs)))]


def _law_table(law: Law) -> dict[str, Any]:
    return {"name": law.name, "parameters": law.parameters}
