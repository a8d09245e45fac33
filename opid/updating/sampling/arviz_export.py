"""Chains for ArviZ, and the same groups as plain arrays where it is not installed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.updating.sampling.chains import Chain


def inference_groups(chain: Chain, names: Sequence[str]) -> dict[str, dict[str, FloatArray]]:
    """Return the groups of ArviZ's schema, each variable (n_chains, n).

    Args:
        chain: of any sampler.
        names: one a parameter.

    Raises:
        InputError: a name missing or given twice.

    >>> one = Chain(np.zeros((2, 5, 1)), np.zeros((2, 5)), 0.3, 10, "metropolis", 0)
    >>> inference_groups(one, ["theta_1"])["posterior"]["theta_1"].shape
    (2, 5)
    """
    if len(names) != chain.n_parameters or len(set(names)) < len(names):
        raise InputError(f"names are {list(names)}: give {chain.n_parameters} different one(s), one a parameter")
    posterior = {name: np.array(chain.samples[:, :, k]) for k, name in enumerate(names)}
    return {"posterior": posterior, "sample_stats": {"lp": np.array(chain.log_density)}}


def to_inference_data(chain: Chain, names: Sequence[str]) -> Any:
    """Return ArviZ's own object where ArviZ is installed (`pip install '.[bayes]'`), otherwise `inference_groups`.

    That object is an `InferenceData` before ArviZ 1.0 and a `DataTree` of xarray since.

    Args:
        chain: of any sampler.
        names: one a parameter.

    Raises:
        InputError: a name missing or given twice.
    """
    groups = inference_groups(chain, names)
    try:
        import arviz
    except ImportError:
        return groups
    # its signature differs between versions
    from_dict: Any = arviz.from_dict
    return from_dict(**groups) if int(arviz.__version__.split(".")[0]) < 1 else from_dict(groups)
