"""Joints of named kinds in the law of sine beats, against independent integrations and worlds without them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Sliders, Structure, force_of, iwan
from opid.modal.forced.excitation import SineBeat, quiet_s, sine_beat_voltage
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.system_fit import fit_system
from opid.modal.identification import identify_modes
from opid.modal.joint_terms import JointTerms, ModalJoint, load_joint
from opid.modal.linear.modes import LinearModes, delay_forces, modal_test
from opid.modal.model import NonlinearModalModel, modal_response
from opid.modal.settings import SIMULATED
from opid.modal.study import ModalStudy, StudyTest
from opid.report import writing
from opid.signals.recording import recording_from_arrays
from opid.signals.resampling import resampled
from opid.studies.study_file import read_study, write_study

FS, STEPS = 1024.0, 24
MODES = LinearModes([60.0], [0.004], [[0.5], [0.3], [-0.2]], ("a", "b", "c"))
K0, C0 = float(MODES.stiffness()[0]), float(MODES.damping()[0])
LARGEST = 6e-4
FORCE, TRAVEL = 0.033 * K0 * LARGEST, 0.33 * LARGEST
LEVELS, FEW = (1.0, 2.5, 5.0, 7.5, 10.0), (2.0, 5.0, 10.0)
BOLT = iwan(stiffness_n_per_m=0.1 * K0, slip_force_n=FORCE, chi=-0.3, beta=0.5, n=80)
# Of iwan(): the force of the sliders that slip one by one is (chi + 1) / (chi + 2) of that of all at the last travel,
# and that of those that slip there at once is beta.
GRADUAL = 0.7 / 1.7
WORLDS = {
    "jenkins": ("iwan_friction", (FORCE, TRAVEL)),
    "iwan": ("iwan_friction", (FORCE, FORCE * 1.5 / (0.1 * K0 * (0.5 + GRADUAL)), 1.0 / 1.7, 0.5 / GRADUAL)),
    "dahl": ("dahl_friction", (FORCE, TRAVEL)),
    "bouc_wen": ("bouc_wen", (FORCE, TRAVEL, 2.0)),
}
POWERS = {"stiffer": 0.4 * K0 / LARGEST**2, "damped": 2.0 * C0 / (LARGEST * K0**0.5)}
"""A cubic spring of 40 % of k0 at LARGEST, and a quadratic damping of twice c0 there, beside one slider and Dahl's."""


def joint_of(world):
    """The joint of a world as a part of a structure, and its stiffness at rest."""
    if world == "stiffer":
        joint, at_rest = joint_of("jenkins")
        cubic = Law((Term("cubic_stiffness", (POWERS[world],)),))
        return replace(joint, law=cubic), at_rest
    if world == "damped":
        joint, at_rest = joint_of("dahl")
        return replace(joint, law=Law((*joint.law.terms, Term("quadratic_damping", (POWERS[world],))))), at_rest
    if world in ("jenkins", "iwan", "stuck"):
        stuck = iwan(stiffness_n_per_m=0.1 * K0, slip_force_n=7.5 * FORCE, chi=-0.3, beta=0.5, n=80)
        sliders = {"jenkins": Sliders([FORCE / TRAVEL], [FORCE]), "iwan": BOLT, "stuck": stuck}[world]
        return Joint("bolt", np.array([1.0]), sliders=sliders), sliders.tangent_n_per_m
    kind, values = WORLDS[world]
    term = Term(kind, (*values, 0.5) if kind == "bouc_wen" else values)
    return Joint("bolt", np.array([1.0]), law=Law((term,))), values[0] / values[1]


def beat_of(level):
    beat = SineBeat(60.0, 0.9, lead_s=0.05, tail_s=quiet_s(MODES, 1))
    return sine_beat_voltage(replace(beat, amplitude=level), FS)


def find_half_steps(force, steps):
    between = resampled(recording_from_arrays([force], ["force"], fs=FS, unit="N"), 2 * steps * FS).samples
    return between[: 2 * (force.size - 1) * steps + 1]


@cache
def move(world, level):
    """The modal acceleration of a beat, with far shorter steps than those of the search."""
    joint, at_rest = joint_of(world)
    structure = Structure([[1.0]], [[C0]], [[K0 - at_rest]], (joint,))
    force = beat_of(level)
    motion = time_response(
        structure,
        0.5 * find_half_steps(force, STEPS),
        fs=FS,
        duration_s=force.size / FS,
        steps_per_sample=STEPS,
    )
    return motion.acceleration[:, 0]


