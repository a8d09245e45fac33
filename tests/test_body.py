"""Mobility of a body: against plain matrices, its derivatives against differences, and bad input."""

from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.laws.law import law
from opid.mechanics.structure import Joint, Structure
from opid.suspensions.model.body import RIGID, ImpossibleBodyError, mobility, own_body, rigid_body, vertical
from opid.suspensions.study import PointMass
from opid.virtual.taxi_tests.aircraft import default_aircraft
from opid.virtual.taxi_tests.airframe import airframe_mass, loaded

PLACES = [(5.0, 0.0), (0.0, 1.6), (0.0, -1.6)]
SENSORS = [(5.3, 0.2), (0.25, 1.4), (0.25, -1.4), (-4.0, 0.1)]
THETA = np.array([0.6, 0.05, 3.0, 5.3])
MU = 1 / 5400.0
NO_LOADING = np.zeros((3, 3))


def loading_of(*rows):
    return sum(mass * np.outer(vertical(x, y), vertical(x, y)) for mass, x, y in rows)


def test_the_mass_matrix_is_that_of_the_airframe_over_its_mass():
    aircraft = replace(default_aircraft(), y_cg_m=0.1)
    mass = aircraft.mass_kg
    rxx = aircraft.ixx_kg_m2 / mass + aircraft.y_cg_m**2
    ryy = aircraft.iyy_kg_m2 / mass + aircraft.x_cg_m**2
    theta = np.array([aircraft.x_cg_m, aircraft.y_cg_m, rxx, ryy])
    found = rigid_body(PLACES).mass(theta, 1 / mass, NO_LOADING)
    np.testing.assert_allclose(found, airframe_mass(aircraft) / mass, rtol=1e-12, atol=1e-12)


def test_a_loading_adds_what_it_adds_to_the_airframe():
    aircraft = default_aircraft()
    loads = [(400.0, 2.0, 0.5), (-90.0, -1.0, -1.0)]
    heavier = loaded(aircraft, [PointMass(*each) for each in loads])
    np.testing.assert_allclose(
        airframe_mass(heavier) - airframe_mass(aircraft), loading_of(*loads), rtol=1e-9, atol=1e-6
    )


def test_mobility_is_j_inverse_mass_j_also_for_displaced_sensors():
    body = rigid_body(PLACES, SENSORS)
    loading = loading_of((400.0, 2.0, 0.5))
    found = mobility(body, THETA, MU, np.zeros(0), loading)
    inverse = np.linalg.inv(body.mass(THETA, MU, loading))
    rows = np.array([vertical(*place) for place in PLACES])
    seen = np.array([vertical(*place) for place in SENSORS])
    np.testing.assert_allclose(found.accelerance[:3, :3], rows @ inverse @ rows.T, rtol=1e-12)
    np.testing.assert_allclose(found.reading[:, :3], seen @ inverse @ rows.T, rtol=1e-10, atol=1e-14)
    # a further sensor sits at an attachment on which nothing acts
    assert body.n_attachments == 4
    assert body.n_interfaces == 3
    assert not found.accelerance[3].any()
    assert not found.reading[:, 3].any()


def test_a_force_at_the_centre_of_gravity_heaves_alone():
    body = rigid_body([(0.6, 0.0), (-2.0, 1.0), (-2.0, -1.0)])
    theta = np.array([0.6, 0.0, 2.0, 0.36 + 4.0])
    np.testing.assert_allclose(mobility(body, theta, 0.0, np.zeros(0), NO_LOADING).accelerance[:, 0], 1.0, rtol=1e-12)


