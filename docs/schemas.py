"""JSON Schemas of what opid writes, made from its frozen result records: `python docs/schemas.py` writes docs/schemas/.

A part of a file that is a record as it stands is read from that record: its fields, their types, and what its docstring
says of them. What `as_json` arranges by hand is stated here by hand.
"""

from __future__ import annotations

import inspect
import json
import re
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import EnumType
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from opid.estimate import Estimate
from opid.modal.decay.free_decay import SCHEMA as DECAY, Decay
from opid.modal.decay.law import DecayLaw
from opid.modal.forced.mode_fit import ModeFit
from opid.modal.forced.system_fit import DrivenLaw, SystemFit
from opid.modal.joint_terms import JointEstimates
from opid.modal.linear.fitted_modes import SCHEMA as MODES, FittedModes
from opid.modal.linear.level_shifts import LevelShift
from opid.modal.linear.modes import LinearModes
from opid.modal.linear.stages import SCHEMA as STAGES, ModeStages, StageShift
from opid.modal.model import Comparison as TruthComparison, TruthTest
from opid.modal.resonance.appropriation import Interaction
from opid.modal.resonance.curve_fit import CurveFit, StateCheck
from opid.modal.resonance.curves import ResponseCurve
from opid.modal.resonance.held_out import HeldOut
from opid.modal.resonance.law import ResonanceLaw
from opid.modal.resonance.result import OF_INTERACTION, OF_SEVERAL, SCHEMA as RESONANCE, Resonance, Resonances
from opid.modal.result import SCHEMA as MODAL, ModalIdentification
from opid.provenance import ReadFile
from opid.signals.health.result import SCHEMA as HEALTH, ChannelHealth, Health
from opid.suspensions.answer.model_error import LeftOutSpectrum, Limit
from opid.suspensions.answer.stored_fit import StoredFit
from opid.suspensions.bench.law import SCHEMA as BENCH, BenchLaw
from opid.suspensions.bench.memory import Memory
from opid.suspensions.bench.simulation import Simulation
from opid.suspensions.flights.campaign import SCHEMA as CAMPAIGN, Campaign, Outcome, Verdict
from opid.suspensions.flights.comparison import SCHEMA as COMPARISON, Change, Comparison
from opid.suspensions.flights.departures import Point, Series
from opid.suspensions.flights.fleet import (
    SCHEMA as FLEET,
    Fleet,
    FleetSeries,
    Strut,
    StrutChange,
    StrutDrift,
    StrutFlight,
)
from opid.suspensions.law_search.force_surface import VisitedForce
from opid.suspensions.own_structure import SCHEMA as STRUCTURE, StructureIdentification
from opid.suspensions.planning.result import SCHEMA as PLAN, PlanResult, StdGrid
from opid.suspensions.result import (
    SCHEMA as IDENTIFICATION,
    Identification,
    InterfaceEstimate,
    RunResidual,
    SpringEstimate,
)
from opid.suspensions.sensing.result import SCHEMA as SENSING, Sensing, VirtualSensor
from opid.suspensions.wheel.result import SCHEMA as WHEEL, WheelIdentification
from opid.updating.measured import MeasuredBackbone
from opid.updating.model_class import ModelClass
from opid.updating.result import (
    SCHEMA as UPDATING,
    ClassPosterior,
    Confusion,
    LinearMode,
    LinearPosterior,
    ModeShape,
    Updating,
)
from opid.updating.structure.reduction import ReductionErrors

Json = dict[str, Any]
FOLDER = Path(__file__).parent / "schemas"
WIDTH = 120
PLAIN: dict[Any, str] = {bool: "boolean", int: "integer", str: "string"}
TEXT: Json = {"type": "string"}
FLAG: Json = {"type": "boolean"}
COUNT: Json = {"type": "integer"}
NUMBER: Json = {"type": ["number", "null"]}
NUMBERS: Json = {"$ref": "#/$defs/Numbers"}
TEXTS: Json = {"type": "array", "items": TEXT}
NO_NUMBER = "Where there is no finite number stands null. Units are SI unless a name says otherwise."


