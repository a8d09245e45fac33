"""Couplings of modes that become unstable beyond the tests are held there, as powers are."""

from dataclasses import replace

import numpy as np
import pytest
from made_modal import SOFT, small_fit, small_modes, small_system

from opid.errors import InputError
from opid.estimate import Estimate
from opid.modal.couplings import Coupling, Product, Reach, is_stable_beyond, list_products, make_joints
from opid.modal.identification import identify_modes, make_model
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.model import NonlinearModalModel, modal_response, simulate
from opid.modal.power_laws import power_law
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.recording import Channel

FS = 1024.0
MODES = LinearModes([60.0, 121.0], [0.004, 0.006], [[0.5, 0.1], [0.3, -0.4], [-0.2, 0.5]], ("a", "b", "c"))
LARGEST = {1: 2e-4, 2: 1e-4}
REACH = Reach(LARGEST, {1: 2 * np.pi * 60 * 2e-4, 2: 2 * np.pi * 121 * 1e-4})
DRIVES = Product((1, 1, 2))


def force_of_joints(joints, at, of_velocity=False):
    force = np.zeros(np.shape(at))
    for joint in joints:
        z = at @ joint.direction
        force += np.outer(joint.law.force(0.0, z) if of_velocity else joint.law.force(z, 0.0), joint.direction)
    return force


@pytest.mark.parametrize(("degree", "of_velocity"), [(3, False), (4, False), (4, True)])
def test_held_couplings_are_the_products_within_and_follow_from_a_potential_beyond(degree, of_velocity):
    rng = np.random.default_rng(degree)
    products = list_products((1, 2), degree, of_velocity=of_velocity)
    couplings = dict(zip(products, rng.normal(size=len(products)), strict=True))
    size = np.array([*(REACH.velocity if of_velocity else LARGEST).values()])
    free, held = make_joints(couplings, 2), make_joints(couplings, 2, REACH)
    within = size * rng.uniform(-1.0, 1.0, (200, 2))
    both = [force_of_joints(each, within, of_velocity) for each in (free, held)]
    np.testing.assert_allclose(both[1], both[0], rtol=1e-9, atol=1e-9 * np.abs(both[0]).max())
    # Far beyond, twice the motion meets twice the force, and the slopes of the forces by each other's motion agree.
    far = size * [40.0, 4.0] * rng.uniform(1.0, 1.2, (50, 2)) * rng.choice([-1.0, 1.0], (50, 2))
    twice, once = (force_of_joints(held, times * far, of_velocity) for times in (2.0, 1.0))
    np.testing.assert_allclose(twice, 2.0 * once, rtol=1e-9, atol=1e-9 * np.abs(once).max())
    h = 1e-6 * size
    slopes = [
        force_of_joints(held, far + h * axis, of_velocity) - force_of_joints(held, far - h * axis, of_velocity)
        for axis in np.eye(2)
    ]
    one, other = slopes[0][:, 1] / h[0], slopes[1][:, 0] / h[1]
    np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-5 * np.abs(one).max())


def test_a_coupling_is_stable_as_long_as_every_small_motion_meets_a_stiffness():
    k = MODES.stiffness()

    def is_stable(coefficient):
        return is_stable_beyond({DRIVES: coefficient}, (k, MODES.damping()), {}, REACH)

    # (k1 + 2 c q2) k2 = (2 c q1)^2 at twice the largest motion, where q2 pulls mode 1 most.
    q1, q2 = 2 * LARGEST[1], 2 * LARGEST[2]
    ends = max(np.roots([4 * q1**2, 2 * q2 * k[1], -k[0] * k[1]]))
    assert is_stable(0.99 * ends)
    assert not is_stable(1.01 * ends)
    assert not is_stable(-1.01 * ends)


