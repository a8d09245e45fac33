"""Which law, by sparse regression on the predicted motion."""

import pytest
from law_runs import fitted, runs_of

from opid.mechanics.laws.law import default_law
from opid.suspensions.law_search.driven import DrivenLaws
from opid.suspensions.law_search.pursuit import chosen, library
from opid.suspensions.law_search.sparse_regression import RegressionSettings, regress, search_by_regression
from opid.suspensions.settings import SearchSettings


@pytest.mark.parametrize("name", ["cubic_stiffness", "arctan_velocity+cubic_stiffness"])
def test_the_true_law_is_proposed_and_chosen(name):
    near = fitted(runs_of(default_law(name)), default_law("coulomb_friction+cubic_stiffness"))
    assert regress(near, 0, library(), RegressionSettings())[0].name == name
    said = []
    ladder = search_by_regression(DrivenLaws(SearchSettings(), 1.0), near, kinds=library(), progress=said.append)
    assert chosen(ladder).law_name == name
    assert chosen(ladder).method == "sparse regression"
    assert ladder[0].fit is near
    assert said[0] == "sparse regression"
    assert name in said