# ---- parts -----------------------------------------------------------------------------------------


def array(items: Json) -> Json:
    """Return the schema of a list."""
    return {"type": "array", "items": items}


def table(values: Json) -> Json:
    """Return the schema of an object whose keys are names that the study gives, or numbers of modes."""
    return {"type": "object", "additionalProperties": values}


def keys(properties: Json, *, optional: tuple[str, ...] = ()) -> Json:
    """Return the schema of an object that has these keys and no others."""
    required = [name for name in properties if name not in optional]
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def or_null(schema: Json) -> Json:
    """Return the schema of what may be null, too."""
    kind = schema.get("type")
    if "enum" in schema:
        return {**schema, "enum": [*schema["enum"], None]}
    if kind is None or "properties" in schema or "items" in schema:
        return {"anyOf": [schema, {"type": "null"}]}
    return schema if isinstance(kind, list) else {**schema, "type": [kind, "null"]}


# ---- from records ----------------------------------------------------------------------------------


def of_type(annotation: Any) -> Json:
    """Return the schema of a field by its type; a record is referred to by the name of its class."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if annotation is float:
        return NUMBER
    if annotation in PLAIN:
        return {"type": PLAIN[annotation]}
    if is_dataclass(annotation):
        return {"$ref": f"#/$defs/{define(annotation)}"}
    if origin is Literal or isinstance(annotation, EnumType):
        return {"enum": [str(each) for each in inner or annotation]}
    if origin in (Union, UnionType) and NoneType in inner:
        (only,) = (each for each in inner if each is not NoneType)
        return or_null(of_type(only))
    if origin in (np.ndarray, NDArray):
        return NUMBERS
    if inner == (float, float):
        return {"$ref": "#/$defs/Ends"}
    if origin is tuple:
        fixed = {} if Ellipsis in inner else {"minItems": len(inner), "maxItems": len(inner)}
        return NUMBERS if inner == (float, ...) else array(of_type(inner[0])) | fixed
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object"} if inner[1] is Any else table(of_type(inner[1]))
    raise TypeError(f"no schema is known of {annotation}: add it to docs/schemas.py")


def fields_of(record: type, *names: str) -> Json:
    """Return the schemas of the fields of a record, of those that are named, with what its docstring says of them."""
    hints, told = get_type_hints(record), _told(record)
    chosen = names or _names(record)
    return {name: of_type(hints[name]) | ({"description": told[name]} if name in told else {}) for name in chosen}


def define(record: type, properties: Json | None = None) -> str:
    """Make a definition of a record, which has its fields unless others are given, and return its name."""
    name = record.__name__
    if name not in DEFINED:
        sentence = _in_json(str(inspect.getdoc(record)).partition("\n\n")[0])
        DEFINED[name] = {"description": sentence} | keys(properties or fields_of(record))
    return name


def _names(record: type, *without: str) -> tuple[str, ...]:
    return tuple(field.name for field in fields(record) if field.name not in without)


def _told(record: type) -> dict[str, str]:
    """What a docstring says of each argument."""
    arguments = str(inspect.getdoc(record)).partition("Args:\n")[2].partition("\n\n")[0]
    found = re.findall(r"^    (\w+): (.*(?:\n      .*)*)", arguments, re.MULTILINE)
    return {name: _in_json(text) for name, text in found}


def _in_json(text: str) -> str:
    """Return a docstring's text without line breaks, and with null for what JSON does not have."""
    return re.sub(r"\b(None|nan)\b", "null", " ".join(text.split()))


