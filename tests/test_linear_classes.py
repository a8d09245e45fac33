"""Sets of stiffness factors, of which phase I chooses one by its evidence; weights of single modes."""

from dataclasses import replace

import made_backbones as made
import numpy as np
import pytest
from made_chain import curve_of, small_chain

import opid
from opid.errors import InputError
from opid.studies.study_file import read_study, write_study
from opid.updating.identification import update_study
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.linear_updating import update_linear
from opid.updating.model_class import Prior
from opid.updating.study import UpdatingStudy

SETS = {"both": ("plate", "leaves"), "plate alone": ("plate",), "leaves alone": ("leaves",)}
PRIOR = Prior("uniform", 0.2, 3.0)


def study_of(seed, plate, leaves, **how):
    return UpdatingStudy(
        "sets of factors",
        made.structure(),
        made.backbones(seed, true=made.system(plate, leaves)),
        (made.CUBIC,),
        parameters={"plate": PRIOR, "leaves": PRIOR},
        linear_classes=SETS,
        n_samples=1000,
        n_internal=0,
        harmonics=(1,),
        seed=seed,
        **how,
    )


@pytest.mark.parametrize(
    ("plate", "leaves", "first"), [(0.8, 1.0, "plate alone"), (1.0, 1.25, "leaves alone"), (0.8, 1.25, "both")]
)
def test_the_set_of_factors_that_is_wrong_is_the_one_that_is_chosen(plate, leaves, first):
    chosen = []
    for seed in range(3):
        found = update_study(study_of(seed, plate, leaves))
        chosen.append(found.linear.name)
        assert [each.name for each in found.linear_classes] == [*SETS]
        best = max(found.linear_classes, key=lambda each: each.log_evidence)
        assert found.linear is best
        for name, true in (("plate", plate), ("leaves", leaves)):
            if name in best.names:
                off = (best.estimates[name].value - true) / best.estimates[name].std
                assert abs(off) < 3.5
    assert chosen == [first] * 3


def test_the_report_and_the_file_hold_all_sets(tmp_path):
    study = study_of(0, 0.8, 1.0, noise=NoiseSettings(weight={2: 1.0, 3: 0.5}))
    write_study(study, tmp_path / "study.toml")
    again = read_study(tmp_path / "study.toml")
    assert dict(again.linear_classes) == SETS
    assert again.noise.weight == {2: 1.0, 3: 0.5}
    found = update_study(again)
    text = opid.text(found)
    assert "plate alone   plate" in text
    assert "best" in next(line for line in text.splitlines() if line.startswith("plate alone"))
    document = found.to_dict()
    assert [each["name"] for each in document["linear_classes"]] == [*SETS]
    assert document["linear"]["evidence"]["method"] == "quadrature"
    assert document["settings"]["noise"]["weight"] == {"2": 1.0, "3": 0.5}
    assert any("does not use weight" in each for each in found.warnings)


def test_sets_that_the_data_cannot_distinguish_are_told():
    study = replace(study_of(1, 1.0, 1.0), noise=NoiseSettings(linear_error=0.3))
    assert any("differ by" in each and "linear classes" in each for each in update_study(study).warnings)


def test_sets_that_cannot_be_are_refused():
    with pytest.raises(InputError) as caught:
        UpdatingStudy(
            "x", small_chain(), (curve_of(),), (made.CUBIC,), parameters={"E": PRIOR},
            linear_classes={"one": ("F",), "two": (), "three": ("E", "E")},
        )  # fmt: skip
    told = str(caught.value)
    assert "the linear class 'one' has 'F', which is no parameter to update: known are" in told
    assert "the linear class 'two' has the parameters [], name at least one" in told
    assert "the linear class 'three' has the parameters ['E', 'E']" in told


def test_a_mode_of_larger_weight_counts_less():
    """Two modes contradict each other: the factors follow the mode that weighs less, for its errors are smaller."""
    one, other = curve_of(1, name="one", factor=1.02), curve_of(2, name="other", factor=0.98)
    found = []
    for weight in ({1: 0.1}, {2: 0.1}, {1: 0.1, 2: 0.1}, 0.1):
        linear = update_linear(
            small_chain(), (one, other), priors={"E": Prior("uniform", 0.5, 2.0)}, rng=np.random.default_rng(0),
            cov=0.02, weight=weight,
        )  # fmt: skip
        found.append(linear.estimates["E"].value)
    by_first, by_second, equal, same = found
    assert by_first > equal > by_second
    assert equal == same
    with pytest.raises(InputError, match="weight names mode 3, which has no backbone"):
        update_linear(
            small_chain(), (one,), priors={"E": PRIOR}, rng=np.random.default_rng(0), cov=0.02, weight={3: 1.0}
        )
    with pytest.raises(InputError, match=r"weight of mode 2 is -1\.0"):
        NoiseSettings(weight={2: -1.0})
