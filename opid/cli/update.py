"""Bayesian updating and class selection from backbones: `opid update`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import Output, example, main, report_note, result_name, with_output

if TYPE_CHECKING:
    from opid.updating.result import Updating
    from opid.updating.structure.reduction import ReductionErrors
    from opid.updating.study import UpdatingStudy

N_COMPARED = 20
"""Modes of the reduced structure that are compared with those of the whole one."""


@main.command(epilog=example("opid update wing/study.toml --truth wing/truth.json --out wing_result"))
@click.argument("study", type=click.Path(path_type=Path), metavar="STUDY.toml")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For the report.  [default: NAME_result]")
@click.option(
    "--form",
    type=click.Choice(("recommended", "paper", "literal", "independent")),
    help="Of the likelihood, whatever the study says.",
)
@click.option(
    "--sampler",
    type=click.Choice(("adaptive", "metropolis", "transitional", "ensemble")),
    help="Of the posterior, whatever the study says.",
)
@click.option("--samples", type=click.IntRange(min=1000), metavar="N", help="Of each class, whatever the study says.")
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Of the sampling, whatever the study says.")
@click.option(
    "--truth", type=click.Path(path_type=Path), metavar="JSON", help="truth.json of a simulation, to compare."
)
@click.option("--chains", is_flag=True, help="Write the samples beside the report, too: netCDF files for ArviZ.")
@with_output
def update(study: Path, out: Path | None, truth: Path | None, chains: bool, output: Output, **settings: Any) -> None:
    """Update a structure with nonlinear joints from its backbones, and tell which law the joints have.

    First the linear parameters from the lowest points, then the coefficients of every candidate law with their
    intervals, the evidence of each law, and the backbones that the best one predicts. The report goes to a new folder
    here, called after the study.
    """
    from dataclasses import replace

    from opid.mechanics.truth import UpdatingTruth
    from opid.report import write_report
    from opid.report.chains import require_arviz, write_chains
    from opid.studies.study_file import read_study
    from opid.updating.identification import update_study
    from opid.updating.study import UpdatingStudy
    from opid.virtual.files.truth import read_truth

    target = output.directory(out or Path(f"{result_name(study)}_result"))
    known = None if truth is None else read_truth(truth, UpdatingTruth)
    if chains:
        require_arviz()
    given = {name.replace("samples", "n_samples"): value for name, value in settings.items() if value is not None}
    with output.progress() as say:
        tests = replace(read_study(study, kind=UpdatingStudy, progress=say), **given)
        found = update_study(tests, progress=say)
        result = replace(found, reductions=_reductions(tests, found))
        page = write_report(result, target, known, figures=output.figures, progress=say)
        files = write_chains(result, target) if chains else ()
    output.show(result, known, notes=(*report_note(page), *(f"Chains: {file}" for file in files)))


def _reductions(study: UpdatingStudy, result: Updating) -> tuple[ReductionErrors, ...]:
    """How both reduced structures differ from the whole one, the one that was used first; none with none to reduce."""
    from opid.updating.structure.affine import AffineStructure
    from opid.updating.structure.reduction import craig_bampton, reduction_errors

    structure, linear = study.structure, result.linear
    if not isinstance(structure, AffineStructure):
        return ()
    factors = {} if linear is None else {n: float(v) for n, v in zip(linear.names, linear.best, strict=True)}

    def errors(method: str) -> ReductionErrors:
        reduced = craig_bampton(structure, factors, n_modes=study.n_internal, method=method)
        return reduction_errors(structure, reduced, min(N_COMPARED, reduced.n_dof), factors=factors)

    return errors("fixed"), errors("free")