DEFINED: dict[str, Json] = {
    "Numbers": {"type": "array", "items": NUMBER},
    "Ends": {"type": "array", "items": NUMBER, "minItems": 2, "maxItems": 2, "description": "lower and upper end"},
}
ESTIMATE = of_type(Estimate)
DEFINED["EstimateWithUnit"] = keys(fields_of(Estimate) | {"unit": TEXT})
UNITED: Json = {"$ref": "#/$defs/EstimateWithUnit"}
LAW: Json = table(table(ESTIMATE)) | {"description": "parameters of each term by its kind"}


# ---- what the wings arrange by hand ----------------------------------------------------------------


def _spring() -> Json:
    head = {"stiffness": UNITED, "damping": UNITED, "law": LAW, "law_name": TEXT, "latex": TEXT}
    return head | fields_of(SpringEstimate, "rest_m", "at_rest")


def _identification() -> Json:
    place = keys(dict.fromkeys(("x_m", "y_m", "sensor_x_m", "sensor_y_m"), NUMBER))
    told = "what limits the precision; null if the answer is refused and the model explains nothing."
    limited_by = {"enum": [*get_args(Limit), None], "description": told}
    structure = {"kind": TEXT, "is_one_gear": FLAG, "recommended": or_null(TEXT), "why": or_null(TEXT)}
    structure |= {"limited_by": limited_by, **fields_of(Identification, "residual_over_noise", "noise_m_per_s2")}
    structure |= {"places": table(place), **fields_of(Identification, "place_corrections")}
    interface = fields_of(InterfaceEstimate, "name", "shared_with", "residual_over_noise", "gas")
    interface |= _spring() | {"x_m": NUMBER, "y_m": NUMBER, "ground_stiffness": UNITED, "per_mass": FLAG}
    run = fields_of(RunResidual, "name", "mass_change_kg", "loading", "unexplained")
    run |= {"unexplained_left_out": NUMBER, "inside_left_out": NUMBER}
    told = "of each sensor on the body, as the other runs predict it; empty where that was not asked"
    run |= {"spectra_left_out": array(of_type(LeftOutSpectrum)) | {"description": told}}
    law = {"name": or_null(TEXT), "latex": or_null(TEXT), "per_mass": FLAG, "parameters": LAW}
    force = fields_of(VisitedForce) | {"units": table(TEXT)}
    absolute = "absolute values; of a body also inertias and centre of gravity"
    rests = "what the answer rests on, and its settings; of no fixed form"
    return {
        "method": {"enum": ["model", "classical", "paper"]},
        "title": TEXT,
        "date": or_null(TEXT) | {"format": "date", "description": "of the runs"},
        "parameters": table(ESTIMATE) | {"description": absolute},
        "ratios": table(ESTIMATE) | {"description": "what needs no known mass"},
        "law": keys(law) | {"description": "of one gear, or of a body whose suspensions are alike"},
        "restoring_force": keys(force) | {"description": "the force without a law, where the motion of one gear went"},
        "structure": keys(structure),
        "interfaces": array(keys(interface)),
        **fields_of(Identification, "candidates", "equivalents"),
        "fits": array(keys(fields_of(StoredFit))) | {"description": "what `opid sense` reads; none without intervals"},
        "runs": array(keys(run)),
        "natural_frequency_of": TEXT | {"description": "what frequency and damping ratio of one gear belong to"},
        "diagnostics": {"type": "object", "description": rests},
        **fields_of(Identification, "weighed", "warnings", "not_determined"),
    }


def _structure() -> Json:
    spring = table({"$ref": f"#/$defs/{define(SpringEstimate, _spring())}"})
    told = ("noise_m_per_s2", "residual_over_noise", "residual_of", "left_out_over_noise", "repeatability", "limits")
    own = fields_of(StructureIdentification, "per_mass", "masses", *told, "warnings", "not_determined")
    return own | {"interfaces": spring, "joints": spring, "settings": {"type": "object"}}


