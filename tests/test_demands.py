"""What the runs demand beside the suspension is found, and nothing that they do not."""

import numpy as np
import pytest

from opid.mechanics.landing_gear import LandingGear, taxi_test
from opid.mechanics.sensors import Sensor
from opid.suspensions.one_gear.demands import PLAUSIBLE_STD, at_last, let_in
from opid.suspensions.one_gear.driven_run import driven_run
from opid.suspensions.one_gear.model_fit import fit_model
from opid.suspensions.one_gear.study import Run, Study
from opid.suspensions.paper.classical import classical_chain

FS, MASS_KG = 256.0, 1850.0


def first_fit(seed=0, *, gear=None, lower=None, upper=None):
    """Runs of a test with one fault, their fit without it, and the classical fit with a ground spring."""
    test = taxi_test(
        gear or LandingGear(),
        rng=np.random.default_rng(seed),
        duration_s=20.0,
        fs=FS,
        lower_sensor=Sensor(**(lower or {})),
        upper_sensor=Sensor(**(upper or {})),
    )
    logs = ((test.heavy.recording, 0.0), (test.light.recording, test.mass_change_kg))
    study = Study(
        "taxi",
        sprung="upper_z",
        unsprung="lower_z",
        runs=tuple(Run(str(change), log, change) for log, change in logs),
    )
    runs = tuple(
        driven_run(log.channel("lower_z"), log.channel("upper_z"), fs=FS, mass_change_kg=change) for log, change in logs
    )
    joint = classical_chain(study, law="arctan_velocity").joint
    fit = fit_model(
        runs,
        LandingGear().law.scaled(1.2 / MASS_KG),
        stiffness_per_mass=joint["stiffness_per_mass"],
        damping_per_mass=joint["damping_per_mass"],
        inverse_mass=1e-3,
    )
    return runs, fit, joint


@pytest.mark.parametrize("seed", range(5))
def test_sound_runs_demand_nothing(seed):
    runs, fit, joint = first_fit(seed)
    again, same, demands = let_in(runs, fit, ground_start=joint)
    assert demands == ()
    assert same is fit
    assert again == runs


COUPLED = {"corner_hz": 0.33}
# gear, lower and upper sensor, and what has to be found
FAULTS = {
    "gain": ({}, {}, {"gain": 1.01}, {"gain_sprung": 1.01}),
    "lag": ({}, {}, {"lag_s": 0.5 / FS}, {"lag_s": 0.5 / FS}),
    "AC coupling": (
        {},
        COUPLED,
        {"corner_hz": 0.462},
        {"corner_unsprung_hz": 0.33, "corner_sprung_hz": 0.462},
    ),
    # none of the three alone lowers the error by much
    "all three": (
        {},
        COUPLED,
        {"gain": 1.03, "corner_hz": 0.462, "lag_s": 0.5 / FS},
        {"gain_sprung": 1.03, "corner_unsprung_hz": 0.33, "corner_sprung_hz": 0.462, "lag_s": 0.5 / FS},
    ),
    "equal AC coupling": ({}, COUPLED, COUPLED, {"corner_unsprung_hz": 0.33, "corner_sprung_hz": 0.33}),
    "weak spring": (
        {"ground_stiffness_n_per_m": 4e3},
        {},
        {},
        {"ground_stiffness_per_mass": 4e3 / MASS_KG},
    ),
    "strong spring": (
        {"ground_stiffness_n_per_m": 1.67e5},
        {},
        {},
        {"ground_stiffness_per_mass": 1.67e5 / MASS_KG},
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_found_and_nothing_else(fault):
    gear, lower, upper, expected = FAULTS[fault]
    runs, before, joint = first_fit(gear=LandingGear(**gear), lower=lower, upper=upper)
    settled, fit, demands = let_in(runs, before, ground_start=joint)
    assert {demand.name for demand in demands} == set(expected)
    for demand in demands:
        assert abs(demand.value - expected[demand.name]) < 4 * demand.std
        assert demand.std < 0.03 * abs(expected[demand.name])
        assert demand.error_after < demand.error_before
        assert demand == at_last(demand, fit)
    assert fit.noise_m_per_s2 == pytest.approx(5e-3, rel=0.06)
    assert before.noise_m_per_s2 > 1.4 * fit.noise_m_per_s2
    place = fit.names.index("inverse_mass")
    assert abs(fit.value[place] - 1 / MASS_KG) < 4 * fit.std[place]
    # and once in, nothing more is asked for
    assert let_in(settled, fit, ground_start=joint)[1].names == fit.names


def test_a_ground_spring_is_let_in_only_where_it_may_be():
    runs, before, _ = first_fit(gear=LandingGear(ground_stiffness_n_per_m=4e3))
    _, fit, demands = let_in(runs, before)
    assert "ground_stiffness_per_mass" not in fit.names
    # it passes for a gain error of K3/K2, which explains the runs less well than the spring does
    assert demands[0].name == "gain_sprung"
    assert demands[0].value == pytest.approx(1 - 4e3 / 3.9e5, abs=0.004)
    assert fit.noise_m_per_s2 > 1.05 * 5e-3


def test_a_fault_far_beyond_what_sensors_do_is_not_let_in():
    """A gain of 1.3 would lower the error a lot, and stands in for something else: a wrong channel, another unit."""
    runs, before, _ = first_fit(upper={"gain": 1.3})
    assert before.noise_m_per_s2 > 20 * 5e-3
    _, fit, demands = let_in(runs, before)
    assert "gain_sprung" not in {demand.name for demand in demands}
    for nuisance in fit.sensors.nuisances:
        assert abs(fit[nuisance.name] - nuisance.nominal) < PLAUSIBLE_STD * nuisance.std
