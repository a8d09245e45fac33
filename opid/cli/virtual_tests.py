"""Virtual taxi tests: `opid demo`, `opid simulate taxi` of one gear and `opid simulate aircraft` of a whole one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import main
from opid.cli.options import PATH, example, seed_option
from opid.cli.output import REPORT, Output, with_files, with_output

if TYPE_CHECKING:
    from opid.mechanics.laws.law import Law
    from opid.virtual.taxi_tests.airframe import Airframe, LandingGear
    from opid.virtual.taxi_tests.taxiing import TaxiTest

ROAD_CLASSES = tuple("ABCDEFGH")
STUDY_FILES = ("study.toml", "truth.json")
TAXI_FILES = ("heavy.csv", "light.csv", *STUDY_FILES)
POSITION_TOLERANCE_M = 0.01
"""Tolerance that the study of an aircraft states for its coordinates, like that of a real drawing."""


@main.command(epilog=example("opid demo --out demo_taxi --seed 2"))
@click.option(
    "--out",
    type=PATH,
    default=Path("demo_taxi"),
    show_default=True,
    metavar="DIR",
    help="Folder for the runs and the report.",
)
@seed_option("road and noise")
@with_output
def demo(seed: int, output: Output) -> None:
    """Simulate two taxi runs, identify them from their log files, and show truth beside estimate."""
    import numpy as np

    from opid.studies.study_file import read_study
    from opid.suspensions.identification import identify
    from opid.suspensions.study import Study
    from opid.virtual.taxi_tests.airframe import LandingGear
    from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_test, taxi_truth
    from opid.virtual.truth_file import write_field_test

    output = output.reserve((*TAXI_FILES, *(f"report/{name}" for name in REPORT)))
    out = output.folder
    with output.progress() as say:
        say("two taxi runs")
        test = taxi_test(LandingGear(), rng=np.random.default_rng(seed))
        runs = taxi_study(test, title=f"Two virtual taxi runs, seed {seed}")
        truth = taxi_truth(test, settings={"seed": seed})
        study = write_field_test(runs, truth, output.place)
        result = identify(read_study(study, kind=Study), progress=say)
        replace(output, out=out / "report", reserved=None).write(result, truth, progress=say)
    notes = (
        f"The runs:   {out / 'heavy.csv'}, {out / 'light.csv'}",
        f"The study:  {study}",
        f"The report: {out / 'report' / 'report.html'} (open it in a browser)",
    )
    output.show(result, truth, notes=notes)


@main.group(epilog=example("opid simulate taxi runs"))
def simulate() -> None:
    """Make a field test with known truth."""


def with_run_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of taxi runs of any aircraft."""
    for option in (
        click.option(
            "--road-class", type=click.Choice(ROAD_CLASSES), default="B", show_default=True, help="By ISO 8608."
        ),
        click.option("--noise", default=0.005, show_default=True, metavar="M/S2", help="Rms of each sensor's noise."),
        click.option("--fs", default=512.0, show_default=True, metavar="HZ", help="Sampling rate."),
        click.option("--duration", default=40.0, show_default=True, metavar="S", help="Length of each run."),
        seed_option("road and noise"),
        click.argument("out", type=PATH),
        with_files,
    ):
        command = option(command)
    return command


