import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from opid.errors import InputError
from opid.mechanics.structure import Sliders, force_of, iwan

STIFFNESS, SLIP = 1.5e7, 900.0
models = pytest.mark.parametrize(("chi", "beta"), [(-0.5, 1.0), (-0.8, 0.2), (-0.2, 0.0), (0.0, 3.0)])


def phi_max(chi, beta):
    return SLIP * (1.0 + beta) / (STIFFNESS * (beta + (chi + 1.0) / (chi + 2.0)))


def density(chi, beta):
    """R of the density R phi^chi."""
    return STIFFNESS / (1.0 + beta) * (chi + 1.0) / phi_max(chi, beta) ** (chi + 1.0)


def first_loading(u, chi, beta):
    return STIFFNESS * u - density(chi, beta) * u ** (chi + 2.0) / ((chi + 1.0) * (chi + 2.0))


def cycle_energy(u, chi, beta):
    return 4.0 * density(chi, beta) * u ** (chi + 3.0) / ((chi + 2.0) * (chi + 3.0))


def dissipated(sliders, amplitude, *, n=1000):
    """Energy of one settled cycle, by the trapezoidal rule."""
    path = amplitude * np.sin(2.0 * np.pi * (np.arange(2 * n + 1) / n + 0.25))
    force, _ = force_of(sliders, path)
    return np.trapezoid(force[n:], path[n:])


@models
def test_the_iwan_model_has_its_stiffness_and_its_slip_force(chi, beta):
    sliders = iwan(stiffness_n_per_m=STIFFNESS, slip_force_n=SLIP, chi=chi, beta=beta)
    assert sliders.n == 40
    assert sliders.tangent_n_per_m == pytest.approx(STIFFNESS, rel=1e-12)
    assert sliders.slip_force_n.sum() == pytest.approx(SLIP, rel=1e-12)
    force, _ = force_of(sliders, [1.01 * phi_max(chi, beta)])
    assert force[0] == pytest.approx(SLIP, rel=1e-12)


@models
def test_the_first_loading_has_its_closed_form(chi, beta):
    sliders = iwan(stiffness_n_per_m=STIFFNESS, slip_force_n=SLIP, chi=chi, beta=beta)
    limit = phi_max(chi, beta)
    u = np.geomspace(1e-3, 1.0, 300) * limit
    force = np.array([force_of(sliders, [each])[0][0] for each in u])
    # between the limits of the ranges the discrete model is the stiffer one, by a fraction of one range
    np.testing.assert_allclose(force, first_loading(u, chi, beta), rtol=6e-3)
    n_ranges = sliders.n - (beta > 0.0)
    edges = np.geomspace(1e-3, 1.0, n_ranges) * limit * (1.0 - 1e-12)
    exact = [force_of(sliders, [each])[0][0] for each in edges]
    np.testing.assert_allclose(exact, first_loading(edges, chi, beta), rtol=1e-9)


@models
def test_the_slope_jumps_at_the_end_of_the_first_loading(chi, beta):
    sliders = iwan(stiffness_n_per_m=STIFFNESS, slip_force_n=SLIP, chi=chi, beta=beta, n=400)
    end = phi_max(chi, beta)
    force, _ = force_of(sliders, np.array([0.9995, 0.9999, 1.0001]) * end)
    before = (force[1] - force[0]) / (4e-4 * end)
    assert force[2] == pytest.approx(SLIP)
    assert before == pytest.approx(beta / (1.0 + beta) * STIFFNESS, abs=0.02 * STIFFNESS)


@models
def test_the_energy_of_a_cycle_is_a_power_of_its_amplitude(chi, beta):
    sliders = iwan(stiffness_n_per_m=STIFFNESS, slip_force_n=SLIP, chi=chi, beta=beta)
    amplitude = np.geomspace(0.01, 1.0, 12) * phi_max(chi, beta)
    energy = np.array([dissipated(sliders, each) for each in amplitude])
    np.testing.assert_allclose(energy, cycle_energy(amplitude, chi, beta), rtol=0.04)
    slope = np.polyfit(np.log(amplitude), np.log(energy), 1)[0]
    assert slope == pytest.approx(3.0 + chi, abs=0.01)


