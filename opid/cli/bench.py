"""Force against motion on a test bench: `opid law`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from opid.cli.group import Number, Output, end, example, main, report_note, with_output

if TYPE_CHECKING:
    from opid.signals.recording import Recording


@main.command(epilog=example("opid law bench.csv --force load --travel stroke --velocity speed --out bench_result"))
@click.argument("bench", type=click.Path(path_type=Path), metavar="BENCH.csv")
@click.option("--force", required=True, metavar="COL", help="Column of the force, in N, kN, lbf, ...")
@click.option("--travel", required=True, metavar="COL", help="Column of the travel, in m, mm, in, ...")
@click.option("--velocity", metavar="COL", help="Column of its rate, in m/s, mm/s, ...  [default: differentiated]")
@click.option("--moving-mass", is_flag=True, help="Parts of unknown mass move between force cell and specimen.")
@click.option(
    "--mass",
    type=Number("kg"),
    metavar="KG",
    help="Of a body that the specimen alone holds: --force is its acceleration.",
)
@click.option("--quasi-static", is_flag=True, help="A slow test whose time means nothing; the file may have none.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For result.json, report and figures.")
@partial(with_output, option="--overwrite")  # --force is a column here
def law(
    bench: Path,
    force: str,
    travel: str,
    velocity: str | None,
    moving_mass: bool,
    mass: float | None,
    quasi_static: bool,
    out: Path | None,
    output: Output,
) -> None:
    """Find the law of a damper or spring from its measured force and motion.

    F = F0 + K z + C z' + f(z, z'), f a sum of laws of the library, with intervals, friction and rubber that remember
    among them; and what of the force no law explains (backlash, moving parts). With --moving-mass the force is m z''
    more, and the law is refined until the motion simulated from the force alone is the recorded one. With --mass no
    force need be measured: --force is the acceleration of a body that the specimen alone holds, and F = -m a.
    """
    from dataclasses import replace

    from opid.report import write_report
    from opid.suspensions.bench.law import law_of_bench
    from opid.suspensions.bench.record import bench_from_recording, quasi_static_bench

    target = None if out is None else output.directory(out)
    with output.progress() as say:
        say("the record")
        wanted = [name for name in dict.fromkeys((force, travel, velocity)) if name is not None]
        if quasi_static:
            if velocity is not None or moving_mass or mass is not None:
                raise click.UsageError(
                    "--quasi-static: a test without time has no --velocity, no --moving-mass and no --mass"
                )
            record = quasi_static_bench(_without_time(bench, wanted), force=force, travel=travel)
        else:
            recording = _with_time(bench, wanted)
            record = bench_from_recording(
                recording, force=force, travel=travel, velocity=velocity, moving_mass=moving_mass, mass_kg=mass
            )
        result = law_of_bench(replace(record, log=str(bench)), title=bench.name, progress=say)
        page = None if target is None else write_report(result, target, figures=output.figures, progress=say)
    output.show(result, notes=report_note(page))
    end(result)


def _with_time(path: Path, channels: list[str]) -> Recording:
    """Read a test with its time; where only that is at fault, say how to do without."""
    from opid.errors import InputError
    from opid.signals.logs import read_log

    try:
        return read_log(path, channels=channels)
    except InputError as error:
        try:
            _without_time(path, channels)
        except InputError:
            raise error from None
        raise InputError(f"{error}; a test so slow that time means nothing needs none: --quasi-static") from None


def _without_time(path: Path, channels: list[str]) -> Recording:
    from opid.signals.log_settings import LogSettings
    from opid.signals.logs import read_log

    return read_log(path, LogSettings(fs_hz=1.0), channels=channels)
