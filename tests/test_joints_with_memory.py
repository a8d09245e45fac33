"""Joints that slip in a class: their steady cycles against motions in time, and curves whose law is updated."""

from dataclasses import replace

import numpy as np
import pytest
from made_dampers import AMPLITUDE, CONTROLLED, CUBIC, DRIVE, EVERYWHERE, RATIO, SPRING, study, system
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.backbones.dissipation import PlacedTerm, find_loss
from opid.mechanics.backbones.family import backbone, family_evaluator
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.memory import force_along, force_at_turns, loop_area, sine_like
from opid.modal.joint_terms import find_joint_curves, find_rest_stiffness, load_joint
from opid.updating.likelihood.backbones import backbone_data
from opid.updating.likelihood.force import force_data
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.posterior import update_class
from opid.updating.unmeasured_modes import PredictionSettings, ResponseSettings

IWAN, JENKINS, DAHL = (40.0, 1e-3, 0.4, 0.7), (40.0, 1e-3, 0.6, 1e9), (40.0, 1e-3)
JOINTS = [("dahl_friction", DAHL), ("iwan_friction", IWAN), ("iwan_friction", JENKINS)]


def one_mass(eigenvalue=1e6):
    return JointedModes([eigenvalue], [[1.0]], [[1.0]], ("mass",), ("joint",))


def find_cycle(name, z, reach, values):
    return LAWS[name].cycle(z, reach, *(*values[1:], 1.0, 1.0)[:3])


