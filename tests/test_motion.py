"""Integration: closed forms, linearity, one filter for every signal, and the failure of the literal recipe."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from opid.errors import InputError
from opid.signals.motion import METHODS, filter_like, integrate, relative_motion

FS = 256.0
TIME = np.arange(30 * 256) / FS
SOUND = ("spectral", "zero_phase")


@pytest.mark.parametrize("method", SOUND)
@pytest.mark.parametrize("frequency_hz", [1.0, 2.0, 9.0])
def test_a_sine_is_integrated_in_closed_form(method, frequency_hz):
    omega = 2 * np.pi * frequency_hz
    motion = integrate(np.sin(omega * TIME + 0.3), fs=FS, method=method)
    inside = slice(10 * 256, 20 * 256)
    # all three went through one filter: its gain is that of the acceleration
    gain = motion.acceleration[inside].std() * np.sqrt(2)
    np.testing.assert_allclose(motion.velocity[inside].std() * np.sqrt(2), gain / omega, rtol=5e-3)
    np.testing.assert_allclose(motion.displacement[inside].std() * np.sqrt(2), gain / omega**2, rtol=1e-2)
    assert np.corrcoef(motion.displacement[inside], -motion.acceleration[inside])[0, 1] > 0.999


@pytest.mark.parametrize("method", METHODS)
@given(a=st.floats(-3, 3), b=st.floats(-3, 3), seed=st.integers(0, 2**16))
@settings(max_examples=10)
def test_integration_is_linear(method, a, b, seed):
    x, y = np.random.default_rng(seed).standard_normal((2, 3000))
    both = integrate(a * x + b * y, fs=FS, method=method)
    alone = [integrate(s, fs=FS, method=method) for s in (x, y)]
    scale = np.abs(alone[0].displacement).max() + np.abs(alone[1].displacement).max()
    for name in ("acceleration", "velocity", "displacement"):
        combined = a * getattr(alone[0], name) + b * getattr(alone[1], name)
        np.testing.assert_allclose(getattr(both, name), combined, atol=1e-9 * (1 + scale * 100))


@pytest.mark.parametrize("method", SOUND)
def test_an_offset_and_a_slow_drift_leave_the_travel_alone(method):
    true = np.sin(2 * np.pi * 2 * TIME)
    clean = integrate(true, fs=FS, method=method)
    drifting = integrate(true + 0.2 + 0.01 * TIME, fs=FS, method=method)
    middle = slice(10 * 256, 20 * 256)
    error = drifting.displacement[middle] - clean.displacement[middle]
    assert np.abs(error).max() < 0.03 * clean.displacement[middle].std()


def test_removing_the_mean_adds_a_parabola_of_height_dv_t_over_8():
    duration, dv = 40.0, 0.06
    t = np.arange(0, duration, 1 / FS)
    # a velocity that grows by dv from one end to the other
    acceleration = dv * np.pi / (2 * duration) * np.sin(np.pi * t / duration)
    true = dv / 2 * (t - duration / np.pi * np.sin(np.pi * t / duration))
    error = integrate(acceleration, fs=FS, method="mean_removed").displacement - true
    curvature, slope, offset = np.polyfit(t, error, 2)
    np.testing.assert_allclose(curvature * duration**2 / 4, -dv * duration / 8, rtol=1e-3)
    np.testing.assert_allclose(error, np.polyval([curvature, slope, offset], t), atol=1e-4 * dv * duration)


def test_filter_like_gives_the_acceleration_back():
    x = np.random.default_rng(1).standard_normal(TIME.size)
    for method in METHODS:
        motion = integrate(x, fs=FS, method=method)
        np.testing.assert_allclose(filter_like(x, motion), motion.acceleration, atol=1e-12)


def test_relative_motion_is_the_difference():
    x, y = np.random.default_rng(2).standard_normal((2, TIME.size))
    relative = relative_motion(x, y, fs=FS)
    np.testing.assert_allclose(relative.velocity, integrate(y - x, fs=FS).velocity)


@pytest.mark.parametrize(
    ("arguments", "settings_", "said"),
    [
        (np.zeros((5, 2)), {}, "one-dimensional"),
        (np.zeros(5000), {"method": "spektral"}, "did you mean 'spectral'"),
        (np.zeros(5000), {"high_pass_hz": 200.0}, "between 0 and fs/2"),
        (np.zeros(500), {"high_pass_hz": 0.3}, "less than three periods"),
    ],
)
def test_bad_input_is_named(arguments, settings_, said):
    with pytest.raises(InputError, match=said):
        integrate(arguments, fs=FS, **settings_)


def test_runs_of_different_length_are_refused():
    with pytest.raises(InputError, match="one length"):
        relative_motion(np.zeros(100), np.zeros(101), fs=FS)
