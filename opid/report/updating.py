"""What a report says of an updating: classes by evidence, coefficients, the linear structure, sampling, coverage."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from opid import plots
from opid.estimate import format_number, format_percent, with_std
from opid.mechanics.laws.law import LAWS, FloatArray
from opid.mechanics.memory import force_at_turns
from opid.mechanics.truth import UpdatingTruth
from opid.report.document import (
    Document,
    Figure,
    Paragraph,
    Remarks,
    Row,
    Table,
    build_columns,
    build_warnings,
    format_count,
    write_options,
    write_sentence,
)
from opid.report.estimates import build_estimate_row, tabulate_estimates
from opid.report.formulas import embed_formula
from opid.report.sketch import sketch_joints
from opid.report.updating_bands import (
    format_fraction,
    list_harmonic_figures,
    list_predicted_figures,
    tabulate_coverage,
    tabulate_harmonics,
    tabulate_motions,
    tabulate_responses,
    tabulate_unmeasured,
)
from opid.updating.model_class import ClassParameter, StiffnessFactor, UncertainTerm, group_joints
from opid.updating.result import ClassPosterior, LinearPosterior, ModeShape, Updating
from opid.updating.sampling.chains import Diagnostics
from opid.updating.sampling.evidence import Evidence
from opid.updating.structure.reduction import ReductionErrors

FORMS = {
    "paper": "mean of the squared errors of each curve, as the paper's numbers have it",
    "literal": "square of the mean error of each curve, as eq. (12) is printed: errors cancel",
    "recommended": "an offset for each curve beside the scatter of its points, noise levels inferred",
    "independent": "every point by itself: intervals far too narrow",
}
"""The forms of the likelihood in words."""

SONG = (
    "M. Song, L. Renson, B. Moaveni and G. Kerschen, Bayesian model updating and class selection of a wing-engine "
    "structure with nonlinear connections using nonlinear normal modes, Mechanical Systems and Signal Processing 165 "
    "(2022)."
)

N_SENSORS_SHOWN = 6  # a figure of backbones has at most this many sensors, two rows of three panels
N_DRAWS = 200  # the band of a force is made of about this many samples: its ends need no more
N_EXTENSIONS = 200  # a force is computed at this many extensions, so that its curve looks smooth
KEPT = 0.01  # a mode counts as kept if the relative error of its frequency is smaller
MOST_NAMED = 4  # this many modes at most are named one by one

# titles of the parts of the page that a reader opens: they are long, and few readers need them
_NUMBERS = "Evidence and sampling in numbers"
_MEASURED = "What was measured of the other modes"
_SHAPES = "Shapes of the other modes"
_LINEAR = "More about the linear structure"
_OTHERS = "Parameters of the other classes"
_RUNNING = "Have the chains converged? Lines that still drift at the end ask for more samples."

_BASES = {"fixed": "modes with sensors and joints held", "free": "free modes (the paper's words)"}

_SIMULATED = (
    " The backbones were simulated: truth, error, and whether the interval held the truth, are known for the classes "
    "that hold the true law."
)


def build_document(result: Updating, truth: UpdatingTruth | None = None) -> Document:
    """Return the report of an updating."""
    tables = (
        _tabulate_classes(result),
        _tabulate_confusion(result),
        _tabulate_coefficients(result, truth),
        _tabulate_linear_classes(result),
        _tabulate_linear(result, truth),
        _tabulate_modes(result),
        _tabulate_evidences(result),
        _tabulate_sensitivities(result),
        _tabulate_sampling(result),
        tabulate_coverage(result),
        tabulate_unmeasured(result),
        tabulate_responses(result),
        tabulate_motions(result),
        tabulate_harmonics(result),
    )
    return Document(
        result.title or "Bayesian updating",
        "Bayesian updating and class selection from backbones",
        _say_best(result),
        result.not_determined,
        (
            Paragraph(_say_basis(result)),
            *(table for table in tables if table.rows),
            Remarks("Reduction", say_reductions(result)),
            build_warnings(text for text in result.all_warnings if text not in result.warnings_of_rejected),
            Remarks("Rejected", tuple(result.warnings_of_rejected)),
        ),
        lambda: list_figures(result, truth),
        _write_command(result),
        source="study",
        reference=f"The method is that of {SONG}",
        sketch=sketch_joints(result),
    )


def _write_command(result: Updating) -> list[str]:
    settings = result.settings
    words = ["opid", "update", str(settings.get("study") or "STUDY.toml"), "--form", result.form]
    given = {name: settings[name] for name in ("sampler", "samples", "seed") if settings.get(name) is not None}
    return [*words, *write_options(given), *(["--joint"] if settings.get("joint") else [])]


def _say_basis(result: Updating) -> str:
    counts = [
        f"{sum(curve.mode == mode for curve in result.measured)} of mode {mode}"
        for mode in sorted({curve.mode for curve in result.measured})
    ]
    points = sum(curve.frequency_hz.size for curve in result.measured)
    system = result.system
    form = FORMS.get(result.form)
    return (
        f"{format_count(len(result.measured), 'backbone')} ({', '.join(counts)}), {format_count(points, 'point')}, "
        f"{format_count(len(system.sensors), 'sensor')}, {format_count(len(system.joints), 'joint')}, "
        f"{format_count(system.n_modes, 'mode')} kept; likelihood {result.form!r}"
        f"{f' ({form})' if form else ''}."
    )


def _say_best(result: Updating) -> str:
    best = result.best
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
    # exp(14) is more than a million
    odds = f"{format_number(math.exp(ahead), 3)} to 1" if ahead < 14 else "more than a million to 1"
    return f"{named}, ahead of {second.model_class.name} by {ahead:.2f} (odds {odds})."


def _tabulate_classes(result: Updating) -> Table:
    """The log evidence of each class, and its difference to the best (Song Table 3)."""
    best = result.best.log_evidence if result.best else max((each.log_evidence for each in result.classes), default=0.0)
    rows = []
    for each in result.classes:
        first = each.evidences[0]
        marked = "best" if each.model_class.name == result.best_class else f"{first.log_evidence - best:+.2f}"
        cells = (
            f"{first.log_evidence:.2f}",
            _format_spread(first.std) or "-",
            marked,
            f"{each.log_likelihood_at_best:.2f}",
        )
        rows.append((each.model_class.name, each.model_class.law_in_words, *cells))
    heads = build_columns("class", "law", "log evidence", "std. dev.", "to the best", "log likelihood", left=(0, 1))
    return Table(heads, tuple(rows), "Model classes")


def _tabulate_confusion(result: Updating) -> Table:
    """How often each class would be chosen if another one were true."""
    found = result.confusion
    names, rows = ((), ()) if found is None else (found.classes, found.chosen)
    n_sets = 0 if found is None else found.n_sets
    return Table(
        build_columns("true class", *names),
        tuple((name, *map(format_fraction, row)) for name, row in zip(names, rows, strict=True)),
        "Which class would be chosen",
        note="In each row one class is the truth: the fraction of sets of curves, drawn with its laws and with errors "
        f"like the measured ones ({n_sets} a row), in which each class has the largest evidence. A class that is often "
        "chosen in the row of another one is no proof against that one.",
    )


def _tabulate_coefficients(result: Updating, truth: UpdatingTruth | None) -> Table:
    """The parameters of each class, and its coefficients in SI units (Song Table 4)."""
    return tabulate_estimates(
        (row for each in result.classes for row in _list_class_rows(each, truth)),
        truth,
        "Coefficients of the classes",
        legend="Each coefficient is its parameter θ times the scale of the class, in the unit of its row, for z in m "
        "and f in N; mean, standard deviation and the 95 % interval are those of the posterior samples."
        + _describe_calibration(result.best)
        + (_SIMULATED if truth else ""),
    )


def _describe_calibration(best: ClassPosterior | None) -> str:
    """What the calibration of the amplitudes does to the best class; "" where they are exact or it does nothing."""
    pairs = zip(best.estimates, best.calibration_std, strict=True) if best else ()
    parts = [f"{format_number(std, 2)} of {name}" for name, std in pairs if std > 0.0 and math.isfinite(std)]
    if best is None or not parts:
        return ""
    made = parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
    return (
        f" They hold the calibration error of the amplitudes (motion_error of [noise]), which alone makes a standard "
        f"deviation of {made} of {best.model_class.name}."
    )


def _list_class_rows(posterior: ClassPosterior, truth: UpdatingTruth | None) -> Iterator[Row]:
    own = posterior.model_class
    several = len(own.terms) > 1
    formulas: dict[tuple[str, ...], list[str]] = {}
    for number, term in enumerate(own.terms, start=1):
        formula = r"c\, \dot z" if term.is_linear_damper else LAWS[term.kind].latex
        # the amplitude is the first letter of a formula
        latex = re.sub(r"^(-?[ck])(?![a-z])", rf"\g<1>{number}", formula) if several else formula
        if several and term.gap_m is not None:
            latex = re.sub(r"\bs\b", f"s{number}", latex)
        formulas.setdefault(term.joints, []).append(latex)
    laws = (
        embed_formula(f"f = {' + '.join(each)}") + (f" at {', '.join(joints)}" if joints else "")
        for joints, each in formulas.items()
    )
    scales = (
        f"{name} x {format_number(each.scale, 4)} {each.unit}"
        for name, each in zip(posterior.estimates, own.law_parameters, strict=False)
    )
    yield (f"{own.name}: {'; '.join(laws)}; {', '.join(scales)}",)
    true = find_true_theta(posterior, truth)
    of_theta = zip(posterior.estimates.items(), posterior.coefficients.items(), true, strict=True)
    for (name, estimate), (parameter, coefficient), value in of_theta:
        if not isinstance(parameter, ClassParameter):
            unit = "of nominal" if isinstance(parameter, StiffnessFactor) else parameter.unit
            yield build_estimate_row(parameter.words, unit, estimate, value)
            continue
        yield build_estimate_row(name, "1", estimate, value)
        known = None if value is None else value * parameter.scale + 0.0
        yield build_estimate_row(parameter.words, parameter.unit, coefficient, known)


def _tabulate_linear_classes(result: Updating) -> Table:
    """The log evidence of each class of linear parameters, and its difference to the best."""
    best = max((each.log_evidence for each in result.linear_classes), default=0.0)
    rows = [
        (
            each.name,
            ", ".join(each.names),
            f"{each.log_evidence:.2f}",
            "best" if each is result.linear else f"{each.log_evidence - best:+.2f}",
        )
        for each in result.linear_classes
    ]
    heads = build_columns("linear class", "parameters", "log evidence", "to the best", left=(0, 1))
    return Table(heads, tuple(rows), "Classes of the linear structure")


def _tabulate_linear(result: Updating, truth: UpdatingTruth | None) -> Table:
    """The linear parameters as factors of their nominal values (Song Table 1)."""
    true = truth.linear if truth else {}
    rows = (
        build_estimate_row(name, "of nominal", estimate, true.get(name))
        for name, estimate in (result.linear.estimates.items() if result.linear is not None else ())
    )
    return tabulate_estimates(rows, truth, "Linear structure")


def _tabulate_modes(result: Updating) -> Table:
    """Frequency and MAC of each identified mode before and after linear updating (Song Table 2)."""
    rows = []
    for mode in result.linear.modes if result.linear is not None else ():
        hz = [f"{value:.2f} Hz" for value in (mode.identified_hz, mode.initial_hz, mode.updated_hz)]
        rows.append((str(mode.mode), *hz, f"{mode.initial_mac:.3f}", f"{mode.updated_mac:.3f}"))
    return Table(build_columns("mode", "identified", "initial", "updated", "MAC, initial", "MAC, updated"), tuple(rows))


def _tabulate_evidences(result: Updating) -> Table:
    """The log evidence of each class by each method, if there are several methods."""
    methods = list(dict.fromkeys(one.method for each in result.classes for one in each.evidences))
    rows = []
    for each in result.classes if len(methods) > 1 else ():
        by_method = {one.method: one for one in each.evidences}
        cells = []
        for method in methods:
            found = by_method.get(method)
            cells.append("-" if found is None else _format_evidence(found))
        rows.append((each.model_class.name, *cells))
    return Table(
        build_columns("log evidence ± std. dev.", *methods),
        tuple(rows),
        note="Log evidence by every method that was run; classes are compared by the first.",
        fold=_NUMBERS,
    )


def _tabulate_sensitivities(result: Updating) -> Table:
    names = list(dict.fromkeys(name for each in result.classes for name in each.prior_sensitivity))
    rows = []
    for each in result.classes if names else ():
        changes = [each.prior_sensitivity.get(name, math.nan) for name in names]
        rows.append((each.model_class.name, *(f"{c:+.2f}" if math.isfinite(c) else "-" for c in changes)))
    return Table(
        build_columns("prior twice as wide", *names),
        tuple(rows),
        note="What a prior twice as wide does to the log evidence: of a wide uniform prior -0.69, for log 2.",
        fold=_NUMBERS,
    )


def _tabulate_sampling(result: Updating) -> Table:
    linear = [] if result.linear is None else [("linear", result.linear.diagnostics)]
    each = [*linear, *((each.model_class.name, each.diagnostics) for each in result.classes)]
    heads = build_columns("sampling", "by", "samples", "evaluations", "accepted", "effective", "R-hat")
    return Table(heads, tuple((name, *_format_diagnostics(known)) for name, known in each), fold=_NUMBERS)


def _format_spread(std: float) -> str:
    """The standard deviation of a log evidence; "" if it is negligible."""
    return f"{std:.2f}" if std >= 0.005 else ""


def _format_evidence(found: Evidence) -> str:
    return with_std(found.log_evidence, found.std) if _format_spread(found.std) else f"{found.log_evidence:.2f}"


def _format_diagnostics(each: Diagnostics) -> tuple[str, ...]:
    return (
        each.sampler,
        str(each.n_samples),
        str(each.n_evaluations),
        format_fraction(each.acceptance),
        f"{each.effective_samples:.0f}" if math.isfinite(each.effective_samples) else "-",
        f"{each.r_hat:.3f}" if math.isfinite(each.r_hat) else "-",
    )


# ---- what the reduction leaves out ------------------------------------------------------------------


def say_reductions(result: Updating) -> tuple[str, ...]:
    """Return how well each reduced structure keeps the modes of the whole one (Song Fig. 7)."""
    tested = sorted({curve.mode for curve in result.measured} | {band.mode for band in result.prediction})
    return tuple(_say_kept(each, tested) for each in result.reductions)


def say_orders(reductions: Sequence[ReductionErrors]) -> tuple[str, ...]:
    """Return the reasons for small values of the modal assurance criterion (MAC) of these reductions."""
    return tuple(reason for each in reductions for reason in _say_reasons(each))


def _say_kept(errors: ReductionErrors, tested: Sequence[int]) -> str:
    n = errors.relative.size
    parts = []
    compared = [mode for mode in tested if mode <= n]
    if compared:
        worst = float(np.abs(errors.relative[np.array(compared) - 1]).max())
        parts.append(f"frequency of {_say_modes(compared)} off by at most {format_percent(worst, 1)}")
    beyond = np.flatnonzero(np.abs(errors.relative) >= KEPT)
    n_kept = int(beyond[0]) if beyond.size else n
    if n_kept:
        parts.append(f"{_say_modes(range(1, n_kept + 1))} by less than {format_percent(KEPT)}")
    cut = f" ({format_count(errors.n_cut, 'direction')} cut off)" if errors.n_cut else ""
    return f"{format_count(errors.n_dof, 'coordinate')}{cut}, {_BASES[errors.method]}: {', '.join(parts)}"


def _say_reasons(errors: ReductionErrors) -> Iterator[str]:
    number = np.arange(1, errors.nearest.size + 1)
    moved = np.flatnonzero((errors.nearest > 0) & (errors.nearest != number))
    lost = [int(mode) for mode in number[errors.nearest == 0]]
    of = "held" if errors.method == "fixed" else "free"
    if moved.size:
        pairs = [f"mode {number[k]} is the whole structure's mode {errors.nearest[k]}" for k in moved[:MOST_NAMED]]
        more = f" and {moved.size - MOST_NAMED} more" * (moved.size > MOST_NAMED)
        yield (
            f"with {of} modes the order changes: {', '.join(pairs)}{more} (crosses: MAC at least "
            f"{errors.nearest_mac[moved].min():.2f}), so that the MAC of equal numbers is small there"
        )
    if lost:
        yield f"with {of} modes the shape of {_say_modes(lost)} is like no single one of the {number.size} compared"


def _say_modes(numbers: Sequence[int]) -> str:
    """ "mode 3", "modes 1 to 9", "modes 7 and 8", "modes 2, 7 and 9"."""
    if len(numbers) == 1:
        return f"mode {numbers[0]}"
    if isinstance(numbers, range) or len(numbers) > MOST_NAMED:
        return f"modes {numbers[0]} to {numbers[-1]}"
    return f"modes {', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"


# ---- figures ----------------------------------------------------------------------------------------


def list_figures(result: Updating, truth: UpdatingTruth | None) -> Iterator[Figure]:
    """Yield the figures, in the order of the work, for which the result has data."""
    modes = sorted({curve.mode for curve in result.measured})
    for mode in modes:
        yield _build_measured_figure(result, mode, is_first=mode == modes[0])
    for number, shape in enumerate(result.mode_shapes):
        yield _build_shape_figure(result, shape, is_first=number == 0)
    if result.linear is not None:
        yield from _list_linear_figures(result.linear, truth)
    if result.reductions:
        yield _build_reduction_figure(result)
    rejected = {each.model_class.name for each in result.rejected}
    kept = [pair for pair in enumerate(result.classes, start=1) if pair[1].model_class.name not in rejected]
    if result.classes:
        yield from _list_all_class_figures(result, truth)
    for number, posterior in kept:
        if posterior.model_class.name == result.best_class:
            yield _build_samples_figure(number, posterior, truth)
    predicted = sorted({band.mode for band in result.prediction if band.is_measured})
    for mode in predicted:
        yield _build_predicted_figure(result, mode, is_first=mode == predicted[0])
    yield from list_predicted_figures(result)
    yield from list_harmonic_figures(result)
    if result.damping:
        yield _build_damping_figure(result)
    for number, posterior in kept:
        if posterior.model_class.name != result.best_class:
            yield _build_samples_figure(number, posterior, truth, fold=_OTHERS)
    if result.linear is not None:
        yield _build_running_figure("linear_running", "Linear parameters", result.linear.samples, result.linear.names)
    for number, each in kept:
        heading = f"{each.model_class.name}, {each.model_class.law_in_words}"
        yield _build_running_figure(f"class_{number}_running", heading, each.samples, each.labels)


def _build_measured_figure(result: Updating, mode: int, *, is_first: bool) -> Figure:
    return Figure(
        f"measured_mode_{mode}",
        f"Mode {mode}: what was measured",
        "Amplitude of the first harmonic over the frequency of phase resonance, one curve a test. They should lie on "
        "each other: how far they do not is what the likelihood takes for errors. A loop or a peak is a modal "
        "interaction, of which one harmonic knows nothing."
        if is_first
        else "",
        lambda: plots.measured_backbones(result.measured, mode, sensors=_choose_sensors(result, mode)),
        fold="" if is_first else _MEASURED,
    )


def _build_shape_figure(result: Updating, shape: ModeShape, *, is_first: bool) -> Figure:
    structure = "with its updated parameters, and as it was given" if shape.initial is not None else "as it was given"
    sketch = (
        " Each sensor is at its coordinates, and its motion is drawn in its direction; lines join neighbours."
        if result.places
        else ""
    )
    return Figure(
        f"shape_mode_{shape.mode}",
        f"Mode {shape.mode}: its shape",
        f"Motion of the sensors at the lowest points of the backbones, mean of the curves, and of the structure "
        f"{structure}. The scale and sign of a shape are free: those of the structure are brought nearest to the "
        f"measured ones.{sketch}"
        if is_first
        else "",
        lambda: plots.mode_shape(shape, result.places or None),
        fold="" if is_first else _SHAPES,
    )


def _list_linear_figures(linear: LinearPosterior, truth: UpdatingTruth | None) -> Iterator[Figure]:
    yield Figure(
        "linear_updating",
        "The linear structure, before and after",
        "Frequencies and shapes of the lowest points of the backbones against the structure as it was given and with "
        "its updated parameters.",
        lambda: plots.linear_updating(linear),
        fold=_LINEAR,
    )
    yield Figure(
        "linear_samples",
        "Linear parameters",
        "Samples of the posterior of the factors as densities, with the contours of 50, 90 and 99 % of a Gaussian of "
        "the same mean and covariance. Green, if any, is the truth of a simulation.",
        lambda: plots.parameter_samples(
            linear.samples,
            [f"{name} [of nominal]" for name in linear.names],
            truth=[truth.linear.get(name) for name in linear.names] if truth else None,
        ),
        fold=_LINEAR,
    )


def _build_reduction_figure(result: Updating) -> Figure:
    sentences = (*say_reductions(result), *say_orders(result.reductions))
    used, *others = result.reductions
    caption = " ".join(map(write_sentence, sentences))
    return Figure(
        "reduction",
        "What the reduction leaves out",
        "Frequencies and shapes of the reduced structure against those of the whole one, mode by mode. The modes that "
        f"are tested and those near their multiples should be exact; higher ones need not. {caption}",
        lambda: plots.reduction_figure(used, free=others[0] if others else None),
        fold=_LINEAR,
    )


def _list_all_class_figures(result: Updating, truth: UpdatingTruth | None) -> Iterator[Figure]:
    yield Figure(
        "log_evidences",
        "Which class",
        "By how much the log evidence of each class lies below that of the best one (in red), by every method that was "
        "run. Three is strong, five is decisive, and one is nothing; a class with a further term pays for the width of "
        "its prior.",
        lambda: plots.log_evidences(result),
    )
    groups = group_joints([each.model_class for each in result.classes], result.system.joints)
    turns = (
        " Of a joint that slips it is the force where a cycle turns, less that of its stiffness while nothing slides."
        if any(each.model_class.slips for each in result.classes)
        else ""
    )
    for number, group in enumerate(groups, start=1):
        yield Figure(
            "joint_forces" if len(groups) == 1 else f"joint_forces_{number}",
            f"What the classes make of the joints{'' if len(groups) == 1 else ' ' + ', '.join(group)}",
            "Nonlinear force of every class up to the extension that the tests reached; beyond, each law is an "
            "extrapolation. Classes whose curves lie on each other, drawn in turns, cannot be distinguished by these "
            f"data.{turns}"
            if number == 1
            else "",
            lambda joint=group[0]: _draw_forces(result, truth, joint),  # type: ignore[misc]
        )


def _build_samples_figure(
    number: int, posterior: ClassPosterior, truth: UpdatingTruth | None, *, fold: str = ""
) -> Figure:
    return Figure(
        f"class_{number}_samples",
        f"{posterior.model_class.name}, {posterior.model_class.law_in_words}: parameters",
        ""
        if fold
        else "Samples of the posterior as densities, and the Gaussian of the same mean and covariance. A narrow "
        "slanting cloud says that two terms stand in for each other; a cut edge, that the prior ends where the data do "
        "not. Classes that the data rule out are not drawn.",
        lambda: plots.parameter_samples(
            posterior.samples, posterior.labels, truth=find_true_theta(posterior, truth) if truth else None
        ),
        fold=fold,
    )


def _build_running_figure(name: str, of: str, samples: FloatArray, labels: Sequence[str]) -> Figure:
    return Figure(
        name, f"{of}: mean and deviation so far", "", lambda: plots.running_moments(samples, labels), fold=_RUNNING
    )


def _build_predicted_figure(result: Updating, mode: int, *, is_first: bool) -> Figure:
    n_missing = sum(band.n_missing for band in result.prediction if band.mode == mode)
    gap = " Where it breaks off, most draws of the parameters have no backbone." if n_missing else ""
    return Figure(
        f"predicted_mode_{mode}",
        f"Mode {mode}: what the best class predicts",
        (
            "Backbone of the best class with its 95 % band over the measured points. The class was fitted to these "
            "points: the fraction within the band is no test on new data. Points that leave the band on one side, and "
            f"more of them with the amplitude, ask for another law.{gap}"
            if is_first
            else gap.strip()
        ),
        lambda: plots.predicted_backbones(_choose_bands(result, mode), result.measured, mode),
    )


def _build_damping_figure(result: Updating) -> Figure:
    return Figure(
        "effective_damping",
        "Damping over the amplitude",
        "Energy that is lost in a cycle over 4 pi times the kinetic energy: of the best class with its 95 % band, and "
        "by the work of the measured force. Points and class may differ by a factor that all points of a mode have in "
        "common, the calibration of force and motion.",
        lambda: plots.effective_damping(result.damping),
    )


def find_true_theta(posterior: ClassPosterior, truth: UpdatingTruth | None) -> list[float | None]:
    """Return the true value of each parameter of a class; None for all if the class lacks a part of the true law."""
    own = posterior.model_class
    if truth is None:
        return [None] * own.n_parameters
    true: list[float | None] = []
    for each in own.law_parameters:
        held = set()
        for joint in each.term.joints or truth.laws:
            terms = truth.laws[joint].parameters
            its_own = [term for term in own.terms if term.acts_at(joint)]
            if not all(any(_may_be(term, kind, values) for term in its_own) for kind, values in terms.items()):
                return [None] * own.n_parameters
            # A term that a joint does not have has the amplitude 0 and any inner parameters.
            found = {LAWS[each.term.kind].parameters[0].name: 0.0}
            if each.term.kind in terms and _may_be(each.term, each.term.kind, terms[each.term.kind]):
                found = terms[each.term.kind]
            held.add(found.get(each.own.name))
        value = held.pop() if len(held) == 1 else None
        true.append(None if value is None else value / each.scale + 0.0)
    return [*true, *(None for _ in own.ratios), *(truth.linear.get(each.name) for each in own.factors)]


def _may_be(term: UncertainTerm, kind: str, values: Mapping[str, float]) -> bool:
    """Return whether a term may have these parameters: its kind, and the extension at which it begins, where known."""
    if term.kind != kind:
        return False
    return term.gap_m is None or math.isclose(term.gap_m, values["gap_m"], rel_tol=1e-6)


def _draw_forces(result: Updating, truth: UpdatingTruth | None, joint: str) -> Any:
    reached = result.reached_extension
    # the laws of joints that no test extends are drawn, too
    extension = np.linspace(0, 1.1 * max(reached.values(), default=0.0) or 1e-3, N_EXTENSIONS)
    return plots.joint_forces(
        extension,
        [_compute_force_band(each, joint, extension) for each in result.classes],
        best=result.best_class,
        truth=force_at_turns(truth.laws[joint], extension) if truth else None,
        reached=reached,
    )


def _compute_force_band(posterior: ClassPosterior, joint: str, extension: FloatArray) -> Any:
    own = posterior.model_class
    thinned = posterior.samples[:: max(1, len(posterior.samples) // N_DRAWS)]
    draws = np.array([force_at_turns(own.law(joint, theta), extension) for theta in thinned])
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    if not posterior.has_intervals:
        low = high = np.full(extension.shape, np.nan)
    return plots.ForceBand(own.name, draws.mean(axis=0), low, high)


def _choose_sensors(result: Updating, mode: int) -> list[str]:
    curves = [curve for curve in result.measured if curve.mode == mode]
    largest: dict[str, float] = {}
    for curve in curves:
        for sensor, values in zip(curve.sensors, np.abs(curve.amplitude).max(axis=0), strict=True):
            largest[sensor] = max(largest.get(sensor, 0.0), float(values))
    chosen = sorted(largest, key=lambda sensor: -largest[sensor])[:N_SENSORS_SHOWN]
    return [sensor for sensor in largest if sensor in chosen]


def _choose_bands(result: Updating, mode: int) -> list[Any]:
    shown = set(_choose_sensors(result, mode)) if any(curve.mode == mode for curve in result.measured) else set()
    own = [band for band in result.prediction if band.mode == mode]
    return ([band for band in own if band.sensor in shown] or own)[:N_SENSORS_SHOWN]
