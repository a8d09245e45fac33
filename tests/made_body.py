"""The identification of an aircraft on three gears, made by hand from its truth, and a short field test of it."""

from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np

from opid.estimate import Estimate
from opid.signals.recording import recording_from_arrays
from opid.suspensions.law_search.pursuit import library
from opid.suspensions.result import (
    BodyParameters,
    BodyRatios,
    Candidate,
    Identification,
    InterfaceEstimate,
    Options,
    RunResidual,
)
from opid.suspensions.settings import Settings
from opid.suspensions.study import BodySensor, MeasuredInterface, PointMass, Run, StructureSettings, Study
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.taxiing import taxi_test

PLACES = {"nose": (5.3, 0.2), "left": (0.25, 1.4), "right": (0.25, -1.4)}
"""Of the sensors on the airframe, beside the struts."""
LOADING = (PointMass(500.0, -1.0, 0.2),)
WHY = "one rigid body leaves 1.02 times the sensors' noise; each gear alone leaves 39.4 times the noise"


def short_test(**settings):
    """Two runs of 8 s at 128 Hz, with a further sensor at the tail."""
    given = {"duration_s": 8.0, "fs": 128.0, "lowest_step_rate_hz": 1024.0, **settings}
    further = {"tail": (-4.0, 0.0)}
    return taxi_test(
        default_aircraft(),
        rng=np.random.default_rng(3),
        loadings=[LOADING],
        sprung_sensors=PLACES,
        further_sensors=further,
        **given,
    )


def small_body(**changes):
    """The rigid body of the default aircraft, every value one or two deviations off, and the structures beside it."""
    rng = np.random.default_rng(7)
    airframe = default_aircraft()
    interfaces = tuple(_interface(gear, rng) for gear in airframe.gears)
    result = Identification(
        study=_study(airframe),
        structure="rigid_body",
        parameters=BodyParameters(
            sprung_mass_kg=Estimate.normal(5403.1, 4.9),
            roll_inertia_kg_m2=Estimate.normal(15960.0, 41.0),
            pitch_inertia_kg_m2=Estimate.normal(27080.0, 62.0),
            x_cg_m=Estimate.normal(0.6013, 0.0011),
            y_cg_m=Estimate.normal(-0.0004, 0.0009),
        ),
        ratios=BodyRatios(
            roll_radius_m=Estimate.normal(1.7187, 0.0021),
            pitch_radius_m=Estimate.normal(2.2387, 0.0024),
            x_cg_m=Estimate.normal(0.6013, 0.0011),
            y_cg_m=Estimate.normal(-0.0004, 0.0009),
        ),
        per_mass=False,
        interfaces=interfaces,
        place_corrections={"sensor_x_m[left]": Estimate.normal(0.006, 0.004)},
        candidates=_candidates(),
        why=WHY,
        runs=(_run("reference", (), rng), _run("loaded", ((500.0, -1.0, 0.2),), rng)),
        noise_m_per_s2=0.005,
        residual_over_noise=1.02,
        evidence=(),
        mended_spikes=(0, 0),
        warnings=("run 'loaded', 'tail': it has an offset of 0.3 m/s^2",),
        not_determined=None,
        options=Options(None, True, "pursuit", library(), 0),
        settings=Settings(),
    )
    return replace(result, **changes)


def body_without_mass():
    """The same from one loading: everything per kg of the body."""
    mass = default_aircraft().mass_kg
    whole = small_body()

    def scaled(estimate):
        return Estimate.normal(estimate.value / mass, estimate.std / mass)

    interfaces = tuple(
        replace(
            each,
            stiffness=scaled(each.stiffness),
            damping=scaled(each.damping),
            law=each.law.scaled(1 / mass),
            law_estimates={
                kind: {name: scaled(e) if name.startswith("amplitude") else e for name, e in table.items()}
                for kind, table in each.law_estimates.items()
            },
        )
        for each in whole.interfaces
    )
    return replace(
        whole,
        parameters=BodyParameters(),
        per_mass=True,
        interfaces=interfaces,
        runs=whole.runs[:1],
        candidates=tuple(replace(c, sprung_mass_kg=Estimate(), left_out_over_noise=None) for c in whole.candidates),
        not_determined="all runs have the same loading: only ratios to the mass can be told",
    )


