"""Results as values of JSON: plain dicts and lists, SI, and null where there is no finite number."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from opid.estimate import Estimate
from opid.suspensions.one_gear.result import SCHEMA, Identification, VisitedForce


def result_json(result: Identification) -> dict[str, Any]:
    """Return an identification as the content of result.json.

    Args:
        result: the identification.

    Returns:
        `schema`, `method`, `title`, `date` (ISO 8601, or null), `parameters` {name: {value, std, interval95}},
        `ratios` likewise, `law` {name,
        latex, per_mass, parameters {kind: {parameter: {value, std, interval95}}}}, `restoring_force` {travel,
        velocity, force, nonlinear_force, per_mass, units}, `diagnostics`, `warnings`, `not_determined`.
    """
    return plain(
        {
            "schema": SCHEMA,
            "method": result.method,
            "title": result.title,
            "date": None if result.date is None else result.date.isoformat(),
            "parameters": _estimates(result.parameters),
            "ratios": _estimates(result.ratios),
            "law": {
                "name": result.law.name,
                "latex": result.law.latex,
                "per_mass": result.restoring_force.per_mass,
                "parameters": {kind: _estimates(values) for kind, values in result.law_estimates.items()},
            },
            "restoring_force": _force(result.restoring_force),
            "diagnostics": result.diagnostics,
            "warnings": result.warnings,
            "not_determined": result.not_determined,
        }
    )


def plain(value: Any) -> Any:
    """Return a value with nothing in it that JSON does not know: numpy becomes Python, NaN and infinity null.

    Args:
        value: dicts, lists, tuples, arrays, numbers, text and None, in each other.

    >>> plain({"a": np.array([1.0, np.nan]), "b": (np.int64(2), True)})
    {'a': [1.0, None], 'b': [2, True]}
    """
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(document: Mapping[str, Any]) -> str:
    """Return a document as the text of a JSON file.

    Args:
        document: of plain values (see `plain`).

    Raises:
        ValueError: a number that is not finite.

    >>> json_text({"a": [1, None]})
    '{\\n  "a": [1, null]\\n}\\n'
    """
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
    # a list of numbers on one line: thousands of lines with one number each help nobody
    return re.sub(r"\[[^\[\]{}\"]*\]", _joined, text) + "\n"


def _joined(found: re.Match[str]) -> str:
    return re.sub(r"\n\s*", "", re.sub(r",\n\s*", ", ", found[0]))


def _estimates(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: asdict(estimate) for name, estimate in estimates.items()}


def _force(force: VisitedForce) -> dict[str, Any]:
    unit = "m/s^2" if force.per_mass else "N"
    return {
        "travel": force.travel,
        "velocity": force.velocity,
        "force": force.force,
        "nonlinear_force": force.nonlinear_force,
        "per_mass": force.per_mass,
        "units": {"travel": "m", "velocity": "m/s", "force": unit, "nonlinear_force": unit},
    }
