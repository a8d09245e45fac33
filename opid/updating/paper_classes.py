"""The five model classes of Song et al. (2021), Table 3, and what the paper finds for them, Table 4."""

from __future__ import annotations

from collections.abc import Mapping

from opid.updating.model_class import ModelClass, Prior

_FIRST, _SECOND = Prior("uniform", 0.0, 10.0), Prior("uniform", -10.0, 10.0)

PAPER_CLASSES = (
    ModelClass("class 1", ("quadratic_stiffness",), (2.16e5,), (_FIRST,)),
    ModelClass("class 2", ("cubic_stiffness",), (6.8e7,), (_FIRST,)),
    ModelClass("class 3", ("quartic_stiffness",), (3e10,), (_FIRST,)),
    ModelClass("class 4", ("cubic_stiffness", "quartic_stiffness"), (8.84e7, -2.7e9), (_FIRST, _SECOND)),
    ModelClass("class 5", ("cubic_stiffness", "quintic_stiffness"), (7.48e7, -8.4e11), (_FIRST, _SECOND)),
)
"""With the priors of section 4.2; the table's scales are in N and mm."""

PAPER_THETA: Mapping[str, tuple[float, ...]] = {
    "class 1": (1.63,),
    "class 2": (1.58,),
    "class 3": (1.09,),
    "class 4": (1.34, 1.26),
    "class 5": (1.49, 0.51),
}
"""Means of Table 4."""
