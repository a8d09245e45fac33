"""Modes: linear ones from impacts, nonlinear models from sine beats, tests at phase resonance, and free decays."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from opid.cli.group import main
from opid.cli.options import PATH, Unit, channel_units_option, example, out_option, time_unit_option, truth_option
from opid.cli.output import REPORT, Output, result_name, with_output
from opid.errors import FileError, InputError, NotDeterminedError
from opid.modal.settings import MODAL
from opid.progress import Say

if TYPE_CHECKING:
    from opid.modal.decay.free_decay import Decay
    from opid.modal.linear.fitted_modes import FittedModes
    from opid.modal.linear.stages import ModeStages
    from opid.signals.recording import FloatArray, Recording
    from opid.studies.modal_study import Decays

FRACTION = click.FloatRange(min=0, max=1, min_open=True)
OPTIONS = {
    "near_hz": "--near",
    "start_s": "--start",
    "stop_s": "--stop",
    "stiffness_order": "--stiffness-order",
    "damping_order": "--damping-order",
    "memory": "--memory",
    "gain_tolerance": "--gain-tolerance",
}
"""Settings as the messages of the library name them, and the options of `opid decay` for them."""


@main.command(epilog=example("opid modal bracket/study.toml --truth bracket/truth.json --out bracket_result"))
@click.argument("study", type=PATH, metavar="STUDY.toml")
@out_option("Folder for the report.  [default: STUDY_result]")
@click.option(
    "--stiffness-order",
    type=click.IntRange(1, 5),
    metavar="N",
    help="Order of the stiffness, whatever the study says.",
)
@click.option(
    "--damping-order", type=click.IntRange(1, 5), metavar="N", help="Order of the damping, whatever the study says."
)
@click.option(
    "--free-linear/--fixed-linear",
    default=None,
    help="Correct frequency and damping in the fit, or not.  [default: as the study says, or the data]",
)
@click.option(
    "--frequency-threshold",
    type=FRACTION,
    metavar="X",
    help="Shift between levels, a fraction, from which a mode is nonlinear.  [default: as the study says, or 0.002]",
)
@click.option(
    "--damping-threshold",
    type=FRACTION,
    metavar="X",
    help="Shift of its damping ratio, likewise.  [default: as the study says, or 0.15]",
)
@truth_option
@with_output
def modal(study: Path, truth: Path | None, output: Output, **settings: Any) -> None:
    """Identify a nonlinear modal model from linear modes and sine beats, and judge it by a truth test.

    Stiffness and damping of each nonlinear mode over its amplitude, with intervals, beside what the linear model makes
    of the same forces.

    The report goes to the folder STUDY_result here: bracket_result for bracket.toml, and for bracket/study.toml.

    `opid simulate sine-beats OUT` writes a study as a template, with logs to try it on; the study file, what to record
    and what the warnings mean stand in docs/nonlinear_modal_models.md.
    """
    from opid.mechanics.truth import ModalTruth
    from opid.modal.identification import identify_modes
    from opid.modal.study import ModalStudy
    from opid.report.nonlinear_modes import write_command
    from opid.studies.study_file import read_study
    from opid.virtual.truth_file import read_truth

    output = output.reserve(default=f"{result_name(study)}_result")
    known = None if truth is None else read_truth(truth, ModalTruth)
    given = {name: value for name, value in settings.items() if value is not None}
    with output.progress() as say, output.name_files(study):
        tests = replace(read_study(study, kind=ModalStudy, progress=say), **given)
        result = identify_modes(tests, progress=say)
        notes = output.write(result, known, command=write_command(result, given), progress=say)
    output.show(result, known, notes=notes)


@main.command(epilog=example("opid modes hit_1.csv hit_2.csv --drive-point tip_z --band 20 800 --out tip_modes"))
@click.argument("logs", type=PATH, metavar="LOG...", nargs=-1, required=True)
@click.option("--force-channel", default="force", show_default=True, metavar="NAME", help="Channel of the force.")
@click.option(
    "--drive-point",
    "drive_points",
    required=True,
    multiple=True,
    metavar="NAME",
    help="Channel of the sensor where the force acts: one for all logs, or one for each of them in turn.",
)
@click.option(
    "--band",
    type=(float, float),
    required=True,
    metavar="LOW HIGH",
    help="Band, Hz, that begins and ends between modes.",
)
@click.option(
    "--stage",
    "stages",
    multiple=True,
    metavar="NAME",
    help="Stage of the campaign, once for each log in turn: the modes of each stage are found and compared.",
)
@channel_units_option("Unit of a channel, like hammer=lbf, whatever the logs say; once for each channel.")
@time_unit_option
@out_option("Folder for result.json, report and modes.csv, which a study takes as its modes; one for each stage.")
@with_output
def modes(logs: tuple[Path, ...], stages: tuple[str, ...], output: Output, **settings: Any) -> None:
    """Find linear modes from impacts or random forces: frequencies, damping, and mass-normalised shapes.

    Each log is a record that begins at rest and has decayed at its end, in which one force drives the structure. All
    channels that read a motion (g, mm/s, mm) or a strain (ustrain) are sensors. Several logs of one drive point are
    averaged; several drive points separate modes of nearly one frequency. With a stage for each log, each stage has
    modes of its own, and by how much they moved since the first one is told and drawn.
    """
    from opid.modal.linear.modes_file import write_modes

    names = [f"modes_{number}.csv" for number in range(1, len({*stages}) + 1)] or ["modes.csv"]
    output = output.reserve((*REPORT, *names))
    with output.progress() as say, output.name_files(*logs):
        found = _find_stages(logs, stages, settings, say) if stages else _find_modes(logs, settings, say)
        with output.together(("modes.csv", "modes_[0-9]*.csv")) as folder:
            notes = output.write(found, progress=say)
            for name, each in zip(names, found.each_stage, strict=True):
                if folder is None:
                    break
                if each.has_scale:
                    write_modes(each.modes, folder / name)
                    notes = (*notes, f"Modes: {output.folder / name} (the file that a study names as its modes)")
                else:
                    note = f"There is no {name}, because the shapes are not mass-normalised: see the warnings."
                    notes = (*notes, note)
    output.show(found, notes=notes)


def _find_stages(logs: tuple[Path, ...], stages: tuple[str, ...], settings: Mapping[str, Any], say: Say) -> ModeStages:
    """Return the linear modes of each stage by its logs, and how they moved."""
    from opid.modal.linear.stages import compare_stages

    if len(stages) != len(logs):
        raise InputError(
            f"--stage is given {len(stages)} times for {len(logs)} logs: give it once for each of them in their order"
        )
    drive_points = _repeat_drive_points(settings["drive_points"], len(logs))
    found = {}
    for stage in dict.fromkeys(stages):
        own = [number for number, name in enumerate(stages) if name == stage]
        say(f"stage {stage}")
        given = {**settings, "drive_points": tuple(drive_points[number] for number in own)}
        found[stage] = _find_modes(tuple(logs[number] for number in own), given, say)
    given = {"logs": [str(log) for log in logs], "stages": stages, **settings}
    return replace(compare_stages(found), settings=given)


def _repeat_drive_points(drive_points: tuple[str, ...], n_logs: int) -> tuple[str, ...]:
    """Return the drive point of each log."""
    if len(drive_points) not in (1, n_logs):
        raise InputError(
            f"--drive-point is given {len(drive_points)} times for {n_logs} logs: give it once for all of them, or "
            "once for each in their order"
        )
    return drive_points * (n_logs if len(drive_points) == 1 else 1)


def _find_modes(logs: tuple[Path, ...], settings: Mapping[str, Any], say: Say) -> FittedModes:
    """Return the linear modes of logs of forced records."""
    from opid.modal.linear.frequency_response import ForcedRecord, forced_record, measured_response
    from opid.modal.linear.response_fit import fit_modes

    drive_points = _repeat_drive_points(settings["drive_points"], len(logs))
    records: dict[str, list[ForcedRecord]] = {}
    for number, (log, drive_point) in enumerate(zip(logs, drive_points, strict=True)):
        say(f"log {number + 1} of {len(logs)}")
        recording = _read_channels(log, dict(settings["units"]), settings["time_unit"])
        record = forced_record(recording, name=str(log), force=settings["force_channel"], drive_point=drive_point)
        records.setdefault(drive_point, []).append(record)
    longest = max(record.force.size for several in records.values() for record in several)
    padded = [[record.padded_to(longest) for record in several] for several in records.values()]
    say("the modes")
    found = fit_modes([measured_response(each) for each in padded], band_hz=settings["band"])
    given = {"logs": [str(log) for log in logs], **settings}
    files = tuple(file for several in padded for record in several for file in record.files)
    return replace(found, settings=given, files=files)


def _read_channels(log: Path, units: Mapping[str, str], time_unit: str | None) -> Recording:
    """Return all channels of a log in SI units, some of them in a unit whatever the log says."""
    from opid.signals.conversion import recording_of
    from opid.signals.log import ChannelSettings, LogSettings
    from opid.signals.logs import open_log

    how = LogSettings(time_unit=time_unit)
    opened = open_log(log, how)
    for name in units:
        opened.find(name)
    for name in opened.signals:
        track, column = opened.find(name)
        if track.channels[column].unit is None and name not in units:
            raise FileError(f"channel {name!r} of {log} states no unit: give it, like --unit {shlex.quote(name)}=N")
    channels = {name: ChannelSettings(name, unit=units.get(name)) for name in opened.signals}
    return recording_of(opened, how, channels=channels)


@main.command(epilog=example("opid resonance bracket/study.toml --truth bracket/truth.json --out bracket_result"))
@click.argument("study", type=PATH, metavar="STUDY.toml")
@out_option("Folder for the report.  [default: STUDY_result]")
@click.option(
    "--mode", type=click.IntRange(min=1), metavar="N", help="Number of the mode.  [default: all that the tests hold]"
)
@click.option(
    "--hold-out",
    metavar="CURVE",
    help='Predict this response curve by the law of the others, "highest" for that of the largest motion.',
)
@click.option(
    "--free-mass",
    is_flag=True,
    help="Find the scale of the shape from the response curves, where shapes are not mass-normalised.",
)
@truth_option
@with_output
def resonance(
    study: Path, mode: int | None, hold_out: str | None, free_mass: bool, truth: Path | None, output: Output
) -> None:
    """Read tests at phase resonance: backbone, damping and harmonics over amplitude, and the law of the mode.

    From logs of force appropriation or control-based continuation, of one level each or of several, whose tests have
    use = "resonance" in a study like that of `opid modal`, or from stepped-sine response curves in its [[curves]], or
    both. Steady levels are found, and what is off quadrature is corrected. Each test and each curve is of the mode that
    it names, or of the one that it moves most; several modes are reported together.

    The report goes to the folder STUDY_result here: bracket_result for bracket.toml, and for bracket/study.toml.

    `opid simulate resonance OUT` writes a study as a template, with a log to try it on.
    """
    from opid.mechanics.truth import ModalTruth
    from opid.modal.resonance.identification import identify_resonance, identify_resonances
    from opid.modal.study import ModalStudy
    from opid.studies.study_file import read_study
    from opid.virtual.truth_file import read_truth

    output = output.reserve(default=f"{result_name(study)}_result")
    known = None if truth is None else read_truth(truth, ModalTruth)
    with output.progress() as say, output.name_files(study):
        tests = read_study(study, kind=ModalStudy, progress=say)
        if mode is None:
            every = identify_resonances(tests, hold_out=hold_out, free_mass=free_mass, progress=say)
            result = every.only or every
        else:
            result = identify_resonance(tests, mode=mode, hold_out=hold_out, free_mass=free_mass, progress=say)
        notes = output.write(result, known, progress=say)
    output.show(result, known, notes=notes)


@main.command(epilog=example("opid decay ring_down.csv --channel tip_z --near 40 --out decay_result"))
@click.argument("logs", type=PATH, metavar="LOG...", nargs=-1, required=True)
@click.option(
    "--channel",
    metavar="NAME",
    help="An acceleration, a velocity, a displacement, an angle or a strain.",
)
@click.option(
    "--study",
    type=PATH,
    metavar="STUDY.toml",
    help="Study of modal tests, whose shapes and sensors filter the mode, instead of --channel.",
)
@click.option(
    "--mode",
    type=click.IntRange(min=1),
    metavar="N",
    help="Mode of the study, counted from 1.  [default: the one that moves most]",
)
@click.option("--unit", type=Unit(), metavar="UNIT", help="Unit of the channel (g, mm/s, ...), whatever the log says.")
@time_unit_option
@click.option("--near", type=float, metavar="HZ", help="Frequency of the mode.  [default: the highest peak]")
@click.option("--start", type=float, metavar="S", help="Start of the decay, s from the first sample.  [default: found]")
@click.option("--stop", type=float, metavar="S", help="End of the decay, s from the first sample.  [default: found]")
@click.option(
    "--stiffness-order",
    type=click.IntRange(1, 5),
    metavar="N",
    help="Order of the stiffness.  [default: found]",
)
@click.option(
    "--damping-order",
    type=click.IntRange(1, 5),
    metavar="N",
    help="Order of the damping.  [default: found]",
)
@click.option(
    "--memory",
    metavar="KIND",
    help="Kind of the joint with memory: iwan_friction, dahl_friction or bouc_wen.  [default: found]",
)
@click.option(
    "--gain-tolerance",
    type=click.FloatRange(min=0, max=1, max_open=True),
    metavar="FRACTION",
    help="Standard deviation of the calibration, 0.01 for 1 %.  "
    f"[default: that of the study, or {MODAL.gain_tolerance:g}]",
)
@out_option("Folder for result.json, report and figure.")
@with_output
def decay(logs: tuple[Path, ...], output: Output, **settings: Any) -> None:
    """Follow a free decay: frequency and damping over amplitude, and the law of the mode.

    From one sensor, or from all sensors of a study by the shape of the mode, and no force. Several logs are repeats:
    their law is a common one, and its intervals at zero amplitude hold their scatter. Where several modes ring in the
    sensor, a --study separates them with the shapes.
    """
    from opid.studies.modal_study import read_decays

    _check_source(settings)
    if twice := sorted({str(log) for log in logs if logs.count(log) > 1}):
        raise click.UsageError(f"{', '.join(twice)} is given twice: a log is no repeat of itself; give each log once")
    study = settings["study"]
    output = output.reserve()
    with output.progress() as say, output.name_files(*logs, *([study] if study else [])):
        read = read_decays(study, logs, say) if study else None
        try:
            found = _follow_decays(logs, read, settings, say)
        except InputError as error:
            raise error.reword(_name_options(str(error), settings)) from error
        except NotDeterminedError as error:
            raise NotDeterminedError(_name_options(str(error), settings), error.partial) from error
        notes = output.write(found, progress=say)
    output.show(found, notes=notes)


def _follow_decays(logs: tuple[Path, ...], study: Decays | None, settings: Mapping[str, Any], say: Say) -> Decay:
    """Return the free decay in a log, or those in several logs pooled."""
    from opid.modal.decay.free_decay import pool_decays

    settings = {name: str(each) if isinstance(each, Path) else each for name, each in settings.items()}
    if study is None:
        decays = [_follow_decay(log, settings, say) for log in logs]
    else:
        decays = _filter_decays(logs, study, settings, say)
    if len(decays) == 1:
        return decays[0]
    say("the common law")
    named = [replace(each, name=log.name) for each, log in zip(decays, logs, strict=True)]
    pooled = pool_decays(named, **{name: settings[name] for name in ("stiffness_order", "damping_order", "memory")})
    return replace(
        pooled,
        name=_name_source(settings, decays[0].mode),
        warnings=tuple(_name_options(text, settings) for text in pooled.warnings),
        settings={"logs": [str(log) for log in logs], **settings, "mode": decays[0].mode},
        files=tuple(file for each in decays for file in each.files),
    )


def _follow_decay(log: Path, settings: Mapping[str, Any], say: Say) -> Decay:
    """Return the free decay in a channel of a log; its warnings name the options of this command."""
    from opid.modal.decay.free_decay import LENGTHS, QUANTITIES, UNITS, free_decay

    say("the record")
    kinds = {
        length + unit.removeprefix("m"): (length, quantity)
        for length in LENGTHS
        for unit, quantity in zip(UNITS, QUANTITIES, strict=True)
    }
    record, force = _read_channel(log, settings, kinds)
    length, quantity = kinds[record.channels[0].unit]
    say("the decay")
    found = free_decay(
        record.samples[:, 0],
        fs=record.fs,
        quantity=quantity,
        length=length,
        near_hz=settings["near"],
        start_s=settings["start"],
        stop_s=settings["stop"],
        force=force,
        stiffness_order=settings["stiffness_order"],
        damping_order=settings["damping_order"],
        memory=settings["memory"],
        gain_tolerance=MODAL.gain_tolerance if settings["gain_tolerance"] is None else settings["gain_tolerance"],
        name=_name_source(settings, None),
    )
    warnings = tuple(_name_options(text, settings) for text in found.warnings)
    return replace(found, warnings=warnings, settings={"log": str(log), **settings}, files=record.files)


def _filter_decays(logs: tuple[Path, ...], study: Decays, settings: Mapping[str, Any], say: Say) -> list[Decay]:
    """Return the free decay of one mode in each log, by the shapes of a study."""
    from opid.modal.decay.free_decay import decay_of
    from opid.modal.forced.mode_tests import find_largest_mode

    tests = study.tests
    known = study.gain_tolerance if settings["gain_tolerance"] is None else settings["gain_tolerance"]
    elastic = [number + 1 for number, is_elastic in enumerate(tests[0].modes.elastic) if is_elastic]
    mode = find_largest_mode(tests[0], elastic) if settings["mode"] is None else settings["mode"]
    options = {name: settings[name] for name in ("stiffness_order", "damping_order", "memory")}
    limits = {"start_s": settings["start"], "stop_s": settings["stop"]}
    decays = []
    for log, test in zip(logs, tests, strict=True):
        say(f"the decay in {log.name}")
        found = decay_of(test, mode, **options, **limits, gain_tolerance=known)
        warnings = tuple(_name_options(text, settings) for text in found.warnings)
        own = {"log": str(log), **settings, "mode": mode}
        name = _name_source(settings, mode)
        decays.append(replace(found, name=name, warnings=warnings, settings=own, files=test.recording.files))
    return decays


def _name_source(settings: Mapping[str, Any], mode: int | None) -> str:
    return str(settings["channel"]) if mode is None else f"mode {mode}"


def _check_source(settings: Mapping[str, Any]) -> None:
    """Refuse options that do not go together: a channel of the logs, or a mode of a study."""
    if (settings["channel"] is None) == (settings["study"] is None):
        both = "" if settings["channel"] is None else ", not both"
        raise click.UsageError(
            f"give --channel NAME (one sensor), or --study STUDY.toml (the shapes of its modes){both}"
        )
    others = ("unit", "time_unit", "near") if settings["study"] is not None else ("mode",)
    given = [f"--{name.replace('_', '-')}" for name in others if settings[name] is not None]
    if given and settings["study"] is not None:
        raise click.UsageError(
            f"--study says units and frequencies: leave {', '.join(given)} out (--mode names a mode)"
        )
    if given:
        raise click.UsageError(
            "--mode needs the shapes of a study: give --study STUDY.toml, or --near HZ with --channel"
        )


def _name_options(text: str, settings: Mapping[str, Any]) -> str:
    """Return a message of the library with the options of this command in place of its settings."""
    options = OPTIONS if settings["study"] is None else OPTIONS | {"near_hz": "--mode"}
    return re.sub(rf"\b({'|'.join(options)})\b", lambda found: options[found[0]], text)


def _read_channel(
    log: Path, settings: Mapping[str, Any], units: Collection[str]
) -> tuple[Recording, FloatArray | None]:
    """Return the channel of a log in SI units, which must be among some, and forces that the log holds beside it."""
    from opid.signals.conversion import recording_of
    from opid.signals.log import ChannelSettings, LogSettings
    from opid.signals.logs import open_log

    channel, unit = settings["channel"], settings["unit"]
    how = LogSettings(time_unit=settings["time_unit"])
    opened = open_log(log, how)
    track, column = opened.find(channel)
    if unit is None and track.channels[column].unit is None:
        raise FileError(f"channel {channel!r} of {log} states no unit: give it, like --unit g, --unit mm/s")
    wanted = {channel: ChannelSettings(channel, unit=unit)}
    record = recording_of(opened, how, channels=wanted)
    if record.channels[0].unit not in units:
        raise FileError(
            f"channel {channel!r} of {log} is in {record.channels[0].unit}: a free decay is followed in an "
            "acceleration, a velocity, a displacement, an angle or a strain; choose such a channel, or give the unit "
            "of its numbers, like --unit g"
        )
    forces = [each.name for each in track.channels if each.name != channel and each.is_in("N")]
    if not forces:
        return record, None
    try:
        beside = recording_of(opened, how, channels=wanted | {name: ChannelSettings(name) for name in forces})
    except InputError:
        return record, None  # A force with gaps tells nothing; the motion is complete.
    return record, beside.samples[:, 1:] if len(beside.samples) == len(record.samples) else None
