"""A nonlinear modal model as JSON and as a page with its figures."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from opid.modal.free_decay import Decay
from opid.modal.result import SCHEMA, ForceCurve, ModalIdentification, ModeFit, TruthTest
from opid.report.as_json import json_text, plain
from opid.report.as_text import columns
from opid.report.directory import write_together
from opid.report.modal_pictures import modal_pictures
from opid.report.modal_tables import (
    Truth,
    basis,
    coefficient_rows,
    decay_table,
    doubts_of,
    mode_table,
    shift_table,
    truth_table,
    truth_test_head,
    unit_of,
)
from opid.report.page import rendered


def modal_json(result: ModalIdentification) -> dict[str, Any]:
    """Return a nonlinear modal model as the content of result.json.

    Args:
        result: from `identify_modes`.

    Returns:
        `schema`, `title`, `drive_point`, `condition_number`, `auto_mac`, `modes` (one a nonlinear mode, with `k` and
        `c` {power: {value, std, interval95}}, `band_hz`, `force_curves` and the fields of `ModeFit`), `linear_modes`
        {frequency_hz, damping_ratio}, `truth_tests` [{name, band_hz, sensors {name: the fields of `Comparison`}}],
        `level_shifts`, `decays`, `warnings`, `not_determined`, `settings`.
    """
    return plain(
        {
            "schema": SCHEMA,
            "title": result.title,
            "drive_point": result.drive_point,
            "condition_number": result.condition_number,
            "auto_mac": result.auto_mac,
            "modes": [_mode(fit) for fit in result.fits],
            "linear_modes": {
                "frequency_hz": result.modes.frequency_hz,
                "damping_ratio": result.modes.damping_ratio,
            },
            "truth_tests": [_truth_test(test) for test in result.truth_tests],
            "level_shifts": [asdict(shift) for shift in result.shifts],
            "decays": [_decay(decay) for decay in result.decays],
            "warnings": result.warnings,
            "not_determined": result.not_determined,
            "settings": result.settings,
        }
    )


def write_modal_report(
    result: ModalIdentification,
    directory: str | os.PathLike[str],
    truth: Truth | None = None,
    *,
    progress: Callable[[str], None] | None = None,
) -> Path:
    """Write result.json, report.html and the figures as PNG, and return the path of the page.

    Args:
        result: from `identify_modes`.
        directory: made if it is not there; all files appear together, any other file in it stays.
        truth: of a simulated test, as in truth.json: shown beside each coefficient.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: a place that cannot be written to.
    """
    from opid.plots.style import figure_of, png

    say = progress or (lambda step: None)
    pictures = modal_pictures(result)
    images: dict[str, bytes] = {}
    for picture in pictures:
        say(f"figure {picture.name}")
        images[picture.name] = png(figure_of(picture.draw(result, truth)))
    page = rendered(
        "modal.html.jinja",
        images,
        title=result.title or "Nonlinear modal model",
        result=result,
        truth=truth,
        basis=basis(result),
        tables=[table for table in (mode_table(result), shift_table(result), decay_table(result)) if len(table) > 1],
        columns=columns(truth),
        rows=coefficient_rows(result, truth),
        truth_tests=[
            (truth_test_head(test), truth_table(test, first=result.drive_point)) for test in result.truth_tests
        ],
        warnings=doubts_of(result),
        pictures=pictures,
        command=_command(result),
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
        "frequency_hz": fit.frequency_hz,
        "damping_ratio": fit.damping_ratio,
        "stiffness_order": fit.stiffness_order,
        "damping_order": fit.damping_order,
        "free_linear": fit.free_linear,
        "k": {str(power): asdict(estimate) for power, estimate in fit.stiffness.items()},
        "c": {str(power): asdict(estimate) for power, estimate in fit.damping.items()},
        "units": {f"k{power}": unit_of("k", power) for power in fit.stiffness}
        | {f"c{power}": unit_of("c", power) for power in fit.damping},
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


def _curve(curve: ForceCurve, along: str) -> dict[str, Any]:
    values = {"force": curve.force, "low": curve.low, "high": curve.high, "linear": curve.linear}
    return {along: curve.position, **values}


def _truth_test(test: TruthTest) -> dict[str, Any]:
    figures = {name: asdict(each) for name, each in test.sensors.items()}
    return {"name": test.name, "band_hz": test.band_hz, "sensors": figures}


def _command(result: ModalIdentification) -> str:
    """The command that gives this result."""
    source = result.settings.get("study")
    orders = "".join(
        f" --{name.replace('_', '-')} {result.settings[name]}"
        for name in ("stiffness_order", "damping_order")
        if isinstance(result.settings.get(name), int)
    )
    return f"opid modal {shlex.quote(str(source or 'STUDY.toml'))}{orders}"


def _decay(decay: Decay) -> dict[str, Any]:
    """A free decay without its record."""
    kept = (
        *("name", "mode", "amplitude", "frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std"),
        *("amplitude_unit", "start_s", "stop_s", "residual_share", "law_misfit", "warnings"),
    )
    return {
        **{name: getattr(decay, name) for name in kept},
        "frequency_low_hz": asdict(decay.frequency_low_hz),
        "damping_low": asdict(decay.damping_low),
        "k": {str(power): asdict(estimate) for power, estimate in decay.stiffness.items()},
        "c": {str(power): asdict(estimate) for power, estimate in decay.damping.items()},
    }
