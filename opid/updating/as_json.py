"""An updating as the content of result.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from opid.estimate import Estimate
from opid.json_values import plain
from opid.updating.data.measured import MeasuredBackbone
from opid.updating.result import SCHEMA, ClassPosterior, LinearPosterior, Updating


def updating_json(result: Updating) -> dict[str, Any]:
    """Return an updating as the content of result.json.

    Args:
        result: from `update_study`.

    Returns:
        What `docs/schemas/updating-1.schema.json` describes.
    """
    reduction, free = (*result.reductions, None, None)[:2]
    return plain(
        {
            "schema": SCHEMA,
            "title": result.title,
            "form": result.form,
            "best_class": result.best_class,
            "classes": [_class(each) for each in result.classes],
            "linear": None if result.linear is None else _linear(result.linear),
            "system": {
                "frequency_hz": result.system.frequency_hz,
                "sensors": result.system.sensors,
                "joints": result.system.joints,
            },
            "reduction": None if reduction is None else asdict(reduction),
            "reduction_free": None if free is None else asdict(free),
            "measured": [_measured(curve) for curve in result.measured],
            "prediction": [asdict(band) for band in result.prediction],
            "warnings": result.warnings,
            "not_determined": result.not_determined,
            "settings": result.settings,
        }
    )


def _class(posterior: ClassPosterior) -> dict[str, Any]:
    own = posterior.model_class
    first = posterior.evidences[0]
    return {
        "name": own.name,
        "law": own.law_in_words,
        "kinds": own.kinds,
        "scales": own.scales,
        "priors": [asdict(prior) for prior in own.priors],
        "log_evidence": first.log_evidence,
        "log_evidence_std": first.std,
        "evidences": [asdict(evidence) for evidence in posterior.evidences],
        "parameters": _estimates(posterior.estimates),
        "coefficients": {
            kind: {**_estimate(estimate), "unit": unit} for kind, (estimate, unit) in posterior.coefficients.items()
        },
        "best": posterior.best,
        "covariance": posterior.covariance,
        "log_likelihood_at_best": posterior.log_likelihood_at_best,
        "diagnostics": asdict(posterior.diagnostics),
        "prior_sensitivity": posterior.prior_sensitivity,
        "warnings": posterior.warnings,
    }


def _linear(linear: LinearPosterior) -> dict[str, Any]:
    return {
        "parameters": _estimates(linear.estimates),
        "best": dict(zip(linear.names, linear.best, strict=True)),
        "covariance": linear.covariance,
        "modes": [asdict(mode) for mode in linear.modes],
        "diagnostics": asdict(linear.diagnostics),
        "warnings": linear.warnings,
    }


def _measured(curve: MeasuredBackbone) -> dict[str, Any]:
    return {
        "name": curve.name,
        "mode": curve.mode,
        "controlled_sensor": curve.controlled_sensor,
        "frequency_hz": curve.frequency_hz,
        "amplitude": dict(zip(curve.sensors, curve.amplitude.T, strict=True)),
    }


def _estimates(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    return {name: _estimate(estimate) for name, estimate in estimates.items()}


def _estimate(estimate: Estimate) -> dict[str, Any]:
    """A posterior has a mean, where other answers have a value."""
    return {"mean": estimate.value, "std": estimate.std, "interval95": estimate.interval95}
