"""An updating as text and as tables: linear parameters, the classes by their evidence, their coefficients, coverage."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from opid.mechanics.laws.law import LAWS
from opid.report.as_text import Row, estimate_row
from opid.report.estimates import formula
from opid.report.updating.coverage import coverage_note, coverage_table
from opid.updating.model_class import short_kind
from opid.updating.result import ClassPosterior, Diagnostics, Updating

Truth = Mapping[str, Any]
Table = list[tuple[str, ...]]

FORMS = {
    "paper": "mean of the squared errors of each curve, as the paper's numbers have it",
    "literal": "square of the mean error of each curve, as eq. (12) is printed: errors cancel",
    "recommended": "an offset for each curve beside the scatter of its points, noise levels inferred",
    "independent": "every point by itself: intervals far too narrow",
}
"""What the forms of the likelihood are."""


def basis(result: Updating) -> str:
    """Return the sentence that says what the answer rests on.

    Args:
        result: the updating.
    """
    counts = [
        f"{sum(curve.mode == mode for curve in result.measured)} of mode {mode}"
        for mode in sorted({curve.mode for curve in result.measured})
    ]
    points = sum(curve.frequency_hz.size for curve in result.measured)
    system = result.system
    form = FORMS.get(result.form)
    return (
        f"{counted(len(result.measured), 'backbone')} ({', '.join(counts)}), {counted(points, 'point')}, "
        f"{counted(len(system.sensors), 'sensor')}, {counted(len(system.joints), 'joint')}, "
        f"{counted(system.n_modes, 'mode')} kept; likelihood {result.form!r}"
        f"{f' ({form})' if form else ''}."
    )


def tables(result: Updating) -> list[tuple[Table, str]]:
    """Return the tables of evidences, prior sensitivity, sampling and coverage that have something in them.

    Args:
        result: the updating.

    Returns:
        Each table, the heads first, and a note below it.
    """
    noted = (
        (evidence_table(result), "Log evidence by every method that was run; classes are compared by the first."),
        (
            sensitivity_table(result),
            "What a prior twice as wide does to the log evidence: of a wide uniform prior -0.69, for log 2.",
        ),
        (sampling_table(result), ""),
        (coverage_table(result), coverage_note(result)),
    )
    return [(table, note) for table, note in noted if len(table) > 1]


def linear_rows(result: Updating, truth: Truth | None = None) -> list[Row]:
    """Return the table of the linear parameters, factors of the nominal values (Song Table 1).

    Args:
        result: the updating.
        truth: as in truth.json, or None.
    """
    if result.linear is None:
        return []
    true = truth["linear"] if truth else {}
    return [
        estimate_row(name, "of nominal", estimate, true.get(name), truth is not None)
        for name, estimate in result.linear.estimates.items()
    ]


def mode_table(result: Updating) -> Table:
    """Return frequency and MAC of each identified mode before and after linear updating (Song Table 2).

    Args:
        result: the updating.
    """
    table: Table = [("mode", "identified", "initial", "updated", "MAC, initial", "MAC, updated")]
    for mode in result.linear.modes if result.linear is not None else ():
        hz = [f"{value:.2f} Hz" for value in (mode.identified_hz, mode.initial_hz, mode.updated_hz)]
        table.append((str(mode.mode), *hz, f"{mode.initial_mac:.3f}", f"{mode.updated_mac:.3f}"))
    return table


def class_table(result: Updating) -> Table:
    """Return the classes with their log evidence and its difference to the best (Song Table 3).

    Args:
        result: the updating.
    """
    table: Table = [("class", "law", "log evidence", "±", "to the best", "log likelihood")]
    best = best_log_evidence(result)
    for each in result.classes:
        first = each.evidences[0]
        marked = "best" if each.model_class.name == result.best_class else f"{first.log_evidence - best:+.2f}"
        cells = (f"{first.log_evidence:.2f}", _spread(first.std) or "-", marked, f"{each.log_likelihood_at_best:.2f}")
        table.append((each.model_class.name, each.model_class.law_in_words, *cells))
    return table


def coefficient_rows(result: Updating, truth: Truth | None = None) -> list[Row]:
    """Return the parameters of every class, and the coefficients that they are in SI units (Song Table 4).

    Args:
        result: the updating.
        truth: as in truth.json, or None; shown for the classes that hold the true law.
    """
    return [row for each in result.classes for row in _rows_of(each, truth)]


def evidence_table(result: Updating) -> Table:
    """Return the log evidence of each class by every method; the heads alone where there is one method.

    Args:
        result: the updating.
    """
    methods = list(dict.fromkeys(one.method for each in result.classes for one in each.evidences))
    table: Table = [("log evidence", *methods)]
    for each in result.classes if len(methods) > 1 else ():
        by_method = {one.method: one for one in each.evidences}
        cells = []
        for method in methods:
            found = by_method.get(method)
            spread = _spread(found.std) if found is not None else ""
            cells.append("-" if found is None else f"{found.log_evidence:.2f}{spread and f' ± {spread}'}")
        table.append((each.model_class.name, *cells))
    return table


def sensitivity_table(result: Updating) -> Table:
    """Return what wider priors do to the log evidence of each class.

    Args:
        result: the updating.
    """
    names = list(dict.fromkeys(name for each in result.classes for name in each.prior_sensitivity))
    table: Table = [("prior twice as wide", *names)]
    for each in result.classes if names else ():
        changes = [each.prior_sensitivity.get(name, math.nan) for name in names]
        table.append((each.model_class.name, *(f"{c:+.2f}" if math.isfinite(c) else "-" for c in changes)))
    return table


def sampling_table(result: Updating) -> Table:
    """Return how well each posterior was sampled.

    Args:
        result: the updating.
    """
    table: Table = [("sampling", "by", "samples", "evaluations", "accepted", "effective", "R-hat")]
    linear = [] if result.linear is None else [("linear", result.linear.diagnostics)]
    for name, each in [*linear, *((each.model_class.name, each.diagnostics) for each in result.classes)]:
        table.append((name, *_sampling_cells(each)))
    return table


def counted(number: int, word: str) -> str:
    """Return a number with its word in the singular or the plural.

    Args:
        number: of things.
        word: for one of them.

    >>> counted(1, "joint"), counted(2, "joint")
    ('1 joint', '2 joints')
    """
    return f"{number} {word}{'s' * (number != 1)}"


def best_sentence(result: Updating) -> str:
    """Return the sentence that names the best class and how far ahead it is; "" if there is none.

    Args:
        result: the updating.
    """
    if not result.best_class:
        return ""
    others = [each for each in result.classes if each.model_class.name != result.best_class]
    if not others:
        return f"Best: {result.best_class}, the only class."
    second = max(others, key=lambda each: each.log_evidence)
    ahead = best_log_evidence(result) - second.log_evidence
    if not math.isfinite(ahead):
        return f"Best: {result.best_class}; no other class can explain the data."
    odds = f"{math.exp(ahead):.3g} to 1" if ahead < 14 else "more than a million to 1"
    return f"Best: {result.best_class}, ahead of {second.model_class.name} by {ahead:.2f} (odds {odds})."


def best_log_evidence(result: Updating) -> float:
    """Return the log evidence of the best class, or the largest there is; 0 without classes.

    Args:
        result: the updating.
    """
    named = [each.log_evidence for each in result.classes if each.model_class.name == result.best_class]
    return named[0] if named else max((each.log_evidence for each in result.classes), default=0.0)


def true_theta(posterior: ClassPosterior, truth: Truth | None) -> list[float | None]:
    """Return the true value of each parameter of a class; None for each where the class lacks a part of the true law.

    Args:
        posterior: of the class.
        truth: as in truth.json, or None.
    """
    own = posterior.model_class
    law = truth["law"] if truth else None
    if law is None or not set(law) <= set(own.kinds):
        return [None] * own.n_parameters
    return [law.get(kind, 0.0) / scale + 0.0 for kind, scale in zip(own.kinds, own.scales, strict=True)]


def _rows_of(posterior: ClassPosterior, truth: Truth | None) -> Iterator[Row]:
    own = posterior.model_class
    several = len(own.kinds) > 1
    names = [f"k{number}" if several else "k" for number in range(1, len(own.kinds) + 1)]
    terms = (formula(LAWS[kind].latex).replace("k", name, 1) for kind, name in zip(own.kinds, names, strict=True))
    scales = ", ".join(f"{name} = theta x {scale:.4g}" for name, scale in zip(names, own.scales, strict=True))
    yield Row(f"{own.name}: f(z) = {' + '.join(terms)}, {scales}")
    true = true_theta(posterior, truth)
    coefficients = posterior.coefficients
    for number, (name, estimate) in enumerate(posterior.estimates.items()):
        kind, value = own.kinds[number], true[number]
        yield estimate_row(name, "1", estimate, value, truth is not None)
        coefficient, unit = coefficients[kind]
        known = None if value is None else value * own.scales[number] + 0.0
        yield estimate_row(short_kind(kind), unit, coefficient, known, truth is not None)


def _spread(std: float) -> str:
    """The deviation of a log evidence, "" where it is too small to count."""
    return f"{std:.2f}" if std >= 0.005 else ""


def _sampling_cells(each: Diagnostics) -> tuple[str, ...]:
    return (
        each.sampler,
        str(each.n_samples),
        str(each.n_evaluations),
        f"{100 * each.acceptance:.0f} %" if math.isfinite(each.acceptance) else "-",
        f"{each.effective_samples:.0f}" if math.isfinite(each.effective_samples) else "-",
        f"{each.r_hat:.3f}" if math.isfinite(each.r_hat) else "-",
    )
