"""The channels of a run -> accelerations, where its sensors read velocities, displacements or travels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from opid.errors import InputError
from opid.signals.clock_matching import ClockMatch
from opid.signals.quantities import (
    DEFAULTS,
    Quantity,
    accelerate,
    acceleration_below,
    check_travel,
    differentiated_noise,
    highest_useful_hz,
    quantity_of,
)
from opid.signals.recording import Channel, Recording
from opid.studies.schema import prefix_errors
from opid.suspensions.study import Run

MOTIONS: dict[Quantity, int] = {"acceleration": 0, "velocity": 1, "displacement": 2}
"""How often a channel that reads a motion is differentiated to become an acceleration."""


def name_travel(channel: str) -> str:
    """Return the name of the travel that a channel read before the acceleration below took its name."""
    return f"{channel} travel"


def convert_run(
    run: Run, stated: Mapping[str, Quantity | None], *, above: Mapping[str, str], forces: Sequence[str] = ()
) -> Run:
    """Return a run whose sensors all read accelerations.

    A velocity or a displacement is differentiated up to the frequency at which it sinks into its noise. A travel in the
    place of a sensor below keeps its samples under another name (`name_travel`), and the acceleration below the
    suspension takes its place.

    Args:
        run: the run.
        stated: what the user states that each sensor below or on the body reads, by its channel; None where nothing is
            stated.
        above: for each channel of a travel the channel on the body above it.
        forces: the channels of forces in struts.

    Raises:
        InputError: a channel in a unit that does not go with its quantity, one that is noise, or a travel that counts
            in the wrong direction.
    """
    recording, clocks, read = run.recording, run.clocks, dict[str, Quantity]()
    highest = dict[str, float]()
    for channel, quantity in stated.items():
        if channel not in recording.names:
            continue  # The study names the channel that is missing.
        with prefix_errors(f"run {run.name!r}, channel {channel!r}: "):
            read[channel] = quantity_of(recording.unit(channel), quantity)
            if read[channel] in ("velocity", "displacement"):
                highest[channel] = highest_useful_hz(recording.channel(channel), fs=recording.fs)
    highest_hz = min(highest.values(), default=None)
    beside = [channel for channel in above if channel not in read and channel in recording.names]
    if highest_hz is not None:
        # One low-pass for all channels: no ratio between them changes.
        others: dict[str, Quantity] = {**dict.fromkeys(beside, "travel"), **dict.fromkeys(forces, "force")}
        for channel, own in (read | others).items():
            if channel in recording.names:
                recording = _differentiate(recording, channel, own, highest_hz)
    for channel in [each for each, quantity in read.items() if quantity == "travel"]:
        with prefix_errors(f"run {run.name!r}, channel {channel!r}: "):
            recording = _derive_below(recording, channel, above[channel])
            clocks = tuple(_rename(match, channel) for match in clocks)
    for channel in beside:
        with prefix_errors(f"run {run.name!r}, channel {channel!r}: "):
            quantity_of(recording.unit(channel), "travel")
            if above[channel] in recording.names:
                check_travel(recording.channel(channel), recording.channel(above[channel]), fs=recording.fs)
    if highest_hz is not None:
        highest_hz *= DEFAULTS.compared_fraction
    return replace(run, recording=recording, clocks=clocks, highest_hz=highest_hz)


def differentiated_noises(runs: Sequence[Run], stated: Mapping[str, Quantity | None]) -> dict[str, float]:
    """Return the noise of each channel that is differentiated, the largest of all runs, m/s^2.

    Args:
        runs: the runs before they were converted.
        stated: what the user states that each sensor reads, by its channel.
    """
    found: dict[str, float] = {}
    for run in runs:
        recording = run.recording
        orders = {
            channel: MOTIONS.get(quantity_of(recording.unit(channel), quantity), 0)
            for channel, quantity in stated.items()
            if channel in recording.names
        }
        columns = {channel: recording.channel(channel) for channel, order in orders.items() if order}
        limits = [highest_useful_hz(each, fs=recording.fs) for each in columns.values()]
        for channel, samples in columns.items():
            noise = differentiated_noise(
                samples, fs=recording.fs, n_derivatives=orders[channel], highest_hz=min(limits)
            )
            found[channel] = max(noise, found.get(channel, 0.0))
    return found


def _differentiate(recording: Recording, channel: str, quantity: Quantity, highest_hz: float) -> Recording:
    """Return the recording with a motion as an acceleration up to a frequency; a travel or a force stays one."""
    samples, fs, n_derivatives = recording.channel(channel), recording.fs, MOTIONS.get(quantity, 0)
    found = accelerate(samples, fs=fs, n_derivatives=n_derivatives, highest_hz=highest_hz)
    what = f"a {quantity}, differentiated up to" if n_derivatives else "low-passed at"
    words = f"{channel}: {what} {highest_hz:.3g} Hz, where the noisiest channel sinks into its noise"
    # A travel and a force have a static part.
    mean = 0.0 if quantity in MOTIONS else samples.mean()
    return with_channel(recording, channel, found + mean, words, "m/s^2" if n_derivatives else recording.unit(channel))


def _derive_below(recording: Recording, channel: str, sprung: str) -> Recording:
    """Return the recording with a travel under another name, and the acceleration below in its place."""
    if sprung not in recording.names:
        return recording
    travel, above, fs = recording.channel(channel), recording.channel(sprung), recording.fs
    if recording.unit(sprung) != "m/s^2":
        raise InputError(f"the channel {sprung!r} on the body is in {recording.unit(sprung)}: give an acceleration")
    check_travel(travel, above, fs=fs)
    words = f"{channel}: a travel; the acceleration below is that above less its second derivative"
    changed = with_channel(recording, channel, acceleration_below(travel, above, fs=fs), words)
    return replace(
        changed,
        samples=np.column_stack([changed.samples, travel]),
        channels=(*changed.channels, Channel(name_travel(channel), "m")),
    )


def _rename(match: ClockMatch, channel: str) -> ClockMatch:
    """Return a match of clocks in which a travel has its later name: what is left of its lag is a lag of the travel."""
    return replace(match, channels=tuple(name_travel(each) if each == channel else each for each in match.channels))


def with_channel(recording: Recording, channel: str, values: np.ndarray, words: str, unit: str = "m/s^2") -> Recording:
    """Return the recording with other samples in the place of a channel."""
    samples, index = recording.samples.copy(), recording.index(channel)
    samples[:, index] = values
    channels = list(recording.channels)
    channels[index] = Channel(channel, unit)
    return replace(recording, samples=samples, channels=tuple(channels), history=(*recording.history, words))
