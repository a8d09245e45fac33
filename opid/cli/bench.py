"""Force against motion on a test bench: `opid law`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from opid.cli.group import Number, Output, example, main, report_note, with_output


@main.command(epilog=example("opid law bench.csv --force load --travel stroke --velocity speed --out bench_result"))
@click.argument("bench", type=click.Path(path_type=Path), metavar="STUDY.toml | BENCH.csv")
@click.option("--force", metavar="COL", help="Without a study: column of the force, in N, kN, lbf, ...")
@click.option("--travel", metavar="COL", help="Without a study: column of the travel, in m, mm, in, ...")
@click.option("--velocity", metavar="COL", help="Column of its rate, in m/s, mm/s, ...  [default: differentiated]")
@click.option("--moving-mass", is_flag=True, help="Parts of unknown mass move between force cell and specimen.")
@click.option(
    "--mass",
    "mass_kg",
    type=Number("kg"),
    metavar="KG",
    help="Of a body that the specimen alone holds: --force is its acceleration.",
)
@click.option("--quasi-static", is_flag=True, help="A slow test whose time means nothing; the file may have none.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="For result.json, report and figures.")
@partial(with_output, option="--overwrite")  # --force is a column here
def law(bench: Path, out: Path | None, output: Output, **of_log: Any) -> None:
    """Find the law of a damper or spring from its measured force and motion.

    F = F0 + K z + C z' + f(z, z'), f a sum of laws of the library, with intervals, friction and rubber that remember
    among them; and what of the force no law explains (backlash, moving parts). With --moving-mass the force is m z''
    more, and the law is refined until the motion simulated from the force alone is the recorded one. With --mass no
    force need be measured: --force is the acceleration of a body that the specimen alone holds, and F = -m a.

    A study file with a table [bench] says all of this itself.
    """
    from opid.report import write_report
    from opid.studies.bench_study import bench_study_from_log
    from opid.studies.study_file import read_study
    from opid.suspensions.bench.law import law_of_bench
    from opid.suspensions.bench.study import BenchStudy

    given = {name: value for name, value in of_log.items() if value is not None and value is not False}
    options = [f"--{name.removesuffix('_kg').replace('_', '-')}" for name in given]
    is_study = bench.suffix.lower() == ".toml"
    if is_study and given:
        raise click.UsageError(f"{bench} is a study, which says that itself: leave out {' and '.join(options)}")
    if not is_study and not {"force", "travel"} <= given.keys():
        raise click.UsageError(
            "name the columns of the log: --force COL --travel COL (`opid inspect LOG` lists them), or give a study"
        )
    target = None if out is None else output.directory(out)
    with output.progress() as say:
        say("the record")
        study = (
            read_study(bench, kind=BenchStudy, progress=say)
            if is_study
            else bench_study_from_log(bench, progress=say, **given)
        )
        result = law_of_bench(study, progress=say)
        page = None if target is None else write_report(result, target, figures=output.figures, progress=say)
    output.show(result, notes=report_note(page))