def _bench() -> Json:
    rung = {"law": TEXT, "r2": NUMBER, "r2_left_out": NUMBER, "bic": NUMBER, "kept": FLAG, "chosen": FLAG}
    simulation = fields_of(Simulation, "error_rms_m", "r2", "steps_per_sample", "tried")
    numbers = ("title", "r2", "r2_left_out", "n_independent", "loop", "cycle", "gas", "calibration")
    own = (*numbers, "warnings", "not_determined")
    return fields_of(BenchLaw, *own) | {
        "parameters": table(or_null(ESTIMATE)),
        "law": keys({"name": TEXT, "latex": TEXT, "parameters": LAW}),
        "residual_rms_n": NUMBER,
        "ladder": array(keys(rung)) | {"description": "the laws that were tried"},
        "memory": keys(fields_of(Memory) | {"seen": FLAG}),
        "simulation": or_null(keys(simulation)),
        "settings": {"type": "object"},
    }


def _sensing() -> Json:
    sensor = fields_of(VirtualSensor, "name", "quantity", "place", "unit") | {"rms": ESTIMATE, "largest": ESTIMATE}
    own = ("title", "run", "fs", "start_s", "per_mass", "static", "rainflow", "over_noise", "widened")
    return fields_of(Sensing, *own, "unmeasured_m_per_s2", "warnings", "seed") | {
        "n_samples": COUNT,
        "sensors": array(keys(sensor)) | {"description": "their time histories are in the log"},
        "settings": {"type": "object"},
    }


def _wheel() -> Json:
    estimate = keys(fields_of(Estimate) | {"unit": TEXT})
    own = ("title", "per_mass", "roads", "stiffer_by_load", "bounds", "unusual", "n_lines")
    return fields_of(WheelIdentification, *own, "stiffer_by_force", "not_determined", "warnings", "seed") | {
        "parameters": table(estimate),
        "settings": {"type": "object"},
    }


def _comparison() -> Json:
    flight = keys({"name": TEXT, "path": TEXT, "date": or_null(TEXT) | {"format": "date"}, "method": TEXT})
    what = {"gear": TEXT, "quantity": TEXT, "kind": TEXT}
    point = fields_of(Point)
    point |= fields_of(Estimate) | {"expected_std": point.pop("std")}
    del point["estimate"]
    series = what | {"unit": TEXT, **fields_of(Series, "scatter", "threshold"), "points": array(keys(point))}
    change = what | fields_of(Change, "first", "last") | {"share": fields_of(Change, "fraction")["fraction"]}
    change |= fields_of(Change, "departure", "confirmed", "statement")
    return fields_of(Comparison, "false_alarm", "n_tests", "dated", "warnings") | {
        "flagged": FLAG,
        "structure": TEXT,
        "flights": array(flight) | {"description": "counted from 0 in `flight`, `first` and `last`"},
        "series": array(keys(series)),
        "changes": array(keys(change)),
        "settings": {"type": "object"},
    }


def _campaign() -> Json:
    flight = fields_of(Outcome, "name", "tail", "verdict", "reason", "folder", "covariates")
    flight["date"] = or_null(TEXT) | {"format": "date", "description": "of the flight"}
    counts = keys({verdict.value: COUNT for verdict in Verdict}) | {"description": "flights of each verdict"}
    return fields_of(Campaign, "title") | {
        "source": TEXT | {"description": "the campaign file, or the folder of studies"},
        "counts": counts,
        "flights": array(keys(flight)),
    }


