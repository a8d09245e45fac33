import numpy as np
import pytest
from scipy import integrate

from opid.errors import InputError
from opid.virtual.taxi_tests.road import iso8608_road, iso8608_tracks, road_psd, track_correlation

LATERAL_M = (0.0, 1.6, -0.3)
N_DRAWS = 10


def tracks(lateral_m=LATERAL_M, *, seed=1, length_m=500.0, **settings):
    settings = {"footprint_m": 0.0, **settings}
    return iso8608_tracks("B", lateral_m=lateral_m, length_m=length_m, rng=np.random.default_rng(seed), **settings)


def spectra(roads):
    """Spatial frequencies in the band, and there the cross-PSD matrix (line, road, road) over the PSD of the class."""
    length_m = roads[0].length_m
    n_points = int(16 * length_m)
    place_m = length_m / n_points * np.arange(n_points)
    lines = np.fft.rfft([road.elevation(place_m) for road in roads], axis=1) / n_points
    n = np.arange(lines.shape[1]) / length_m
    inside = (n > 0.0199) & (n < 4.0001)
    n, lines = n[inside], lines[:, inside]
    return n, 2.0 * length_m * np.einsum("in,jn->nij", lines.conj(), lines) / road_psd("B", n)[:, None, None]


@pytest.fixture(scope="module")
def averaged():
    """Spatial frequencies, and cross-PSD over that of the class in the mean over draws of tracks on one surface."""
    draws = [spectra(tracks(seed=seed)) for seed in range(N_DRAWS)]
    return draws[0][0], np.mean([matrix for _, matrix in draws], axis=0)


def octaves(n):
    """Lines of each octave from 0.02 cycles/m on, and five deviations of a mean over them and the draws."""
    octave = np.floor(np.log2(n / 0.01999)).astype(int)
    lines = [octave == k for k in range(octave.max() + 1)]
    return lines, [5.0 / np.sqrt(inside.sum() * N_DRAWS) for inside in lines]


def test_the_psd_of_every_track_is_that_of_the_class(averaged):
    n, matrix = averaged
    for inside, bound in zip(*octaves(n), strict=True):
        of_tracks = np.einsum("nii->ni", matrix[inside]).real.mean(axis=0)
        np.testing.assert_allclose(of_tracks, 1.0, atol=bound)


@pytest.mark.parametrize(("one", "other"), [(0, 1), (0, 2), (1, 2)])
def test_the_coherence_is_that_of_an_isotropic_surface(averaged, one, other):
    n, matrix = averaged
    expected = track_correlation(n, abs(LATERAL_M[one] - LATERAL_M[other]))
    assert expected[0] > 0.8
    assert expected[-1] < 0.02
    for inside, bound in zip(*octaves(n), strict=True):
        cross, correlation = matrix[inside, one, other].mean(), expected[inside].mean()
        assert abs(cross - correlation) < bound
        auto = matrix[inside, one, one].mean() * matrix[inside, other, other].mean()
        assert abs(cross) ** 2 / auto.real == pytest.approx(correlation**2, abs=2.0 * bound)


@pytest.mark.parametrize(("n", "distance_m"), [(0.02, 3.0), (0.1, 3.0), (0.1, 0.3), (0.4, 1.5), (2.0, 0.1)])
def test_the_correlation_is_that_of_a_surface_of_equal_roughness_in_all_directions(n, distance_m):
    # a track whose PSD falls with n^-2 is cut from a surface whose PSD falls with |k|^-3
    def surface(m):
        return (n**2 + m**2) ** -1.5

    cross, _ = integrate.quad(surface, 0.0, np.inf, weight="cos", wvar=2.0 * np.pi * distance_m, limlst=400)
    along, _ = integrate.quad(surface, 0.0, np.inf)
    assert track_correlation(n, distance_m) == pytest.approx(cross / along, abs=1e-6)


