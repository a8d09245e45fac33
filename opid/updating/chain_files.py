"""The samples of an updating as netCDF files of ArviZ, one for each posterior, and ArviZ's diagnostics of them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from opid.errors import FileError, pip_install, require
from opid.signals.files import PATIENCE_S, reserve_directory, write_whole
from opid.updating.result import ClassPosterior, LinearPosterior, Updating
from opid.updating.sampling.chains import to_inference_data

SUMMARY_FILE = "chains_summary.csv"

CHAIN_FILES = ("chains_linear.nc", "chains_class_[0-9]*.nc", SUMMARY_FILE)
"""Patterns of the names of the files that an updating can leave."""


def require_arviz() -> None:
    """Refuse by an InputError, before long work, what ArviZ could not write after it."""
    require("arviz", "writing chains", "arviz", "bayes")


def write_chains(result: Updating, directory: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Write chains_linear.nc and chains_class_1.nc, chains_class_2.nc, ... for `arviz.from_netcdf`, and their summary.

    Classes are counted as in the report; the parameters are theta_1, theta_2, ..., those of the linear structure have
    their own names. The chains are those of the law in the unit of the measured amplitudes: `calibration_std` of
    result.json is not in them. chains_summary.csv has a row for each of them with the diagnostics of `arviz.summary`:
    Monte Carlo errors of mean and standard deviation, effective samples of the bulk and the tails, and R-hat. Particles
    of transitional sampling are not several chains, and have no row.

    Args:
        result: from `update_study`.
        directory: made if it is not there.

    Returns:
        The files, the summary last if some posterior has several chains.

    Raises:
        InputError: ArviZ is not installed or cannot write netCDF, or a place that cannot be written to.
    """
    require_arviz()
    names, of_chains = [], {}
    with (
        reserve_directory(directory, wait_s=PATIENCE_S) as reserved,
        reserved.replace_files() as folder,
    ):
        for name, posterior, parameters in _list_posteriors(result):
            names.append(f"chains_{name}.nc")
            chain = posterior.chain
            data = to_inference_data(chain, parameters)
            try:
                data.to_netcdf(folder / names[-1])
            except (ImportError, ValueError) as error:
                reason, path = " ".join(str(error).split()), reserved / names[-1]
                raise FileError(f"ArviZ cannot write {path} ({reason}): run `{pip_install('h5netcdf')}`") from error
            if len(chain.samples) > 1:
                of_chains[name] = data
        if of_chains:
            names.append(SUMMARY_FILE)
            _write_summary(of_chains, folder / SUMMARY_FILE)
    return tuple(reserved / name for name in names)


def _write_summary(data_of: Mapping[str, Any], path: Path) -> None:
    """Write ArviZ's diagnostics of ArviZ's objects, by the name of the posterior, as one table."""
    import arviz
    import pandas  # ArviZ needs it, too.

    tables = {name: arviz.summary(data, kind="diagnostics", round_to="none") for name, data in data_of.items()}
    with write_whole(path) as file:
        pandas.concat(tables, names=["posterior", "parameter"]).to_csv(file, lineterminator="\n")


def _list_posteriors(result: Updating) -> Iterator[tuple[str, ClassPosterior | LinearPosterior, tuple[str, ...]]]:
    if result.linear is not None:
        yield "linear", result.linear, result.linear.names
    for number, each in enumerate(result.classes, start=1):
        yield f"class_{number}", each, tuple(each.estimates)
