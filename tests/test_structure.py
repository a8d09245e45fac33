import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from opid.errors import InputError
from opid.mechanics.laws.law import default_law
from opid.mechanics.structure import (
    Joint,
    Structure,
    frequency_response,
    linear_matrices,
    modal_assurance,
    natural_frequencies,
)
from opid.virtual.taxi_tests.airframe import LandingGear, airframe_structure

positive = st.floats(0.1, 10.0)


def chain(masses, springs, dampers):
    """A chain of masses from a wall, spring k before mass k."""
    n_dof = len(masses)
    joints = []
    for place, (stiffness, damping) in enumerate(zip(springs, dampers, strict=True)):
        direction = np.zeros(n_dof)
        direction[place] = 1.0
        if place:
            direction[place - 1] = -1.0
        joints.append(Joint(f"spring {place}", direction, stiffness, damping))
    return Structure(np.diag(masses), np.zeros((n_dof, n_dof)), np.zeros((n_dof, n_dof)), tuple(joints))


def test_a_uniform_chain_has_its_closed_form():
    # fixed-free chain: omega_k = 2 sqrt(k/m) sin((2k - 1) pi / (4n + 2))
    n_dof, mass, stiffness = 6, 3.0, 500.0
    modes = natural_frequencies(chain([mass] * n_dof, [stiffness] * n_dof, [0.0] * n_dof))
    k = np.arange(1, n_dof + 1)
    omega = 2.0 * np.sqrt(stiffness / mass) * np.sin((2 * k - 1) * np.pi / (4 * n_dof + 2))
    np.testing.assert_allclose(modes.frequency_hz, omega / (2.0 * np.pi), rtol=1e-12)
    np.testing.assert_allclose(modes.shapes.T @ (mass * modes.shapes), np.eye(n_dof), atol=1e-12)


def test_stiffness_proportional_damping_has_its_closed_form():
    beta = 1e-3
    springs = np.array([400.0, 300.0, 200.0])
    modes = natural_frequencies(chain([1.0, 2.0, 3.0], springs, beta * springs))
    np.testing.assert_allclose(modes.zeta, beta * np.pi * modes.frequency_hz, rtol=1e-10)


@settings(max_examples=50)
@given(
    masses=st.lists(positive, min_size=3, max_size=3),
    springs=st.lists(positive, min_size=3, max_size=3),
    place=st.integers(0, 2),
    added=positive,
)
def test_more_mass_never_raises_a_frequency_and_more_stiffness_never_lowers_one(masses, springs, place, added):
    before = natural_frequencies(chain(masses, springs, [0.0] * 3)).frequency_hz
    heavier, stiffer = list(masses), list(springs)
    heavier[place] += added
    stiffer[place] += added
    slack = 1e-9 * before[-1]
    assert (natural_frequencies(chain(heavier, springs, [0.0] * 3)).frequency_hz <= before + slack).all()
    assert (natural_frequencies(chain(masses, stiffer, [0.0] * 3)).frequency_hz >= before - slack).all()


def test_a_free_structure_has_a_rigid_body_mode():
    free = Structure(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), (Joint("spring", [-1, 1], 50.0),))
    modes = natural_frequencies(free)
    np.testing.assert_allclose(2.0 * np.pi * modes.frequency_hz, [0.0, 10.0], atol=1e-12)
    assert np.isnan(modes.zeta[0])


def test_the_frequency_response_is_the_sum_of_the_modes():
    # stiffness-proportional damping keeps the modes real
    springs = np.array([400.0, 300.0, 200.0])
    structure = chain([1.0, 2.0, 3.0], springs, 2e-3 * springs)
    modes = natural_frequencies(structure)
    frequency_hz = np.linspace(0.1, 6.0, 40)
    omega, omega_k = 2 * np.pi * frequency_hz[:, None], 2 * np.pi * modes.frequency_hz
    factor = 1.0 / (omega_k**2 - omega**2 + 2j * modes.zeta * omega_k * omega)
    expected = np.einsum("ik,fk,jk->fij", modes.shapes, factor, modes.shapes)
    np.testing.assert_allclose(frequency_response(structure, frequency_hz), expected, rtol=1e-9)


