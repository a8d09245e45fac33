"""An updating as JSON and as a page with its figures."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from opid.estimate import Estimate
from opid.json_values import json_text, plain
from opid.report.as_text import columns
from opid.report.page import drawn, rendered
from opid.report.updating.pictures import updating_pictures
from opid.report.updating.tables import (
    Truth,
    basis,
    best_sentence,
    class_table,
    coefficient_estimates,
    coefficient_rows,
    doubts_of,
    law_of,
    linear_rows,
    mode_table,
    tables,
)
from opid.signals.directory import write_together
from opid.updating.data.measured import MeasuredBackbone
from opid.updating.result import SCHEMA, ClassPosterior, LinearPosterior, Updating
from opid.updating.structure.reduction import ReductionErrors


def updating_json(
    result: Updating, *, reduction: ReductionErrors | None = None, free: ReductionErrors | None = None
) -> dict[str, Any]:
    """Return an updating as the content of result.json.

    Args:
        result: from `update_study`.
        reduction: how the reduced structure differs from the whole one.
        free: the same of the reduction with free modes.

    Returns:
        `schema`, `title`, `form`, `best_class`, `classes` (each with `name`, `law`, `kinds`, `scales`, `priors`,
        `log_evidence`, `log_evidence_std`, `evidences` [{method, log_evidence, std}], `parameters` {theta_1: {mean,
        std, interval95}}, `coefficients` {kind: {mean, std, interval95, unit}} in SI units, `best`, `covariance`,
        `log_likelihood_at_best`, `diagnostics`, `prior_sensitivity`, `warnings`), `linear` (null without phase I;
        `parameters`, `best`, `covariance`, `modes`, `diagnostics`, `warnings`), `system` {frequency_hz, sensors,
        joints}, `reduction` and `reduction_free` (null, or the fields of `ReductionErrors`), `measured` [{name, mode,
        controlled_sensor, frequency_hz, amplitude {sensor: values}}], `prediction` [the fields of `BackboneBand`, null
        where no backbone was found], `warnings`, `not_determined`, `settings`. Amplitudes in m.
    """
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


def write_updating_report(
    result: Updating,
    directory: str | os.PathLike[str],
    truth: Truth | None = None,
    *,
    reduction: ReductionErrors | None = None,
    free: ReductionErrors | None = None,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Args:
        result: from `update_study`.
        directory: made if it is not there; all files appear together, any other file in it stays.
        truth: of a simulated test, as in truth.json: shown beside each estimate.
        reduction: how the reduced structure differs from the whole one; drawn if it is given.
        free: the same of the reduction with free modes, drawn beside it.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    pictures = updating_pictures(result, reduction, free)
    images = drawn(pictures, result, truth, progress=progress)
    page = rendered(
        "updating.html.jinja",
        images,
        title=result.title or "Bayesian updating",
        result=result,
        truth=truth,
        basis=basis(result),
        columns=columns(truth),
        linear_rows=linear_rows(result, truth),
        mode_table=mode_table(result),
        class_table=class_table(result),
        best=best_sentence(result),
        rows=coefficient_rows(result, truth),
        tables=tables(result),
        warnings=doubts_of(result),
        pictures=pictures,
        command=_command(result),
    )
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = page.encode()
    # last, so that a result.json is never there without its report
    contents["result.json"] = json_text(updating_json(result, reduction=reduction, free=free)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


def _class(posterior: ClassPosterior) -> dict[str, Any]:
    own = posterior.model_class
    first = posterior.evidences[0]
    return {
        "name": own.name,
        "law": law_of(posterior),
        "kinds": own.kinds,
        "scales": own.scales,
        "priors": [asdict(prior) for prior in own.priors],
        "log_evidence": first.log_evidence,
        "log_evidence_std": first.std,
        "evidences": [asdict(evidence) for evidence in posterior.evidences],
        "parameters": _estimates(posterior.estimates),
        "coefficients": {
            kind: {**_estimate(estimate), "unit": unit}
            for kind, (estimate, unit) in coefficient_estimates(posterior).items()
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


def _command(result: Updating) -> str:
    """The command that gives this result."""
    settings = result.settings
    study = shlex.quote(str(settings.get("study") or "STUDY.toml"))
    options = "".join(
        f" --{name} {settings[name]}" for name in ("sampler", "samples", "seed") if settings.get(name) is not None
    )
    return f"opid update {study} --form {result.form}{options}"
