"""A body on several suspensions as JSON and as a page with its figures."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from opid.estimate import Estimate
from opid.report.as_json import json_text, plain
from opid.report.as_text import columns
from opid.report.body_pictures import body_pictures
from opid.report.body_text import (
    Truth,
    body_limits,
    body_rows,
    candidate_table,
    kind_in_words,
    reason,
    recommendation,
    recommended,
    suspension_rows,
    units_of,
)
from opid.report.directory import write_together
from opid.report.page import drawn, rendered
from opid.suspensions.one_gear.result import PARAMETERS, RATIOS, SCHEMA
from opid.suspensions.result import BODY_PARAMETERS, BODY_RATIOS, BodyIdentification, InterfaceEstimate


def body_json(result: BodyIdentification) -> dict[str, Any]:
    """Return the identification of a body as the content of result.json.

    The schema is that of one suspension: its names stand there too, null where they belong to an interface.

    Args:
        result: from `identify_body`.

    Returns:
        `schema`, `method`, `title`, `date`, `parameters` and `ratios` {name: {value, std, interval95}}, `law`,
        `restoring_force` (empty: see `interfaces`), `structure` {kind, recommended, why, residual_over_noise,
        noise_m_per_s2, places {interface: {x_m, y_m, sensor_x_m, sensor_y_m}}, place_corrections}, `interfaces` [{name,
        shared_with, x_m, y_m, stiffness and damping {value, std, interval95, unit}, law {kind: {parameter: {value, std,
        interval95}}}, law_name, latex, per_mass, residual_over_noise}], `candidates` [the fields of `Candidate`],
        `runs` [{name, mass_change_kg, loading}], `diagnostics`, `warnings`, `not_determined`.
    """
    none = Estimate()
    names = tuple(dict.fromkeys((*BODY_PARAMETERS, *PARAMETERS)))
    ratios = tuple(dict.fromkeys((*BODY_RATIOS, *RATIOS)))
    return plain(
        {
            "schema": SCHEMA,
            "method": "model",
            "title": result.title,
            "date": None if result.date is None else result.date.isoformat(),
            "parameters": {name: asdict(result.parameters.get(name, none)) for name in names},
            "ratios": {name: asdict(result.ratios.get(name, none)) for name in ratios},
            "law": _law_of_all(result),
            "restoring_force": _no_force(result),
            "structure": _structure(result),
            "interfaces": [_interface(result, interface) for interface in result.interfaces],
            "candidates": [asdict(candidate) for candidate in result.candidates],
            "runs": [
                {"name": run.name, "mass_change_kg": run.mass_change_kg, "loading": run.loading} for run in result.runs
            ],
            "diagnostics": result.diagnostics,
            "warnings": result.warnings,
            "not_determined": result.not_determined,
        }
    )


def write_body_report(
    result: BodyIdentification,
    directory: str | os.PathLike[str],
    truth: Truth | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Args:
        result: from `identify_body`.
        directory: made if it is not there; all files appear together, any other file in it stays.
        truth: of a simulated aircraft, as in truth.json: shown beside the estimates.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    pictures = body_pictures(result)
    images = drawn(pictures, result, truth, progress=progress)
    page = rendered(
        "body.html.jinja",
        images,
        title=result.title or "Identification",
        result=result,
        truth=truth,
        kind=kind_in_words(result.structure),
        columns=columns(truth),
        body_rows=body_rows(result, truth),
        suspension_rows=suspension_rows(result, truth),
        candidates=candidate_table(result),
        recommendation=recommendation(result) if result.candidates else "",
        limits=body_limits(result),
        pictures=pictures,
        command=_command(result),
        python=_python(result),
    )
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = page.encode()
    # last, so that a result.json is never there without its report
    contents["result.json"] = json_text(body_json(result)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


def _law_of_all(result: BodyIdentification) -> dict[str, Any]:
    """The law where all suspensions have the same terms; their values stand with them."""
    laws = {interface.law.name: interface.law.latex for interface in result.interfaces}
    name, latex = next(iter(laws.items())) if len(laws) == 1 else (None, None)
    return {"name": name, "latex": latex, "per_mass": result.per_mass, "parameters": {}}


def _no_force(result: BodyIdentification) -> dict[str, Any]:
    """No force belongs to all suspensions; the keys stay, so that who reads them finds nothing and not a fault."""
    unit = "m/s^2" if result.per_mass else "N"
    units = {"travel": "m", "velocity": "m/s", "force": unit, "nonlinear_force": unit}
    return {**{name: [] for name in units}, "per_mass": result.per_mass, "units": units}


def _structure(result: BodyIdentification) -> dict[str, Any]:
    best = recommended(result)
    return {
        "kind": result.structure,
        "recommended": None if best is None else best.kind,
        "why": reason(result) or None,
        "residual_over_noise": result.residual_over_noise,
        "noise_m_per_s2": result.noise_m_per_s2,
        "places": {
            name: dict(zip(("x_m", "y_m", "sensor_x_m", "sensor_y_m"), place, strict=True))
            for name, place in result.places.items()
        },
        "place_corrections": _estimates(result.place_corrections),
    }


def _interface(result: BodyIdentification, interface: InterfaceEstimate) -> dict[str, Any]:
    stiffness, damping = units_of(result)
    x_m, y_m = result.places.get(interface.name, (None, None))[:2]
    return {
        "name": interface.name,
        "shared_with": interface.shared_with,
        "x_m": x_m,
        "y_m": y_m,
        "stiffness": asdict(interface.stiffness) | {"unit": stiffness},
        "damping": asdict(interface.damping) | {"unit": damping},
        "law": {kind: _estimates(values) for kind, values in interface.law_estimates.items()},
        "law_name": interface.law.name,
        "latex": interface.law.latex,
        "per_mass": result.per_mass,
        "residual_over_noise": interface.residual_over_noise,
    }


def _estimates(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: asdict(estimate) for name, estimate in estimates.items()}


def _command(result: BodyIdentification) -> str:
    """The command that gives this result."""
    known = result.diagnostics
    law = "" if known.get("law") in (None, "searched") else f" --law {known['law']}"
    band = " --band {:g} {:g}".format(*known["band_hz"]) if "band_hz" in known else ""
    return f"opid identify {shlex.quote(known.get('study') or 'study.toml')}{band}{law}"


def _python(result: BodyIdentification) -> str:
    """The lines of Python that give this result from its study."""
    known = result.diagnostics
    given = "" if known.get("law") in (None, "searched") else f', law="{known["law"]}"'
    given += f", band_hz={tuple(known['band_hz'])}" if "band_hz" in known else ""
    study = known.get("study") or "study.toml"
    return f'import opid\n\nresult = opid.identify_body(opid.read_body_study("{study}"){given})'
