"""The report of an identification: text, result.json, a page that opens offline, and its figures."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeGuard

from opid.json_values import json_text
from opid.report.again import command_of, python_of
from opid.report.as_json import chain_of, result_json
from opid.report.as_text import columns
from opid.report.body_pictures import body_pictures
from opid.report.body_text import (
    body_limits,
    body_rows,
    body_text,
    candidate_table,
    kind_in_words,
    law_sentences,
    recommendation,
    sensor_sentences,
    suspension_rows,
)
from opid.report.gear_pictures import gear_pictures
from opid.report.gear_text import gear_limits, gear_rows, gear_text
from opid.report.page import Truth, drawn, rendered
from opid.signals.directory import write_together
from opid.suspensions.paper.result import AnyIdentification
from opid.suspensions.result import Identification


def result_text(result: AnyIdentification, truth: Truth | None = None) -> str:
    """Return an identification as text: the numbers, what limits them, and what to doubt.

    Args:
        result: of one gear, by any method, or of a body on several suspensions.
        truth: of a simulation, as in truth.json: shown beside each estimate.
    """
    return body_text(result, truth) if _is_body(result) else gear_text(result, truth)


def write_report(
    result: AnyIdentification,
    directory: str | os.PathLike[str],
    truth: Truth | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Everything is made before the first file is written, and the files appear together. Files of an older report are
    replaced, any other file in the directory stays.

    Args:
        result: of one gear, by any method, or of a body on several suspensions.
        directory: made if it is not there.
        truth: of a simulation, as in truth.json: shown beside the estimates.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    pictures = body_pictures(result) if _is_body(result) else gear_pictures(result)
    images = drawn(pictures, result, truth, progress=progress)
    contents = {f"{name}.png": image for name, image in images.items()}
    page = _body_page(result, truth) if _is_body(result) else _gear_page(result, truth)
    contents["report.html"] = rendered(
        page.template,
        images,
        title=result.title or "Identification",
        result=result,
        truth=truth,
        columns=columns(truth),
        pictures=pictures,
        command=command_of(result),
        python=python_of(result),
        **page.content,
    ).encode()
    # last, so that a result.json is never there without its report
    contents["result.json"] = json_text(result_json(result)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


@dataclass(frozen=True)
class RunRow:
    """A run of one gear in the table of the page.

    Args:
        name: of the run.
        mass_change_kg: against the reference.
        duration_s: its length.
        fs: its sampling rate, Hz.
        travel_rms_m: None where the steps of the paper cannot be taken, as for what follows.
        velocity_rms_m_per_s: of the suspension.
        n_averages: behind the transmissibility.
    """

    name: str
    mass_change_kg: float
    duration_s: float
    fs: float
    travel_rms_m: float | None = None
    velocity_rms_m_per_s: float | None = None
    n_averages: float | None = None


def _is_body(result: AnyIdentification) -> TypeGuard[Identification]:
    return isinstance(result, Identification) and not result.study.is_one_gear


@dataclass(frozen=True)
class _Page:
    """A template, and what it names beside what all of them name."""

    template: str
    content: Mapping[str, Any]


def _gear_page(result: AnyIdentification, truth: Truth | None) -> _Page:
    content = {"rows": gear_rows(result, truth), "limits": gear_limits(result), "runs": _run_rows(result)}
    return _Page("page.html.jinja", content)


def _run_rows(result: AnyIdentification) -> list[RunRow]:
    chain = chain_of(result)
    rows = []
    for place, run in enumerate(result.study.runs):
        row = RunRow(run.name, run.mass_change_kg, run.recording.duration_s, run.recording.fs)
        if chain is not None:
            step = chain.runs[place]
            travel, velocity = (float(each.std()) for each in (step.surface.travel, step.surface.velocity))
            averages = step.T.spectra.n_averages
            row = RunRow(row.name, row.mass_change_kg, row.duration_s, row.fs, travel, velocity, averages)
        rows.append(row)
    return rows


def _body_page(result: Identification, truth: Truth | None) -> _Page:
    content = {
        "kind": kind_in_words(result.structure),
        "body_rows": body_rows(result, truth),
        "suspension_rows": suspension_rows(result, truth),
        "candidates": candidate_table(result),
        "recommendation": recommendation(result) if result.candidates else "",
        "limits": body_limits(result),
        "notes": [*sensor_sentences(result), *law_sentences(result)],
    }
    return _Page("body.html.jinja", content)
