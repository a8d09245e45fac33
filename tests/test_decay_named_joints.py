"""Joints of named kinds in the law of free decays, against closed forms, simulated decays and worlds without them."""

from functools import cache

import numpy as np
import pytest
from made_decays import (
    RUNG_FS,
    RUNG_LEVEL,
    RUNG_OMEGA,
    bolt,
    bolt_values,
    decay_with_friction,
    noisy_after_rest,
    ring_with_sliders,
    ring_with_state,
)
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.memory import find_steady_loop, force_along, sine_like
from opid.mechanics.structure import Sliders, force_of
from opid.modal.decay.free_decay import free_decay, law_of_decays
from opid.modal.decay.slow_flow import solve_slow_flow
from opid.modal.joint_terms import JointTerms, find_joint_curves, find_rest_stiffness
from opid.modal.linear.modes import LinearModes
from opid.modal.model import NonlinearModalModel, modal_response
from opid.report import writing

FS, OMEGA, LEVEL = RUNG_FS, RUNG_OMEGA, RUNG_LEVEL
K0, C0 = OMEGA**2, 0.006 * OMEGA
FORCE, TRAVEL = 0.02 * K0 * LEVEL, 0.2 * LEVEL
DURATION_S = 3.0
BOLT = bolt(FORCE, 0.1 * K0, -0.3, 0.5)
# Values of the joint in each world, and those that its kind holds.
WORLDS = {
    "jenkins": ("iwan_friction", {"amplitude": FORCE, "scale": TRAVEL}),
    "iwan": ("iwan_friction", bolt_values(FORCE, 0.1 * K0, -0.3, 0.5)),
    "dahl": ("dahl_friction", {"amplitude": FORCE, "scale": TRAVEL}),
    "bouc_wen": ("bouc_wen", {"amplitude": FORCE, "scale": TRAVEL, "exponent": 2.0}),
}
HELD = {"jenkins": (0.5, np.inf), "bouc_wen": (0.5,)}


@cache
def ring(world):
    if world == "jenkins":
        return ring_with_sliders(Sliders([FORCE / TRAVEL], [FORCE]), c0=C0)
    if world == "iwan":
        return ring_with_sliders(BOLT, c0=C0)
    return ring_with_state(world, FORCE, TRAVEL, c0=C0)


def follow(signal, memory, seed=0, noise=0.01, **choices):
    samples = noisy_after_rest(signal, np.random.default_rng(seed), noise)
    return free_decay(samples, fs=FS, memory=memory, **choices)


# ---- one cycle -------------------------------------------------------------------------------------


def test_the_loop_of_dahl_has_its_closed_area():
    amplitude = np.geomspace(0.03, 300.0, 40)
    area = find_steady_loop("dahl_friction").find_area(amplitude)
    np.testing.assert_allclose(area, 4.0 * (amplitude - np.tanh(amplitude)), rtol=2e-5)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 6.0])
@pytest.mark.parametrize("amplitude", [1.0, 3.0, 20.0])
def test_the_loop_of_bouc_wen_is_that_of_its_state_equation(exponent, amplitude):
    z, v, fs = sine_like(amplitude / np.sqrt(2), 2.0 * np.pi * amplitude / np.sqrt(2))
    force = force_along(Law((Term("bouc_wen", (1.0, 1.0, exponent, 0.5)),)), z, v, fs)
    n = z.size // 4
    loop, at = find_steady_loop("bouc_wen", exponent, 0.5), np.array([amplitude])
    assert loop.find_area(at)[0] == pytest.approx(force[-n:] @ v[-n:] / fs, rel=5e-4)
    assert loop.find_stiffness(at)[0] == pytest.approx(2.0 * np.mean(force[-n:] * z[-n:]) / amplitude**2, rel=5e-4)


@pytest.mark.parametrize("over", [0.5, 1.0, 1.5, 5.0])
def test_an_iwan_joint_is_that_of_its_sliders(over):
    values = tuple(WORLDS["iwan"][1].values())
    angle = 2.0 * np.pi * np.arange(4001) / 2000
    amplitude = over * WORLDS["iwan"][1]["scale"]
    force = force_of(BOLT, amplitude * np.sin(angle))[0][-2000:]
    softening, damping = find_joint_curves("iwan_friction", values, np.array([amplitude]))
    in_phase, quadrature = (2.0 * np.mean(force * shape(angle[-2000:])) / amplitude for shape in (np.sin, np.cos))
    rest = find_rest_stiffness("iwan_friction", values)
    assert rest == pytest.approx(0.1 * K0, rel=1e-3)
    assert rest - softening[0] == pytest.approx(in_phase, rel=2e-3)
    assert damping[0] == pytest.approx(quadrature, rel=0.02)


