"""Virtual tests of structures with nonlinear modes: `opid simulate sine-beats`, `resonance` and `backbones`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import click

from opid.cli.options import PATH, example, seed_option
from opid.cli.output import Output, with_files
from opid.cli.virtual_tests import STUDY_FILES, simulate
from opid.progress import Say

if TYPE_CHECKING:
    import numpy as np

    from opid.mechanics.backbones.jointed_modes import JointedModes
    from opid.updating.measured import MeasuredBackbone
    from opid.updating.model_class import ModelClass

DRIVE, DAMPING_RATIO = "7", 0.003
"""Sensor at which the shaker acts, as in the paper, and damping ratio of every mode."""

RECORDED = (3,)
"""Higher harmonics of the sensors in the files of backbones."""

FEWEST_CONTROLLED = 10
"""Points of a curve of a controlled test; with fewer, larger steps it loses quadrature after a minute."""


case_option = click.option(
    "--case",
    type=click.Choice(("cubic", "1", "2")),
    default="cubic",
    show_default=True,
    help="cubic: one mode with a known law; 1: 18 modes, 5 nonlinear; 2: 26 modes, one to 300 g.",
)
noise_option = click.option(
    "--noise",
    type=click.FloatRange(min=0),
    default=0.01,
    show_default=True,
    metavar="X",
    help="Noise, a fraction of each channel's rms.",
)


@simulate.command("sine-beats", epilog=example("opid simulate sine-beats bracket --case cubic"))
@click.argument("out", type=PATH)
@case_option
@seed_option("the noise")
@noise_option
@click.option(
    "--shaker/--no-shaker",
    default=None,
    help="Force from a shaker, or given as it is.  [default: given in case cubic, else a shaker]",
)
@click.option(
    "--frequency-error", default=0.0, show_default=True, metavar="%", help="Error of frequencies in modes.npz."
)
@click.option("--damping-error", default=0.0, show_default=True, metavar="%", help="Error of damping in modes.npz.")
@with_files
def sine_beats(
    case: str,
    seed: int,
    noise: float,
    shaker: bool | None,
    output: Output,
    **errors_percent: float,
) -> None:
    """Write a series of modal tests of a bolted structure into the directory OUT.

    Impacts at three levels, sine beats at several for each nonlinear mode, and a truth test. Makes modes.npz, the logs,
    study.toml for `opid modal`, and truth.json.
    """
    import numpy as np

    from opid.virtual.modal_tests.series import modal_truth, stated_modes, virtual_series, virtual_study
    from opid.virtual.truth_file import write_field_test

    output = output.reserve(("modes.npz", *STUDY_FILES))
    settings = {"case": case, "seed": seed, "noise": noise, "shaker": shaker}
    settings |= {f"{name}_percent": value for name, value in errors_percent.items()}
    with output.progress() as say:
        say("the highest levels")
        series = virtual_series(case, shaker=shaker)
        fractions = {name: value / 100 for name, value in errors_percent.items()}
        stated = stated_modes(series.case.modes, **fractions)
        rng = np.random.default_rng(seed)
        study = virtual_study(series, rng=rng, noise_fraction=noise, given=stated, progress=say)
        say("the files")
        path = write_field_test(study, modal_truth(series, settings=settings), output.place)
    output.show_made(f"{len(study.tests)} tests: {series.case.text}", "modal", path)


@simulate.command("resonance", epilog=example("opid simulate resonance bracket --levels 20"))
@click.argument("out", type=PATH)
@case_option
@seed_option("the noise")
@click.option(
    "--levels",
    type=click.IntRange(2, 10_000),
    default=70,
    show_default=True,
    metavar="N",
    help="Levels of the voltage.",
)
@click.option(
    "--curves",
    type=click.IntRange(0, 1000),
    default=0,
    show_default=True,
    metavar="N",
    help="Stepped-sine response curves beside the levels.",
)
@noise_option
@click.option(
    "--phase-error", default=0.0, show_default=True, metavar="DEG", help="Phase by which the loop misses quadrature."
)
@with_files
def resonance_logs(
    case: str, seed: int, levels: int, curves: int, noise: float, phase_error: float, output: Output
) -> None:
    """Write a force appropriation of a nonlinear mode, level after level, into the directory OUT.

    Makes modes.npz, the log, a CSV file for each response curve, study.toml for `opid resonance`, and truth.json.
    """
    import numpy as np

    from opid.virtual.modal_tests.resonance_logs import resonance_study
    from opid.virtual.modal_tests.series import modal_truth, virtual_series
    from opid.virtual.truth_file import write_field_test

    output = output.reserve(("modes.npz", *STUDY_FILES))
    settings = {"case": case, "seed": seed, "levels": levels, "curves": curves, "noise": noise}
    settings |= {"phase_error_deg": phase_error}
    with output.progress() as say:
        series = virtual_series(case)
        study = resonance_study(
            series,
            rng=np.random.default_rng(seed),
            n_levels=levels,
            n_curves=curves,
            noise_fraction=noise,
            phase_error_deg=phase_error,
            progress=say,
        )
        say("the files")
        path = write_field_test(study, modal_truth(series, settings=settings), output.place)
    made = f"{levels} levels" + (f", {curves} response curves" if curves else "")
    output.show_made(f"{made}: {series.case.text}", "resonance", path)


@simulate.command("backbones", epilog=example("opid simulate backbones wing --true-class 2 --points 20"))
@click.argument("out", type=PATH)
@click.option(
    "--by",
    type=click.Choice(("synthetic", "continuation")),
    default="synthetic",
    show_default=True,
    help="synthetic: harmonic balance and drawn errors; continuation: a controlled shaker test, simulated in time.",
)
@seed_option("the errors")
@click.option(
    "--true-class",
    type=click.IntRange(1, 5),
    default=2,
    show_default=True,
    metavar="N",
    help="Number of the law, 1 to 5 in the paper.",
)
@click.option(
    "--other-class",
    type=click.IntRange(1, 5),
    metavar="N",
    help="Number of the law of the second pylon.  [default: that of the first]",
)
@click.option(
    "--points", type=click.IntRange(3, 10_000), default=20, show_default=True, metavar="N", help="Points of each curve."
)
@click.option(
    "--curves",
    type=click.IntRange(1, 1000),
    nargs=2,
    default=(14, 5),
    show_default=True,
    metavar="N N",
    help="Curves of either mode, at most; in a controlled test one for each sensor that reaches quadrature.",
)
@click.option(
    "--linear-error",
    type=click.FloatRange(min=0),
    default=0.4,
    show_default=True,
    metavar="%",
    help="Standard deviation of the linear frequencies of a synthetic set.",
)
@click.option(
    "--matrices",
    type=click.Choice(("npz", "mat", "mtx")),
    default="npz",
    show_default=True,
    help="Files of the matrices: numpy's, MATLAB's, or one of Matrix Market for each.",
)
@with_files
def backbones(
    by: str,
    seed: int,
    true_class: int,
    other_class: int | None,
    points: int,
    curves: tuple[int, int],
    linear_error: float,
    matrices: Literal["npz", "mat", "mtx"],
    output: Output,
) -> None:
    """Write backbones of the wing-engine structure, with known truth, into the directory OUT.

    Makes the nominal matrices with two factors to update, one CSV file a curve, study.toml for `opid update` with the
    five classes of the paper, or with those in which the pylons share a law or do not, and truth.json.
    """
    import numpy as np

    from opid.errors import InputError
    from opid.mechanics.laws.law import Law
    from opid.mechanics.truth import UpdatingTruth
    from opid.report.document import format_count
    from opid.studies.updating_study import FACTOR_PRIOR
    from opid.updating.model_class import PAPER_CLASSES, PAPER_THETA
    from opid.updating.structure.reduction import reduce
    from opid.updating.study import UpdatingStudy
    from opid.virtual.backbone_tests.measured import synthetic_backbones
    from opid.virtual.backbone_tests.wing_engine import (
        UPDATED,
        laws_of_pylons,
        replace_matrices,
        wing_engine_structure,
    )
    from opid.virtual.truth_file import write_field_test

    if by == "continuation" and points < FEWEST_CONTROLLED:
        raise InputError(
            f"--points is {points}, and a controlled test loses quadrature between points so far apart: give at least "
            f"{FEWEST_CONTROLLED}, or leave out --by continuation"
        )
    output = output.reserve(STUDY_FILES)
    settings = {"by": by, "seed": seed, "true_class": true_class, "points": points, "curves": list(curves)}
    settings |= {"linear_error_percent": linear_error} if by == "synthetic" else {"damping_ratio": DAMPING_RATIO}
    true = PAPER_CLASSES[true_class - 1]
    theta = PAPER_THETA[true.name]
    classes: tuple[ModelClass, ...] = PAPER_CLASSES
    if other_class is not None:
        settings["other_class"] = other_class
        other = PAPER_CLASSES[other_class - 1]
        theta += PAPER_THETA[other.name]
        pairs = [(true, other), (other, true)] if other is not true else [(true, true)]
        classes = (*dict.fromkeys((true, other)), *(laws_of_pylons(*pair) for pair in pairs))
        true = laws_of_pylons(true, other)
    with output.progress() as say:
        say("the structure")
        structure = wing_engine_structure()
        system = reduce(structure, UPDATED)
        rng = np.random.default_rng(seed)
        if by == "synthetic":
            measured = synthetic_backbones(
                system, true, theta, rng=rng, n_curves=curves, n_points=points, linear_error=linear_error / 100,
                recorded=RECORDED,
            )  # fmt: skip
        else:
            measured = _measure_by_continuation(system, true, theta, rng, points, curves, say)
        study = UpdatingStudy(
            f"Virtual backbones of a wing-engine structure, seed {seed}", structure, measured, classes,
            parameters=dict.fromkeys(UPDATED, FACTOR_PRIOR), seed=seed,
        )  # fmt: skip
        say("the files")
        description = f"the wing-engine structure, {structure.n_dof} degrees of freedom, {true.name} with theta {theta}"
        laws = {joint: Law(each.terms) for joint, each in true.laws(system.joints, theta).items()}
        truth = UpdatingTruth(UPDATED, laws, description, settings)
        with output.together() as folder:
            path = write_field_test(study, truth, output.place)
            if matrices != "npz" and folder is not None:
                replace_matrices(structure, folder, matrices)
    output.show_made(f"{format_count(len(measured), 'backbone')}: {description}", "update", path)


def _measure_by_continuation(
    system: JointedModes,
    true: ModelClass,
    theta: tuple[float, ...],
    rng: np.random.Generator,
    points: int,
    curves: tuple[int, int],
    say: Say,
) -> tuple[MeasuredBackbone, ...]:
    from opid.errors import NotDeterminedError
    from opid.mechanics.backbones.specimen import Specimen
    from opid.virtual.backbone_tests.measured import AMPLITUDE_M, BENDING_MODES, virtual_backbones

    specimen = Specimen(system, tuple(true.laws(system.joints, theta).values()), DAMPING_RATIO, DRIVE)
    measured: list[MeasuredBackbone] = []
    for mode, amplitude, wanted in zip(BENDING_MODES, AMPLITUDE_M, curves, strict=True):
        reached, reason = 0, ""
        # The pylons move most, and reach quadrature first.
        for sensor in reversed(system.sensors):
            if reached == wanted:
                break
            say(f"mode {mode}: quadrature at sensor {sensor}, {reached} of {wanted} curves")
            try:
                measured += virtual_backbones(
                    specimen, rng=rng, modes=(mode,), amplitude_m=(amplitude,), n_points=points, sensors=(sensor,),
                    recorded=RECORDED,
                )  # fmt: skip
            except NotDeterminedError as error:
                reason = str(error)
                continue  # The paper leaves such sensors out, too: 9 of 14 in the second mode.
            reached += 1
        if not reached:
            raise NotDeterminedError(
                f"no sensor reaches quadrature in mode {mode}, the last: {reason}; more --points make smaller steps",
                tuple(measured),
            )
    return tuple(measured)
