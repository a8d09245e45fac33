"""How to repeat an identification: by a command, and by lines of Python."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import fields, replace

from opid.signals.log import AS_WRITTEN
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.settings import Settings
from opid.suspensions.study import Study

Choice = tuple[tuple[str, ...], str]
"""A choice of the user as words of the command, of which there are none if no option says it, and as an argument."""

OPTIONS_OF_LOGS = {"unit": "--unit", "time_unit": "--time-unit"}
"""Settings of logs that options say."""


def write_command(result: AnyIdentification) -> list[str] | None:
    """Return the words of the command that gives a result; None for a study or settings that were made in Python."""
    study, choices = result.study, [words for words, _ in _list_choices(result)]
    if not all(choices):
        return None
    options = [word for words in choices for word in words]
    if study.source is not None:
        return ["opid", "identify", str(study.source), *options]
    logs = _find_logs(study)
    if not logs:
        return None
    changes = [word for change in _list_mass_changes(study) for word in ("--mass-change", _format_number(change))]
    told = [words for words, _ in _list_log_choices(study)]
    if not all(told):
        return None
    about_logs = [word for words in told for word in words]
    channels = ["--sprung", study.sprung, "--unsprung", study.unsprung]
    return ["opid", "identify", *logs, *channels, *changes, *about_logs, *options]


def write_python(result: AnyIdentification) -> str:
    """Return the lines of Python that give a result; a study that was made in Python is called `study` in them."""
    study = result.study
    if study.source is not None:
        made = f"opid.read_study({_quote(str(study.source))})"
    elif logs := _find_logs(study):
        arguments = [
            f"[{', '.join(map(_quote, logs))}]",
            f"sprung={_quote(study.sprung)}",
            f"unsprung={_quote(study.unsprung)}",
            f"mass_changes_kg={_list_mass_changes(study)!r}",
            *(argument for _, argument in _list_log_choices(study)),
        ]
        made = "\n".join(["opid.study_from_logs(", *(f"        {each}," for each in arguments), "    )"])
    else:
        made = "study"
    names = set() if isinstance(result, PaperIdentification) else _write_changed_settings(result.settings)[1]
    imports = [f"from opid.suspensions import {', '.join(sorted(names))}"] if names else []
    arguments = [made, *(argument for _, argument in _list_choices(result))]
    lines = ["import opid", *imports, "", "result = opid.identify(", *(f"    {each}," for each in arguments), ")"]
    return "\n".join(lines)


def _list_choices(result: AnyIdentification) -> Iterator[Choice]:
    """The band, and every setting that differs from the default."""
    if isinstance(result, PaperIdentification):
        known, band_hz = result.settings, result.settings.band_hz
        yield ("--method", result.method), f"method={_quote(result.method)}"
        yield _format_band(band_hz)
        yield ("--high-pass", _format_number(known.high_pass_hz)), f"high_pass_hz={known.high_pass_hz!r}"
        yield from _list_law_choices(known.law, known.ground)
        return
    asked = result.options
    yield _format_band(result.settings.runs.band_hz)
    if asked.method_of_law != "pursuit":
        yield ("--method-of-law", asked.method_of_law.replace(" ", "-")), f"method_of_law={_quote(asked.method_of_law)}"
    if asked.seed:
        yield (), f"seed={asked.seed!r}"
    changed, _ = _write_changed_settings(result.settings)
    if changed:
        yield (), f"settings=Settings({changed})"
    yield from _list_law_choices(asked.law, asked.ground)


def _format_band(band_hz: tuple[float, float]) -> Choice:
    return ("--band", *map(_format_number, band_hz)), f"band_hz={band_hz!r}"


def _list_law_choices(law: str | None, has_ground: bool) -> Iterator[Choice]:
    if law is not None:
        yield ("--law", law), f"law={_quote(law)}"
    if not has_ground:
        yield ("--no-ground",), "ground=False"


def _list_log_choices(study: Study) -> Iterator[Choice]:
    """What the user stated about the gear of some logs, where it differs from the default."""
    gear = study.interfaces[0]
    if gear.axis != "up":
        yield ("--axis", gear.axis), f"axis={_quote(gear.axis)}"
    for option, name, value in (
        ("--piston-area", "piston_area_m2", gear.piston_area_m2),
        ("--repeatability", "repeatability", study.repeatability),
    ):
        if value is not None:
            yield (option, _format_number(value)), f"{name}={_quote(value)}"
    of_spectra = {name: value for name, value in vars(study.transmissibility).items() if value is not None}
    if of_spectra:
        spoken: list[str] = []
        for name, value in of_spectra.items():
            spoken += [f"--{name.removesuffix('_s')}", value if isinstance(value, str) else _format_number(value)]
        arguments = ", ".join(f"{name}={_quote(value)}" for name, value in of_spectra.items())
        yield tuple(spoken), f"transmissibility=opid.signals.TransmissibilitySettings({arguments})"
    how = study.runs[0].log_settings
    if how != AS_WRITTEN:
        known = [(each.name, getattr(how, each.name)) for each in fields(how)]
        stated = {name: value for name, value in known if value != getattr(AS_WRITTEN, name)}
        has_options = stated.keys() <= OPTIONS_OF_LOGS.keys()
        words = [word for name, value in stated.items() if has_options for word in (OPTIONS_OF_LOGS[name], value)]
        arguments = ", ".join(f"{name}={value!r}" for name, value in stated.items())
        yield tuple(words), f"settings=opid.signals.LogSettings({arguments})"


def _find_logs(study: Study) -> list[str]:
    """The logs if they alone make the study; none otherwise."""
    logs = [str(run.log) for run in study.runs if run.log is not None]
    return logs if study.is_one_gear and len(logs) == len(study.runs) else []


def _list_mass_changes(study: Study) -> list[float]:
    first, *others = study.runs
    return [run.mass_change_kg - first.mass_change_kg for run in others]


def _quote(value: str | float) -> str:
    """A text or a number as Python writes it, with double quotes."""
    return json.dumps(value, ensure_ascii=False)


def _format_number(value: float) -> str:
    """The shortest text of a number that is read back as the same number."""
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)


def _write_changed_settings(settings: Settings) -> tuple[str, set[str]]:
    """The settings that differ from the default, but for the band, as arguments; and the records that they need."""
    standard = Settings()
    settings = replace(settings, runs=replace(settings.runs, band_hz=standard.runs.band_hz))
    changed, names = [], set()
    for part in fields(Settings):
        mine, usual = getattr(settings, part.name), getattr(standard, part.name)
        inside = [
            f"{each.name}={getattr(mine, each.name)!r}"
            for each in fields(mine)
            if getattr(mine, each.name) != getattr(usual, each.name)
        ]
        if inside:
            names |= {"Settings", type(mine).__name__}
            changed.append(f"{part.name}={type(mine).__name__}({', '.join(inside)})")
    return ", ".join(changed), names
