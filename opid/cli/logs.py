"""What is in a log: `opid inspect`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from opid.cli.group import BadInput, main, progress
from opid.errors import InputError

if TYPE_CHECKING:
    from opid.signals.health_result import Health
    from opid.signals.log_settings import ChannelSettings, LogSettings

CHANNELS_A_PICTURE, MOST_PICTURES = 12, 4


@main.command()
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option(
    "--study",
    type=click.Path(path_type=Path),
    metavar="STUDY.toml",
    help="Read the logs, and their channels that it names, as this study file says.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Leave pictures of each log there.")
def inspect(logs: tuple[Path, ...], study: Path | None, as_json: bool, out: Path | None) -> None:
    """Say what is in a log, and what is wrong with it.

    A log that cannot be read is told, and the others still inspected; the status is then 2.
    """
    from opid.report import health_json, health_text
    from opid.report.as_json import json_text
    from opid.report.directory import require_directory

    if out is not None:
        require_directory(out)
    settings, channels = _as_studied(study)
    found: dict[Path, Health] = {}
    failures = []
    for log in dict.fromkeys(logs):
        try:
            found[log] = _health(log, settings, channels)
        except InputError as error:
            failures.append(str(error))
            continue
        if not as_json:
            click.echo("\n" * (len(found) > 1) + health_text(str(log), found[log]), nl=False)
    if as_json and found:
        document = health_json({str(log): health for log, health in found.items()})
        click.echo(_printable(json_text(document)), nl=False)
    if out is not None and found:
        pictures = _write_pictures(found, out)
        if not as_json:
            click.echo(_printable("\nPictures: " + ", ".join(str(out / name) for name in pictures)))
            for log, health in found.items():
                if len(drawn := _drawn(health)) < len(health.channels):
                    words = f"{len(drawn)} of the {len(health.channels)} channels of {log} are drawn"
                    click.echo(_printable(f"{words}: name those wanted in [channels] of a study"))
    for failure in failures[:-1]:
        click.echo(f"Error: {failure}", err=True)
    if failures:
        raise BadInput(failures[-1])


def _as_studied(study: Path | None) -> tuple[LogSettings, Mapping[str, ChannelSettings] | None]:
    """How the logs are to be read, and which of their channels."""
    from opid.identify.study_file import read_log_settings
    from opid.signals.log_settings import AS_WRITTEN

    if study is None:
        return AS_WRITTEN, None
    settings, channels = read_log_settings(study)
    return settings, channels or None


def _health(log: Path, settings: LogSettings, channels: Mapping[str, ChannelSettings] | None) -> Health:
    from opid.signals.health import inspect as inspect_log
    from opid.signals.logs import open_log

    with progress() as say:
        say(log.name)
        opened = open_log(log, settings)
        return inspect_log(
            opened, settings, channels=channels, progress=lambda part: say(f"{log.name}, {part:.0%} read")
        )


def _write_pictures(found: Mapping[Path, Health], out: Path) -> list[str]:
    """Draw each log, some channels on every picture, and return the names of the files."""
    from opid.plots import figure_of, health_picture, png
    from opid.report.directory import write_together

    images = {}
    for stem, health in zip(_distinct([log.stem for log in found]), found.values(), strict=True):
        names = _drawn(health)
        parts = [names[i : i + CHANNELS_A_PICTURE] for i in range(0, len(names), CHANNELS_A_PICTURE)]
        for number, part in enumerate(parts, 1):
            name = f"{stem}.png" if len(parts) == 1 else f"{stem}_part{number}.png"
            with progress() as say:
                say(name)
                images[name] = png(figure_of(health_picture(health, channels=part)))
    write_together(out, images)
    return list(images)


def _drawn(health: Health) -> list[str]:
    """The names of the channels to draw: all, or of hundreds the first, accelerations before others."""
    most = CHANNELS_A_PICTURE * MOST_PICTURES
    by_kind = sorted(health.channels, key=lambda channel: channel.unit != "m/s^2")
    return [channel.name for channel in (health.channels if len(by_kind) <= most else by_kind[:most])]


def _printable(text: str) -> str:
    """What any terminal takes: a file name need not be UTF-8."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _distinct(names: list[str]) -> list[str]:
    """Number the names that stand there twice."""
    return [f"{name}_{names[:i].count(name) + 1}" if names.count(name) > 1 else name for i, name in enumerate(names)]