def test_damping_by_a_coupling_that_feeds_a_mode_is_held_too():
    product = Product((1, 1, 2, 2), of_velocity=True)
    c = MODES.damping()
    feeds = -c[0] / (2 * (2 * REACH.velocity[2]) ** 2)
    assert not is_stable_beyond({product: 3.0 * feeds}, (MODES.stiffness(), c), {}, REACH)
    assert is_stable_beyond({product: 0.2 * feeds}, (MODES.stiffness(), c), {}, REACH)


def system_of(coefficient):
    return replace(small_system(), couplings=(Coupling(Product((SOFT, SOFT, 4)), Estimate.normal(coefficient, 0.0)),))


def test_a_stable_coupling_stays_as_it_is_and_an_unstable_one_is_held():
    modes = small_modes()
    stable = make_model(modes, [small_fit()], systems=[system_of(2e7)])
    assert stable.reach is None
    unstable = make_model(modes, [small_fit()], systems=[system_of(2e11)])
    assert set(unstable.reach.displacement) == {SOFT, 4}
    assert unstable.reach.displacement[4] == small_system().driven[4].largest


def world(coefficient, reach=None):
    return NonlinearModalModel(MODES, {1: power_law({3: 2e9}, {})}, {}, {DRIVES: coefficient}, reach)


@pytest.mark.parametrize("times", [1.5, 3.0])
def test_held_modes_decay_from_beyond_their_range_where_the_products_run_away(times):
    k = MODES.stiffness()
    coefficient = 0.9 * np.sqrt(k[0] * k[1]) / (2 * LARGEST[1])
    start = {"displacement": times * np.array([2e-4, -1e-4]), "fs": FS, "drive_point": "a"}
    free = modal_response(world(coefficient, REACH), np.zeros(4096), **start)
    assert np.abs(free.displacement[-400:]).max() < 0.8 * np.abs(free.displacement[:400]).max()
    if times == 3.0:
        with pytest.raises(InputError, match="grows without bound"):
            modal_response(world(coefficient), np.zeros(4096), **start)


def beat(level, name, rng, model):
    time = np.arange(4096) / FS
    window = np.where(time < 0.4, np.sin(np.pi * time / 0.4) ** 2, 0.0)
    force = level * window * np.sin(2 * np.pi * 60.0 * time)
    motion = simulate(model, force, fs=FS, drive_point="a")
    samples = np.column_stack([motion.samples, force])
    samples = samples + 0.003 * samples.std(axis=0) * rng.standard_normal(samples.shape)
    record = replace(motion, samples=samples, channels=(*motion.channels, Channel("force", "N")))
    return modal_test(record, MODES, name=name, force="force", drive_point="a")


@pytest.mark.parametrize("seed", [0, 1])
def test_a_truth_test_beyond_held_couplings_is_predicted_and_told(seed):
    """A spring that softens leaves so little stiffness beyond the tests that the coupling would take the rest."""
    rng, k = np.random.default_rng(seed), MODES.stiffness()
    softer, drives = -0.8 * k[0] / (12 * LARGEST[1] ** 2), 0.3 * np.sqrt(k[0] * k[1]) / (4 * LARGEST[1])
    true = NonlinearModalModel(MODES, {1: power_law({3: softer}, {})}, {}, {DRIVES: drives}, REACH)
    tests = [StudyTest(beat(level, f"beat_{level:g}", rng, true), "fit", 1) for level in (0.8, 1.6, 2.4, 3.2)]
    tests.append(StudyTest(beat(6.0, "beyond", rng, true), "truth"))
    found = identify_modes(ModalStudy("coupled", MODES, (1,), tuple(tests), "a", 3, 1, False, couplings=((1, 1, 2),)))
    assert set(found.model.reach.displacement) == {1, 2}
    assert any("with its couplings held where they would become unstable" in text for text in found.warnings)
    (truth,) = found.truth_tests
    for sensor in truth.sensors.values():
        assert sensor.nrmse_nonlinear < 0.15 < 1.5 < sensor.nrmse_linear
