"""Tables [[classes]] of a study file: laws, scales with units, priors, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from opid.errors import InputError
from opid.studies.updating_study import ClassTable, find_term, tabulate_class
from opid.updating.model_class import Prior


def test_laws_have_short_and_full_names_and_scales_have_units():
    assert find_term("Even quadratic") == "even_quadratic_stiffness"
    assert find_term("cubic_stiffness") == "cubic_stiffness"
    table = {"law": "cubic+quartic", "scale": ("0.0884 N/mm^3", "-0.0027 N/mm4")}
    found = ClassTable(**table).model
    assert found.name == "cubic+quartic"
    np.testing.assert_allclose([each.scale for each in found.parameters], [8.84e7, -2.7e9], rtol=1e-12)
    assert found.priors == (Prior(), Prior())
    assert ClassTable(law="quadratic", scale="0.216 kN / m^2").model.terms[0].scales == (216.0,)
    assert tabulate_class(found).model == replace(found, name="cubic+quartic")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"law": "cubik", "scale": 1}, "did you mean 'cubic'"),
        ({"law": "cubic + quintic", "scale": (1,)}, "1 scale(s): give 2, one for each of stiffness_n_per_m3 (N/m^3)"),
        ({"law": "cubic", "scale": "0.068 N/mm^2"}, "its unit is N/m^3"),
        ({"law": "cubic", "scale": "much"}, "give a number in N/m^3"),
        ({"law": "cubic", "scale": 0}, "other than 0"),
        ({"law": "cubic", "scale": 1, "prior": ("flat", 0, 1)}, "no prior 'flat'"),
        ({"law": "cubic", "scale": 1, "prior": ("uniform", 5, 0)}, "lower end first"),
        ({"law": "cubic + quintic", "scale": 1, "prior": (("uniform", 0, 1),)}, "1 prior(s): give 2"),
        ({"law": "cubic + cubic", "scale": 1}, "twice"),
        ({"law": "signed power", "scale": (1,)}, "1 scale(s): give 2"),
        ({"law": "cubic damping", "scale": 1}, "has no spring"),
        ({"law": "blow off damping", "scale": (1, 0.5)}, "has no spring"),
        ({"law": "cubic + linear dampng", "scale": 1}, "did you mean 'linear_damping'"),
        ({"law": "cubic + linear damping + signed power damping", "scale": 1}, "which are one kind: give one of them"),
        ({"law": "arctan_mixed", "scale": 1}, "depends on the rate and on the travel: give springs and dampers apart"),
    ],
)
def test_a_class_that_cannot_be_is_refused(table, words):
    with pytest.raises(InputError) as caught:
        ClassTable(**table)
    assert words in str(caught.value)
