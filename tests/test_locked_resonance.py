"""Tests at phase resonance whose force follows the motion without an error, in worlds of one mode with a known law."""

from functools import cache

import numpy as np
import pytest

from opid.modal.linear.modes import LinearModes, modal_test
from opid.modal.resonance.identification import identify_resonance
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.recording import recording_from_arrays
from opid.signals.units import STANDARD_GRAVITY

FS, STEPS, HOLD_S = 1024.0, 12, 2.5
MODES = LinearModes([60.0], [0.004], [[0.5], [0.3], [-0.2]], ("a", "b", "c"))
K0, C0 = float(MODES.stiffness()[0]), float(MODES.damping()[0])
LARGEST = 1e-3
K3, C2 = -0.12 * K0 / LARGEST**2, 8.0
SLIP = 0.02 * K0 * LARGEST
TRAVEL = 0.2 * LARGEST


@cache
def record_levels(*, has_joint):
    """Modal acceleration and force of ten levels, without noise: the force has the phase of the velocity.

    The mode has a cubic spring and quadratic damping, or one slider with a spring instead.
    """
    k3, c2 = (0.0, 0.0) if has_joint else (K3, C2)
    k_joint = SLIP / TRAVEL if has_joint else 0.0
    q = v = slid = 0.0
    omega, step, samples = float(np.sqrt(K0)), 1.0 / (FS * STEPS), []

    def accelerate(q, v, slid, newton):
        angle = np.arctan2(omega * q, v)
        force = newton * np.cos(angle)
        joint = min(max(slid, -SLIP), SLIP)
        return 0.5 * force - (K0 - k_joint) * q - k3 * q**3 - C0 * v - c2 * v * abs(v) - joint, force

    for amplitude in np.linspace(0.1, 1.0, 10) * LARGEST:
        # Friction of a slider loses 4 (a - travel) times its force in a cycle.
        lost = 4.0 * SLIP * max(amplitude - TRAVEL, 0.0) / (np.pi * amplitude) if has_joint else 0.0
        newton = (C0 * omega * amplitude + 8.0 / (3.0 * np.pi) * c2 * (omega * amplitude) ** 2 + lost) / 0.5
        for _ in range(round(HOLD_S * FS)):
            samples.append(accelerate(q, v, slid, newton))
            for _ in range(STEPS):
                a1 = accelerate(q, v, slid, newton)[0]
                middle = v + 0.5 * step * a1
                a2 = accelerate(q + 0.5 * step * v, middle, slid + 0.5 * step * k_joint * v, newton)[0]
                moved = step * middle
                slid = min(max(slid + k_joint * moved, -SLIP), SLIP)
                q, v = q + moved, v + step * a2
    return np.array(samples).T


def make_study(*, has_joint=False, force_factor=1.0, first_level=0, **settings):
    first = first_level * round(HOLD_S * FS)
    acceleration, force = record_levels(has_joint=has_joint)[:, first:]
    channels = np.column_stack([acceleration[:, None] * MODES.shapes[:, 0], force_factor * force])
    channels = channels + 0.01 * channels.std(axis=0) * np.random.default_rng(0).standard_normal(channels.shape)
    recording = recording_from_arrays(list(channels.T), [*MODES.sensors, "force"], fs=FS, unit=["m/s^2"] * 3 + ["N"])
    test = modal_test(recording, MODES, name="levels", force="force", drive_point="a")
    return ModalStudy("locked", MODES, (1,), (StudyTest(test, "resonance", 1),), "a", **settings)


def test_levels_at_quadrature_give_the_law_although_they_hardly_show_the_inertia():
    result = identify_resonance(make_study())
    assert result.not_determined == ""
    assert result.records_law.stiffness[3].holds(K3)
    assert result.records_law.damping[1].holds(C0)
    assert result.records_law.stiffness[3].value == pytest.approx(K3, rel=0.01)


@pytest.mark.parametrize(("factor", "unit"), [(0.2248, "lbf"), (STANDARD_GRAVITY, "m/s")])
def test_the_growth_between_such_levels_shows_a_force_in_another_unit(factor, unit):
    result = identify_resonance(make_study(force_factor=factor))
    assert result.law is None
    assert "show a modal mass of" in result.not_determined


def test_a_joint_is_not_mistaken_for_a_phase_of_the_force():
    result = identify_resonance(make_study(has_joint=True))
    zeta = C0 / 2.0 + 2.0 * SLIP * (LARGEST - TRAVEL) / (np.pi * LARGEST**2 * 2.0 * np.pi * result.resonance_hz[-1])
    assert result.damping_ratio[-1] * 2.0 * np.pi * result.resonance_hz[-1] == pytest.approx(zeta, rel=0.02)
    if result.records_law is None:
        assert "the mode has a joint with memory" in result.not_determined
    else:
        assert result.records_law.damping_ratio[-1] == pytest.approx(result.damping_ratio[-1], rel=0.1)
        assert all(each.std is None for each in result.records_law.stiffness.values())


def test_what_a_study_names_beside_powers_is_told_to_be_left_out():
    warnings = identify_resonance(make_study(memory="dahl_friction", couplings=((1, 1, 1),))).warnings
    assert any("dahl_friction and the coupling(s)" in each and "are left out" in each for each in warnings)
    assert not any("left out" in each for each in identify_resonance(make_study()).warnings)


def test_levels_that_slide_throughout_do_not_tell_the_mode_at_rest():
    result = identify_resonance(make_study(has_joint=True, first_level=5))
    law = result.records_law
    assert law.stiffness[1].interval95 is None
    assert law.damping[1].interval95 is None
    assert law.damping_ratio[-1] == pytest.approx(result.damping_ratio[-1], rel=0.02)
    assert any("k0 and c0 are extrapolated by powers" in each for each in result.warnings)
