"""What is wrong with a channel and what to do about it, one plain sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from opid.signals.health.result import ChannelHealth, Finding, Kind, Severity, SpectralLine
from opid.signals.health.settings import HEALTH
from opid.signals.units import STANDARD_GRAVITY


@dataclass(frozen=True)
class NoUnit:
    """Why no unit of a channel is known.

    Args:
        is_stated: whether one is stated, which nobody knows.
        reason: the whole of it as a sentence.
    """

    is_stated: bool
    reason: str


@dataclass(frozen=True)
class ChannelDetails:
    """Where and at what value something is wrong with a channel.

    Args:
        clipped_at: the extreme values that are held.
        held_s: length of the longest held value beside motion, s, or 0.
        held_from_s: its time, s.
        drift_part_s: length of the stretches whose means the drift is taken of, s.
        without_unit: why no unit is known; None where one is.
    """

    clipped_at: tuple[float, ...] = ()
    held_s: float = 0.0
    held_from_s: float = np.nan
    drift_part_s: float = 0.0
    without_unit: NoUnit | None = None


def _with_unit(value: str, unit: str) -> str:
    return value if unit == "?" else f"{value} {unit}"


def _first_s(channel: ChannelHealth, kind: Kind) -> float:
    return next((stretch.start_s for stretch in channel.stretches if stretch.kind == kind), np.nan)


def channel_findings(channel: ChannelHealth, details: ChannelDetails) -> Iterator[Finding]:
    """Yield what is wrong with a channel."""
    for severity, message in _sentences(channel, details):
        yield Finding(severity, channel.name, message)


def unit_findings(without_unit: Mapping[str, NoUnit]) -> Iterator[Finding]:
    """Yield what to do about channels without a unit, in one sentence where it is the same for several."""
    silent = [name for name, why in without_unit.items() if not why.is_stated]
    if len(silent) > 1:
        names = ", ".join(map(repr, silent[:4])) + (f" and {len(silent) - 4} more" if len(silent) > 4 else "")
        yield Finding(
            "warning",
            "",
            f"{len(silent)} channels state no unit ({names}), they are inspected as written: give `unit` in their "
            "tables of [channels], or in [log] for all",
        )
    for name, why in without_unit.items():
        if len(silent) < 2 or name not in silent:
            yield Finding("warning", name, f"{why.reason}; it is inspected as written")


def _mute(channel: ChannelHealth) -> Iterator[tuple[Severity, str]]:
    mean = _with_unit(f"{channel.mean:.4g}", channel.unit)
    # a thermometer may well rest, a switch has two states; an accelerometer in operation has neither
    if channel.unit not in ("m/s^2", "?"):
        if channel.rms == 0:
            yield "note", f"all samples lie at {mean}"
    elif channel.rms == 0:
        yield "fault", f"mute, all samples lie at {mean}: check the sensor and its cable"
    else:
        yield "fault", f"mute, it has but two or three values about {mean}: check the sensor, its cable and its range"


def _sentences(channel: ChannelHealth, details: ChannelDetails) -> Iterator[tuple[Severity, str]]:
    if channel.missing and np.isnan(channel.mean):
        yield "fault", "holds no value at all: leave the channel out, or export the log again"
        return
    if channel.missing:
        yield (
            "warning",
            f"{channel.missing} value(s) are missing, the first at {_first_s(channel, 'missing'):.4f} s: choose a "
            "stretch without them (start_s, stop_s); `identify` leaves them out by itself",
        )
    if channel.mute:
        yield from _mute(channel)
        return
    if channel.clipped_fraction > 0:
        ends = " or ".join(f"{value:.5g}" for value in sorted(details.clipped_at))
        yield (
            "warning",
            f"{channel.clipped_fraction:.2%} of the samples are clipped at {_with_unit(ends, channel.unit)}, the "
            f"first at {_first_s(channel, 'clipped'):.3f} s: measure again with a larger range",
        )
    elif details.held_s:
        yield (
            "warning",
            f"one value is held for {details.held_s:.3g} s from {details.held_from_s:.3f} s: leave this dropout out "
            "with start_s and stop_s",
        )
    if channel.spikes:
        yield (
            "warning",
            f"{channel.spikes} spike(s) of one sample, the first at {_first_s(channel, 'spike'):.4f} s: check the "
            "cable, or leave them out with start_s and stop_s",
        )
    step = channel.quantisation_step
    if step is not None and channel.rms < HEALTH.coarse_steps * step:
        yield (
            "warning",
            f"the rms is only {channel.rms / step:.1f} steps of the resolution "
            f"({_with_unit(f'{step:.3g}', channel.unit)}): measure with a smaller range or more bits",
        )
    yield from _of_supply(channel)
    if channel.unit == "m/s^2":
        yield from _of_offset(channel, details)


def _of_offset(channel: ChannelHealth, details: ChannelDetails) -> Iterator[tuple[Severity, str]]:
    mean = channel.mean
    if abs(abs(mean) / STANDARD_GRAVITY - 1) < HEALTH.gravity_tolerance:
        yield "note", f"the mean, {mean:.3f} m/s^2, is gravity: nothing to do, `identify` takes it off"
    elif abs(abs(mean) - 1) < HEALTH.gravity_tolerance:
        yield "note", f"the mean, {mean:.3f} m/s^2, would be gravity in g: check the unit"
    elif abs(mean) > HEALTH.most_gravities * STANDARD_GRAVITY:
        yield (
            "warning",
            f"the mean, {mean:.4g} m/s^2, is more than gravity makes: a false offset or a wrong unit; check the "
            "sensor's zero and range, and give `offset` in its table of [channels]",
        )
    elif abs(mean) > HEALTH.offset_rms * channel.rms:
        yield (
            "note",
            f"the offset, {mean:.3g} m/s^2, is large beside the rms, {channel.rms:.3g} m/s^2: nothing to do, "
            "`identify` takes it off",
        )
    if channel.drift > HEALTH.drift_rms * channel.rms:
        yield (
            "note",
            f"the offset drifts by {channel.drift:.3g} m/s^2 (means of {details.drift_part_s:.3g} s), as the sensor "
            "warms up, or the vehicle tilts or brakes: nothing to do, the high-pass of `identify` takes it off",
        )


def _of_supply(channel: ChannelHealth) -> Iterator[tuple[Severity, str]]:
    named = [line for line in channel.lines if line.name]
    hum = float(np.sqrt(sum(line.rms**2 for line in named)))
    if hum < 0.2 * HEALTH.hum_rms * channel.rms:
        return
    severity: Severity = "warning" if hum > HEALTH.hum_rms * channel.rms else "note"
    lines = ", ".join(_line(line) for line in named[:3]) + (" and more" if len(named) > 3 else "")
    yield (
        severity,
        f"{_with_unit(f'{hum:.2g}', channel.unit)} rms of the electric supply ({lines}): earth the shield at one end, "
        "keep the cable away from power lines, and choose a band without these lines",
    )


def _line(line: SpectralLine) -> str:
    return f"{line.frequency_hz:.4g} Hz: {line.name}"