def _fleet() -> Json:
    what = {"gear": TEXT, "quantity": TEXT, "kind": TEXT, "unit": TEXT}
    at = {"date": TEXT | {"format": "date"}}
    expected = NUMBER | {"description": "what the flights before it say; null where it is not judged"}
    latest = fields_of(StrutFlight, "flight", "departure") | at | fields_of(Estimate) | {"expected": expected}
    strut = fields_of(Strut, "tail", "trend_per_year") | {"n_flights": COUNT, "latest": keys(latest)}
    of_all = fields_of(FleetSeries, "scatter", "level", "trend_per_year", "covariates", "threshold", "n_tests")
    own = fields_of(StrutChange, "tail", "flight", "fraction", "departure", "n_needed", "n_flights")
    steps = array(keys(at | {"fraction": ESTIMATE})) | {"description": "days on which all struts changed at once"}
    drifts = array(keys(fields_of(StrutDrift, *_names(StrutDrift, "quantity")) | {"statement": TEXT}))
    return fields_of(Fleet, "source", "n_flights", "years", "alarms_per_year", "warnings") | {
        "flagged": FLAG,
        "series": array(keys(what | of_all | {"struts": array(keys(strut)), "common_steps": steps, "drifts": drifts})),
        "changes": array(keys(what | own | at | {"statement": TEXT})),
        "settings": {"type": "object"},
    }


def _plan() -> Json:
    pair = or_null({"$ref": "#/$defs/Ends"})
    told = fields_of(PlanResult, "ranges")["ranges"]["description"]
    return fields_of(PlanResult, *_names(PlanResult, "read_files", "ranges", "grid")) | {
        "ranges": array(pair) | {"description": told},
        "grid": keys(fields_of(StdGrid, *_names(StdGrid, "std")) | {"std": array(array(NUMBERS))}),
    }


def _health() -> Json:
    define(ChannelHealth, fields_of(ChannelHealth, *_names(ChannelHealth, "overview")))
    log = keys(fields_of(Health, *_names(Health, "rms_history", "files")))
    return {"logs": array(log), "settings": {"type": "object"}}


def _powers() -> Json:
    """Coefficients of a mode; keys are the powers."""
    stiffness, damping = ({"description": f"{each}_n by its power n"} for each in "kc")
    return {"k": table(ESTIMATE) | stiffness, "c": table(ESTIMATE) | damping, "units": table(TEXT)}


def _free_decay() -> Json:
    curve = ("amplitude", "amplitude_unit", "frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std")
    rest = ("gain_std", "start_s", "stop_s", "beginning", "law_misfit", "warnings", "frequency_low_hz", "damping_low")
    repeats = {"repeats": {"type": "array", "description": "the single decays, where several were pooled"}}
    return fields_of(Decay, "name", "mode", *curve, *rest) | _residual_of(Decay) | _powers() | _joint() | repeats


def _joint() -> Json:
    scatter = fields_of(DecayLaw, "frequency_scatter_hz", "damping_scatter")
    return {"joint": or_null(keys(_joint_estimates() | scatter))}


def _joint_estimates(prefix: str = "") -> Json:
    slip, exponent = (
        {name: ESTIMATE | {"description": getattr(JointEstimates, name).__doc__.rstrip(".")}}
        for name in ("slip", "slip_exponent")
    )
    kind = or_null(TEXT) | {"description": "the name of the kind of joint in the place of slip"}
    values = table(ESTIMATE) | {"description": "its values by name, empty without one"}
    return fields_of(JointEstimates, "friction") | slip | exponent | {f"{prefix}kind": kind, f"{prefix}values": values}


def _linear_modes() -> Json:
    names = ("band_hz", "sensors", "units", "unexplained", "warnings", "frequency_hz", "damping_ratio", "modal_mass_kg")
    names += ("sensor_delay_s", "misfits", "has_scale", "drive_candidates")
    matrices = fields_of(FittedModes, "shapes", "shape_std")
    return fields_of(FittedModes, *names, "delay_s") | {
        **{name: array(array(NUMBER)) | {"description": each["description"]} for name, each in matrices.items()},
        "drive_points": array(TEXT),
        "settings": {"type": "object"},
    }


def _mode_stages() -> Json:
    own = fields_of(ModeStages, "stages") | {"warnings": TEXTS, "settings": {"type": "object"}}
    modes = array(keys(_linear_modes() | {"schema": {"const": MODES}}))
    return own | {"modes": modes, "shifts": array(array(keys(fields_of(StageShift))))}


