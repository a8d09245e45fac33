"""A nonlinear modal model as JSON and as a page with its figures."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from opid.estimate import Estimate
from opid.json_values import json_text, plain
from opid.modal.decay.fit import DecayLaw
from opid.modal.result import SCHEMA, ForceCurve, ModalIdentification, ModeFit, TruthTest
from opid.modal.study import THRESHOLDS, ModalStudy
from opid.report.modal.decay_report import coefficients, decay_fields
from opid.report.modal.pictures import modal_pictures
from opid.report.modal.tables import (
    Truth,
    basis,
    by_decays_alone,
    coefficient_rows,
    doubts_of,
    tables,
    truth_table,
    truth_test_head,
    with_coefficients,
)
from opid.report.modal.units import coefficient_columns
from opid.report.page import drawn, rendered
from opid.signals.directory import write_together

FORCED_ONLY = (
    *("band_hz", "n_lines", "residual_share", "condition_raw", "condition_scaled", "modal_mass", "force_curves"),
    *("frequency_at_hz", "damping_at"),
)
"""Keys of a mode in result.json that are null where only free decays show it."""


def modal_json(result: ModalIdentification) -> dict[str, Any]:
    """Return a nonlinear modal model as the content of result.json.

    Args:
        result: from `identify_modes`.

    Returns:
        `schema`, `title`, `drive_point`, `condition_number`, `auto_mac`, `modes` (one a nonlinear mode, with `k` and
        `c` {power: {value, std, interval95}}, `band_hz`, `force_curves` and the fields of `ModeFit`), `linear_modes`
        {frequency_hz, damping_ratio}, `truth_tests` [{name, band_hz, sensors {name: the fields of `Comparison`}}],
        `level_shifts`, `decays`, `decay_laws` {mode: {`k`, `c`, `frequency_low_hz`, `damping_low`, ...}}, `warnings`
        (those of single modes and decays among them), `not_determined`, `settings`. A mode that only free decays show
        stands in `modes` with the same keys, after the others: `known_by` is "free decays" instead of "forced tests",
        `k` and `c` are those of `decay_laws` (power 1 as for all `modes` the correction of k0 and c0; in `decay_laws`
        and `decays` it is k0 and c0 itself), `tests` are its decays, and what only forced tests give (`band_hz`,
        `force_curves`, `modal_mass`, ...) is null.
    """
    return plain(
        {
            "schema": SCHEMA,
            "title": result.title,
            "drive_point": result.drive_point,
            "condition_number": result.condition_number,
            "auto_mac": result.auto_mac,
            "modes": [
                *(_mode(fit) for fit in result.fits),
                *(_mode_of_decays(result, mode) for mode in by_decays_alone(result)),
            ],
            "linear_modes": {
                "frequency_hz": result.modes.frequency_hz,
                "damping_ratio": result.modes.damping_ratio,
            },
            "truth_tests": [_truth_test(test) for test in result.truth_tests],
            "level_shifts": [asdict(shift) for shift in result.shifts],
            "decays": [decay_fields(decay) for decay in result.decays],
            "decay_laws": {str(mode): _decay_law(law) for mode, law in sorted(result.decay_laws.items())},
            "warnings": doubts_of(result),
            "not_determined": result.not_determined,
            "settings": result.settings,
        }
    )


def write_modal_report(
    result: ModalIdentification,
    directory: str | os.PathLike[str],
    truth: Truth | None = None,
    *,
    options: Mapping[str, Any] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Args:
        result: from `identify_modes`.
        directory: made if it is not there; all files appear together, any other file in it stays.
        truth: of a simulated test, as in truth.json: shown beside each coefficient.
        options: settings that the command was given, by their names in `ModalStudy`, for the line that says how to do
            it again; where None, the settings of the result that are not the defaults.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    pictures = modal_pictures(result, truth)
    images = drawn(pictures, result, truth, progress=progress)
    known = with_coefficients(truth)
    page = rendered(
        "modal.html.jinja",
        images,
        title=result.title or "Nonlinear modal model",
        result=result,
        truth=known,
        basis=basis(result),
        tables=tables(result),
        columns=coefficient_columns(known),
        rows=coefficient_rows(result, known),
        truth_tests=[
            (truth_test_head(test), truth_table(test, first=result.drive_point)) for test in result.truth_tests
        ],
        warnings=doubts_of(result),
        pictures=pictures,
        command=_command(result, _beside_defaults(result) if options is None else options),
    )
    contents = {f"{name}.png": image for name, image in images.items()}
    contents["report.html"] = page.encode()
    # last, so that a result.json is never there without its report
    contents["result.json"] = json_text(modal_json(result)).encode()
    write_together(directory, contents)
    return Path(directory) / "report.html"


def _mode(fit: ModeFit) -> dict[str, Any]:
    """One nonlinear mode; `k` and `c` by power, as the paper calls them."""
    return {
        "mode": fit.mode,
        "known_by": "forced tests",
        "frequency_hz": fit.frequency_hz,
        "damping_ratio": fit.damping_ratio,
        "stiffness_order": fit.stiffness_order,
        "damping_order": fit.damping_order,
        "free_linear": fit.free_linear,
        **coefficients(fit.stiffness, fit.damping),
        "band_hz": fit.band_hz,
        "n_lines": fit.n_lines,
        "residual_share": fit.residual_share,
        "condition_raw": fit.condition_raw,
        "condition_scaled": fit.condition_scaled,
        "modal_mass": asdict(fit.modal_mass),
        "tests": fit.tests,
        "force_curves": {
            "stiffness": _curve(fit.stiffness_curve, "displacement"),
            "damping": _curve(fit.damping_curve, "velocity"),
        },
        "frequency_at_hz": fit.frequency_at_hz,
        "damping_at": fit.damping_at,
        "orders": [asdict(rung) for rung in fit.orders],
        "warnings": fit.warnings,
    }


def _mode_of_decays(result: ModalIdentification, mode: int) -> dict[str, Any]:
    """A mode that only free decays show, with the keys of the others; null is what forced tests alone give."""
    law, place = result.decay_laws[mode], result.modes.place(mode)
    stiffness = dict(law.stiffness) | {1: _less(law.stiffness[1], float(result.modes.stiffness()[place]))}
    damping = dict(law.damping) | {1: _less(law.damping[1], float(result.modes.damping()[place]))}
    return {
        "mode": mode,
        "known_by": "free decays",
        "frequency_hz": result.modes.frequency_hz[place],
        "damping_ratio": result.modes.damping_ratio[place],
        "stiffness_order": max(law.stiffness),
        "damping_order": max(law.damping),
        "free_linear": True,
        **coefficients(stiffness, damping),
        **dict.fromkeys(FORCED_ONLY),
        "tests": [decay.name for decay in result.decays if decay.mode == mode],
        "orders": [],
        "warnings": law.warnings,
    }


def _less(estimate: Estimate, given: float) -> Estimate:
    """An estimate of k0 or c0 as the correction of the one that is given."""
    return Estimate() if estimate.value is None else Estimate.normal(estimate.value - given, estimate.std)


def _decay_law(law: DecayLaw) -> dict[str, Any]:
    """The law that the free decays of a mode give together."""
    return {
        **coefficients(law.stiffness, law.damping),
        "frequency_low_hz": asdict(law.frequency_low_hz),
        "damping_low": asdict(law.damping_low),
        "amplitude": law.amplitude,
        "frequency_hz": law.frequency_hz,
        "damping_ratio": law.damping_ratio,
        "misfit": law.misfit,
        "warnings": law.warnings,
    }


def _curve(curve: ForceCurve, along: str) -> dict[str, Any]:
    values = {"force": curve.force, "low": curve.low, "high": curve.high, "linear": curve.linear}
    return {along: curve.position, **values}


def _truth_test(test: TruthTest) -> dict[str, Any]:
    figures = {name: asdict(each) for name, each in test.sensors.items()}
    return {"name": test.name, "band_hz": test.band_hz, "sensors": figures}


def _command(result: ModalIdentification, options: Mapping[str, Any]) -> str:
    """The command that gives this result."""
    words = [f"--{name.replace('_', '-')} {value:g}" for name, value in options.items() if name != "free_linear"]
    if options.get("free_linear") is not None:
        words.append("--free-linear" if options["free_linear"] else "--fixed-linear")
    return " ".join(["opid modal", shlex.quote(str(result.settings.get("study") or "STUDY.toml")), *words])


def _beside_defaults(result: ModalIdentification) -> dict[str, Any]:
    """The settings of a result that are not the defaults, whether its study file or the command has them."""
    names = ("stiffness_order", "damping_order", "free_linear", *THRESHOLDS)
    given = {name: result.settings[name] for name in names if result.settings.get(name) is not None}
    return {name: value for name, value in given.items() if value != getattr(ModalStudy, name)}
