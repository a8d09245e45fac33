"""Irregular stamps: whether samples were taken at them, and what they are at equal steps."""

import numpy as np
import pytest
from measured_data import DATA, needs_data

from opid.signals.clock import ClockError
from opid.signals.stamps import at_equal_steps

FS, N = 200.0, 8000
TONES = [(1.3, 0.1), (2.9, 1.0), (5.3, 2.0), (9.7, 0.5), (17.0, 3.0), (31.0, 0.7)]
CHANCE = np.random.default_rng(0)
WALK, WHITE = np.cumsum(0.004 * CHANCE.standard_normal(N)), 0.02 * CHANCE.standard_normal(N)


def motion(time_s, noise=0.003):
    values = sum(np.cos(2 * np.pi * f * time_s + p) for f, p in TONES)
    return (values + noise * np.random.default_rng(1).standard_normal(time_s.size))[:, np.newaxis]


@pytest.mark.parametrize("scatter", [WALK, WHITE, np.clip(10 * WHITE, -0.4, 0.4)], ids=["walk", "white", "strong"])
def test_samples_that_were_taken_at_their_stamps_are_resampled(scatter):
    stamps = (np.arange(N) + scatter) / FS
    samples, clock, evidence = at_equal_steps(motion(stamps), stamps)
    assert (evidence.taken, evidence.is_sure, clock.fs) == ("own times", True, FS)
    assert abs(evidence.factor - 1) < 4 * evidence.factor_std
    true = motion(clock.start_s + np.arange(len(samples)) / clock.fs, noise=0.0)
    assert np.std((samples - true)[50:-50]) < 2 * 0.003
    assert "so they were resampled at their own times" in evidence.sentence


@pytest.mark.parametrize("scatter", [WALK, WHITE, np.clip(10 * WHITE, -0.4, 0.4)], ids=["walk", "white", "strong"])
def test_equally_spaced_samples_with_wrong_stamps_stay_as_they_are(scatter):
    given = motion(np.arange(N) / FS)
    samples, clock, evidence = at_equal_steps(given, (np.arange(N) + scatter) / FS)
    assert (evidence.taken, evidence.is_sure) == ("equal steps", True)
    assert abs(evidence.factor) < 4 * evidence.factor_std
    assert samples is given
    assert clock.fs == pytest.approx(FS, rel=1e-4)


def test_samples_without_motion_decide_nothing_and_say_so():
    noise = np.random.default_rng(2).standard_normal((N, 1))
    _, _, evidence = at_equal_steps(noise, (np.arange(N) + WHITE) / FS)
    assert not evidence.is_sure
    assert "which decides nothing" in evidence.sentence


def test_what_is_stated_is_done_and_a_contradiction_is_told():
    given, stamps = motion(np.arange(N) / FS), (np.arange(N) + WHITE) / FS
    _, _, evidence = at_equal_steps(given, stamps, taken="own times")
    assert (evidence.taken, evidence.is_stated, evidence.is_sure) == ("own times", True, False)
    assert "as stated, the rows are resampled at their own times, and the samples show" in evidence.sentence


@pytest.mark.parametrize("scatter", [0 * WHITE, WHITE], ids=["regular", "white"])
def test_one_or_two_lost_rows_are_interpolated(scatter):
    true_s = (np.arange(N) + scatter) / FS
    kept = np.delete(np.arange(N), [1000, 3000, 3001, 6000])
    samples, clock, evidence = at_equal_steps(motion(true_s)[kept], true_s[kept])
    assert evidence.bridged == 4
    assert "4 lost row(s) were interpolated" in evidence.sentence
    true = motion(clock.start_s + np.arange(len(samples)) / clock.fs, noise=0.0)
    assert np.abs(samples - true)[50:-50].max() < 0.1


def test_a_host_that_stalls_loses_no_row():
    stamps = np.arange(N) / FS
    stamps[4000:4006] = stamps[4006]
    _, _, evidence = at_equal_steps(motion(np.arange(N) / FS), stamps)
    assert (evidence.bridged, evidence.taken) == (0, "equal steps")


def test_longer_gaps_and_stamps_that_go_back_are_refused():
    stamps = np.arange(N) / FS
    with pytest.raises(ClockError, match=r"about 3 sample\(s\) lost, and 2 are interpolated at the most"):
        at_equal_steps(motion(stamps[3:]), np.delete(stamps, [500, 501, 502]))
    with pytest.raises(ClockError, match="the time goes back"):
        at_equal_steps(motion(stamps), stamps[::-1])
    kept = np.arange(N) % 20 != 7
    with pytest.raises(ClockError, match="which is more than 2% of all"):
        at_equal_steps(motion(stamps[kept]), stamps[kept])


@needs_data("wobble_landcruiser")
def test_a_host_that_empties_a_buffer_is_found_by_the_samples():
    raw = np.loadtxt(DATA / "wobble_landcruiser" / "20211027T145614_sensors.csv", delimiter=",")
    _, clock, evidence = at_equal_steps(raw[:, [3, 9, 15, 21]], raw[:, 0])
    assert (evidence.taken, evidence.is_sure, evidence.repeats) == ("equal steps", True, True)
    assert abs(evidence.factor) < 0.05
    assert clock.fs == pytest.approx(116.73, abs=0.01)
