import numpy as np
import pytest
from hypothesis import given, strategies as st

from opid.errors import InputError
from opid.virtual.taxi_tests.road import ROAD_CLASSES, SpeedProfile, iso8608_road, road_psd


def road(road_class="B", *, footprint_m=0.0, seed=1, length_m=1000.0):
    rng = np.random.default_rng(seed)
    return iso8608_road(road_class, length_m=length_m, footprint_m=footprint_m, rng=rng)


def periodogram(profile, step_m):
    """One-sided PSD of one period of a road, m^3, and its spatial frequencies."""
    spectrum = np.fft.rfft(profile)
    return np.fft.rfftfreq(profile.size, step_m), 2.0 * step_m / profile.size * np.abs(spectrum) ** 2


@pytest.mark.parametrize("road_class", ["A", "B", "C"])
def test_the_psd_is_that_of_the_standard(road_class):
    rough = road(road_class)
    step_m = rough.length_m / 40000
    n, psd = periodogram(rough.elevation(step_m * np.arange(40000)), step_m)
    inside = (n > 0.0199) & (n < 4.0001)
    standard = {"A": 16e-6, "B": 64e-6, "C": 256e-6}[road_class] * (n[inside] / 0.1) ** -2.0
    np.testing.assert_allclose(psd[inside], standard, rtol=1e-2)
    assert psd[~inside].sum() < 1e-6 * psd.sum()


def test_the_heights_are_close_to_gaussian_with_the_variance_of_the_band():
    heights = np.concatenate([road(seed=seed).elevation(np.arange(0.0, 1000.0, 0.05)) for seed in range(20)])
    # integral of Gd over the band, 0.02 to 4 cycles/m and half a line more at both ends
    assert np.var(heights) == pytest.approx(64e-8 * (1.0 / 0.0195 - 1.0 / 4.0005), rel=1e-3)
    assert np.mean(heights**4) / np.var(heights) ** 2 == pytest.approx(3.0, abs=0.15)


def test_each_class_is_twice_as_high_as_the_one_before():
    places = np.linspace(0.0, 50.0, 500)
    np.testing.assert_allclose(road("C").elevation(places), 2.0 * road("B").elevation(places), rtol=1e-9)
    assert list(ROAD_CLASSES) == list("ABCDEFGH")
    assert road_psd("H", 0.1) == pytest.approx(16e-6 * 4.0**7)


def test_the_footprint_is_a_moving_average():
    point, tyre = road(footprint_m=0.0), road(footprint_m=0.3)
    places = np.linspace(10.0, 60.0, 173)
    across = np.linspace(-0.15, 0.15, 301)
    averaged = np.trapezoid(point.elevation(places[:, None] + across), across, axis=1) / 0.3
    np.testing.assert_allclose(tyre.elevation(places), averaged, atol=1e-4 * np.std(averaged))


def test_slope_is_the_derivative_of_the_elevation():
    rough = road(footprint_m=0.3)
    places = np.linspace(0.0, 400.0, 999)
    numeric = (rough.elevation(places + 1e-5) - rough.elevation(places - 1e-5)) / 2e-5
    np.testing.assert_allclose(rough.slope(places), numeric, atol=1e-6 * np.abs(numeric).max())


def test_a_road_repeats_smoothly_and_a_short_one_still_has_its_long_waves():
    short = road(length_m=5.0)
    assert short.length_m >= 10.0 / 0.02
    places = np.linspace(-3.0, 3.0, 50)
    np.testing.assert_allclose(short.elevation(places + short.length_m), short.elevation(places), atol=1e-12)


def test_the_seed_makes_the_road():
    places = np.linspace(0.0, 10.0, 20)
    np.testing.assert_array_equal(road(seed=4).elevation(places), road(seed=4).elevation(places))
    assert not np.allclose(road(seed=4).elevation(places), road(seed=5).elevation(places))


@given(start=st.floats(0.0, 40.0), stop=st.floats(0.0, 40.0), duration=st.floats(1.0, 100.0))
def test_speed_is_the_derivative_of_the_position(start, stop, duration):
    speed = SpeedProfile(start, stop, duration)
    time_s = np.linspace(-0.5 * duration, 1.5 * duration, 201)
    step_s = 1e-4 * duration
    numeric = (speed.position_m(time_s + step_s) - speed.position_m(time_s - step_s)) / (2.0 * step_s)
    np.testing.assert_allclose(numeric, speed.speed_m_per_s(time_s), atol=1e-3 * (start + stop + 1e-9))


def test_a_braked_aircraft_stays_where_it_stops():
    braking = SpeedProfile(25.0, 0.0, 20.0)
    np.testing.assert_allclose(braking.position_m([0.0, 20.0, 30.0]), [0.0, 250.0, 250.0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: road("b"), "no road class 'b'"),
        (lambda: road(length_m=0.0), "length is 0.0 m"),
        (lambda: road(footprint_m=-0.3), "footprint -0.3 m"),
        (lambda: iso8608_road("B", length_m=9.0, rng=np.random.default_rng(1), band_cycles_per_m=(4.0, 0.02)),
         "the lower first"),
        (lambda: SpeedProfile(-1.0, 2.0, 3.0), "not negative"),
        (lambda: SpeedProfile(1.0, 2.0, 0.0), "positive duration"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
