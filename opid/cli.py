"""The `opid` command: each subcommand is a few public calls.

Exit status 0: done. 1: the data do not determine the answer (what was determined is written). 2: bad input or usage.
Heavy imports stand inside the commands, so that help and usage errors come at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.errors import InputError, NotDeterminedError

if TYPE_CHECKING:
    from opid.identify.result import Identification
    from opid.identify.study import Study
    from opid.mechanics.landing_gear import LandingGear, TaxiTest
    from opid.mechanics.laws import Law


class BadInput(click.ClickException):
    """What was given cannot be used."""

    exit_code = 2


class NotDetermined(click.ClickException):
    """The data do not determine the answer."""

    exit_code = 1


class Interrupted(click.ClickException):
    """The user pressed Ctrl-C."""

    exit_code = 130


class Commands(click.Group):
    """Commands whose failures for the user's reasons are sentences, not tracebacks."""

    def invoke(self, context: click.Context) -> Any:
        """Run the command that was asked for."""
        try:
            return super().invoke(context)
        except InputError as error:
            raise BadInput(str(error)) from error
        except NotDeterminedError as error:
            raise NotDetermined(str(error)) from error
        except OSError as error:
            # without a name it is no file of the user's (a pipe whose reader has gone: click ends quietly)
            if error.filename is None:
                raise
            raise BadInput(f"{error.filename}: {error.strerror}") from error
        except KeyboardInterrupt as error:
            raise Interrupted("interrupted") from error


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="opid")
def main() -> None:
    """Identify a nonlinear suspension from what two accelerometers recorded in operation.

    Begin with `opid demo`, or with `opid inspect` and `opid identify` on logs of your own.
    """


@main.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("demo_taxi"),
    show_default=True,
    metavar="DIR",
    help="For the runs and the report.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of road and noise.")
def demo(out: Path, seed: int) -> None:
    """Simulate two taxi runs, identify them from their log files, and show truth beside estimate."""
    import numpy as np

    from opid.identify.identification import identify_study
    from opid.identify.study import read_study
    from opid.mechanics.landing_gear import LandingGear, taxi_test
    from opid.report import read_truth, result_text, write_field_test, write_report
    from opid.report.directory import require_directory

    require_directory(out)
    with _progress() as say:
        say("two taxi runs")
        test = taxi_test(LandingGear(), rng=np.random.default_rng(seed))
        title = f"Two virtual taxi runs, seed {seed}"
        study = write_field_test(test, out, title=title, settings={"seed": seed})
        result = identify_study(read_study(study), progress=say)
        truth = read_truth(out / "truth.json")
        page = write_report(result, out / "report", truth, progress=say)
    click.echo(result_text(result, truth))
    click.echo(f"The runs:   {out / 'heavy.csv'}, {out / 'light.csv'}")
    click.echo(f"The study:  {study}")
    click.echo(f"The report: {page} (open it in a browser)")
    _end(result)


@main.group()
def simulate() -> None:
    """Make a field test with known truth."""


# the defaults are those of opid.mechanics (a test compares them), written out so that help needs no heavy import
@simulate.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of road and noise.")
@click.option("--duration", default=40.0, show_default=True, metavar="S", help="Length of each run.")
@click.option("--fs", default=512.0, show_default=True, metavar="HZ", help="Sampling rate.")
@click.option("--sprung-mass", default=1850.0, show_default=True, metavar="KG", help="M2 of the heavy run.")
@click.option("--mass-removed", default=220.0, show_default=True, metavar="KG", help="Before the light run.")
@click.option("--stiffness", default=3.9e5, show_default=True, metavar="N/M", help="K2 of the suspension.")
@click.option("--damping", type=float, metavar="NS/M", help="C2 of the suspension.  [default: 6000]")
@click.option("--damping-ratio", type=float, metavar="ZETA", help="C2 / (2 sqrt((K2 + K3) M2)), instead of --damping.")
@click.option("--ground-stiffness", default=0.0, show_default=True, metavar="N/M", help="K3 from the sprung mass.")
@click.option("--law", default="arctan_velocity", show_default=True, help="Nonlinear law; sums joined by +; or linear.")
@click.option(
    "--friction",
    type=click.FloatRange(min=0),
    metavar="N",
    help="Amplitude of the law's friction term; 0 leaves it out.",
)
@click.option("--road-class", default="B", show_default=True, metavar="A..H", help="Of ISO 8608.")
@click.option("--speed-start", default=18.0, show_default=True, metavar="M/S")
@click.option("--speed-stop", default=0.5, show_default=True, metavar="M/S")
@click.option("--noise", default=0.005, show_default=True, metavar="M/S2", help="Rms of each sensor's noise.")
@click.option("--corner", default=0.0, show_default=True, metavar="HZ", help="Of the AC coupling; 0 for none.")
@click.option("--corner-mismatch", default=0.0, show_default=True, metavar="%", help="Upper corner above the lower.")
@click.option("--gain-error", default=0.0, show_default=True, metavar="%", help="Of the upper sensor.")
@click.option("--cross-axis", default=0.0, show_default=True, metavar="%", help="Of the fore-aft motion leaking in.")
@click.option("--bits", type=int, metavar="N", help="Resolution of the converter.  [default: fine]")
@click.option(
    "--range", "full_scale", type=float, metavar="M/S2", help="Of the converter, +-.  [default: 50 with --bits]"
)
def taxi(out: Path, seed: int, **settings: Any) -> None:
    """Write two taxi runs of an aircraft at two masses into the directory OUT.

    Makes heavy.csv, light.csv, study.toml for `opid identify`, and truth.json.
    """
    from opid.report import write_field_test
    from opid.report.directory import require_directory

    require_directory(out)
    with _progress() as say:
        say("two taxi runs")
        test = _taxi_test(seed, settings)
        title = f"Two virtual taxi runs, seed {seed}"
        study = write_field_test(test, out, title=title, settings={"seed": seed} | settings)
    click.echo(f"{test.heavy.gear.sprung_mass_kg:g} kg: {out / 'heavy.csv'}")
    click.echo(f"{test.light.gear.sprung_mass_kg:g} kg: {out / 'light.csv'}")
    click.echo(f"Next: opid identify {study} --truth {out / 'truth.json'}")


