"""`opid campaign`: many flights at once."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import click

from opid.cli.group import NotDetermined, main
from opid.cli.options import PATH, Number, example, out_option
from opid.cli.output import Output, result_name, with_output
from opid.errors import InputError


@main.command(epilog=example("opid campaign fleet.toml --out fleet_2026 --workers 8"))
@click.argument("source", type=PATH, metavar="CAMPAIGN.toml | DIR")
@out_option("Folder for the results.  [default: NAME_campaign]")
@click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Processes on this machine.  [default: all processors]"
)
@click.option(
    "--scheduler", metavar="ADDRESS", help="A running Dask scheduler in their place, like tcp://10.0.0.1:8786."
)
@click.option(
    "--time-limit",
    "time_limit_s",
    type=Number("seconds, 600 for ten minutes"),
    default=600.0,
    show_default=True,
    metavar="S",
    help="A flight that takes longer has failed.",
)
@click.option("--pages", "with_pages", is_flag=True, help="Write a report page for each flight, 3 MB each.")
@with_output
def campaign(
    source: Path,
    workers: int | None,
    scheduler: str | None,
    time_limit_s: float,
    with_pages: bool,
    output: Output,
) -> None:
    """Identify many flights on Dask, and gather their values as a dataset that `opid compare` reads.

    CAMPAIGN.toml names a study file as a template and a table of flights, whose cells fill the template in; of a folder
    DIR each study file in it or below is a flight.

    A run that was stopped goes on where it ended: a flight is identified again only if its study, its logs, the options
    or the version of opid are no longer the same, or if its files were at fault, or with --force. A flight that fails,
    or takes too long, is reported with its reason and ends nothing.

    Exit status 0: each flight was tried. 1: none of them has an answer. 2: bad input.
    """
    from opid.campaigns.campaign_file import read_campaign
    from opid.campaigns.engine import refuse_another, run_campaign
    from opid.campaigns.flight_task import TaskSettings
    from opid.signals.files import make_directory
    from opid.suspensions.flights.campaign import INDEX_FILE, Verdict

    if workers is not None and scheduler is not None:
        raise click.UsageError("--workers and --scheduler are both given: give one of them")
    if not time_limit_s > 0:
        raise InputError(f"--time-limit is {time_limit_s:g}: give a positive number of seconds")
    plan = read_campaign(source)
    # A campaign goes on where an earlier run ended, in the same folder.
    output = replace(output, out=output.out or Path(f"{result_name(source)}_campaign"))
    if not output.overwrite:
        refuse_another(plan.title, output.folder)
    # The flights stand there as they are identified, and a second campaign must see that it is taken.
    make_directory(output.folder)
    output = output.reserve(())
    with output.progress() as say:
        found = run_campaign(
            plan,
            output.place,
            source=source,
            workers=workers,
            scheduler=scheduler,
            task_settings=TaskSettings(time_limit_s=time_limit_s, with_pages=with_pages, with_figures=output.figures),
            is_forced=output.overwrite,
            announce=None if output.quiet else _print_dashboard,
            progress=say,
        )
        command = ["opid", "campaign", str(source), "--out", str(output.folder)]
        notes = output.write(found, command=command, progress=say)
    before = f"{found.n_done_before} of {len(found.outcomes)} flights were done by an earlier run."
    output.show(found, notes=(*[before] * (found.n_done_before > 0), *notes))
    if not found.counts[Verdict.IDENTIFIED]:
        place = "stand above" if output.has_text else f"stand in {output.folder / INDEX_FILE}"
        raise NotDetermined(f"no flight has an answer: the reasons {place}")


def _print_dashboard(address: str) -> None:
    from tqdm import tqdm

    tqdm.write(f"Dashboard: {address}", file=sys.stderr)  # It stands above the line of progress, which is drawn again.
