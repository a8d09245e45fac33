"""What follows from an identification: `opid sense` gives forces and motion along a log, `opid wheel` what is below."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import main
from opid.cli.options import PATH, Number, example, out_option
from opid.cli.output import Output, result_name, with_output
from opid.errors import FileError, InputError

if TYPE_CHECKING:
    from opid.estimate import Estimate
    from opid.suspensions.sensing.result import Sensing

_LONGEST_NAME = 250  # bytes of the name of a file, of which systems allow 255 and the writer needs some
LOG_FILE = "virtual_sensors.csv"
"""The log that is written where no other is named."""

_LEAST_KG, _MOST_KG = 1e-9, 1e12  # of what moves with a wheel

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"


class NamedPlace(click.ParamType):
    """A name and a place, x forward and y to the left, m."""

    name = "NAME=X,Y"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, float, float]:
        """Return name, x and y."""
        found = re.fullmatch(rf"\s*([^=]+?)\s*=\s*({_NUMBER})\s*,\s*({_NUMBER})\s*(?:m\s*)?", str(value), re.IGNORECASE)
        if found is None:
            self.fail(f"{value!r} is no NAME=X,Y: give one, like tail=-5.0,0.0, in m", param, ctx)
        return found[1], float(found[2]), float(found[3])


class MassOfInterface(click.ParamType):
    """A mass in kg with or without its standard deviation, of all interfaces or of one that is named."""

    name = "[NAME=]KG[+-STD]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, float, float]:
        """Return the name, empty where none is given, the mass and its standard deviation."""
        words = rf"(?:\s*([^=]+?)\s*=)?\s*({_NUMBER})\s*(?:[+]-\s*({_NUMBER}))?\s*(?:kg)?\s*"
        found = re.fullmatch(words, str(value), re.IGNORECASE)
        if found is None:
            self.fail(f"{value!r} is no mass: give one in kg, like 105+-5 or left=105+-5", param, ctx)
        mass_kg, std_kg = float(found[2]), float(found[3] or 0.0)
        if not _LEAST_KG <= mass_kg <= _MOST_KG or not 0.0 <= std_kg <= _MOST_KG:
            self.fail(f"{value!r} is no mass from {_LEAST_KG:g} to {_MOST_KG:g} kg: give one, like 105+-5", param, ctx)
        return found[1] or "", mass_kg, std_kg


@main.command(
    epilog=example("opid sense study.toml result flight_12.csv --unsprung-mass 105+-2 --out flight_12_forces")
)
@click.argument("study", type=PATH, metavar="STUDY.toml | DIR")
@click.argument("result", type=PATH, metavar="RESULT")
@click.argument("log", required=False, type=PATH, metavar="[LOG]")
@out_option("Folder for result.json, report and log.  [default: NAME_sensors]")
@click.option("--run", metavar="NAME", help="Run of the study in the place of LOG.  [default: the first]")
@click.option(
    "--like", metavar="RUN", help="LOG has the loading of this run, and its channels are read in the same way."
)
@click.option(
    "--mass-change",
    "mass_change_kg",
    type=Number("kg, negative for what was taken off"),
    metavar="KG",
    help="One gear: mass that it carries in LOG less that of the reference.",
)
@click.option(
    "--unsprung-mass",
    "unsprung",
    type=MassOfInterface(),
    multiple=True,
    help="Mass that moves with the wheel, with its standard deviation; the tyre force is given only with it.",
)
@click.option(
    "--place",
    "places",
    type=NamedPlace(),
    multiple=True,
    help="Place on a rigid body, m, whose motion is wanted; once for each.",
)
@click.option(
    "--log",
    "written",
    type=PATH,
    metavar="FILE",
    help=f"Log that is written; its ending decides the format (.csv, .h5, ...).  [default: {LOG_FILE} in the folder]",
)
@with_output
def sense(
    study: Path,
    result: Path,
    log: Path | None,
    run: str | None,
    like: str | None,
    mass_change_kg: float | None,
    unsprung: tuple[tuple[str, float, float], ...],
    places: tuple[tuple[str, float, float], ...],
    written: Path | None,
    output: Output,
) -> None:
    """Give forces, travel and motion of an identified body along a log, with bands.

    RESULT is the result.json of `opid identify` of this STUDY, or its folder. LOG is a further log of the same sensors,
    read as the study says; without it a run of the study is taken. The log that is written has strut force, travel,
    its rate, and acceleration and velocity of the body, each followed by its standard deviation (NAME_std); the report
    has rainflow counts of the strut forces.
    """
    from opid.report.suspensions.sensing import write_command
    from opid.signals.files import make_directory
    from opid.signals.logs import write_log
    from opid.studies.stored_fits import read_fits
    from opid.studies.study_file import read_study
    from opid.studies.suspension_study import read_further_run
    from opid.suspensions.sensing.virtual_sensors import sense as sense_run
    from opid.suspensions.study import Study

    if log is not None and run is not None:
        raise click.UsageError(f"{log} and --run {run} are both given: give one of them")
    if log is None and (like is not None or mass_change_kg is not None):
        raise click.UsageError("--like and --mass-change say what LOG carries, and no LOG is given: leave them out")
    if like is not None and mass_change_kg is not None:
        raise click.UsageError("--like and --mass-change are both given: give one of them")
    file = study / "study.toml" if os.path.isfile(study / "study.toml") else study
    output = output.reserve(
        ("result.json", "report.html", *([] if written else [LOG_FILE])),
        default=f"{log.stem if log else result_name(file)}_sensors",
    )
    path = written or output.folder / LOG_FILE
    is_inside = os.path.realpath(path.parent) == os.path.realpath(output.folder)
    if written is not None:
        _require_place(written, output, is_inside=is_inside)
    with output.progress() as say, output.name_files(file, result, *([log] if log else [])):
        fits = read_fits(result)
        read = read_study(file, kind=Study, progress=say)
        wanted = run if log is None else read_further_run(
            read, log, like=like, mass_change_kg=mass_change_kg, progress=say
        )  # fmt: skip
        found = sense_run(
            read,
            fits,
            wanted,
            places={name: (x_m, y_m) for name, x_m, y_m in places},
            unsprung_mass_kg=_read_masses(unsprung),
            progress=say,
        )
        options = {
            "run": run,
            "like": like,
            "mass-change": mass_change_kg,
        }
        command = write_command(file, result, log, options, unsprung, places)
        _require_not_read(path, file, result, found)
        with output.together((LOG_FILE,)) as folder:
            notes = output.write(found, command=command, progress=say)
            if folder is not None and is_inside:
                write_log(found.to_recording(), folder / path.name)
        if not is_inside:
            make_directory(path.parent)
            write_log(found.to_recording(), path)
    output.show(found, notes=(*notes, f"Log: {path}"))


def _require_place(path: Path, output: Output, *, is_inside: bool) -> None:
    """Refuse before the work a log that cannot be written where `--log` says, or that would replace another file."""
    from opid.signals.files import require_directory
    from opid.signals.logs import require_written_format

    try:
        require_written_format(path)
        if not is_inside:
            require_directory(path.parent)
    except InputError as error:
        raise error.reword(f"--log: {error}") from error
    if len(os.fsencode(path.name)) > _LONGEST_NAME:
        raise InputError(f"--log: the name {path.name} is longer than {_LONGEST_NAME} bytes: give a shorter one")
    if os.path.lexists(path) and not path.is_file():
        raise FileError(f"--log: {path} is no file: choose another place")
    if path.exists() and not output.overwrite:
        raise FileError(f"--log: {path} is there already: choose another place, or overwrite it with --force")


def _require_not_read(path: Path, study: Path, result: Path, found: Sensing) -> None:
    """Refuse a log in the place of a file that was read."""
    read = [str(study), str(result), str(result / "result.json"), *(each.name for each in found.files)]
    if os.path.realpath(path) in [os.path.realpath(each) for each in read]:
        raise click.UsageError(f"--log: {path} is a file that was read: choose another place")


def _read_masses(given: tuple[tuple[str, float, float], ...]) -> Estimate | dict[str, Estimate] | None:
    from opid.estimate import Estimate

    named = {name: Estimate.normal(mass_kg, std_kg) for name, mass_kg, std_kg in given}
    if len(named) < len(given):
        raise click.UsageError("--unsprung-mass is given twice for the same interfaces: give it once for each")
    if "" in named and len(given) > 1:
        raise click.UsageError(
            "--unsprung-mass is given with and without a name: name an interface in each, or in none"
        )
    return named.get("", named or None)


@main.command(epilog=example("opid wheel study.toml result --out wheel"))
@click.argument("study", type=PATH, metavar="STUDY.toml | DIR")
@click.argument("result", type=PATH, metavar="RESULT")
@out_option("Folder for result.json and report.  [default: NAME_wheel]")
@with_output
def wheel(study: Path, result: Path, output: Output) -> None:
    """Identify unsprung mass, tyre and road of a gear from the same runs.

    RESULT is the result.json of `opid identify` of this STUDY, or its folder. Each run of the study needs its speed,
    speed_m_per_s: a number in m/s, or the name of a channel, as a GPS receiver gives it. The road is not measured: its
    spectrum is fitted, with its roughness, its slope and its class by ISO 8608.
    """
    from opid.studies.stored_fits import read_fits
    from opid.studies.study_file import read_study
    from opid.suspensions.study import Study
    from opid.suspensions.wheel.identification import identify_wheel

    file = study / "study.toml" if os.path.isfile(study / "study.toml") else study
    output = output.reserve(default=f"{result_name(file)}_wheel")
    with output.progress() as say, output.name_files(file, result):
        fits = read_fits(result)
        found = identify_wheel(read_study(file, kind=Study, progress=say), fits, progress=say)
        notes = output.write(found, command=["opid", "wheel", str(file), str(result)], progress=say)
    output.show(found, notes=notes)