# The defaults are those of `opid.virtual`, as a test asserts; they stand here so that help needs no heavy import.
@simulate.command(epilog=example("opid simulate taxi runs --law arctan_velocity+cubic_stiffness --noise 0.02"))
@with_run_options
@click.option("--sprung-mass", default=1850.0, show_default=True, metavar="KG", help="Sprung mass M2 of the heavy run.")
@click.option("--mass-removed", default=220.0, show_default=True, metavar="KG", help="Taken off before the light run.")
@click.option("--stiffness", default=3.9e5, show_default=True, metavar="N/M", help="Stiffness K2 of the suspension.")
@click.option("--damping", type=float, metavar="NS/M", help="Its damping C2.  [default: 6000]")
@click.option("--damping-ratio", type=float, metavar="ZETA", help="C2 / (2 sqrt((K2 + K3) M2)), instead of --damping.")
@click.option(
    "--ground-stiffness", default=0.0, show_default=True, metavar="N/M", help="Ground spring K3 at the sprung mass."
)
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
@click.option("--speed-start", default=18.0, show_default=True, metavar="M/S", help="Speed at the beginning of a run.")
@click.option("--speed-stop", default=0.5, show_default=True, metavar="M/S", help="Speed at its end.")
@click.option("--corner", default=0.0, show_default=True, metavar="HZ", help="Corner of the AC coupling; 0 for none.")
@click.option("--corner-mismatch", default=0.0, show_default=True, metavar="%", help="Upper corner above the lower.")
@click.option("--gain-error", default=0.0, show_default=True, metavar="%", help="Gain error of the upper sensor.")
@click.option(
    "--cross-axis", default=0.0, show_default=True, metavar="%", help="Part of the fore-aft motion that leaks in."
)
@click.option("--bits", type=int, metavar="N", help="Resolution of the converter.  [default: fine]")
@click.option(
    "--range",
    "full_scale",
    type=float,
    metavar="M/S2",
    help="End of its range.  [default: 50 with --bits]",
)
def taxi(seed: int, output: Output, **settings: Any) -> None:
    """Write two taxi runs of an aircraft at two masses into the directory OUT.

    Makes heavy.csv, light.csv, study.toml for `opid identify`, and truth.json.
    """
    output = output.reserve(TAXI_FILES)
    _write_test(_simulate_gear, output, {"seed": seed} | settings, title=f"Two virtual taxi runs, seed {seed}")


@simulate.command(epilog=example("opid simulate aircraft plane --seed 2 --loading 500 -1 0.2"))
@with_run_options
@click.option(
    "--tracks",
    type=click.Choice(("independent", "coherent")),
    default="coherent",
    show_default=True,
    help="Tracks of left and right wheels: coherent as on one isotropic runway.",
)
@click.option("--random", "is_random", is_flag=True, help="Another aircraft for each seed.  [default: one of 5.4 t]")
@click.option("--bending", type=float, metavar="HZ", help="A fuselage that bends, at HZ.  [default: rigid]")
@click.option(
    "--loading",
    "loadings",
    nargs=3,
    type=float,
    multiple=True,
    metavar="KG X Y",
    help="Put on for the second run; once for each mass.  [default: 500 -1 0.2]",
)
@click.option(
    "--weaken",
    nargs=2,
    type=(str, float),
    multiple=True,
    metavar="GEAR FACTOR",
    help="Times FACTOR the stiffness of the strut nose, left or right, as harm would: left 0.95.",
)
@click.option("--date", "day", type=click.DateTime(["%Y-%m-%d"]), metavar="YYYY-MM-DD", help="Date of the runs.")
def aircraft(seed: int, day: datetime | None, output: Output, **settings: Any) -> None:
    """Write two taxi runs of an aircraft on three gears at two loadings into the directory OUT.

    The sensors on the airframe stand beside the struts, a further one near the tail. Makes reference.csv, loaded.csv,
    study.toml for `opid identify`, which states the noise and coordinates to 1 cm, and truth.json.
    """
    output = output.reserve(("reference.csv", "loaded.csv", *STUDY_FILES))
    settings["loadings"] = settings["loadings"] or ((500.0, -1.0, 0.2),)
    _write_test(
        _simulate_aircraft,
        output,
        {"seed": seed} | settings,
        title=f"A virtual aircraft on three gears, seed {seed}",
        day=None if day is None else day.date(),
        position_tolerance_m=POSITION_TOLERANCE_M,
        # Noise can be stated only where there is some.
        noise_m_per_s2=settings["noise"] or None,
    )