@pytest.mark.parametrize(("name", "values"), JOINTS[:2])
@pytest.mark.parametrize("reach", [3e-4, 1.2e-3, 6e-3])
def test_a_cycle_is_that_of_the_law_followed_in_time(name, values, reach):
    # The kind itself has twenty elements in the place of many sliders.
    tolerance = 1e-3 if name == "dahl_friction" else 2e-2
    z, v, fs = sine_like(reach / np.sqrt(2), reach * 10.0)
    law, n = Law((Term(name, values),)), 2000
    force, travel = force_along(law, z, v, fs)[-n:], z[-n:]
    # Small cycles forget slowly where they began; it adds the same to a cycle and to the opposite one.
    force = 0.5 * (force - np.roll(force, n // 2))
    # At half a turn less each angle the motion passes the same travel in the other direction.
    mean = 0.5 * (force + force[(n // 2 - np.arange(n)) % n])
    expected = find_rest_stiffness(name, values) * travel
    expected += values[0] * find_cycle(name, travel, np.full(n, reach), values)[0]
    np.testing.assert_allclose(mean, expected, atol=tolerance * np.abs(force).max())
    lost = values[0] * LAWS[name].cycle_loss(reach, *(*values[1:], 1.0, 1.0)[:3])
    assert lost == pytest.approx(loop_area(law, z, v, fs), rel=3 * tolerance)


@pytest.mark.parametrize(("name", "values"), JOINTS)
def test_the_force_where_cycles_turn_is_that_of_first_loading(name, values):
    z = np.linspace(1e-5, 5e-3, 40)
    turned = force_at_turns(Law((Term(name, values), Term("cubic_stiffness", (1e9,)))), z)
    loaded = load_joint(name, values, z)
    if name == "dahl_friction":
        # Its steady cycles turn at A tanh(Z / s), not at the A (1 - exp(-Z / s)) of first loading.
        loaded = values[0] * np.tanh(z / values[1])
    np.testing.assert_allclose(
        turned, loaded - find_rest_stiffness(name, values) * z + 1e9 * z**3, rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(force_at_turns(Law((Term(name, values),)), -z), 1e9 * z**3 - turned, atol=1e-9)


@pytest.mark.parametrize(("name", "values"), JOINTS)
def test_one_mass_has_the_closed_form_of_slip(name, values):
    amplitude = np.geomspace(1e-4, 1e-2, 15)
    softening, damping = find_joint_curves(name, values, amplitude)
    curve = backbone(one_mass(), Law((Term(name, values),)), mode=1, sensor="mass", amplitude=amplitude)
    np.testing.assert_allclose(1e6 - (2 * np.pi * curve.frequency_hz) ** 2, softening, rtol=1e-3)
    found = family_evaluator(one_mass(), (name,), mode=1, sensor="mass", amplitude=amplitude)(np.array([values]))
    placed = [PlacedTerm(name, np.array([values]), np.ones(1, dtype=bool))]
    lost, _ = find_loss(found, one_mass(), placed, [], np.zeros(1))
    np.testing.assert_allclose(lost[0], np.pi * amplitude**2 * damping, rtol=1e-4)


@pytest.mark.parametrize("name", ["iwan_friction", "dahl_friction"])
def test_slopes_of_backbones_are_those_of_differences(name):
    theta = np.array([[CUBIC, 1.0, 1.2e-3, 0.45, 0.6][: 3 if name == "dahl_friction" else 5]])
    solve = family_evaluator(
        system(), ("cubic_stiffness", name), mode=1, sensor=CONTROLLED, amplitude=AMPLITUDE, harmonics=(1, 3)
    )
    by_value, by_shape = solve.find_slopes(theta, solve(theta))
    for column in range(theta.size):
        step = np.zeros_like(theta)
        step[0, column] = 1e-5 * theta[0, column]
        more, less = solve(theta + step), solve(theta - step)
        for slopes, attribute in ((by_value, "eigenvalue"), (by_shape, "shapes")):
            differences = (getattr(more, attribute) - getattr(less, attribute)) / (2 * step[0, column])
            np.testing.assert_allclose(slopes[..., column], differences, atol=1e-6 * np.abs(differences).max())


def test_a_driven_mass_with_sliders_has_the_predicted_amplitude_and_phase():
    """Thirty sliders beside a spring, in time, driven at the frequency and by the force that the backbone has."""
    (force_n, travel, spread, _), n = (400.0, 1e-3, 0.5, 0.0), 30
    values, amplitude = (force_n, travel, spread, 1e-6), 0.8e-3
    # With this spread the sliders are as stiff as each other, and slip at evenly spread travels.
    slips = travel * (np.arange(n) + 0.5) / n
    stiffness = force_n / np.sum(slips)
    system_at_rest = one_mass(1e6 + n * stiffness)
    found = family_evaluator(system_at_rest, ("iwan_friction",), mode=1, sensor="mass", amplitude=[amplitude])
    curve = found(np.array([values]))
    placed = [PlacedTerm("iwan_friction", np.array([values]), np.ones(1, dtype=bool))]
    lost = find_loss(curve, system_at_rest, placed, [], np.zeros(1))[0][0, 0]
    omega, drive = np.sqrt(curve.eigenvalue[0, 0]), lost / (np.pi * amplitude)

    def move(t, y):
        stretch = y[2:]
        slides = ((stretch >= slips) & (y[1] > 0)) | ((stretch <= -slips) & (y[1] < 0))
        pull = stiffness * np.clip(stretch, -slips, slips).sum()
        return np.concatenate([[y[1], drive * np.cos(omega * t) - 1e6 * y[0] - pull], np.where(slides, 0.0, y[1])])

    n_cycles, period = 60, 2 * np.pi / omega
    end = n_cycles * period
    times = end - period + period * (np.arange(256) + 0.5) / 256
    answer = solve_ivp(
        move, (0.0, end), np.zeros(n + 2), t_eval=times, rtol=1e-6, atol=1e-9, max_step=period / 100, method="RK23"
    )
    first = 2 * np.mean(answer.y[0] * np.exp(-1j * omega * times))
    assert abs(first) == pytest.approx(amplitude, rel=0.01)
    assert np.degrees(np.angle(first)) == pytest.approx(-90.0, abs=1.5)


# ---- classes ------------------------------------------------------------------------------------------

TRUE = (1.0, 1.2e-3, 0.45, 0.6)
SLIP = UncertainTerm("iwan_friction", (1.0, 1e-3, 0.45, 0.6), (Prior(), Prior("lognormal", 1.0, 1.0), None, None))
BENDING = UncertainTerm("dahl_friction", (1.0, 1e-3), (Prior(), Prior("lognormal", 1.0, 1.0)))
CLASSES = (
    ModelClass("iwan", (SPRING, SLIP)),
    ModelClass("spring", (SPRING,)),
    ModelClass("dahl", (SPRING, BENDING)),
)


def measure(seed, *, force=True):
    """Three curves of each mode with noise, all with one error of calibration, of cubic springs and Iwan joints."""
    rng, found = np.random.default_rng(seed), []
    gain = 1 + 0.02 * rng.standard_normal()
    built = replace(system(), eigenvalue=system().eigenvalue * (1 + 0.004 * rng.standard_normal(3)) ** 2)
    kinds, theta = ("cubic_stiffness", "iwan_friction"), np.array([[CUBIC, *TRUE]])
    placed = [PlacedTerm(kind, np.array([own]), EVERYWHERE) for kind, own in zip(kinds, ((CUBIC,), TRUE), strict=True)]
    for mode in (1, 2):
        solve = family_evaluator(built, kinds, mode=mode, sensor=CONTROLLED, amplitude=AMPLITUDE, harmonics=(1, 3))
        true = solve(theta)
        lost, n = find_loss(true, built, placed, [], np.array([RATIO]))[0][0], AMPLITUDE.size
        for number in range(3):
            hz = true.frequency_hz[0] * (1 + 5e-4 * rng.standard_normal() + 1e-4 * rng.standard_normal(n))
            force_n = gain * lost / (np.pi * AMPLITUDE) * (1 + 5e-3 * rng.standard_normal((2, n)).sum(axis=0))
            shapes = true.shapes[0] * (1 + 3e-3 * rng.standard_normal(true.shapes[0].shape))
            shapes[:, 0] = AMPLITUDE
            driven = {"drive": DRIVE, "force_n": force_n} if force else {}
            found.append(
                MeasuredBackbone(
                    f"mode {mode}, curve {number}", mode, CONTROLLED, hz, shapes, system().sensors, **driven
                )
            )
    return tuple(found)


def update(measured, *, force):
    data = backbone_data(system(), measured)
    if force:
        known = dict.fromkeys((1, 2), RATIO)
        data = replace(data, force=force_data(data.modes, measured, NoiseSettings(), known))
    rng = np.random.default_rng(1)
    return [update_class(data, each, rng=rng, n_samples=1000, evidences=("laplace",)) for each in CLASSES]


def test_slip_is_chosen_and_its_intervals_hold():
    own, *others = update(measure(0), force=True)
    assert own.evidences[0].log_evidence > 10 + max(each.evidences[0].log_evidence for each in others)
    truth, std = np.array([1.0, TRUE[0], TRUE[1] / 1e-3]), np.sqrt(np.diag(own.covariance))
    assert (np.abs(own.best - truth) < 2.5 * std).all()
    # Force and travel of slip are told within a few per cent.
    assert (std < 0.02 * truth).all()
    # The other classes do not lose the measured energy, and that is told.
    for each in others:
        assert any("force of mode" in warning for warning in each.warnings)


def test_slip_is_told_by_frequencies_alone():
    own, *others = update(measure(3, force=False), force=False)
    assert own.evidences[0].log_evidence > 10 + max(each.evidences[0].log_evidence for each in others)
    truth, std = np.array([1.0, TRUE[0], TRUE[1] / 1e-3]), np.sqrt(np.diag(own.covariance))
    assert (np.abs(own.best - truth) < 2.5 * std).all()


def test_what_needs_more_than_steady_cycles_is_refused():
    with pytest.raises(InputError, match="lugre_friction' has a memory whose steady cycle is not known"):
        UncertainTerm("lugre_friction", (1.0, 1e-3, 1.4, 0.05, 1e-3), (Prior(), None, None, None, None))
    with pytest.raises(InputError, match="no end of its stiffness while nothing slides: give values below 1"):
        UncertainTerm("iwan_friction", (1.0, 1e-3, 0.5, 0.6), (Prior(), None, Prior("lognormal", 1.0, 0.3), None))
    with pytest.raises(
        InputError, match="amplitude_n of 'dahl_friction' is positive, and its prior allows values below 0"
    ):
        # A negative slip force would feed energy in.
        UncertainTerm("dahl_friction", (1.0, 1e-3), (Prior("normal", 1.0, 0.5), None))
    with pytest.raises(InputError, match="a joint has dahl_friction, which has a memory: give springs and dampers"):
        Specimen(one_mass(), Law((Term("dahl_friction", DAHL),)), RATIO, "mass")
    with pytest.raises(InputError, match="has a joint with memory and interaction is 'keep', take 'omit'"):
        study(measure(0), classes=CLASSES, interaction="keep", met_damping=0.002)
    response = PredictionSettings(responses=(ResponseSettings(mode=1, drive=DRIVE, force_n=(0.1,)),))
    with pytest.raises(InputError, match="whose response to a force is not modelled"):
        study(measure(0), classes=CLASSES, prediction=response)
    even = ModelClass("even", (UncertainTerm("even_quadratic_stiffness", (1e4,), (Prior(),)), SLIP))
    with pytest.raises(InputError, match="is not odd and has a memory"):
        study(measure(0), classes=(even,), harmonics=(0, 1, 2, 3))
