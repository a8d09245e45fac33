"""What `inspect` finds in a log: figures of clocks, channels and pairs, faulty stretches, and findings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

import numpy as np

from opid.json_values import plain
from opid.provenance import ReadFile
from opid.result import Result, SummaryRow
from opid.signals.health.settings import HEALTH
from opid.signals.health.spikes import SPIKES
from opid.signals.orientation import Alignment, Orientation
from opid.signals.recording import FloatArray

SCHEMA = "opid.health/1"

Severity = Literal["note", "warning", "fault"]
Code = Literal[
    # of a clock
    "implausible_rate", "unreadable_stamps", "time_goes_back", "host_stalls", "gaps", "bridged_rows", "judged_stamps",
    "uneven_steps",
    "rows_equally_spaced", "no_clock", "shared_stamps", "repeated_stamps",
    # of a channel
    "no_values", "missing_values", "clipped", "held_value", "spikes", "short_blows", "coarse_resolution", "constant",
    "mute", "few_values", "gravity", "gravity_in_g", "false_offset", "large_offset", "drift", "supply_lines", "no_unit",
    # of channels beside each other
    "same_signal", "lag", "quiet_channel", "swapped_channels", "too_large", "all_gravity_in_g",
    # of how a log was read, and of what a run was made of
    "remark", "channels_chosen", "left_out", "several_recorders", "matched_clocks", "unknown_start", "same_log",
    # of how a three-axis sensor is mounted
    "orientation", "no_orientation", "sensor_moved", "false_vertical",
]  # fmt: skip
Kind = Literal["gap", "missing", "clipped", "flat", "spike"]
Sentences = Iterator[tuple[Severity, Code, str]]
"""How severe each fault is, its code, and what was found and what to do."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong or noteworthy.

    Args:
        severity: "fault" (unusable), "warning" (may spoil the result) or "note" (good to know).
        code: code of its kind; findings with one code differ in their numbers and names only, except for "remark".
        channel: name of the channel that it concerns, empty for the whole recording.
        message: what was found and what to do.
    """

    severity: Severity
    code: Code
    channel: str
    message: str


@dataclass(frozen=True)
class Stretch:
    """A stretch of time in which something is wrong.

    Args:
        kind: kind of the fault.
        start_s: time of its beginning, s.
        stop_s: time of its end, s.
    """

    kind: Kind
    start_s: float
    stop_s: float


@dataclass(frozen=True)
class ClockHealth:
    """Figures of one clock.

    Args:
        track: name of the track, empty where there is only one.
        channels: names of its channels.
        fs: rate, Hz: as stated, or from the stamps.
        stated: whether the file (or the user) states the rate; the stamps are then not used.
        start_s: time of the first sample, s.
        duration_s: length, gaps included, s.
        n_samples: number of rows.
        jitter: standard deviation of the steps between stamps over the period, rounding of the stamps included.
        resolution_s: step to which the stamps are rounded, s; 0 without stamps.
        repeated: stamps equal to the one before.
        backward: stamps before the one before.
        gaps: the first hundred steps of more than a period and a half.
        n_gaps: number of such steps.
        n_lost: approximate number of samples that were lost in them.
    """

    track: str
    channels: tuple[str, ...]
    fs: float
    stated: bool
    start_s: float
    duration_s: float
    n_samples: int
    jitter: float = 0.0
    resolution_s: float = 0.0
    repeated: int = 0
    backward: int = 0
    gaps: tuple[Stretch, ...] = ()
    n_gaps: int = 0
    n_lost: int = 0


@dataclass(frozen=True)
class SpectralLine:
    """A line that stands out of the spectrum, or a peak that may be one.

    Args:
        frequency_hz: frequency of the line, Hz.
        rms: rms of the line, in the unit of the channel.
        name: "mains, 50 Hz", "harmonic 3 of the mains (50 Hz)", or empty.
        harmonic: number of the harmonic of an electric supply, 1 for the supply itself; None for another line.
        resolved: whether the record is long enough to show that the peak is narrower than a resonance of 1 % damping.
    """

    frequency_hz: float
    rms: float
    name: str = ""
    harmonic: int | None = None
    resolved: bool = True


@dataclass(frozen=True, eq=False)
class Overview:
    """The data of a channel's picture, of one size for a log of any length.

    Args:
        time_s: (n,) middles of the stretches, s.
        lowest: (n,) least value in each stretch, NaN where there is none.
        highest: (n,) largest value in each stretch.
        frequency_hz: (n_lines,) frequencies of the spectra, Hz.
        psd: (n_lines,) power spectral density, unit^2/Hz.
        spectrogram_s: (m,) middles of the times of the spectrogram, s.
        spectrogram_hz: (n_bands,) frequencies of the spectrogram, Hz: single lines up to about 20 Hz, then bands of
            growing width.
        spectrogram: (m, n_bands) power spectral density at these times, unit^2/Hz, NaN where there is none.
    """

    time_s: FloatArray
    lowest: FloatArray
    highest: FloatArray
    frequency_hz: FloatArray
    psd: FloatArray
    spectrogram_s: FloatArray
    spectrogram_hz: FloatArray
    spectrogram: FloatArray


@dataclass(frozen=True)
class ChannelHealth:
    """Figures of one channel, in its SI unit (as written where no unit is known).

    Args:
        name: name of the channel.
        unit: its SI unit, "?" where none is known.
        mean: the offset.
        rms: root mean square about the mean.
        peak: largest distance from the mean.
        crest_factor: peak over rms, 0 for a mute channel.
        high_frequency_rms: rms of the part above 5 Hz.
        quantisation_step: the values are multiples of this step; None where no step is visible.
        clipped_fraction: fraction of the samples that lie at an extreme value, three or more in a row.
        longest_flat_s: longest time for which the value does not change, s.
        spikes: number of single samples that depart from their neighbours by 10 robust standard deviations.
        mute: whether the channel has no more than three different values.
        number: number of the channel among all channels of its log, counted from 1; 0 where unknown.
        missing: number of missing values (NaN).
        drift: range of the slow offset (means of long parts of the record), in the unit.
        noise_floor: rms of white noise as quiet as the quietest part of the spectrum: an upper bound for the sensor's.
        lines: lines that stand out of the spectrum, the strongest first.
        stretches: stretches in which something is wrong, the first hundred of each kind.
        overview: the data of its picture.
    """

    name: str
    unit: str
    mean: float
    rms: float
    peak: float
    crest_factor: float
    high_frequency_rms: float
    quantisation_step: float | None
    clipped_fraction: float
    longest_flat_s: float
    spikes: int
    mute: bool
    number: int = 0
    missing: int = 0
    drift: float = 0.0
    noise_floor: float = 0.0
    lines: tuple[SpectralLine, ...] = ()
    stretches: tuple[Stretch, ...] = ()
    overview: Overview | None = field(default=None, compare=False)


@dataclass(frozen=True)
class PairHealth:
    """Figures of two channels of one clock beside each other.

    Args:
        first: name of a channel.
        second: name of another.
        lag_s: time by which the second comes later, s; NaN where they are not coherent enough.
        lag_std_s: standard deviation of the lag, s.
        coherent_band_hz: longest band in which the squared coherence exceeds a half, Hz; None where there is none.
        is_short: whether the record is too short to tell.
    """

    first: str
    second: str
    lag_s: float
    lag_std_s: float
    coherent_band_hz: tuple[float, float] | None
    is_short: bool = False


@dataclass(frozen=True, eq=False)
class RmsHistory:
    """How strong the motion is, second by second; segments are found from it.

    Args:
        start_s: (n,) start of each stretch, s.
        length_s: length of each stretch, s.
        rms: (n, n_channels) rms about the mean of each stretch, in the unit of the channel; NaN where values are
            missing.
        mean: (n, n_channels) mean of each stretch; NaN where there is no value.
        sound: (n, n_channels) whether nothing is wrong with the channel in the stretch.
        complete: (n, n_channels) whether no value is missing and the clock does not jump.
    """

    start_s: FloatArray
    length_s: float
    rms: FloatArray
    mean: FloatArray
    sound: np.ndarray
    complete: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Health(Result):
    """What `inspect` found in a log.

    Args:
        fs: sampling rate, Hz, of the clock with most samples.
        duration_s: duration of that clock, s.
        n_samples: number of samples of each of its channels.
        channels: figures of each channel.
        looks_unsprung: of two coherent accelerations the one that looks like the wheel's side; None where there are no
            such two.
        findings: what is wrong, faults first.
        clocks: figures of each clock.
        pairs: accelerations of one clock beside each other.
        rms_history: rms history of each clock, in the order of `clocks`.
        orientations: how each three-axis accelerometer is mounted, by the part of the names that its axes share.
        alignments: how each two of them that share a motion are turned against each other.
        log: name of the log; empty for a recording.
        files: files that it was read from.
    """

    fs: float
    duration_s: float
    n_samples: int
    channels: tuple[ChannelHealth, ...]
    looks_unsprung: str | None
    findings: tuple[Finding, ...]
    clocks: tuple[ClockHealth, ...] = ()
    pairs: tuple[PairHealth, ...] = ()
    rms_history: tuple[RmsHistory, ...] = ()
    orientations: Mapping[str, Orientation] = field(default_factory=dict)
    alignments: tuple[Alignment, ...] = ()
    log: str = ""
    files: tuple[ReadFile, ...] = ()

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return rate and length of the clock with most samples, and offset and rms of each channel."""
        rows = [("fs", self.fs, "Hz"), ("duration", self.duration_s, "s"), ("samples", float(self.n_samples), "1")]
        for channel in self.channels:
            rows += [
                (f"{channel.name}.{what}", getattr(channel, what), channel.unit) for what in ("mean", "rms", "peak")
            ]
        return tuple(SummaryRow(name, value, None, None, unit) for name, value, unit in rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `health_json`."""
        return health_json([self])

    def _write_headline(self) -> str:
        return f"{self.log or 'a recording'}, {len(self.channels)} channels: {count_findings(self.findings)}"


@dataclass(frozen=True, eq=False, repr=False)
class Inspection(Result):
    """What `opid inspect` found in some logs.

    Args:
        logs: the health of each log.
        names: names that stand before the figures, one for each log and no two alike.
    """

    logs: tuple[Health, ...]
    names: tuple[str, ...]

    def summary(self) -> tuple[SummaryRow, ...]:
        """Return the numbers of each log, with its name before each."""
        return tuple(
            replace(row, name=f"{name}.{row.name}")
            for name, health in zip(self.names, self.logs, strict=True)
            for row in health.summary()
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the content of result.json, see `health_json`."""
        return health_json(self.logs)

    @property
    def files(self) -> tuple[ReadFile, ...]:
        """The logs and the study that says how they are read, as they were then."""
        return tuple(file for health in self.logs for file in health.files)

    def _write_headline(self) -> str:
        findings = [each for health in self.logs for each in health.findings]
        return f"{len(self.logs)} logs: {count_findings(findings)}"


def count_findings(findings: Sequence[Finding]) -> str:
    """Return how many findings of each severity there are.

    >>> count_findings([]), count_findings([Finding("note", "drift", "", "an offset")])
    ('nothing is wrong', '1 note')
    """
    counts = [(kind, sum(each.severity == kind for each in findings)) for kind in ("fault", "warning", "note")]
    return ", ".join(f"{n} {kind}{'s' * (n != 1)}" for kind, n in counts if n) or "nothing is wrong"


def health_json(logs: Sequence[Health]) -> dict[str, Any]:
    """Return the health of some logs as a value of JSON, without the arrays of pictures.

    Returns:
        `schema`, `logs` and `settings`; a log has the fields of `Health` except `rms_history` and `files`, and its
        channels have theirs except `overview`. The settings are those of `HealthSettings`, and below `spikes` those of
        `SpikeSettings`.

    >>> list(health_json([]))
    ['schema', 'logs', 'settings']
    """
    settings = asdict(HEALTH) | {"spikes": asdict(SPIKES)}
    return plain({"schema": SCHEMA, "logs": [_drop_arrays(each) for each in logs], "settings": settings})


def _drop_arrays(health: Health) -> dict[str, Any]:
    # the arrays are left out before `asdict`, which would copy them
    channels = tuple(replace(channel, overview=None) for channel in health.channels)
    document = asdict(replace(health, channels=channels, rms_history=(), files=()))
    del document["rms_history"], document["files"]
    for channel in document["channels"]:
        del channel["overview"]
    return {"log": document.pop("log")} | document
