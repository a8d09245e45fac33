"""Results of many flights against each other: `opid compare`."""

from __future__ import annotations

from pathlib import Path

import click

from opid.cli.group import Output, example, main, report_note, with_output

CHANGED = 3
"""Exit status where a change is flagged; 1 and 2 mean what they mean everywhere."""


@main.command(epilog=example("opid compare flight_1 flight_2 flight_3 --out health"))
@click.argument("results", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RESULT...")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For comparison.json, report and figures.")
@click.option(
    "--false-alarm",
    type=float,
    metavar="P",
    help="Chance of any flag in the whole comparison if nothing changed.  [default: 0.001]",
)
@with_output
def compare(results: tuple[Path, ...], out: Path | None, false_alarm: float | None, output: Output) -> None:
    """Say what changed from flight to flight by more than its uncertainty.

    RESULT is a result.json of `opid identify`, a folder with one, or a folder of such folders. They are taken by the
    dates in the study files (`date = 2026-03-01`), else as they are given.

    A flight that is not determined, or for which no structure was recommended, is left out and named.

    Exit status 0: nothing is flagged. 1: fewer than two flights can be compared, for want of values with intervals. 2:
    bad input. 3: a change is flagged.
    """
    from opid.report import write_report
    from opid.suspensions.flights.comparison import compare as compare_flights
    from opid.suspensions.flights.results import read_flights

    target = None if out is None else output.directory(out, ("comparison.json", "report.html"))
    with output.progress() as say:
        say("the results")
        found = compare_flights(read_flights(results), false_alarm=false_alarm)
        command = ["opid", "compare", *map(str, results)]
        page = (
            None
            if target is None
            else write_report(found, target, command=command, figures=output.figures, progress=say)
        )
    output.show(found, notes=report_note(page))
    if found.changes:
        click.get_current_context().exit(CHANGED)