@pytest.mark.parametrize("ground", [0.0, 1.67e5])
def test_the_transmissibility_of_a_gear_has_no_tyre_in_it(ground):
    # T = (K2 + jw C2) / (K2 + K3 - w^2 M2 + jw C2), whatever M1, K1, C1 and the (nonlinear) law are
    gear = LandingGear(ground_stiffness_n_per_m=ground, tyre_stiffness_n_per_m=1e6, unsprung_mass_kg=80.0)
    frequency_hz = np.linspace(0.05, 40.0, 200)
    structure = airframe_structure(gear.airframe)
    heave, wheel = structure.index("heave"), structure.index("wheel")
    receptance = frequency_response(structure, frequency_hz)
    found = receptance[:, heave, wheel] / receptance[:, wheel, wheel]
    jw = 2j * np.pi * frequency_hz
    strut = gear.suspension_stiffness_n_per_m + jw * gear.suspension_damping_n_s_per_m
    np.testing.assert_allclose(found, strut / (strut + ground + jw**2 * gear.sprung_mass_kg), rtol=1e-9)


def test_modal_assurance_knows_scale_sign_and_phase_from_shape():
    shapes = np.random.default_rng(4).standard_normal((5, 3))
    np.testing.assert_allclose(np.diag(modal_assurance(shapes, -7.0 * np.exp(0.3j) * shapes)), 1, atol=1e-12)
    own = modal_assurance(shapes)
    np.testing.assert_allclose(own, own.T, atol=1e-14)
    assert ((own >= 0) & (own <= 1 + 1e-12)).all()
    assert modal_assurance(shapes, shapes[:, :2]).shape == (3, 2)
    with pytest.raises(InputError, match="give both at the same sensors"):
        modal_assurance(np.ones((3, 2)), np.ones((4, 2)))


def test_modal_assurance_takes_single_shapes_and_zero_ones():
    np.testing.assert_allclose(modal_assurance([1.0, 2.0], [2.0, 4.0]), [[1.0]])
    assert modal_assurance([1.0, 2.0, -1.0], [2.0, -1.0, 0.0]).tolist() == [[0.0]]
    assert modal_assurance(np.eye(2), [[0.0], [0.0]]).tolist() == [[0.0], [0.0]]


def test_laws_do_not_enter_the_linear_matrices():
    plain = Joint("strut", [-1, 1], 100.0, 2.0)
    nonlinear = Joint("strut", [-1, 1], 100.0, 2.0, default_law("arctan_displacement"))
    zeros = np.zeros((2, 2))
    for expected, found in zip(
        linear_matrices(Structure(np.eye(2), zeros, zeros, (plain,))),
        linear_matrices(Structure(np.eye(2), zeros, zeros, (nonlinear,))),
        strict=True,
    ):
        np.testing.assert_array_equal(found, expected)


def test_a_structure_keeps_its_own_copy():
    mass = np.eye(2)
    structure = Structure(mass, np.zeros((2, 2)), np.eye(2))
    mass[0, 0] = 7.0
    assert structure.mass[0, 0] == 1.0
    assert not structure.stiffness.flags.writeable


EYE, NONE = np.eye(2), np.zeros((2, 2))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Structure(np.diag([1.0, 0.0]), NONE, EYE), "positive mass"),
        (lambda: Structure(EYE, NONE, [[1.0, 0.5], [0.0, 1.0]]), "stiffness matrix is not symmetric"),
        (
            lambda: Structure(EYE, [[np.nan, 0.0], [0.0, 1.0]], EYE),
            "damping matrix is not symmetric and finite",
        ),
        (lambda: Structure(EYE, NONE, np.eye(3)), r"stiffness matrix has shape \(3, 3\)"),
        (lambda: Structure([1.0, 2.0], NONE, EYE), "give a square matrix"),
        (lambda: Structure(EYE, NONE, EYE, (Joint("strut", [1.0]),)), "'strut' has shape"),
        (lambda: Structure(EYE, NONE, EYE, names=("a", "a")), "2 different names"),
        (lambda: Structure(EYE, NONE, EYE, names=("wheel", "body")).index("whel"), "did you mean 'wheel'"),
        (lambda: natural_frequencies(Structure(EYE, NONE, -EYE)), "unstable"),
        (lambda: frequency_response(Structure([[1.0]], [[0.0]], [[0.0]]), [0.0]), "undamped resonance"),
    ],
)
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