def beats_of(world, seed, levels=LEVELS):
    """Beats with noise of 1 % of the rms of each channel."""
    rng, tests = np.random.default_rng(seed), []
    for level in levels:
        channels = np.column_stack([move(world, level)[:, None] * MODES.shapes[:, 0], beat_of(level)])
        channels = channels + 0.01 * channels.std(axis=0) * rng.standard_normal(channels.shape)
        units = ["m/s^2"] * 3 + ["N"]
        recording = recording_from_arrays(list(channels.T), [*MODES.sensors, "force"], fs=FS, unit=units)
        tests.append(modal_test(recording, MODES, name=f"beat {level:g}", force="force", drive_point="a"))
    return tests


def study_of(tests, **settings):
    return ModalStudy("one mode", MODES, (1,), tuple(StudyTest(each, "fit", 1) for each in tests), "a", **settings)


def fit_law(world, memory, seed=0, levels=LEVELS):
    tests = beats_of(world, seed, levels)
    return fit_system(tests, fit_mode(tests, 1), memory=memory)


def fit_joint_alone(world, memory, seed):
    """The law without powers above 1, so that nothing but the joint is searched."""
    tests = beats_of(world, seed)
    fit = fit_mode(tests, 1, stiffness_order=1, damping_order=1, free_linear=True)
    return fit_system(tests, fit, memory=memory, search_own=False)


# ---- the force -------------------------------------------------------------------------------------


@pytest.mark.parametrize("world", ["dahl", "bouc_wen"])
def test_a_mode_with_a_joint_moves_as_an_independent_integration_says(world):
    kind, values = WORLDS[world]
    joint = ModalJoint(JointTerms(kind=kind, values=(*values, 0.5) if kind == "bouc_wen" else values), LARGEST)
    force = beat_of(10.0)
    found = modal_response(NonlinearModalModel(MODES, {}, {1: joint}), force, fs=FS, drive_point="a")
    fine, at = find_half_steps(force, 8)[:, 0], np.arange(2 * 8 * (force.size - 1) + 1) / (2 * 8 * FS)

    def slope(t, y):
        q, v, h = y
        rate = v - abs(v) * h if world == "dahl" else v * (1.0 - h * h * (0.5 + 0.5 * np.sign(v * h)))
        pull = (K0 - FORCE / TRAVEL) * q + C0 * v + FORCE * h
        return [v, 0.5 * np.interp(t, at, fine) - pull, rate / TRAVEL]

    n = 700
    time, small = np.arange(n) / FS, np.array([1e-12, 1e-10, 1e-9])
    known = solve_ivp(slope, (0.0, time[-1]), np.zeros(3), "LSODA", time, rtol=1e-8, atol=small, max_step=1.0 / FS)
    assert np.abs(found.displacement[:n, 0] - known.y[0]).max() < 1e-3 * np.abs(known.y[0]).max()
    # The joint slides here, so that it matters.
    assert np.abs(known.y[0]).max() > 1.5 * TRAVEL


def test_the_first_loading_of_a_joint_is_that_of_its_sliders():
    at = np.linspace(0.0, 2.0 * LARGEST, 50)
    force = load_joint("iwan_friction", WORLDS["iwan"][1], at)
    np.testing.assert_allclose(force, force_of(BOLT, at)[0], atol=2e-3 * FORCE)
    dahl = load_joint("dahl_friction", (FORCE, TRAVEL), at)
    np.testing.assert_allclose(dahl, FORCE * (1.0 - np.exp(-at / TRAVEL)), atol=1e-4 * FORCE)


@pytest.mark.parametrize("world", WORLDS)
def test_the_force_of_the_velocity_loses_what_a_named_joint_loses(world):
    kind, values = WORLDS[world]
    more = {"jenkins": (0.5, np.inf), "bouc_wen": (0.5,)}.get(world, ())
    joint = JointTerms(friction=0.1, kind=kind, values=(*values, *more))
    sine = np.abs(np.sin(2.0 * np.pi * (np.arange(4000) + 0.5) / 4000))
    for amplitude in (0.5 * TRAVEL, 2.0 * TRAVEL, 5.0 * TRAVEL):
        first = 2.0 * np.mean(joint.find_loss_force(amplitude * sine) * sine)
        assert first == pytest.approx(joint.find_damping(np.array(amplitude)) * amplitude, rel=0.01)


