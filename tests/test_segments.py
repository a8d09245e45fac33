"""The stretch to identify from: all of a tidy log, and no more of another than is sound and in motion."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from made_logs import log_of, noise, track_of

from opid.errors import InputError
from opid.signals.health.inspection import inspect
from opid.signals.segments import SEGMENTS, LeftOut, Segment, sound_segments, taxi_segment

FS = 64.0  # a bin is a second
NAMES = ("c0", "c1")


def health_of(level, *, fault=None, seed=0):
    """Return the health of two channels whose motion has a level a second."""
    samples = noise(len(level) * 64, 2, seed) * np.repeat(level, 64)[:, None]
    samples += 1e-3 * noise(len(level) * 64, 2, seed + 1)
    if fault is not None:
        fault(samples)
    return inspect(log_of(samples, fs=FS), thorough=False)


def chosen(level, **more):
    segment = taxi_segment(health_of(np.asarray(level, dtype=float), **more), NAMES)
    return segment.start_s, segment.stop_s


def nan_at(*seconds):
    def fault(samples):
        samples[[int(64 * s) for s in seconds], 0] = np.nan

    return fault


@settings(max_examples=25)
@given(st.integers(2, 250), st.floats(0.25, 4.0), st.integers(0, 1000))
def test_a_tidy_log_in_motion_is_taken_whole(n, end, seed):
    health = health_of(np.geomspace(1.0, end, n), seed=seed)
    assert taxi_segment(health, NAMES) == Segment(None, None, "", ())


def test_a_run_that_brakes_to_a_tenth_is_taken_whole():
    assert chosen(np.linspace(1.0, 0.1, 40)) == (None, None)


def test_a_vehicle_that_rolls_slowly_to_its_end_moves_and_one_that_idles_stands():
    rough = 0.05 * np.exp(0.8 * np.random.default_rng(0).standard_normal(20)).clip(0.4, 1.9)
    assert chosen(np.concatenate([np.ones(60), rough])) == (None, None)
    assert chosen(np.concatenate([np.ones(60), np.full(20, 0.05)])) == (None, 60.0)


def test_a_log_of_few_samples_is_taken_whole():
    health = inspect(log_of(noise(3, 2), fs=FS), thorough=False)
    assert taxi_segment(health, NAMES) == Segment(None, None, "", ())


def test_standstill_at_either_end_and_between_is_cut():
    level = [0.0] * 20 + [1.0] * 60 + [0.01] * 30 + [1.0] * 40 + [0.0] * 10
    segment = taxi_segment(health_of(np.array(level)), NAMES)
    assert (segment.start_s, segment.stop_s) == (20.0, 80.0)
    assert segment.left_out == (
        LeftOut("standstill", 0.0, 20.0),
        LeftOut("standstill", 80.0, 110.0),
        LeftOut("not chosen", 110.0, 150.0),
        LeftOut("standstill", 150.0, 160.0),
    )
    assert segment.reason == (
        "20 s to 80 s is the longest stretch in motion; left out: 60 s of standstill, 40 s of other motion"
    )


@pytest.mark.parametrize("still", [0.0, 0.01, 0.05])
@pytest.mark.parametrize(("length", "start"), [(36, 11), (25, 12), (20, 9)])
@pytest.mark.parametrize("level", [lambda u: 1 - 0.9 * u, lambda u: 0.1 + 0.9 * u, lambda u: 0.1 + np.sin(np.pi * u)])
def test_standstill_is_cut_from_short_logs_and_the_slow_part_of_a_run_is_not(length, start, still, level):
    motion = level(np.linspace(0, 1, length - start))
    begin, end = chosen(np.concatenate([np.full(start, still), motion]))
    assert start <= begin <= start + 1
    assert end is None


def test_a_moment_of_quiet_is_no_standstill():
    assert chosen([1.0] * 30 + [0.01] * 4 + [1.0] * 30) == (None, None)


def test_a_short_taxi_in_a_long_wait_is_found():
    assert chosen([0.0] * 500 + [1.0] * 40 + [0.0] * 500) == (500.0, 540.0)


def test_an_open_end_stays_open():
    assert chosen([0.0] * 20 + [1.0] * 60) == (20.0, None)
    assert chosen([1.0] * 60 + [0.0] * 20) == (None, 60.0)


def test_the_more_energetic_of_two_of_nearly_one_length():
    assert chosen([0.5] * 50 + [0.0] * 20 + [1.0] * 45) == (70.0, None)
    assert chosen([0.5] * 80 + [0.0] * 20 + [1.0] * 45) == (None, 80.0)


def test_faults_cut():
    segment = taxi_segment(health_of(np.ones(100), fault=nan_at(30.5, 31.2)), NAMES)
    assert (segment.start_s, segment.stop_s) == (32.0, None)
    assert segment.left_out == (LeftOut("not chosen", 0.0, 30.0), LeftOut("faulty", 30.0, 32.0))
    assert "2 s at fault" in segment.reason


def test_single_spikes_do_not_cut_and_clipped_stretches_do():
    def spikes(samples):
        samples[[64 * 20, 64 * 50], 1] += 80.0

    def clip(samples):
        samples[64 * 40 : 64 * 44, 1] = np.clip(samples[64 * 40 : 64 * 44, 1] * 50, -30, 30)

    def storm(samples):
        samples[64 * 40 : 64 * 42 : 8, 1] += 80.0

    assert chosen(np.ones(90), fault=spikes) == (None, None)
    assert chosen(np.ones(90), fault=clip) == (44.0, None)
    assert chosen(np.ones(90), fault=storm) == (42.0, None)


def test_a_log_that_is_clipped_all_along_is_taken_where_it_can_be_read():
    def clip(samples):
        np.clip(samples, -0.2, 0.2, out=samples)
        samples[64 * 30, 0] = np.nan

    segment = taxi_segment(health_of(np.ones(90), fault=clip), NAMES)
    assert (segment.start_s, segment.stop_s) == (31.0, None)
    assert "1 s incomplete" in segment.reason


def test_a_log_with_no_stretch_that_can_be_read_is_taken_whole_and_told():
    segment = taxi_segment(health_of(np.ones(60), fault=nan_at(*np.arange(3, 60, 5))), NAMES)
    assert (segment.start_s, segment.stop_s) == (None, None)
    assert f"no stretch of {SEGMENTS.least_s:g} s is sound" in segment.reason


def test_of_a_long_motion_the_steadiest_part_is_taken():
    rng = np.random.default_rng(0)
    level = np.concatenate([np.exp(0.5 * rng.standard_normal(400)), np.ones(400), np.exp(rng.standard_normal(200))])
    segment = taxi_segment(health_of(level), NAMES)
    assert segment.stop_s - segment.start_s == SEGMENTS.most_s
    assert segment.start_s >= 395
    assert segment.stop_s <= 805
    assert "the 300 s with the steadiest motion" in segment.reason


@settings(max_examples=30)
@given(
    st.lists(st.tuples(st.sampled_from(["move", "stand", "nan", "clip"]), st.integers(1, 60)), min_size=1, max_size=8)
)
def test_what_is_chosen_holds_no_fault_and_the_rest_is_accounted_for(parts):
    kinds = np.concatenate([[kind] * length for kind, length in parts])
    n = kinds.size

    def fault(samples):
        by_second = samples.reshape(n, 64, 2)
        by_second[kinds == "nan", 10, 0] = np.nan
        by_second[kinds == "clip", 20:30, 1] = 9.0

    health = health_of(np.where(kinds == "stand", 0.0, 1.0), fault=fault)
    segment = taxi_segment(health, NAMES)
    first = 0 if segment.start_s is None else int(segment.start_s)
    stop = n if segment.stop_s is None else int(segment.stop_s)
    assert stop - first <= SEGMENTS.most_s
    if "no stretch" not in segment.reason:
        assert not (kinds[first:stop] == "nan").any()
        rest = sum(part.stop_s - part.start_s for part in segment.left_out)
        assert rest + stop - first == pytest.approx(n)
        whole = (segment.start_s, segment.stop_s) == (None, None)
        assert whole == (not segment.left_out)
    for own in sound_segments(health, NAMES, least_s=3.0):
        a = 0 if own.start_s is None else int(own.start_s)
        b = n if own.stop_s is None else int(own.stop_s)
        assert b - a >= 3
        assert not np.isin(kinds[a:b], ["nan", "clip"]).any()


def test_sound_segments_leave_out_gaps():
    stamps = np.arange(64 * 60) / FS
    stamps[64 * 25 + 10 :] += 100.0
    health = inspect(log_of(noise(64 * 60, 2), stamps=stamps), thorough=False)
    first, second = sound_segments(health, NAMES)
    assert (first.start_s, first.stop_s) == (None, 25.0)
    assert (second.start_s, second.stop_s) == (126.0, None)
    assert taxi_segment(health, NAMES).start_s == 126.0
    with pytest.raises(InputError, match="'c2' was not inspected"):
        sound_segments(health, ["c2"])


def test_only_the_channels_named_count():
    health = health_of(np.ones(60), fault=nan_at(20.5))
    assert sound_segments(health, ["c1"]) == (Segment(None, None, "nothing is wrong with it"),)
    assert len(sound_segments(health, ["c0"])) == 2


def test_channels_of_two_clocks_are_sound_where_both_are():
    slow, fast = noise(64 * 60), noise(640 * 60, seed=1)
    slow[64 * 15, 0] = np.nan
    fast[640 * 40 + 5, 0] = np.nan
    tracks = track_of(slow, fs=64.0, names=["a"], name="dc"), track_of(fast, fs=640.0, names=["b"], name="piezo")
    health = inspect(log_of(*tracks), thorough=False)
    found = sound_segments(health, ["a", "b"], least_s=5.0)
    assert [(s.start_s, s.stop_s) for s in found] == [(None, 15.0), (16.0, 40.0), (41.0, None)]
    assert taxi_segment(health, ["a", "b"]).start_s in (16.0, 41.0)