def test_the_place_of_the_origin_changes_nothing():
    shift = np.array([3.0, -0.5])
    here, there = (
        rigid_body([tuple(np.add(p, s)) for p in PLACES], [tuple(np.add(p, s)) for p in SENSORS])
        for s in ((0.0, 0.0), shift)
    )
    x, y = THETA[:2]
    loads = [(400.0, 2.0, 0.5)]
    theta = np.array([x + shift[0], y + shift[1], 3.0 - y**2 + (y + shift[1]) ** 2, 5.3 - x**2 + (x + shift[0]) ** 2])
    one = mobility(here, THETA, MU, np.zeros(0), loading_of(*loads))
    far = [(mass, px + shift[0], py + shift[1]) for mass, px, py in loads]
    other = mobility(there, theta, MU, np.zeros(0), loading_of(*far))
    np.testing.assert_allclose(other.accelerance, one.accelerance, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(other.reading, one.reading, rtol=1e-8, atol=1e-12)


def test_derivatives_are_those_of_differences():
    body = rigid_body(PLACES, SENSORS[:3], names=("nose", "left", "right"), tolerance_m=0.01)
    loading = loading_of((400.0, 2.0, 0.5))
    rng = np.random.default_rng(1)
    at = np.concatenate([THETA, [MU], 0.02 * rng.standard_normal(len(body.coordinates))])

    def of(vector):
        return mobility(body, vector[:4], vector[4], vector[5:], loading)

    exact = of(at)
    assert len(exact.by_accelerance) == at.size == len(exact.by_reading)
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = 1e-6 * (MU if k == 4 else 1.0)
        up, down = of(at + step), of(at - step)
        for name in ("accelerance", "reading"):
            differences = (getattr(up, name) - getattr(down, name)) / (2 * step[k])
            found = getattr(exact, f"by_{name}")[k]
            np.testing.assert_allclose(found, differences, rtol=1e-6, atol=1e-7 * np.abs(differences).max(initial=1e-3))


def test_coordinates_are_named_and_those_of_sensors_move_readings_alone():
    body = rigid_body(PLACES, SENSORS[:3], names=("nose", "left", "right"), tolerance_m=0.01)
    names = [coordinate.name for coordinate in body.coordinates]
    assert names[:2] == ["x_m[nose]", "y_m[nose]"]
    assert names[-1] == "sensor_y_m[right]"
    assert len(names) == 12
    found = mobility(body, THETA, MU, np.zeros(12), NO_LOADING)
    assert not found.by_accelerance[5 + names.index("sensor_x_m[left]")].any()
    assert rigid_body(PLACES).coordinates == ()
    assert body.names == RIGID


def test_an_impossible_body_is_told():
    body = rigid_body(PLACES)
    with pytest.raises(ImpossibleBodyError, match="not positive definite"):
        mobility(body, np.array([3.0, 0.0, 1.0, 2.0]), MU, np.zeros(0), NO_LOADING)


NAMES = ("base", "floor", "roof")
STOREYS = (Joint("low", (-1, 1, 0), 4e6, 2e3), Joint("high", (0, -1, 1), 3e6, 1e3))


def frame(**changes):
    given = {"mass": np.diag([3e3, 2e3, 1e3]), "stiffness": np.zeros((3, 3)), "joints": STOREYS, **changes}
    return Structure(given["mass"], np.zeros((3, 3)), given["stiffness"], given["joints"], NAMES)


def test_an_own_structure_is_its_matrices():
    """The springs inside, put together again, are the stiffness and damping of the structure."""
    ground = np.diag([0.0, 5e4, 0.0])
    body = own_body(frame(stiffness=ground), ["base"], NAMES)
    assert body.absolute
    assert body.n_interfaces == 1
    assert body.n_attachments == 4
    stiffness = sum(
        spring.stiffness_n_per_m * np.outer(row, row) for spring, row in zip(body.inside, body.rows[1:], strict=True)
    )
    np.testing.assert_allclose(
        stiffness, [[4e6, -4e6, 0], [-4e6, 4e6 + 3e6 + 5e4, -3e6], [0, -3e6, 3e6]], rtol=1e-12, atol=1e-6
    )
    found = mobility(body, np.zeros(0), 1.0, np.zeros(0), np.diag([0.0, 0.0, 100.0]))
    np.testing.assert_allclose(found.accelerance[0, 0], 1 / 3e3)
    np.testing.assert_allclose(found.accelerance[2, 2], 1 / 2e3 + 1 / 1100.0)
    np.testing.assert_allclose(found.reading[2, 2], 1 / 1100.0)


def test_unknown_masses_are_ratios_to_the_first_and_what_is_known_keeps_the_scale():
    body = own_body(frame(), ["base"], NAMES, unknown=["high"], unknown_mass=["floor", "roof"])
    assert not body.absolute
    assert body.names == ("mass[roof] / mass[floor]",)
    mass = body.mass(np.array([0.5]), 1 / 2e3, NO_LOADING)
    # what the matrix says of the unknown ones is not used
    np.testing.assert_allclose(2e3 * mass, np.diag([3e3, 2e3, 1e3]))
    other = own_body(frame(mass=np.diag([3e3, 7.0, 8.0])), ["base"], NAMES, unknown_mass=["floor", "roof"])
    np.testing.assert_allclose(other.mass(np.array([0.5]), 1 / 2e3, NO_LOADING), mass)
    assert [spring.stiffness_n_per_m for spring in body.inside] == [4e6, None]
    assert own_body(frame(), ["base", "floor", "roof"], ["base"]).readings.shape == (1, 3)


def test_more_sensors_than_attachments_sit_at_attachments_without_a_spring():
    body = own_body(frame(joints=()), ["base"], NAMES)
    assert body.n_attachments == 3
    assert [spring.name for spring in body.inside] == ["sensor 1", "sensor 2"]
    assert not body.rows[1:].any()


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"interfaces": ["bas"]}, "no degree of freedom 'bas': did you mean 'base'"),
        ({"sensors": ["attic"]}, "no degree of freedom 'attic': known are"),
        ({"unknown_mass": ["rof"]}, "no degree of freedom 'rof'"),
        ({"unknown": ["hig"]}, "no joint 'hig' in the structure: did you mean 'high'"),
        ({"unknown_mass": ["roof", "roof"]}, "unknown_mass names 'roof' 2 times"),
        ({"interfaces": ["base", "base"]}, "interfaces names 'base' 2 times"),
    ],
)
def test_unknown_names_are_refused(given, match):
    settings = {"interfaces": ["base"], "sensors": list(NAMES), **given}
    with pytest.raises(InputError, match=match):
        own_body(frame(), settings.pop("interfaces"), settings.pop("sensors"), **settings)


def test_a_law_inside_and_a_joint_of_a_structure_without_joints_are_refused():
    nonlinear = replace(STOREYS[0], law=law("cubic_stiffness", stiffness_n_per_m3=1e9))
    with pytest.raises(InputError, match="joint 'low' inside of the structure has a law: make an interface of it"):
        own_body(frame(joints=(nonlinear,)), ["base"], NAMES)
    with pytest.raises(InputError, match="it has none"):
        own_body(frame(joints=()), ["base"], NAMES, unknown=["low"])
