"""How often each class would be chosen if another one were true."""

import made_backbones as made
import numpy as np
import pytest

from opid.errors import InputError
from opid.studies.updating_study import ClassTable
from opid.updating.confusion import find_confusion
from opid.updating.likelihood.backbones import backbone_data, draw_curves
from opid.updating.likelihood.curves import make_curves
from opid.updating.likelihood.noise import NoiseSettings
from opid.updating.model_class import ModelClass, Prior, UncertainTerm
from opid.updating.posterior import update_class
from opid.updating.study import UpdatingStudy

TWIN = ModelClass("twin", (UncertainTerm("cubic_stiffness", (6.8e7,), (Prior("uniform", 0.0, 10.0),)),))


def data():
    return backbone_data(made.system(), made.backbones(0))


def test_classes_that_differ_are_kept_apart_and_twins_are_not():
    given = data()
    found = [
        update_class(given, each, rng=np.random.default_rng(0), n_samples=1000)
        for each in (made.CUBIC, TWIN, made.QUADRATIC)
    ]
    confusion = find_confusion(given, found, n_sets=4, rng=np.random.default_rng(1))
    assert confusion.classes == ("cubic", "twin", "quadratic")
    np.testing.assert_allclose(confusion.chosen.sum(axis=1), 1.0)
    assert confusion.chosen[2, 2] == 1.0  # the quadratic law is never taken for the cubic one
    assert (confusion.chosen[:2, 2] == 0.0).all()


def test_drawn_curves_scatter_as_the_measured_ones_do():
    (mode, _) = data().modes
    eigenvalue, shapes, _, _ = make_curves(data(), mode, made.CUBIC)(np.array([[made.TRUTH]]))
    rng = np.random.default_rng(2)
    drawn = [draw_curves(mode, eigenvalue[0], shapes[0], rng) for _ in range(200)]
    errors = np.array([each.eigenvalue for each in drawn]) / (mode.between @ eigenvalue[0]) - 1
    # the error of the linear structure is common to all points, and is the largest
    assert errors.mean(axis=1).std() == pytest.approx(2 * NoiseSettings().linear_error, rel=0.25)
    np.testing.assert_allclose(np.linalg.norm(drawn[0].shapes, axis=1), 1.0, rtol=1e-9)
    assert np.abs(np.sum(drawn[0].shapes * mode.shapes, axis=1)).min() > 0.95


def test_only_the_recommended_form_draws_curves():
    classes = (ClassTable(law="cubic", scale=6.8e7).model,)
    with pytest.raises(InputError, match="n_confused is 5 in the form 'paper', take the recommended form"):
        UpdatingStudy("x", made.system(), made.backbones(0), classes, form="paper", n_confused=5)
