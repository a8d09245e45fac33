"""An identification as text and as a page with its figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeGuard

from opid.report.again import command_of, python_of
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
from opid.report.page import Page, Truth
from opid.suspensions.answer.as_json import chain_of
from opid.suspensions.paper.result import AnyIdentification
from opid.suspensions.result import Identification


def text_of(result: AnyIdentification, truth: Truth | None = None) -> str:
    """Return an identification as text: the numbers, what limits them, and what to doubt.

    Args:
        result: of one gear, by any method, or of a body on several suspensions.
        truth: of a simulation, as in truth.json: shown beside each estimate.
    """
    return body_text(result, truth) if _is_body(result) else gear_text(result, truth)


def page_of(result: AnyIdentification, truth: Truth | None = None) -> Page:
    """Return what the page of an identification shows.

    Args:
        result: of one gear, by any method, or of a body on several suspensions.
        truth: of a simulation, as in truth.json: shown beside the estimates.
    """
    if _is_body(result):
        template, pictures, content = "body.html.jinja", body_pictures(result), _body_content(result, truth)
    else:
        template, pictures, content = "gear.html.jinja", gear_pictures(result), _gear_content(result, truth)
    return Page(
        template,
        result.title or "Identification",
        pictures,
        {"columns": columns(truth), **content},
        result.warnings,
        result.not_determined,
        command_of(result),
        python_of(result),
    )


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


def _gear_content(result: AnyIdentification, truth: Truth | None) -> dict[str, Any]:
    return {"rows": gear_rows(result, truth), "limits": gear_limits(result), "runs": _run_rows(result)}


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


def _body_content(result: Identification, truth: Truth | None) -> dict[str, Any]:
    return {
        "kind": kind_in_words(result.structure),
        "body_rows": body_rows(result, truth),
        "suspension_rows": suspension_rows(result, truth),
        "candidates": candidate_table(result),
        "recommendation": recommendation(result) if result.candidates else "",
        "limits": body_limits(result),
        "notes": [*sensor_sentences(result), *law_sentences(result)],
    }
