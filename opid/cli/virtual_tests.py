"""Virtual field tests: `opid demo` and `opid simulate taxi`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import REPORT, Output, end, example, free_directory, main, progress, with_force, with_output

if TYPE_CHECKING:
    from opid.mechanics.laws.law import Law
    from opid.virtual.taxi_tests.landing_gear import LandingGear, TaxiTest

ROAD_CLASSES = tuple("ABCDEFGH")
STUDY_FILES = ("study.toml", "truth.json")
TAXI_FILES = ("heavy.csv", "light.csv", *STUDY_FILES)


@main.command(epilog=example("opid demo --out demo_taxi --seed 2"))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("demo_taxi"),
    show_default=True,
    metavar="DIR",
    help="For the runs and the report.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of road and noise.")
@with_output
def demo(out: Path, seed: int, output: Output) -> None:
    """Simulate two taxi runs, identify them from their log files, and show truth beside estimate."""
    import numpy as np

    from opid.report import write_report
    from opid.studies.study_file import read_study
    from opid.suspensions.identification import identify
    from opid.suspensions.study import Study
    from opid.virtual.files.gear import read_truth, write_field_test
    from opid.virtual.taxi_tests.landing_gear import LandingGear, taxi_test

    output.directory(out, (*TAXI_FILES, *(f"report/{name}" for name in REPORT)))
    with output.progress() as say:
        say("two taxi runs")
        test = taxi_test(LandingGear(), rng=np.random.default_rng(seed))
        title = f"Two virtual taxi runs, seed {seed}"
        study = write_field_test(test, out, title=title, settings={"seed": seed})
        result = identify(read_study(study, kind=Study), progress=say)
        truth = read_truth(out / "truth.json")
        page = write_report(result, out / "report", truth, figures=output.figures, progress=say)
    notes = (
        f"The runs:   {out / 'heavy.csv'}, {out / 'light.csv'}",
        f"The study:  {study}",
        f"The report: {page} (open it in a browser)",
    )
    output.show(result, truth, notes=notes)
    end(result)


@main.group(epilog=example("opid simulate taxi runs"))
def simulate() -> None:
    """Make a field test with known truth."""


# the defaults are those of opid.mechanics (a test compares them), written out so that help needs no heavy import
@simulate.command(epilog=example("opid simulate taxi runs --law arctan_velocity+cubic_stiffness --noise 0.02"))
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
@click.option(
    "--law",
    default="arctan_velocity",
    show_default=True,
    help="Nonlinear law, one of `opid laws`; sums joined by +; or linear.",
)
@click.option(
    "--friction",
    type=click.FloatRange(min=0),
    metavar="N",
    help="Amplitude of the law's friction term; 0 leaves it out.",
)
@click.option("--road-class", type=click.Choice(ROAD_CLASSES), default="B", show_default=True, help="Of ISO 8608.")
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
@with_force
def taxi(out: Path, seed: int, overwrite: bool, **settings: Any) -> None:
    """Write two taxi runs of an aircraft at two masses into the directory OUT.

    Makes heavy.csv, light.csv, study.toml for `opid identify`, and truth.json.
    """
    from opid.virtual.files.gear import write_field_test

    free_directory(out, TAXI_FILES, overwrite=overwrite)
    with progress() as say:
        say("two taxi runs")
        test = _taxi_test(seed, settings)
        title = f"Two virtual taxi runs, seed {seed}"
        study = write_field_test(test, out, title=title, settings={"seed": seed} | settings)
    click.echo(f"{test.heavy.gear.sprung_mass_kg:g} kg: {out / 'heavy.csv'}")
    click.echo(f"{test.light.gear.sprung_mass_kg:g} kg: {out / 'light.csv'}")
    click.echo(f"Next: opid identify {study} --truth {out / 'truth.json'}")


def _taxi_test(seed: int, settings: dict[str, Any]) -> TaxiTest:
    """Run the field test that the options of `simulate taxi` describe."""
    import numpy as np

    from opid.virtual.taxi_tests.landing_gear import taxi_test
    from opid.virtual.taxi_tests.sensors import Sensor

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
    from opid.mechanics.laws.law import default_law
    from opid.virtual.taxi_tests.landing_gear import LandingGear

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

    from opid.mechanics.laws.kinds import LAWS
    from opid.mechanics.laws.law import Law

    if friction_n is None:
        return law
    rubbing = [term for term in law.terms if term.kind.is_friction]
    if len(rubbing) != 1:
        known = ", ".join(kind.name for kind in LAWS.values() if kind.is_friction)
        raise click.UsageError(f"--friction needs one friction term in --law ({known}); it is {law.name}")
    rest = tuple(term for term in law.terms if term is not rubbing[0])
    rubbed = replace(rubbing[0], values=(friction_n, *rubbing[0].inner))
    return Law((*rest, rubbed) if friction_n else rest)