# ---- decays ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("world", WORLDS)
def test_a_named_joint_is_found_with_intervals_that_hold(world, seed):
    kind, truth = WORLDS[world]
    decay = follow(ring(world), kind, seed)
    law = decay.fitted
    found = {name.split(".")[1]: estimate for name, estimate, _ in law.joint_estimates.list_values("m/s^2", "m")}
    assert found.keys() == truth.keys()
    for name, value in truth.items():
        assert found[name].holds(value)
        assert found[name].std < (0.2 if name == "jump" else 0.1) * value
    assert law.damping[1].holds(C0)
    assert decay.law_misfit < 1.5
    values = (*truth.values(), *HELD.get(world, ()))
    # In units of LEVEL and OMEGA
    true = JointTerms(kind=kind, values=(values[0] / K0 / LEVEL, values[1] / LEVEL, *values[2:]))
    flow = solve_slow_flow(np.array([1.0]), np.array([C0 / OMEGA]), np.log(1e-3), 0.3, true)
    frequency, damping = law.curves_at(LEVEL * np.exp(flow.log_amplitude))
    inside = (flow.log_amplitude > np.log(0.02)) & (flow.log_amplitude < np.log(0.8))
    np.testing.assert_allclose(frequency[inside], 60.0 * flow.natural[inside], rtol=2e-3)
    # Where a single slider begins to slide the damping is a step.
    ratio = (damping / (0.5 * flow.damping / flow.natural) - 1.0)[inside]
    assert np.median(np.abs(ratio)) < 0.03
    assert np.abs(ratio).max() < (0.2 if world == "jenkins" else 0.04)


@pytest.mark.parametrize("world", ["jenkins", "dahl"])
def test_the_model_of_the_law_predicts_the_decay(world):
    kind = WORLDS[world][0]
    law = follow(ring(world), kind).fitted
    omega = np.sqrt(law.stiffness[1].value)
    modes = LinearModes([omega / (2.0 * np.pi)], [0.5 * law.damping[1].value / omega], [[1.0]], ("a",))
    model = NonlinearModalModel(modes, {}, {1: law.joint})
    still = np.zeros(round(0.5 * FS))
    motion = modal_response(model, still, fs=FS, drive_point="a", velocity=[OMEGA * LEVEL]).acceleration[:, 0]
    measured = ring(world)[: motion.size]
    assert np.sqrt(np.mean((motion - measured) ** 2)) < 0.05 * np.sqrt(np.mean(measured**2))


@pytest.mark.slow
def test_repeats_have_one_joint():
    decays = [follow(ring("dahl"), "dahl_friction", seed) for seed in range(2)]
    both = law_of_decays(decays, memory="dahl_friction")
    assert both.joint_estimates.values[0].holds(FORCE)
    assert both.joint_estimates.values[1].holds(TRAVEL)


def test_a_result_tells_the_joint():
    decay = follow(ring("jenkins"), "iwan_friction")
    rows = {row.name: row for row in decay.summary()}
    assert rows["iwan_friction.amplitude"].unit == "m/s^2"
    assert rows["iwan_friction.scale"].unit == "m"
    joint = decay.to_dict()["joint"]
    assert joint["kind"] == "iwan_friction"
    assert joint["values"]["scale"]["value"] == rows["iwan_friction.scale"].estimate.value
    assert "(Jenkins)" in writing.text(decay)