def _residual_of(record: type) -> Json:
    return {"residual_share": fields_of(record, "residual_fraction")["residual_fraction"]}


def _modal() -> Json:
    def force(along: str) -> Json:
        return keys(dict.fromkeys((along, "force", "low", "high", "linear"), NUMBERS))

    always = ("mode", "frequency_hz", "damping_ratio", "stiffness_order", "damping_order", "free_linear", "tests")
    forced = ("band_hz", "n_lines", "condition_raw", "condition_scaled", "modal_mass", "delay_s")
    mode = fields_of(ModeFit, *always, "orders", "interactions", "warnings") | _powers() | _joint_estimates("joint_")
    mode |= {"known_by": {"enum": ["forced tests", "free decays"]}}
    of_forced = fields_of(ModeFit, *forced, "frequency_at_hz", "damping_at", "misfit") | _residual_of(ModeFit)
    of_forced["force_curves"] = keys({"stiffness": force("displacement"), "damping": force("velocity")})
    mode |= {name: or_null(schema) for name, schema in of_forced.items()}
    low = ("frequency_low_hz", "damping_low", "amplitude", "frequency_hz", "damping_ratio", "misfit", "warnings")
    compared = {"sensors": table(keys(fields_of(TruthComparison)))}
    own = ("title", "drive_point", "condition_number", "warnings", "not_determined", "settings")
    return fields_of(ModalIdentification, *own) | {
        "auto_mac": array(NUMBERS),
        "modes": array(keys(mode)),
        "linear_modes": keys(fields_of(LinearModes, "frequency_hz", "damping_ratio")),
        "truth_tests": array(keys(fields_of(TruthTest, "name", "band_hz") | compared)),
        "systems": array(_system()),
        "level_shifts": array(keys(fields_of(LevelShift))),
        "decays": array(keys(_free_decay())),
        "decay_laws": table(keys(fields_of(DecayLaw, *low) | _powers() | _joint()))
        | {"description": "by the number of the mode"},
    }


def _system() -> Json:
    coupling = keys(
        {"modes": array({"type": "integer"}), "of_velocity": {"type": "boolean"}, "unit": TEXT}
        | {"coefficient": ESTIMATE}
    )
    law = fields_of(DrivenLaw, "largest") | _powers() | _joint_estimates("joint_")
    by_mode = {"driven": table(keys(law)), "ratios": table(ESTIMATE), "missed": table(NUMBER)}
    own = fields_of(SystemFit, "modes", "trials", "warnings")
    return keys(own | {"couplings": array(coupling)} | by_mode)


def _resonance() -> Json:
    curves = ("amplitude", "frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std")
    law = or_null(keys(fields_of(ResonanceLaw, *curves, "force_phase_deg", "misfit", "n_states") | _powers()))
    numbers = ("start_s", "stop_s", "voltage_v", "driven_hz", "phase_error_deg", "amplitude", "resonance_hz")
    level = {"test": TEXT} | dict.fromkeys((*numbers, "damping_ratio"), NUMBER)
    level["force_n"] = NUMBERS | {"description": "amplitudes of the harmonics 1 to 5, N"}
    level["sensors"] = array(NUMBERS) | {"description": "those of each sensor, m/s^2 (of a strain gauge strain/s^2)"}
    level["modal"] = array(NUMBERS) | {"description": "those of each modal acceleration, m/s^2 kg^1/2"}
    curve = fields_of(ResponseCurve, "name", "sensor", "frequency_hz", "force_n", "amplitude", "phase_deg")
    curve |= dict.fromkeys(("amplitude_by_law", "phase_by_law_deg"), NUMBERS) | fields_of(CurveFit, "is_prediction")
    curve |= dict.fromkeys(("error", "peak_ratio"), NUMBER) | fields_of(CurveFit, "resonance")
    held_out = fields_of(
        HeldOut, "fitted", "reason", "low", "high", "range_hz", "lowest_hz", "measured_amplitude", "reach", "widened"
    )
    held_out |= fields_of(HeldOut, "resonance_hz", "measured_hz", "amplitude") | {"curve": keys(curve)}
    held_out |= {"shift_hz": NUMBER, "error_fraction": NUMBER}
    own = ("title", "mode", "drive_point", "left_out", "warnings", "not_determined", "settings", "modal_mass")
    return fields_of(Resonance, *own) | {
        "held_out": or_null(keys(held_out)),
        "levels": array(keys(level)),
        "sensors": TEXTS,
        **dict.fromkeys(("records_law", "backbone_law", "curves_law", "joint_law"), law),
        "curves": array(keys(curve)),
        "curve_check": or_null(keys(fields_of(StateCheck))),
        "interaction": or_null(keys(fields_of(Interaction, *OF_INTERACTION))),
        "linear_modes": keys(fields_of(LinearModes, "frequency_hz", "damping_ratio")),
    }


