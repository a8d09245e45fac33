from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.laws.law import law
from opid.mechanics.rig import Rig, Shaker
from opid.mechanics.structure import Joint, Structure
from opid.modal.linear.modes import LinearModes, modes_of_structure
from opid.modal.resonance.appropriation import appropriate_force, modal_interaction
from opid.modal.resonance.phase_lock import PhaseLock
from opid.virtual.modal_tests.bolted_structures import case_study_2

LOW_HZ, HIGH_HZ = 100.0, 204.0
SHAPES = np.array([[0.8, 0.05], [-0.5, 0.7], [0.3, -0.6]])
NAMES = ("drive", "left", "right")


def two_modes(square=0.0, shaker=None, shapes=SHAPES):
    """Two modes, the lower works on the higher by b z^2, z = q1 + q2."""
    omega, zeta = 2 * np.pi * np.array([LOW_HZ, HIGH_HZ]), np.array([0.004, 0.006])
    joints = (Joint("joint", (1.0, 1.0), law=law("even_quadratic_stiffness", stiffness_n_per_m2=square)),)
    structure = Structure(np.eye(2), np.diag(2 * zeta * omega), np.diag(omega**2), joints)
    return Rig(structure, shapes[0], shapes, NAMES, shaker), modes_of_structure(structure, shapes, NAMES)


def hold(rig, modes, levels_v, mode=1, seed=1, **settings):
    return appropriate_force(rig, modes, mode, levels_v=levels_v, rng=np.random.default_rng(seed), **settings)


def plate(levels_v, **build):
    study = case_study_2(**build)
    return hold(study.rig, study.modes, levels_v, mode=10)


@pytest.mark.parametrize("ratio", [1.99, 2.02])
def test_the_coupled_plate_is_flagged(ratio):
    appropriation = plate(np.geomspace(20.0, 32.0, 5), ratio=ratio)
    found = modal_interaction(appropriation)
    assert appropriation.locked.all()
    assert found.flagged
    assert (found.target, found.mode, found.harmonic) == (10, 18, 2)
    assert found.holds[-1]
    assert (found.mac[found.holds] >= 0.9).all()
    assert (found.mac_of_others < 0.3).all()
    assert (found.driven_fraction < 0.1).all()
    assert found.statement.startswith("Mode 10 drives mode 18: from level")


@pytest.mark.parametrize("build", [{"ratio": 2.2}, {"coupling_n_per_m2": 0.0}])
def test_the_detuned_and_the_uncoupled_plate_are_not(build):
    appropriation = plate(np.geomspace(8.0, 31.0, 4), **build)
    found = modal_interaction(appropriation)
    assert appropriation.locked.all()
    assert not found.flagged
    assert found.first_level is None
    assert not found.holds.any()
    assert found.fraction.max() < 0.35
    assert found.statement.startswith("No interaction is seen")


def test_a_weak_interaction_has_the_share_of_perturbation():
    square, levels = 2e6, [1.0, 2.0]
    appropriation = hold(*two_modes(square), levels, noise_fraction=0.0)
    found = modal_interaction(appropriation)
    assert (found.mode, found.harmonic) == (2, 2)
    q, omega = appropriation.amplitude, 2 * np.pi * appropriation.frequency_hz
    high = 2 * np.pi * HIGH_HZ
    dynamic = np.abs(high**2 - (2 * omega) ** 2 + 2j * 0.006 * high * 2 * omega)
    np.testing.assert_allclose(found.fraction, 4.0 * (square * q / 2.0) / dynamic, rtol=0.02)


def test_a_mode_that_the_shaker_drives_is_no_interaction():
    # a poor shaker, and a drive point at which the higher mode moves well
    shaker = Shaker(armature_kg=0.05, back_emf_n_s_per_m=5.0, second_harmonic=0.9)
    rig, modes = two_modes(shaker=shaker, shapes=np.array([[0.3, 0.8], [-0.5, 0.7], [0.3, -0.6]]))
    appropriation = hold(rig, modes, [14.0, 20.0, 28.0])
    found = modal_interaction(appropriation)
    assert appropriation.locked.all()
    assert (found.mode, found.harmonic) == (2, 2)
    assert (found.fraction > 0.5).all()
    assert (found.mac > 0.9).all()
    np.testing.assert_allclose(found.driven_fraction, 1.0, rtol=0.05)
    assert not found.flagged
    assert "can have driven 1" in found.statement


def test_levels_that_did_not_lock_do_not_count():
    rig, modes = two_modes(3e7)
    locked = hold(rig, modes, [8.0, 9.0, 10.0])
    assert modal_interaction(locked).flagged
    lost = replace(locked, levels=tuple(replace(level, locked=False) for level in locked.levels))
    found = modal_interaction(lost)
    assert not found.flagged
    assert "No level of mode 1 locked" in found.statement
    one = replace(locked, levels=(*lost.levels[:2], locked.levels[2]))
    assert not modal_interaction(one).flagged
    assert modal_interaction(one, least_levels=1).first_level == 3


def test_the_thresholds_decide():
    locked = hold(*two_modes(3e7), [8.0, 9.0, 10.0], settings=PhaseLock(record_periods=20))
    assert not modal_interaction(locked, least_fraction=50.0).flagged
    assert not modal_interaction(locked, most_driven=1e-9).flagged


def test_bad_input_is_refused():
    rig, modes = two_modes()
    found = hold(rig, modes, [1.0], settings=PhaseLock(record_periods=4))
    for wrong in ({"least_fraction": 0.0}, {"least_assurance": 1.0}, {"most_driven": -1.0}):
        with pytest.raises(InputError, match="positive numbers, and a MAC below 1"):
            modal_interaction(found, **wrong)
    with pytest.raises(InputError, match="least_levels is 0"):
        modal_interaction(found, least_levels=0)
    with pytest.raises(InputError, match="other sensors or another number of modes"):
        modal_interaction(found, LinearModes([100.0], [0.004], [[1.0]], ("drive",)))
    single = LinearModes(modes.frequency_hz * [1.0, 0.0], modes.damping_ratio, modes.shapes, NAMES)
    with pytest.raises(InputError, match="no other elastic mode"):
        modal_interaction(found, single)
