"""Libraries that serve one rare path are extras: all else works without them, and a sentence says what to install."""

import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from made_body import small_body
from made_updating import small_updating

from opid.campaigns.campaign_file import CampaignPlan
from opid.campaigns.engine import run_campaign
from opid.errors import InputError
from opid.signals.exchange import frame_of, xarray_of
from opid.signals.logs import formats
from opid.signals.recording import recording_from_arrays
from opid.suspensions.flights.dataset import read_dataset
from opid.updating.chain_files import write_chains
from opid.updating.sampling.samplers import nuts
from opid.virtual.backbone_tests.wing_engine import wing_engine_structure

PROJECT = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]


def recording():
    return recording_from_arrays(np.zeros((1, 16)), fs=10.0, unit="m/s^2", names=["a"])


def walks():
    return nuts(None, None, covariance=1.0, n_samples=1, n_warm_up=0, rng=np.random.default_rng(0))


NEEDED = {
    "arviz": ("bayes", "arviz", lambda folder: write_chains(small_updating(), folder)),
    "distributed": ("campaign", "distributed", lambda folder: run_campaign(CampaignPlan("none", ()), folder)),
    "nutpie": ("nuts", "nutpie", lambda folder: walks()),
    "pandas": ("tables", "pandas", lambda folder: small_body().to_frame()),
    "pandas of a recording": ("tables", "pandas", lambda folder: frame_of(recording())),
    "pyarrow": ("campaign", "pyarrow", read_dataset),
    "skfem": ("wing", "scikit-fem", lambda folder: wing_engine_structure()),
    "xarray": ("tables", "xarray", lambda folder: xarray_of(recording())),
}


@pytest.mark.parametrize("module", NEEDED)
def test_what_needs_an_extra_says_how_to_install_it(module, tmp_path, monkeypatch):
    extra, library, use = NEEDED[module]
    monkeypatch.setitem(sys.modules, module.split()[0], None)
    with pytest.raises(InputError) as caught:
        use(tmp_path)
    pip = f"{sys.executable} -m pip install"
    end = f" needs {library}, which is not installed: run `{pip} '.[{extra}]'` in a clone of opid, or `{pip} {library}`"
    assert str(caught.value).endswith(end)
    assert list(tmp_path.iterdir()) == []


def libraries(requirements):
    return {re.split(r"[<>=\[]", each)[0] for each in requirements}


def test_the_extras_that_are_named_have_these_libraries():
    named = {(extra, library) for extra, library, _ in NEEDED.values()}
    named |= {(form.extra, form.needs) for form in formats().values() if form.needs}
    for extra, library in named:
        assert library in libraries(EXTRAS[extra])
        assert library not in libraries(PROJECT["dependencies"])


def test_all_has_every_extra_that_a_user_needs():
    (every,) = EXTRAS["all"]
    assert {*every.removeprefix("opid[").removesuffix("]").split(",")} == EXTRAS.keys() - {
        *("all", "bayes", "campaign", "dev", "docs", "fuzz", "notebooks", "nuts", "test"),
    }
