"""Response curves under a force against closed forms, scipy's integration and the quadrature curve."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError, NotDeterminedError
from opid.mechanics.backbones.forced_curves import forced_curve
from opid.mechanics.backbones.jointed_modes import JointedModes
from opid.mechanics.backbones.quadrature_curves import begin_curve, quadrature_curve
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import Law, Term

OMEGA, ZETA, CUBIC, FORCE = 100.0, 0.02, 4e9, 0.6


def one_mass(*terms):
    """A mass of 1 kg on a spring, with the law of the terms."""
    system = JointedModes([OMEGA**2], [[1.0]], [[1.0]], ("mass",), ("spring",))
    return Specimen(system, Law(tuple(Term(name, values) for name, values in terms)), ZETA, "mass")


def cubic_mass(*dampers):
    return one_mass(("cubic_stiffness", (CUBIC,)), *dampers)


def two_modes(drive="tip"):
    """Two modes that move both joints, 14 and 25 Hz, with a linear and a quadratic damper; `end` moves backwards."""
    system = JointedModes(
        (2 * np.pi * np.array([14.0, 25.0])) ** 2,
        np.array([[0.9, 0.8], [-0.5, 0.7]]),
        np.array([[0.8, 0.7], [0.75, -0.8]]),
        ("tip", "end"),
        ("left", "right"),
    )
    law = Law(
        (Term("cubic_stiffness", (1e8,)), Term("signed_power_damping", (0.4, 1.0)), Term("quadratic_damping", (2.0,)))
    )
    return Specimen(system, law, 0.002, drive)


def respond(specimen, force_n=FORCE, **changes):
    asked = {"mode": 1, "sensor": specimen.system.sensors[0], "harmonics": (1,), "widest_fraction": 0.3} | changes
    return forced_curve(specimen, force_n=force_n, **asked)


def test_a_linear_mode_has_the_closed_form():
    curve = respond(one_mass(("cubic_stiffness", (1e-3,))))
    omega, lag = 2 * np.pi * curve.frequency_hz, np.radians(curve.phase_deg)
    np.testing.assert_allclose(curve.phase_deg, np.arange(5, 180, 5), atol=1e-6)
    response = FORCE / (OMEGA**2 - omega**2 + 2j * ZETA * OMEGA * omega)
    np.testing.assert_allclose(curve.amplitude, np.abs(response), rtol=1e-8)
    np.testing.assert_allclose(lag, -np.angle(response), atol=1e-8)
    hz, amplitude = curve.resonance
    assert 2 * np.pi * hz == pytest.approx(OMEGA * np.sqrt(1 - 2 * ZETA**2), rel=1e-6)
    assert amplitude == pytest.approx(FORCE / (2 * ZETA * OMEGA**2 * np.sqrt(1 - ZETA**2)), rel=1e-6)


def test_a_duffing_oscillator_has_the_closed_form_through_its_turning_points():
    curve = respond(cubic_mass())
    omega, lag, a = 2 * np.pi * curve.frequency_hz, np.radians(curve.phase_deg), curve.amplitude
    np.testing.assert_allclose((OMEGA**2 + 0.75 * CUBIC * a**2 - omega**2) * a, FORCE * np.cos(lag), atol=1e-9)
    np.testing.assert_allclose(2 * ZETA * OMEGA * omega * a, FORCE * np.sin(lag), rtol=1e-8)
    assert (np.diff(curve.phase_deg) > 0).all()
    # Over the frequency it turns back twice.
    turns = np.sign(np.diff(curve.frequency_hz))
    assert (np.diff(turns) != 0).sum() == 2
    assert curve.reason == ""


def test_the_peak_is_next_to_the_quadrature_of_the_same_force():
    curve = respond(cubic_mass(), phases=np.arange(5, 180, 2.5))
    hz, amplitude = curve.resonance
    at = float(curve.amplitude[np.argmin(np.abs(curve.phase_deg - 90.0))])
    (level,) = quadrature_curve(
        cubic_mass(), mode=1, sensor="mass", controlled_sensor="mass", amplitude=[at], harmonics=(1,),
        widest_fraction=0.3,
    ).levels  # fmt: skip
    assert abs(level.force[0]) == pytest.approx(FORCE, rel=1e-8)
    # |X| is largest where 2 zeta w0 w A = f sin(lag), with w a function of the lag, is: 90 degrees and a little less.
    assert at < amplitude < at * (1 + ZETA**2)
    assert hz == pytest.approx(level.frequency_hz, rel=2e-3)


def rate_of(specimen, level):
    """The right-hand side of the equations of motion in modal coordinates, for scipy."""
    system, omega = specimen.system, 2 * np.pi * level.frequency_hz

    def rate(t, y):
        q, speed = np.split(y, 2)
        held = [law.force(z, v) for law, z, v in zip(
            specimen.joint_laws, system.at_joints @ q, system.at_joints @ speed, strict=True
        )]  # fmt: skip
        force = abs(level.force[0]) * np.cos(omega * t) * specimen.drive_row
        return np.concatenate(
            [speed, force - system.eigenvalue * q - specimen.modal_damping * speed - system.at_joints.T @ held]
        )

    return rate


@pytest.mark.parametrize(("sensor", "lag"), [("tip", 40.0), ("tip", 90.0), ("end", 150.0)])
def test_levels_are_periodic_orbits_for_scipy(sensor, lag):
    specimen = two_modes()
    curve = respond(
        specimen, 3.0, sensor=sensor, phases=[40.0, 65.0, 115.0, 150.0], harmonics=range(1, 12, 2),
    )  # fmt: skip
    level = curve.levels[int(np.argmin(np.abs(curve.phase_deg - lag)))]
    assert curve.phase_deg[np.argmin(np.abs(curve.phase_deg - lag))] == pytest.approx(lag, abs=1e-6)
    assert abs(level.force[0]) == pytest.approx(3.0, rel=1e-9)
    h = np.arange(1, level.sensors.shape[1] + 1)
    coordinates = np.linalg.solve(specimen.system.at_sensors, level.sensors)
    omega = 2 * np.pi * level.frequency_hz
    start = np.concatenate([coordinates.sum(axis=1).real, (coordinates @ (1j * h * omega)).real])
    end = solve_ivp(rate_of(specimen, level), (0.0, 1 / level.frequency_hz), start, rtol=1e-10, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(end, start, atol=2e-5 * np.abs(start[2:]).max())
    # The frequency of the curve is beyond the linear one, so that the dampers and the springs count.
    assert curve.resonance[0] > 1.02 * 14.0


def test_a_motion_from_rest_ends_on_the_curve():
    specimen = cubic_mass(("quadratic_damping", (5.0,)))
    curve = respond(specimen, phases=[20.0, 40.0, 120.0], harmonics=(1, 3, 5))
    level = curve.levels[0]
    period = 1 / level.frequency_hz
    run = solve_ivp(rate_of(specimen, level), (0.0, 100 * period), [0.0, 0.0], rtol=1e-8, atol=1e-12,
                    t_eval=99 * period + period * np.arange(32) / 32)  # fmt: skip
    first = 2 * np.mean(run.y[0] * np.exp(-2j * np.pi * np.arange(32) / 32))
    assert abs(first) == pytest.approx(curve.amplitude[0], rel=1e-4)
    assert np.degrees(-np.angle(first)) == pytest.approx(20.0, abs=0.05)


def test_a_phase_that_is_not_reached_ends_the_curve_with_a_reason():
    """Other modes move the sensor, too: the lag of the second one tends to that of the motion that they leave."""
    curve = respond(two_modes("end"), 0.5, mode=2, sensor="tip", phases=[1.0, 45.0, 135.0, 179.9])
    assert len(curve.levels) < 5
    assert re.search(r"'tip' does not reach a lag of (1|180) degrees beyond [\d.]+ Hz", curve.reason)
    assert (curve.amplitude > 0).all()


def test_a_response_whose_largest_level_is_at_its_end_has_no_resonance():
    assert respond(cubic_mass(), phases=[60.0, 120.0]).resonance is not None
    assert respond(cubic_mass(), phases=[89.0, 170.0]).resonance is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"force_n": -1.0}, "force_n is -1.0: give the positive amplitude of the force, N"),
        ({"force_n": np.nan}, "force_n is nan"),
        ({"phases": [100.0, 120.0]}, "give growing angles between 0 and 180 degrees, on both sides of 90"),
        ({"phases": [0.0, 120.0]}, "give growing angles"),
        ({"phases": [120.0, 80.0]}, "give growing angles"),
        ({"phases": []}, "give growing angles"),
        ({"harmonics": (3,)}, "harmonics are (3,)"),
        ({"sensor": "mast"}, "there is no sensor 'mast'"),
        ({"mode": 2}, "there is no mode 2"),
    ],
)
def test_a_response_that_cannot_be_is_refused(changes, words):
    with pytest.raises(InputError, match=re.escape(words)):
        respond(cubic_mass(), **changes)


@pytest.mark.parametrize("changes", [{"force_n": 2.0}, {"amplitude": 2e-3}, {"force_n": 2.0, "phase_error_rad": 0.7}])
def test_slopes_of_the_equations_are_their_differences(changes):
    balance, branch = begin_curve(two_modes(), 1, ("end", "tip"), (1, 2, 3), 0.3)
    rng, here = np.random.default_rng(0), replace(balance, **changes)
    x = branch.x * (1 + 0.02 * rng.standard_normal(branch.x.size)) + 0.02 * rng.standard_normal(branch.x.size)
    small = 1e-6 * np.eye(x.size)
    differences = np.array([(here.residual(x + each) - here.residual(x - each)) / 2e-6 for each in small]).T
    np.testing.assert_allclose(here.find_slopes(x), differences, atol=1e-8 * np.abs(differences).max())


def test_a_force_at_which_the_curve_is_lost_is_told():
    """Where two modes are near each other a sensor between them loses its quadrature, from some force on."""
    system = JointedModes(
        (2 * np.pi * np.array([14.0, 15.5])) ** 2, [[0.5, 0.5], [0.9, -0.9]], [[0.8, 0.1]], ("a", "b"), ("link",)
    )
    specimen = Specimen(system, Law((Term("cubic_stiffness", (1e8,)),)), 0.01, "a")
    small = respond(specimen, 1.0, sensor="b", phases=[80.0, 100.0])
    assert small.reason == ""
    with pytest.raises(NotDeterminedError, match=r"'b' does not reach quadrature beyond .* of 40 N: give a smaller"):
        respond(specimen, 40.0, sensor="b")
    with pytest.raises(NotDeterminedError, match=r"'b' does not reach quadrature within .* take another sensor"):
        respond(specimen, 1.0, sensor="b", widest_fraction=1e-6)