# ---- the fit ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("world", WORLDS)
def test_a_named_joint_is_found_with_intervals_that_hold(world, seed):
    kind, truth = WORLDS[world]
    found = fit_joint_alone(world, kind, seed)
    joint = found.fit.joint_estimates
    assert found.dropped == ""
    assert joint.kind.name == kind
    assert len(joint.values) == len(truth)
    for estimate, value in zip(joint.values, truth, strict=True):
        assert abs(estimate.value - value) < 3.0 * estimate.std
        assert estimate.std < 0.02 * value
    assert abs(found.fit.stiffness[1].value) < 3.0 * found.fit.stiffness[1].std
    assert abs(found.fit.damping[1].value) < max(3.0 * found.fit.damping[1].std, 0.005 * C0)
    assert found.fit.misfit < 2.5
    assert found.fit.modal_mass.value == pytest.approx(1.0, abs=2e-3)


@pytest.mark.slow
def test_a_joint_is_found_where_powers_friction_and_slip_miss_the_tests():
    found = fit_law("dahl", None, levels=FEW)
    joint = found.fit.joint_estimates
    assert joint.kind.name == "dahl_friction"
    assert joint.values[0].holds(FORCE)
    assert any("do not explain the tests, but friction that bends" in each for each in found.warnings)


@pytest.mark.slow
def test_the_fit_tells_the_joint_and_its_curves():
    found = identify_modes(study_of(beats_of("dahl", 1), memory="dahl_friction"))
    fit = found.fits[0]
    rows = {row.name: row for row in found.summary()}
    assert rows["mode_1.dahl_friction.amplitude"].unit == "N/kg^1/2"
    assert rows["mode_1.dahl_friction.scale"].unit == "m kg^1/2"
    mode = found.to_dict()["modes"][0]
    assert mode["joint_kind"] == "dahl_friction"
    assert mode["joint_values"]["scale"]["value"] == rows["mode_1.dahl_friction.scale"].estimate.value
    assert mode["slip"]["value"] is None
    text = " ".join(writing.text(found).split())
    assert "friction that bends before it slides (Dahl), whose stiffness before it slides is in k0" in text
    assert "1, 1, dahl_friction" in text
    # Frequency, damping and forces are those of the true joint.
    truth, at = JointTerms(kind="dahl_friction", values=(FORCE, TRAVEL)), fit.stiffness_curve.position[1:]
    omega = np.sqrt(K0 - truth.find_softening(at))
    np.testing.assert_allclose(2.0 * np.pi * fit.frequency_at_hz[1:], omega, rtol=1e-4)
    np.testing.assert_allclose(2.0 * omega * fit.damping_at[1:], C0 + truth.find_damping(at) / omega, rtol=0.01)
    lost = FORCE / TRAVEL * at - FORCE * (1.0 - np.exp(-at / TRAVEL))
    np.testing.assert_allclose(fit.stiffness_curve.force[1:], -lost, atol=0.01 * lost[-1])
    assert (fit.damping_curve.low < fit.damping_curve.force)[1:].all()
    assert not any("misses the tests" in each for each in found.all_warnings)


@pytest.mark.slow
def test_a_delay_between_force_and_motion_is_found_beside_a_joint():
    late = [delay_forces(each, 1.0 / FS) for each in beats_of("dahl", 0, FEW)]
    fit = identify_modes(study_of(late, memory="dahl_friction")).fits[0]
    assert fit.delay_s.holds(-1.0 / FS)
    assert fit.delay_s.std < 1e-5
    for estimate, truth in zip(fit.joint_estimates.values, (FORCE, TRAVEL), strict=True):
        assert abs(estimate.value - truth) < 3.0 * estimate.std
        assert estimate.value == pytest.approx(truth, rel=5e-3)
    assert sum("µs before the forces" in each for each in fit.warnings) == 1


# ---- worlds without the joint ----------------------------------------------------------------------


@pytest.mark.slow
def test_a_joint_that_never_slides_as_a_whole_is_withheld():
    found = fit_law("stuck", "iwan_friction")
    assert "do not determine iwan_friction, which the study names" in found.dropped
    joint = found.fit.joint_estimates
    assert joint.named is None
    assert joint.slip_exponent.value == pytest.approx(-0.3, abs=0.02)


@pytest.mark.slow
def test_powers_are_not_told_as_a_joint():
    tests = beats_of("stuck", 0, (0.02, 0.03, 0.05))
    found = identify_modes(study_of(tests, memory="dahl_friction", free_linear=True))
    assert found.fits[0].joint_estimates.named is None
    assert any("dahl_friction" in each for each in found.all_warnings)