@main.command()
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="LOG...")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="Leave a picture of each log there.")
def inspect(logs: tuple[Path, ...], as_json: bool, out: Path | None) -> None:
    """Say what is in a log, and what is wrong with it."""
    from opid.report import health_json, health_text
    from opid.report.as_json import json_text
    from opid.signals.health import inspect as inspect_recording
    from opid.signals.logs import read_log

    logs = tuple(dict.fromkeys(logs))
    recordings = {str(log): read_log(log) for log in logs}
    health = {log: inspect_recording(recording) for log, recording in recordings.items()}
    if out is not None:
        from opid.plots import figure_of, png, recording
        from opid.report.directory import write_together

        names = _distinct([log.stem for log in logs])
        drawn = (png(figure_of(recording(each))) for each in recordings.values())
        write_together(out, {f"{name}.png": image for name, image in zip(names, drawn, strict=True)})
    if as_json:
        click.echo(json_text(health_json(health)), nl=False)
        return
    click.echo("\n".join(health_text(log, each) for log, each in health.items()), nl=False)
    if out is not None:
        click.echo("\nPictures: " + ", ".join(str(out / f"{name}.png") for name in names))


@main.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="STUDY.toml | LOG...")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For the report.  [default: NAME_result]")
@click.option(
    "--method",
    default="classical",
    show_default=True,
    help="classical, model (fits the driven suspension), or paper (its printed formula).",
)
@click.option("--law", help="The law to fit; sums joined by +.  [default: searched]")
@click.option("--band", nargs=2, type=float, metavar="LO HI", help="Lines to use, Hz.  [default: 0.5 12]")
@click.option("--high-pass", type=float, metavar="HZ", help="Corner of the integration.  [default: 0.3]")
@click.option("--no-ground", is_flag=True, help="Fit no ground spring: K3 = 0.")
@click.option(
    "--truth", type=click.Path(path_type=Path), metavar="JSON", help="truth.json of a simulation, to compare."
)
@click.option("--sprung", metavar="NAME", help="Without a study: channel on the airframe.")
@click.option("--unsprung", metavar="NAME", help="Without a study: channel on the spindle.")
@click.option(
    "--mass-change",
    "mass_changes",
    multiple=True,
    type=float,
    metavar="KG",
    help="Without a study: mass of a further log less that of the first; once for each.",
)
def identify(
    paths: tuple[Path, ...],
    out: Path | None,
    method: str,
    law: str | None,
    band: tuple[float, float] | None,
    high_pass: float | None,
    no_ground: bool,
    truth: Path | None,
    sprung: str | None,
    unsprung: str | None,
    mass_changes: tuple[float, ...],
) -> None:
    """Identify mass, springs, damping and law from a study file, or from logs, the reference run first.

    The report goes to a new folder here, called after the study (after its directory if it is called study.toml).
    """
    from opid.identify.identification import identify_study
    from opid.report import read_truth, result_text, write_report
    from opid.report.directory import require_directory

    target = require_directory(out or Path(f"{_name(paths[0])}_result"))
    known = None if truth is None else read_truth(truth)
    settings: dict[str, Any] = {"method": method, "law": law, "ground": not no_ground}
    settings |= {} if band is None else {"band_hz": band}
    settings |= {} if high_pass is None else {"high_pass_hz": high_pass}
    with _progress() as say:
        say("logs")
        study = _study(paths, sprung, unsprung, mass_changes)
        result = identify_study(study, progress=say, **settings)
        page = write_report(result, target, known, progress=say)
    click.echo(result_text(result, known))
    click.echo(f"Report: {page} (open it in a browser)")
    _end(result)


