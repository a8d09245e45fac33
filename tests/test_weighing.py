"""Weighed masses: compared with every answer, prior knowledge with a tolerance, and contradictions by how much."""

from dataclasses import replace

import body_runs
import numpy as np
import pytest

import opid
from opid.errors import InputError
from opid.estimate import Estimate
from opid.suspensions.settings import WeighingSettings
from opid.suspensions.study import Run, study_of_gear
from opid.suspensions.weighing import (
    InverseMass,
    PriorMass,
    compare_with_weighed,
    find_prior_mass,
    warn_of_weighed,
)
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

LAW = "arctan_velocity"


@pytest.fixture(scope="module")
def study():
    test = taxi_test(LandingGear(), rng=np.random.default_rng(3), duration_s=20, fs=256)
    runs = (Run("heavy", test.heavy.recording, 0.0), Run("light", test.light.recording, -220.0))
    return study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, repeatability=0.0)


def _weigh(study, *weighed):
    """Return the study with (mass, tolerance) of its runs."""
    runs = (
        replace(run, weighed_mass_kg=mass, weighed_tolerance_kg=tolerance)
        for run, (mass, tolerance) in zip(study.runs, weighed, strict=True)
    )
    return replace(study, runs=tuple(runs))


NOT = (None, None)


@pytest.fixture(scope="module")
def alone(study):
    return opid.identify(study, law=LAW)


@pytest.mark.parametrize("method", ["model", "classical", "paper"])
def test_a_weighed_mass_is_compared_and_changes_no_number(study, method):
    found = opid.identify(_weigh(study, (1860.0, None), (1630.0, None)), method=method, law=LAW)
    assert found.parameters == opid.identify(study, method=method, law=LAW).parameters
    mass = found.parameters.sprung_mass_kg.value
    for each, weighed, change in zip(found.weighed, (1860.0, 1630.0), (0.0, -220.0), strict=True):
        assert not each.is_prior
        if mass is None:
            assert each.error_percent is None
        else:
            np.testing.assert_allclose(each.error_percent, 100 * (weighed - mass - change) / weighed)
    written = found.to_dict()["weighed"]
    assert [each["run"] for each in written] == ["heavy", "light"]
    assert "Weighed and identified mass" in opid.text(found)


def test_a_tolerance_makes_it_prior_knowledge_of_the_model(study, alone):
    own = alone.parameters.sprung_mass_kg
    found = opid.identify(_weigh(study, (1852.0, 2.0), NOT), law=LAW)
    mass = found.parameters.sprung_mass_kg
    weights = own.std**-2, 2.0**-2
    expected = (own.value * weights[0] + 1852.0 * weights[1]) / sum(weights)
    assert mass.std < min(own.std, 2.0)
    np.testing.assert_allclose(mass.std, sum(weights) ** -0.5, rtol=0.1)
    np.testing.assert_allclose(mass.value, expected, atol=0.3 * mass.std)
    (each,) = found.weighed
    assert each.is_prior
    np.testing.assert_allclose(each.by_runs_kg.value, own.value, rtol=1e-6)
    np.testing.assert_allclose(each.deviations, (1852 - own.value) / np.hypot(own.std, 2), atol=0.05)
    # the classical chain has no priors
    classical = opid.identify(_weigh(study, (1852.0, 2.0), NOT), method="classical", law=LAW)
    assert not classical.weighed[0].is_prior


def test_a_weighed_mass_gives_the_scale_of_one_run(study):
    one = replace(study, runs=study.runs[:1])
    assert opid.identify(one, law=LAW).parameters.sprung_mass_kg.value is None
    runs = (replace(one.runs[0], weighed_mass_kg=1850.0, weighed_tolerance_kg=5.0),)
    found = opid.identify(replace(one, runs=runs), law=LAW)
    assert found.not_determined is None
    np.testing.assert_allclose(found.parameters.sprung_mass_kg.std, 5.0, rtol=0.01)
    assert found.parameters.suspension_stiffness_n_per_m.holds(3.9e5)
    assert found.weighed[0].by_runs_kg == Estimate()


