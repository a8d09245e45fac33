"""What is wrong with a log, as text for a terminal of 80 columns and as a page with its figures."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from opid.report.as_text import WIDTH, aligned, wrapped
from opid.report.page import Page, Picture
from opid.signals.health.result import ChannelHealth, ClockHealth, Finding, Health, PairHealth, SpectralLine

MOST_LINES, MOST_PAIRS, MOST_NOTES = 6, 12, 12
MOST_CLOCKS, MOST_CHANNELS, MOST_WITH_LINES, MOST_ALIKE = 40, 40, 12, 3
"""What a page has room for, of a channel's lines, of pairs, of notes, of clocks, of channels in a table and with lines,
and of findings that differ but in their numbers: `Health.to_dict` tells them all."""

CHANNELS_A_PICTURE, MOST_PICTURES = 12, 2
"""A picture takes seconds: of a log with more channels than these hold the most telling are drawn."""

FEW_CLOCKS = 6
"""Clocks that are told in a sentence each; of more, a line each."""

LEAST_JITTER = 1e-6
"""Of the period; what is less is the rounding of numbers, not of stamps."""


def text_of(health: Health) -> str:
    """Return the health of a log as text: its figures, then what is wrong, the worst first, and what to do.

    Args:
        health: from `opid.inspect`.
    """
    parts = [*_clock_lines(_shown(health.log or "a recording"), health), "", *_channel_lines(health.channels), ""]
    of_channels = list(_spectral_lines(_telling(health.channels)))
    parts += [*of_channels, *([""] if of_channels else [])]
    parts += _pair_lines(health.pairs)
    if health.looks_unsprung:
        parts.append(f"{health.looks_unsprung!r} looks like the unsprung channel (most motion above 5 Hz).")
    parts += _finding_lines(health.findings)
    if not health.findings:
        parts.append("Nothing is wrong.")
    return "\n".join(parts) + "\n"


def page_of(health: Health) -> Page:
    """Return what the page of a log shows: the text as it is, and the pictures of its channels.

    Args:
        health: from `opid.inspect`.
    """
    return Page(
        "health.html.jinja",
        health.log or "A recording",
        health_pictures(health),
        {"text": text_of(health), "left_out": channels_left_out(health)},
        command=["opid", "inspect", health.log] if health.log else None,
    )


def health_pictures(health: Health) -> tuple[Picture, ...]:
    """Return the pictures of a log, some channels on every one; of very many channels the most telling are drawn.

    Args:
        health: of the log.
    """
    from opid import plots

    def picture(number: int, names: Sequence[str]) -> Picture:
        return Picture(
            "health" if len(parts) == 1 else f"health_part{number}",
            "History, spectrum and spectrogram" + f", part {number}" * (len(parts) > 1),
            "Each channel over time, between its least and its largest value; its power spectral density; and how that "
            "moves over time. What is wrong is marked.",
            lambda health, truth: plots.health_picture(health, channels=names),
        )

    names = _drawn(health)
    parts = [names[i : i + CHANNELS_A_PICTURE] for i in range(0, len(names), CHANNELS_A_PICTURE)]
    return tuple(picture(number, part) for number, part in enumerate(parts, 1))


def channels_left_out(health: Health) -> str:
    """Return the sentence that says that not all channels are drawn; empty if they are.

    Args:
        health: of the log.
    """
    n, every = len(_drawn(health)), len(health.channels)
    words = f"{n} of the {every} channels of {health.log} are drawn: name those wanted in [channels] of a study"
    return words if n < every else ""


def _drawn(health: Health) -> list[str]:
    """The names of the channels to draw: all, or of many the first that are not mute, accelerations before others."""
    most = CHANNELS_A_PICTURE * MOST_PICTURES
    telling = sorted(health.channels, key=lambda channel: (channel.mute, channel.unit != "m/s^2"))
    return [channel.name for channel in (health.channels if len(telling) <= most else telling[:most])]


# ---- clocks ----------------------------------------------------------------------------------------


def _clock_lines(name: str, health: Health) -> list[str]:
    """The name of the log, and a sentence for each clock."""
    if not health.clocks:
        return [f"{name}: {health.duration_s:.4g} s at {health.fs:.9g} Hz, {health.n_samples} samples"]
    if len(health.clocks) == 1:
        return wrapped(f"{name}: {_clock_words(health.clocks[0])}.")
    lines = [f"{name}: {len(health.clocks)} clocks, {_counted(len(health.channels), 'channel')}"]
    if len(health.clocks) > FEW_CLOCKS:
        return [*lines, *_clock_table(health.clocks)]
    for clock in health.clocks:
        title = _shown(clock.track or clock.channels[0] + ", ..." * (len(clock.channels) > 1))
        lines += wrapped(f"{title}: {_clock_words(clock)}.", "  ")
    return lines


def _clock_table(clocks: Sequence[ClockHealth]) -> list[str]:
    """A line for each clock, those with most samples where they are too many."""
    most = sorted(clocks, key=lambda clock: -clock.n_samples)[:MOST_CLOCKS]
    rows = [
        (
            _shown(clock.track or clock.channels[0]),
            f"{len(clock.channels)}",
            f"{clock.fs:.6g} Hz",
            f"{clock.n_samples}",
            f"{clock.duration_s:.4g} s",
            f"{clock.n_gaps}" if clock.n_gaps else "-",
        )
        for clock in clocks
        if clock in most
    ]
    lines = _table(("clock", "channels", "rate", "samples", "length", "gaps"), rows)
    more = len(clocks) - len(rows)
    return lines + [f"and {_counted(more, 'clock')} with fewer samples (--json tells all)"] * (more > 0)


def _clock_words(clock: ClockHealth) -> str:
    """One sentence: rate, length, jitter, gaps, stamps that stand twice."""
    if clock.stated:
        rate = f"{clock.fs:.9g} Hz as stated, no time stamps to check it by"
    else:
        jitter = f"jitter {_figure(100 * clock.jitter)} % of the period" if clock.jitter > LEAST_JITTER else "no jitter"
        rate = f"{clock.fs:.9g} Hz from time stamps, {jitter}"
        # what is finer than a nanosecond is the arithmetic's, and stamps exact in a binary number are not rounded
        exact = abs(clock.resolution_s * clock.fs - 1) < 1e-6 and clock.jitter <= LEAST_JITTER
        rounded = clock.resolution_s > 1e-9 and not exact
        rate += f" (they are rounded to {_seconds(clock.resolution_s)})" if rounded else ""
    words = [f"{clock.duration_s:.6g} s from {clock.start_s:.6g} s on", rate, f"{clock.n_samples} samples"]
    if clock.n_gaps:
        longest = max((gap.stop_s - gap.start_s for gap in clock.gaps), default=0.0)
        words.append(f"{_counted(clock.n_gaps, 'gap')} (the longest {_seconds(longest)}, {clock.n_lost} samples lost)")
    elif not clock.stated:
        words.append("no gap")
    words += [f"{_counted(clock.repeated, 'stamp')} repeated"] * (clock.repeated > 0)
    words += [f"{_counted(clock.backward, 'stamp')} run{'s' * (clock.backward == 1)} backward"] * (clock.backward > 0)
    return "; ".join(words)


def _seconds(value: float) -> str:
    """A time in the unit that needs no zeros: "3.5 s", "10 ms", "1 us"."""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")):
        if value * factor >= 0.9995:  # 999.9 ms would be 1e+03 ms
            return f"{value * factor:.3g} {unit}"
    return f"{1e9 * value:.3g} ns"


def _counted(number: int, word: str) -> str:
    return f"{number} {word}{'s' * (number != 1)}"


# ---- channels --------------------------------------------------------------------------------------


def _channel_lines(channels: Sequence[ChannelHealth]) -> list[str]:
    """A table of figures, and one of faults for the channels that have any; of very many the most telling."""
    shown = _telling(channels)
    # a study may name a channel by its number in the log
    digits = max((len(f"{channel.number}") for channel in shown if channel.number), default=0)
    numbers = [(f"{channel.number or '-'}".rjust(digits),) if digits else () for channel in shown]
    head = ("channel", *(("no.",) if digits else ()), "unit", "mean", "rms", "peak", "noise floor", "step", "drift")
    rows = [
        (
            _shown(channel.name),
            *number,
            channel.unit,
            *(_figure(value, 3) for value in (channel.mean, channel.rms, channel.peak)),
            _figure(channel.noise_floor or None),
            _figure(channel.quantisation_step),
            _figure(None if channel.mute else channel.drift),
        )
        for channel, number in zip(shown, numbers, strict=True)
    ]
    lines = _table(head, rows, left=range(head.index("unit") + 1))
    if len(shown) < len(channels):
        lines += wrapped(
            f"and {len(channels) - len(shown)} channels more, {sum(channel.mute for channel in channels)} of all are "
            "constant: --json tells all, and [channels] of a study (--study) names those wanted."
        )
    faults = [row for row in ((_shown(channel.name), *_faults(channel)) for channel in shown) if set(row[1:]) != {"-"}]
    if faults:
        lines += ["", *_table(("channel", "missing", "clipped", "longest held", "spikes"), faults)]
    return lines


def _telling(channels: Sequence[ChannelHealth]) -> Sequence[ChannelHealth]:
    """All channels, or of very many those that a page has room for."""
    if len(channels) <= MOST_CHANNELS:
        return channels
    return sorted(channels, key=lambda c: (c.mute, c.unit != "m/s^2", c.unit == "?"))[:MOST_CHANNELS]


def _shown(name: str) -> str:
    """A name that no terminal stumbles over."""
    return name if name.isprintable() else ascii(name)[1:-1]


def _figure(value: float | None, digits: int = 2) -> str:
    """A number of so many digits: "4000", not "4e+03"."""
    return "-" if value is None or not math.isfinite(value) else f"{float(f'{value:.{digits}g}'):.6g}"


def _faults(channel: ChannelHealth) -> tuple[str, ...]:
    flat = any(stretch.kind == "flat" for stretch in channel.stretches)
    return (
        f"{channel.missing}" if channel.missing else "-",
        f"{channel.clipped_fraction:.2%}" if channel.clipped_fraction > 0 else "-",
        _seconds(channel.longest_flat_s) if flat else "mute" if channel.mute else "-",
        f"{channel.spikes}" if channel.spikes else "-",
    )


def _table(head: Sequence[str], rows: Sequence[Sequence[str]], *, left: Sequence[int] = (0,)) -> list[str]:
    """Aligned columns; names too long for the screen stand on a line of their own."""
    width = max(map(len, aligned([head, *rows], left=left)))
    if width <= WIDTH:
        return aligned([head, *rows], left=left)
    room = max(12, max(map(len, (row[0] for row in rows))) - (width - WIDTH))
    short = [(row[0] if len(row[0]) <= room else "", *row[1:]) for row in rows]
    lines = aligned([head, *short], left=left)
    text = lines[:1]
    for row, line in zip(rows, lines[1:], strict=True):
        text += [row[0], line] if len(row[0]) > room else [line]
    return text


def _spectral_lines(channels: Sequence[ChannelHealth]) -> Iterator[str]:
    """The lines of each channel, and the peaks that may be lines."""
    kinds = (
        ("Lines", [(each, [line for line in each.lines if line.resolved or line.name]) for each in channels]),
        ("Peaks", [(each, [line for line in each.lines if not (line.resolved or line.name)]) for each in channels]),
    )
    for kind, of_channels in kinds:
        some = [(channel, lines) for channel, lines in of_channels if lines]
        for channel, lines in some[:MOST_WITH_LINES]:
            yield from wrapped(_line_words(channel, lines), f"{kind} of {_shown(channel.name)}: ")
        if len(some) > MOST_WITH_LINES:
            yield f"{kind} of {_counted(len(some) - MOST_WITH_LINES, 'channel')} more (--json tells all)."
        if some and kind == "Peaks":
            yield "A peak may be a line or a resonance: the record does not tell."


def _line_words(channel: ChannelHealth, lines: Sequence[SpectralLine]) -> str:
    unit = "" if channel.unit == "?" else f" {channel.unit}"
    shown = [
        f"{line.name or f'{line.frequency_hz:.4g} Hz'}, {_figure(line.rms)}{unit} rms" for line in lines[:MOST_LINES]
    ]
    more = len(lines) - len(shown)
    return "; ".join(shown) + (f"; and {more} weaker" if more > 0 else "") + "."


# ---- pairs and findings ------------------------------------------------------------------------------


def _pair_lines(pairs: Sequence[PairHealth]) -> list[str]:
    """A table of the pairs that move together."""
    together = [pair for pair in pairs if pair.coherent_band_hz is not None or math.isfinite(pair.lag_s)]
    rows = [(_shown(pair.first), _shown(pair.second), *_pair_words(pair)) for pair in together[:MOST_PAIRS]]
    lines = _table(("channel", "beside", "comes later by", "coherent band"), rows, left=(0, 1)) if rows else []
    more, apart = len(together) - len(rows), len(pairs) - len(together)
    lines += [f"and {_counted(more, 'pair')} more (--json tells all)"] * (more > 0)
    lines += [f"{_counted(apart, 'pair')} of accelerations {'are' if apart > 1 else 'is'} not coherent"] * (apart > 0)
    return [*lines, ""] if lines else []


def _pair_words(pair: PairHealth) -> tuple[str, str]:
    """The lag of the second channel, ms, and the band in which the two move together."""
    lag = "-"
    if math.isfinite(pair.lag_s):
        decimals = 3
        if math.isfinite(pair.lag_std_s) and pair.lag_std_s > 0:
            # two digits of the standard deviation, in ms
            decimals = min(6, max(0, 1 - math.floor(math.log10(1e3 * pair.lag_std_s))))
        lag = f"{1e3 * pair.lag_s:.{decimals}f} +- {1e3 * pair.lag_std_s:.{decimals}f} ms"
    band = pair.coherent_band_hz
    return lag, "none" if band is None else f"{band[0]:.3g} to {band[1]:.3g} Hz"


def _finding_lines(findings: Sequence[Finding]) -> Iterator[str]:
    """The findings, those that say the same, or the same of too many channels with other numbers, together."""
    together: dict[tuple[str, str], list[str]] = {}
    for finding in findings:
        message = finding.message.removeprefix(f"channel {finding.channel!r} ")
        together.setdefault((finding.severity, message), []).append(finding.channel)
    alike: dict[tuple[str, str], list[tuple[str, list[str]]]] = {}
    for (severity, message), channels in together.items():
        alike.setdefault((severity, _without_numbers(message)), []).append((message, channels))
    notes = 0
    for (severity, _), messages in alike.items():
        concerned = list(dict.fromkeys(channel for _, channels in messages for channel in channels))
        # what is wrong with one clock or channel in several places is told place by place
        many = len(messages) > MOST_ALIKE and (len(concerned) > MOST_ALIKE or concerned == [""])
        for message, channels in messages[:1] if many else messages:
            notes += severity == "note"
            if severity == "note" and notes > MOST_NOTES:
                continue
            where = _listed(channels)
            if many:
                also = _listed([channel for channel in concerned if channel not in channels])
                message += f" (likewise {also})" if also else f" (and {len(messages) - 1} times likewise)"
            yield from wrapped(f"{where}: {message}" if where else message, f"{severity.capitalize()}: ")
    if notes > MOST_NOTES:
        yield f"and {_counted(notes - MOST_NOTES, 'note')} more (--json tells all)"


def _without_numbers(message: str) -> str:
    return re.sub(r"'[^']*'|[-+]?\d[\d.e+-]*|nan", "#", message)


def _listed(channels: Sequence[str]) -> str:
    """Names of channels, of many the first."""
    names = list(dict.fromkeys(_shown(channel) for channel in channels if channel))
    more = len(names) - MOST_CHANNELS // 5
    return ", ".join(names[: MOST_CHANNELS // 5]) + (f" and {more} more" if more > 0 else "")
