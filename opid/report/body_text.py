"""A body on several suspensions as text and as tables: parameters, suspensions, and the structures compared."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from opid.estimate import Estimate, rounded
from opid.mechanics.laws.rows import unit_of_parameter
from opid.report.as_text import (
    WIDTH,
    Row,
    aligned,
    columns,
    estimate_row,
    labelled,
    laid_out,
    refusal,
    table_lines,
    wrapped,
)
from opid.report.estimates import formula, parameter_label
from opid.report.gear_text import sensors_in_words
from opid.report.rest_rows import rest_rows
from opid.suspensions.answer.intervals import limits_of_mass
from opid.suspensions.fitting.noise import over_noise
from opid.suspensions.result import UNITS, Candidate, Identification, InterfaceEstimate

LABELS = {
    "sprung_mass_kg": "sprung mass M",
    "roll_inertia_kg_m2": "inertia Ixx",
    "pitch_inertia_kg_m2": "inertia Iyy",
    "x_cg_m": "c.g. x",
    "y_cg_m": "c.g. y",
    "roll_radius_m": "roll radius",
    "pitch_radius_m": "pitch radius",
}
CANDIDATE_HEAD = ("structure", "residual / noise", "left-out run", "mass [kg]", "law", "verdict")
_SHORT_HEAD = ("structure", "fit", "left out", "mass [kg]", "law", "verdict")

Truth = Mapping[str, Any]


def body_text(result: Identification, truth: Truth | None = None) -> str:
    """Return the identification of a body as text: the numbers, the structures compared, and what to doubt.

    Args:
        result: the identification.
        truth: of a simulated aircraft, as in truth.json: shown beside each estimate.
    """
    day = "" if result.date is None else f", {result.date}"
    structures: list[str] = []
    if result.candidates:
        structures = ["Structures: residual over noise of the fit, and of runs left out of it"]
        structures += aligned(_in_width(candidate_table(result)))
    return laid_out(
        [f"{result.title or 'Identification'}{day} ({kind_in_words(result.structure)})"],
        refusal(result.not_determined),
        table_lines([*body_rows(result, truth), *suspension_rows(result, truth)], columns(truth)),
        wrapped(body_limits(result)),
        structures,
        wrapped(recommendation(result)) if result.candidates else [],
        labelled("Sensors: ", sensor_sentences(result)),
        labelled("Law: ", law_sentences(result)),
        labelled("Warning: ", result.warnings),
    )


def body_rows(result: Identification, truth: Truth | None = None) -> list[Row]:
    """Return the table of numbers of the body: masses, centre of gravity, radii, and corrections of places.

    Args:
        result: the identification.
        truth: as in truth.json, or None.
    """
    true, has_truth = truth["parameters"] if truth else {}, truth is not None
    given, of_loading = dict(result.parameters.items()), dict(result.ratios.items())
    table = [
        estimate_row(LABELS[name], UNITS[name], estimate, true.get(name), has_truth)
        for name, estimate in given.items()
        # what one loading alone gives stands below, and gears alone have no inertia
        if estimate.value is not None
        or name == "sprung_mass_kg"
        or (name not in of_loading and result.structure == "rigid_body")
    ]
    ratios = {name: estimate for name, estimate in of_loading.items() if name not in given or given[name].value is None}
    if any(estimate.value is not None for estimate in ratios.values()):
        table.append(Row("What needs no known mass"))
        table += [
            estimate_row(LABELS[name], UNITS[name], estimate, true_ratio(name, true), has_truth)
            for name, estimate in ratios.items()
        ]
    if result.place_corrections:
        table.append(Row("Places: what is to be added to the coordinates stated"))
        table += [
            estimate_row(_place(name), "m", estimate, None, has_truth)
            for name, estimate in result.place_corrections.items()
        ]
    return table


def suspension_rows(result: Identification, truth: Truth | None = None) -> list[Row]:
    """Return the table of the suspensions: stiffness, damping, law and residual of each.

    Args:
        result: the identification.
        truth: as in truth.json, or None.
    """
    table: list[Row] = []
    shown: set[str] = set()
    for interface in result.interfaces:
        like = next((name for name in interface.shared_with if name in shown), None)
        if like is not None and truth is None:
            table.append(Row(f"Suspension {interface.name}: as {like}, shared"))
            table.append(_residual_row(interface, has_truth=False))
        else:
            table += _suspension(result, interface, truth)
        shown.add(interface.name)
    return table


def candidate_table(result: Identification) -> list[tuple[str, ...]]:
    """Return the structures that were compared, head first.

    Args:
        result: the identification.
    """
    table: list[tuple[str, ...]] = [CANDIDATE_HEAD]
    for candidate in result.candidates:
        mass = candidate.sprung_mass_kg
        spread = f" ± {rounded(mass.std, mass.std)}" if mass.std is not None else ""
        table.append(
            (
                candidate_label(candidate),
                over_noise(candidate.residual_over_noise),
                over_noise(candidate.left_out_over_noise),
                rounded(mass.value, mass.std) + spread,
                candidate.law.replace("+", " + ") or "-",
                verdict(candidate),
            )
        )
    return table


def candidate_label(candidate: Candidate) -> str:
    """Return what a structure is called in tables and figures.

    Args:
        candidate: the structure.
    """
    if candidate.kind == "rigid_body":
        return "rigid body"
    names = ", ".join(candidate.interfaces)
    return f"mean {names}" if candidate.kind == "pair" else f"{names} alone"


def verdict(candidate: Candidate) -> str:
    """Return what is to be thought of a structure, in a word or two.

    Args:
        candidate: the structure.
    """
    if candidate.recommended:
        return "recommended"
    if not math.isfinite(candidate.residual_over_noise):
        return "no fit"
    return "explains" if candidate.explains else "rejected"


def recommendation(result: Identification) -> str:
    """Return which structure is recommended, and why; that none is, if so.

    Args:
        result: the identification.
    """
    best = result.recommended
    if best is None:
        explained = any(candidate.explains for candidate in result.candidates)
        doubt = "their mass would be negative" if explained else "none leaves noise alone"
        return f"Recommended: none of them, for {doubt}. The numbers are those of: {_kind(result)}."
    return f"Recommended: {kind_in_words(best.kind)}. Why: {sentence(result.reason)}"


def sensor_sentences(result: Identification) -> list[str]:
    """Return what was found out about the sensors, a sentence for each fitted structure.

    Args:
        result: the identification.
    """
    return [words for evidence in result.evidence if (words := sensors_in_words(evidence))]


def law_sentences(result: Identification) -> list[str]:
    """Return which other laws explain the runs as well.

    Args:
        result: the identification.
    """
    return [f"{words}." for words in result.alternative_laws]


def body_limits(result: Identification) -> str:
    """Return the sentence that says what the answer rests on.

    Args:
        result: the identification.
    """
    n_runs, n_gears = len(result.runs), len(result.interfaces)
    n_sensors = max((len(run.measured) for run in result.runs), default=n_gears)
    n_loadings = len({run.loading for run in result.runs})
    scale = "one loading" if n_loadings == 1 else f"{n_loadings} loadings"
    alike = " ".join(
        f"{each[0].upper()}{each[1:]}."
        for evidence in result.evidence[:1]
        for each in limits_of_mass(
            evidence.repeatability,
            evidence.fit,
            # of gears that were fitted one by one, each has a share of its own
            result.parameters.sprung_mass_kg if len(result.evidence) == 1 else Estimate(),
        )
    )
    return (
        f"From {n_runs} run{'s' * (n_runs > 1)} at {scale}: {n_sensors} sensor{'s' * (n_sensors > 1)} on the body "
        f"predicted from the motion below {n_gears} suspension{'s' * (n_gears > 1)}, "
        f"{over_noise(result.residual_over_noise)} times the noise of {1e3 * result.noise_m_per_s2:.2g} mm/s^2 is left."
        f"{' ' * bool(alike)}{alike}"
    )


def kind_in_words(kind: str) -> str:
    """Return a kind of structure in words.

    Args:
        kind: of `opid.suspensions.study.KINDS`, or another.

    >>> kind_in_words("rigid_body"), kind_in_words("single")
    ('rigid body', 'each suspension alone')
    """
    return {"single": "each suspension alone", "pair": "mean of each pair"}.get(kind, kind.replace("_", " "))


def true_ratio(name: str, true: Mapping[str, float]) -> float | None:
    """Return what is true of one of the ratios of a body.

    Args:
        name: of the ratio.
        true: of its parameters; empty if nothing is known.

    >>> true_ratio("roll_radius_m", {"sprung_mass_kg": 100.0, "roll_inertia_kg_m2": 400.0})
    2.0
    """
    if not true or name in true:
        return true.get(name)
    inertia = {"roll_radius_m": "roll_inertia_kg_m2", "pitch_radius_m": "pitch_inertia_kg_m2"}[name]
    return math.sqrt(true[inertia] / true["sprung_mass_kg"])


def sentence(text: str) -> str:
    """Return a clause as a sentence: with one full stop.

    Args:
        text: the clause.
    """
    return text.rstrip(". ") + "." if text.strip() else ""


def _place(name: str) -> str:
    """A coordinate in words: "sensor_x_m[left]" is "left, sensor x"."""
    what, _, whose = name.rstrip("]").partition("[")
    return f"{whose}, {what.removesuffix('_m').replace('_', ' ')}" if whose else name


def _kind(result: Identification) -> str:
    return kind_in_words(result.structure)


def _suspension(result: Identification, interface: InterfaceEstimate, truth: Truth | None) -> Iterator[Row]:
    has_truth = truth is not None
    true = truth["interfaces"].get(interface.name) if truth else None
    scale = 1.0 / truth["parameters"]["sprung_mass_kg"] if truth and result.per_mass else 1.0
    stiffness, damping = result.units
    terms = interface.law.terms
    shown = f", f = {formula(interface.law.latex)}" if len(terms) == 1 else ""
    other = f"; truth: {true['law']['name']}" if true and true["law"]["name"] != interface.law.name else ""
    yield Row(f"Suspension {interface.name}: {interface.law.name}{shown}{other}")
    yield _residual_row(interface, has_truth=has_truth)
    slope = "K/M" if result.per_mass else "K"
    known = {key: scale * true[key] for key in ("stiffness_n_per_m", "damping_n_s_per_m")} if true else {}
    yield estimate_row(f"stiffness {slope}", stiffness, interface.stiffness, known.get("stiffness_n_per_m"), has_truth)
    slope = "C/M" if result.per_mass else "C"
    yield estimate_row(f"damping {slope}", damping, interface.damping, known.get("damping_n_s_per_m"), has_truth)
    if interface.ground_stiffness.value:
        slope = "K3/M" if result.per_mass else "K3"
        yield estimate_row(f"ground {slope}", stiffness, interface.ground_stiffness, None, has_truth)
    for term in terms:
        if len(terms) > 1:
            yield Row(f"Term {term.name} of {interface.name}: {formula(term.kind.latex)}")
        for parameter in term.kind.parameters if term.name in interface.law_estimates else ():
            amplitude = parameter.role == "amplitude"
            value = true["law"]["parameters"].get(term.name, {}).get(parameter.name) if true else None
            yield estimate_row(
                parameter_label(parameter),
                unit_of_parameter(parameter, per_mass=result.per_mass),
                interface.law_estimates[term.name][parameter.name],
                value * scale if amplitude and value is not None else value,
                has_truth,
            )
    yield from rest_rows(interface, (stiffness, damping), has_truth=has_truth)


def _residual_row(interface: InterfaceEstimate, *, has_truth: bool) -> Row:
    blank = ("-", "1", "-", "-", "-") if has_truth else ("-", "-", "1")
    return Row("residual/noise", (over_noise(interface.residual_over_noise), *blank))


def _in_width(table: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Cut the names of laws where the lines would be longer than a terminal is wide; pages show them whole."""
    place = _SHORT_HEAD.index("law")
    short = [_SHORT_HEAD, *table[1:]]
    room = WIDTH - sum(max(len(row[i]) for row in short) + 2 for i in range(len(_SHORT_HEAD)) if i != place)

    def cut(law: str) -> str:
        return law if len(law) <= room else law[: max(room - 2, 1)] + ".."

    return [(*row[:place], cut(row[place]), *row[place + 1 :]) for row in short]
