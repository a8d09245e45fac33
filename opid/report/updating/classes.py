"""What a report says of an updating: classes by evidence, coefficients, the linear structure, sampling, coverage."""

from __future__ import annotations

import math
from collections.abc import Iterator

from opid.mechanics.laws.law import LAWS
from opid.mechanics.truth import UpdatingTruth
from opid.report.document import Document, Paragraph, Remarks, Table, columns, counted, warnings
from opid.report.estimates import estimate_columns, estimate_row, formula
from opid.report.updating.figures import figures_of, true_theta
from opid.report.updating.reduction import reduction_sentences
from opid.updating.model_class import short_kind
from opid.updating.result import ClassPosterior, Updating
from opid.updating.sampling.chains import Diagnostics

FORMS = {
    "paper": "mean of the squared errors of each curve, as the paper's numbers have it",
    "literal": "square of the mean error of each curve, as eq. (12) is printed: errors cancel",
    "recommended": "an offset for each curve beside the scatter of its points, noise levels inferred",
    "independent": "every point by itself: intervals far too narrow",
}
"""What the forms of the likelihood are."""

SONG = (
    "M. Song, L. Renson, B. Moaveni and G. Kerschen, Bayesian model updating and class selection of a wing-engine "
    "structure with nonlinear connections using nonlinear normal modes, Mechanical Systems and Signal Processing 165 "
    "(2022)."
)


_SIMULATED = (
    " The backbones were simulated: truth, error, and whether the interval held the truth, are known for the classes "
    "that hold the true law."
)


def document_of(result: Updating, truth: UpdatingTruth | None = None) -> Document:
    """Return what is said of an updating.

    Args:
        result: from `update_study`.
        truth: of a simulated test: shown beside each estimate.
    """
    tables = (
        _class_table(result),
        _coefficient_table(result, truth),
        _linear_table(result, truth),
        _mode_table(result),
        _evidence_table(result),
        _sensitivity_table(result),
        _sampling_table(result),
        _coverage_table(result),
    )
    return Document(
        result.title or "Bayesian updating",
        "Bayesian updating and class selection from backbones",
        _best(result),
        result.not_determined,
        (
            Paragraph(_basis(result)),
            *(table for table in tables if table.rows),
            Remarks("Reduction", reduction_sentences(result)),
            warnings(result.all_warnings),
        ),
        lambda: figures_of(result, truth),
        _command(result),
        source="study",
        reference=f"The method is that of {SONG}",
    )


def _command(result: Updating) -> list[str]:
    settings = result.settings
    words = ["opid", "update", str(settings.get("study") or "STUDY.toml"), "--form", result.form]
    given = [name for name in ("sampler", "samples", "seed") if settings.get(name) is not None]
    return [*words, *(word for name in given for word in (f"--{name}", str(settings[name])))]


def _basis(result: Updating) -> str:
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


def _best(result: Updating) -> str:
    """Which class is the best and how far it is ahead."""
    best = next((each for each in result.classes if each.model_class.name == result.best_class), None)
    if best is None:
        return "No class of laws is the best."
    named = f"Best: {result.best_class}, {best.model_class.law_in_words}"
    others = [each for each in result.classes if each is not best]
    if not others:
        return f"{named}, the only class."
    second = max(others, key=lambda each: each.log_evidence)
    ahead = best.log_evidence - second.log_evidence
    if not math.isfinite(ahead):
        return f"{named}; no other class can explain the data."
    odds = f"{math.exp(ahead):.3g} to 1" if ahead < 14 else "more than a million to 1"
    return f"{named}, ahead of {second.model_class.name} by {ahead:.2f} (odds {odds})."


def _class_table(result: Updating) -> Table:
    """The classes with their log evidence and its difference to the best (Song Table 3)."""
    named = [each.log_evidence for each in result.classes if each.model_class.name == result.best_class]
    best = named[0] if named else max((each.log_evidence for each in result.classes), default=0.0)
    rows = []
    for each in result.classes:
        first = each.evidences[0]
        marked = "best" if each.model_class.name == result.best_class else f"{first.log_evidence - best:+.2f}"
        cells = (f"{first.log_evidence:.2f}", _spread(first.std) or "-", marked, f"{each.log_likelihood_at_best:.2f}")
        rows.append((each.model_class.name, each.model_class.law_in_words, *cells))
    heads = columns("class", "law", "log evidence", "std. dev.", "to the best", "log likelihood", left=(0, 1))
    return Table(heads, tuple(rows), "Model classes")


def _coefficient_table(result: Updating, truth: UpdatingTruth | None) -> Table:
    """The parameters of every class, and the coefficients that they are in SI units (Song Table 4)."""
    return Table(
        estimate_columns(truth),
        tuple(row for each in result.classes for row in _rows_of(each, truth)),
        "Coefficients of the classes",
        legend="Each coefficient is its parameter θ times the scale of the class, in the unit of its row, for z in m "
        "and f in N; mean, standard deviation and the 95 % interval are those of the posterior samples."
        + (_SIMULATED if truth else ""),
    )