@pytest.mark.slow
@pytest.mark.parametrize("world", WORLDS)
def test_a_joint_is_found_where_powers_friction_and_slip_miss_the_decay(world):
    law = follow(ring(world), None, 2).fitted
    kind, truth = WORLDS[world]
    assert law.joint_estimates.named.name == kind
    assert law.joint_estimates.kind.n_fitted == len(truth)
    assert all(each.holds(value) for each, value in zip(law.joint_estimates.values, truth.values(), strict=True))
    assert any("do not explain the decay, but" in each for each in law.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_a_slider_is_found_by_its_name_and_never_told_by_an_exponent(seed):
    # Beside a damping ratio of 1 % the windows round its corner off.
    signal = ring_with_sliders(Sliders([FORCE / TRAVEL], [FORCE]), c0=0.02 * OMEGA)
    named = follow(signal, "iwan_friction", seed).fitted
    assert named.joint_estimates.values[0].holds(FORCE)
    assert named.joint_estimates.values[1].holds(TRAVEL)
    free = follow(signal, None, seed).fitted
    if free.joint_estimates.named is not None and free.joint_estimates.named.name == "bouc_wen":
        assert free.joint_estimates.values[2].interval95 is None
        assert any("hardly told from one slider" in each for each in free.warnings)


@pytest.mark.parametrize("seed", range(3))
def test_bands_of_a_named_joint_hold_the_damping_of_steady_cycles(seed):
    law = follow(ring("dahl"), "dahl_friction", seed).fitted
    joint = JointTerms(kind="dahl_friction", values=(FORCE, TRAVEL))
    natural = np.sqrt(K0 - joint.find_softening(law.amplitude))
    ratio = (C0 + joint.find_damping(law.amplitude) / natural) / (2.0 * natural)
    assert np.mean(np.abs(law.damping_ratio - ratio) < 2.0 * law.damping_std) > 0.9
    assert law.stiffness[1].holds(K0)


def test_a_motion_that_no_structure_has_is_told():
    for unit, is_told in ((1.0, False), (1e5, True)):
        decay = follow(ring("dahl") * unit, False, quantity="acceleration")
        assert any("check the unit of the channel" in each for each in decay.warnings) == is_told


# ---- worlds without the joint ----------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(2))
def test_a_joint_that_never_slides_as_a_whole_tells_no_largest_force(seed):
    signal = ring_with_sliders(bolt(7.5 * FORCE, 0.1 * K0, -0.3, 0.5), c0=C0)
    decay = follow(signal, "iwan_friction", seed)
    assert decay.fitted is None
    assert any("does not determine iwan_friction" in each for each in decay.warnings)
    # Without the name it is the slip of the micro-slip.
    law = follow(signal, None, seed).fitted
    assert law.joint_estimates.named is None
    assert law.joint_estimates.slip_exponent.value is None or law.joint_estimates.slip_exponent.value == pytest.approx(
        -0.3, abs=0.05
    )


def test_dry_friction_tells_no_travel():
    signal = decay_with_friction(
        fs=FS, duration_s=DURATION_S, k0=K0, c0=C0, friction=0.002 * K0 * LEVEL, amplitude=LEVEL
    )
    for kind in ("dahl_friction", "bouc_wen"):
        assert follow(signal, kind).fitted is None
    assert follow(signal, None).fitted.joint_estimates.friction.holds(0.002 * K0 * LEVEL)


def test_powers_are_not_told_as_a_joint():
    time = np.arange(round(DURATION_S * FS)) / FS

    def force(q, v):
        return C0 * v * (1.0 + 0.3 * np.abs(v) / (OMEGA * LEVEL)) + K0 * q * (1.0 - 0.04 * (q / LEVEL) ** 2)

    found = solve_ivp(lambda _, y: [y[1], -force(*y)], (0.0, time[-1]), [LEVEL, 0.0], "DOP853", time, rtol=1e-9)
    for kind in ("iwan_friction", "dahl_friction", "bouc_wen"):
        decay = follow(-force(*found.y), kind)
        if decay.fitted is not None:
            assert any(f"laws without {kind} explain the decay better" in each for each in decay.warnings)
            assert all(each.std is None for each in decay.fitted.joint_estimates.values)


def test_another_kind_of_joint_is_refused_or_doubted():
    for world, kind in (("bouc_wen", "iwan_friction"), ("dahl", "bouc_wen"), ("jenkins", "dahl_friction")):
        decay = follow(ring(world), kind)
        assert decay.fitted is None or all(each.std is None for each in decay.fitted.joint_estimates.values)


def test_a_kind_that_is_none_of_a_joint_is_refused():
    with pytest.raises(InputError, match="which is linear"):
        follow(ring("jenkins"), "maxwell_arm")
    with pytest.raises(InputError, match="iwan_friction"):
        follow(ring("jenkins"), "iwan_frction")
