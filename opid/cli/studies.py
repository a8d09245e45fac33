"""One gear or a body on several suspensions from runs at known loadings: `opid identify`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import Number, Output, example, main, report_note, result_name, with_output
from opid.errors import InputError
from opid.suspensions.settings import METHODS, METHODS_OF_LAW

if TYPE_CHECKING:
    from opid.suspensions.study import Study


@main.command(
    epilog=example(
        "opid identify heavy.csv light.csv --sprung upper_z --unsprung lower_z --mass-change -220 --out result"
    )
)
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="STUDY.toml | DIR | LOG...")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For the report.  [default: NAME_result]")
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="One gear: model (fits the driven suspension), classical (the paper's chain mended), or paper (its printed "
    "formula).",
)
@click.option("--law", help="The law to fit, one of `opid laws`; sums joined by +.  [default: searched]")
@click.option(
    "--method-of-law",
    type=click.Choice(METHODS_OF_LAW),
    default=METHODS_OF_LAW[0],
    show_default=True,
    help='How the law is searched: pursuit, "sparse regression" (pysindy), or both, one after the other.',
)
@click.option(
    "--band", nargs=2, type=float, metavar="LO HI", help="Lines to use, Hz.  [default: 0.3 40, classical 0.5 12]"
)
@click.option(
    "--high-pass",
    type=float,
    metavar="HZ",
    help="One gear, classical and paper: corner of the integration.  [default: 0.3]",
)
@click.option("--no-ground", is_flag=True, help="Let no spring to the ground in, K3 = 0.")
@click.option(
    "--truth", type=click.Path(path_type=Path), metavar="JSON", help="truth.json of a simulation, to compare."
)
@click.option("--sprung", metavar="NAME", help="Without a study: channel on the airframe.")
@click.option("--unsprung", metavar="NAME", help="Without a study: channel on the spindle.")
@click.option(
    "--mass-change",
    "mass_changes",
    multiple=True,
    type=Number("kg, negative for what was taken off"),
    metavar="KG",
    help="Without a study: mass of a further log less that of the first; once for each, in the order of the logs.",
)
@click.option(
    "--axis",
    type=click.Choice(("up", "down", "horizontal")),
    help="Without a study: where the channels count positive; horizontal where no weight acts.  [default: up]",
)
@click.option(
    "--piston-area",
    type=Number("m^2, 0.004 for 40 cm^2"),
    metavar="M2",
    help="Without a study: what the gas of an oleo strut pushes on; its pressure and volume are then given.",
)
@click.option(
    "--repeatability",
    type=Number("a fraction, 0.01 for 1 %"),
    metavar="FRACTION",
    help="Without a study: by how much springs, damping and friction differ from run to run; 0 for not at all.  "
    "[default: 0.01]",
)
@with_output
def identify(
    paths: tuple[Path, ...],
    out: Path | None,
    method: str,
    law: str | None,
    method_of_law: str,
    band: tuple[float, float] | None,
    high_pass: float | None,
    no_ground: bool,
    truth: Path | None,
    sprung: str | None,
    unsprung: str | None,
    mass_changes: tuple[float, ...],
    axis: str | None,
    piston_area: float | None,
    repeatability: float | None,
    output: Output,
) -> None:
    """Identify mass, springs, damping and law from a study file, or from logs, the reference run first.

    A study with [[interfaces]] is one of a body on several suspensions: its masses, inertias, and each suspension.
    Options marked "One gear" are for a study of a single suspension. DIR stands for the study.toml in it.

    The report goes to a new folder here, called after the study (after its directory if it is called study.toml).
    """
    paths = tuple(_study_in(path) if len(paths) == 1 else path for path in paths)
    is_one_gear = _is_of_one_gear(paths)
    of_logs = {
        "--sprung": sprung,
        "--unsprung": unsprung,
        "--mass-change": mass_changes or None,
        "--axis": axis,
        "--piston-area": piston_area,
        "--repeatability": repeatability,
    }
    if not is_one_gear:
        options = {"--method": None if method == "model" else method, "--high-pass": high_pass, **of_logs}
        given = [name for name, value in options.items() if value is not None]
        if given:
            raise click.UsageError(
                f"{paths[0]} is the study of a body on several suspensions, which has no {' or '.join(given)}: "
                f"leave {'it' if len(given) == 1 else 'them'} out"
            )
    if method == "model" and high_pass is not None:
        raise click.UsageError(
            "--high-pass is the corner of the integration of --method classical and paper; the model integrates "
            "nothing: leave it out"
        )
    if method != "model" and method_of_law != "pursuit":
        raise click.UsageError(f"--method {method} has one method of searching the law: leave --method-of-law out")
    from opid.mechanics.truth import BodyTruth, GearTruth, TaxiTruth
    from opid.report import write_report
    from opid.suspensions.identification import identify as identify_study
    from opid.virtual.files.truth import read_truth

    target = output.directory(out or Path(f"{result_name(paths[0])}_result"))
    known: TaxiTruth | None = None
    if truth is not None:
        known = read_truth(truth, GearTruth) if is_one_gear else read_truth(truth, BodyTruth)
    settings: dict[str, Any] = {"method": method, "law": law, "ground": not no_ground, "method_of_law": method_of_law}
    settings |= {} if band is None else {"band_hz": band}
    settings |= {} if high_pass is None else {"high_pass_hz": high_pass}
    with output.progress() as say:
        study = _study(paths, of_logs, say)
        result = identify_study(study, progress=say, **settings)
        page = write_report(result, target, known, figures=output.figures, progress=say)
    output.show(result, known, notes=report_note(page))


def _study_in(path: Path) -> Path:
    """The study.toml of a directory that has one; any other path as it is."""
    return path / "study.toml" if (path / "study.toml").is_file() else path


def _is_of_one_gear(paths: tuple[Path, ...]) -> bool:
    """Whether it is about one gear, as logs without a study are; what is wrong with a file is said when it is read."""
    from opid.studies.schema import load

    if len(paths) != 1 or paths[0].suffix.lower() != ".toml":
        return True
    try:
        document = load(paths[0])
    except InputError:
        return True
    return len(document.get("interfaces", ())) < 2 and not document.get("body_sensors")


def _study(paths: tuple[Path, ...], of_logs: dict[str, Any], say: Callable[[str], None]) -> Study:
    from opid.signals.files import nearest_beside
    from opid.studies.study_file import read_study
    from opid.studies.suspension_study import study_from_logs
    from opid.suspensions.study import Study

    studies = [path for path in paths if path.suffix.lower() == ".toml"]
    if studies:
        if len(paths) > 1:
            raise click.UsageError(f"{len(paths)} files are given: give one study file, or logs only")
        given = [name for name, value in of_logs.items() if value is not None]
        if given:
            named = " and ".join(given)
            raise click.UsageError(f"{studies[0]} is a study, which says that itself: leave out {named}")
        return read_study(studies[0], kind=Study, progress=say)
    if paths[0].is_dir():
        raise click.UsageError(f"{paths[0]} is a directory without a study.toml: name a study file, or logs")
    sprung, unsprung = of_logs["--sprung"], of_logs["--unsprung"]
    if not (sprung and unsprung):
        for path in paths:
            if not path.exists():
                raise InputError(f"there is no file or directory {path}{nearest_beside(path)}")
        raise click.UsageError(
            "name the channels of the logs: --sprung NAME --unsprung NAME (`opid inspect LOG` lists them), or give a "
            "study file"
        )
    title = " and ".join(path.name for path in paths)
    return study_from_logs(
        paths,
        sprung=sprung,
        unsprung=unsprung,
        mass_changes_kg=of_logs["--mass-change"] or (),
        title=title,
        axis=of_logs["--axis"] or "up",
        piston_area_m2=of_logs["--piston-area"],
        repeatability=of_logs["--repeatability"],
        progress=say,
    )
