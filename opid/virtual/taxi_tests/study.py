"""The truth of a simulated taxi test of a gear or an aircraft, and the study that its owner would write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from datetime import date
from typing import Any

from opid.mechanics.truth import BodyNumbers, BodyTruth, GearNumbers, GearTruth, SuspensionTruth, TaxiTruth
from opid.suspensions.study import BodySensor, MeasuredInterface, PointMass, Run, StructureSettings, Study
from opid.virtual.taxi_tests.taxiing import TaxiTest


def taxi_truth(test: TaxiTest, *, settings: Mapping[str, Any] | None = None) -> TaxiTruth:
    """Return the truth of a simulated taxi test: a `GearTruth` for a gear, a `BodyTruth` for an aircraft.

    Args:
        test: the field test; its first run is the reference.
        settings: the settings of the simulation, which are kept as they are.
    """
    airframe, given = test.runs[0].airframe, dict(settings or {})
    if airframe.is_one_gear:
        gear = test.heavy.gear
        numbers = GearNumbers(*(getattr(gear, each.name) for each in fields(GearNumbers)))
        return GearTruth(numbers, gear.law, test.mass_change_kg, given)
    assert airframe.ixx_kg_m2 is not None  # only a gear alone may lack it
    assert airframe.iyy_kg_m2 is not None
    return BodyTruth(
        BodyNumbers(airframe.mass_kg, airframe.ixx_kg_m2, airframe.iyy_kg_m2, airframe.x_cg_m, airframe.y_cg_m),
        {
            gear.name: SuspensionTruth(
                gear.x_m, gear.y_m, gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m, gear.law
            )
            for gear in airframe.gears
        },
        {
            name: tuple((each.mass_kg, each.x_m, each.y_m) for each in loading)
            for name, loading in zip(name_runs(test), test.loadings, strict=True)
        },
        given,
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
    """Return the study of a simulated taxi test, as the owner of the aircraft would write it.

    Args:
        test: the field test; its first run is the reference.
        title: the title of the study.
        shared: names of gears that have the same stiffness, damping and law.
        position_tolerance_m: tolerance that is stated for the coordinates of an aircraft.
        noise_m_per_s2: rms noise that is stated for the sensors of an aircraft; None if it is not known.
        day: day of the runs.
    """
    first = test.runs[0]
    is_one_gear = first.airframe.is_one_gear
    positions, n_gears = first.places_m, len(first.airframe.gears)
    channels, interfaces = [*positions], []
    for gear, unsprung, sprung in zip(
        first.airframe.gears, channels[:n_gears], channels[n_gears : 2 * n_gears], strict=True
    ):
        beside = () if positions[sprung] == (gear.x_m, gear.y_m) else positions[sprung]
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
            for name, run, loading in zip(name_runs(test), test.runs, test.loadings, strict=True)
        ),
        structure=StructureSettings() if is_one_gear else structure,
        sensors=tuple(BodySensor(name, *positions[name]) for name in channels[2 * n_gears :]),
        date=day,
    )


def name_runs(test: TaxiTest) -> list[str]:
    """Return the names of the runs: the reference, and those with loadings."""
    first, further = ("heavy", "light") if test.runs[0].airframe.is_one_gear else ("reference", "loaded")
    if len(test.runs) == 2:
        return [first, further]
    return [first, *(f"{further}_{number}" for number in range(1, len(test.runs)))]
