"""What is in a log: `opid inspect`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from opid.cli.group import BadInput, main
from opid.cli.options import PATH, example, out_option, time_unit_option, unit_option
from opid.cli.output import REPORT, Output, with_output
from opid.errors import InputError, escape_invisible
from opid.progress import Say, Step

if TYPE_CHECKING:
    from opid.signals.health.result import Health
    from opid.signals.log import LogSettings
    from opid.studies.suspension_study import LogReading


@main.command(epilog=example("opid inspect heavy.csv light.csv --out inspected"))
@click.argument("logs", nargs=-1, required=True, type=PATH, metavar="LOG...")
@click.option(
    "--study",
    type=PATH,
    metavar="STUDY.toml",
    help="Read the logs, and the channels that its runs take from them, as this study file says.",
)
@unit_option
@time_unit_option
@out_option("Folder for result.json, report and a picture of each log.")
@with_output
def inspect(
    logs: tuple[Path, ...], study: Path | None, unit: str | None, time_unit: str | None, output: Output
) -> None:
    """Say what is in a log, and what is wrong with it.

    A log that cannot be read gets a sentence, and the others are inspected even so; the status is then 2.
    """
    from opid.report import text
    from opid.report.health import say_channels_left_out
    from opid.signals.files import shorten_name
    from opid.signals.health.result import Inspection
    from opid.signals.log import AS_WRITTEN, LogSettings

    studies = [log for log in logs if log.suffix.lower() == ".toml"]
    if studies:
        raise click.UsageError(
            f"{studies[0]} is a study, no log: name the logs and say how to read them, "
            f"opid inspect LOG... --study {studies[0]}"
        )
    units = LogSettings(unit=unit, time_unit=time_unit)
    if study is not None and units != AS_WRITTEN:
        raise click.UsageError(f"--study {study} says how its logs are read: leave --unit and --time-unit out")
    readings = [(log, reading) for log in dict.fromkeys(logs) for reading in _choose_readings(log, study, units)]
    names = [shorten_name(log.stem) for log, _ in readings]
    stems_of_pictures = dict.fromkeys(names + _number_alike(names))
    pictures = [f"{stem}{end}.png" for stem in stems_of_pictures for end in ("", "_part1", "_orientation")]
    output = output.reserve((*REPORT, *pictures))
    found: list[Health] = []
    stems: list[str] = []
    failures = []
    for log, reading in readings:
        several = [each for each, _ in readings].count(log) > 1
        title = f"{log} ({', '.join(reading.channels)})" if several and reading.channels else str(log)
        try:
            with output.progress() as say:
                found.append(replace(_check_log(log, reading, study, say), log=title))
            stems.append(shorten_name(log.stem))
        except InputError as error:
            failures.append(str(error))
            continue
        if output.has_text:
            click.echo("\n" * (len(found) > 1) + text(found[-1]), nl=False)
    if found:
        result = Inspection(tuple(found), tuple(_number_alike(stems)))
        options = {"--study": study, "--unit": unit, "--time-unit": time_unit}
        given = [word for name, value in options.items() if value is not None for word in (name, str(value))]
        words = ["opid", "inspect", *map(str, dict.fromkeys(logs)), *given]
        with output.progress() as say:
            notes = output.write(result, command=words, progress=say)
        left_out = map(say_channels_left_out, found) if output.figures and notes else ()
        if output.as_json:
            output.show(result)
        elif output.has_text and notes:
            click.echo(escape_invisible("\n" + "\n".join((*notes, *filter(None, left_out)))))
    for failure in failures[:-1]:
        click.echo(escape_invisible(f"Error: {failure}"), err=True)
    if failures:
        raise BadInput(failures[-1])


def _choose_readings(log: Path, study: Path | None, units: LogSettings) -> tuple[LogReading, ...]:
    """Return how the log is to be read, and which of its channels."""
    from opid.studies.suspension_study import LogReading, find_log_readings

    return (LogReading(units),) if study is None else find_log_readings(study, log)


def _check_log(log: Path, reading: LogReading, study: Path | None, say: Say) -> Health:
    from opid.provenance import read_file
    from opid.signals.health.inspection import inspect as inspect_log
    from opid.signals.health.result import Finding
    from opid.signals.logs import open_log

    say(log.name)
    health = inspect_log(
        open_log(log, reading.settings),
        reading.settings,
        channels=reading.channels,
        progress=lambda fraction: say(Step(log.name, fraction)),
    )
    if study is None:
        return health
    health = replace(health, files=(read_file(study), *health.files))
    words = _describe_choice(reading.runs)
    if not words:
        return health
    return replace(health, findings=(*health.findings, Finding("note", "channels_chosen", "", words)))


def _describe_choice(runs: tuple[str, ...]) -> str:
    """Return a sentence that says as part of which run a log is shown; "" if only one run uses it."""
    if not runs:
        return "no run of the study takes a channel from this log: all are shown, read as [log] says"
    others = ", ".join(map(repr, runs[1:]))
    return f"read as run {runs[0]!r} says; {others} use{'s' * (len(runs) == 2)} this log, too" if others else ""


def _number_alike(names: list[str]) -> list[str]:
    """Return the names, with a number behind those that occur more than once."""
    return [f"{name}_{names[:i].count(name) + 1}" if names.count(name) > 1 else name for i, name in enumerate(names)]