@pytest.mark.parametrize("tolerance", [None, 5.0])
def test_a_weighed_mass_that_contradicts_the_runs_is_not_believed(study, alone, tolerance):
    """The scale had the whole aircraft on it, or the wheels too: the answer is that of the runs, and says so."""
    found = opid.identify(_weigh(study, (2100.0, tolerance), NOT), law=LAW)
    assert found.parameters == alone.parameters
    (warning,) = (each for each in found.warnings if "contradicts the runs" in each)
    assert f"{found.weighed[0].deviations:.1f} standard deviations" in warning
    assert found.weighed[0].deviations > 10
    assert not found.weighed[0].is_prior


def test_weighings_that_contradict_the_mass_change_are_named(study):
    weighed = _weigh(study, (1850.0, 3.0), (1590.0, 3.0))
    compared = compare_with_weighed(weighed, Estimate(), settings=WeighingSettings())
    (warning,) = warn_of_weighed(weighed, compared, WeighingSettings())
    assert "differ by -260 kg on the scale and by -220 kg" in warning
    agreeing = _weigh(study, (1850.0, 3.0), (1632.0, 3.0))
    compared = compare_with_weighed(agreeing, Estimate(), settings=WeighingSettings())
    assert list(warn_of_weighed(agreeing, compared, WeighingSettings())) == []


def test_weighings_of_one_scale_are_not_averaged_to_more_than_its_tolerance(study):
    prior = find_prior_mass(_weigh(study, (1852.0, 4.0), (1628.0, 4.0)))
    assert prior == PriorMass(1850.0, 4.0)
    assert find_prior_mass(_weigh(study, (1852.0, None), NOT)) is None


def test_runs_that_say_nothing_of_the_mass_contradict_nothing():
    assert abs(InverseMass(-1e-5, 1e-3).compare(PriorMass(1850.0, 5.0))) < 1
    assert InverseMass(-1e-5, 1e-3).mass == Estimate()
    assert InverseMass(-1e-3, 1e-5).compare(PriorMass(1850.0, 5.0)) < -100


@pytest.mark.parametrize(
    ("mass", "tolerance", "words"),
    [
        (-5.0, None, "weighed_mass_kg is -5.0, give the mass that this gear carries in this run"),
        (float("nan"), None, "weighed_mass_kg is nan"),
        ("heavy", None, "weighed_mass_kg is 'heavy'"),
        (2e6, None, "at most 1e"),
        (1850.0, 0.0, "weighed_tolerance_kg is 0.0, give the standard deviation"),
        (1850.0, 2000.0, "less than 1850 kg"),
        (None, 5.0, "weighed_tolerance_kg is stated without weighed_mass_kg"),
    ],
)
def test_masses_of_no_sense_are_refused(study, mass, tolerance, words):
    with pytest.raises(InputError, match=words):
        _weigh(study, (mass, tolerance), NOT)


def test_a_weighed_mass_below_the_mass_change_is_refused(study):
    runs = (study.runs[0], replace(study.runs[1], loading=220.0, weighed_mass_kg=200.0))
    with pytest.raises(InputError, match="leaves nothing for the reference"):
        replace(study, runs=runs)


def test_the_whole_body_is_weighed_where_all_suspensions_are_described():
    light, heavy = body_runs.short_runs()
    true_kg = body_runs.aircraft().mass_kg
    alone = opid.identify(body_runs.study(), law=LAW).parameters.sprung_mass_kg
    weighed = replace(light, weighed_mass_kg=true_kg + 2.0, weighed_tolerance_kg=4.0)
    found = opid.identify(body_runs.study(runs=(weighed, heavy)), law=LAW)
    mass = found.parameters.sprung_mass_kg
    assert found.weighed[0].is_prior
    assert mass.holds(true_kg)
    assert mass.std < min(alone.std, 4.0)
    np.testing.assert_allclose(mass.std, (alone.std**-2 + 4.0**-2) ** -0.5, rtol=0.1)
    assert found.parameters.roll_inertia_kg_m2.interval95 is not None
    assert "Weighed and identified mass" in opid.text(found)
    # a gear alone carries a part that the scale did not read
    apart = opid.identify(body_runs.study("single", runs=(weighed, heavy)), law=LAW)
    assert not apart.weighed[0].is_prior
