"""The report of a log: what is in it, and what is wrong with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from opid.errors import escape_in_line
from opid.estimate import format_number, format_percent
from opid.report.document import (
    Block,
    Document,
    Figure,
    Paragraph,
    Remarks,
    Table,
    build_columns,
    end_sentence,
    format_count,
    write_sentence,
)
from opid.signals.health.result import (
    ChannelHealth,
    ClockHealth,
    Finding,
    Health,
    Inspection,
    PairHealth,
    SpectralLine,
    count_findings,
)
from opid.signals.orientation import say_alignment, say_orientation

MOST_LINES, MOST_PAIRS, MOST_NOTES = 6, 12, 12
MOST_CLOCKS, MOST_CHANNELS, MOST_WITH_LINES, MOST_ALIKE = 40, 40, 12, 3
"""The most lines of a channel, pairs, notes, clocks, channels in a table, channels with lines, and findings with the
same code that a page shows; `Health.to_dict` has them all."""

CHANNELS_A_FIGURE, MOST_FIGURES = 12, 2
"""Channels on a figure and the number of figures; each figure takes seconds, so that no more are drawn."""

FEW_CLOCKS = 6
"""This many clocks at most get a sentence each; more get a row of a table each."""

NO_LAG = "A lag needs a broad coherent band in which the phase is that of a delay; that of a suspension is not."

LEAST_JITTER = 1e-6
"""Fraction of the period; less is the rounding of numbers, not of stamps."""


def build_document(result: Health | Inspection) -> Document:
    """Return the report of a log, or of several in their order: each with a heading, as it is alone."""
    if isinstance(result, Health):
        return _build_log_document(result, "health")
    parts = [_build_log_document(health, name) for name, health in zip(result.names, result.logs, strict=True)]
    if len(parts) == 1:
        return parts[0]
    findings = [each for health in result.logs for each in health.findings]
    headings = [Paragraph(part.answer, part.title) for part in parts]
    return Document(
        f"{len(parts)} logs",
        "what is in them, and what is wrong with them",
        write_sentence(count_findings(findings)),
        None,
        tuple(block for heading, part in zip(headings, parts, strict=True) for block in (heading, *part.blocks)),
        lambda: [block for part in parts for block in part.details()],
        ["opid", "inspect", *(health.log for health in result.logs)],
        source="logs",
    )


def _build_log_document(health: Health, name: str) -> Document:
    """The report of a log: clocks, channels and pairs, then the findings, the most serious first."""
    blocks: list[Block] = [*_list_clock_blocks(health.clocks), *_tabulate_channels(health.channels)]
    blocks += [*_list_spectrum_blocks(_choose_telling(health.channels)), *_list_pair_blocks(health.pairs)]
    blocks += _list_mountings(health)
    if health.looks_unsprung:
        blocks.append(Paragraph(f"{health.looks_unsprung!r} looks like the unsprung channel (most motion above 5 Hz)."))
    blocks += _list_findings(health.findings) if health.findings else [Paragraph("Nothing is wrong.")]
    return Document(
        health.log or "A recording",
        "what is in the log, and what is wrong with it",
        write_sentence(_say_answer(health)),
        None,
        tuple(blocks),
        lambda: _list_details(health, name),
        ["opid", "inspect", health.log] if health.log else None,
        source="log",
    )


def _list_details(health: Health, name: str) -> Iterator[Block]:
    left_out = say_channels_left_out(health)
    if left_out:
        yield Paragraph(end_sentence(left_out))
    yield from _list_figures(health, name)
    if health.orientations:
        from opid import plots

        yield Figure(
            f"{name}_orientation",
            "Orientation of the three-axis sensors" + f" of {health.log}" * bool(health.log),
            "The axes of each sensor seen from the side, with the vertical that gravity shows upward and its 95 % "
            "interval. An axis that points at the reader is a dot.",
            lambda: plots.orientation_picture(health),
        )


def _list_figures(health: Health, name: str) -> Iterator[Figure]:
    """The figures of a log, several channels on each; of very many channels some are drawn."""
    from opid import plots

    def build_figure(number: int, names: Sequence[str]) -> Figure:
        return Figure(
            name if len(parts) == 1 else f"{name}_part{number}",
            "History, spectrum and spectrogram"
            + f" of {health.log}" * bool(health.log)
            + f", part {number}" * (len(parts) > 1),
            "Each channel over time, between its least and its largest value; its power spectral density; and how that "
            "moves over time. What is wrong is marked.",
            lambda: plots.health_picture(health, channels=names),
        )

    names = _choose_drawn(health)
    parts = [names[i : i + CHANNELS_A_FIGURE] for i in range(0, len(names), CHANNELS_A_FIGURE)]
    return (build_figure(number, part) for number, part in enumerate(parts, 1))


def say_channels_left_out(health: Health) -> str:
    """Return a sentence on channels that are not drawn; empty if all are."""
    n, every = len(_choose_drawn(health)), len(health.channels)
    words = f"{n} of the {every} channels of {health.log} are drawn: name those wanted in [channels] of a study"
    return words if n < every else ""


def _choose_drawn(health: Health) -> list[str]:
    """The names of the channels to draw: all, or the first that are not mute, accelerations before others."""
    most = CHANNELS_A_FIGURE * MOST_FIGURES
    telling = sorted(health.channels, key=lambda channel: (channel.mute, channel.unit != "m/s^2"))
    return [channel.name for channel in (health.channels if len(telling) <= most else telling[:most])]


# ---- clocks ----------------------------------------------------------------------------------------


def _say_answer(health: Health) -> str:
    if not health.clocks:
        return (
            f"{format_number(health.duration_s, 4)} s at {format_number(health.fs, 9)} Hz, {health.n_samples} samples"
        )
    if len(health.clocks) == 1:
        return _say_clock(health.clocks[0])
    return f"{len(health.clocks)} clocks, {format_count(len(health.channels), 'channel')}"


def _list_clock_blocks(clocks: Sequence[ClockHealth]) -> Iterator[Block]:
    """A sentence for each of a few clocks, or a row for each of many."""
    if len(clocks) > FEW_CLOCKS:
        shown = sorted(clocks, key=lambda clock: -clock.n_samples)[:MOST_CLOCKS]
        rows = tuple(
            (
                clock.track or clock.channels[0],
                f"{len(clock.channels)}",
                format_number(clock.fs),
                f"{clock.n_samples}",
                format_number(clock.duration_s, 4),
                f"{clock.n_gaps}" if clock.n_gaps else "-",
            )
            for clock in clocks
            if clock in shown
        )
        more = len(clocks) - len(rows)
        yield Table(
            build_columns("clock", "channels", "rate [Hz]", "samples", "length [s]", "gaps"),
            rows,
            note=f"and {format_count(more, 'clock')} with fewer samples (--json lists all)" if more > 0 else "",
        )
    elif len(clocks) > 1:
        titles = (clock.track or clock.channels[0] + ", ..." * (len(clock.channels) > 1) for clock in clocks)
        sentences = zip(titles, clocks, strict=True)
        yield Remarks("Clock", tuple(f"{escape_in_line(title)}: {_say_clock(clock)}" for title, clock in sentences))


def _say_clock(clock: ClockHealth) -> str:
    if clock.stated:
        rate = f"{format_number(clock.fs, 9)} Hz as stated, no time stamps to check it by"
    else:
        jitter = (
            f"jitter {format_percent(clock.jitter, 2)} of the period" if clock.jitter > LEAST_JITTER else "no jitter"
        )
        rate = f"{format_number(clock.fs, 9)} Hz from time stamps, {jitter}"
        # less than a nanosecond comes from arithmetic, and stamps that are exact binary numbers are not rounded
        is_exact = abs(clock.resolution_s * clock.fs - 1) < 1e-6 and clock.jitter <= LEAST_JITTER
        is_rounded = clock.resolution_s > 1e-9 and not is_exact
        rate += f" (they are rounded to {_format_seconds(clock.resolution_s)})" if is_rounded else ""
    words = [
        f"{format_number(clock.duration_s)} s from {format_number(clock.start_s)} s on",
        rate,
        f"{clock.n_samples} samples",
    ]
    if clock.n_gaps:
        longest = max((gap.stop_s - gap.start_s for gap in clock.gaps), default=0.0)
        words.append(
            f"{format_count(clock.n_gaps, 'gap')} (the longest {_format_seconds(longest)}, {clock.n_lost} samples lost)"
        )
    elif not clock.stated:
        words.append("no gap")
    words += [f"{format_count(clock.repeated, 'stamp')} repeated"] * (clock.repeated > 0)
    words += [f"{format_count(clock.backward, 'stamp')} run{'s' * (clock.backward == 1)} backward"] * (
        clock.backward > 0
    )
    return "; ".join(words)


def _format_seconds(value: float) -> str:
    """A time in a unit in which it needs no zeros: "3.5 s", "10 ms", "1 µs"."""
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs")):
        if value * factor >= 0.9995:  # otherwise 999.9 ms would become 1e+03 ms
            return f"{format_number(value * factor, 3)} {unit}"
    return f"{format_number(1e9 * value, 3)} ns"


# ---- channels --------------------------------------------------------------------------------------


def _tabulate_channels(channels: Sequence[ChannelHealth]) -> Iterator[Table]:
    """A table of all channels, and one of the faults of some; of very many channels some are shown."""
    shown = _choose_telling(channels)
    # a study may name a channel by its number in the log
    has_numbers = any(channel.number for channel in shown)
    more = (
        f"and {len(channels) - len(shown)} channels more, {sum(channel.mute for channel in channels)} of all are "
        "constant: --json lists all, and [channels] of a study (--study) names those wanted."
    )
    yield Table(
        build_columns(
            *("channel", *["no."] * has_numbers, "unit", "mean", "rms", "peak", "noise at most", "step", "drift"),
            left=(0, 1 + has_numbers),
        ),
        tuple(
            (
                channel.name,
                *[f"{channel.number or '-'}"] * has_numbers,
                channel.unit,
                *(format_number(value, 3) for value in (channel.mean, channel.rms, channel.peak)),
                format_number(channel.noise_floor or None, 2),
                format_number(channel.quantisation_step, 2),
                format_number(None if channel.mute else channel.drift, 2),
            )
            for channel in shown
        ),
        note=more if len(shown) < len(channels) else "",
    )
    faults = tuple((channel.name, *cells) for channel in shown if set(cells := _format_faults(channel)) != {"-"})
    if faults:
        yield Table(build_columns("channel", "missing", "clipped", "longest held", "spikes"), faults)


def _choose_telling(channels: Sequence[ChannelHealth]) -> Sequence[ChannelHealth]:
    """All channels, or of very many those that a page has room for, accelerations before others."""
    if len(channels) <= MOST_CHANNELS:
        return channels
    return sorted(channels, key=lambda c: (c.mute, c.unit != "m/s^2", c.unit == "?"))[:MOST_CHANNELS]


def _format_faults(channel: ChannelHealth) -> tuple[str, ...]:
    is_flat = any(stretch.kind == "flat" for stretch in channel.stretches)
    return (
        f"{channel.missing}" if channel.missing else "-",
        f"{channel.clipped_fraction:.2%}" if channel.clipped_fraction > 0 else "-",
        _format_seconds(channel.longest_flat_s) if is_flat else "mute" if channel.mute else "-",
        f"{channel.spikes}" if channel.spikes else "-",
    )


def _list_spectrum_blocks(channels: Sequence[ChannelHealth]) -> Iterator[Block]:
    """The lines of each channel, and the peaks that may be lines."""
    kinds = (
        ("Lines", [(each, [line for line in each.lines if line.resolved or line.name]) for each in channels]),
        ("Peaks", [(each, [line for line in each.lines if not (line.resolved or line.name)]) for each in channels]),
    )
    for kind, of_channels in kinds:
        some = [_say_lines(channel, lines) for channel, lines in of_channels if lines]
        more = len(some) - MOST_WITH_LINES
        more_channels = [f"{format_count(more, 'channel')} more (--json lists all)"] * (more > 0)
        yield Remarks(kind, (*some[:MOST_WITH_LINES], *more_channels))
        if some and kind == "Peaks":
            yield Paragraph("A peak may be a line or a resonance: the record cannot decide.")


def _say_lines(channel: ChannelHealth, lines: Sequence[SpectralLine]) -> str:
    unit = "" if channel.unit == "?" else f" {channel.unit}"
    shown = [
        f"{line.name or f'{format_number(line.frequency_hz, 4)} Hz'}, {format_number(line.rms, 2)}{unit} rms"
        for line in lines[:MOST_LINES]
    ]
    more = len(lines) - len(shown)
    return f"{escape_in_line(channel.name)}: " + "; ".join(shown) + (f"; and {more} weaker" if more > 0 else "")


# ---- pairs and findings ------------------------------------------------------------------------------


def _list_pair_blocks(pairs: Sequence[PairHealth]) -> Iterator[Block]:
    together = [pair for pair in pairs if pair.coherent_band_hz is not None or math.isfinite(pair.lag_s)]
    short = sum(pair.is_short for pair in pairs)
    more, apart = len(together) - MOST_PAIRS, len(pairs) - len(together) - short
    notes = [f"and {format_count(more, 'pair')} more (--json lists all)."] * (more > 0)
    notes += [f"{format_count(apart, 'pair')} of accelerations {'are' if apart > 1 else 'is'} not coherent."] * (
        apart > 0
    )
    notes += [f"The record is too short to compare {format_count(short, 'pair')} of accelerations."] * (short > 0)
    if together:
        heads = build_columns(
            "channel", "beside", "comes later by [ms]", "std. dev. [ms]", "coherent band", left=(0, 1)
        )
        rows = tuple((p.first, p.second, *_format_pair(p)) for p in together[:MOST_PAIRS])
        if any(row[2] == "-" for row in rows):
            notes.append(NO_LAG)
        yield Table(heads, rows, note=" ".join(notes))
    elif notes:
        yield Paragraph(" ".join(notes))


def _format_pair(pair: PairHealth) -> tuple[str, ...]:
    lag = ("-", "-")
    if math.isfinite(pair.lag_s):
        decimals = 3
        if math.isfinite(pair.lag_std_s) and pair.lag_std_s > 0:
            # the standard deviation keeps two digits, in ms
            decimals = min(6, max(0, 1 - math.floor(math.log10(1e3 * pair.lag_std_s))))
        lag = (f"{1e3 * pair.lag_s:.{decimals}f}", f"{1e3 * pair.lag_std_s:.{decimals}f}")
    band = pair.coherent_band_hz
    return *lag, "none" if band is None else f"{format_number(band[0], 3)} to {format_number(band[1], 3)} Hz"


def _list_mountings(health: Health) -> Iterator[Remarks]:
    """How each three-axis accelerometer is mounted, and how two of them are turned against each other."""
    sentences = [f"{escape_in_line(name)}: {say_orientation(found)}" for name, found in health.orientations.items()]
    sentences += [
        f"{escape_in_line(each.second)} against {escape_in_line(each.first)}: {say_alignment(each)}"
        for each in health.alignments
    ]
    if sentences:
        yield Remarks("Orientation", tuple(sentences))


def _list_findings(findings: Sequence[Finding]) -> Iterator[Remarks]:
    """The findings by severity; those with the same message, and many with the same code, together."""
    for severity in dict.fromkeys(finding.severity for finding in findings):
        sentences = list(_say_findings([finding for finding in findings if finding.severity == severity]))
        more = len(sentences) - MOST_NOTES if severity == "note" else 0
        if more > 0:
            sentences[MOST_NOTES:] = [f"and {format_count(more, 'note')} more (--json lists all)"]
        yield Remarks(severity.capitalize(), tuple(sentences), is_warning=severity != "note")


def _say_findings(findings: Sequence[Finding]) -> Iterator[str]:
    alike: dict[tuple[str, str], dict[str, list[str]]] = {}
    for finding in findings:
        message = finding.message.removeprefix(f"channel {finding.channel!r} ")
        # each remark says something else
        key = (finding.code, message if finding.code == "remark" else "")
        alike.setdefault(key, {}).setdefault(message, []).append(finding.channel)
    for by_message in alike.values():
        messages = list(by_message.items())
        concerned = list(dict.fromkeys(channel for channels in by_message.values() for channel in channels))
        # the findings of a single clock or channel are listed one by one
        is_merged = len(messages) > MOST_ALIKE and (len(concerned) > MOST_ALIKE or concerned == [""])
        for message, channels in messages[:1] if is_merged else messages:
            where = _say_names(channels)
            if is_merged:
                also = _say_names([channel for channel in concerned if channel not in channels])
                message += f" (likewise {also})" if also else f" (and {len(messages) - 1} times likewise)"
            yield f"{where}: {message}" if where else message


def _say_names(channels: Sequence[str]) -> str:
    names = list(dict.fromkeys(map(escape_in_line, filter(None, channels))))
    more = len(names) - MOST_CHANNELS // 5
    return ", ".join(names[: MOST_CHANNELS // 5]) + (f" and {more} more" if more > 0 else "")
