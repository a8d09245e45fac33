"""The channels of a run -> accelerations, where its sensors read velocities, displacements or travels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from opid.errors import InputError
from opid.signals.clock_matching import ClockMatch
from opid.signals.quantities import (
    Quantity,
    accelerate,
    acceleration_below,
    check_travel,
    highest_useful_hz,
    quantity_of,
)
from opid.signals.recording import Channel, Recording
from opid.studies.schema import prefix_errors
from opid.suspensions.study import Run


def name_travel(channel: str) -> str:
    """Return the name of the travel that a channel read before the acceleration below took its name."""
    return f"{channel} travel"


def convert_run(run: Run, stated: Mapping[str, Quantity | None], *, sprung: str, travel: str | None) -> Run:
    """Return a run whose sensors all read accelerations.

    A velocity or a displacement is differentiated up to the frequency at which it sinks into its noise. A travel keeps
    its samples under another name (`name_travel`), and the acceleration below the suspension takes its place.

    Args:
        run: the run.
        stated: what the user states that each sensor reads, by its channel; None where nothing is stated.
        sprung: the channel on the body.
        travel: the channel of a travel that stands beside a sensor on either side; None if there is none.

    Raises:
        InputError: a channel in a unit that does not go with its quantity, one that is noise, or a travel that counts
            in the wrong direction.
    """
    recording, clocks, highest = run.recording, run.clocks, [] if run.highest_hz is None else [run.highest_hz]
    for channel, quantity in sorted(stated.items(), key=lambda each: each[1] == "travel"):
        if channel not in recording.names:
            continue  # The study names the channel that is missing.
        with prefix_errors(f"run {run.name!r}, channel {channel!r}: "):
            read = quantity_of(recording.unit(channel), quantity)
            if read in ("velocity", "displacement"):
                recording, highest_hz = _differentiate(recording, channel, read)
                highest.append(highest_hz)
            elif read == "travel":
                recording = _derive_below(recording, channel, sprung)
                clocks = tuple(_rename(match, channel) for match in clocks)
    if travel is not None and travel in recording.names:
        with prefix_errors(f"run {run.name!r}, channel {travel!r}: "):
            quantity_of(recording.unit(travel), "travel")
            check_travel(recording.channel(travel), recording.channel(sprung), fs=recording.fs)
    return replace(run, recording=recording, clocks=clocks, highest_hz=min(highest, default=None))


def _differentiate(recording: Recording, channel: str, quantity: Quantity) -> tuple[Recording, float]:
    """Return the recording with a channel as an acceleration, and the frequency up to which it is one."""
    samples, fs = recording.channel(channel), recording.fs
    highest_hz = highest_useful_hz(samples, fs=fs)
    found = accelerate(samples, fs=fs, n_derivatives=1 if quantity == "velocity" else 2, highest_hz=highest_hz)
    words = f"{channel}: a {quantity}, differentiated up to {highest_hz:.3g} Hz, where it sinks into its noise"
    return _with_channel(recording, channel, found, words), highest_hz


def _derive_below(recording: Recording, channel: str, sprung: str) -> Recording:
    """Return the recording with a travel under another name, and the acceleration below in its place."""
    if sprung not in recording.names:
        return recording
    travel, above, fs = recording.channel(channel), recording.channel(sprung), recording.fs
    if recording.unit(sprung) != "m/s^2":
        raise InputError(f"the channel {sprung!r} on the body is in {recording.unit(sprung)}: give an acceleration")
    check_travel(travel, above, fs=fs)
    words = f"{channel}: a travel; the acceleration below is that above less its second derivative"
    changed = _with_channel(recording, channel, acceleration_below(travel, above, fs=fs), words)
    return replace(
        changed,
        samples=np.column_stack([changed.samples, travel]),
        channels=(*changed.channels, Channel(name_travel(channel), "m")),
    )


def _rename(match: ClockMatch, channel: str) -> ClockMatch:
    """Return a match of clocks in which a travel has its later name: what is left of its lag is a lag of the travel."""
    return replace(match, channels=tuple(name_travel(each) if each == channel else each for each in match.channels))


def _with_channel(recording: Recording, channel: str, acceleration: np.ndarray, words: str) -> Recording:
    """Return the recording with an acceleration in the place of a channel."""
    samples, index = recording.samples.copy(), recording.index(channel)
    samples[:, index] = acceleration
    channels = list(recording.channels)
    channels[index] = Channel(channel, "m/s^2")
    return replace(recording, samples=samples, channels=tuple(channels), history=(*recording.history, words))
