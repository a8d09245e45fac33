"""An updating as text and as a page with its figures."""

from __future__ import annotations

from opid.report.as_text import aligned, columns, labelled, laid_out, refusal, table_lines, wrapped
from opid.report.page import Page
from opid.report.updating.pictures import updating_pictures
from opid.report.updating.reduction import reduction_sentences
from opid.report.updating.tables import (
    Truth,
    basis,
    best_sentence,
    class_table,
    coefficient_rows,
    linear_rows,
    mode_table,
    tables,
)
from opid.updating.result import Updating


def text_of(result: Updating, truth: Truth | None = None) -> str:
    """Return an updating as text: linear parameters, classes, coefficients, sampling, coverage, and what to doubt.

    Args:
        result: from `update_study`.
        truth: of a simulated test, as in truth.json: shown beside each estimate.
    """
    linear: list[list[str]] = []
    if result.linear is not None:
        linear = [["Linear structure"], table_lines(linear_rows(result, truth), columns(truth))]
        linear.append(aligned(mode_table(result)))
    classes: list[list[str]] = []
    if result.classes:
        classes = [["Model classes"], [*aligned(class_table(result), left=(0, 1)), *wrapped(best_sentence(result))]]
        classes.append(table_lines(coefficient_rows(result, truth), columns(truth)))
    return laid_out(
        [result.title or "Bayesian updating"],
        wrapped(basis(result)),
        refusal(result.not_determined),
        *linear,
        labelled("Reduction: ", (f"{sentence}." for sentence in reduction_sentences(result))),
        *classes,
        *([*aligned(table), *wrapped(note)] for table, note in tables(result)),
        labelled("Warning: ", result.all_warnings),
    )


def page_of(result: Updating, truth: Truth | None = None) -> Page:
    """Return what the page of an updating shows.

    Args:
        result: from `update_study`.
        truth: of a simulated test, as in truth.json: shown beside each estimate.
    """
    return Page(
        "updating.html.jinja",
        result.title or "Bayesian updating",
        updating_pictures(result),
        {
            "basis": basis(result),
            "columns": columns(truth),
            "linear_rows": linear_rows(result, truth),
            "mode_table": mode_table(result),
            "class_table": class_table(result),
            "best": best_sentence(result),
            "rows": coefficient_rows(result, truth),
            "tables": tables(result),
        },
        result.all_warnings,
        result.not_determined,
        _command(result),
    )


def _command(result: Updating) -> list[str]:
    """The command that gives this result."""
    settings = result.settings
    words = ["opid", "update", str(settings.get("study") or "STUDY.toml"), "--form", result.form]
    given = [name for name in ("sampler", "samples", "seed") if settings.get(name) is not None]
    return [*words, *(word for name in given for word in (f"--{name}", str(settings[name])))]
