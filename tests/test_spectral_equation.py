"""The equation of the sprung mass: exact without noise, at the bound with it."""

import numpy as np
import pytest
from law_runs import weightless_test

from opid.errors import InputError
from opid.mechanics.laws.law import Law, law
from opid.suspensions.law_search.pursuit import chosen
from opid.suspensions.paper.identification import fit_law, search_law
from opid.suspensions.paper.restoring_force import restoring_force
from opid.suspensions.paper.settings import PaperSettings
from opid.suspensions.paper.spectral_equation import equation_lines, fit_equation
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_test

QUIET = Sensor(noise_m_per_s2=0.0)
START = {"stiffness_per_mass": 150.0, "damping_per_mass": 1.0}


def _lines(test, channels="recording"):
    runs = []
    for run, change in ((test.heavy, 0.0), (test.light, test.mass_change_kg)):
        log = getattr(run, channels)
        runs.append(equation_lines(log.channel("lower_z"), log.channel("upper_z"), fs=log.fs, mass_change_kg=change))
    return runs


def _test(gear, seed=0, **settings):
    settings = {"duration_s": 20, "fs": 256, "lower_sensor": QUIET, "upper_sensor": QUIET} | settings
    return taxi_test(gear, rng=np.random.default_rng(seed), **settings)


@pytest.mark.parametrize("zeta", [0.02, 0.11, 0.3, 0.6])
@pytest.mark.parametrize("ground", [0.0, 1.67e5])
def test_a_linear_gear_without_noise_is_found_exactly_at_every_damping(zeta, ground):
    damping = 2 * zeta * np.sqrt(3.9e5 * 1850)
    gear = LandingGear(suspension_damping_n_s_per_m=damping, ground_stiffness_n_per_m=ground, law=Law())
    fit = fit_equation(_lines(_test(gear)), Law(), **START, inverse_mass=1 / 1000)
    np.testing.assert_allclose(1 / fit.inverse_mass, 1850, rtol=2e-4)
    np.testing.assert_allclose(fit.ratios[0], 3.9e5 / 1850, rtol=2e-4)
    np.testing.assert_allclose(fit.ratios[1], damping / 1850, rtol=1e-3)
    np.testing.assert_allclose(fit.ratios[2], ground / 1850, atol=0.03)


def test_stated_errors_are_the_spread_and_the_noise_is_recovered():
    fits = []
    for seed in range(25):
        test = _test(LandingGear(law=Law()), seed, lower_sensor=Sensor(), upper_sensor=Sensor())
        fits.append(fit_equation(_lines(test), Law(), **START, inverse_mass=1 / 1000))
    value, stated = (np.array([getattr(fit, name) for fit in fits]) for name in ("value", "std"))
    np.testing.assert_allclose(stated.mean(axis=0), value.std(axis=0), rtol=0.5)
    # the stated deviations see no bias beyond the error of the mean
    assert (np.abs(value.mean(axis=0) - [3.9e5 / 1850, 6e3 / 1850, 0, 1 / 1850]) < stated.mean(axis=0)).all()
    np.testing.assert_allclose(np.mean([fit.noise_m_per_s2 for fit in fits]), Sensor().noise_m_per_s2, rtol=0.05)


def test_ignoring_the_noise_of_the_regressors_shrinks_the_mass():
    # ordinary least squares on the same lines: the reason for the weights
    noisy = Sensor(noise_m_per_s2=0.03)
    errors = {"ordinary": [], "in_variables": []}
    for seed in range(4):
        runs = _lines(_test(LandingGear(law=Law()), seed, lower_sensor=noisy, upper_sensor=noisy))
        fit = fit_equation(runs, Law(), **START, inverse_mass=1 / 1000)
        errors["in_variables"].append(abs(1 / fit.inverse_mass / 1850 - 1))
        stiffness = []
        for run in runs:
            columns = np.stack([run.sprung - run.unsprung, 1j * run.omega * (run.sprung - run.unsprung)], 1)
            right = run.omega**2 * run.sprung
            flat = np.linalg.lstsq(
                np.concatenate([columns.real, columns.imag]),
                np.concatenate([right.real, right.imag]),
                rcond=None,
            )
            stiffness.append(flat[0][0])
        errors["ordinary"].append(abs(220 / (1 - stiffness[0] / stiffness[1]) / 1850 - 1))
    assert np.median(errors["in_variables"]) < 0.02
    assert np.median(errors["ordinary"]) > 5 * np.median(errors["in_variables"])


