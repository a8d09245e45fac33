"""The natural frequency of one gear belongs to the stiffness that it has at rest, and the result says so."""

import numpy as np
import pytest
from law_runs import study_of

import opid
from opid.mechanics.laws.law import law
from opid.mechanics.truth import GearNumbers, GearTruth
from opid.suspensions.identification import identify
from opid.virtual.taxi_tests.airframe import LandingGear

SPRING = law("arctan_displacement", amplitude_n=400.0, scale_m=2e-3)
FRICTION = law("arctan_velocity", amplitude_n=400.0, scale_m_per_s=0.02)
DAHL = law("dahl_friction", amplitude_n=400.0, scale_m=5e-4)


@pytest.mark.parametrize(
    ("restoring", "belongs_to"),
    [
        (SPRING, "tangent at rest"),
        (SPRING + FRICTION, "tangent at rest"),
        (FRICTION, "linear part"),
        (DAHL, "all but what the law remembers"),
    ],
    ids=lambda each: getattr(each, "name", None),
)
def test_the_frequency_is_that_of_the_tangent_at_rest(restoring, belongs_to):
    gear = LandingGear(law=restoring)
    found = identify(study_of(gear, lowest_step_rate_hz=16384.0), law=restoring.name)
    tangent = gear.suspension_stiffness_n_per_m + float(restoring.gradient(0.0, 0.0)[0])
    true_hz = np.sqrt(tangent / gear.sprung_mass_kg) / (2 * np.pi)
    assert found.frequency_of == belongs_to
    frequency, zeta = found.ratios.natural_frequency_hz, found.ratios.damping_ratio
    assert abs(frequency.value - true_hz) < 4 * frequency.std
    assert frequency.std < 0.01 * true_hz
    np.testing.assert_allclose(4 * np.pi * frequency.value * zeta.value, found.ratios.damping_per_mass.value)
    # the stiffness told beside it, run by run, has the same frequency
    at_rest, mass = found.interfaces[0].at_rest[0].stiffness, found.parameters.sprung_mass_kg
    np.testing.assert_allclose(frequency.value, np.sqrt(at_rest.value / mass.value) / (2 * np.pi), rtol=1e-3)


def test_table_and_json_say_what_the_frequency_belongs_to():
    truth = GearTruth(GearNumbers(1850.0, 3.9e5, 6e3, 0.0), SPRING)
    found = identify(study_of(LandingGear(law=SPRING)), law=SPRING.name)
    assert found.to_dict()["natural_frequency_of"] == "tangent at rest"
    said = opid.text(found, truth)
    assert "On the tangent stiffness at rest in the reference run, with the damping C2" in said
    # the truth beside it is that of the tangent, too
    assert "2.66143" in said


def test_a_law_that_remembers_is_told_with_its_equivalents():
    said = opid.text(identify(study_of(LandingGear(law=DAHL), lowest_step_rate_hz=16384.0), law=DAHL.name))
    assert "Without what the law remembers: stiffer in small or quick motion" in said
    assert said.count("natural freq.") == 3
