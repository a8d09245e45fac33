"""Powers of nonlinear modes that become unstable beyond the tests are held there."""

from dataclasses import replace

import numpy as np
import pytest
from made_beats import C2, FOUR, FS, K3, OMEGA, ONE, ZETA, beat, beats, measured, softening
from made_modal import SOFT, small_decay, small_fit, small_modes, small_system

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.laws.law import Term, TermSet
from opid.modal.decay.free_decay import law_of_decays
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.system_fit import DrivenLaw
from opid.modal.identification import identify_modes, make_model
from opid.modal.joint_terms import SLIP, JointEstimates, JointTerms, ModalJoint
from opid.modal.model import NonlinearModalModel, modal_response, simulate
from opid.modal.power_laws import hold_unstable, list_held, power_law
from opid.modal.study import ModalStudy, StudyTest

Z = np.linspace(-3.0, 3.0, 121)
C0 = 2 * ZETA * OMEGA
SPEED = 0.3
FADING = TermSet((Term("held_damping", (-0.6 * C0 / SPEED**2, SPEED, 3.0)),))
"""Damping that fades up to a velocity, to four tenths of c0, and stays there."""


def test_the_held_force_is_the_power_within_and_its_secant_beyond():
    law = power_law({2: 0.1, 3: -0.2, 5: -0.05}, {2: 0.1, 3: -0.6})
    held = hold_unstable(law, (1.0, 0.3), (1.5, 0.5))
    assert list_held(held) == ["stiffness", "damping"]
    within = np.abs(Z) <= 1.5
    np.testing.assert_allclose(held.force(Z, 0.0)[within], law.force(Z, 0.0)[within], rtol=1e-12)
    secant = 0.1 * 1.5 - 0.2 * 1.5**2 - 0.05 * 1.5**4
    np.testing.assert_allclose(held.force(Z, 0.0)[~within], secant * Z[~within], rtol=1e-12)
    slow = np.abs(Z) <= 0.5
    np.testing.assert_allclose(held.force(0.0, Z)[slow], law.force(0.0, Z)[slow], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(held.force(0.0, Z)[~slow], (0.1 * 0.5 - 0.6 * 0.25) * Z[~slow], rtol=1e-12)


@pytest.mark.parametrize(
    ("law", "ends_at"),
    [
        # the tangent 1 - 3 z^2 vanishes, and so does what cubic damping takes from a cycle, 1 - 3/4 V^2
        (power_law({3: -1.0}, {}), 3**-0.5),
        (power_law({}, {3: -1.0}), (4 / 3) ** 0.5),
        # a spring that stiffens again is unstable between, 1 - 12 z^3 + 10 z^4, though not at the end of the range
        (power_law({4: -3.0, 5: 2.0}, {}), 0.53078),
    ],
)
def test_powers_are_held_where_they_become_unstable_within_twice_the_motion(law, ends_at):
    far, near = 0.51 * ends_at, 0.49 * ends_at
    assert hold_unstable(law, (1.0, 1.0), (near, near)) is law
    held = hold_unstable(law, (1.0, 1.0), (far, far))
    assert {term.inner[0] for term in held.terms} == {far}
    # what is past its fall at the motion of the tests already is held, too
    assert list_held(hold_unstable(law, (1.0, 1.0), (1.2 * ends_at, 1.2 * ends_at)))


def test_only_the_unstable_kind_is_held():
    law = power_law({3: -1.0}, {2: 0.1, 3: 0.1})
    held = hold_unstable(law, (1.0, 0.1), (0.5, 0.5))
    assert list_held(held) == ["stiffness"]
    speeds = np.linspace(-4.0, 4.0, 33)
    np.testing.assert_array_equal(held.force(0.0, speeds), law.force(0.0, speeds))


@pytest.mark.parametrize("times", [1.5, 3.0])
def test_a_held_mode_decays_from_beyond_its_range_where_the_powers_grow(times):
    law = power_law({}, {3: -0.6 * C0 / SPEED**2})
    free = {"fs": FS, "drive_point": "a", "velocity": [times * SPEED]}
    held = hold_unstable(law, (OMEGA**2, C0), (SPEED / OMEGA, SPEED))
    motion = modal_response(NonlinearModalModel(ONE, {1: held}), np.zeros(4096), **free).velocity[:, 0]
    peaks = np.abs(motion).reshape(-1, 64).max(axis=1)
    assert (np.diff(peaks) < 0.0).all()
    # Far beyond the range the damping is the secant there, and within it less is lost than by c0 alone.
    turns = 64 / FS
    rate = np.log(peaks[0] / peaks[1]) / turns
    assert 0.5 * 0.4 * C0 < rate < 0.5 * C0
    if times == 3.0:
        with pytest.raises(InputError, match="grows without bound"):
            modal_response(NonlinearModalModel(ONE, {1: law}), np.zeros(4096), **free)


@pytest.fixture(scope="module")
def fading():
    """Beats within the velocity at which damping has faded, and two truth tests beyond it, of mode 3."""
    rng = np.random.default_rng(3)
    world = NonlinearModalModel(FOUR, {3: FADING})
    tests = [StudyTest(each) for each in beats(world, rng, (1.5, 4.0, 6.5, 8.6))]
    truths = [StudyTest(measured(world, beat(each), rng, name=f"{each:g} N"), "truth") for each in (12.5, 23.0)]
    study = ModalStudy("fading", FOUR, (3,), (*tests, *truths), "a", 1, 3, False)
    return study, identify_modes(study)


def test_a_truth_test_beyond_held_powers_does_not_grow_and_is_told(fading):
    study, found = fading
    assert list_held(found.model.laws[3]) == ["damping"]
    told = [warning for warning in found.warnings if "with its powers of damping held" in warning]
    times = [float(warning.split("times as far")[0].split()[-1]) for warning in told]
    np.testing.assert_allclose(times, [1.5, 3.0], atol=0.15)
    # The world keeps its damping beyond the tests, too, so that the held model predicts it.
    for test in found.truth_tests:
        for sensor in test.sensors.values():
            assert sensor.nrmse_nonlinear < 0.08 < 0.3 < sensor.nrmse_linear
    plain = NonlinearModalModel(found.model.modes, {3: found.fits[0].law})
    for each in study.of_use("truth"):
        with pytest.raises(InputError, match="grows without bound"):
            simulate(plain, each.test.forces[0].samples, fs=FS, drive_point="a")


def test_a_stable_law_stays_as_it_is_to_the_last_bit():
    fit = fit_mode(beats(softening(FOUR, 3), np.random.default_rng(2)), 3, stiffness_order=3, damping_order=2)
    assert (fit.stiffness[3].value, fit.damping[2].value) == pytest.approx((K3, C2), rel=0.02)
    model = make_model(FOUR, [fit])
    assert model.laws[3] == fit.law
    force = beat(60.0)
    plain = NonlinearModalModel(FOUR, {3: fit.law})
    assert np.array_equal(*(simulate(each, force, fs=FS, drive_point="a").samples for each in (model, plain)))


def test_laws_of_driven_modes_are_held_too():
    modes = small_modes()
    k0 = float(modes.stiffness()[3])

    def model_of(k3, *slip):
        values = tuple(Estimate.normal(each, 0.0) for each in slip)
        joint = JointEstimates(kind=SLIP if slip else None, values=values)
        law = DrivenLaw({3: Estimate.normal(k3, 0.0)}, {}, joint, largest=2e-4)
        return make_model(modes, [small_fit()], systems=[replace(small_system(), driven={4: law})])

    def unstable(k0):
        """The k3 whose tangent vanishes at twice the largest displacement."""
        return -k0 / (3 * 4e-4**2)

    assert list_held(model_of(1.01 * unstable(k0)).laws[4]) == ["stiffness"]
    stable = model_of(0.99 * unstable(k0))
    assert list_held(stable.laws[4]) == []
    assert stable.laws[SOFT] == small_fit().law
    # At twice the largest displacement all of the joint slips, and carries nothing of a further motion.
    slip = 0.3 * k0 / (4e-4**0.5 / 0.5)
    carried = ModalJoint(JointTerms(slip=slip, exponent=-0.5), 2e-4).stuck_stiffness
    assert carried == pytest.approx(0.3 * k0, rel=1e-9)
    assert list_held(model_of(1.01 * unstable(0.7 * k0), slip, -0.5).laws[4]) == ["stiffness"]
    assert list_held(model_of(0.99 * unstable(0.7 * k0), slip, -0.5).laws[4]) == []


def test_the_law_of_free_decays_is_held_too():
    """Decays stand for a mode that no forced test moves."""
    law = law_of_decays([small_decay()])
    assert make_model(small_modes(), [], {SOFT: law}).laws[SOFT] == law.law
    steep = replace(law, stiffness=law.stiffness | {5: Estimate.normal(-1e20, 0.0)})
    model = make_model(small_modes(), [], {SOFT: steep})
    assert list_held(model.laws[SOFT]) == ["stiffness"]
    assert {term.inner[0] for term in model.laws[SOFT].terms if term.name == "held_stiffness"} == {law.amplitude.max()}
