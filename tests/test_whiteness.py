"""A residual that is white passes, one that is not is told apart, located, and its intervals hold."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal, stats

from opid.mechanics.landing_gear import DEFAULT_LAW, LandingGear, taxi_test
from opid.mechanics.laws import Law
from opid.mechanics.sensors import Sensor
from opid.suspensions.one_gear.driven_run import driven_run
from opid.suspensions.one_gear.model_fit import fit_model
from opid.suspensions.one_gear.whiteness import WHITE_BELOW, bootstrap_std, coloured_std, whiteness

FS, MASS_KG = 256.0, 1850.0
FREQUENCY_HZ = np.arange(0.3, 40.0, 0.05)


def white_lines(rng, n_runs=1):
    """A residual of white noise, as much of a fit as the test of whiteness looks at."""
    lines = rng.standard_normal((n_runs, FREQUENCY_HZ.size, 2)) @ [1, 1j]
    return SimpleNamespace(residual=tuple(lines), frequency_hz=(FREQUENCY_HZ,) * n_runs)


def runs_of(seed, lower=None, upper=None, extra=None):
    sensors = {"lower_sensor": Sensor(**(lower or {})), "upper_sensor": Sensor(**(upper or {}))}
    test = taxi_test(LandingGear(), rng=np.random.default_rng(seed), duration_s=20.0, fs=FS, **sensors)
    return [
        driven_run(
            run.recording.channel("lower_z"),
            run.recording.channel("upper_z") + (0.0 if extra is None else extra(run.recording.channel("lower_z"))),
            fs=FS,
            mass_change_kg=change,
        )
        for run, change in ((test.heavy, 0.0), (test.light, test.mass_change_kg))
    ]


def fitted(runs, law=DEFAULT_LAW):
    scaled = law.scaled(1 / MASS_KG)
    return fit_model(runs, scaled, stiffness_per_mass=210.0, damping_per_mass=3.2, inverse_mass=1 / MASS_KG)


def test_the_statistic_of_white_noise_is_kolmogorovs():
    rng = np.random.default_rng(0)
    statistics = [whiteness(white_lines(rng)).statistic for _ in range(1000)]
    # finitely many lines, looked at from one side of each step, lie a little below the limit
    assert stats.kstest(statistics, stats.kstwobign.cdf).statistic < 0.1
    assert np.mean(np.array(statistics) > stats.kstwobign.isf(0.05)) == pytest.approx(0.05, abs=0.025)


def test_white_noise_is_called_white():
    rng = np.random.default_rng(1)
    assert stats.kstwobign.sf(WHITE_BELOW) == pytest.approx(1e-3, rel=0.05)
    # two runs, 1 of 500 by the limit: 3 of 200 has a chance of 1 %
    assert sum(not whiteness(white_lines(rng, n_runs=2)).white for _ in range(200)) <= 2


@pytest.mark.parametrize("centre_hz", [2.0, 5.0, 11.0])
def test_a_hump_in_a_spectrum_is_located(centre_hz):
    lines = white_lines(np.random.default_rng(2), n_runs=2)
    height = 1 + 3 / (1 + ((FREQUENCY_HZ - centre_hz) / (0.1 * centre_hz)) ** 2)
    found = whiteness(
        SimpleNamespace(residual=tuple(height * line for line in lines.residual), frequency_hz=lines.frequency_hz)
    )
    assert not found.white
    assert found.band_hz[0] < centre_hz < found.band_hz[1]
    assert found.excess > 1.5


def test_a_second_resonance_of_the_airframe_is_located():
    """A bracket that rings at 11 Hz beside the airframe: its reading has a part that no gear makes."""
    pole = np.exp((-0.03 + 1j) * 2 * np.pi * 11.0 / FS)

    def ringing(lower):
        answer = signal.lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], lower)
        return 0.02 * answer / answer.std()

    found = whiteness(fitted(runs_of(0, extra=ringing)))
    assert not found.white
    assert found.band_hz[0] < 11.0 < found.band_hz[1]
    assert whiteness(fitted(runs_of(0))).white


def test_all_deviations_agree_where_the_residual_is_white():
    ratios = []
    for seed in range(6):
        runs = runs_of(seed)
        fit = fitted(runs)
        ratios.append(
            [coloured_std(fit) / fit.std, bootstrap_std(runs, fit, rng=np.random.default_rng(seed)) / fit.std]
        )
        assert np.all(coloured_std(fit) >= fit.std)
    np.testing.assert_allclose(np.mean(ratios, axis=0), 1.0, atol=0.15)


def test_a_bootstrap_is_repeated_by_its_seed():
    runs = runs_of(0)
    fit = fitted(runs)
    first, again, other = (bootstrap_std(runs, fit, rng=np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(other, first, rtol=0.3)
    assert np.any(other != first)


@pytest.mark.parametrize(
    ("case", "sensor", "law"), [("no law", {}, Law()), ("leak", {"cross_axis": 0.03}, DEFAULT_LAW)]
)
def test_deviations_of_a_coloured_residual_cover_where_plain_ones_do_not(case, sensor, law):
    """Mass and stiffness to mass, 12 seeds: the error over the deviation should be 1 in the mean square."""
    plain, coloured, resampled = [], [], []
    for seed in range(12):
        runs = runs_of(seed, sensor, sensor)
        fit = fitted(runs, law)
        assert not whiteness(fit).white
        chosen = [0, fit.names.index("inverse_mass")]
        error = fit.value[chosen] - [3.9e5 / MASS_KG, 1 / MASS_KG]
        plain.append(error / fit.std[chosen])
        coloured.append(error / coloured_std(fit)[chosen])
        resampled.append(error / bootstrap_std(runs, fit, rng=np.random.default_rng(seed))[chosen])
    before = np.sqrt(np.mean(np.square(plain), axis=0))
    assert np.all(before > 1.4)
    for better in (coloured, resampled):
        after = np.sqrt(np.mean(np.square(better), axis=0))
        assert np.all(after < 0.85 * before)
        assert np.all(after < 2.0)
