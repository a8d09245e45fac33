"""Spectra against scipy, closed forms and the physics of a linear two-channel system."""

import numpy as np
import pytest
from scipy import signal

from opid.errors import InputError
from opid.signals.spectra import cross_spectra, noise_floor, sample_window, transmissibility

FS = 256.0


def _pair(seed=0, n=2**15):
    x = np.random.default_rng(seed).standard_normal(n)
    y = signal.lfilter(*signal.butter(2, 10, fs=FS), x)
    return x, y


@pytest.mark.parametrize("n_samples", [2, 7, 1024])
@pytest.mark.parametrize("name", ["hann", "flattop", ("tukey", 0.3)])
def test_windows_are_those_of_scipy(name, n_samples):
    np.testing.assert_allclose(sample_window(name, n_samples), signal.get_window(name, n_samples), atol=1e-15)


@pytest.mark.parametrize("window", ["hann", "flattop", ("tukey", 0.3), "boxcar"])
def test_the_diagonal_is_welchs(window):
    x, y = _pair()
    spectra = cross_spectra(np.stack([x, y], 1), fs=FS, window=window, nperseg=1024, noverlap=307)
    for i, channel in enumerate((x, y)):
        _, expected = signal.welch(channel, FS, window=window, nperseg=1024, noverlap=307)
        np.testing.assert_allclose(spectra.density[:, i, i], expected, rtol=1e-10, atol=1e-18)
    assert spectra.n_blocks == (x.size - 307) // (1024 - 307)
    np.testing.assert_allclose(spectra.density[:, 0, 1], spectra.density[:, 1, 0].conj())


@pytest.mark.parametrize("estimator", ["H1", "H2", "Hv"])
def test_every_estimator_finds_a_noise_free_filter(estimator):
    x, y = _pair()
    T = transmissibility(x, y, fs=FS, estimator=estimator, nperseg=2048)
    _, expected = signal.freqz(*signal.butter(2, 10, fs=FS), worN=T.frequency_hz, fs=FS)
    inside = (T.frequency_hz > 0.5) & (T.frequency_hz < 30)
    np.testing.assert_allclose(T.value[inside], expected[inside], rtol=0.02)


def test_h1_is_low_with_input_noise_h2_high_with_output_noise_hv_between():
    rng = np.random.default_rng(3)
    x = rng.standard_normal(2**16)
    noisy = [x + 0.5 * rng.standard_normal(x.size) for _ in range(2)]
    level = {
        name: np.median(np.abs(transmissibility(*noisy, fs=FS, estimator=name, nperseg=512).value))
        for name in ("H1", "H2", "Hv")
    }
    np.testing.assert_allclose(level["H1"], 1 / 1.25, rtol=0.03)
    np.testing.assert_allclose(level["H2"], 1.25, rtol=0.03)
    np.testing.assert_allclose(level["Hv"], 1.0, rtol=0.03)


def test_one_average_has_coherence_one_by_construction():
    rng = np.random.default_rng(4)
    T = transmissibility(*rng.standard_normal((2, 2048)), fs=FS, nperseg=2048)
    assert T.spectra.n_averages == 1
    np.testing.assert_allclose(T.coherence[1:-1], 1.0)


def test_independent_averages_are_between_half_of_the_blocks_and_all():
    x, y = _pair()
    half = cross_spectra(np.stack([x, y], 1), fs=FS, nperseg=1024, noverlap=512)
    none = cross_spectra(np.stack([x, y], 1), fs=FS, nperseg=1024, noverlap=0)
    assert none.n_averages == none.n_blocks == 32
    assert none.n_averages < half.n_averages < half.n_blocks


def test_the_stated_random_error_is_the_observed_one():
    rng = np.random.default_rng(5)
    ratios, stated = [], []
    for _ in range(60):
        x = rng.standard_normal(8192)
        T = transmissibility(x, x + rng.standard_normal(x.size), fs=FS, nperseg=512, noverlap=0)
        ratios.append(np.abs(T.value[20:200]))
        stated.append(T.relative_std[20:200])
    observed = np.std(ratios, axis=0) / np.mean(ratios, axis=0)
    np.testing.assert_allclose(np.mean(stated), np.mean(observed), rtol=0.1)


def test_noise_floor_sees_through_a_resonance():
    rng = np.random.default_rng(6)
    x, _ = _pair(6)
    y = signal.lfilter(*signal.iirpeak(3, 5, fs=FS), x) + 0.01 * rng.standard_normal(x.size)
    assert 0.009 < noise_floor(y, fs=FS) < 0.02


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"nperseg": 10**6}, "no longer than the run"),
        ({"nperseg": 256, "noverlap": 256}, "below nperseg"),
        ({"estimator": "H3"}, "did you mean|known are"),
        ({"fs": 5e-4}, "unit of the time"),
    ],
)
def test_bad_settings_are_named(settings, said):
    with pytest.raises(InputError, match=said):
        transmissibility(np.zeros(1000), np.zeros(1000), **({"fs": FS} | settings))


@pytest.mark.parametrize("fs", [0.1, 0.5, 1.0, 3.0])
def test_the_noise_floor_has_no_least_rate(fs):
    assert noise_floor(np.random.default_rng(0).standard_normal(5000), fs=fs) == pytest.approx(1.0, rel=0.1)