def _study(airframe):
    """What the numbers are about, with noise in place of what was measured."""
    names = [f"{gear.name}_{side}_z" for gear in airframe.gears for side in ("lower", "upper")]
    rng = np.random.default_rng(8)
    reference, loaded = (
        recording_from_arrays(rng.standard_normal((7, 512)), [*names, "tail"], fs=128.0) for _ in range(2)
    )
    interfaces = [
        MeasuredInterface(
            gear.name, f"{gear.name}_upper_z", f"{gear.name}_lower_z", gear.x_m, gear.y_m, *PLACES[gear.name]
        )
        for gear in airframe.gears
    ]
    return Study(
        title="An aircraft made by hand",
        interfaces=tuple(interfaces),
        runs=(Run("reference", reference), Run("loaded", loaded, (PointMass(500.0, -1.0, 0.2),))),
        structure=StructureSettings("rigid_body", noise_m_per_s2=0.005),
        sensors=(BodySensor("tail", -4.0, 0.0),),
        date=date(2026, 3, 1),
        source=Path("my study.toml"),
    )


def _interface(gear, rng):
    def near(value, fraction):
        return Estimate.normal(value * (1 + fraction * rng.standard_normal()), fraction * value)

    phase = np.linspace(0, 60, 1500)
    return InterfaceEstimate(
        name=gear.name,
        shared_with=(),
        stiffness=near(gear.suspension_stiffness_n_per_m, 1e-3),
        damping=near(gear.suspension_damping_n_s_per_m, 3e-3),
        ground_stiffness=Estimate(0.0),
        law=gear.law,
        law_estimates={
            kind: {name: near(value, 5e-3) for name, value in table.items()}
            for kind, table in gear.law.parameters.items()
        },
        travel=0.012 * np.sin(1.3 * phase) * np.cos(0.1 * phase),
        velocity=0.15 * np.cos(1.7 * phase) * np.cos(0.1 * phase),
        residual_over_noise=1.0 + 0.01 * gear.x_m,
        rest_m=Estimate(0.0),
        at_rest=(),
    )


def _candidates():
    def candidate(kind, names, mass, ratio, left_out, law, recommended=False):
        why = "what it leaves is the sensors' noise" if recommended else f"it leaves {ratio:.3g} times the noise"
        return Candidate(kind, names, mass, ratio, left_out, law, ratio <= 1.2, recommended, why)

    friction = "arctan_velocity"
    return (
        candidate("single", ("nose",), Estimate(), float("inf"), None, ""),
        candidate("single", ("left",), Estimate.normal(3900.0, 700.0), 39.4, 61.0, f"{friction}+cubic_stiffness"),
        candidate("single", ("right",), Estimate.normal(4100.0, 650.0), 36.1, 55.0, f"{friction}+quadratic_damping"),
        candidate("pair", ("left", "right"), Estimate.normal(2290.0, 120.0), 14.2, 17.0, friction),
        candidate("rigid_body", ("nose", "left", "right"), Estimate.normal(5403.1, 4.9), 1.02, 1.04, friction, True),
    )


def _run(name, loading, rng):
    frequency = np.arange(0.5, 40.0, 0.125)
    time = np.arange(20.0, 26.0, 1 / 128)
    true = np.stack([np.sin(2 * np.pi * f * time) * np.exp(-((time - 23) ** 2)) for f in (1.4, 1.6, 1.7, 1.9)])
    measured = true + 0.005 * rng.standard_normal(true.shape)
    return RunResidual(
        unexplained=0.01,
        name=name,
        mass_change_kg=sum(row[0] for row in loading),
        frequency_hz=frequency,
        residual=np.abs(rng.standard_normal((4, frequency.size, 2)) @ [1, 1j]) / np.sqrt(2),
        time_s=time,
        measured=measured,
        predicted=true,
        loading=loading,
    )
