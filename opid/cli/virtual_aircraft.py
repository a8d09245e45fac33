"""A virtual field test of a whole aircraft: `opid simulate aircraft`."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import example, free_directory, progress, with_force
from opid.cli.virtual_tests import ROAD_CLASSES, STUDY_FILES, simulate

if TYPE_CHECKING:
    from opid.virtual.taxi_tests.airframe import Airframe
    from opid.virtual.taxi_tests.taxiing_aircraft import AircraftTest

POSITION_TOLERANCE_M = 0.01
"""What the study says of its coordinates, as of those of a real drawing."""


@simulate.command(epilog=example("opid simulate aircraft plane --seed 2 --loading 500 -1 0.2"))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Of runway and noise.")
@click.option(
    "--tracks",
    type=click.Choice(("independent", "coherent")),
    default="coherent",
    show_default=True,
    help="Of left and right wheels: coherent as on one isotropic runway.",
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
@click.option("--duration", default=40.0, show_default=True, metavar="S", help="Length of each run.")
@click.option("--fs", default=512.0, show_default=True, metavar="HZ", help="Sampling rate.")
@click.option("--noise", default=0.005, show_default=True, metavar="M/S2", help="Rms of each sensor's noise.")
@click.option("--road-class", type=click.Choice(ROAD_CLASSES), default="B", show_default=True, help="Of ISO 8608.")
@click.option("--date", "day", type=click.DateTime(["%Y-%m-%d"]), metavar="YYYY-MM-DD", help="Of the runs.")
@with_force
def aircraft(out: Path, seed: int, day: datetime | None, overwrite: bool, **settings: Any) -> None:
    """Write two taxi runs of an aircraft on three gears at two loadings into the directory OUT.

    The sensors on the airframe stand beside the struts, a further one near the tail. Makes reference.csv, loaded.csv,
    study.toml for `opid identify`, which states the noise and coordinates to 1 cm, and truth.json.
    """
    from opid.virtual.files.aircraft import write_aircraft_test

    free_directory(out, ("reference.csv", "loaded.csv", *STUDY_FILES), overwrite=overwrite)
    settings["loadings"] = settings["loadings"] or ((500.0, -1.0, 0.2),)
    with progress() as say:
        say("two taxi runs")
        test = _aircraft_test(seed, settings)
        say("the files")
        title = f"A virtual aircraft on three gears, seed {seed}"
        stated = {"seed": seed} | settings
        study = write_aircraft_test(
            test,
            out,
            title=title,
            day=None if day is None else day.date(),
            settings=stated,
            position_tolerance_m=POSITION_TOLERANCE_M,
            # no level can be stated of none
            noise_m_per_s2=settings["noise"] or None,
        )
    for name, run in zip(("reference", "loaded"), test.runs, strict=True):
        click.echo(f"{run.airframe.mass_kg:.6g} kg: {out / name}.csv")
    click.echo(f"Next: opid identify {study} --truth {out / 'truth.json'}")


def _aircraft_test(seed: int, settings: dict[str, Any]) -> AircraftTest:
    """Run the field test that the options describe."""
    import numpy as np

    from opid.virtual.taxi_tests.aircraft import default_aircraft, random_aircraft, with_bending
    from opid.virtual.taxi_tests.airframe import Loading
    from opid.virtual.taxi_tests.sensors import Sensor
    from opid.virtual.taxi_tests.taxiing_aircraft import aircraft_test

    aircraft_rng, test_rng = np.random.default_rng(seed).spawn(2)
    airframe = random_aircraft(aircraft_rng) if settings["is_random"] else default_aircraft()
    if settings["bending"] is not None:
        airframe = with_bending(airframe, frequency_hz=settings["bending"])
    for name, factor in settings["weaken"]:
        airframe = _weakened(airframe, name, factor)
    # ahead of the struts and nearer to the middle, as there is room in a fuselage
    beside = {gear.name: (gear.x_m + 0.3, round(0.85 * gear.y_m, 2)) for gear in airframe.gears}
    behind = min(gear.x_m for gear in airframe.gears) - 3.0
    return aircraft_test(
        airframe,
        rng=test_rng,
        loadings=[[Loading(*each) for each in settings["loadings"]]],
        duration_s=settings["duration"],
        fs=settings["fs"],
        road_class=settings["road_class"],
        coherent_tracks=settings["tracks"] == "coherent",
        sprung_sensors=beside,
        further_sensors={"tail_z": (behind, 0.0)},
        sensor=Sensor(noise_m_per_s2=settings["noise"]),
    )


def _weakened(airframe: Airframe, name: str, factor: float) -> Airframe:
    """The aircraft with the stiffness of one strut times `factor`; its law stays."""
    from dataclasses import replace

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
