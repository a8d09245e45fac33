"""Modes that drive each other: the products of their coordinates, their simulation, and their fit to sine beats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.structure import force_of
from opid.modal.couplings import Product, expand_joint, list_products, make_joints
from opid.modal.forced.excitation import SineBeat, quiet_s, sine_beat_voltage
from opid.modal.forced.mode_fit import fit_mode
from opid.modal.forced.system_fit import fit_system
from opid.modal.identification import identify_modes
from opid.modal.joint_terms import JointTerms, ModalJoint, slip_damping, slip_softening
from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.model import NonlinearModalModel, modal_response, simulate
from opid.modal.power_laws import power_law
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.recording import recording_from_arrays
from opid.studies.study_file import read_study, write_study

FS = 1024.0
MODES = LinearModes([60.0, 121.0], [0.004, 0.006], [[0.5, 0.1], [0.3, -0.4], [-0.2, 0.5]], ("a", "b", "c"))
JOINT = expand_joint({1: 1.0, 2: 1.6}, 2.5e6, 3)
"""The products of a joint that is 2.5e6 z^3, z = q1 + 1.6 q2."""


def potential(couplings, q):
    return sum(value * np.prod([q[mode - 1] for mode in product.modes]) for product, value in couplings.items())


@pytest.mark.parametrize(
    ("n_modes", "degree", "of_velocity"), [(2, 3, False), (2, 4, False), (3, 3, False), (2, 4, True)]
)
def test_the_force_of_joints_is_the_derivative_of_the_products(n_modes, degree, of_velocity):
    rng = np.random.default_rng(degree + n_modes)
    products = list_products(range(1, n_modes + 1), degree, of_velocity=of_velocity)
    couplings = dict(zip(products, rng.normal(size=len(products)), strict=True))
    at, zero = rng.normal(size=n_modes), np.zeros(1)
    force = np.zeros(n_modes)
    for joint in make_joints(couplings, n_modes):
        z = np.array([joint.direction @ at])
        force += joint.direction * joint.law.force(*((zero, z) if of_velocity else (z, zero)))
    steps = 1e-6 * np.eye(n_modes)
    slope = [(potential(couplings, at + h) - potential(couplings, at - h)) / 2e-6 for h in steps]
    np.testing.assert_allclose(force, slope, rtol=1e-6)


def test_a_joint_expands_by_the_binomial_theorem():
    found = expand_joint({4: 1.0, 9: 2.0}, 5.0, 3)
    assert found == {
        Product((4, 4, 4)): 5.0, Product((4, 4, 9)): 30.0, Product((4, 9, 9)): 60.0, Product((9, 9, 9)): 40.0
    }  # fmt: skip


@pytest.mark.parametrize(("modes", "of_velocity"), [((1, 2), False), ((1, 1, 1, 1, 2), False), ((1, 1, 2), True)])
def test_products_that_are_no_potential_are_refused(modes, of_velocity):
    with pytest.raises(InputError, match="three or four modes"):
        Product(modes, of_velocity)


def test_coupled_modes_move_as_an_independent_integration_says():
    model = NonlinearModalModel(MODES, {1: power_law({3: -4e9}, {})}, {}, JOINT)
    time = np.arange(1024) / FS
    force = 4 * np.sin(2 * np.pi * 60 * time) * np.hanning(1024)
    push = MODES.row("a")
    k0, c0 = MODES.stiffness(), MODES.damping()

    def slope(t, y):
        q, v = y[:2], y[2:]
        z = q[0] + 1.6 * q[1]
        pull = 3 * 2.5e6 * z**2 * np.array([1.0, 1.6]) + np.array([-4e9 * q[0] ** 3, 0.0])
        f = 4 * np.sin(2 * np.pi * 60 * t) * np.interp(t, time, np.hanning(1024)) * push
        return np.concatenate([v, f - c0 * v - k0 * q - pull])

    found = modal_response(model, force, fs=FS, drive_point="a")
    known = solve_ivp(slope, (0, time[-1]), np.zeros(4), t_eval=time, rtol=1e-9, atol=1e-12)
    assert np.abs(found.displacement - known.y[:2].T).max() < 2e-3 * np.abs(known.y[:2]).max()
    # The coupling matters here, more than the tolerance.
    alone = modal_response(NonlinearModalModel(MODES, model.laws), force, fs=FS, drive_point="a")
    assert (
        np.abs(found.displacement[:, 1] - alone.displacement[:, 1]).max() > 0.2 * np.abs(found.displacement[:, 1]).max()
    )


@pytest.mark.parametrize("exponent", [-0.5, 0.0])
def test_sliders_have_the_stiffness_and_the_loss_of_the_joint(exponent):
    """One cycle at a displacement has the first harmonic that the closed forms of slip give."""
    joint = ModalJoint(JointTerms(slip=3.0, exponent=exponent), 1.0)
    model = NonlinearModalModel(MODES, {}, {1: joint})
    assert model.structure().stiffness[0, 0] == pytest.approx(MODES.stiffness()[0] - joint.stuck_stiffness)
    phase = 2 * np.pi * np.arange(2000) / 2000
    q = 0.8 * np.cos(phase)
    _, start = force_of(joint.sliders, np.concatenate([q, q]))
    force = force_of(joint.sliders, q, start)[0] - joint.stuck_stiffness * q
    first = 2 * np.mean(force * np.exp(-1j * phase)) / 0.8
    assert first.real == pytest.approx(-3.0 * slip_softening(exponent) * 0.8 ** (1 + exponent), rel=0.02)
    assert abs(first.imag) == pytest.approx(3.0 * slip_damping(exponent) * 0.8 ** (1 + exponent), rel=0.03)


@pytest.mark.parametrize("exponent", [-0.5, 0.0, 0.7])
def test_the_force_of_the_velocity_loses_what_the_joint_loses(exponent):
    joint = JointTerms(friction=0.3, slip=3.0, exponent=exponent)
    sine = np.abs(np.sin(2 * np.pi * (np.arange(20000) + 0.5) / 20000))
    for amplitude in (0.1, 0.8):
        first = 2 * np.mean(joint.find_loss_force(amplitude * sine) * sine)
        assert first == pytest.approx(joint.find_damping(np.array(amplitude)) * amplitude, rel=1e-6)


def test_slip_takes_its_force_from_the_first_loading():
    joint = ModalJoint(JointTerms(slip=3.0, exponent=-0.5), 1.0)
    q = np.linspace(0.0, 1.0, 101)
    taken = joint.stuck_stiffness * q - force_of(joint.sliders, q)[0]
    np.testing.assert_allclose(taken, joint.terms.find_slip_force(q), atol=0.002 * taken[-1])


def make_beats(model, levels, *, noise=0.01, seed=0):
    """Sine beats of mode 1 at some peak forces, with noise of a fraction of the rms of each channel."""
    rng = np.random.default_rng(seed)
    beat = SineBeat(60.0, 0.9, lead_s=0.05, tail_s=quiet_s(model.modes, 1))
    tests = []
    for level in levels:
        force = sine_beat_voltage(replace(beat, amplitude=level), FS)
        response = simulate(model, force, fs=FS, drive_point="a").samples
        channels = np.column_stack([response, force])
        channels = channels + noise * channels.std(axis=0) * rng.standard_normal(channels.shape)
        units = ["m/s^2"] * 3 + ["N"]
        recording = recording_from_arrays(list(channels.T), [*MODES.sensors, "force"], fs=FS, unit=units)
        tests.append(modal_test(recording, MODES, name=f"beat {level:g}", force="force", drive_point="a"))
    return tests


def make_study(fits, truths=(), **settings):
    tests = [StudyTest(each, "fit", 1) for each in fits]
    tests += [StudyTest(replace(each, name=f"truth {each.name}"), "truth") for each in truths]
    return ModalStudy("two modes", MODES, (1,), tuple(tests), "a", **settings)


SLIPPING = ModalJoint(JointTerms(slip=8e4, exponent=-0.5), 1e-3)
LEVELS = (1.0, 2.5, 5.0, 7.5, 10.0)


@pytest.fixture(scope="module")
def beats():
    return make_beats(NonlinearModalModel(MODES, {}, {1: SLIPPING}, JOINT), (*LEVELS, 12.0))


@pytest.fixture(scope="module")
def identified(beats):
    return identify_modes(make_study(beats[:-1], beats[-1:]))


@pytest.mark.slow
def test_the_joint_between_modes_is_found(identified):
    (system,) = identified.systems
    assert system.modes == (1, 2)
    assert not system.warnings
    found = {each.product: each.coefficient for each in system.couplings}
    assert set(found) == set(JOINT)
    for product, truth in JOINT.items():
        assert abs(found[product].value - truth) < 3 * found[product].std, product.name
    assert found[Product((1, 1, 2))].value == pytest.approx(JOINT[Product((1, 1, 2))], rel=0.02)
    assert abs(system.ratios[2].value - 1.6) < 3 * system.ratios[2].std
    fit = identified.fits[0]
    assert abs(fit.joint_estimates.slip_exponent.value + 0.5) < 3 * fit.joint_estimates.slip_exponent.std
    assert not any("interact" in text for text in identified.all_warnings)


def test_slip_is_in_the_damping_over_amplitude_and_over_velocity(identified):
    fit = identified.fits[0]
    amplitude, omega = fit.stiffness_curve.position[1:], 2 * np.pi * fit.frequency_at_hz[1:]
    of_slip = fit.joint.terms.find_damping(amplitude) / omega
    viscous = MODES.damping()[0] + fit.damping[1].value
    np.testing.assert_allclose(2 * omega * fit.damping_at[1:], viscous + of_slip, rtol=1e-9)
    # A cycle of the force over velocity has the same damping, but for the shift of the frequency on the way.
    curve, largest = fit.damping_curve, omega[-1] * amplitude[-1]
    sine = np.abs(np.sin(2 * np.pi * (np.arange(2000) + 0.5) / 2000))
    first = 2 * np.mean(np.interp(largest * sine, curve.position, curve.force) * sine) / largest
    assert first == pytest.approx(of_slip[-1], rel=0.03)
    assert of_slip[-1] > 0.3 * viscous
    assert (curve.low < curve.force)[1:].all()


def test_the_model_with_the_joint_predicts_a_higher_level(identified):
    (truth,) = identified.truth_tests
    assert max(each.nrmse_nonlinear for each in truth.sensors.values()) < 0.05
    assert min(each.nrmse_linear for each in truth.sensors.values()) > 0.5


def test_the_simplest_form_that_explains_the_tests_is_chosen(identified):
    chosen = [each for each in identified.systems[0].trials if each.chosen]
    assert len(chosen) == 1
    assert chosen[0].error == min(
        each.error for each in identified.systems[0].trials if each.coefficients <= chosen[0].coefficients
    )
    assert "joint k z^3" in chosen[0].terms


@pytest.mark.slow
def test_named_products_are_fitted_as_they_are(beats):
    found = identify_modes(make_study(beats[:2], couplings=((1, 1, 2),)))
    (system,) = found.systems
    assert [each.product for each in system.couplings] == [Product((1, 1, 2))]
    # At these levels it is the product that counts.
    assert system.couplings[0].coefficient.value == pytest.approx(JOINT[Product((1, 1, 2))], rel=0.05)


def test_no_coupling_is_asked_for(beats):
    found = identify_modes(make_study(beats[:3], couplings=(), stiffness_order=3, damping_order=3))
    assert found.systems == ()
    assert any("the modes interact" in text for text in found.all_warnings)


@pytest.mark.slow
def test_an_interaction_that_no_coupling_explains_stays_a_warning(beats):
    """A law of mode 1 alone does not explain mode 2, and that is still told."""
    alone = fit_mode(beats[:3], 1)
    found = fit_system(beats[:3], alone)
    assert found.modes == (1,)
    assert found.fit.interactions == alone.interactions != ()
    assert alone.interactions[0].sentence in found.fit.warnings


@pytest.mark.slow
def test_modes_that_do_not_interact_have_no_coupling():
    beats = make_beats(NonlinearModalModel(MODES, {}, {1: SLIPPING}), LEVELS)
    found = identify_modes(make_study(beats))
    assert len(found.systems) == 1
    assert not found.systems[0].couplings
    assert found.fits[0].joint_estimates.slip.value is not None


@pytest.mark.slow
def test_a_shape_that_is_too_large_is_told(beats):
    """No potential explains both modes when the shape of the driven one is 20 % too large: its mass is then not 1."""
    modes = replace(MODES, shapes=MODES.shapes * np.array([1.0, 1.2]))
    wrong = [modal_test(each.recording, modes, name=each.name, force="force", drive_point="a") for each in beats[2:-1]]
    # Each product as large as the quietest test asks for makes the model grow without bound: the search begins without.
    named = {"couplings": ((1, 1, 1), (1, 1, 2), (1, 2, 2))}
    found = identify_modes(replace(make_study(beats[2:-1], **named), modes=modes, tests=make_study(wrong).tests))
    (told,) = (text for text in found.all_warnings if "times what its pull on the other mode asks for" in text)
    assert float(told.split("may be ")[1].split(" times the true one")[0]) == pytest.approx(1.2, rel=0.05)
    assert set(found.systems[0].ratios) == set()


@pytest.mark.parametrize(
    ("couplings", "message"),
    [
        (((1, 7),), "7 is no elastic mode"),
        (((1, 2),), "three or four modes"),
        (((2, 2, 2),), "none of which is among nonlinear"),
    ],
)
def test_couplings_that_cannot_be_are_refused(beats, couplings, message):
    with pytest.raises(InputError, match=message):
        make_study(beats[:1], couplings=couplings)


def test_friction_beside_powers_is_found():
    slides = ModalJoint(JointTerms(friction=0.5), 1e-3)
    beats = make_beats(NonlinearModalModel(MODES, {}, {1: slides}), LEVELS)
    found = identify_modes(make_study(beats))
    friction = found.fits[0].joint_estimates.friction
    assert friction.value == pytest.approx(0.5, rel=0.05)
    assert abs(friction.value - 0.5) < 3 * friction.std


@pytest.mark.slow
def test_friction_beside_a_spring_that_softens_much_is_found():
    slides = ModalJoint(JointTerms(friction=0.13), 1e-3)
    model = NonlinearModalModel(MODES, {1: power_law({3: -2e10}, {})}, {1: slides})
    fit = identify_modes(make_study(make_beats(model, (0.8, 2.0, 4.0, 7.0, 10.0)))).fits[0]
    assert fit.joint_estimates.friction.value == pytest.approx(0.13, rel=0.02)
    assert fit.stiffness[3].holds(-2e10)


def test_the_powers_stay_where_they_are_the_law():
    """No simulation is made where the equation leaves no more than noise."""
    beats = make_beats(NonlinearModalModel(MODES, {1: power_law({3: -2e9}, {2: 3.0})}), LEVELS)
    found = identify_modes(make_study(beats))
    assert found.systems == ()
    fit = fit_mode(beats, 1)
    assert 0.7 < fit.misfit < 1.5
    assert found.fits[0].stiffness[3] == fit.stiffness[3]


def test_a_study_file_names_products(beats, tmp_path):
    given = make_study(beats[:2], couplings=((1, 1, 2), (1, 1, 1)))
    path = tmp_path / "study.toml"
    write_study(given, path)
    assert read_study(path).couplings == ((1, 1, 2), (1, 1, 1))
    text = path.read_text()
    path.write_text(text.replace("[1, 1, 2]", "[1, 1, 9]"))
    with pytest.raises(InputError, match="9 is no elastic mode"):
        read_study(path)


@pytest.mark.slow
def test_the_model_has_the_friction_of_free_decays():
    """Decays of a mode give friction beside powers, and the model decays as the measured mode does."""
    slides = ModalJoint(JointTerms(friction=0.4), 1e-3)
    (beat,) = make_beats(NonlinearModalModel(MODES, {}, {1: slides}), (12.0,), noise=0.001)
    after = beat.recording.samples[round(1.0 * FS) :, :3]
    recording = recording_from_arrays(list(after.T), MODES.sensors, fs=FS)
    decay = modal_test(recording, MODES, name="decay")
    found = identify_modes(ModalStudy("decay", MODES, (1,), (StudyTest(decay, "decay", 1),)))
    law = found.decay_laws[1]
    assert abs(law.joint_estimates.friction.value - 0.4) < 3 * law.joint_estimates.friction.std
    assert found.model.joints[1].terms.friction == law.joint_estimates.friction.value
    assert any(row.name == "mode_1.decays.friction" for row in found.summary())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_a_named_coupling_that_the_tests_do_not_show_is_told_when_it_is_dropped(seed):
    alone = NonlinearModalModel(MODES, {1: power_law({3: -4e9}, {})})
    tests = make_beats(alone, (2.0, 4.0, 6.0, 8.0), seed=seed)
    found = identify_modes(make_study(tests, couplings=((1, 1, 2),), stiffness_order=3, damping_order=1))
    fitted = [each.product for system in found.systems for each in system.couplings]
    if fitted:  # Then its interval holds that there is none.
        assert any("cannot tell the coupling(s) k q1^2 q2 from zero" in text for text in found.warnings)
    else:
        (told,) = (text for text in found.warnings if "k q1^2 q2 that the study names are left out" in text)
        # The law of mode 1 explains it; what is left is noise at the frequency of mode 2, which does not move.
        assert "so that these tests do not show them" in told or "of that of mode 2 is left" in told


def test_a_start_that_runs_away_says_what_was_given_and_what_to_do(beats):
    fit = fit_mode(beats[:3], 1, stiffness_order=3, damping_order=1)
    steep = replace(fit, stiffness={**fit.stiffness, 3: Estimate.normal(-1e14, 0.0)})
    with pytest.raises(InputError, match="grows without bound") as raised:
        fit_system(beats[:3], steep, products=(Product((1, 1, 2)),), search_own=False)
    for words in (
        "k3, k q1^2 q2, from the equation of motion",
        "'beat ",
        "m kg^1/2",
        "needs a bounded motion",
        "lower",
    ):
        assert words in str(raised.value)


def test_a_coupling_of_a_mode_that_only_decays_show_is_told(beats):
    time = np.arange(4096) / FS
    motion = modal_response(
        NonlinearModalModel(MODES), np.zeros(time.size), fs=FS, drive_point="a", displacement=[0.0, 2e-4]
    )
    noisy = motion.acceleration @ MODES.shapes.T
    noisy = noisy + 1e-3 * noisy.std() * np.random.default_rng(0).standard_normal(noisy.shape)
    record = recording_from_arrays(list(noisy.T), list(MODES.sensors), fs=FS, unit="m/s^2")
    decay = StudyTest(modal_test(record, MODES, name="decay"), "decay", 2)
    study = make_study(beats[:3], stiffness_order=3, damping_order=1)
    both = replace(study, nonlinear=(1, 2), couplings=((2, 2, 2),), tests=(*study.tests, decay))
    found = identify_modes(both)
    assert any("k q2^3 that the study names are left out: no forced test" in text for text in found.warnings)
