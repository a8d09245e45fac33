"""A log is read once in blocks: what is found does not depend on them, and is what whole arrays give."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from made_logs import log_of, messages, noise, track_of

from opid.errors import InputError
from opid.signals.health.channel import MomentCheck
from opid.signals.health.chunks import CHUNK_VALUES, RowStretches, Thinning, rows_of_a_bin
from opid.signals.health.inspection import inspect
from opid.signals.health.spikes import remove_spikes
from opid.signals.log import ChannelSettings, LogSettings
from opid.signals.recording import recording_from_arrays
from opid.signals.segments import taxi_segment

FS = 500.0
N = 1_200_000


def faulty():
    """Return 40 min of two channels with every fault at a known place, in several chunks."""
    samples = noise(N, 2) * np.array([1.0, 0.3])
    samples[:, 0] = np.round(samples[:, 0] / 0.01) * 0.01
    samples[300_000, 0] += 60.0
    samples[700_000:700_400, 0] = samples[700_000, 0]
    samples[100_000:100_010, 1] = np.nan
    samples[900_000:900_500, 1] = 4.0
    samples[262_140:262_150, 1] = np.nan
    return samples


FAULTY = faulty()


def same(one, other):
    """Compare records field by field, figures up to rounding."""
    if dataclasses.is_dataclass(one):
        return all(same(getattr(one, f.name), getattr(other, f.name)) for f in dataclasses.fields(one))
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, (float, np.ndarray)):
        return np.allclose(one, other, rtol=1e-9, atol=1e-12, equal_nan=True)
    return one == other


@pytest.fixture(scope="module")
def whole():
    return inspect(log_of(FAULTY, fs=FS))


@pytest.mark.parametrize("rows", [1000, 77_777])
def test_the_blocks_make_no_difference(whole, rows):
    assert same(whole, inspect(log_of(FAULTY, fs=FS, rows=rows)))


def test_the_blocks_of_stamps_make_no_difference():
    samples = noise(60_000, 2)
    stamps = np.round(np.arange(60_000) / FS, 4)
    stamps[30_000:] += 7.0
    first, other = (inspect(log_of(samples, stamps=stamps, rows=rows)) for rows in (1000, 100_000))
    assert same(first, other)


def test_faults_planted_in_a_long_log_are_found_where_they_are(whole):
    one, other = whole.channels
    assert [(s.kind, s.start_s) for s in one.stretches] == [("flat", 1400.0), ("spike", 600.0)]
    assert one.longest_flat_s == pytest.approx(399 / FS)
    assert one.quantisation_step == pytest.approx(0.01)
    assert [(s.kind, s.start_s, s.stop_s) for s in other.stretches] == [
        ("missing", 200.0, 200.02),
        ("missing", 524.28, 524.3),
        ("clipped", 1800.0, 1801.0),
        ("flat", 1800.0, 1801.0),
    ]
    assert other.missing == 20
    assert other.clipped_fraction == pytest.approx(500 / (N - 20))
    text = " / ".join(messages(whole))
    assert "1 spike(s) of one sample, the first at 600.0000 s: check the cable" in text
    assert "20 value(s) are missing, the first at 200.0000 s: choose a stretch without them (start_s" in text
    assert "clipped at 4 m/s^2, the first at 1800.000 s: measure again with a larger range" in text
    assert "one value is held for 0.798 s from 1400.000 s" in text


def test_levels_and_soundness_second_by_second(whole):
    (levels,) = whole.rms_history
    bin_rows = rows_of_a_bin(FS)
    assert levels.length_s == bin_rows / FS
    np.testing.assert_allclose(levels.start_s, np.arange(-(-N // bin_rows)) * bin_rows / FS)
    k = 700
    inside = slice(k * bin_rows, (k + 1) * bin_rows)
    np.testing.assert_allclose(levels.rms[k], FAULTY[inside].std(axis=0))
    bad = [{int(row) // bin_rows for row in rows} for rows in ((700_000, 700_399), (100_000, 262_140, 262_149))]
    bad[1] |= set(range(900_000 // bin_rows, 900_499 // bin_rows + 1))
    for i in range(2):
        assert set(np.flatnonzero(~levels.sound[:, i])) == bad[i]
    assert set(np.flatnonzero(~levels.complete[:, 1])) == {195, 511, 512}
    assert np.isnan(levels.rms[100_000 // bin_rows, 1])


def test_the_picture_has_bounded_size_and_true_extremes(whole):
    picture = whole.channels[0].overview
    assert 1000 <= picture.time_s.size <= 2000
    assert np.nanmax(picture.highest) == np.nanmax(FAULTY[:, 0])
    assert picture.time_s[np.nanargmax(picture.highest)] == pytest.approx(600.0, abs=2.0)
    assert picture.spectrogram.shape == (picture.spectrogram_s.size, picture.spectrogram_hz.size)
    assert 150 <= picture.spectrogram_s.size <= 300
    # white noise of rms 1 has a density of 2/fs at all times
    assert np.nanmean(picture.spectrogram) == pytest.approx(2 / FS, rel=0.05)
    assert inspect(log_of(FAULTY[:5000], fs=FS), thorough=False).channels[0].overview is None


@settings(max_examples=25)
@given(st.integers(2, 4000), st.integers(0, 10_000), st.sampled_from([0.5, 30.0, 117.3, 512.0]), st.integers(0, 2))
def test_figures_are_those_of_whole_arrays(n, seed, fs, gone):
    samples = noise(n, 1, seed)[:, 0] * 3 + 5
    samples[np.random.default_rng(seed).integers(0, n, gone)] = np.nan
    samples[0] = 1.0
    channel = inspect(log_of(samples[:, None], fs=fs, rows=97)).channels[0]
    there = samples[np.isfinite(samples)]
    assert channel.missing == n - there.size
    assert channel.mean == pytest.approx(there.mean())
    assert channel.rms == pytest.approx(there.std(), abs=1e-9)
    assert channel.peak == pytest.approx(np.abs(there - there.mean()).max())
    if not gone and fs == 512.0:
        assert channel.spikes == (0 if n < rows_of_a_bin(fs) + 4 else remove_spikes(samples, fs=fs)[1].size)


def test_a_higher_extreme_later_undoes_the_clipping_seen_before():
    samples = noise(40_000)
    samples[1000:1010] = 8.0
    assert "clipped at 8 m/s^2" in messages(inspect(log_of(samples, fs=FS)))[0]
    samples[39_000] = 9.0
    health = inspect(log_of(samples, fs=FS))
    assert health.channels[0].clipped_fraction == 0.0
    assert health.rms_history[0].sound.all()


def test_a_run_over_the_border_of_chunks_is_one():
    rows = CHUNK_VALUES // rows_of_a_bin(FS) * rows_of_a_bin(FS)
    samples = noise(rows + 100_000)
    border = 2 ** int(np.log2(CHUNK_VALUES / rows_of_a_bin(FS))) * rows_of_a_bin(FS)
    samples[border - 200 : border + 300] = 6.0
    (clipped, flat) = inspect(log_of(samples, fs=FS)).channels[0].stretches
    assert (clipped.kind, flat.kind) == ("clipped", "flat")
    assert clipped.start_s == flat.start_s == pytest.approx((border - 200) / FS)
    assert clipped.stop_s == flat.stop_s == pytest.approx((border + 300) / FS)
    samples[border - 1] += 50.0
    samples[border + 30_000] += 50.0
    spikes = [s.start_s for s in inspect(log_of(samples, fs=FS)).channels[0].stretches if s.kind == "spike"]
    assert spikes == pytest.approx([(border + 30_000) / FS])


def test_units_are_converted_or_told():
    samples = np.round(noise(5000, 3) * 100)
    track = track_of(samples, fs=FS, unit=None)
    channels = {
        "up": ChannelSettings("c0", unit="g", scale=0.01, offset=0.5, sign=-1),
        "raw": ChannelSettings("c1", scale=0.01),
        "also": ChannelSettings(3),
    }
    health = inspect(log_of(track), channels=channels)
    assert [channel.unit for channel in health.channels] == ["m/s^2", "?", "?"]
    assert health.channels[0].mean == pytest.approx(-9.80665 * (0.01 * samples[:, 0].mean() + 0.5))
    assert health.channels[1].rms == pytest.approx(0.01 * samples[:, 1].std())
    assert any(m.startswith("2 channels state no unit ('raw', 'also')") and "[log]" in m for m in messages(health))
    assert inspect(log_of(track), LogSettings(unit="g"), channels=["c2"]).channels[0].unit == "m/s^2"
    odd = inspect(log_of(track), channels={"x": ChannelSettings("c0")})
    assert "give `unit` in its table of [channels]" in messages(odd)[0]
    unknown = inspect(log_of(samples, fs=FS, unit="furlong"))
    assert "'furlong' is not known" in messages(unknown)[0]


def test_several_clocks_and_progress():
    slow = track_of(noise(2000, 1), fs=100.0, names=["a"], name="dc")
    fast = track_of(noise(9000, 2, seed=1), fs=FS, names=["a", "b"], name="piezo", rows=1000)
    told = []
    health = inspect(log_of(slow, fast), progress=told.append)
    assert [channel.name for channel in health.channels] == ["dc/a", "piezo/a", "b"]
    assert [clock.fs for clock in health.clocks] == [100.0, FS]
    assert health.fs == FS
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_what_holds_nothing_is_told():
    with pytest.raises(InputError, match="holds no samples"):
        inspect(log_of(np.empty((0, 1)), fs=FS))
    with pytest.raises(InputError, match="neither a rate nor time stamps: give fs_hz"):
        inspect(log_of(noise(10)))
    health = inspect(log_of(np.full((5000, 1), np.nan), fs=FS))
    assert health.findings[0].severity == "fault"
    assert "holds no value at all" in messages(health)[0]


def test_a_log_that_ends_with_a_full_chunk_or_one_row_more():
    rows = 2 ** int(np.log2(CHUNK_VALUES / rows_of_a_bin(FS))) * rows_of_a_bin(FS)
    for n in (rows, rows + 1):
        samples = noise(n)
        (channel,) = inspect(log_of(samples, fs=FS)).channels
        assert channel.rms == pytest.approx(samples.std())
        assert channel.missing == 0


def test_series_are_joined_by_powers_of_two():
    values = np.random.default_rng(0).standard_normal(1000)
    series = Thinning({"sum": np.add, "lowest": np.fmin}, most=60)
    for part in np.array_split(values, 37):
        series.add({"sum": part.copy(), "lowest": part.copy()})
    items = series.items()
    assert series.n_halvings == 5
    np.testing.assert_allclose(items["sum"], np.add.reduceat(values, np.arange(0, 1000, 32)))
    np.testing.assert_array_equal(items["lowest"], np.minimum.reduceat(values, np.arange(0, 1000, 32)))


def test_stretches_close_together_become_one_when_there_are_too_many():
    kept = RowStretches(most=10, coarse=5)
    starts = np.arange(100) * 4
    kept.add(starts, starts + 1)
    kept.add(np.array([1000]), np.array([1010]))
    assert kept.rows().tolist() == [[0, 397], [1000, 1010]]


def test_the_levels_are_those_of_pairs_of_seconds_where_a_log_is_very_long(monkeypatch):
    monkeypatch.setattr("opid.signals.health.channel.MOST_BINS", 100)
    assert MomentCheck(1, envelope=False)._bins._most == 100
    samples = noise(150 * 512) + np.repeat(np.arange(150), 512)[:, None]
    (levels,) = inspect(log_of(samples, fs=512.0)).rms_history
    assert levels.length_s == 2.0
    np.testing.assert_allclose(levels.rms[:, 0], samples.reshape(75, 1024).std(axis=1))


def test_a_recording_is_inspected_as_its_log_is():
    samples = noise(20_000, 2)
    run = recording_from_arrays(list(samples.T), ["c0", "c1"], fs=FS)
    assert same(inspect(run), dataclasses.replace(inspect(log_of(samples, fs=FS)), log=""))


@settings(max_examples=30)
@given(st.data())
def test_whatever_a_log_holds_is_told_and_never_a_crash(data):
    seed = data.draw(st.integers(0, 10_000))
    rng = np.random.default_rng(seed)
    n = data.draw(st.sampled_from([1, 2, 3, 64, 129, 3000]))
    samples = noise(n, 2, seed)
    for value in data.draw(st.lists(st.sampled_from([np.nan, np.inf, 1e300, -1e150, 0.0, 1e-300]), max_size=3)):
        first, last = np.sort(rng.integers(0, n + 1, 2))
        samples[first:last, rng.integers(0, 2)] = value
    fs = data.draw(st.sampled_from([1e-3, 10.0, 512.0, 1e7]))
    stamps = rng.choice([0.0, 1.7e9, -5.0]) + np.arange(n) / fs
    for fault in data.draw(st.lists(st.sampled_from(["nan", "jump", "held", "coarse", "mixed", "inf"]), max_size=3)):
        first, last = np.sort(rng.integers(0, n, 2))
        if fault in ("nan", "inf", "held"):
            stamps[first:last] = {"nan": np.nan, "inf": np.inf, "held": stamps[first]}[fault]
        elif fault == "jump":
            stamps[first:] += rng.choice([1.0, -1.0, 1e5])
        else:
            stamps = np.round(stamps, 1) if fault == "coarse" else rng.permutation(stamps)
    rebuilt = LogSettings(clock=data.draw(st.sampled_from(["stamps", "reconstructed"])))
    health = inspect(log_of(samples, stamps=stamps, rows=97), rebuilt)
    assert health.n_samples == n
    assert all(finding.message for finding in health.findings)
    segment = taxi_segment(health, ("c0", "c1"))
    assert segment.start_s is None or np.isfinite(segment.start_s)
    assert sum(each.missing for each in health.channels) == (~(np.abs(samples) < 1e60)).sum()
