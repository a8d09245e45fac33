"""Restoring-force laws as values: a simulation takes the same law that a fit finds.

A law is a sum of terms, f(z, v) = sum_i A_i g_i(z, v; inner parameters) in N, of the extension z (m) of a
joint and its rate v (m/s). The joint has it beside its linear stiffness and damping.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opid.errors import InputError, meant_by, nearest
from opid.estimate import Estimate
from opid.mechanics.laws.kinds import LAWS, ForceAndDerivatives, Kind, Parameter
from opid.result import SummaryRow

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Term:
    """One term of a law: the name of its kind and the values of the parameters, the amplitude first.

    Raises:
        InputError: an unknown kind, a wrong number of values, or a value outside its role.
    """

    name: str
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.name not in LAWS:
            raise InputError(_describe_unknown_law(self.name))
        try:
            object.__setattr__(self, "values", tuple(float(value) for value in self.values))
        except (TypeError, ValueError):
            raise InputError(f"{self.name} has the values {self.values!r}: give numbers") from None
        if len(self.values) != len(self.kind.parameters):
            names = ", ".join(parameter.name for parameter in self.kind.parameters)
            raise InputError(f"{self.name} has {len(self.values)} value(s): give one for each of {names}")
        for parameter, value in zip(self.kind.parameters, self.values, strict=True):
            positive = parameter.role in ("scale", "exponent")
            if not math.isfinite(value) or (positive and value <= 0.0):
                needed = "a positive number" if positive else "a finite number"
                unit = "" if parameter.unit == "1" else f" {parameter.unit}"
                raise InputError(f"{parameter.name} of {self.name} is {value:g}{unit}: give {needed}")

    @property
    def kind(self) -> Kind:
        """The entry in `LAWS`."""
        return LAWS[self.name]

    @property
    def amplitude(self) -> float:
        """The value to which the force is proportional."""
        return self.values[0]

    @property
    def inner(self) -> tuple[float, ...]:
        """The other values."""
        return self.values[1:]

    def evaluate(self, z: FloatArray, v: FloatArray) -> ForceAndDerivatives:
        """Return the force for unit amplitude and its derivatives by z, v and the first two inner values.

        A term with memory has the force of a slow motion that goes on in one direction.
        """
        return self.kind.function(z, v, *(*self.inner, 1.0, 1.0)[:2])

    def evaluate_about(self, rest_m: float, z: FloatArray, v: FloatArray) -> ForceAndDerivatives:
        """Return the same about a rest position, at which the force and its derivatives by inner values are zero.

        A term with a slow and a quick curve (gas) rests on the slow one (see `loading`).

        Args:
            rest_m: extension at rest, m.
            z: extension from rest, m.
            v: rate of the extension, m/s, of the same shape.
        """
        shape, by_z, by_v, first, second = self.evaluate(z + rest_m, v)
        if rest_m == 0.0:
            return shape, by_z, by_v, first, second
        # A kind may divide zero by zero at rest before it replaces the result.
        with np.errstate(all="ignore"):
            at_rest = self.evaluate(np.array(rest_m), np.array(0.0))
        factor, _, by_first, by_second = self.loading(rest_m)
        shape, first, second = shape - at_rest[0], first - at_rest[3], second - at_rest[4]
        return (
            factor * shape,
            factor * by_z,
            factor * by_v,
            factor * (first + by_first * shape),
            factor * (second + by_second * shape),
        )

    def static_force(self, z: FloatArray) -> tuple[Any, Any, Any, Any]:
        """Return the force for unit amplitude of the term standing still, its derivatives by z and two inner values.

        Args:
            z: extension to which it was brought slowly, m.
        """
        slowly = (*self.kind.quasi_static, None, None)[:2]
        inner = [
            value if fixed is None else fixed for value, fixed in zip((*self.inner, 1.0, 1.0), slowly, strict=False)
        ]
        shape, by_z, _, *by_inner = self.kind.function(z, np.zeros_like(z), *inner)
        first, second = (by if fixed is None else 0.0 for by, fixed in zip(by_inner, slowly, strict=True))
        return shape, by_z, first, second

    def loading(self, rest_m: float) -> tuple[float, float, float, float]:
        """Return the factor on the amplitude where the term was brought slowly to rest, and its derivatives.

        A gas that carries the force 1 - s at rest, by its slow curve s(z), moves on its quick curve q(z) as if it
        carried (1 - s)/(1 - q) at its origin, which is the factor.

        Args:
            rest_m: extension at rest, m.

        Returns:
            The factor, and the derivatives of its logarithm by the position and by the first two inner values.
        """
        if not self.kind.quasi_static:
            return 1.0, 0.0, 0.0, 0.0
        position = np.array(rest_m)
        slow, slow_by, *slow_by_inner = self.static_force(position)
        quick, quick_by, _, *quick_by_inner = self.evaluate(position, np.array(0.0))
        left, moving = 1.0 - float(slow), 1.0 - float(quick)
        by = [
            float(q) / moving - float(s) / left
            for s, q in zip((slow_by, *slow_by_inner), (quick_by, *quick_by_inner), strict=True)
        ]
        return left / moving, by[0], by[1], by[2]


@dataclass(frozen=True)
class TermSet:
    """Terms side by side, of which several may be of one kind.

    Args:
        terms: the terms, each about its own origin.
        rest_m: extension of the terms at which the joint rests, m: the force is f(rest + z, v) - f(rest, 0).
    """

    terms: tuple[Term, ...] = ()
    rest_m: float = 0.0

    @property
    def name(self) -> str:
        """The names of the terms joined by `+`, or "linear"."""
        return "+".join(term.name for term in self.terms) or "linear"

    @property
    def has_memory(self) -> bool:
        """Whether a term has a memory."""
        return any(term.kind.memory is not None for term in self.terms)

    @property
    def remembering(self) -> Law:
        """The terms with memory."""
        return Law(tuple(term for term in self.terms if term.kind.memory is not None))

    @property
    def n_faint(self) -> int:
        """Number of last terms that are too weak to move anything, so that their memories only follow the motion."""
        return 0

    @property
    def vector(self) -> FloatArray:
        """(n_parameters,) all values in one array, which a fit varies."""
        return np.array([value for term in self.terms for value in term.values], dtype=np.float64)

    def force(self, z: ArrayLike, v: ArrayLike) -> FloatArray:
        """Return f(z, v), N, for the extension z (m) and its rate v (m/s), arrays that broadcast."""
        z, v = _broadcast(z, v)
        total = np.zeros(z.shape)
        for term in self.terms:
            total += term.amplitude * term.evaluate_about(self.rest_m, z, v)[0]
        return total

    def static_force(self, z: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the force of the law standing still at an extension, less that at rest, N.

        Args:
            z: extension from rest, to which the law was brought slowly, m.

        Returns:
            The force, its derivative by z, (*z.shape,) each, and those by each entry of `vector`, (*z.shape,
            n_parameters).
        """
        position, rest = np.asarray(z, dtype=np.float64) + self.rest_m, np.array(self.rest_m)
        force, by_z = np.zeros(position.shape), np.zeros(position.shape)
        by_values = np.zeros((*position.shape, self.vector.size))
        column = 0
        # A kind may divide zero by zero at rest before it replaces the result.
        with np.errstate(all="ignore"):
            for term in self.terms:
                shape, slope, *by_inner = term.static_force(position)
                at_rest, _, *by_inner_at_rest = term.static_force(rest)
                force += term.amplitude * (shape - at_rest)
                by_z += term.amplitude * slope
                by_values[..., column] = shape - at_rest
                for k in range(min(2, len(term.inner))):
                    by_values[..., column + 1 + k] = term.amplitude * (by_inner[k] - by_inner_at_rest[k])
                column += len(term.values)
        return force, by_z, by_values

    def gradient(self, z: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return df/dz, N/m, and df/dv, N s/m, the tangent stiffness and damping at (z, v)."""
        z, v = _broadcast(z, v)
        by_z, by_v = np.zeros(z.shape), np.zeros(z.shape)
        for term in self.terms:
            _, term_by_z, term_by_v, *_ = term.evaluate_about(self.rest_m, z, v)
            by_z += term.amplitude * term_by_z
            by_v += term.amplitude * term_by_v
        return by_z, by_v

    def parameter_gradient(self, z: ArrayLike, v: ArrayLike) -> FloatArray:
        """Return the derivatives of the force by each entry of `vector`, shape (*z.shape, n_parameters).

        The column of an amplitude is the term for unit amplitude: the basis function of a regression.
        """
        z, v = _broadcast(z, v)
        gradient = np.zeros((*z.shape, self.vector.size))
        column = 0
        for term in self.terms:
            shape, _, _, *by_inner = term.evaluate_about(self.rest_m, z, v)
            gradient[..., column] = shape
            for index, by_value in enumerate(by_inner[: len(term.inner)]):
                gradient[..., column + 1 + index] = term.amplitude * by_value
            column += len(term.values)
        return gradient


@dataclass(frozen=True)
class WithCandidates(TermSet):
    """A law followed by further terms that are too weak to move anything.

    Args:
        terms: terms of the law, then the faint ones.
        rest_m: extension of the terms at which the joint rests, m.
        n_faint: number of faint terms.
    """

    n_faint: int = 0


@dataclass(frozen=True)
class Law(TermSet):
    """A restoring force as a value: a sum of terms in canonical order; no term at all is the linear joint.

    Terms of one kind with equal inner parameters are added up; laws add with `+`.

    Args:
        terms: the terms, each about its own origin.
        rest_m: extension of the law at which the joint rests, m: its force is f(rest + z, v) - f(rest, 0).

    Raises:
        InputError: two terms of one kind that differ in an inner parameter, or a sum of laws that rest at different
            extensions.

    >>> friction = law("arctan_velocity", amplitude_n=400.0, scale_m_per_s=0.02)
    >>> hardening = law("cubic_stiffness", stiffness_n_per_m3=3e9)
    >>> (hardening + friction).name
    'arctan_velocity+cubic_stiffness'
    >>> float(friction.force(0.0, 0.02))
    200.0
    >>> float(hardening.resting_at(0.01).gradient(0.0, 0.0)[0].round(3))
    900000.0
    """

    def __post_init__(self) -> None:
        if len(self.terms) < 2:  # there is nothing to order, and a fit builds tens of thousands of laws
            object.__setattr__(self, "terms", tuple(self.terms))
            return
        order = list(LAWS)
        ordered = sorted(self.terms, key=lambda term: order.index(term.name))
        merged = tuple(_add_up(name, tuple(terms)) for name, terms in groupby(ordered, lambda term: term.name))
        object.__setattr__(self, "terms", merged)

    @property
    def latex(self) -> str:
        r"""The force f(z, \dot z) as a formula, "0" for the linear joint."""
        return " + ".join(term.kind.latex for term in self.terms) or "0"

    @property
    def parameters(self) -> dict[str, dict[str, float]]:
        """The values as JSON holds them, {kind: {parameter: value}}."""
        return {
            term.name: {p.name: value for p, value in zip(term.kind.parameters, term.values, strict=True)}
            for term in self.terms
        }

    @property
    def parameter_list(self) -> tuple[Parameter, ...]:
        """The parameter of each entry of `vector`, in order."""
        return tuple(parameter for term in self.terms for parameter in term.kind.parameters)

    def with_vector(self, vector: ArrayLike) -> Law:
        """Return the law of the same terms with these values, the inverse of `vector`."""
        values = np.asarray(vector, dtype=np.float64)
        if values.shape != self.vector.shape:
            raise InputError(
                f"{self.name} has {self.vector.size} parameter(s) and the array shape {values.shape}: give one value "
                "for each"
            )
        remaining: Iterator[float] = iter(values.tolist())
        terms = tuple(Term(term.name, tuple(next(remaining) for _ in term.values)) for term in self.terms)
        return Law(terms, self.rest_m)

    def resting_at(self, rest_m: float) -> Law:
        """Return the law of a joint that rests at another extension.

        Args:
            rest_m: the extension at which it rests, from the origin of the terms, m.

        Raises:
            InputError: a value that is not a finite number.
        """
        if isinstance(rest_m, bool) or not isinstance(rest_m, Real) or not math.isfinite(rest_m):
            raise InputError(f"rest_m of a law is {rest_m!r}: give the extension in m, a finite number")
        return self if rest_m == self.rest_m else Law(self.terms, float(rest_m))

    def scaled(self, factor: float) -> Law:
        """Return factor times this law: only the amplitudes change.

        A fit to accelerations gives the force per unit mass, which times the mass is the force.
        """
        terms = tuple(replace(term, values=(factor * term.amplitude, *term.inner)) for term in self.terms)
        return Law(terms, self.rest_m)

    def __add__(self, other: Law) -> Law:
        rests = {law.rest_m for law in (self, other) if law.terms}
        if len(rests) > 1:
            raise InputError(
                f"laws that rest at {self.rest_m:g} and {other.rest_m:g} m cannot be added: let both rest at one "
                "extension"
            )
        return Law((*self.terms, *other.terms), *rests)


LINEAR = Law()
"""The linear joint: no nonlinear force."""


def law(name: str, **parameters: Any) -> Law:
    """Return the law called `name`.

    Args:
        name: a kind in `LAWS`, "linear", or a sum "a+b".
        parameters: for one kind its parameters; for a sum one dict of parameters for each kind.

    Raises:
        InputError: an unknown law or parameter, a missing one, or a value outside its range.

    >>> law("cubic_stiffness", stiffness_n_per_m3=3e9).parameters
    {'cubic_stiffness': {'stiffness_n_per_m3': 3000000000.0}}
    """
    single = "+" not in name and name != "linear"
    return law_from_parameters(name, {name: parameters} if single else parameters)


def law_from_parameters(name: str, parameters: Mapping[str, Mapping[str, float]]) -> Law:
    """Return the law of a result file: the inverse of `Law.name` with `Law.parameters`.

    Raises:
        InputError: what `law` refuses.

    >>> law_from_parameters("linear", {}) == LINEAR
    True
    """
    names = _split_name(name)
    for given in parameters:
        if given not in names:
            raise InputError(f"the law {name!r} has no term {given!r}: {nearest(given, names)}")
    return Law(tuple(_make_term(kind, parameters.get(kind, {})) for kind in names))


def default_law(name: str) -> Law:
    """Return the law called `name` with values that suit a landing gear.

    Raises:
        InputError: an unknown law.

    >>> default_law("arctan_velocity+cubic_stiffness").vector.tolist()
    [400.0, 0.02, 3000000000.0]
    """
    return Law(tuple(Term(kind, tuple(p.default for p in LAWS[kind].parameters)) for kind in _split_name(name)))


def _describe_unknown_law(name: str) -> str:
    """Return why a name is refused, with the kinds that a search tries and those that are fitted only by name."""
    known = [*LAWS, "linear"]
    if meant_by(name, known):
        return f"there is no law {name!r}: {nearest(name, known)}"
    searched = [repr(kind) for kind, each in LAWS.items() if each.searched and not each.bench_only]
    others = [repr(kind) for kind in LAWS if repr(kind) not in searched]
    return (
        f"there is no law {name!r}: a search tries {', '.join(searched)}; only a study that names them fits "
        f"{', '.join(others)}; 'linear' is a spring and a damper without a law"
    )


def _split_name(name: str) -> list[str]:
    if not isinstance(name, str):
        raise InputError(f"the law is {name!r}: give its name in quotes, sums joined by +")
    names = [part.strip() for part in name.split("+")]
    if names == ["linear"]:
        return []
    if "" in names:
        raise InputError(f"the law {name!r} lacks a name: give one on each side of +, or 'linear' for no law")
    for part in names:
        if part == "linear":
            raise InputError(f"the law {name!r} adds 'linear': the linear part is always there, leave it out")
        if part not in LAWS:
            raise InputError(_describe_unknown_law(part))
        if names.count(part) > 1:
            raise InputError(f"the law {name!r} has {part!r} twice: name each kind once")
    return names


def _make_term(name: str, given: Mapping[str, float]) -> Term:
    if not isinstance(given, Mapping):
        raise InputError(f"the parameters of {name} are {given!r}: give a dict of name and value")
    names = [parameter.name for parameter in LAWS[name].parameters]
    for key in given:
        if key not in names:
            raise InputError(f"{name} has no parameter {key!r}: {nearest(key, names)}")
    missing = [key for key in names if key not in given]
    if missing:
        raise InputError(f"{name} needs {', '.join(missing)}: give a value for each")
    return Term(name, tuple(given[key] for key in names))


def _add_up(name: str, terms: tuple[Term, ...]) -> Term:
    if len({term.inner for term in terms}) > 1:
        raise InputError(
            f"a sum has {name!r} twice with different inner parameters: give one term of each kind, or equal parameters"
        )
    return Term(name, (math.fsum(term.amplitude for term in terms), *terms[0].inner))


def _broadcast(z: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray]:
    z, v = np.broadcast_arrays(np.asarray(z, dtype=np.float64), np.asarray(v, dtype=np.float64))
    return z, v


def unit_of_parameter(parameter: Parameter, *, per_mass: bool) -> str:
    """Return the unit of a parameter of a law whose force is given in N, or per kg.

    >>> [unit_of_parameter(each, per_mass=True) for each in LAWS["arctan_velocity"].parameters]
    ['N/kg', 'm/s']
    """
    return f"{parameter.unit}/kg" if per_mass and parameter.role == "amplitude" else parameter.unit


def law_rows(
    law: Law, estimates: Mapping[str, Mapping[str, Estimate]], name: str, *, per_mass: bool = False
) -> Iterator[SummaryRow]:
    """Yield the parameters of a law as rows of a summary.

    Names of rows begin with `name`; a kind that `estimates`, {kind: {parameter: Estimate}}, lacks has no rows;
    `per_mass` says that the force is given per kg.
    """
    for term in law.terms:
        for parameter in term.kind.parameters if term.name in estimates else ():
            yield SummaryRow.of(
                f"{name}.{term.name}.{parameter.name}",
                estimates[term.name][parameter.name],
                unit_of_parameter(parameter, per_mass=per_mass),
            )


class FitOfOneLaw:
    """The part of a fit with one law that a search of the law reads."""

    if TYPE_CHECKING:

        @property
        def law(self) -> Law:
            """The law with its fitted values, as a field or a property."""

    @property
    def laws(self) -> dict[str, Law]:
        """The law in the form that a search takes."""
        return {"": self.law}

    @property
    def law_name(self) -> str:
        """Name of the law."""
        return self.law.name