def _resonances() -> Json:
    own = fields_of(Resonances, "title", "faults", "settings") | {"not_determined": TEXT, "warnings": TEXTS}
    return own | {"modes": array(keys(_resonance() | {"schema": {"const": RESONANCE}}))}


def _updating() -> Json:
    posterior = fields_of(Estimate)
    posterior = {"mean": posterior.pop("value"), **posterior}
    rank = {"parameters": table(keys(posterior)), "covariance": array(NUMBERS)}
    own = ("best", "calibration_std", "log_likelihood_at_best", "diagnostics", "prior_sensitivity", "evidences")
    model_class = fields_of(ModelClass) | fields_of(ClassPosterior, *own, "warnings") | rank
    model_class |= {"law": TEXT, "coefficients": table(keys(posterior | {"unit": TEXT}))}
    model_class |= {"log_evidence": NUMBER, "log_evidence_std": NUMBER}
    linear = fields_of(LinearPosterior, "diagnostics", "warnings", "name", "evidence")
    linear |= rank | {"best": table(NUMBER)}
    of_mode = [each.name for each in fields(LinearMode) if each.name != "initial_shape"]
    linear["modes"] = array(keys(fields_of(LinearMode, *of_mode)))
    measured = fields_of(MeasuredBackbone, "name", "mode", "controlled_sensor", "frequency_hz", "force_n", "harmonics")
    measured["drive"] = or_null(TEXT)
    measured["amplitude"] = table(NUMBERS) | {"description": "m, by sensor"}
    top = (
        "title",
        "form",
        "best_class",
        "prediction",
        "damping",
        "responses",
        "harmonics",
        "warnings",
        "not_determined",
        "settings",
    )
    return fields_of(Updating, *top) | {
        "classes": array(keys(model_class)),
        "linear": or_null(keys(linear)),
        "linear_classes": array(keys(linear)),
        "system": keys({"frequency_hz": NUMBERS, "sensors": TEXTS, "joints": TEXTS}),
        "reduction": of_type(ReductionErrors | None),
        "reduction_free": of_type(ReductionErrors | None),
        "confusion": of_type(Confusion | None),
        "measured": array(keys(measured)),
        "shapes": array(of_type(ModeShape)),
    }


# ---- files -----------------------------------------------------------------------------------------

