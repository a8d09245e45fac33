"""Frequency and damping over amplitude of a free decay: `opid decay`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import Output, example, main, report_note, with_output
from opid.errors import InputError, NotDeterminedError

if TYPE_CHECKING:
    from opid.modal.decay.free_decay import Decay
    from opid.signals.recording import Recording

ORDERS = ("stiffness_order", "damping_order")
OPTIONS = tuple(
    (re.compile(setting), option)
    for setting, option in (
        (r"\bnear_hz\b", "--near"),
        (r"\bstart_s\b", "--start"),
        (r"\bstop_s\b", "--stop"),
        (r"\bstiffness_order\b", "--stiffness-order"),
        (r"\bdamping_order\b", "--damping-order"),
        (r"`?\btime_unit\b`?( in \[log\])?", "--time-unit"),
    )
)
"""Settings of the library, as its messages name them, and what they are called here."""


@main.command(epilog=example("opid decay ring_down.csv --channel tip_z --near 40 --out decay_result"))
@click.argument("log", type=click.Path(path_type=Path), metavar="LOG")
@click.option("--channel", required=True, metavar="NAME", help="Acceleration, velocity or displacement, by its unit.")
@click.option("--unit", metavar="UNIT", help="Of the channel (g, m/s^2, mm/s, ...), whatever the log says.")
@click.option("--time-unit", metavar="UNIT", help="Of the time column (s, ms, ...), whatever the log says.")
@click.option("--near", type=float, metavar="HZ", help="Frequency of the mode.  [default: the highest peak]")
@click.option("--start", type=float, metavar="S", help="Start of the decay, s from the first sample.  [default: found]")
@click.option("--stop", type=float, metavar="S", help="Its end, s from the first sample.  [default: found]")
@click.option("--stiffness-order", type=click.IntRange(1, 5), metavar="N", help="N_s, 1 is linear.  [default: found]")
@click.option("--damping-order", type=click.IntRange(1, 5), metavar="N", help="N_d, 1 is linear.  [default: found]")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For result.json, report and figure.")
@with_output
def decay(log: Path, out: Path | None, output: Output, **settings: Any) -> None:
    """Follow a free decay: frequency and damping over amplitude, and the law of the mode.

    From one sensor and no force. Where several modes ring in the sensor, `opid modal` separates them with the shapes.
    """
    from opid.report import write_report

    target = None if out is None else output.directory(out)
    with output.progress() as say:
        try:
            found = _decay(log, settings, say)
        except InputError as error:
            raise InputError(_in_options(str(error))) from error
        except NotDeterminedError as error:
            raise NotDeterminedError(_in_options(str(error)), error.partial) from error
        page = None if target is None else write_report(found, target, figures=output.figures, progress=say)
    output.show(found, notes=report_note(page))


def _decay(log: Path, settings: Mapping[str, Any], say: Callable[[str], None]) -> Decay:
    """The free decay in a channel of a log; what there is to doubt is said with the options of this command."""
    from opid.modal.decay.free_decay import QUANTITIES, UNITS, free_decay

    say("the record")
    record = _record(log, settings, UNITS)
    say("the decay")
    found = free_decay(
        record.samples[:, 0],
        fs=record.fs,
        quantity=QUANTITIES[UNITS.index(record.channels[0].unit)],
        near_hz=settings["near"],
        start_s=settings["start"],
        stop_s=settings["stop"],
        name=settings["channel"],
        **{name: settings[name] for name in ORDERS},
    )
    warnings = tuple(_in_options(text) for text in found.warnings)
    return replace(found, warnings=warnings, settings={"log": str(log), **settings}, files=record.files)


def _in_options(text: str) -> str:
    """A message of the library, which names its settings, with the options of this command in their place."""
    for setting, option in OPTIONS:
        text = setting.sub(option, text)
    return text


def _record(log: Path, settings: Mapping[str, Any], units: tuple[str, ...]) -> Recording:
    """The channel of a log in SI units; refused where these are none of a motion."""
    from opid.signals.conversion import recording_of
    from opid.signals.log_settings import ChannelSettings, LogSettings
    from opid.signals.logs import open_log

    channel, unit = settings["channel"], settings["unit"]
    how = LogSettings(time_unit=settings["time_unit"])
    opened = open_log(log, how)
    track, column = opened.find(channel)
    if unit is None and track.channels[column].unit is None:
        raise InputError(f"channel {channel!r} of {log} states no unit: give it, like --unit g, --unit mm/s")
    record = recording_of(opened, how, channels={channel: ChannelSettings(channel, unit=unit)})
    if record.channels[0].unit not in units:
        raise InputError(
            f"channel {channel!r} of {log} is in {record.channels[0].unit}: a free decay is followed in an "
            "acceleration, a velocity or a displacement; choose such a channel, or give the unit of its numbers, like "
            "--unit g"
        )
    return record
