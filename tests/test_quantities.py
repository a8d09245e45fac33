"""Velocities, displacements and travels: their derivatives, how far these are useful, and what is refused."""

import numpy as np
import pytest

import opid
from opid.signals.quantities import accelerate, acceleration_below, check_travel, highest_useful_hz, quantity_of

FS = 256.0
T = np.arange(round(20 * FS)) / FS


def gear_motion(frequency_hz=2.0, seed=0):
    """Travel and acceleration of a body on a spring whose lower end moves at random below 10 Hz."""
    rng = np.random.default_rng(seed)
    lines_hz = np.fft.rfftfreq(T.size, 1 / FS)
    omega, square = 2 * np.pi * lines_hz, (2 * np.pi * frequency_hz) ** 2
    travel = (rng.standard_normal(lines_hz.size) + 1j * rng.standard_normal(lines_hz.size)) * (lines_hz > 0.3)
    travel *= (lines_hz < 10.0) / (1.0 + (omega**2 / square))
    travel *= 0.004 * np.sqrt(2) / np.linalg.norm(travel) * T.size / np.sqrt(2)
    return np.fft.irfft(travel, T.size), np.fft.irfft(-square * travel * (1 + 0.02j * omega), T.size)


@pytest.mark.parametrize("n_derivatives", [0, 1, 2])
def test_derivatives_are_those_of_a_sine(n_derivatives):
    omega = 2 * np.pi * 3.0
    found = accelerate(np.sin(omega * T), fs=FS, n_derivatives=n_derivatives, highest_hz=30.0)
    true = omega**n_derivatives * np.sin(omega * T + n_derivatives * np.pi / 2)
    inside = slice(round(2 * FS), -round(2 * FS))
    assert np.abs(found - true)[inside].max() < 2e-3 * omega**n_derivatives


def test_motion_above_the_useful_frequency_is_left_out():
    found = accelerate(np.sin(2 * np.pi * 40.0 * T), fs=FS, n_derivatives=2, highest_hz=10.0)
    assert np.std(found) < 1e-3 * (2 * np.pi * 40.0) ** 2


def test_more_noise_ends_sooner():
    travel, _ = gear_motion()
    noise = np.random.default_rng(1).standard_normal(T.size)
    quiet, loud = (highest_useful_hz(travel + level * noise, fs=FS) for level in (1e-5, 1e-4))
    assert 3.0 < loud < quiet <= 11.0


def test_noise_alone_is_refused():
    with pytest.raises(opid.InputError, match=r"sinks into its noise at .* give a sensor with less noise"):
        highest_useful_hz(np.random.default_rng(0).standard_normal(T.size), fs=FS)


def test_acceleration_below_is_that_above_less_the_second_derivative():
    travel, above = gear_motion()
    below = acceleration_below(travel + 1e-6 * np.random.default_rng(2).standard_normal(T.size), above, fs=FS)
    lines = np.fft.rfft(travel) * -((2 * np.pi * np.fft.rfftfreq(T.size, 1 / FS)) ** 2)
    true = above - np.fft.irfft(lines, T.size)
    inside = slice(round(2 * FS), -round(2 * FS))
    assert np.std((below - true)[inside]) < 0.1 * np.std(true[inside])


@pytest.mark.parametrize(
    ("unit", "stated", "found"),
    [
        ("m/s^2", None, "acceleration"),
        ("m/s", None, "velocity"),
        ("m", "travel", "travel"),
        ("m", "displacement", "displacement"),
    ],
)
def test_a_unit_tells_the_quantity(unit, stated, found):
    assert quantity_of(unit, stated) == found


@pytest.mark.parametrize(
    ("unit", "stated", "words"),
    [
        ("m", None, r"give quantity = 'displacement' .* or 'travel'"),
        ("m/s^2", "travel", r"its quantity is 'travel' and its unit is m/s\^2"),
        ("N", None, "it is in N: give an acceleration"),
    ],
)
def test_another_unit_is_refused(unit, stated, words):
    with pytest.raises(opid.InputError, match=words):
        quantity_of(unit, stated)


def test_a_sound_travel_is_accepted():
    check_travel(*gear_motion(), fs=FS)


def test_a_travel_of_the_wrong_sign_is_refused():
    travel, above = gear_motion()
    with pytest.raises(opid.InputError, match=r"give sign = -1 in the table of .* that is turned round"):
        check_travel(-travel, above, fs=FS)


@pytest.mark.parametrize("frequency_hz", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("factor", [1e3, 1e-3, 0.01])
def test_a_travel_in_a_wrong_unit_is_refused(factor, frequency_hz):
    """Millimetres that are read as metres, the other way round, and metres that are read as centimetres."""
    travel, above = gear_motion(frequency_hz)
    if factor == 0.01 and frequency_hz < 2.0:
        pytest.skip("a factor of a hundred looks like another suspension")
    with pytest.raises(opid.InputError, match=r"natural frequency of .* which no suspension has: check its unit"):
        check_travel(factor * travel, above, fs=FS)


def test_a_travel_of_another_suspension_is_refused():
    with pytest.raises(opid.InputError, match="of the acceleration above is coherent with it"):
        check_travel(gear_motion(seed=1)[0], gear_motion(seed=2)[1], fs=FS)