@pytest.mark.slow
def test_beats_that_never_reach_the_slip_force_of_a_named_joint_show_a_linear_mode():
    found = identify_modes(study_of(beats_of("jenkins", 0, (0.2, 0.4, 0.6)), memory="iwan_friction"))
    assert found.fits[0].joint_estimates.named is None
    assert found.fits[0].frequency_at_hz[-1] == pytest.approx(60.0, rel=1e-5)
    assert any("do not determine iwan_friction" in each for each in found.all_warnings)


@pytest.mark.slow
@pytest.mark.parametrize(("world", "kind"), [("dahl", "iwan_friction"), ("bouc_wen", "dahl_friction")])
def test_a_joint_of_another_kind_is_told(world, kind):
    found = fit_law(world, kind, levels=FEW)
    true, truth = WORLDS[world]
    joint = found.fit.joint_estimates
    assert f"{kind}, which the study names" in found.dropped
    assert joint.kind.name == true
    assert abs(joint.values[0].value - truth[0]) < 3.0 * joint.values[0].std


@pytest.mark.slow
@pytest.mark.parametrize(("world", "kind", "n"), [("stiffer", "iwan_friction", 3), ("damped", "dahl_friction", 2)])
def test_a_joint_beside_a_power_that_nobody_names_is_found(world, kind, n):
    fit = identify_modes(study_of(beats_of(world, 0, FEW), memory=kind)).fits[0]
    joint, power = fit.joint_estimates, {"stiffer": fit.stiffness, "damped": fit.damping}[world][n]
    assert joint.kind.name == kind
    for estimate, truth in ((joint.values[0], FORCE), (joint.values[1], TRAVEL), (power, POWERS[world])):
        assert abs(estimate.value - truth) < 3.0 * estimate.std
        assert estimate.value == pytest.approx(truth, rel=0.02)


@pytest.mark.slow
def test_a_joint_that_nobody_names_is_taken_where_all_else_leaves_far_more():
    """With a force that is 3 % too large the true joint leaves more than noise, too."""
    tests = beats_of("dahl", 0, FEW)
    louder = [
        replace(each, forces=tuple(replace(force, samples=1.03 * force.samples) for force in each.forces))
        for each in tests
    ]
    found = fit_system(louder, fit_mode(louder, 1))
    assert found.fit.misfit > SIMULATED.unexplained
    assert found.fit.joint_estimates.kind.name == "dahl_friction"
    assert found.fit.joint_estimates.values[0].holds(FORCE)


# ---- the study -------------------------------------------------------------------------------------


def test_the_free_decays_of_a_study_have_the_joint_that_it_names():
    joint, at_rest = joint_of("dahl")
    structure = Structure([[1.0]], [[C0]], [[K0 - at_rest]], (joint,))
    still = np.zeros((2 * 4 * (round(3.0 * FS) - 1) + 1, 1))
    speed = [1.5 * LARGEST * np.sqrt(K0)]
    ring = time_response(structure, still, fs=FS, duration_s=3.0, initial_velocity=speed, steps_per_sample=4)
    channels = ring.acceleration * MODES.shapes[:, 0]
    channels = channels + 0.01 * channels.std(axis=0) * np.random.default_rng(0).standard_normal(channels.shape)
    test = modal_test(recording_from_arrays(list(channels.T), MODES.sensors, fs=FS), MODES, name="ring")
    decays = (StudyTest(test, "decay", 1),)
    law = identify_modes(ModalStudy("ring", MODES, (1,), decays, memory="dahl_friction")).decay_laws[1]
    assert law.joint_estimates.kind.name == "dahl_friction"
    assert law.joint_estimates.values[0].holds(FORCE)
    assert law.joint_estimates.values[1].holds(TRAVEL)


def test_a_study_file_names_a_joint(tmp_path):
    path = tmp_path / "study.toml"
    write_study(study_of(beats_of("dahl", 0, (1.0,)), memory="bouc_wen"), path)
    assert read_study(path).memory == "bouc_wen"
    text = path.read_text()
    path.write_text(text.replace('"bouc_wen"', '"bouc_when"'))
    with pytest.raises(InputError, match=r"no joint of a mode.*bouc_wen"):
        read_study(path)
    path.write_text(text.replace('"bouc_wen"', '"maxwell_arm"'))
    with pytest.raises(InputError, match="which is linear"):
        read_study(path)
