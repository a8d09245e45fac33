import numpy as np
import pytest

from opid.errors import InputError
from opid.mechanics.laws.law import law
from opid.mechanics.response import time_response
from opid.mechanics.rig import Shaker, armature_force, on_shaker
from opid.mechanics.structure import Joint, Structure, frequency_response, iwan, natural_frequencies


def beam():
    """Three modes, the first a rigid-body one, and the direction of the drive point."""
    omega = 2.0 * np.pi * np.array([0.0, 120.0, 310.0])
    return Structure(np.eye(3), np.diag(2 * 0.004 * omega), np.diag(omega**2)), np.array([0.2, 0.3, -0.25])


def test_the_force_on_the_structure_has_its_closed_form():
    # f = Z_s a g V / (a (Z_s + Z_a) + Z_s Z_a) with the dynamic stiffness of stinger and armature, a the accelerance
    structure, point = beam()
    shaker = Shaker()
    driven = on_shaker(structure, shaker, point)
    frequency_hz = np.linspace(5.0, 800.0, 300)
    jw = 2j * np.pi * frequency_hz
    receptance = np.einsum("i,fij,j->f", point, frequency_response(structure, frequency_hz), point)
    stinger = 1.5e7 + 50.0 * jw
    armature = 0.45 * jw**2 + 260.0 * jw + 6e3
    expected = stinger / (stinger + armature * (1.0 + stinger * receptance))
    together = frequency_response(driven, frequency_hz)[:, :, -1]
    along = driven.joints[-1].direction
    np.testing.assert_allclose(stinger * (together @ along), expected, rtol=1e-8)
    # what the force does to the drive point
    np.testing.assert_allclose(together[:, :-1] @ point, expected * receptance, rtol=1e-8)


def test_the_force_drops_at_a_resonance():
    # the armature takes the force where the drive point moves easily: why a shaker's force is measured
    structure, point = beam()
    driven = on_shaker(structure, Shaker(), point)
    frequency_hz = np.linspace(100.0, 140.0, 801)
    stinger = 1.5e7 + 50.0 * 2j * np.pi * frequency_hz
    force = np.abs(stinger * (frequency_response(driven, frequency_hz)[:, :, -1] @ driven.joints[-1].direction))
    assert force[np.argmin(np.abs(frequency_hz - 120.0))] < 0.5 * force[0]


def test_the_energy_of_the_voltage_force_goes_where_it_can():
    structure, point = beam()
    shaker = Shaker()
    driven = on_shaker(structure, shaker, point)

    def force(t):
        return (80.0 * np.sin(2 * np.pi * 118.0 * t) * np.sin(np.pi * np.minimum(t, 0.4) / 0.4) ** 2)[:, None]

    motion = time_response(driven, force, fs=2e4, duration_s=0.5, loads=np.eye(4)[:, 3:])
    x, v = motion.displacement, motion.velocity
    z, w = x @ driven.joints[-1].direction, v @ driven.joints[-1].direction
    stored = 0.5 * np.einsum("ti,ij,tj->t", v, driven.mass, v) + 0.5 * np.einsum("ti,ij,tj->t", x, driven.stiffness, x)
    stored += 0.5 * 1.5e7 * z**2
    lost = np.einsum("ti,ij,tj->t", v, driven.damping, v) + 50.0 * w**2
    power = force(motion.time_s)[:, 0] * v[:, 3] - lost
    received = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) / motion.fs])
    np.testing.assert_allclose(received, stored, atol=2e-3 * stored.max())


def test_the_joints_of_the_structure_stay_as_they_are():
    structure, point = beam()
    joint = Joint("lap", [0.0, 1.0, 1.0], 5e4, 3.0, law("cubic_stiffness", stiffness_n_per_m3=1e9),
                  iwan(stiffness_n_per_m=1e5, slip_force_n=10.0))  # fmt: skip
    with_joint = Structure(structure.mass, structure.damping, structure.stiffness, (joint,), ("a", "b", "c"))
    driven = on_shaker(with_joint, Shaker(), point)
    lap, stinger = driven.joints
    assert driven.names == ("a", "b", "c", "armature")
    assert (lap.name, stinger.name) == ("lap", "stinger")
    assert lap.sliders is joint.sliders
    assert lap.law == joint.law
    np.testing.assert_array_equal(lap.direction, [0.0, 1.0, 1.0, 0.0])
    assert with_joint.joints[0].direction.shape == (3,)


def test_a_rigid_stinger_adds_the_armature_to_the_structure():
    block = Structure([[3.0]], [[0.0]], [[0.0]])
    driven = on_shaker(block, Shaker(stinger_n_per_m=1e12), [1.0])
    frequency_hz = natural_frequencies(driven).frequency_hz[0]
    assert frequency_hz == pytest.approx(np.sqrt(6e3 / 3.45) / (2 * np.pi), rel=1e-6)


@pytest.mark.parametrize(("level", "fraction"), [(28.0, 0.04), (14.0, 0.02), (2.8, 0.004)])
def test_the_second_harmonic_grows_with_the_level(level, fraction):
    n = 64
    voltage = level * np.sin(2 * np.pi * np.arange(n) / n)
    lines = np.abs(np.fft.rfft(armature_force(Shaker(second_harmonic=0.04), voltage))) * 2 / n
    assert lines[1] == pytest.approx(16.0 * level)
    assert lines[2] / lines[1] == pytest.approx(fraction)
    assert np.abs(lines[3:]).max() < 1e-9 * lines[1]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Shaker(armature_kg=0.0), "armature_kg of the shaker is 0.0: give a positive"),
        (lambda: Shaker(back_emf_n_s_per_m=-1.0), "back_emf_n_s_per_m of the shaker is -1.0: give 0 or more"),
        (lambda: Shaker(second_harmonic=np.nan), "second_harmonic of the shaker is nan"),
        (lambda: on_shaker(beam()[0], Shaker(), [1.0]), "give 3 finite"),
        (lambda: on_shaker(beam()[0], Shaker(), np.zeros(3)), "not all zero"),
        (lambda: on_shaker(on_shaker(*beam_on()), Shaker(), np.ones(4)), "already"),
    ],
)
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()


def beam_on():
    structure, point = beam()
    return structure, Shaker(), point
