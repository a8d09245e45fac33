"""The tables [[classes]] of a study file and the priors in it -> `ModelClass`, `Prior`, and back."""

from __future__ import annotations

import re
from dataclasses import astuple, dataclass
from typing import Annotated

from opid.errors import InputError, nearest
from opid.mechanics.laws.kinds import LAWS
from opid.updating.model_class import Family, ModelClass, Prior

PRIOR = 'a list like ["uniform", 0, 10], ["normal", 1, 0.3] or ["lognormal", 1, 0.3]'
PriorRow = Annotated[tuple[Family, float, float], PRIOR]
"""Family, first and second value of a `Prior`."""

_WITH_UNIT = re.compile(r"\s*([-+0-9.eE]+)\s*([kM]?)N\s*/\s*(m|mm|cm|in)\s*(?:\^|\*\*)?\s*(\d*)\s*")
_PER_METRE = {"m": 1.0, "cm": 1e2, "mm": 1e3, "in": 1 / 0.0254}
_FORCE = {"": 1.0, "k": 1e3, "M": 1e6}


@dataclass(frozen=True, kw_only=True)
class ClassTable:
    """A table of [[classes]].

    Args:
        name: of the class; the law where left out.
        law: kinds of `opid.mechanics.laws.law`, "_stiffness" may be left out, joined by +.
        scale: one for all terms or one each, in SI units or with the unit in a text.
        prior: one for all terms or one each; uniform from 0 to 10 where left out.

    Raises:
        InputError: an unknown law, a scale in no unit of its term, a prior that is none, or counts that do not match.

    >>> ClassTable(law="cubic + quintic", scale=("0.0748 N/mm^3", -8.4e11)).model.scales
    (74800000.0, -840000000000.0)
    """

    name: str | None = None
    law: str
    scale: Annotated[
        float | str | tuple[float | str, ...], 'a number in SI units, text like "0.068 N/mm^3", or a list of such'
    ]
    prior: Annotated[PriorRow | tuple[PriorRow, ...] | None, f"{PRIOR}, or one such list for each term"] = None

    def __post_init__(self) -> None:
        _ = self.model  # so that what is wrong with it is said where it is read

    @property
    def model(self) -> ModelClass:
        """The class that the table describes."""
        kinds = tuple(kind_named(part) for part in self.law.split("+"))
        name = self.law if self.name is None else self.name
        scales = self.scale if isinstance(self.scale, tuple) else (self.scale,) * len(kinds)
        prior = astuple(Prior()) if self.prior is None else self.prior
        rows = prior if prior and isinstance(prior[0], tuple) else (prior,) * len(kinds)
        for what, given in (("scale", scales), ("prior", rows)):
            if len(given) != len(kinds):
                raise InputError(f"class {name!r} has {len(kinds)} term(s) and {len(given)} {what}(s): give one a term")
        values = tuple(_scale(scale, kind) for scale, kind in zip(scales, kinds, strict=True))
        return ModelClass(name, kinds, values, tuple(Prior(*row) for row in rows))


def table_of_class(model: ModelClass) -> ClassTable:
    """Return the table that describes a class."""
    scales, priors = model.scales, tuple(astuple(each) for each in model.priors)
    return ClassTable(
        name=model.name,
        law=" + ".join(kind.removesuffix("_stiffness") for kind in model.kinds),
        scale=scales if model.n_parameters > 1 else scales[0],
        prior=priors if model.n_parameters > 1 else priors[0],
    )


def kind_named(text: str) -> str:
    """Return the kind of spring that a short or a full name means.

    Raises:
        InputError: there is none.

    >>> kind_named(" cubic "), kind_named("gas column")
    ('cubic_stiffness', 'gas_column')
    """
    plain = "_".join(text.lower().split())
    for name in (plain, f"{plain}_stiffness"):
        if name in LAWS:
            return name
    springs = [kind.removesuffix("_stiffness") for kind in LAWS if len(LAWS[kind].parameters) == 1]
    raise InputError(f"there is no law {text.strip()!r}: {nearest(plain, springs)}")


def _scale(given: float | str, kind: str) -> float:
    """The scale of a term in SI units."""
    unit = LAWS[kind].parameters[0].unit
    if not isinstance(given, str):
        return float(given)
    found = _WITH_UNIT.fullmatch(given)
    try:
        number, force, length, power = found.groups() if found else ("", "", "m", "")
        value = float(number)
    except ValueError:
        raise InputError(
            f'the scale of {kind} is {given!r}: give a number in {unit}, or text like "0.068 N/mm^3"'
        ) from None
    if unit != f"N/m^{power}" and not (unit == "N/m" and power in ("", "1")):
        raise InputError(f"the scale of {kind} is {given!r}: its unit is {unit}, give it with that power")
    return value * _FORCE[force] * _PER_METRE[length] ** int(power or 1)
