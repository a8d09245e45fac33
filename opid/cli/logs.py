"""What is in a log: `opid inspect`."""

from __future__ import annotations

from pathlib import Path

import click

from opid.cli.group import main


@main.command()
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Leave a picture of each log there.")
def inspect(logs: tuple[Path, ...], as_json: bool, out: Path | None) -> None:
    """Say what is in a log, and what is wrong with it."""
    from opid.report import health_json, health_text
    from opid.report.as_json import json_text
    from opid.signals.health import inspect as inspect_recording
    from opid.signals.logs import read_log

    logs = tuple(dict.fromkeys(logs))
    recordings = {str(log): read_log(log) for log in logs}
    health = {log: inspect_recording(recording) for log, recording in recordings.items()}
    if out is not None:
        from opid.plots import figure_of, png, recording
        from opid.report.directory import write_together

        names = _distinct([log.stem for log in logs])
        drawn = (png(figure_of(recording(each))) for each in recordings.values())
        write_together(out, {f"{name}.png": image for name, image in zip(names, drawn, strict=True)})
    if as_json:
        click.echo(json_text(health_json(health)), nl=False)
        return
    click.echo("\n".join(health_text(log, each) for log, each in health.items()), nl=False)
    if out is not None:
        click.echo("\nPictures: " + ", ".join(str(out / f"{name}.png") for name in names))


def _distinct(names: list[str]) -> list[str]:
    """Number the names that stand there twice."""
    return [f"{name}_{names[:i].count(name) + 1}" if names.count(name) > 1 else name for i, name in enumerate(names)]
