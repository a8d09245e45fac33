"""Control-based continuation against harmonic balance, closed forms and scipy's integration."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from opid.errors import InputError
from opid.mechanics.backbones.family import backbone
from opid.mechanics.backbones.jointed_modes import JointedModes, jointed_modes
from opid.mechanics.backbones.quadrature_curves import find_quadrature_error, quadrature_curve
from opid.mechanics.backbones.specimen import Specimen
from opid.mechanics.laws.law import law
from opid.mechanics.response import advance, state_at
from opid.mechanics.rig import Shaker
from opid.updating.structure.reduction import reduce
from opid.virtual.backbone_tests.control_based_continuation import ContinuationSettings, ReadingNoise, measured_curve
from opid.virtual.backbone_tests.shaker_feedback import close_loop, design_reading
from opid.virtual.backbone_tests.wing_engine import UPDATED, wing_engine_structure

CUBIC = law("cubic_stiffness", stiffness_n_per_m3=1.58 * 6.8e7)
NOISE = ReadingNoise(acceleration_m_per_s2=5e-3, force_n=5e-3, control_n=1e-2)
AMPLITUDE = np.array([8e-4, 1.2e-3, 1.6e-3, 1.9e-3])
HASTY = ContinuationSettings(longest_periods=60, most_records=4, record_periods=10)


@pytest.fixture(scope="module")
def wing():
    """The wing-engine structure at real size: 29 modes, mode 1 of the paper is the seventh."""
    return Specimen(reduce(wing_engine_structure(), UPDATED), CUBIC, 0.003, "7")


@pytest.fixture(scope="module")
def measured(wing):
    return measured_curve(
        wing,
        mode=7,
        sensor="10",
        controlled_sensor="10",
        amplitude=AMPLITUDE,
        rng=np.random.default_rng(6),
        noise=NOISE,
    )


def two_masses(damping_ratio=0.01, cubic=4e6, drive="a"):
    rows = {"sensor_rows": np.eye(2), "joint_rows": [[-1.0, 1.0]], "sensors": ("a", "b"), "joints": ("link",)}
    system = jointed_modes(np.diag([2.0, 1.0]), [[3e4, -1e4], [-1e4, 1.3e4]], **rows)
    return Specimen(system, law("cubic_stiffness", stiffness_n_per_m3=cubic), damping_ratio, drive)


def one_mass(kind="cubic_stiffness", **values):
    system = JointedModes([100.0**2], [[1.0]], [[1.0]], ("mass",), ("spring",))
    return Specimen(system, law(kind, **values), 0.02, "mass")


def test_a_duffing_oscillator_has_the_closed_form():
    specimen = one_mass(stiffness_n_per_m3=4e9)
    a = np.array([1e-4, 5e-4, 1e-3])
    curve = quadrature_curve(
        specimen, mode=1, sensor="mass", controlled_sensor="mass", amplitude=a, harmonics=(1,), widest_fraction=0.3
    )
    omega = np.sqrt(100.0**2 + 0.75 * 4e9 * a**2)
    np.testing.assert_allclose(2 * np.pi * curve.frequency_hz, omega, rtol=1e-9)
    np.testing.assert_allclose(np.abs(curve.force[:, 0]), 2 * 0.02 * 100.0 * omega * a, rtol=1e-8)
    assert curve.reason == ""
    assert np.abs(curve.phase_error_rad).max() < 1e-8


def test_quadrature_curves_are_periodic_orbits_for_scipy():
    specimen = two_masses()
    curve = quadrature_curve(
        specimen, mode=2, sensor="b", controlled_sensor="b", amplitude=[1e-3, 3e-3, 6e-3], harmonics=range(1, 14, 2)
    )
    level = curve.levels[-1]
    period = 1.0 / level.frequency_hz
    omega = 2 * np.pi * level.frequency_hz
    h = np.arange(1, level.sensors.shape[1] + 1)
    mass = np.diag([2.0, 1.0])
    shapes = specimen.system.at_sensors
    damping = mass @ shapes @ np.diag(specimen.modal_damping) @ shapes.T @ mass
    stiffness = np.array([[3e4, -1e4], [-1e4, 1.3e4]])

    def rate(t, y):
        pull = 4e6 * (y[1] - y[0]) ** 3
        force = np.array([pull + (level.force[0] * np.exp(1j * omega * t)).real, -pull])
        return np.concatenate([y[2:], np.linalg.solve(mass, force - stiffness @ y[:2] - damping @ y[2:])])

    start = np.concatenate([level.sensors.sum(axis=1).real, (level.sensors @ (1j * h * omega)).real])
    end = solve_ivp(rate, (0.0, period), start, rtol=1e-11, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(end, start, atol=2e-7 * np.abs(start[2:]).max())
    assert curve.frequency_hz[-1] > 1.005 * curve.frequency_hz[0]


def test_a_sensor_with_two_quadratures_keeps_to_one(wing):
    # the drive point moves so little in the mode that it is in quadrature twice, 0.14 % of the frequency apart
    asked = {"mode": 7, "sensor": "7", "controlled_sensor": "10"}
    few, many = (quadrature_curve(wing, **asked, amplitude=np.linspace(2e-4, 4e-3, n)) for n in (11, 21))
    assert few.converged.all()
    assert many.converged.all()
    np.testing.assert_allclose(many.frequency_hz[::2], few.frequency_hz, rtol=1e-9)
    true = backbone(
        wing.system, CUBIC, mode=7, sensor="10", amplitude=many.controlled_amplitude, harmonics=(1, 3, 5, 7)
    )
    off = many.frequency_hz / true.frequency_hz - 1.0
    assert off[0] == pytest.approx(-0.00237, rel=0.01), "the quadrature of the linear structure that is nearest"
    assert np.abs(np.diff(off)).max() < 1.2e-4, "no hop"
    assert many.force[:, 0].real.min() > 0.0


def test_quadrature_ends_where_two_of_them_merge(wing):
    amplitude = np.linspace(2e-4, 2.5e-3, 11)
    curve = quadrature_curve(wing, mode=8, sensor="1", controlled_sensor="10", amplitude=amplitude)
    assert curve.converged[:9].all()
    assert not curve.converged.all()
    assert "'1' does not reach quadrature" in curve.reason


def test_a_law_that_is_not_odd_needs_the_mean_and_tends_to_the_backbone():
    specimen = one_mass("even_quadratic_stiffness", stiffness_n_per_m2=2e6)
    every = range(6)
    a = [1e-4, 1e-3]
    curve = quadrature_curve(specimen, mode=1, sensor="mass", controlled_sensor="mass", amplitude=a, harmonics=every)
    true = backbone(specimen.system, specimen.laws, mode=1, sensor="mass", amplitude=a, harmonics=every)
    np.testing.assert_allclose(curve.frequency_hz, true.frequency_hz, rtol=1e-5)
    assert curve.frequency_hz[1] < curve.frequency_hz[0]


def test_the_time_domain_agrees_with_harmonic_balance_and_the_backbone_in_spite_of_noise(wing, measured):
    assert measured.converged.all(), measured.reason
    held = measured.controlled_amplitude
    damped = quadrature_curve(wing, mode=7, sensor="10", controlled_sensor="10", amplitude=held)
    true = backbone(wing.system, CUBIC, mode=7, sensor="10", amplitude=held, harmonics=(1, 3, 5, 7))
    np.testing.assert_allclose(measured.frequency_hz, damped.frequency_hz, rtol=3e-5)
    np.testing.assert_allclose(measured.frequency_hz, true.frequency_hz, rtol=1e-4)
    np.testing.assert_allclose(np.abs(measured.force[:, 0]), damped.force[:, 0].real, rtol=0.02)
    # phases of the record count from the target, those of harmonic balance from the force
    tip = measured.sensors.index("10")
    for h in (1, 3):
        there = np.abs(measured.harmonics[-1, tip, h - 1])
        np.testing.assert_allclose(there, np.abs(damped.harmonics[-1, tip, h - 1]), rtol=0.02)


def test_frequencies_hold_where_the_phase_hardly_tells_them(wing):
    # where two quadratures of a sensor lie close, 5e-3 rad are 3e-5 of the frequency and more
    asked = {"mode": 7, "sensor": "8", "controlled_sensor": "10"}
    curve = measured_curve(wing, **asked, amplitude=[4e-4, 6e-4], rng=np.random.default_rng(3), noise=NOISE)
    assert curve.converged.all(), curve.reason
    exact = quadrature_curve(wing, **asked, amplitude=curve.controlled_amplitude)
    np.testing.assert_allclose(curve.frequency_hz, exact.frequency_hz, rtol=3e-5)


def test_levels_keep_their_promises(wing, measured):
    settings = ContinuationSettings()
    assert np.abs(measured.phase_error_rad).max() <= settings.phase_tolerance_rad
    assert np.abs(measured.controlled_amplitude / AMPLITUDE - 1.0).max() <= settings.amplitude_fraction
    assert max(level.invasiveness for level in measured.levels[1:]) < 0.01
    assert measured.harmonics.shape == (AMPLITUDE.size, 14, 7)
    # what is out of phase with the mode belongs to others: left out, shapes are those of the backbone
    true = backbone(wing.system, CUBIC, mode=7, sensor="10", amplitude=measured.controlled_amplitude, harmonics=(1, 3))
    np.testing.assert_allclose(measured.amplitude, true.shapes, atol=0.006 * AMPLITUDE[-1])
    # the pylons of the first mode move against one another
    signs = np.sign(measured.amplitude[-1, [9, 10, 12, 13]])
    assert signs.tolist() == [1.0, 1.0, -1.0, -1.0]


def test_the_seed_decides_the_noise():
    def first(seed):
        rng = np.random.default_rng(seed)
        asked = {"mode": 1, "sensor": "b", "controlled_sensor": "b", "amplitude": [1e-3]}
        return measured_curve(two_masses(), **asked, rng=rng, noise=NOISE, settings=HASTY).levels[0]

    one, again, other = first(1), first(1), first(2)
    assert np.array_equal(one.sensors, again.sensors)
    assert not np.array_equal(one.sensors, other.sensors)


def test_a_sensor_that_hardly_moves_in_the_mode_does_not_reach_quadrature(wing):
    asked = {"mode": 8, "sensor": "5", "controlled_sensor": "10", "amplitude": AMPLITUDE[:3]}
    curve = measured_curve(wing, **asked, rng=np.random.default_rng(0), settings=HASTY)
    assert not curve.converged.any()
    assert len(curve.levels) == 2, "after two failures the curve ends"
    assert "'5'" in curve.reason
    exact = quadrature_curve(wing, **asked)
    assert not exact.converged.any()
    assert "'5' does not reach quadrature" in exact.reason


@pytest.mark.parametrize("shaker", [None, Shaker(back_emf_n_s_per_m=20.0)], ids=["force", "shaker"])
def test_feedback_of_the_drive_point_alone_and_through_a_shaker(shaker):
    plain = two_masses()
    specimen = Specimen(plain.system, plain.laws, 0.01, "a", shaker)
    settings = ContinuationSettings(modal_filter=False, feedback_damping=0.05)
    curve = measured_curve(
        specimen,
        mode=1,
        sensor="b",
        controlled_sensor="b",
        amplitude=[1e-3, 3e-3],
        rng=np.random.default_rng(0),
        settings=settings,
    )
    assert curve.converged.all(), curve.reason
    exact = quadrature_curve(plain, mode=1, sensor="b", controlled_sensor="b", amplitude=curve.controlled_amplitude)
    np.testing.assert_allclose(curve.frequency_hz, exact.frequency_hz, rtol=1e-4)


@pytest.mark.parametrize("cubic", [4e6, -2e6], ids=["hardening", "softening"])
def test_hardening_and_softening_modes_are_held(cubic):
    specimen = two_masses(damping_ratio=0.003, cubic=cubic)
    asked = {"mode": 2, "sensor": "b", "controlled_sensor": "b"}
    levels = np.linspace(2e-3, 1.4e-2, 9)
    curve = measured_curve(specimen, **asked, amplitude=levels, rng=np.random.default_rng(2), noise=NOISE)
    assert curve.converged.all(), curve.reason
    exact = quadrature_curve(specimen, **asked, amplitude=curve.controlled_amplitude)
    np.testing.assert_allclose(curve.frequency_hz, exact.frequency_hz, rtol=3e-5)
    assert abs(curve.frequency_hz[-1] / curve.frequency_hz[0] - 1) > 0.02


def test_the_closed_loop_is_the_one_of_scipy():
    specimen = two_masses(drive="a")
    loop = close_loop(specimen, 1, damping_ratio=0.3, stiffness_fraction=0.02)
    p, d = loop.gains
    row = specimen.drive_row

    def rate(t, y):
        z = specimen.system.at_joints[0] @ y[:2]
        control = np.sin(80.0 * t) - p * loop.reading @ y[:2] - d * loop.reading @ y[2:]
        pull = -specimen.system.at_joints[0] * 4e6 * z**3
        linear = -specimen.system.eigenvalue * y[:2] - specimen.modal_damping * y[2:]
        return np.concatenate([y[2:], linear + pull + row * control])

    fs, n = 5000.0, 1000
    forces = np.sin(80.0 * np.arange(2 * n + 1) / (2 * fs))[:, None]
    found, _ = advance(loop.ready, state_at(loop.ready, [0.003, 0.001]), forces, fs=fs)
    exact = solve_ivp(rate, (0, n / fs), [0.003, 0.001, 0, 0], t_eval=found.time_s, rtol=1e-10, atol=1e-12).y
    np.testing.assert_allclose(found.displacement, exact[:2].T, atol=1e-8)


def test_the_modal_reading_stirs_no_mode_up(wing):
    reading = design_reading(wing, 7)
    row = wing.drive_row
    assert reading[6] == pytest.approx(row[6])
    # as near to the bound as a linear programme holds it (1e-7 of its scaled rows)
    assert (reading * row).min() > -1e-7 * row[6] ** 2
    others = np.delete(reading * row, 6)
    assert others.sum() < 0.2 * np.delete(row**2, 6).sum(), "it reads less of the other modes than the drive point does"


def test_feedback_stiffens_and_damps_the_mode_by_what_is_asked():
    specimen = two_masses()
    loop = close_loop(specimen, 1, damping_ratio=0.05, stiffness_fraction=0.01)
    row, place = specimen.drive_row, 0
    omega = 2 * np.pi * specimen.system.frequency_hz[place]
    added = np.array(loop.gains) * row[place] * loop.reading[place]
    np.testing.assert_allclose(added, [2 * 0.01 * omega**2, 2 * 0.05 * omega])


def test_phase_errors_are_positive_below_resonance():
    assert find_quadrature_error(1.0, -1j) == pytest.approx(0.0)
    assert find_quadrature_error(1.0, 0.1 - 1j) == pytest.approx(np.arctan(0.1))
    assert find_quadrature_error(1.0, -0.1 + 1j) == pytest.approx(np.arctan(0.1)), "a sensor that moves the other way"
    assert find_quadrature_error(1.0, -0.1 - 1j) == pytest.approx(-np.arctan(0.1))


def test_feedback_that_loses_the_structure_is_told(wing):
    curve = measured_curve(
        wing,
        mode=7,
        sensor="10",
        controlled_sensor="10",
        amplitude=[4e-3],
        rng=np.random.default_rng(0),
        settings=ContinuationSettings(feedback_damping=0.2, longest_periods=60, most_records=4),
    )
    assert not curve.converged.any()
    assert curve.reason


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"damping_ratio": 0.0}, "damping_ratio"),
        ({"damping_ratio": [0.01]}, "one for each mode"),
        ({"drive": "c"}, "no sensor 'c'"),
        ({"laws": (CUBIC, CUBIC)}, "2 laws"),
        ({"shaker": Shaker(second_harmonic=0.1)}, "distorts"),
    ],
)
def test_a_specimen_that_cannot_be(change, text):
    plain = two_masses()
    given = {"system": plain.system, "laws": plain.laws, "damping_ratio": 0.01, "drive": "a"}
    with pytest.raises(InputError, match=text):
        Specimen(**(given | change))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"mode": 3}, "no mode 3"),
        ({"sensor": "c"}, "no sensor 'c'"),
        ({"controlled_sensor": "c"}, "no sensor 'c'"),
        ({"amplitude": [2e-3, 1e-3]}, "from small to large"),
        ({"amplitude": [-1e-3]}, "positive"),
    ],
)
def test_a_curve_that_cannot_be(change, text):
    asked = {"mode": 1, "sensor": "b", "controlled_sensor": "b", "amplitude": [1e-3]} | change
    with pytest.raises(InputError, match=text):
        quadrature_curve(two_masses(), **asked)
    with pytest.raises(InputError, match=text):
        measured_curve(two_masses(), **asked, rng=np.random.default_rng(0))


def test_harmonics_without_the_first_are_refused():
    with pytest.raises(InputError, match="1 among them"):
        quadrature_curve(two_masses(), mode=1, sensor="b", controlled_sensor="b", amplitude=[1e-3], harmonics=(3,))


def test_modes_that_nothing_can_drive_are_refused():
    system = JointedModes([0.0, 100.0], [[1.0, 1.0], [1.0, 0.0]], [[0.0, 1.0]], ("a", "node"), ("link",))
    asked = {"sensor": "a", "controlled_sensor": "a", "amplitude": [1e-3]}
    with pytest.raises(InputError, match="give the number of an elastic mode"):
        quadrature_curve(Specimen(system, CUBIC, 0.01, "a"), mode=1, **asked)
    with pytest.raises(InputError, match="'node' does not move"):
        quadrature_curve(Specimen(system, CUBIC, 0.01, "node"), mode=2, **asked)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"record_periods": 0}, "whole number"),
        ({"phase_tolerance_rad": -1.0}, "positive number"),
        ({"feedback_stiffness": -1.0}, "0 or more"),
        ({"samples_per_period": 16}, "four for each harmonic"),
    ],
)
def test_settings_that_cannot_be(change, text):
    with pytest.raises(InputError, match=text):
        ContinuationSettings(**change)


def test_noise_below_zero_is_refused():
    with pytest.raises(InputError, match="force_n"):
        ReadingNoise(force_n=-1.0)
