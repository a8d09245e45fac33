"""A jump of dry friction is no spike, a lone sample is one, in a whole run and in a log that is read once."""

from dataclasses import replace

import numpy as np
import pytest
from measured_data import DATA, needs_data
from scipy import signal

from opid.mechanics.laws.law import law
from opid.signals.health.inspection import inspect
from opid.signals.health.spikes import SPIKES, remove_spikes
from opid.signals.recording import recording_from_arrays
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.sensors import Sensor
from opid.virtual.taxi_tests.taxiing import taxi_run


def stick_slip(seed, duration_s=8.0):
    """A run of dry friction that is drawn at random: its force, scale, rate, road and the noise of the sensors."""
    rng = np.random.default_rng(seed)
    amplitude_n, scale_m_per_s = 10 ** rng.uniform(2.0, np.log10(3000.0)), 10 ** rng.uniform(np.log10(5e-4), -1.3)
    kind = str(rng.choice(["arctan_velocity", "coulomb_friction"]))
    gear = LandingGear(law=law(kind, amplitude_n=amplitude_n, scale_m_per_s=scale_m_per_s))
    sensor = Sensor(noise_m_per_s2=10 ** rng.uniform(-3.5, -1.0))
    return taxi_run(
        gear,
        rng=rng,
        fs=float(rng.choice([256.0, 512.0, 1000.0, 2000.0])),
        duration_s=duration_s,
        road_class=str(rng.choice(list("ABCD"))),
        lower_sensor=sensor,
        upper_sensor=sensor,
        # the rate at which steep friction brings the wheel to a halt is amplitude / (scale * mass)
        lowest_step_rate_hz=max(4096.0, 2 * amplitude_n / (scale_m_per_s * gear.unsprung_mass_kg)),
    ).recording


def resonance(seed, n=20_000, fs=512.0):
    pole = np.exp((-0.1 + 1j) * 2 * np.pi * 15.0 / fs)
    noise = np.random.default_rng(seed).standard_normal(n)
    return signal.lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], noise)


