"""The tables [[classes]] of a study file and the priors in it -> `ModelClass`, `Prior`, and back."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from opid.errors import InputError, nearest
from opid.mechanics.laws.kinds import LAWS
from opid.studies.tables import MAYBE_TEXT, TEXT, Key, maybe, table_faults
from opid.updating.model_class import FAMILIES, ModelClass, Prior

CLASS = {
    "name": MAYBE_TEXT,
    "law": TEXT,
    "scale": Key((int, float, str, list), 'a number in SI units, text like "0.068 N/mm^3", or a list of such'),
    "prior": maybe(list, 'a list like ["uniform", 0, 10], or one such list for each term'),
}
"""What may stand in [[classes]]."""

_WITH_UNIT = re.compile(r"\s*([-+0-9.eE]+)\s*([kM]?)N\s*/\s*(m|mm|cm|in)\s*(?:\^|\*\*)?\s*(\d*)\s*")
_PER_METRE = {"m": 1.0, "cm": 1e2, "mm": 1e3, "in": 1 / 0.0254}
_FORCE = {"": 1.0, "k": 1e3, "M": 1e6}


def class_faults(number: int, table: object) -> Iterator[str]:
    """Yield what is wrong with one table of a class whose keys and types are right."""
    if isinstance(table, Mapping) and not list(table_faults("", table, CLASS)):
        try:
            model_class(table)
        except InputError as error:
            yield f"[[classes]] number {number}: {error}"


def model_class(table: Mapping[str, Any]) -> ModelClass:
    """Return the class that a table describes.

    Args:
        table: `law` (kinds of `opid.mechanics.laws.law`, "_stiffness" may be left out, joined by +), `scale` (one for
            all terms or one each, in SI units or with the unit in a text), and optionally `name` (the law where left
            out) and `prior` (one for all terms or one each; uniform from 0 to 10 where left out).

    Raises:
        InputError: an unknown law, a scale in no unit of its term, a prior that is none, or counts that do not match.

    >>> model_class({"law": "cubic + quintic", "scale": ["0.0748 N/mm^3", -8.4e11]}).scales
    (74800000.0, -840000000000.0)
    """
    kinds = tuple(kind_named(part) for part in table["law"].split("+"))
    name = table.get("name", table["law"])
    scales = table["scale"] if isinstance(table["scale"], list) else [table["scale"]] * len(kinds)
    if len(scales) != len(kinds):
        raise InputError(f"class {name!r} has {len(kinds)} term(s) and {len(scales)} scale(s): give one a term")
    priors = _priors(table.get("prior"), len(kinds), name)
    values = tuple(_scale(scale, kind) for scale, kind in zip(scales, kinds, strict=True))
    return ModelClass(name, kinds, values, priors)


def class_table(model: ModelClass) -> dict[str, Any]:
    """Return the table that `model_class` makes a class of."""
    return {
        "name": model.name,
        "law": " + ".join(kind.removesuffix("_stiffness") for kind in model.kinds),
        "scale": list(model.scales) if model.n_parameters > 1 else model.scales[0],
        "prior": [prior_list(each) for each in model.priors] if model.n_parameters > 1 else prior_list(model.priors[0]),
    }


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


def prior_of(given: object) -> Prior:
    """Return the prior that a list describes.

    Args:
        given: ["uniform", low, high], ["normal", mean, deviation] or ["lognormal", median, deviation of the logarithm].

    Raises:
        InputError: it describes none.

    >>> prior_of(["normal", 1, 0.1])
    Prior(family='normal', first=1.0, second=0.1)
    """
    match given:
        case [str() as family, (int() | float()) as first, (int() | float()) as second]:
            if family not in FAMILIES:
                raise InputError(f"there is no prior {family!r}: {nearest(family, FAMILIES)}")
            return Prior(next(each for each in FAMILIES if each == family), float(first), float(second))
    raise InputError(f'the prior is {given!r}: give a list like ["uniform", 0, 10]')


def prior_list(prior: Prior) -> list[Any]:
    """Return the list that `prior_of` makes a prior of."""
    return [prior.family, prior.first, prior.second]


def _priors(given: object, n: int, name: str) -> tuple[Prior, ...]:
    if given is None:
        return (Prior(),) * n
    if isinstance(given, list) and given and isinstance(given[0], list):
        if len(given) != n:
            raise InputError(f"class {name!r} has {n} term(s) and {len(given)} prior(s): give one a term")
        return tuple(prior_of(each) for each in given)
    return (prior_of(given),) * n


def _scale(given: object, kind: str) -> float:
    """The scale of a term in SI units."""
    unit = LAWS[kind].parameters[0].unit
    if isinstance(given, (int, float)) and not isinstance(given, bool):
        return float(given)
    found = _WITH_UNIT.fullmatch(given) if isinstance(given, str) else None
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
