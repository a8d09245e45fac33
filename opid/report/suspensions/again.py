"""How to come to an identification again: the command, and the lines of Python."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace

from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.result import Identification
from opid.suspensions.settings import Settings
from opid.suspensions.study import Study


@dataclass(frozen=True)
class _Asked:
    """What an identification was asked for that differs from the default, as options and as arguments."""

    options: tuple[str, ...]
    arguments: tuple[str, ...]
    imports: tuple[str, ...] = ()
    has_command: bool = True


def command_of(result: AnyIdentification) -> list[str] | None:
    """Return the words of the command that gives a result; None for a study or settings that were made in Python."""
    asked, study = _collect_arguments(result), result.study
    if not asked.has_command:
        return None
    if study.source is not None:
        return ["opid", "identify", str(study.source), *asked.options]
    logs = _find_logs(study)
    if not logs:
        return None
    changes = [word for change in _list_mass_changes(study) for word in ("--mass-change", _number(change))]
    channels = ["--sprung", study.sprung, "--unsprung", study.unsprung]
    more = [
        word
        for option, _, value in _said_of_logs(study)
        for word in (option, value if isinstance(value, str) else _number(value))
    ]
    return ["opid", "identify", *logs, *channels, *changes, *more, *asked.options]


def python_of(result: AnyIdentification) -> str:
    """Return the lines of Python that give a result; the study is called so where it was made in Python."""
    asked, study = _collect_arguments(result), result.study
    if study.source is not None:
        made = f"opid.read_study({_quote(str(study.source))})"
    elif logs := _find_logs(study):
        arguments = [
            f"[{', '.join(map(_quote, logs))}]",
            f"sprung={_quote(study.sprung)}",
            f"unsprung={_quote(study.unsprung)}",
            f"mass_changes_kg={_list_mass_changes(study)!r}",
            *(f"{name}={_quote(value)}" for _, name, value in _said_of_logs(study)),
        ]
        made = "\n".join(["opid.study_from_logs(", *(f"        {each}," for each in arguments), "    )"])
    else:
        made = "study"
    lines = ["import opid", *asked.imports, "", "result = opid.identify("]
    return "\n".join([*lines, *(f"    {each}," for each in (made, *asked.arguments)), ")"])


def _find_logs(study: Study) -> list[str]:
    """The logs that make the study by themselves; none where it was made otherwise."""
    logs = [str(run.log) for run in study.runs if run.log is not None]
    return logs if study.is_one_gear and len(logs) == len(study.runs) else []


def _list_mass_changes(study: Study) -> list[float]:
    first, *others = study.runs
    return [run.mass_change_kg - first.mass_change_kg for run in others]


def _said_of_logs(study: Study) -> list[tuple[str, str, str | float]]:
    """What is said of the gear beside its logs and differs from the default: as option, as argument, and the value."""
    gear = study.interfaces[0]
    said = (
        ("--axis", "axis", None if gear.axis == "up" else gear.axis),
        ("--piston-area", "piston_area_m2", gear.piston_area_m2),
        ("--repeatability", "repeatability", study.repeatability),
    )
    return [(option, name, value) for option, name, value in said if value is not None]


def _collect_arguments(result: AnyIdentification) -> _Asked:
    return _of_paper(result) if isinstance(result, PaperIdentification) else _of_model(result)


def _of_paper(result: PaperIdentification) -> _Asked:
    known = result.settings
    options = ["--method", result.method, *_band(known.band_hz), "--high-pass", _number(known.high_pass_hz)]
    arguments = [
        f"method={_quote(result.method)}",
        f"band_hz={known.band_hz!r}",
        f"high_pass_hz={known.high_pass_hz!r}",
    ]
    return _with_law(known.law, known.ground, options, arguments)


def _of_model(result: Identification) -> _Asked:
    asked, band_hz = result.options, result.settings.runs.band_hz
    options, arguments = _band(band_hz), [f"band_hz={band_hz!r}"]
    if asked.method_of_law != "pursuit":
        options += ["--method-of-law", asked.method_of_law]
        arguments.append(f"method_of_law={_quote(asked.method_of_law)}")
    if asked.seed:
        arguments.append(f"seed={asked.seed!r}")
    changed, names = _write_settings(result.settings)
    if changed:
        arguments.append(f"settings=Settings({changed})")
    found = _with_law(asked.law, asked.ground, options, arguments)
    imports = (f"from opid.suspensions import {', '.join(sorted(names))}",) if changed else ()
    return replace(found, imports=imports, has_command=not changed and not asked.seed)


def _with_law(law: str | None, ground: bool, options: list[str], arguments: list[str]) -> _Asked:
    if law is not None:
        options, arguments = [*options, "--law", law], [*arguments, f"law={_quote(law)}"]
    if not ground:
        options, arguments = [*options, "--no-ground"], [*arguments, "ground=False"]
    return _Asked(tuple(options), tuple(arguments))


def _band(band_hz: tuple[float, float]) -> list[str]:
    return ["--band", *map(_number, band_hz)]


def _quote(value: str | float) -> str:
    """A text or number as Python writes it, in the quotes of this house."""
    return json.dumps(value, ensure_ascii=False)


def _number(value: float) -> str:
    """The number in few digits that is read back as the same."""
    return f"{value:g}" if float(f"{value:g}") == value else repr(value)


def _write_settings(settings: Settings) -> tuple[str, set[str]]:
    """The settings other than the default as arguments, and the names that they need; the band stands by itself."""
    standard = Settings()
    settings = replace(settings, runs=replace(settings.runs, band_hz=standard.runs.band_hz))
    changed, names = [], {"Settings"}
    for part in fields(Settings):
        mine, usual = getattr(settings, part.name), getattr(standard, part.name)
        inside = [
            f"{each.name}={getattr(mine, each.name)!r}"
            for each in fields(mine)
            if getattr(mine, each.name) != getattr(usual, each.name)
        ]
        if inside:
            names.add(type(mine).__name__)
            changed.append(f"{part.name}={type(mine).__name__}({', '.join(inside)})")
    return ", ".join(changed), names
