"""A virtual series of modal tests: `opid simulate sine-beats`."""

from __future__ import annotations

from pathlib import Path

import click

from opid.cli.group import example, free_directory, progress, show_next, with_force
from opid.cli.virtual_tests import STUDY_FILES, simulate


@simulate.command("sine-beats", epilog=example("opid simulate sine-beats bracket --case cubic"))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--case",
    type=click.Choice(("cubic", "1", "2")),
    default="cubic",
    show_default=True,
    help="cubic: one mode with a known law; 1: 18 modes, 5 nonlinear; 2: 26 modes, one to 300 g.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of the noise.")
@click.option("--noise", type=click.FloatRange(min=0), default=0.01, show_default=True, help="Of each channel's rms.")
@click.option(
    "--shaker/--no-shaker",
    default=None,
    help="Force from a shaker, or given as it is.  [default: given in case cubic, else a shaker]",
)
@click.option("--frequency-error", default=0.0, show_default=True, metavar="%", help="Of the frequencies in modes.npz.")
@click.option("--damping-error", default=0.0, show_default=True, metavar="%", help="Of the damping in modes.npz.")
@with_force
def sine_beats(
    out: Path,
    case: str,
    seed: int,
    noise: float,
    shaker: bool | None,
    frequency_error: float,
    damping_error: float,
    overwrite: bool,
) -> None:
    """Write a series of modal tests of a bolted structure into the directory OUT.

    Impacts at three levels, sine beats at several for each nonlinear mode, and a truth test. Makes modes.npz, the logs,
    study.toml for `opid modal`, and truth.json.
    """
    import numpy as np

    from opid.virtual.files.modal import modal_truth
    from opid.virtual.files.truth import write_field_test
    from opid.virtual.modal_tests.series import stated_modes, virtual_series, virtual_study

    free_directory(out, ("modes.npz", *STUDY_FILES), overwrite=overwrite)
    settings = {"case": case, "seed": seed, "noise": noise, "shaker": shaker}
    settings |= {"frequency_error_percent": frequency_error, "damping_error_percent": damping_error}
    with progress() as say:
        say("the highest levels")
        series = virtual_series(case, shaker=shaker)
        stated = stated_modes(
            series.case.modes, frequency_error=frequency_error / 100, damping_error=damping_error / 100
        )
        rng = np.random.default_rng(seed)
        study = virtual_study(series, rng=rng, noise_share=noise, given=stated, progress=say)
        say("the files")
        path = write_field_test(study, modal_truth(series, settings=settings), out)
    click.echo(f"{len(study.tests)} tests: {series.case.text}")
    show_next("modal", path)
