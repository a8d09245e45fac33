"""The report of an identification: of one gear, by any method, or of a body on several suspensions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict

from opid.estimate import Estimate, format_number, format_percent, rounded, with_std
from opid.mechanics.laws.law import Law
from opid.mechanics.memory import loop_area, sine_like
from opid.mechanics.truth import BodyTruth, GearTruth, SuspensionTruth, TaxiTruth
from opid.mechanics.weight import depends_on_travel
from opid.plots.style import find_true_scale
from opid.report.document import (
    Block,
    Document,
    Paragraph,
    Remarks,
    Row,
    Table,
    build_columns,
    build_warnings,
    end_sentence,
    format_count,
    write_sentence,
)
from opid.report.estimates import (
    INTERVAL,
    build_estimate_row,
    list_gas_rows,
    list_law_rows,
    say_law,
    tabulate_estimates,
)
from opid.report.sketch import sketch_suspensions
from opid.report.suspensions.again import write_command, write_python
from opid.report.suspensions.figures import list_figures
from opid.report.suspensions.paper_tables import tabulate_peaks, tabulate_spectra, tabulate_weighed
from opid.suspensions.answer.as_json import chain_of
from opid.suspensions.answer.intervals import limits_of_mass
from opid.suspensions.fitting.noise import over_noise
from opid.suspensions.paper.chain import PaperChain
from opid.suspensions.paper.result import AnyIdentification, PaperIdentification
from opid.suspensions.result import UNITS, Candidate, GearParameters, Identification, InterfaceEstimate
from opid.suspensions.sensor_facts import TRAVEL_PER_S2, UNKNOWN_GAIN, TravelSensor
from opid.suspensions.study import Study

LABELS = {
    "suspension_stiffness_n_per_m": "stiffness K2",
    "suspension_damping_n_s_per_m": "damping C2",
    "ground_stiffness_n_per_m": "ground K3",
    "roll_inertia_kg_m2": "inertia Ixx",
    "pitch_inertia_kg_m2": "inertia Iyy",
    "x_cg_m": "c.g. x",
    "y_cg_m": "c.g. y",
    "stiffness_per_mass": "K2/M2",
    "damping_per_mass": "C2/M2",
    "ground_stiffness_per_mass": "K3/M2",
    "natural_frequency_hz": "natural freq.",
    "damping_ratio": "damping ratio",
    "roll_radius_m": "roll radius",
    "pitch_radius_m": "pitch radius",
}
FREQUENCY_OF = {
    "linear part": "",
    "tangent at rest": "On the tangent stiffness at rest in the reference run, with the damping C2",
    "all but what the law remembers": "Without what the law remembers: stiffer in small or quick motion",
}
"""What natural frequency and damping ratio refer to, unless it is K2 with C2 alone."""

REFERENCE = (
    "“The paper” above is J. Iwaniec and T. Uhl, Identification of nonlinear parameters of the Skytruck airplane "
    "landing gear by means of the operational modal analysis output-only method, Molecular and Quantum Acoustics 28 "
    "(2007)."
)

MOST_NAMED = 6
"""This many kinds of law at most are named one by one."""


def build_document(result: AnyIdentification, truth: TaxiTruth | None = None) -> Document:
    """Return the report of an identification: the numbers, their basis, and the warnings."""
    day = f", runs of {result.date}" if result.date else ""
    return Document(
        result.title or "Identification",
        f"{_say_kind(result)}, from {_say_sources(result.study)}{day}",
        _say_answer(result),
        result.not_determined,
        tuple(_list_blocks(result, truth)),
        lambda: _list_details(result, truth),
        write_command(result),
        write_python(result),
        reference=REFERENCE if result.study.is_one_gear else "",
        sketch=sketch_suspensions(result),
    )


def _say_sources(study: Study) -> str:
    if not study.strut_sensors:
        return "accelerations alone"
    travels, forces = len(study.travels), len(study.forces)
    names = ["the travels" if travels > 1 else "the travel"] * bool(travels)
    names += ["the forces in the struts" if forces > 1 else "the force in the strut"] * bool(forces)
    if not study.is_driven:
        return " and ".join([*names, "the acceleration above"])
    return f"accelerations and {' and '.join(names)}"


def _say_kind(result: AnyIdentification) -> str:
    if isinstance(result, PaperIdentification) or result.study.is_one_gear:
        return f"method {result.method}"
    return _say_structure(result.structure)


def _say_structure(structure: str) -> str:
    names = {"single": "each suspension alone", "pair": "mean of each pair"}
    return names.get(structure, structure.replace("_", " "))


def _say_answer(result: AnyIdentification) -> str:
    mass, said = result.parameters.sprung_mass_kg, []
    if mass.interval95 is not None:
        low, high = (rounded(end, mass.std) for end in mass.interval95)
        said.append(f"the sprung mass is {rounded(mass.value, mass.std)} kg (95 % interval {low} .. {high} kg)")
    if not result.is_refused:
        said += _say_laws(result)
    return write_sentence("; ".join(said))


def _say_laws(result: AnyIdentification) -> Iterator[str]:
    if result.study.is_one_gear or not isinstance(result, Identification):
        yield f"the law is {result.law.name}"
        return
    names: dict[str, list[str]] = {}
    for interface in result.interfaces:
        names.setdefault(interface.law.name, []).append(interface.name)
    for law, whose in names.items():
        yield f"the law of {'each suspension' if len(names) == 1 else ' and '.join(whose)} is {law}"


def _list_blocks(result: AnyIdentification, truth: TaxiTruth | None) -> Iterator[Block]:
    simulated = " The runs were simulated: truth, error, and whether the interval held the truth, are known."
    about_body = (
        " Values are those of the reference loading; inertias about the centre of gravity, x forward, y to the left."
    )
    yield tabulate_estimates(
        _list_rows(result, truth),
        truth,
        legend=INTERVAL
        + simulated * (truth is not None)
        + about_body * (not result.study.is_one_gear)
        + " The force of a suspension is K z + C z′ + f(z, z′), z the travel of the body less that below.",
    )
    if (weighed := tabulate_weighed(result)) is not None:
        yield weighed
    if isinstance(result, PaperIdentification) and result.method == "paper":
        peaks = tabulate_peaks(result.study, result.chain)
        yield from [] if peaks is None else [peaks]
    yield build_warnings(result.warnings)
    yield Paragraph(_say_limits(result))
    if isinstance(result, Identification):
        if result.candidates and not result.study.is_one_gear:
            yield _tabulate_structures(result)
            yield Paragraph(_say_recommendation(result))
        yield from _list_sensors(result)
    yield Remarks("Law", result.alternative_laws)


def _list_details(result: AnyIdentification, truth: TaxiTruth | None) -> Iterator[Block]:
    chain = chain_of(result) if result.study.is_one_gear else None
    yield _tabulate_runs(result, chain)
    if chain is not None:
        yield tabulate_spectra(chain)
        peaks = tabulate_peaks(result.study, chain) if result.method != "paper" else None
        yield from [] if peaks is None else [peaks]
    yield from list_figures(result, truth)


# ---- the table of numbers --------------------------------------------------------------------------


def _list_rows(result: AnyIdentification, truth: TaxiTruth | None) -> Iterator[Row]:
    """Parameters, suspensions, and the ratios that need no known mass, which may be all that a body is known by."""
    yield from _list_parameter_rows(result, truth)
    if result.study.is_one_gear:
        if not result.is_refused:
            yield from _list_gear_rows(result, truth)
        yield from _list_ratio_rows(result, truth)
        yield from _list_equivalent_rows(result)
    elif isinstance(result, Identification):
        yield from _list_ratio_rows(result, truth)
        if result.place_corrections:
            yield ("Coordinates: what is to be added to those stated",)
        for name, estimate in result.place_corrections.items():
            yield build_estimate_row(_format_coordinate(name), "m", estimate)
        yield from _list_suspension_rows(result, truth)


def _list_parameter_rows(result: AnyIdentification, truth: TaxiTruth | None) -> Iterator[Row]:
    true = truth.parameters if truth else None
    ratios = dict(result.ratios.items())
    # gears alone have no inertia, and the numbers that one loading gives are among the ratios
    is_told = isinstance(result.parameters, GearParameters) or _is_rigid(result)
    for name, estimate in result.parameters.items():
        if estimate.value is not None or name == "sprung_mass_kg" or (is_told and name not in ratios):
            yield build_estimate_row(_format_label(name, result), UNITS[name], estimate, getattr(true, name, None))


def _is_rigid(result: AnyIdentification) -> bool:
    return isinstance(result, Identification) and result.structure == "rigid_body"


def _format_label(name: str, result: AnyIdentification) -> str:
    if name == "sprung_mass_kg":
        return "sprung mass M2" if result.study.is_one_gear else "sprung mass M"
    return LABELS[name]


def _list_ratio_rows(result: AnyIdentification, truth: TaxiTruth | None) -> Iterator[Row]:
    given = dict(result.parameters.items())
    shown = {name: each for name, each in result.ratios.items() if name not in given or given[name].value is None}
    if not (result.study.is_one_gear or any(estimate.value is not None for estimate in shown.values())):
        return
    is_model = isinstance(result, Identification)
    true = _compute_true_ratios(truth, is_at_rest=is_model) if truth else {}
    yield ("Ratios to the mass of the reference run" if result.study.is_one_gear else "What needs no known mass",)
    for name, estimate in shown.items():
        if name == "natural_frequency_hz" and estimate.value is not None and isinstance(result, Identification):
            belongs_to = FREQUENCY_OF[result.frequency_of]
            yield from [(belongs_to,)] * bool(belongs_to)
        yield build_estimate_row(LABELS[name], UNITS[name], estimate, true.get(name))


def _compute_true_ratios(truth: TaxiTruth, *, is_at_rest: bool) -> dict[str, float]:
    """The true ratios of a gear or a body; its frequency is that of the tangent stiffness if `is_at_rest`."""
    mass = truth.parameters.sprung_mass_kg
    if isinstance(truth, BodyTruth):
        body = truth.parameters
        radii = {"roll_radius_m": body.roll_inertia_kg_m2 / mass, "pitch_radius_m": body.pitch_inertia_kg_m2 / mass}
        return asdict(body) | {name: math.sqrt(square) for name, square in radii.items()}
    gear = truth.parameters
    stiffness, damping = gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m
    ground, slope = gear.ground_stiffness_n_per_m, truth.law.gradient(0.0, 0.0)[0] if is_at_rest else 0.0
    omega = math.sqrt((stiffness + ground + float(slope)) / mass)
    return {
        "stiffness_per_mass": stiffness / mass,
        "damping_per_mass": damping / mass,
        "ground_stiffness_per_mass": ground / mass,
        "natural_frequency_hz": omega / (2 * math.pi),
        "damping_ratio": damping / (2 * mass * omega),
    }


def _list_equivalent_rows(result: AnyIdentification) -> Iterator[Row]:
    """The straight suspension of each run, if the numbers of the law are not valid, or if the law remembers."""
    if not isinstance(result, Identification) or not (result.limited_by == "model" or result.law.has_memory):
        return
    for each in result.equivalents:
        yield (f"Straight suspension that comes nearest to it over the motion of run {each.run!r}",)
        for name in ("natural_frequency_hz", "damping_ratio"):
            yield build_estimate_row(LABELS[name], UNITS[name], getattr(each, name))


def _format_coordinate(name: str) -> str:
    """A coordinate in words: "sensor_x_m[left]" becomes "left, sensor x"."""
    what, _, whose = name.rstrip("]").partition("[")
    return f"{whose}, {what.removesuffix('_m').replace('_', ' ')}" if whose else name


# ---- suspensions -----------------------------------------------------------------------------------


def _list_gear_rows(result: AnyIdentification, truth: TaxiTruth | None) -> Iterator[Row]:
    true, scale = truth if isinstance(truth, GearTruth) else None, find_true_scale(truth, per_mass=result.per_mass)
    yield from _list_law_rows(result, "", result.law, result.law_estimates, true, scale)
    if isinstance(result, Identification):
        yield from _list_rest_rows(result, result.interfaces[0], true)
        yield from _list_loop_rows(result, result.interfaces[0], true, scale)


def _list_suspension_rows(result: Identification, truth: TaxiTruth | None) -> Iterator[Row]:
    shown: set[str] = set()
    scale = find_true_scale(truth, per_mass=result.per_mass)
    for interface in result.interfaces:
        like = next((name for name in interface.shared_with if name in shown), None)
        if like is not None and truth is None:
            yield (f"Suspension {interface.name}: as {like}, shared",)
            yield _build_residual_row(interface)
        else:
            true = truth.interfaces.get(interface.name) if isinstance(truth, BodyTruth) else None
            springs = _list_spring_rows(result, interface, true, scale)
            yield from _list_law_rows(
                result, interface.name, interface.law, interface.law_estimates, true, scale, springs
            )
            yield from _list_rest_rows(result, interface, true)
            yield from _list_loop_rows(result, interface, true, scale)
        shown.add(interface.name)


def _list_spring_rows(
    result: Identification, interface: InterfaceEstimate, true: SuspensionTruth | None, scale: float
) -> Iterator[Row]:
    springs = (
        ("stiffness K", "stiffness_n_per_m", interface.stiffness),
        ("damping C", "damping_n_s_per_m", interface.damping),
        ("ground K3", "ground_stiffness_n_per_m", interface.ground_stiffness),
    )
    yield _build_residual_row(interface)
    for label, name, estimate in springs if interface.ground_stiffness.value else springs[:2]:
        known = getattr(true, name, None)
        value = None if known is None else known * scale
        yield build_estimate_row(f"{label}{'/M' * result.per_mass}", result.units["damping" in name], estimate, value)


def _list_law_rows(
    result: AnyIdentification,
    suspension: str,
    law: Law,
    estimates: Mapping[str, Mapping[str, Estimate]],
    true: GearTruth | SuspensionTruth | None,
    scale: float,
    springs: Iterable[Row] = (),
) -> Iterator[Row]:
    """The name of a law, the springs beside it, and its parameters; the only suspension of a gear has no name."""
    other = f"; truth: {true.law.name}" if true and true.law.name != law.name else ""
    symbol = "f" if not result.per_mass else "f/M" if suspension else "f/M2"
    yield (f"{f'Suspension {suspension}' if suspension else 'Law'}: {say_law(law, symbol)}{other}",)
    yield from springs
    parameters = true.law.parameters if true else None
    yield from list_law_rows(law, estimates, of=suspension, per_mass=result.per_mass, true=parameters, true_scale=scale)


def _build_residual_row(interface: InterfaceEstimate) -> Row:
    return ("residual/noise", over_noise(interface.residual_over_noise), "-", "-", "1", "-", "-", "-")


def _list_rest_rows(
    result: Identification, interface: InterfaceEstimate, true: GearTruth | SuspensionTruth | None
) -> Iterator[Row]:
    """The rest of a suspension in each run, and its stiffness there, if its law depends on travel."""
    if interface.stiffness.value is None or not depends_on_travel(interface.law):
        return
    stiffness, damping = result.units
    rows: list[tuple[str, str, Estimate]] = []
    true_rest_m = 0.0 if true is None else true.law.rest_m
    is_elsewhere = bool(interface.rest_m.value or true_rest_m)
    for each in interface.at_rest:
        if each.travel_m.std:
            rows.append((f"{each.run}: travel", "m", each.travel_m))
        rows.append((f"{each.run}: stiffness", stiffness, each.stiffness))
        rows.append((f"{each.run}: damping", damping, each.damping))
    yield ("At rest, run by run: static travel from the reference run, tangent stiffness, equivalent damping",)
    if is_elsewhere:
        yield build_estimate_row("rest on the law", "m", interface.rest_m, None if true is None else true_rest_m)
    yield from (build_estimate_row(*row) for row in rows)
    yield from list_gas_rows(interface.gas, "Gas at rest in the reference run")


def _list_loop_rows(
    result: Identification, interface: InterfaceEstimate, true: GearTruth | SuspensionTruth | None, scale: float
) -> Iterator[Row]:
    """The energy that what a suspension remembers takes per cycle, in a motion as large and as fast as each run."""
    if interface.stiffness.value is None:
        return
    for each in interface.at_rest:
        if each.loop is None or each.loop.frequency_hz is None:
            continue
        size_m, frequency_hz = each.loop.travel_amplitude_m, each.loop.frequency_hz
        known = None
        if true is not None:
            pace = 2 * math.pi * frequency_hz
            known = scale * loop_area(true.law, *sine_like(size_m / math.sqrt(2), size_m * pace / math.sqrt(2)))
        sine = f"a sine of {format_number(1e3 * size_m, 3)} mm at {format_number(frequency_hz, 3)} Hz"
        yield (
            f"What remembers, in {sine} like run {each.run!r}"
            f"{': these runs do not determine it' * (each.loop.area_j.value is None)}",
        )
        yield build_estimate_row("energy per cycle", "J/kg" if result.per_mass else "J", each.loop.area_j, known)


# ---- structures, sensors and runs ------------------------------------------------------------------


def _tabulate_structures(result: Identification) -> Table:
    def build_row(candidate: Candidate) -> Row:
        mass = candidate.sprung_mass_kg
        return (
            candidate.label,
            over_noise(candidate.residual_over_noise),
            over_noise(candidate.left_out_over_noise),
            with_std(mass.value, mass.std),
            candidate.law.replace("+", " + ") or "-",
            _say_verdict(candidate),
        )

    return Table(
        build_columns(
            "structure", "fit", "left out", "mass ± std [kg]", "law", "verdict", left=(0, 4, 5), elastic=(4,)
        ),
        tuple(map(build_row, result.candidates)),
        "Structures: residual over noise of the fit, and of runs left out of it",
        legend="The mass is what rests on a suspension alone or on one of a pair, and all that is sprung for a rigid "
        "body. The noise is known beforehand, from the study or from the records.",
    )


def _say_verdict(candidate: Candidate) -> str:
    if candidate.recommended:
        return "recommended"
    if not math.isfinite(candidate.residual_over_noise):
        return "no fit"
    return "explains" if candidate.explains else "rejected"


def _say_recommendation(result: Identification) -> str:
    best = result.recommended
    if best is None:
        explained = any(candidate.explains for candidate in result.candidates)
        reason = "their mass would be negative" if explained else "none leaves noise alone"
        return f"Recommended: none of them, for {reason}. The numbers are those of: {_say_structure(result.structure)}."
    return f"Recommended: {_say_structure(best.kind)}. Why: {end_sentence(result.reason)}"


def _list_sensors(result: Identification) -> Iterator[Table | Paragraph]:
    """The faults of sensors that the fits found, beside what was known before, and what was found of their clocks."""
    rows = tuple(
        (
            fault.name,
            rounded(fit.value(fault.name), std := float(fit.std[fit.model.names.index(fault.name)])),
            rounded(std, std),
            format_number(fault.nominal, 3),
            format_number(fault.std, 1),
        )
        for fit in (evidence.fit for evidence in result.evidence)
        for fault in fit.model.faults
        if fault.std < UNKNOWN_GAIN
    )
    rows += tuple(
        (
            f"{channel}, reading for 1 N",
            rounded(gain.value, gain.std or 0.0),
            rounded(gain.std or 0.0, gain.std),
            "",
            "",
        )
        for evidence in result.evidence
        for channel, gain in evidence.gains_of_forces.items()
        if gain.value is not None
    )
    of_clocks = [
        f"{run.name}: {finding.message}"
        for run in result.study.runs
        for finding in run.findings
        if finding.code in ("matched_clocks", "judged_stamps")
    ]
    columns = build_columns("of the sensors", "found", "std. dev.", "known before", "std. dev.")
    if rows:
        yield Table(columns, rows, note="; ".join(of_clocks))
    elif of_clocks:
        yield Paragraph(end_sentence("; ".join(of_clocks)))


def _tabulate_runs(result: AnyIdentification, chain: PaperChain | None) -> Table:
    """The runs (Table 1 of the paper), and what the steps of the paper found of each."""
    steps = chain.runs if chain is not None else ()

    def format_step(index: int) -> Row:
        surface = steps[index].surface
        travel, velocity = 1e3 * float(surface.travel.std()), float(surface.velocity.std())
        return format_number(travel, 3), format_number(velocity, 3), f"{steps[index].T.spectra.n_averages:.1f}"

    heads = ("travel rms [mm]", "velocity rms [m/s]", "averages")
    has_weighed = any(run.weighed_mass_kg is not None for run in result.study.runs)
    weighed = ("weighed [kg]",) * has_weighed
    known = ("mass change [kg]", *weighed, "length [s]", "rate [Hz]", "samples")
    return Table(
        build_columns("run", *known, *(heads if steps else ())),
        tuple(
            (
                run.name,
                format_number(run.mass_change_kg, has_sign=True) if run.mass_change_kg else "0",
                *(("-" if run.weighed_mass_kg is None else format_number(run.weighed_mass_kg),) * has_weighed),
                format_number(run.recording.duration_s, 4),
                format_number(run.recording.fs),
                f"{run.recording.n_samples}",
                *(format_step(index) if steps else ()),
            )
            for index, run in enumerate(result.study.runs)
        ),
        "Runs",
    )


# ---- what the answer rests on ----------------------------------------------------------------------


def _say_limits(result: AnyIdentification) -> str:
    if isinstance(result, PaperIdentification):
        return _say_limits_of_chain(result)
    return _say_limits_of_gear(result) if result.study.is_one_gear else _say_limits_of_body(result)


def _say_limits_of_gear(result: Identification) -> str:
    evidence, lines = result.evidence[0], result.runs[0].frequency_hz
    is_white = evidence.whiteness.white
    if result.study.is_driven:
        follows = (
            "the model predicts the airframe acceleration to "
            f"{_format_mm_per_s2(evidence.fit.noise_m_per_s2)} rms, and the sensors' noise is at most "
            f"{_format_mm_per_s2(evidence.noise)}"
        )
    else:
        number = next(k for k, (_, each) in enumerate(result.study.strut_sensors) if isinstance(each, TravelSensor))
        n_strut = len(result.study.strut_sensors)
        noise_m = float(evidence.fit.model.noise[1][number - n_strut]) / TRAVEL_PER_S2
        follows = (
            "with the airframe acceleration the model predicts the travel to "
            f"{_format_mm(evidence.fit.ratio * noise_m)} rms, and the noise of its sensor is {_format_mm(noise_m)}"
        )
    predicted = (
        f"{_say_runs(len(result.runs), (lines[0], lines[-1]))}{follows}; the prediction errors are "
        f"{'white, as noise is' if is_white else 'not white'}."
    )
    if not any(estimate.interval95 for _, estimate in (*result.parameters.items(), *result.ratios.items())):
        return predicted
    checked = evidence.bootstrap_over_white.get("inverse_mass")
    check = f" (resampling blocks of time gives {checked:.2f} times that of the mass)" if checked and is_white else ""
    unlike = " and for suspensions that differ from run to run" * (evidence.repeatability.estimated is not None)
    left_out = (
        f"The other runs predict {result.runs[each.run].name!r} to {format_percent(each.unexplained, 2)} of its rms "
        f"acceleration; {100 * each.inside:.0f} % of its spectral lines lie in the predicted 95 % band."
        for each in result.left_out
    )
    sentences = (
        f"{predicted} The intervals allow for {'such noise' if is_white else 'errors so coloured'}{check}{unlike}.",
        *left_out,
        *map(write_sentence, evidence.limits),
    )
    return " ".join(sentences) + _say_kinds(result.options.law, result.options.kinds)


def _say_limits_of_chain(result: PaperIdentification) -> str:
    averages = min(run.T.spectra.n_averages for run in result.chain.runs)
    the_same = (
        " Stiffness, damping and friction are taken to be the same in all runs; the driven model lets them differ."
    )
    return (
        f"{_say_runs(len(result.chain.runs), result.chain.band_hz)}the fitted equation leaves "
        f"{_format_mm_per_s2(result.joint.noise_m_per_s2)} rms unexplained, the noise floor of the airframe sensor is "
        f"at most {_format_mm_per_s2(result.chain.noise_floor_m_per_s2)}. Each transmissibility rests on "
        f"{averages:.1f} independent averages (the parameters do not come from it)."
        f"{the_same * (len(result.chain.runs) > 1)}"
        f"{_say_kinds(result.settings.law, result.tried_kinds)}"
    )


def _say_limits_of_body(result: Identification) -> str:
    n_gears = len(result.interfaces)
    n_sensors = max((len(run.measured) for run in result.runs), default=n_gears)
    n_loadings = len({run.loading for run in result.runs})
    scale = "one loading" if n_loadings == 1 else f"{n_loadings} loadings"
    # gears that were fitted one by one share the mass, so that it belongs to no single fit
    mass = result.parameters.sprung_mass_kg if len(result.evidence) == 1 else Estimate()
    is_pushed = result.limited_by == "unmeasured forces"
    alike = (limits_of_mass(each.repeatability, each.fit, mass, is_pushed=is_pushed) for each in result.evidence[:1])
    return " ".join(
        (
            f"From {format_count(len(result.runs), 'run')} at {scale}: {format_count(n_sensors, 'sensor')} on the body "
            f"predicted from the motion below {format_count(n_gears, 'suspension')}, "
            f"{over_noise(result.residual_over_noise)} times the noise of {_format_mm_per_s2(result.noise_m_per_s2)} "
            "is left.",
            *(write_sentence(limit) for limits in alike for limit in limits),
        )
    )


def _say_runs(n_runs: int, band_hz: tuple[float, float]) -> str:
    return f"From {format_count(n_runs, 'run')}, {format_number(band_hz[0], 3)} to {format_number(band_hz[1], 3)} Hz: "


def _say_kinds(law: str | None, kinds: tuple[str, ...]) -> str:
    if law is not None:
        return ""
    named = ", ".join(sorted(kinds)) if len(kinds) <= MOST_NAMED else f"the {len(kinds)} kinds of the library"
    return (
        f" Stiffness and damping are the linear part of the force. The law is its nonlinear part, chosen among {named} "
        "and their sums; with another law both would have other values."
    )


def _format_mm(value_m: float) -> str:
    return f"{format_number(1e3 * value_m, 2)} mm"


def _format_mm_per_s2(value: float) -> str:
    return f"{format_number(1e3 * value, 2)} mm/s^2"
