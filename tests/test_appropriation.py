from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.laws.law import LINEAR, law
from opid.mechanics.rig import Rig, Shaker
from opid.mechanics.structure import Joint, Structure, iwan
from opid.modal.linear.modes import LinearModes, modes_of_structure
from opid.modal.resonance.appropriation import appropriate_force, levels_for
from opid.modal.resonance.phase_lock import PhaseLock
from opid.virtual.modal_tests.bolted_structures import case_study_1, level_dependence

HZ, ZETA, KG = 120.0, 0.004, 2.0
OMEGA = 2.0 * np.pi * HZ
QUIET = {"noise_fraction": 0.0}


def one_mode(force=LINEAR, sliders=None, shaker=None):
    """A mass on a spring with a joint beside it, driven where its sensor is, and its linear mode."""
    stuck = sliders.tangent_n_per_m if sliders else 0.0
    joint = Joint("joint", (1.0,), law=force, sliders=sliders)
    structure = Structure([[KG]], [[2 * ZETA * OMEGA * KG]], [[KG * OMEGA**2 - stuck]], (joint,))
    return Rig(structure, (1.0,), [[1.0]], ("mass",), shaker), modes_of_structure(structure, [[1.0]], ("mass",))


def run(rig, modes, levels_v, mode=1, seed=1, **settings):
    return appropriate_force(rig, modes, mode, levels_v=levels_v, rng=np.random.default_rng(seed), **settings)


def test_a_linear_mode_is_held_at_its_closed_form():
    forces = np.array([1.0, 5.0, 20.0])
    found = run(*one_mode(), forces, **QUIET)
    assert found.locked.all()
    assert all(abs(level.phase_error_deg) < 1.0 for level in found.levels)
    # a degree of phase is zeta / 57 of the frequency
    np.testing.assert_allclose(found.frequency_hz, HZ, rtol=1.2 * ZETA / 57.0)
    np.testing.assert_allclose(found.damping_ratio, ZETA, rtol=4e-3)
    np.testing.assert_allclose(np.abs(found.sensors[:, 0, 0]), forces / (2 * ZETA * KG), rtol=4e-3)
    np.testing.assert_allclose(found.amplitude, forces / (2 * ZETA * np.sqrt(KG) * OMEGA**2), rtol=4e-3)
    np.testing.assert_allclose(np.abs(found.force), [[f, 0, 0, 0, 0] for f in forces], atol=1e-9)


def test_a_wrong_natural_frequency_is_corrected_from_either_side():
    rig, modes = one_mode()
    for fraction in (0.97, 1.03):
        wrong = replace(modes, frequency_hz=fraction * modes.frequency_hz)
        found = run(rig, wrong, [5.0], **QUIET)
        assert found.locked.all()
        np.testing.assert_allclose(found.frequency_hz, HZ, rtol=1.2 * ZETA / 57.0)


def test_the_backbone_of_a_cubic_spring_has_its_closed_form():
    for sign in (-1.0, 1.0):
        k3 = sign * 4e9
        found = run(*one_mode(law("cubic_stiffness", stiffness_n_per_m3=k3)), np.geomspace(2.0, 30.0, 5), **QUIET)
        assert found.locked.all()
        x = found.amplitude / np.sqrt(KG)
        # to the first harmonic
        backbone = np.sqrt(OMEGA**2 + 0.75 * k3 / KG * x**2) / (2 * np.pi)
        np.testing.assert_allclose(found.frequency_hz, backbone, rtol=1.5e-4)
        assert abs(backbone[-1] / HZ - 1.0) > 0.01
        # the amplitude stands to half a per cent
        np.testing.assert_allclose(found.damping_ratio * found.frequency_hz / HZ, ZETA, rtol=4e-3)


def test_a_joint_that_slips_shows_its_frequency_and_damping():
    rig, modes = one_mode(sliders=iwan(stiffness_n_per_m=0.1 * KG * OMEGA**2, slip_force_n=80.0))
    found = run(rig, modes, np.geomspace(1.0, 25.0, 5), **QUIET)
    truth = level_dependence(rig.structure, mode=1, amplitude=found.amplitude)
    assert found.locked.all()
    assert truth.zeta[-1] > 1.5 * truth.zeta[0]
    np.testing.assert_allclose(found.frequency_hz, truth.frequency_hz, rtol=3e-4)
    np.testing.assert_allclose(found.damping_ratio, truth.zeta, rtol=0.02)


def test_the_shaker_changes_the_force_but_not_what_is_found():
    cubic = law("cubic_stiffness", stiffness_n_per_m3=-4e9)
    shaker = Shaker(armature_kg=0.2, back_emf_n_s_per_m=60.0)
    found = run(*one_mode(cubic, shaker=shaker), [1.0, 4.0], noise_fraction=0.01)
    assert found.locked.all()
    # it drops near resonance
    assert (np.abs(found.force[:, 0]) < 0.6 * shaker.force_per_volt_n * found.voltage_v).all()
    x = found.amplitude / np.sqrt(KG)
    np.testing.assert_allclose(
        found.frequency_hz, np.sqrt(OMEGA**2 - 0.75 * 4e9 / KG * x**2) / (2 * np.pi), rtol=1.5e-4
    )
    np.testing.assert_allclose(found.damping_ratio * found.frequency_hz / HZ, ZETA, rtol=0.01)