OF_MODEL_ALONE = ("structure", "interfaces", "candidates", "runs", "equivalents", "fits", "natural_frequency_of")
FILES = (
    (IDENTIFICATION, "a suspension, or a body on several, from runs (opid identify)", _identification, OF_MODEL_ALONE),
    (STRUCTURE, "a structure of your own (opid.suspensions.identify_structure)", _structure, ()),
    (BENCH, "the law of a damper or spring on a test bench (opid law)", _bench, ()),
    (SENSING, "forces and motion along a log (opid sense)", _sensing, ()),
    (WHEEL, "unsprung mass, tyre and road of a gear (opid wheel)", _wheel, ()),
    (COMPARISON, "what changed from flight to flight (opid compare)", _comparison, ()),
    (CAMPAIGN, "what became of each of many flights (opid campaign)", _campaign, ()),
    (FLEET, "which struts of a fleet changed (opid compare CAMPAIGN)", _fleet, ()),
    (PLAN, "what planned runs will determine, and the cheapest plan (opid plan)", _plan, ()),
    (HEALTH, "what is wrong with logs (opid inspect)", _health, ()),
    (MODES, "linear modes of measured responses (opid modes)", _linear_modes, ()),
    (STAGES, "linear modes at several stages of a campaign (opid modes --stage)", _mode_stages, ()),
    (DECAY, "one free decay (opid decay)", lambda: _free_decay() | {"settings": {"type": "object"}}, ()),
    (MODAL, "a nonlinear modal model (opid modal)", _modal, ()),
    (RESONANCE, "one mode in measured tests at phase resonance (opid resonance)", _resonance, ()),
    (OF_SEVERAL, "several modes in measured tests at phase resonance (opid resonance)", _resonances, ()),
    (UPDATING, "the joints of a finite-element model from backbones (opid update)", _updating, ()),
)


def schemas() -> dict[str, str]:
    """Return the text of each schema by the name of its file; each is whole without the others."""
    digest = TEXT | {"pattern": "^[0-9a-f]{64}$"}
    file = fields_of(ReadFile, "name") | {"sha256": digest}
    written = TEXT | {"format": "date-time", "description": "ISO 8601, UTC"}
    version = TEXT | {"description": "its version"}
    provenance = keys({"opid": version, "written": written, "files": array(keys(file))})
    made = {}
    for identifier, what, properties_of, optional in FILES:
        name = f"{identifier.removeprefix('opid.').replace('/', '-')}.schema.json"
        head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": name, "title": what}
        own = {"schema": {"const": identifier}, "provenance": provenance} | properties_of()
        schema = head | {"description": NO_NUMBER} | keys(own, optional=optional)
        made[name] = _packed(schema | {"$defs": {each: DEFINED[each] for each in sorted(_used(schema))}}) + "\n"
    return made


def _used(schema: Any) -> set[str]:
    """Names of the definitions that a schema refers to, and that those refer to."""
    found, open_ones = set(), {json.dumps(schema)}
    while open_ones:
        names = set(re.findall(r'"#/\$defs/(\w+)"', open_ones.pop())) - found
        found |= names
        open_ones |= {json.dumps(DEFINED[each]) for each in names}
    return found


def _packed(value: Any, indent: int = 0, before: int = 0) -> str:
    """JSON in which whatever fits on a line stands on one."""
    line = json.dumps(value, ensure_ascii=False)
    if indent + before + len(line) < WIDTH or not isinstance(value, (dict, list)):
        return line
    if isinstance(value, list) and all(isinstance(each, str) and each.isidentifier() for each in value):
        pad = " " * (indent + 2)
        names = textwrap.fill(line[1:-1], WIDTH, initial_indent=pad, subsequent_indent=pad)
        return f"[\n{names}\n{' ' * indent}]"
    first, last = "{}" if isinstance(value, dict) else "[]"
    inner = ",\n".join(" " * (indent + 2) + each for each in _items(value, indent + 2))
    return f"{first}\n{inner}\n{' ' * indent}{last}"


def _items(value: Json | list[Any], indent: int) -> Iterator[str]:
    if isinstance(value, list):
        yield from (_packed(each, indent) for each in value)
        return
    for key, each in value.items():
        name = f"{json.dumps(key)}: "
        yield name + _packed(each, indent, len(name))


def main() -> None:
    """Write the schemas."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in schemas().items():
        (FOLDER / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
