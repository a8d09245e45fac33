"""Suspensions: `opid identify` of runs, `opid law` of a bench, `opid compare` of flights, and the list `opid laws`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import main
from opid.cli.options import (
    PATH,
    Number,
    OfWords,
    channel_units_option,
    example,
    out_option,
    time_unit_option,
    truth_option,
    unit_option,
)
from opid.cli.output import Output, result_name, with_output
from opid.errors import FileError, InputError, list_names
from opid.progress import Say
from opid.suspensions.sensor_facts import USUAL_GAIN_TOLERANCE, USUAL_LAG_TOLERANCE_S
from opid.suspensions.settings import METHODS, METHODS_OF_LAW

if TYPE_CHECKING:
    from opid.mechanics.laws.kind import Kind
    from opid.suspensions.flights.comparison import Comparison
    from opid.suspensions.flights.fleet import Fleet
    from opid.suspensions.study import Study

CHANGED = 3
"""Exit status of `opid compare` if a change is flagged; 1 and 2 mean what they mean everywhere."""


@main.command(
    epilog=example(
        "opid identify heavy.csv light.csv --sprung upper_z --unsprung lower_z --mass-change -220 --out result"
    )
)
@click.argument("paths", nargs=-1, required=True, type=PATH, metavar="STUDY.toml | DIR | LOG...")
@out_option("Folder for the report.  [default: NAME_result]")
@click.option(
    "--method",
    type=click.Choice(METHODS),
    default=METHODS[0],
    show_default=True,
    help="One gear: model (fits the driven suspension), classical (the paper's chain mended), or paper (as printed).",
)
@click.option("--law", help="The law to fit, one of `opid laws`; sums joined by +.  [default: searched]")
@click.option(
    "--method-of-law",
    type=OfWords(METHODS_OF_LAW),
    default=METHODS_OF_LAW[0],
    show_default=True,
    help="How the law is searched: pursuit, sparse-regression (pysindy), or both, one after the other.",
)
@click.option(
    "--band",
    nargs=2,
    type=float,
    metavar="LO HI",
    help="Frequency range of the fit, Hz.  [default: 0.3 40, classical 0.5 12]",
)
@click.option(
    "--high-pass",
    type=float,
    metavar="HZ",
    help="One gear, classical and paper: corner of the integration.  [default: 0.3]",
)
@click.option("--no-ground", is_flag=True, help="Fit no spring to the ground (K3 = 0).")
@truth_option
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
    help="Without a study: piston area of an oleo strut, m^2; the report then gives gas pressure and volume.",
)
@click.option(
    "--repeatability",
    type=Number("a fraction, 0.01 for 1 %"),
    metavar="FRACTION",
    help="Without a study: by how much springs, damping and friction differ from run to run; 0 for not at all.  "
    "[default: 0.01]",
)
@click.option(
    "--window",
    metavar="NAME",
    help="Without a study: window of the transmissibility, like hann or flattop.  [default: hann, paper flattop]",
)
@click.option(
    "--overlap",
    type=Number("a fraction, 0.3 for 30 %"),
    metavar="FRACTION",
    help="Without a study: overlap of its blocks.  [default: 0.5, paper 0.3]",
)
@click.option("--estimator", metavar="H1|H2|Hv", help="Without a study: its estimator.  [default: H1]")
@click.option(
    "--block",
    type=Number("s, 32 for lines of 1/32 Hz"),
    metavar="S",
    help="Without a study: length of its blocks, s.  [default: 8, paper 32]",
)
@unit_option
@time_unit_option
@with_output
def identify(
    paths: tuple[Path, ...],
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
    window: str | None,
    overlap: float | None,
    estimator: str | None,
    block: float | None,
    unit: str | None,
    time_unit: str | None,
    output: Output,
) -> None:
    """Identify mass, springs, damping and law from a study file, or from logs, the reference run first.

    A study with [[interfaces]] is one of a body on several suspensions: its masses, inertias, and each suspension.
    Options marked "One gear" are for a study of a single suspension. DIR stands for the study.toml in it.

    The report goes to a new folder here, called after the study (after its directory if it is called study.toml).
    """
    paths = tuple(_find_study(path) if len(paths) == 1 else path for path in paths)
    is_one_gear = _is_of_one_gear(paths)
    of_logs = {
        "--sprung": sprung,
        "--unsprung": unsprung,
        "--mass-change": mass_changes or None,
        "--axis": axis,
        "--piston-area": piston_area,
        "--repeatability": repeatability,
        "--window": window,
        "--overlap": overlap,
        "--estimator": estimator,
        "--block": block,
        "--unit": unit,
        "--time-unit": time_unit,
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
    from opid.suspensions.identification import identify as identify_study
    from opid.virtual.truth_file import read_truth

    output = output.reserve(default=f"{result_name(paths[0])}_result")
    known: TaxiTruth | None = None
    if truth is not None:
        known = read_truth(truth, GearTruth) if is_one_gear else read_truth(truth, BodyTruth)
    settings: dict[str, Any] = {"method": method, "law": law, "ground": not no_ground, "method_of_law": method_of_law}
    settings |= {} if band is None else {"band_hz": band}
    settings |= {} if high_pass is None else {"high_pass_hz": high_pass}
    with output.progress() as say, output.name_files(*paths):
        study = _read_paths(paths, of_logs, say)
        result = identify_study(study, progress=say, **settings)
        notes = output.write(result, known, progress=say)
    output.show(result, known, notes=notes)


def _find_study(path: Path) -> Path:
    """Return the study.toml of a directory; any other path as it is."""
    return path / "study.toml" if os.path.isfile(path / "study.toml") else path


def _is_of_one_gear(paths: tuple[Path, ...]) -> bool:
    """Return whether the files are of one gear, as logs without a study are; `_read_paths` refuses a faulty file."""
    from opid.studies.schema import load

    if len(paths) != 1 or paths[0].suffix.lower() != ".toml":
        return True
    try:
        document = load(paths[0])
    except InputError:
        return True
    interfaces = document.get("interfaces")
    return not (isinstance(interfaces, list) and len(interfaces) > 1) and not document.get("body_sensors")


def _refuse_beside_study(study: Path, options: Sequence[str]) -> None:
    """Refuse options for logs without a study where a study is given."""
    if options:
        raise click.UsageError(f"{study} is a study, which states this itself: leave out {' and '.join(options)}")


def _read_paths(paths: tuple[Path, ...], of_logs: dict[str, Any], say: Say) -> Study:
    from opid.signals.files import nearest_beside
    from opid.signals.log import LogSettings
    from opid.signals.logs import open_log
    from opid.signals.spectra import TransmissibilitySettings
    from opid.studies.study_file import read_study
    from opid.studies.suspension_study import study_from_logs
    from opid.suspensions.study import Study

    studies = [path for path in paths if path.suffix.lower() == ".toml"]
    if studies:
        if len(paths) > 1:
            raise click.UsageError(f"{len(paths)} files are given: give one study file, or logs only")
        _refuse_beside_study(studies[0], [name for name, value in of_logs.items() if value is not None])
        return read_study(studies[0], kind=Study, progress=say)
    if paths[0].is_dir():
        raise click.UsageError(f"{paths[0]} is a directory without a study.toml: name a study file, or logs")
    sprung, unsprung = of_logs["--sprung"], of_logs["--unsprung"]
    if not (sprung and unsprung):
        for path in paths:
            if not path.exists():
                raise FileError(f"there is no file or directory {path}{nearest_beside(path)}")
        known = list_names(map(repr, open_log(paths[0]).names))
        raise click.UsageError(
            f"name the channels of the logs, of {known}: --sprung NAME --unsprung NAME, or give a study file"
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
        transmissibility=TransmissibilitySettings(
            of_logs["--window"], of_logs["--overlap"], of_logs["--estimator"], of_logs["--block"]
        ),
        settings=LogSettings(unit=of_logs["--unit"], time_unit=of_logs["--time-unit"]),
        progress=say,
    )


@main.command(epilog=example("opid law bench.csv --force-channel load --travel-channel stroke --out bench_result"))
@click.argument("bench", type=PATH, metavar="STUDY.toml | BENCH.csv")
@click.option("--force-channel", "force", metavar="NAME", help="Without a study: the force, in N, kN, lbf, ...")
@click.option("--travel-channel", "travel", metavar="NAME", help="Without a study: the travel, in m, mm, in, ...")
@click.option(
    "--velocity-channel",
    "velocity",
    metavar="NAME",
    help="Without a study: its rate, in m/s, mm/s, ...  [default: differentiated]",
)
@click.option("--moving-mass", is_flag=True, help="Parts of unknown mass move between force cell and specimen.")
@click.option(
    "--mass",
    "mass_kg",
    type=Number("kg"),
    metavar="KG",
    help="Mass of a body carried by the specimen alone; --force-channel then names its acceleration.",
)
@click.option(
    "--piston-area",
    "piston_area_m2",
    type=Number("m^2, 0.004 for 40 cm^2"),
    metavar="M2",
    help="Piston area of an oleo strut, m^2; the report then gives gas pressure and volume.",
)
@click.option(
    "--gain-tolerance",
    "gain_tolerance",
    type=click.FloatRange(min=0, max=1, max_open=True),
    metavar="FRACTION",
    help=f"Standard deviation of the gain of each channel.  [default: {USUAL_GAIN_TOLERANCE:g}]",
)
@click.option(
    "--lag-tolerance",
    "lag_tolerance_s",
    type=click.FloatRange(min=0),
    metavar="S",
    help=f"Standard deviation of the lag of the force, s.  [default: {USUAL_LAG_TOLERANCE_S:g} and half a sample]",
)
@click.option(
    "--mass-tolerance",
    "mass_tolerance_kg",
    type=click.FloatRange(min=0),
    metavar="KG",
    help="Standard deviation of the mass between force cell and specimen.  [default: 0.001 kg per N of force]",
)
@channel_units_option("Without a study: unit of a channel, like load=kN, whatever the log says; once for each channel.")
@time_unit_option
@click.option("--quasi-static", is_flag=True, help="A slow test: time is ignored and may be missing.")
@out_option("Folder for result.json, report and figures.")
@with_output
def law(bench: Path, units: tuple[tuple[str, str], ...], time_unit: str | None, output: Output, **of_log: Any) -> None:
    """Find the law of a damper or spring from its measured force and motion.

    F = F0 + K z + C z' + f(z, z'), where f is a sum of laws of the library, friction and rubber with memory among
    them. All values have intervals, and what no law explains (backlash, moving parts) is reported. With --moving-mass
    the inertia m z'' is added to the force, and the law is refined until the motion simulated from the force alone
    is the recorded one. With --mass no force need be measured: --force-channel names the acceleration of a body
    carried by the specimen alone, and F = -m a.

    A study file with a table [bench] says all of this itself.
    """
    from opid.report.suspensions.bench import write_command
    from opid.signals.logs import open_log
    from opid.studies.bench_study import bench_study_from_log
    from opid.studies.study_file import read_study
    from opid.suspensions.bench.law import law_of_bench
    from opid.suspensions.bench.record import BenchStudy

    given = {name: value for name, value in of_log.items() if value is not None and value is not False}
    options = [each.opts[0] for each in click.get_current_context().command.params if each.name in given]
    of_units = [word for channel, unit in units for word in ("--unit", f"{channel}={unit}")]
    of_units += [] if time_unit is None else ["--time-unit", time_unit]
    options += dict.fromkeys(word for word in of_units if word.startswith("--"))
    is_study = bench.suffix.lower() == ".toml"
    if is_study:
        _refuse_beside_study(bench, options)
    elif not {"force", "travel"} <= given.keys():
        known = list_names(map(repr, open_log(bench).names))
        raise click.UsageError(
            f"name the channels of the log, of {known}: --force-channel NAME --travel-channel NAME, or give a study"
        )
    output = output.reserve()
    with output.progress() as say, output.name_files(bench):
        say("the record")
        study = (
            read_study(bench, kind=BenchStudy, progress=say)
            if is_study
            else bench_study_from_log(bench, units=dict(units), time_unit=time_unit, progress=say, **given)
        )
        result = law_of_bench(study, progress=say)
        notes = output.write(result, command=[*write_command(result), *of_units], progress=say)
    output.show(result, notes=notes)


@main.command(epilog=example("opid compare flight_1 flight_2 flight_3 --out health"))
@click.argument("results", nargs=-1, required=True, type=PATH, metavar="RESULT... | CAMPAIGN")
@out_option("Folder for comparison.json (of a campaign fleet.json), report and figures.")
@click.option(
    "--false-alarm",
    type=float,
    metavar="P",
    help="Chance of any flag among results if nothing changed.  [default: 0.001]",
)
@click.option(
    "--alarms-per-year",
    type=float,
    metavar="N",
    help="Expected false alarms of a campaign in a year of the whole fleet.  [default: 0.1]",
)
@with_output
def compare(
    results: tuple[Path, ...], false_alarm: float | None, alarms_per_year: float | None, output: Output
) -> None:
    """Say what changed from flight to flight by more than its uncertainty.

    RESULT is a result.json of `opid identify`, a folder with one, or a folder of such folders. They are taken by the
    dates in the study files (`date = 2026-03-01`), else as they are given.

    CAMPAIGN is the folder of an `opid campaign`, or the dataset in it: each strut of the fleet is then compared with
    its own past and with the others, with the columns of numbers in the table of flights, like a temperature, as
    covariates.

    A flight that is not determined, or for which no structure was recommended, is left out and named.

    Exit status 0: nothing is flagged. 1: fewer than two flights can be compared, for want of values with intervals. 2:
    bad input. 3: a change is flagged.
    """
    from opid.suspensions.flights.comparison import compare as compare_flights
    from opid.suspensions.flights.dataset import is_dataset, read_dataset
    from opid.suspensions.flights.fleet_comparison import compare_fleet
    from opid.suspensions.flights.results import read_flights

    campaigns = [path for path in results if is_dataset(path)]
    if campaigns and len(results) > 1:
        raise click.UsageError(f"{campaigns[0]} is a campaign: give it alone, or results only")
    if campaigns and false_alarm is not None:
        raise click.UsageError(f"{campaigns[0]} is a campaign: give --alarms-per-year in the place of --false-alarm")
    if not campaigns and alarms_per_year is not None:
        raise click.UsageError("--alarms-per-year is for the folder of a campaign: give --false-alarm for results")
    output = output.reserve(("fleet.json" if campaigns else "comparison.json", "report.html"))
    with output.progress() as say:
        say("the results")
        found: Comparison | Fleet
        if campaigns:
            found = compare_fleet(read_dataset(campaigns[0]), alarms_per_year=alarms_per_year)
        else:
            found = compare_flights(read_flights(results), false_alarm=false_alarm)
        notes = output.write(found, command=["opid", "compare", *map(str, results)], progress=say)
    output.show(found, notes=notes)
    if found.has_flags:
        click.get_current_context().exit(CHANGED)


@main.command(epilog=example("opid laws --json"))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def laws(as_json: bool) -> None:
    """List the laws of the library with their formulas and parameters.

    z is the extension of the suspension and z' its rate. A law that is fitted or simulated is one of these or a sum of
    them, as in `--law arctan_velocity+cubic_stiffness`, beside the linear stiffness and damping.
    """
    from opid.json_values import json_text
    from opid.mechanics.laws.kinds import LAWS

    kinds = list(LAWS.values())
    click.echo(json_text(_tabulate_laws(kinds)) if as_json else _format_laws(kinds), nl=False)


def _format_laws(kinds: list[Kind]) -> str:
    from opid.report.as_text import align_table
    from opid.report.formulas import format_formula

    head = ("parameter", "unit", "default", "role")
    cells = [
        (f"  {each.name}", each.unit, f"{each.default:g}", each.role) for kind in kinds for each in kind.parameters
    ]
    lines = iter(align_table([(f"  {head[0]}", *head[1:]), *cells], left=(0, 1)))
    n_searched = sum(kind.searched and not kind.bench_only for kind in kinds)
    head_line = f"{len(kinds)} laws, {n_searched} of them searched by `opid identify`; the columns of their parameters:"
    parts = [head_line, next(lines)]
    for kind in kinds:
        parts += ["", f"{kind.name}: {format_formula(kind.latex)}", f"  {_say_which_search(kind)}"]
        parts += [next(lines) for _ in kind.parameters]
    return "\n".join(parts) + "\n"


def _say_which_search(kind: Kind) -> str:
    """Say whether a law remembers the motion, and which search tries it."""
    memory = "" if kind.memory is None else "it remembers the motion; "
    if kind.bench_only:
        return f"{memory}searched by `opid law` alone"
    return f"{memory}{'searched' if kind.searched else 'not searched: name it'}"


def _tabulate_laws(kinds: list[Kind]) -> dict[str, Any]:
    from opid.report.formulas import format_formula

    return {
        "schema": "opid.laws/1",
        "laws": [
            {
                "name": kind.name,
                "formula": format_formula(kind.latex),
                "latex": kind.latex,
                "has_memory": kind.memory is not None,
                "is_searched": kind.searched,
                "is_bench_only": kind.bench_only,
                "parameters": [
                    {"name": each.name, "unit": each.unit, "role": each.role, "default": each.default}
                    for each in kind.parameters
                ],
            }
            for kind in kinds
        ],
    }