@settings(max_examples=30)
@given(
    chi=st.floats(-0.9, 0.0),
    beta=st.floats(0.0, 5.0),
    amplitude=st.floats(0.01, 2.0),
    fraction=st.floats(-1.0, 1.0),
)
def test_masing_a_reversal_is_the_first_loading_twice_as_large(chi, beta, amplitude, fraction):
    sliders = iwan(stiffness_n_per_m=STIFFNESS, slip_force_n=SLIP, chi=chi, beta=beta)
    top = amplitude * phi_max(chi, beta)
    first, _ = force_of(sliders, [top, fraction * top])
    back, _ = force_of(sliders, [(1.0 - fraction) * top / 2.0])
    assert first[1] == pytest.approx(first[0] - 2.0 * back[0], abs=1e-9 * SLIP)


@settings(max_examples=30)
@given(seed=st.integers(0, 1000), split=st.integers(1, 49))
def test_a_history_cut_in_two_is_the_same_history(seed, split):
    rng = np.random.default_rng(seed)
    sliders = Sliders(rng.uniform(1.0, 9.0, 5), rng.uniform(0.5, 2.0, 5))
    path = np.cumsum(rng.standard_normal(50))
    whole, end = force_of(sliders, path)
    first, between = force_of(sliders, path[:split])
    second, last = force_of(sliders, path[split:], between)
    np.testing.assert_array_equal(np.concatenate([first, second]), whole)
    np.testing.assert_array_equal(last, end)
    assert np.abs(whole).max() <= sliders.slip_force_n.sum() * (1.0 + 1e-12)


def test_a_settled_cycle_closes_and_one_inside_another_leaves_no_trace():
    sliders = iwan(stiffness_n_per_m=STIFFNESS, slip_force_n=SLIP)
    u = phi_max(-0.5, 1.0)
    outer, _ = force_of(sliders, np.array([0.9, -0.9, 0.4]) * u)
    inner, _ = force_of(sliders, np.array([0.9, -0.9, 0.4, 0.1, 0.4]) * u)
    assert inner[-1] == pytest.approx(outer[-1], rel=1e-12)


def test_sliders_keep_their_own_copy():
    stiffness = np.ones(2)
    sliders = Sliders(stiffness, [1.0, 1.0])
    stiffness[0] = 7.0
    assert sliders.tangent_n_per_m == 2.0
    assert not sliders.slip_force_n.flags.writeable


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Sliders([1.0], [1.0, 2.0]), "1 stiffnesses and 2 slip forces"),
        (lambda: Sliders([1.0, 0.0], [1.0, 2.0]), "stiffness_n_per_m of the sliders"),
        (lambda: Sliders([1.0], [np.inf]), "slip_force_n of the sliders"),
        (lambda: Sliders([], []), "give one positive number"),
        (lambda: force_of(Sliders([1.0], [1.0]), [[1.0]]), r"the extension has shape \(1, 1\)"),
        (lambda: force_of(Sliders([1.0], [1.0]), [1.0], [0.0, 0.0]), r"the start \(2,\)"),
        (lambda: iwan(stiffness_n_per_m=-1.0, slip_force_n=1.0), "the joint has stiffness -1.0"),
        (lambda: iwan(stiffness_n_per_m=1.0, slip_force_n=1.0, chi=-1.0), "chi is -1.0"),
        (lambda: iwan(stiffness_n_per_m=1.0, slip_force_n=1.0, n=2), "n is 2"),
        (lambda: iwan(stiffness_n_per_m=1.0, slip_force_n=1.0, smallest_fraction=1.0), "smallest_fraction 1.0"),
    ],
)
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