def test_noise_does_not_keep_the_loop_from_locking_and_repeats_with_its_seed():
    rig, modes = one_mode()
    one, same, other = (run(rig, modes, [2.0, 3.0], seed=seed) for seed in (1, 1, 2))
    assert one.locked.all()
    assert other.locked.all()
    np.testing.assert_array_equal(one.modal, same.modal)
    assert not np.array_equal(one.modal, other.modal)
    np.testing.assert_allclose(one.damping_ratio, ZETA, rtol=0.01)


def test_a_mode_among_others_is_held_and_filtered():
    study = case_study_1()
    found = run(study.rig, study.modes, [0.3, 3.0], mode=12)
    assert found.locked.all()
    assert found.range_hz == pytest.approx((239.5, 279.0), abs=0.5)
    truth = level_dependence(study.rig.structure, mode=12, amplitude=found.amplitude)
    # the other modes move the drive point, too, and so its phase resonance by some 1e-3 of the frequency
    np.testing.assert_allclose(found.frequency_hz, truth.frequency_hz, rtol=1e-3)
    np.testing.assert_allclose(found.damping_ratio, truth.zeta, rtol=0.03)
    assert "2 of 2 levels of mode 12 locked" in found.text


def test_levels_that_do_not_lock_are_kept_and_said_so():
    rig, modes = one_mode()
    done = []
    short = PhaseLock(longest_s=0.3)
    found = run(rig, modes, [2.0, 3.0], settings=short, progress=lambda k, n: done.append((k, n)))
    assert found.locked.tolist() == [False, False]
    assert done == [(1, 2), (2, 2)]
    assert "not locked within 0.3 s" in found.levels[0].text
    assert found.text.startswith("0 of 2 levels")
    assert found.modal.shape == (2, 1, 5)
    assert np.isfinite(found.modal).all()


def test_a_range_that_ends_before_the_resonance_is_named_as_the_cause():
    rig, modes = one_mode(law("cubic_stiffness", stiffness_n_per_m3=4e9))
    narrow = PhaseLock(range_hz=(119.0, 120.3), longest_s=2.0)
    found = run(rig, modes, [2.0, 60.0], settings=narrow)
    assert found.locked.tolist() == [True, False]
    assert "end of its range" in found.levels[1].text


def test_levels_reach_the_amplitude_asked_for():
    rig, modes = one_mode(law("quadratic_damping", damping_n_s2_per_m2=20.0))
    rng = np.random.default_rng(3)
    voltages = levels_for(rig, modes, 1, top_m_per_s2=400.0, rng=rng, n_levels=5, lowest_fraction=0.1)
    np.testing.assert_allclose(voltages[1:] / voltages[:-1], 0.1**-0.25)
    found = run(rig, modes, voltages[-1:])
    assert abs(found.sensors[0, 0, 0]) == pytest.approx(400.0, rel=0.02)


def test_an_amplitude_beyond_the_range_is_not_determined():
    rig, modes = one_mode(law("cubic_stiffness", stiffness_n_per_m3=4e9))
    narrow = PhaseLock(range_hz=(119.0, 120.3), longest_s=2.0)
    with pytest.raises(NotDeterminedError, match="mode 1 came to"):
        levels_for(rig, modes, 1, top_m_per_s2=4000.0, rng=np.random.default_rng(1), settings=narrow)


def test_bad_input_is_refused():
    rig, modes = one_mode()
    with pytest.raises(InputError, match="no mode 2"):
        run(rig, modes, [1.0], mode=2)
    for voltages in ([], [0.0], [-1.0], [np.nan], [[1.0]]):
        with pytest.raises(InputError, match="positive voltages"):
            run(rig, modes, voltages)
    with pytest.raises(InputError, match="damped elastic mode"):
        run(rig, LinearModes([0.0], [0.0], [[0.7]], ("mass",)), [1.0])
    with pytest.raises(InputError, match="the rig has no sensor 'mas'"):
        run(rig, LinearModes([HZ], [ZETA], [[0.7]], ("mas",)), [1.0], drive_point="mas")
    with pytest.raises(InputError, match="no sensor of the rig reads"):
        run(replace(rig, sensors=[[0.5]]), modes, [1.0])
    with pytest.raises(InputError, match="noise_fraction is -1"):
        run(rig, modes, [1.0], noise_fraction=-1.0)
    with pytest.raises(InputError, match="120 Hz in it"):
        run(rig, modes, [1.0], settings=PhaseLock(range_hz=(130.0, 140.0)))
    with pytest.raises(InputError, match="two or more levels"):
        levels_for(rig, modes, 1, top_m_per_s2=1.0, rng=np.random.default_rng(1), n_levels=1)


@pytest.mark.parametrize(
    "setting", ["hold_periods", "record_periods", "samples_per_period", "steady_fraction", "integral"]
)
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(InputError, match=f"{setting} of the phase lock is 0"):
        PhaseLock(**{setting: 0})
