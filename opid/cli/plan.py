"""`opid plan`: which runs are worth making."""

from __future__ import annotations

from pathlib import Path

import click

from opid.cli.group import main
from opid.cli.options import PATH, Number, example, out_option
from opid.cli.output import Output, result_name, with_output


@main.command(epilog=example("opid plan guess.toml --target sprung_mass=0.5%"))
@click.argument("source", type=PATH, metavar="STUDY.toml | GUESS.toml")
@click.option(
    "--target",
    "targets",
    multiple=True,
    required=True,
    metavar="NAME=STD",
    help="A standard deviation to reach: sprung_mass=0.5%, or x_cg_m=0.01 in the unit of the number; once for each.",
)
@click.option(
    "--mass-change",
    "changes_kg",
    multiple=True,
    type=Number("kg, negative for what is taken off"),
    metavar="KG",
    help="A mass change to try; once for each.  [default: those of the guess, or 5 to 30 % of the mass]",
)
@click.option(
    "--duration",
    "durations_s",
    multiple=True,
    type=Number("seconds"),
    metavar="S",
    help="A duration of a run to try; once for each.  [default: those of the guess, or 20 to 640 s]",
)
@click.option("--law", help="The law of a study, one of `opid laws`; sums joined by +.  [default: searched]")
@out_option("Folder for the report.  [default: NAME_plan]")
@with_output
def plan(
    source: Path,
    targets: tuple[str, ...],
    changes_kg: tuple[float, ...],
    durations_s: tuple[float, ...],
    law: str | None,
    output: Output,
) -> None:
    """Plan runs: what they will determine, what they cannot tell apart, and the cheapest plan for the targets.

    GUESS.toml states a guessed gear in a table [gear], the road, the sensors and the planned runs [[runs]]; virtual
    runs take their place. Of a study, runs are planned that add to those that it has.

    Standard deviations are those that `opid identify` will state if the guess is right. The cheapest plan is the one
    with the smallest sum of the costs of runs, seconds and kilograms, in minutes of the crew where the guess states no
    [costs]. Exit status 1: no plan that was tried reaches the targets.
    """
    from dataclasses import replace

    from opid.planning.guess import is_guess, plan as plan_source, read_guess
    from opid.studies.study_file import read_study
    from opid.suspensions.planning.search import SearchSpace
    from opid.suspensions.study import Study

    output = output.reserve(default=f"{result_name(source)}_plan")
    with output.progress() as say, output.name_files(source):
        known = read_guess(source) if is_guess(source) else read_study(source, kind=Study, progress=say)
        space = SearchSpace() if isinstance(known, Study) else known.search
        space = replace(
            space,
            mass_changes_kg=changes_kg or space.mass_changes_kg,
            durations_s=durations_s or space.durations_s,
        )
        result = plan_source(known, targets, law=law, search=space, progress=say)
        notes = output.write(result, progress=say)
    output.show(result, notes=notes)