@pytest.mark.parametrize("order", [1, -1])
def test_runs_of_unequal_length_weigh_by_their_lines(order):
    long = _test(LandingGear(law=Law()), duration_s=80, lower_sensor=Sensor(), upper_sensor=Sensor())
    short = _test(LandingGear(law=Law()), 1, lower_sensor=Sensor(), upper_sensor=Sensor())
    runs = [_lines(long)[0], _lines(short)[1]][::order]
    fit = fit_equation(runs, Law(), **START, inverse_mass=1 / 1000)
    np.testing.assert_allclose(fit.noise_m_per_s2, Sensor().noise_m_per_s2, rtol=0.05)
    for residual in fit.residual:
        np.testing.assert_allclose(np.sqrt(np.mean(np.abs(residual) ** 2)), Sensor().noise_m_per_s2, rtol=0.1)
    np.testing.assert_allclose(1 / fit.inverse_mass, 1850, rtol=0.01)


def test_time_shift_and_units_change_nothing():
    test = _test(LandingGear(law=Law()), lower_sensor=Sensor(), upper_sensor=Sensor())
    x1, x2 = (test.heavy.recording.channel(name) for name in ("lower_z", "upper_z"))
    plain = fit_equation([equation_lines(x1, x2, fs=256)], Law(), **START)
    scaled = fit_equation([equation_lines(7 * x1, 7 * x2, fs=256)], Law(), **START)
    np.testing.assert_allclose(scaled.value, plain.value, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(scaled.noise_m_per_s2, 7 * plain.noise_m_per_s2, rtol=1e-5)
    # played backwards in time a dissipative gear has negative damping, and the same stiffness
    back = fit_equation([equation_lines(x1[::-1], x2[::-1], fs=256)], Law(), **START)
    np.testing.assert_allclose(back.ratios[0], plain.ratios[0], rtol=2e-3)
    np.testing.assert_allclose(back.ratios[1], -plain.ratios[1], rtol=2e-2)


def test_the_search_finds_friction_and_its_scale():
    test = _test(LandingGear(), duration_s=40, lower_sensor=Sensor(), upper_sensor=Sensor())
    runs = _lines(test)
    surfaces = [
        restoring_force(run.recording.channel("lower_z"), run.recording.channel("upper_z"), fs=256)
        for run in (test.heavy, test.light)
    ]
    ladder = search_law(runs, surfaces, inverse_mass=1 / 1500)
    best = chosen(ladder).fit
    assert best.law.name == "arctan_velocity"
    np.testing.assert_allclose(best.law.scaled(1 / best.inverse_mass).vector, [400, 0.02], rtol=0.03)
    assert ladder[0].law_name == "linear"
    assert ladder[0].fit.noise_m_per_s2 > 10 * best.noise_m_per_s2
    direct = fit_law(runs, surfaces, "arctan_velocity", inverse_mass=1 / 1500)
    np.testing.assert_allclose(direct.value, best.value, rtol=1e-3, atol=1e-3)


def test_bad_input_is_named():
    x = np.random.default_rng(0).standard_normal((2, 256 * 20))
    with pytest.raises(InputError, match="0 < low < high"):
        equation_lines(*x, fs=256, band_hz=(5, 2))
    with pytest.raises(InputError, match="longer run or a wider band"):
        equation_lines(*x, fs=256, band_hz=(5, 5.5))
    with pytest.raises(InputError, match="at least one"):
        fit_equation([], Law(), **START)
    lines = equation_lines(*x, fs=256)
    with pytest.raises(InputError, match="same mass change"):
        fit_equation([lines, lines], Law(), **START, inverse_mass=1e-3)
    unknown = PaperSettings(candidates=("cubic_stifness",))
    with pytest.raises(InputError, match="did you mean 'cubic_stiffness'"):
        search_law([lines], [restoring_force(*x, fs=256)], inverse_mass=None, settings=unknown)


def test_a_law_weighs_its_own_noise():
    """A stiffness that the law cancels must not pass for a noisier, better model (the weight holds both).

    The paper's equation has one law about the rest of both runs: the motion is one that no weight acts on.
    """
    gear = LandingGear(law=law("cubic_stiffness", stiffness_n_per_m3=3e9))
    runs = _lines(weightless_test(gear, duration_s=20, fs=256))
    true = fit_equation(runs, law("cubic_stiffness", stiffness_n_per_m3=1e6), **START, inverse_mass=1 / 1850)
    np.testing.assert_allclose(true.ratios[0], 3.9e5 / 1850, rtol=0.02)