def test_long_waves_are_common_and_short_ones_are_not():
    assert track_correlation(0.1, 0.0) == 1.0
    assert track_correlation([1e-9, 1e3], 1.0) == pytest.approx([1.0, 0.0])
    falling = track_correlation(np.linspace(0.0, 2.0, 500), 1.0)
    assert (np.diff(falling) < 0.0).all()


def test_independent_tracks_have_nothing_in_common():
    matrix = np.array([spectra(tracks((0.0, 0.3), seed=seed, coherent=False))[1] for seed in range(5)])
    np.testing.assert_allclose(np.einsum("snii->sni", matrix).real, 1.0, rtol=1e-2)
    cross = matrix[:, :, 0, 1]
    assert abs(cross.mean()) < 4.0 / np.sqrt(cross.size)


@pytest.mark.parametrize("coherent", [True, False])
def test_wheels_at_the_same_place_across_have_the_same_road(coherent):
    roads = tracks((1.0, -1.0, 1.0), coherent=coherent)
    assert roads[0] is roads[2]
    place_m = np.linspace(0.0, 50.0, 200)
    assert not np.allclose(roads[0].elevation(place_m), roads[1].elevation(place_m))


def test_tracks_that_touch_are_almost_one():
    near, nearer, nearest = (tracks((0.0, b)) for b in (1e-2, 1e-5, 1e-12))
    place_m = np.linspace(0.0, 400.0, 4000)
    apart = [np.std(np.diff([road.elevation(place_m) for road in roads], axis=0)) for roads in (near, nearer, nearest)]
    assert apart[0] > 100.0 * apart[1] > 100.0 * apart[2]


def test_slope_and_footprint_are_those_of_a_road():
    point, tyre = tracks(), tracks(footprint_m=0.3)
    place_m = np.linspace(10.0, 60.0, 173)
    across = np.linspace(-0.15, 0.15, 301)
    for one, other in zip(point, tyre, strict=True):
        averaged = np.trapezoid(one.elevation(place_m[:, None] + across), across, axis=1) / 0.3
        np.testing.assert_allclose(other.elevation(place_m), averaged, atol=1e-3 * np.std(averaged))
        numeric = (other.elevation(place_m + 1e-5) - other.elevation(place_m - 1e-5)) / 2e-5
        np.testing.assert_allclose(other.slope(place_m), numeric, atol=1e-6 * np.abs(numeric).max())
        np.testing.assert_allclose(other.elevation(place_m + other.length_m), other.elevation(place_m), atol=1e-12)


def test_the_mean_height_is_zero_and_the_seed_makes_the_tracks():
    first, again, other = (tracks(seed=seed) for seed in (3, 3, 4))
    place_m = first[0].length_m * np.arange(8000) / 8000
    for one, same, different in zip(first, again, other, strict=True):
        assert abs(one.elevation(place_m).mean()) < 1e-9
        np.testing.assert_array_equal(one.elevation(place_m), same.elevation(place_m))
        assert not np.allclose(one.elevation(place_m), different.elevation(place_m))


def test_a_single_track_is_a_road():
    (track,) = tracks((1.6,), seed=5, footprint_m=0.3)
    road = iso8608_road("B", length_m=500.0, rng=np.random.default_rng(5), footprint_m=0.3)
    place_m = np.linspace(0.0, 100.0, 500)
    np.testing.assert_array_equal(track.elevation(place_m), road.elevation(place_m))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: tracks(()), "one finite number for each wheel"),
        (lambda: tracks((0.0, np.nan)), "one finite number for each wheel"),
        (lambda: tracks(length_m=-1.0), "length is -1.0 m"),
        (lambda: tracks(footprint_m=-0.3), "footprint -0.3 m"),
        (lambda: iso8608_tracks("b", lateral_m=(0.0,), length_m=9.0, rng=np.random.default_rng(1)),
         "no road class 'b'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(call, message):
    with pytest.raises(InputError, match=message):
        call()
