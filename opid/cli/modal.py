"""Nonlinear modal models from sine beats: `opid modal`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from opid.cli.group import Output, example, main, report_note, result_name, with_output

FRACTION = click.FloatRange(min=0, max=1, min_open=True)


@main.command(epilog=example("opid modal bracket/study.toml --truth bracket/truth.json --out bracket_result"))
@click.argument("study", type=click.Path(path_type=Path), metavar="STUDY.toml")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For the report.  [default: STUDY_result]")
@click.option("--stiffness-order", type=click.IntRange(1, 5), metavar="N", help="N_s, whatever the study says.")
@click.option("--damping-order", type=click.IntRange(1, 5), metavar="N", help="N_d, whatever the study says.")
@click.option(
    "--free-linear/--fixed-linear",
    default=None,
    help="Correct frequency and damping in the fit, or not.  [default: as the study says, or the data]",
)
@click.option(
    "--frequency-threshold",
    type=FRACTION,
    metavar="X",
    help="Shift between levels, a fraction, from which a mode is nonlinear.  [default: as the study says, or 0.002]",
)
@click.option(
    "--damping-threshold",
    type=FRACTION,
    metavar="X",
    help="Likewise of its damping ratio.  [default: as the study says, or 0.15]",
)
@click.option(
    "--truth", type=click.Path(path_type=Path), metavar="JSON", help="truth.json of a simulation, to compare."
)
@with_output
def modal(study: Path, out: Path | None, truth: Path | None, output: Output, **settings: Any) -> None:
    """Identify a nonlinear modal model from linear modes and sine beats, and judge it by a truth test.

    Stiffness and damping of each nonlinear mode over its amplitude, with intervals, beside what the linear model makes
    of the same forces.

    The report goes to the folder STUDY_result here: bracket_result for bracket.toml, and for bracket/study.toml.

    `opid simulate sine-beats OUT` writes a study as a template, with logs to try it on; the study file, what to record
    and what the warnings mean stand in docs/nonlinear_modal_models.md.
    """
    from dataclasses import replace

    from opid.mechanics.truth import ModalTruth
    from opid.modal.identification import identify_modes
    from opid.modal.study import ModalStudy
    from opid.report import write_report
    from opid.report.nonlinear_modes import command_of
    from opid.studies.study_file import read_study
    from opid.virtual.files.truth import read_truth

    target = output.directory(out or Path(f"{result_name(study)}_result"))
    known = None if truth is None else read_truth(truth, ModalTruth)
    given = {name: value for name, value in settings.items() if value is not None}
    with output.progress() as say:
        tests = replace(read_study(study, kind=ModalStudy, progress=say), **given)
        result = identify_modes(tests, progress=say)
        page = write_report(
            result, target, known, command=command_of(result, given), figures=output.figures, progress=say
        )
    output.show(result, known, notes=report_note(page))