def _write_test(
    make: Callable[[dict[str, Any]], TaxiTest], output: Output, settings: dict[str, Any], **facts: Any
) -> None:
    """Simulate a taxi test, write it with the facts that its owner knows, and print the next command."""
    from opid.virtual.taxi_tests.taxiing import taxi_study, taxi_truth
    from opid.virtual.truth_file import write_field_test

    with output.progress() as say:
        say("two taxi runs")
        test = make(settings)
        say("the files")
        study = taxi_study(test, **facts)
        path = write_field_test(study, taxi_truth(test, settings=settings), output.place)
    runs = zip(study.runs, test.runs, strict=True)
    made = "\n".join(f"{run.airframe.mass_kg:g} kg: {output.folder / named.name}.csv" for named, run in runs)
    output.show_made(made, "identify", path)


def _simulate_gear(settings: dict[str, Any]) -> TaxiTest:
    import numpy as np

    from opid.virtual.taxi_tests.sensors import Sensor
    from opid.virtual.taxi_tests.taxiing import taxi_test

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
        _make_gear(settings),
        rng=np.random.default_rng(settings["seed"]),
        mass_removed_kg=settings["mass_removed"],
        duration_s=settings["duration"],
        fs=settings["fs"],
        speed_m_per_s=(settings["speed_start"], settings["speed_stop"]),
        road_class=settings["road_class"],
        lower_sensor=Sensor(**lower),
        upper_sensor=Sensor(**upper),
    )


def _make_gear(settings: dict[str, Any]) -> LandingGear:
    from opid.mechanics.laws.law import default_law
    from opid.virtual.taxi_tests.airframe import LandingGear

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
        law=_replace_friction(default_law(settings["law"]), settings["friction"]),
    )


def _replace_friction(law: Law, friction_n: float | None) -> Law:
    """Return the law with another amplitude of its friction term, or without that term if the amplitude is 0."""
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


def _simulate_aircraft(settings: dict[str, Any]) -> TaxiTest:
    import numpy as np

    from opid.suspensions.study import PointMass
    from opid.virtual.taxi_tests.aircraft import default_aircraft, random_aircraft, with_bending
    from opid.virtual.taxi_tests.sensors import Sensor
    from opid.virtual.taxi_tests.taxiing import taxi_test

    sensor = Sensor(noise_m_per_s2=settings["noise"])
    aircraft_rng, test_rng = np.random.default_rng(settings["seed"]).spawn(2)
    airframe = random_aircraft(aircraft_rng) if settings["is_random"] else default_aircraft()
    if settings["bending"] is not None:
        airframe = with_bending(airframe, frequency_hz=settings["bending"])
    for name, factor in settings["weaken"]:
        airframe = _weaken(airframe, name, factor)
    # The sensors stand ahead of the struts and nearer to the middle, where a fuselage has room.
    beside = {gear.name: (gear.x_m + 0.3, round(0.85 * gear.y_m, 2)) for gear in airframe.gears}
    behind = min(gear.x_m for gear in airframe.gears) - 3.0
    return taxi_test(
        airframe,
        rng=test_rng,
        loadings=[[PointMass(*each) for each in settings["loadings"]]],
        duration_s=settings["duration"],
        fs=settings["fs"],
        road_class=settings["road_class"],
        coherent_tracks=settings["tracks"] == "coherent",
        sprung_sensors=beside,
        further_sensors={"tail_z": (behind, 0.0)},
        lower_sensor=sensor,
        upper_sensor=sensor,
    )


def _weaken(airframe: Airframe, name: str, factor: float) -> Airframe:
    """Return the aircraft with the stiffness of one strut times `factor` and the same law."""
    from opid.errors import InputError, nearest

    names = [gear.name for gear in airframe.gears]
    if name not in names:
        raise InputError(f"--weaken names the gear {name!r}, which is not there ({nearest(name, names)})")
    if not 0.0 < factor < float("inf"):
        raise InputError(f"--weaken {name} has the factor {factor:g}, give a positive one, as 0.95 for 5 % less")
    gears = tuple(
        replace(gear, suspension_stiffness_n_per_m=factor * gear.suspension_stiffness_n_per_m)
        if gear.name == name
        else gear
        for gear in airframe.gears
    )
    return replace(airframe, gears=gears)