def random_indices(rng, n, every=400):
    """Indices at random, never closer than ten samples."""
    return np.sort(rng.choice(np.arange(10, n - 10, 10), size=n // every, replace=False))


@pytest.mark.parametrize("seed", range(24))
def test_clean_dry_friction_loses_no_sample(seed):
    recording = stick_slip(seed)
    for samples in recording.samples.T:
        mended, indices = remove_spikes(samples, fs=recording.fs)
        assert indices.size == 0
        np.testing.assert_array_equal(mended, samples)
    assert [channel.spikes for channel in inspect(recording).channels] == [0, 0]


@pytest.mark.parametrize("height", [5.0, 20.0, 100.0])
@pytest.mark.parametrize("seed", range(6))
def test_spikes_among_dry_friction_are_mended(seed, height):
    rng, recording = np.random.default_rng(seed), stick_slip(seed)
    for samples in recording.samples.T:
        planted = random_indices(rng, samples.size)
        spiky = samples.copy()
        spiky[planted] += height * samples.std() * rng.choice([-1.0, 1.0], planted.size)
        mended, indices = remove_spikes(spiky, fs=recording.fs)
        assert set(indices) <= set(planted)
        # one at a reversal of the friction may be missed
        assert indices.size >= planted.size - 1
        assert np.abs(mended - samples)[indices].max() < 3 * samples.std()


@pytest.mark.parametrize("noise", ["white", "resonance"])
@pytest.mark.parametrize("seed", range(4))
def test_a_spike_that_just_stands_out_is_mended(seed, noise):
    rng = np.random.default_rng(seed)
    samples = rng.standard_normal(20_000) if noise == "white" else resonance(seed)
    departure = np.convolve(samples, [-0.5, 1.0, -0.5], mode="valid")
    planted = random_indices(rng, samples.size)
    spiky = samples.copy()
    # noise takes away four standard deviations of the departure at the most, and the limit has an error of its own
    spiky[planted] += (SPIKES.least_sigma + 5) * departure.std() * rng.choice([-1.0, 1.0], planted.size)
    assert remove_spikes(spiky, fs=512.0)[1].tolist() == planted.tolist()


@pytest.mark.parametrize("order", [None, 2, 4])
@pytest.mark.parametrize("factor", [4, 16])
@pytest.mark.parametrize("seed", range(4))
def test_a_jump_is_no_spike_behind_any_usual_filter(seed, factor, order):
    rng = np.random.default_rng(seed)
    jumps = np.cumsum((rng.random(80_000) < 1e-3) * rng.standard_normal(80_000))
    filtered = jumps if order is None else signal.sosfilt(signal.butter(order, 0.8 / factor, output="sos"), jumps)
    samples = filtered[::factor] + 0.001 * rng.standard_normal(80_000 // factor)
    # two jumps within two samples of a recorder without a filter are a spike to anybody
    assert remove_spikes(samples, fs=512.0)[1].size <= (order is None) * 2


@pytest.mark.parametrize("seed", range(4))
def test_spikes_beside_the_border_of_chunks_are_counted_once(seed):
    rng = np.random.default_rng(seed)
    samples = rng.standard_normal(1_100_000)
    borders = np.array([2**18, 2**19, 2**20])
    planted = np.concatenate([border + 13 * np.arange(-5, 5) + seed for border in borders])
    samples[planted] += 50.0
    assert remove_spikes(samples, fs=512.0)[1].tolist() == planted.tolist()
    (channel,) = inspect(recording_from_arrays([samples], ["a"], fs=512.0)).channels
    assert channel.spikes == planted.size


def struck(width, offset, seed, fs=2048.0):
    """Return force and acceleration of a structure of four modes, struck three times for `width` samples."""
    rng, time_s = np.random.default_rng(seed), np.arange(round(8 * fs)) / fs
    force = np.zeros(time_s.size)
    for at_s in (1.0, 3.0, 5.0):
        part = (time_s - at_s - offset / fs) * fs / width
        force += np.where((part > 0.0) & (part < 1.0), 100.0 * np.sin(np.pi * part), 0.0)
    answer = np.zeros(time_s.size)
    for hz in rng.uniform(50.0, 900.0, 4):
        ring = np.exp(-0.004 * 2 * np.pi * hz * time_s) * np.sin(2 * np.pi * hz * time_s) * hz
        answer += signal.fftconvolve(force, ring)[: time_s.size]
    columns = [each + 1e-3 * each.std() * rng.standard_normal(each.size) for each in (force, answer)]
    return recording_from_arrays(columns, ["force", "a"], fs=fs, unit=["N", "m/s^2"])


@pytest.mark.parametrize(("width", "offset"), [(1.0, 0.5), (1.5, 0.25), (3.0, 0.5), (6.0, 0.1)])
def test_blows_of_a_hammer_are_no_spikes_of_a_cable(width, offset):
    """A structure whose modes ring beside each other may seem to have one: in one record of ten."""
    spikes = []
    for seed in range(20):
        health = inspect(struck(width, offset, seed))
        assert [each.channel for each in health.findings if each.code == "spikes"] in ([], ["a"])
        short = [each.severity for each in health.findings if each.code == "short_blows"]
        assert short == (["note"] if width < 2.0 else [])
        spikes.append(health.channels[1].spikes)
    assert np.count_nonzero(spikes) <= 4


def test_a_spike_beside_blows_and_one_in_a_shaken_force_are_told():
    record = struck(6.0, 0.1, 0)
    samples = record.samples.copy()
    samples[10_000] += 20.0 * samples.std(axis=0)
    health = inspect(replace(record, samples=samples))
    assert [(each.code, each.channel) for each in health.findings if each.code == "spikes"] == [
        ("spikes", "force"),
        ("spikes", "a"),
    ]
    shaken = np.random.default_rng(0).standard_normal(20_000)
    shaken[7000] = 40.0
    (finding,) = inspect(recording_from_arrays([shaken], ["force"], fs=512.0, unit="N")).findings
    assert finding.code == "spikes"


@needs_data("wobble_landcruiser")
@pytest.mark.parametrize(
    ("name", "column", "row"),
    [
        ("20211027T145614", 3, 2912),
        ("20211027T145614", 10, 991),
        ("20211027T145614", 11, 991),
        ("20211027T145614", 12, 991),
        ("20211027T145614", 12, 2424),
        ("20211029T125712", 12, 644),
        ("20211029T125712", 21, 3154),
        ("20211029T125712", 24, 4446),
    ],
)
def test_values_that_a_bus_lost_on_a_real_axle_are_found(name, column, row):
    # single readings of 0 or -1028 (two equal bytes) amid others
    samples = np.loadtxt(DATA / "wobble_landcruiser" / f"{name}_sensors.csv", delimiter=",", usecols=column)
    assert samples[row] in (0.0, -1028.0)
    indices = remove_spikes(samples, fs=117.0)[1]
    assert row in indices
    assert indices.size <= 4
