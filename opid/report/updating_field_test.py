"""Virtual backbones on disk: matrices, one CSV file a curve, the study that names them, and the truth behind them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from opid.mechanics.laws import Law
from opid.report.as_json import json_text, plain
from opid.report.directory import made_directory
from opid.report.updating_tables import TRUTH_SCHEMA
from opid.signals.files import written_whole
from opid.updating.study import UpdatingStudy
from opid.updating.study_file import write_updating_study


def updating_truth_json(
    law: Law, linear: Mapping[str, float], *, structure: str = "", settings: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return what is true of virtual backbones.

    Args:
        law: of the joints, a sum of springs with one coefficient each.
        linear: true factors of the linear structure by name.
        structure: what was tested, in one sentence.
        settings: what it was simulated with, kept as they are.

    Returns:
        `schema`, `structure`, `linear` {name: factor}, `law` {kind: coefficient in SI units}, `settings`.
    """
    return plain(
        {
            "schema": TRUTH_SCHEMA,
            "structure": structure,
            "linear": dict(linear),
            "law": {term.name: term.amplitude for term in law.terms},
            "settings": dict(settings or {}),
        }
    )


def write_updating_field_test(
    study: UpdatingStudy, directory: str | os.PathLike[str], *, truth: Mapping[str, Any]
) -> Path:
    """Write structure.npz, the backbones, study.toml and truth.json, and return the path of the study.

    Args:
        study: what was measured, and the classes to compare.
        directory: made if it is not there.
        truth: of `updating_truth_json`.

    Raises:
        InputError: a place that cannot be written to, or what `write_updating_study` refuses.
    """
    target = made_directory(directory)
    write_updating_study(study, target / "study.toml")
    with written_whole(target / "truth.json") as file:
        file.write(json_text(truth))
    return target / "study.toml"
