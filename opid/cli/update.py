"""Bayesian updating and class selection from backbones: `opid update`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import main
from opid.cli.options import PATH, example, out_option, truth_option
from opid.cli.output import Output, result_name, with_output
from opid.errors import FileError, list_names

if TYPE_CHECKING:
    from opid.mechanics.truth import UpdatingTruth
    from opid.updating.result import Updating
    from opid.updating.structure.reduction import ReductionErrors
    from opid.updating.study import UpdatingStudy

N_COMPARED = 20
"""Number of modes in which the reduced structure is compared with the whole one."""


@main.command(epilog=example("opid update wing/study.toml --truth wing/truth.json --out wing_result"))
@click.argument("study", type=PATH, metavar="STUDY.toml")
@out_option("Folder for the report.  [default: NAME_result]")
@click.option(
    "--form",
    type=click.Choice(("recommended", "paper", "literal", "independent")),
    help="Form of the likelihood, whatever the study says.",
)
@click.option(
    "--sampler",
    type=click.Choice(("adaptive", "nuts", "transitional")),
    help="Sampler of the posterior, whatever the study says.",
)
@click.option(
    "--samples",
    "n_samples",
    type=click.IntRange(1000, 100_000_000),
    metavar="N",
    help="Samples of a class, whatever the study says.",
)
@click.option(
    "--confusion",
    "n_confused",
    type=click.IntRange(min=1),
    metavar="N",
    help="Draw N sets of curves with each class as the truth, and tell how often another class would be chosen.",
)
@click.option(
    "--joint/--apart",
    "is_joint",
    default=None,
    help="Update the linear parameters together with the laws, or before them; whatever the study says.",
)
@click.option("--seed", type=click.IntRange(min=0), metavar="N", help="Seed of the sampling, whatever the study says.")
@truth_option
@click.option("--chains", is_flag=True, help="Write the samples, too: netCDF files for ArviZ, and its diagnostics.")
@with_output
def update(study: Path, truth: Path | None, chains: bool, output: Output, **settings: Any) -> None:
    """Update a structure with nonlinear joints from its backbones, and choose the law of the joints.

    First the linear parameters from the lowest points, then the coefficients of every candidate law with their
    intervals, the evidence of each law, and the backbones that the best one predicts. The report goes to a new folder
    here, called after the study.
    """
    from dataclasses import replace

    from opid.mechanics.truth import UpdatingTruth
    from opid.studies.study_file import read_study
    from opid.updating.chain_files import CHAIN_FILES, require_arviz, write_chains
    from opid.updating.identification import update_study
    from opid.updating.study import UpdatingStudy
    from opid.virtual.truth_file import read_truth

    output = output.reserve(default=f"{result_name(study)}_result")
    known = None if truth is None else read_truth(truth, UpdatingTruth)
    if chains:
        require_arviz()
    given = {name: value for name, value in settings.items() if value is not None}
    with output.progress() as say, output.name_files(study):
        tests = replace(read_study(study, kind=UpdatingStudy, progress=say), **given)
        if known is not None:
            _require_joints(tests, known, truth)
        found = update_study(tests, progress=say)
        result = replace(found, reductions=_compare_reductions(tests, found))
        with output.together(CHAIN_FILES):
            notes = output.write(result, known, progress=say)
            files = write_chains(result, output.place) if chains else ()
    output.show(result, known, notes=(*notes, *(f"Chains: {file}" for file in files)))


def _require_joints(study: UpdatingStudy, known: UpdatingTruth, truth: Path | None) -> None:
    """Refuse a truth that is of another structure, whose joints have other names."""
    without = [joint for joint in study.structure.joints if joint not in known.laws]
    if without:
        raise FileError(
            f"{truth} has the laws of the joints {list_names(known.laws)}, and the study has {list_names(without)}: "
            "give the truth that was written beside this study, or leave it out"
        )


def _compare_reductions(study: UpdatingStudy, result: Updating) -> tuple[ReductionErrors, ...]:
    """Return the errors of both reductions, that in use first; nothing if the study gives no whole structure."""
    from opid.updating.structure.affine import AffineStructure
    from opid.updating.structure.reduction import craig_bampton, reduction_errors

    structure, linear = study.structure, result.linear
    if not isinstance(structure, AffineStructure):
        return ()
    factors = {} if linear is None else {n: float(v) for n, v in zip(linear.names, linear.best, strict=True)}

    def compare_reduced(method: str) -> ReductionErrors:
        reduced = craig_bampton(structure, factors, n_modes=study.n_kept, method=method)
        return reduction_errors(structure, reduced, min(N_COMPARED, reduced.n_dof), factors=factors)

    return compare_reduced("fixed"), compare_reduced("free")
