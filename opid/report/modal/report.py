"""A nonlinear modal model as text and as a page with its figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from opid.modal.result import ModalIdentification, TruthTest
from opid.modal.study import THRESHOLDS, ModalStudy
from opid.report.as_text import aligned, labelled, laid_out, refusal, table_lines, wrapped
from opid.report.modal.pictures import modal_pictures
from opid.report.modal.tables import (
    MOST_SENSORS,
    Truth,
    basis,
    coefficient_rows,
    tables,
    truth_table,
    truth_test_head,
    with_coefficients,
)
from opid.report.modal.units import coefficient_columns
from opid.report.page import Page


def text_of(result: ModalIdentification, truth: Truth | None = None) -> str:
    """Return a nonlinear modal model as text: the modes, their coefficients, the truth tests, and what to doubt.

    Args:
        result: from `identify_modes`.
        truth: of a simulated test, as in truth.json: shown beside each coefficient.
    """
    known = with_coefficients(truth)
    rows = coefficient_rows(result, known)
    return laid_out(
        [result.title or "Nonlinear modal model"],
        wrapped(basis(result)),
        refusal(result.not_determined),
        *([*aligned(table), *wrapped(note)] for table, note in tables(result)),
        table_lines(rows, coefficient_columns(known)) if rows else [],
        *(_truth_lines(test, first=result.drive_point) for test in result.truth_tests),
        labelled("Warning: ", result.all_warnings),
    )


def _truth_lines(test: TruthTest, *, first: str | None) -> list[str]:
    shown = truth_table(test, most=MOST_SENSORS, first=first)
    left = len(test.sensors) - MOST_SENSORS
    more = [f"and {left} sensor(s) that fare better"] if left > 0 else []
    return [*wrapped(truth_test_head(test)), *aligned(shown), *more]


def page_of(result: ModalIdentification, truth: Truth | None = None) -> Page:
    """Return what the page of a nonlinear modal model shows.

    Args:
        result: from `identify_modes`.
        truth: of a simulated test, as in truth.json: shown beside each coefficient.
    """
    known = with_coefficients(truth)
    return Page(
        "modal.html.jinja",
        result.title or "Nonlinear modal model",
        modal_pictures(result, truth),
        {
            "coefficients_known": known is not None,
            "basis": basis(result),
            "tables": tables(result),
            "columns": coefficient_columns(known),
            "rows": coefficient_rows(result, known),
            "truth_tests": [
                (truth_test_head(test), truth_table(test, first=result.drive_point)) for test in result.truth_tests
            ],
        },
        result.all_warnings,
        result.not_determined,
        command_of(result),
    )


def command_of(result: ModalIdentification, options: Mapping[str, Any] | None = None) -> list[str]:
    """Return the words of the command that gives this result.

    Args:
        result: the identification.
        options: settings that the command was given, by their names in `ModalStudy`; where None, the settings of the
            result that are not the defaults.
    """
    given = _beside_defaults(result) if options is None else options
    words = ["opid", "modal", str(result.settings.get("study") or "STUDY.toml")]
    for name, value in given.items():
        words += [] if name == "free_linear" else [f"--{name.replace('_', '-')}", f"{value:g}"]
    if given.get("free_linear") is not None:
        words.append("--free-linear" if given["free_linear"] else "--fixed-linear")
    return words


def _beside_defaults(result: ModalIdentification) -> dict[str, Any]:
    """The settings of a result that are not the defaults, whether its study file or the command has them."""
    names = ("stiffness_order", "damping_order", "free_linear", *THRESHOLDS)
    given = {name: result.settings[name] for name in names if result.settings.get(name) is not None}
    return {name: value for name, value in given.items() if value != getattr(ModalStudy, name)}
