"""What is below the suspension: `opid wheel` gives unsprung mass, tyre and road of an identified gear."""

from __future__ import annotations

from pathlib import Path

import click

from opid.cli.group import PATH, Output, example, main, out_option, result_name, with_output


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

    file = study / "study.toml" if (study / "study.toml").is_file() else study
    output = output.reserve(default=f"{result_name(file)}_wheel")
    with output.progress() as say:
        fits = read_fits(result)
        found = identify_wheel(read_study(file, kind=Study, progress=say), fits, progress=say)
        notes = output.write(found, command=["opid", "wheel", str(file), str(result)], progress=say)
    output.show(found, notes=notes)