def _rows_of(posterior: ClassPosterior, truth: UpdatingTruth | None) -> Iterator[tuple[str, ...]]:
    own = posterior.model_class
    several = len(own.kinds) > 1
    names = [f"k{number}" if several else "k" for number in range(1, len(own.kinds) + 1)]
    terms = (formula(LAWS[kind].latex).replace("k", name, 1) for kind, name in zip(own.kinds, names, strict=True))
    scales = ", ".join(f"{name} = theta x {scale:.4g}" for name, scale in zip(names, own.scales, strict=True))
    yield (f"{own.name}: f(z) = {' + '.join(terms)}, {scales}",)
    true = true_theta(posterior, truth)
    coefficients = posterior.coefficients
    for number, (name, estimate) in enumerate(posterior.estimates.items()):
        kind, value = own.kinds[number], true[number]
        yield estimate_row(name, "1", estimate, value, truth is not None)
        coefficient, unit = coefficients[kind]
        known = None if value is None else value * own.scales[number] + 0.0
        yield estimate_row(short_kind(kind), unit, coefficient, known, truth is not None)


def _linear_table(result: Updating, truth: UpdatingTruth | None) -> Table:
    """The linear parameters, factors of the nominal values (Song Table 1)."""
    true = truth.linear if truth else {}
    rows = (
        estimate_row(name, "of nominal", estimate, true.get(name), truth is not None)
        for name, estimate in (result.linear.estimates.items() if result.linear is not None else ())
    )
    return Table(estimate_columns(truth), tuple(rows), "Linear structure")


def _mode_table(result: Updating) -> Table:
    """Frequency and MAC of each identified mode before and after linear updating (Song Table 2)."""
    rows = []
    for mode in result.linear.modes if result.linear is not None else ():
        hz = [f"{value:.2f} Hz" for value in (mode.identified_hz, mode.initial_hz, mode.updated_hz)]
        rows.append((str(mode.mode), *hz, f"{mode.initial_mac:.3f}", f"{mode.updated_mac:.3f}"))
    return Table(columns("mode", "identified", "initial", "updated", "MAC, initial", "MAC, updated"), tuple(rows))


def _evidence_table(result: Updating) -> Table:
    """The log evidence of each class by every method; empty where there is one method."""
    methods = list(dict.fromkeys(one.method for each in result.classes for one in each.evidences))
    rows = []
    for each in result.classes if len(methods) > 1 else ():
        by_method = {one.method: one for one in each.evidences}
        cells = []
        for method in methods:
            found = by_method.get(method)
            spread = _spread(found.std) if found is not None else ""
            cells.append("-" if found is None else f"{found.log_evidence:.2f}{spread and f' ± {spread}'}")
        rows.append((each.model_class.name, *cells))
    return Table(
        columns("log evidence (± std. dev.)", *methods),
        tuple(rows),
        note="Log evidence by every method that was run; classes are compared by the first.",
    )


def _sensitivity_table(result: Updating) -> Table:
    """What wider priors do to the log evidence of each class."""
    names = list(dict.fromkeys(name for each in result.classes for name in each.prior_sensitivity))
    rows = []
    for each in result.classes if names else ():
        changes = [each.prior_sensitivity.get(name, math.nan) for name in names]
        rows.append((each.model_class.name, *(f"{c:+.2f}" if math.isfinite(c) else "-" for c in changes)))
    return Table(
        columns("prior twice as wide", *names),
        tuple(rows),
        note="What a prior twice as wide does to the log evidence: of a wide uniform prior -0.69, for log 2.",
    )


def _sampling_table(result: Updating) -> Table:
    """How well each posterior was sampled."""
    linear = [] if result.linear is None else [("linear", result.linear.diagnostics)]
    each = [*linear, *((each.model_class.name, each.diagnostics) for each in result.classes)]
    heads = columns("sampling", "by", "samples", "evaluations", "accepted", "effective", "R-hat")
    return Table(heads, tuple((name, *_sampling_cells(known)) for name, known in each))


def _coverage_table(result: Updating) -> Table:
    """The fraction of measured points within the predicted band, one row a sensor and one column a mode."""
    modes = sorted({band.mode for band in result.prediction})
    rows = []
    for sensor in dict.fromkeys(band.sensor for band in result.prediction):
        own = [band for band in result.prediction if band.sensor == sensor]
        # of several bands of one mode and sensor all stand in one cell
        cells = [", ".join(_percent(band.coverage) for band in own if band.mode == mode) or "-" for mode in modes]
        rows.append((f"sensor {sensor}", *cells))
    gaps = "".join(
        f" The band of mode {band.mode} has no frequency at {band.n_missing} of its {band.amplitude.size} "
        "amplitudes, where most draws of the parameters have no backbone; its figure has a gap there."
        for band in result.prediction
        if band.n_missing
    )
    return Table(
        columns("within the band", *(f"mode {mode}" for mode in modes)),
        tuple(rows),
        note="Fraction of the measured points within the 95 % band of the best class. The class was fitted to these "
        f"points: it tells whether the errors are as large as assumed, and is no test on new data.{gaps}",
    )


def _spread(std: float) -> str:
    """The standard deviation of a log evidence, "" where it is too small to count."""
    return f"{std:.2f}" if std >= 0.005 else ""


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %" if math.isfinite(value) else "-"


def _sampling_cells(each: Diagnostics) -> tuple[str, ...]:
    return (
        each.sampler,
        str(each.n_samples),
        str(each.n_evaluations),
        _percent(each.acceptance),
        f"{each.effective_samples:.0f}" if math.isfinite(each.effective_samples) else "-",
        f"{each.r_hat:.3f}" if math.isfinite(each.r_hat) else "-",
    )
