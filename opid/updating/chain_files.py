"""The samples of an updating as netCDF files of ArviZ, one for the linear parameters and one a class."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from opid.errors import InputError, pip_install, require
from opid.signals.files import make_directory
from opid.updating.result import ClassPosterior, LinearPosterior, Updating
from opid.updating.sampling.chains import Chain, to_inference_data


def require_arviz() -> None:
    """Refuse by an InputError, before long work, what ArviZ could not write after it."""
    require("arviz", "writing chains", "arviz", "bayes")


def write_chains(result: Updating, directory: str | os.PathLike[str]) -> tuple[Path, ...]:
    """Write chains_linear.nc and chains_class_1.nc, chains_class_2.nc, ... for `arviz.from_netcdf`.

    Classes are counted as in the report; the parameters are theta_1, theta_2, ..., those of the linear structure have
    their own names.

    Args:
        result: from `update_study`.
        directory: made if it is not there.

    Returns:
        The files.

    Raises:
        InputError: ArviZ is not installed or cannot write netCDF, or a place that cannot be written to.
    """
    require_arviz()
    target = make_directory(directory)
    written = []
    for name, posterior, parameters in _list_posteriors(result):
        path = target / f"chains_{name}.nc"
        try:
            to_inference_data(_find_chain(posterior), parameters).to_netcdf(path)
        except (ImportError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise InputError(f"ArviZ cannot write {path} ({reason}): run `{pip_install('h5netcdf')}`") from error
        written.append(path)
    return tuple(written)


def _list_posteriors(result: Updating) -> Iterator[tuple[str, ClassPosterior | LinearPosterior, tuple[str, ...]]]:
    if result.linear is not None:
        yield "linear", result.linear, result.linear.names
    for number, each in enumerate(result.classes, start=1):
        yield f"class_{number}", each, tuple(each.estimates)


def _find_chain(posterior: ClassPosterior | LinearPosterior) -> Chain:
    """The chains of a posterior; if it did not keep them, its samples as one chain of unknown density."""
    if posterior.chain is not None:
        return posterior.chain
    samples, known = posterior.samples[None], posterior.diagnostics
    unknown = np.full(samples.shape[:2], np.nan)
    return Chain(samples, unknown, known.acceptance, known.n_evaluations, known.sampler, 0)
