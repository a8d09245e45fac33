"""A simulated field test on disk: its logs, the study that names them, and the truth behind them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from opid.json_values import json_text, plain
from opid.mechanics.laws.law import law_from_parameters
from opid.signals.directory import made_directory
from opid.signals.files import written_whole
from opid.studies.study_file import write_study
from opid.suspensions.result import GearParameters
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.files.truth import read_truth_file
from opid.virtual.taxi_tests.landing_gear import TaxiTest

TRUTH_SCHEMA = "opid.truth/1"


def truth_json(test: TaxiTest, *, settings: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what is true of a simulated field test, under the names of result.json.

    Args:
        test: the field test; the heavy run is the reference.
        settings: what it was simulated with, kept as they are.

    Returns:
        `schema`, `parameters` {name: value}, `law` {name, parameters}, `mass_change_kg`, `settings`.
    """
    gear = test.heavy.gear
    return plain(
        {
            "schema": TRUTH_SCHEMA,
            "parameters": {each.name: getattr(gear, each.name) for each in fields(GearParameters)},
            "law": {"name": gear.law.name, "parameters": gear.law.parameters},
            "mass_change_kg": test.mass_change_kg,
            "settings": dict(settings or {}),
        }
    )


def write_field_test(
    test: TaxiTest, directory: str | os.PathLike[str], *, title: str, settings: Mapping[str, Any] | None = None
) -> Path:
    """Write heavy.csv, light.csv, study.toml and truth.json, and return the path of the study.

    Args:
        test: the field test.
        directory: made if it is not there.
        title: of the study.
        settings: as in `truth_json`.

    Raises:
        InputError: a place that cannot be written to.
    """
    runs = (
        Run("heavy", test.heavy.recording, 0.0),
        Run("light", test.light.recording, test.mass_change_kg),
    )
    study = study_of_gear(title, sprung="upper_z", unsprung="lower_z", runs=runs)
    target = made_directory(directory)
    write_study(study, target / "study.toml")
    with written_whole(target / "truth.json") as file:
        file.write(json_text(truth_json(test, settings=settings)))
    return target / "study.toml"


def read_truth(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a truth.json.

    Args:
        path: the file.

    Raises:
        InputError: no such file, or none of `truth_json`'s making.
    """

    def check(truth: dict[str, Any]) -> None:
        truth["parameters"] = {each.name: float(truth["parameters"][each.name]) for each in fields(GearParameters)}
        law_from_parameters(truth["law"]["name"], truth["law"]["parameters"])

    return read_truth_file(
        path, schema=TRUTH_SCHEMA, what="a simulated field test", command="opid simulate", check=check
    )