def _end(result: Identification) -> None:
    """Leave with status 1 and the reason if something is not determined."""
    if result.not_determined:
        raise NotDetermined(f"not determined: {result.not_determined}")


def _name(path: Path) -> str:
    """Name a result after its study; every other study is called study.toml, so after the directory of such a one."""
    return path.stem if path.name != "study.toml" else path.resolve().parent.name or path.stem


def _study(paths: tuple[Path, ...], sprung: str | None, unsprung: str | None, mass_changes: tuple[float, ...]) -> Study:
    from opid.identify.study import read_study, study_from_logs

    studies = [path for path in paths if path.suffix.lower() == ".toml"]
    if studies:
        if len(paths) > 1:
            raise click.UsageError(f"{len(paths)} files are given: give one study file, or logs only")
        if sprung or unsprung or mass_changes:
            raise click.UsageError(
                f"{studies[0]} names the channels and mass changes: leave out --sprung, --unsprung and --mass-change"
            )
        return read_study(studies[0])
    if paths[0].is_dir():
        raise click.UsageError(f"{paths[0]} is a directory: name a study file in it, or logs")
    if not (sprung and unsprung):
        raise click.UsageError("name the channels of the logs: --sprung NAME --unsprung NAME, or give a study file")
    title = " and ".join(path.name for path in paths)
    return study_from_logs(paths, sprung=sprung, unsprung=unsprung, mass_changes_kg=mass_changes, title=title)


def _taxi_test(seed: int, settings: dict[str, Any]) -> TaxiTest:
    """Run the field test that the options of `simulate taxi` describe."""
    import numpy as np

    from opid.mechanics.landing_gear import taxi_test
    from opid.mechanics.sensors import Sensor

    fine = settings["bits"] is None
    lower = {
        "noise_m_per_s2": settings["noise"],
        "corner_hz": settings["corner"],
        "cross_axis": settings["cross_axis"] / 100,
        "bits": settings["bits"],
        "range_m_per_s2": settings["full_scale"] or (None if fine else 50.0),
    }
    upper = lower | {
        "corner_hz": settings["corner"] * (1 + settings["corner_mismatch"] / 100),
        "gain": 1 + settings["gain_error"] / 100,
    }
    return taxi_test(
        _gear(settings),
        rng=np.random.default_rng(seed),
        mass_removed_kg=settings["mass_removed"],
        duration_s=settings["duration"],
        fs=settings["fs"],
        speed_m_per_s=(settings["speed_start"], settings["speed_stop"]),
        road_class=settings["road_class"],
        lower_sensor=Sensor(**lower),
        upper_sensor=Sensor(**upper),
    )


def _gear(settings: dict[str, Any]) -> LandingGear:
    from opid.mechanics.landing_gear import LandingGear
    from opid.mechanics.laws import default_law

    mass, stiffness, ground = (settings[name] for name in ("sprung_mass", "stiffness", "ground_stiffness"))
    damping, ratio = settings["damping"], settings["damping_ratio"]
    if damping is not None and ratio is not None:
        raise click.UsageError("--damping and --damping-ratio are both given: give one of them")
    if ratio is not None:
        damping = 2 * ratio * max((stiffness + ground) * mass, 0.0) ** 0.5
    return LandingGear(
        sprung_mass_kg=mass,
        suspension_stiffness_n_per_m=stiffness,
        suspension_damping_n_s_per_m=6000.0 if damping is None else damping,
        ground_stiffness_n_per_m=ground,
        law=_with_friction(default_law(settings["law"]), settings["friction"]),
    )


def _with_friction(law: Law, friction_n: float | None) -> Law:
    """Give the friction term of a law another amplitude; none at all for an amplitude of 0."""
    from dataclasses import replace

    from opid.mechanics.laws import Law

    if friction_n is None:
        return law
    rubbing = [term for term in law.terms if term.name in ("arctan_velocity", "coulomb_friction")]
    if len(rubbing) != 1:
        raise click.UsageError(
            f"--friction needs one friction term in --law, arctan_velocity or coulomb_friction; it is {law.name}"
        )
    rest = tuple(term for term in law.terms if term is not rubbing[0])
    rubbed = replace(rubbing[0], values=(friction_n, *rubbing[0].inner))
    return Law((*rest, rubbed) if friction_n else rest)


def _distinct(names: list[str]) -> list[str]:
    """Number the names that stand there twice."""
    return [f"{name}_{names[:i].count(name) + 1}" if names.count(name) > 1 else name for i, name in enumerate(names)]


@contextmanager
def _progress() -> Iterator[Callable[[str], None]]:
    """Show the step that is under way on stderr; nothing where that is no terminal."""
    from tqdm import tqdm

    with tqdm(bar_format="{desc} ({elapsed})", file=sys.stderr, disable=None, leave=False) as bar:
        yield bar.set_description_str


if __name__ == "__main__":
    main()
