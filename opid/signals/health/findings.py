"""What is wrong with a clock or a channel and what to do about it, one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from opid.signals.health.clock import ClockCheck
from opid.signals.health.result import ChannelHealth, ClockHealth, Code, Kind, Severity
from opid.signals.health.settings import HEALTH
from opid.signals.units import STANDARD_GRAVITY

Sentences = Iterator[tuple[Severity, Code, str]]
"""How severe each fault is, its code, and what was found and what to do."""


def clock_sentences(check: ClockCheck, health: ClockHealth) -> Sentences:
    """Yield what is wrong with a clock."""
    of_track = f" of {health.track!r}" if health.track else ""
    if not HEALTH.least_fs_hz <= health.fs <= HEALTH.most_fs_hz:
        cause = (
            "check the stated rate (fs_hz in [log])"
            if health.stated
            else "check their unit (time_unit in [log], --time-unit)"
        )
        source = "is stated" if health.stated else "follows from the time stamps"
        yield "warning", "implausible_rate", f"a rate of {health.fs:.6g} Hz{of_track} {source}: {cause}"
    if check.unreadable:
        yield (
            "fault",
            "unreadable_stamps",
            f"{check.unreadable} time stamp(s){of_track} are no number: mend the log there",
        )
    if check.backward:
        yield (
            "fault",
            "time_goes_back",
            f"the time{of_track} goes back {check.backward} time(s), the first to {check.first_backward_s:.9g} s: "
            "put the samples in order, or split the log there if two were joined",
        )
    yield from _spacing_sentences(check, health, of_track)
    if stalls := check.stalls():
        _, begin, end = max(stalls, key=lambda each: each[2] - each[1])
        yield (
            "note",
            "host_stalls",
            f"the stamps{of_track} stand still {len(stalls)} time(s), the longest for {end - begin:.3g} s "
            f"at {begin:.6g} s, and the rows then catch up: the host stalled, and no sample counts as lost",
        )
    if health.n_gaps:
        gap = health.gaps[0]
        yield (
            "warning",
            "gaps",
            f"the time{of_track} jumps from {gap.start_s:.9g} s to {gap.stop_s:.9g} s where steps of "
            f"{1 / health.fs:.6g} s are usual ({health.n_gaps} gap(s), about {health.n_lost} sample(s) lost): choose a "
            "stretch without gaps (start_s, stop_s); `identify` leaves them out by itself",
        )
    usual = max(0.02, 0.5 * health.resolution_s * health.fs)
    if not (check.is_crowded or check.is_reconstructed or health.n_gaps or check.backward) and health.jitter > usual:
        yield (
            "warning",
            "uneven_steps",
            f"the steps between time stamps{of_track} scatter by {health.jitter:.0%} of the period: if the recorder "
            'samples at equal steps and only stamps late, write `clock = "reconstructed"` in [log]',
        )


def _spacing_sentences(check: ClockCheck, health: ClockHealth, of_track: str) -> Sentences:
    """What is wrong with stamps that repeat, or come in bursts."""
    if check.is_reconstructed and not health.stated:
        yield (
            "note",
            "rows_equally_spaced",
            f"the rows{of_track} are assumed to be equally spaced at {health.fs:.6g} Hz, the stamps lie up to "
            f"{check.stray_s:.2g} s off: nothing to do unless samples were lost",
        )
    elif health.repeated == health.n_samples - 1 and health.n_samples > 1:
        yield (
            "fault",
            "no_clock",
            f"all {health.n_samples} time stamps{of_track} are {health.start_s:.9g} s, which is no clock: state the "
            "rate (fs_hz in [log])",
        )
    elif check.is_crowded:
        rows = health.n_samples / (health.n_samples - health.repeated)
        yield (
            "fault",
            "shared_stamps",
            f"about {rows:.1f} rows{of_track} share a time stamp, as if a host empties a buffer or rounds its stamps: "
            f'write `clock = "reconstructed"` in [log], which assumes equally spaced rows at {health.fs:.6g} Hz',
        )
    elif check.repeated:
        yield (
            "fault",
            "repeated_stamps",
            f"{check.repeated} time stamp(s){of_track} stand twice in a row, the first at "
            f"{check.first_repeated_s:.9g} s: remove the repeated samples, write the time with more digits, or write "
            '`clock = "reconstructed"` in [log] if the rows are equally spaced',
        )


def channel_sentences(
    channel: ChannelHealth, *, clipped_at: Sequence[float], held_s: float, held_from_s: float, drift_part_s: float
) -> Sentences:
    """Yield what is wrong with a channel.

    Args:
        channel: its figures.
        clipped_at: the extreme values that are held.
        held_s: longest time for which one value is held beside motion, s; 0 where none is.
        held_from_s: when that begins, s.
        drift_part_s: length of the parts whose means show the drift, s.
    """
    if channel.missing and np.isnan(channel.mean):
        yield "fault", "no_values", "holds no value at all: leave the channel out, or export the log again"
        return
    if channel.missing:
        yield (
            "warning",
            "missing_values",
            f"{channel.missing} value(s) are missing, the first at {_first_s(channel, 'missing'):.4f} s: choose a "
            "stretch without them (start_s, stop_s); `identify` leaves them out by itself",
        )
    if channel.mute:
        yield from _mute_sentences(channel)
        return
    if channel.clipped_fraction > 0:
        ends = " or ".join(f"{value:.5g}" for value in sorted(clipped_at))
        yield (
            "warning",
            "clipped",
            f"{channel.clipped_fraction:.2%} of the samples are clipped at {_with_unit(ends, channel.unit)}, the "
            f"first at {_first_s(channel, 'clipped'):.3f} s: measure again with a larger range",
        )
    elif held_s:
        yield (
            "warning",
            "held_value",
            f"one value is held for {held_s:.3g} s from {held_from_s:.3f} s: leave this dropout out "
            "with start_s and stop_s",
        )
    if channel.spikes:
        yield (
            "warning",
            "spikes",
            f"{channel.spikes} spike(s) of one sample, the first at {_first_s(channel, 'spike'):.4f} s: check the "
            "cable, or leave them out with start_s and stop_s",
        )
    step = channel.quantisation_step
    if step is not None and channel.rms < HEALTH.coarse_steps * step:
        yield (
            "warning",
            "coarse_resolution",
            f"the rms is only {channel.rms / step:.1f} steps of the resolution "
            f"({_with_unit(f'{step:.3g}', channel.unit)}): measure with a smaller range or more bits",
        )
    yield from _supply_sentences(channel)
    if channel.unit == "m/s^2":
        yield from _offset_sentences(channel, drift_part_s)


def _mute_sentences(channel: ChannelHealth) -> Sentences:
    mean = _with_unit(f"{channel.mean:.4g}", channel.unit)
    # A thermometer may well rest and a switch has two states, but an accelerometer in operation moves.
    if channel.unit not in ("m/s^2", "?"):
        if channel.rms == 0:
            yield "note", "constant", f"all samples lie at {mean}"
    elif channel.rms == 0:
        yield "fault", "mute", f"mute, all samples lie at {mean}: check the sensor and its cable"
    else:
        yield (
            "fault",
            "few_values",
            f"mute, it has only two or three values about {mean}: check the sensor, its cable and its range",
        )


def _offset_sentences(channel: ChannelHealth, drift_part_s: float) -> Sentences:
    mean = channel.mean
    if abs(abs(mean) / STANDARD_GRAVITY - 1) < HEALTH.gravity_tolerance:
        yield "note", "gravity", f"the mean, {mean:.3f} m/s^2, is gravity: nothing to do, `identify` takes it off"
    elif abs(abs(mean) - 1) < HEALTH.gravity_tolerance:
        yield "note", "gravity_in_g", f"the mean, {mean:.3f} m/s^2, would be gravity in g: check the unit"
    elif abs(mean) > HEALTH.most_gravities * STANDARD_GRAVITY:
        yield (
            "warning",
            "false_offset",
            f"the mean, {mean:.4g} m/s^2, is more than gravity makes: a false offset or a wrong unit; check the "
            "sensor's zero and range, and give `offset` in its table of [channels]",
        )
    elif abs(mean) > HEALTH.offset_rms * channel.rms:
        yield (
            "note",
            "large_offset",
            f"the offset, {mean:.3g} m/s^2, is large beside the rms, {channel.rms:.3g} m/s^2: nothing to do, "
            "`identify` takes it off",
        )
    if channel.drift > HEALTH.drift_rms * channel.rms:
        yield (
            "note",
            "drift",
            f"the offset drifts by {channel.drift:.3g} m/s^2 (means of {drift_part_s:.3g} s), as the sensor "
            "warms up, or the vehicle tilts or brakes: nothing to do, the high-pass of `identify` takes it off",
        )


def _supply_sentences(channel: ChannelHealth) -> Sentences:
    named = [line for line in channel.lines if line.name]
    hum = float(np.sqrt(sum(line.rms**2 for line in named)))
    if hum < 0.2 * HEALTH.hum_rms * channel.rms:
        return
    severity: Severity = "warning" if hum > HEALTH.hum_rms * channel.rms else "note"
    lines = ", ".join(f"{line.frequency_hz:.4g} Hz: {line.name}" for line in named[:3])
    lines += " and more" if len(named) > 3 else ""
    yield (
        severity,
        "supply_lines",
        f"{_with_unit(f'{hum:.2g}', channel.unit)} rms of the electric supply ({lines}): earth the shield at one end, "
        "keep the cable away from power lines, and choose a band without these lines",
    )


def _with_unit(value: str, unit: str) -> str:
    return value if unit == "?" else f"{value} {unit}"


def _first_s(channel: ChannelHealth, kind: Kind) -> float:
    return next((stretch.start_s for stretch in channel.stretches if stretch.kind == kind), np.nan)
