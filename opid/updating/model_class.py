"""Model classes: springs and dampers of the joints whose parameters are updated, scaled to be near 1, with priors.

The five classes of Song et al. (2021) follow at the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special, stats

from opid.errors import InputError, list_names, nearest
from opid.mechanics.backbones.harmonic_balance import TRIED_M, TRIED_M_PER_S, depends_on_rate
from opid.mechanics.laws.kind import TINY
from opid.mechanics.laws.kinds import LAWS, Kind, Parameter
from opid.mechanics.laws.law import Term, TermSet
from opid.signals.recording import FloatArray

LINEAR_DAMPING = "signed_power_damping"
"""The kind that is a linear damper where its exponent is known to be 1."""

LATE_CUBIC = "late_cubic_stiffness"
"""The kind of which a spline has one term for each knot."""

_NO_DENSITY = 40.0  # standard deviations beyond which the density of a normal distribution is 0 in floating point

Family = Literal["uniform", "normal", "lognormal"]
FAMILIES: tuple[Family, ...] = get_args(Family)


@dataclass(frozen=True)
class Prior:
    """Prior of one parameter.

    Args:
        family: "uniform" between `first` and `second`; "normal" with mean `first` and standard deviation `second`;
            "lognormal" with median `first` and standard deviation `second` of the logarithm.
        first: first value of the prior, see `family`.
        second: second value of the prior, see `family`.

    Raises:
        InputError: an unknown family, or values that do not make a distribution.

    >>> float(Prior("uniform", 0.0, 10.0).log_density(1.6).round(6))
    -2.302585
    """

    family: Family = "uniform"
    first: float = 0.0
    second: float = 10.0

    def __post_init__(self) -> None:
        if self.family not in FAMILIES:
            raise InputError(f"there is no prior {self.family!r}: {nearest(self.family, FAMILIES)}")
        if not (np.isfinite(self.first) and np.isfinite(self.second)):
            raise InputError(
                f"a {self.family} prior has the values {self.first} and {self.second}: give finite numbers"
            )
        if self.family == "uniform" and self.first >= self.second:
            raise InputError(f"a uniform prior goes from {self.first:g} to {self.second:g}: give the lower end first")
        if self.family != "uniform" and self.second <= 0:
            raise InputError(f"a {self.family} prior has a standard deviation of {self.second:g}: give a positive one")
        if self.family == "lognormal" and self.first <= 0:
            raise InputError(f"a lognormal prior has the median {self.first:g}: give a positive one")

    @cached_property
    def _distribution(self) -> Any:
        first, second = self.first, self.second
        if self.family == "uniform":
            return stats.uniform(first, second - first)
        return stats.norm(first, second) if self.family == "normal" else stats.lognorm(second, 0, first)

    @property
    def support(self) -> tuple[float, float]:
        """Lower and upper end of the possible values."""
        if self.family == "uniform":
            return self.first, self.second
        return (0.0 if self.family == "lognormal" else -np.inf), np.inf

    def widen(self, least: float = -np.inf, most: float = np.inf) -> Prior:
        """Return the prior twice as wide about the same centre; a uniform one stays between `least` and `most`.

        >>> Prior("uniform", 1.0, 3.0).widen(least=0.5)
        Prior(family='uniform', first=0.5, second=4.0)
        """
        if self.family == "uniform":
            half = (self.second - self.first) / 2
            return Prior("uniform", max(self.first - half, least), min(self.second + half, most))
        return Prior(self.family, self.first, 2 * self.second)

    def log_density(self, value: ArrayLike) -> FloatArray:
        """Logarithm of the density, of the shape of `value`; -inf outside the support."""
        # scipy checks so much that it takes ten times as long.
        given, (low, high) = np.asarray(value, dtype=np.float64), self.support
        if self.family == "uniform":
            return np.where((given >= low) & (given <= high), -np.log(high - low), -np.inf)
        inside = given > 0.0 if self.family == "lognormal" else np.isfinite(given)
        safe = np.where(inside, given, self.first)
        density = -0.5 * self.to_normal(safe) ** 2 - np.log(self.second * np.sqrt(2 * np.pi))
        if self.family == "lognormal":
            density = density - np.log(safe)
        return np.where(inside, density, -np.inf)

    def from_normal(self, score: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Values at the probabilities that a standard normal variable has at `score`, and their derivatives by it.

        >>> value, slope = Prior("lognormal", 2.0, 0.5).from_normal([0.0, 1.0])
        >>> value.round(3).tolist(), slope.round(3).tolist()
        ([2.0, 3.297], [1.0, 1.649])
        """
        given = np.asarray(score, dtype=np.float64)
        if self.family == "uniform":
            width, near = self.second - self.first, np.clip(given, -_NO_DENSITY, _NO_DENSITY)
            return self.first + width * special.ndtr(given), width * np.exp(-0.5 * near**2) / np.sqrt(2 * np.pi)
        if self.family == "normal":
            return self.first + self.second * given, np.full_like(given, self.second)
        # A value or slope beyond the largest number is infinite.
        logarithm = np.log(self.first) + self.second * given
        most = np.log(np.finfo(np.float64).max) - max(0.0, float(np.log(self.second)))
        value = np.where(logarithm < most, np.exp(np.minimum(logarithm, most)), np.inf)
        return value, self.second * value

    def to_normal(self, value: ArrayLike) -> FloatArray:
        """Scores of a standard normal variable at the probabilities of `value`: the inverse of `from_normal`."""
        given = np.asarray(value, dtype=np.float64)
        if self.family == "uniform":
            return special.ndtri((given - self.first) / (self.second - self.first))
        if self.family == "normal":
            return np.asarray((given - self.first) / self.second)
        logarithm = np.log(given, out=np.full(given.shape, -np.inf), where=given > 0.0)
        return np.asarray((logarithm - np.log(self.first)) / self.second)

    def sample(self, n: int, rng: np.random.Generator) -> FloatArray:
        """(n,) independent draws."""
        return np.asarray(self._distribution.rvs(n, rng))


@dataclass(frozen=True)
class UncertainTerm:
    """One term of the law of some joints, with what is known of each of its parameters.

    Args:
        kind: name of the kind in `opid.laws.LAWS`, a spring or a damper.
        scales: one factor for each parameter of the kind, in its unit; that of an amplitude may be negative.
        priors: prior of each parameter over its scale; None for one that is known to be its scale.
        joints: names of the joints that have the term, with the same values; all where empty.

    Raises:
        InputError: an unknown kind, one with a memory that has no steady cycle or one that is neither spring nor
            damper, counts that do not match, or a scale or a prior that its parameter cannot have.
    """

    kind: str
    scales: tuple[float, ...]
    priors: tuple[Prior | None, ...]
    joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.kind not in LAWS:
            raise InputError(f"there is no law {self.kind!r}: {nearest(self.kind, LAWS)}")
        kind = LAWS[self.kind]
        if kind.memory is not None and kind.cycle is None:
            known = list_names([name for name, each in LAWS.items() if each.cycle is not None], 9)
            raise InputError(f"{self.kind!r} has a memory whose steady cycle is not known: joints may have {known}")
        wanted = [each.name for each in kind.parameters]
        for what, given in (("scale", self.scales), ("prior", self.priors)):
            if len(given) != len(wanted):
                raise InputError(
                    f"{self.kind!r} has {len(given)} {what}(s): give {len(wanted)}, one for each of {', '.join(wanted)}"
                )
        for parameter, scale, prior in zip(kind.parameters, self.scales, self.priors, strict=True):
            if not (np.isfinite(scale) and scale):
                raise InputError(f"{parameter.name} of {self.kind!r} has the scale {scale}: give a number other than 0")
            if _is_positive(kind, parameter) and scale < 0.0:
                raise InputError(f"{parameter.name} of {self.kind!r} has the scale {scale}: give a positive one")
            if _is_positive(kind, parameter) and prior is not None and prior.support[0] < 0.0:
                raise InputError(
                    f"{parameter.name} of {self.kind!r} is positive, and its prior allows values below 0: give a "
                    "uniform one from 0 up, or a lognormal one"
                )
            most = scale if prior is None else scale * prior.support[1]
            if most > parameter.stiff_below:
                raise InputError(
                    f"{parameter.name} of {self.kind!r} may be {most:g}, where the joint has no end of its stiffness "
                    f"while nothing slides: give values below {parameter.stiff_below:g}, by a uniform prior or known"
                )
        if self.is_damper and depends_on_travel(Term(self.kind, self.scales)):
            raise InputError(f"{self.kind!r} depends on the rate and on the travel: give springs and dampers apart")
        if len(set(self.joints)) < len(self.joints):
            raise InputError(f"{self.kind!r} is at the joints {self.joints}: name each once")

    @property
    def has_memory(self) -> bool:
        """Whether it is a joint that slips: a spring that loses energy, whose stiffness at rest is not its own."""
        return LAWS[self.kind].memory is not None

    @cached_property
    def is_damper(self) -> bool:
        """Whether its force depends on the rate of the extension alone."""
        return not self.has_memory and depends_on_rate(Term(self.kind, self.scales))

    @property
    def is_linear_damper(self) -> bool:
        """Whether it is a signed power of the rate whose exponent is known to be 1."""
        return self.kind == LINEAR_DAMPING and self.scales[1] == 1.0 and self.priors[1] is None

    @property
    def gap_m(self) -> float | None:
        """The extension at which it begins, m, where that is known; None of other terms."""
        pairs = zip(LAWS[self.kind].parameters, self.scales, self.priors, strict=True)
        return next((scale for own, scale, prior in pairs if own.name == "gap_m" and prior is None), None)

    @property
    def words(self) -> str:
        """The kind in short words, and where it acts: "cubic at front"."""
        return f"{self.short}{self.place}"

    @property
    def short(self) -> str:
        """The kind in short words, with a known extension at which it begins: "late cubic from 0.5 mm"."""
        return "linear damping" if self.is_linear_damper else f"{short_kind(self.kind)}{self.start}"

    @property
    def start(self) -> str:
        """Where it begins: " from 0.5 mm"; "" where that is not known, or at rest."""
        return "" if self.gap_m is None else _write_start([self.gap_m])

    @property
    def place(self) -> str:
        """Where it acts: " at front"; "" for all joints."""
        return f" at {', '.join(self.joints)}" if self.joints else ""

    def acts_at(self, joint: str) -> bool:
        """Return whether the joint called `joint` has the term."""
        return not self.joints or joint in self.joints


def _write_start(gaps_m: Sequence[float]) -> str:
    """Return where terms begin, in mm: " from 0.5, 1 and 1.5 mm"."""
    *first, last = (f"{1e3 * each:g}" for each in sorted(gaps_m))
    listed = f"{', '.join(first)} and {last}" if first else last
    return f" from {listed} mm"


def _is_positive(kind: Kind, parameter: Parameter) -> bool:
    """Return whether a parameter has no negative values: a scale, an exponent, and the force of a joint that slips."""
    return parameter.role in ("scale", "exponent") or kind.memory is not None


def depends_on_travel(term: Term) -> bool:
    """Return whether the force of a term differs between extensions at one rate."""
    tried = (term.evaluate(TRIED_M, np.full(TRIED_M.size, rate))[0] for rate in TRIED_M_PER_S)
    return any(np.ptp(each) > 0.0 for each in tried)


@dataclass(frozen=True)
class ClassParameter:
    """One unknown parameter of a class.

    Args:
        term: the term that it belongs to.
        index: its index among the parameters of the kind, 0 for the amplitude.
    """

    term: UncertainTerm
    index: int

    @property
    def own(self) -> Parameter:
        """The parameter of the kind."""
        return LAWS[self.term.kind].parameters[self.index]

    @property
    def unit(self) -> str:
        """The unit of the parameter."""
        return "N s/m" if self.term.is_linear_damper else self.own.unit

    @property
    def is_amplitude(self) -> bool:
        """Whether the term is nothing where the parameter is 0."""
        return self.index == 0

    @property
    def scale(self) -> float:
        """The factor that takes theta to the parameter in its unit."""
        return self.term.scales[self.index]

    @property
    def limits(self) -> tuple[float, float]:
        """The ends between which theta may be."""
        is_positive = _is_positive(LAWS[self.term.kind], self.own)
        return 0.0 if is_positive else -np.inf, self.own.stiff_below / self.scale if is_positive else np.inf

    @property
    def prior(self) -> Prior:
        """The prior of theta."""
        prior = self.term.priors[self.index]
        assert prior is not None  # A parameter that is known is none of the class.
        return prior

    @property
    def key(self) -> str:
        """The name in files: "cubic_stiffness", with what distinguishes it: "gas_column.exponent at front"."""
        inner = f".{self.own.name}" if self.index else ""
        kind = "linear_damping" if self.term.is_linear_damper else self.term.kind
        return f"{kind}{inner}{self.term.start}{self.term.place}"

    @property
    def words(self) -> str:
        """The name in short words: "cubic", "gas column, exponent at front"."""
        inner = f", {self.own.words}" if self.index else ""
        return f"{self.term.short}{inner}{self.term.place}"


class _PlainParameter:
    """What parameters beside those of a law have in common: theta is the parameter itself."""

    scale: ClassVar[float] = 1.0
    unit: ClassVar[str] = "1"
    is_amplitude: ClassVar[bool] = False
    limits: ClassVar[tuple[float, float]] = (0.0, np.inf)


@dataclass(frozen=True)
class StiffnessFactor(_PlainParameter):
    """A factor of a part of the linear stiffness that is unknown together with the laws of a class.

    Args:
        name: its name in the structure.
        prior: its prior; 1 is the nominal structure.
    """

    name: str
    prior: Prior

    @property
    def key(self) -> str:
        """The name in files."""
        return self.name

    @property
    def words(self) -> str:
        """The name in short words."""
        return self.name


@dataclass(frozen=True)
class DampingRatio(_PlainParameter):
    """The damping ratio of a mode of the structure without its joints, which is unknown together with their laws.

    Args:
        mode: number of the mode, from 1.
        prior: its prior.
    """

    mode: int
    prior: Prior

    @property
    def key(self) -> str:
        """The name in files."""
        return f"damping_ratio of mode {self.mode}"

    @property
    def words(self) -> str:
        """The name in short words."""
        return f"damping of mode {self.mode}"


@dataclass(frozen=True)
class ModelClass:
    """Candidate laws of the joints: the sum of terms at each joint, whose parameters are theta times their scales.

    Joints that share a term have the same values of it; a class with one term for several joints and a class with a
    term for each of them are different classes.

    Args:
        name: the name of the class.
        terms: the terms, springs and then dampers, at least one spring; those of one kind are at different joints, or
            begin at different extensions that are known.
        factors: factors of the linear stiffness that are unknown, too; none where the structure is taken as it is.
        ratios: damping ratios of modes that are unknown, too; none where no force tells them.

    Raises:
        InputError: no spring, no unknown parameter, or two terms of one kind at a joint.

    >>> cubic = ModelClass("class 2", (UncertainTerm("cubic_stiffness", (6.8e7,), (Prior("uniform", 0, 10),)),))
    >>> cubic.law("front", [1.58]).terms
    (Term(name='cubic_stiffness', values=(107440000.0,)),)
    """

    name: str
    terms: tuple[UncertainTerm, ...]
    factors: tuple[StiffnessFactor, ...] = ()
    ratios: tuple[DampingRatio, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(sorted(self.terms, key=lambda each: each.is_damper)))
        if not self.springs:
            raise InputError(f"class {self.name!r} has no spring: give at least one law that moves the frequencies")
        if not self.law_parameters:
            raise InputError(f"class {self.name!r} has no unknown parameter: give one a prior")
        for number, one in enumerate(self.terms):
            for other in self.terms[:number]:
                if one.kind != other.kind or (one.joints and other.joints and not {*one.joints} & {*other.joints}):
                    continue
                if "" not in (one.start, other.start) and one.start != other.start:
                    continue
                if one.is_linear_damper or other.is_linear_damper:
                    raise InputError(
                        f"class {self.name!r} has a linear damper and another {short_kind(one.kind)} at a joint, which "
                        "are one kind: give one of them, or a quadratic or cubic damping beside the linear one"
                    )
                gap = any(each.name == "gap_m" for each in LAWS[one.kind].parameters)
                hint = ", or with different known gaps" if gap else ""
                raise InputError(f"class {self.name!r} names {one.kind!r} twice at a joint: name each once{hint}")

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kind of each spring."""
        return tuple(each.kind for each in self.springs)

    @property
    def joints(self) -> tuple[tuple[str, ...], ...]:
        """The joints of each spring; empty for one of all joints."""
        return tuple(each.joints for each in self.springs)

    @property
    def springs(self) -> tuple[UncertainTerm, ...]:
        """The terms that move the frequencies."""
        return tuple(each for each in self.terms if not each.is_damper)

    @property
    def slips(self) -> bool:
        """Whether a joint has a memory."""
        return any(each.has_memory for each in self.terms)

    @property
    def has_knots(self) -> bool:
        """Whether a term begins at an extension that is known, as the pieces of a spline."""
        return any(each.gap_m is not None for each in self.terms)

    @property
    def dampers(self) -> tuple[UncertainTerm, ...]:
        """The terms that lose energy."""
        return tuple(each for each in self.terms if each.is_damper)

    @property
    def parameters(self) -> tuple[OneParameter, ...]:
        """The unknown parameters, in the order of theta: of springs, of dampers, damping ratios, then the factors."""
        return (*self.law_parameters, *self.ratios, *self.factors)

    @cached_property
    def law_parameters(self) -> tuple[ClassParameter, ...]:
        """The unknown parameters of the laws."""
        return tuple(
            ClassParameter(term, index)
            for term in self.terms
            for index, prior in enumerate(term.priors)
            if prior is not None
        )

    @property
    def n_spring_parameters(self) -> int:
        """Number of unknown parameters of springs, the first of theta."""
        return sum(not each.term.is_damper for each in self.law_parameters)

    @property
    def is_unknown(self) -> NDArray[np.bool_]:
        """(n,) whether each parameter of all terms is unknown."""
        return np.array([prior is not None for each in self.terms for prior in each.priors])

    @cached_property
    def _must_be_positive(self) -> NDArray[np.bool_]:
        """(n,) whether each parameter of all terms is a scale, by which a force divides, or an exponent."""
        own = [each for term in self.terms for each in LAWS[term.kind].parameters]
        return np.array([each.role in ("scale", "exponent") for each in own])

    @property
    def scales(self) -> FloatArray:
        """(n,) the factor that takes theta to each unknown parameter of the laws in its unit."""
        return np.array([each.scale for each in self.law_parameters])

    @property
    def priors(self) -> tuple[Prior, ...]:
        """The prior of each unknown parameter."""
        return tuple(each.prior for each in self.parameters)

    @property
    def law_in_words(self) -> str:
        """The law in short words: "cubic + quintic", "cubic at front + late cubic from 0.5 and 1 mm at rear"."""
        words: dict[tuple[str, str], str] = {}
        gaps: dict[tuple[str, str], list[float]] = {}
        for each in self.terms:
            own = each.kind, each.place
            words[own] = each.words
            if each.gap_m is not None:
                gaps.setdefault(own, []).append(each.gap_m)
                words[own] = f"{short_kind(each.kind)}{_write_start(gaps[own])}{each.place}"
        return " + ".join(words.values())

    @property
    def n_parameters(self) -> int:
        """Number of unknown parameters."""
        return len(self.parameters)

    def with_prior(self, number: int, prior: Prior) -> ModelClass:
        """Return the class with another prior of its parameter `number`, which counts from 0."""
        changed = self.parameters[number]
        if isinstance(changed, StiffnessFactor):
            factors = (replace(each, prior=prior) if each is changed else each for each in self.factors)
            return replace(self, factors=tuple(factors))
        if isinstance(changed, DampingRatio):
            ratios = (replace(each, prior=prior) if each is changed else each for each in self.ratios)
            return replace(self, ratios=tuple(ratios))
        at = changed.index
        priors = (*changed.term.priors[:at], prior, *changed.term.priors[at + 1 :])
        terms = (replace(each, priors=priors) if each is changed.term else each for each in self.terms)
        return replace(self, terms=tuple(terms))

    def coefficients(self, theta: ArrayLike) -> FloatArray:
        """Parameters of all terms in their units, (..., n), for unknown ones theta, (..., n_parameters)."""
        unknown = np.asarray(theta, dtype=np.float64)[..., : len(self.law_parameters)]
        scales = np.array([scale for each in self.terms for scale in each.scales])
        values = np.broadcast_to(scales, (*unknown.shape[:-1], scales.size)).copy()
        values[..., self.is_unknown] *= unknown
        # A prior may end at 0: a friction that reverses within no velocity at all is the limit of very small ones.
        return np.where(self._must_be_positive, np.maximum(values, TINY), values)

    def law(self, joint: str, theta: Sequence[float] | FloatArray) -> TermSet:
        """Return the law of the joint called `joint` for one theta, (n_parameters,); without a term it is linear."""
        values = iter(self.coefficients(theta).tolist())
        terms = [(each, Term(each.kind, tuple(next(values) for _ in each.scales))) for each in self.terms]
        return TermSet(tuple(term for each, term in terms if each.acts_at(joint)))

    def laws(self, joints: Sequence[str], theta: Sequence[float] | FloatArray) -> dict[str, TermSet]:
        """Return the law of each of some joints, by its name, for one theta, (n_parameters,)."""
        return {joint: self.law(joint, theta) for joint in joints}

    def log_prior(self, theta: ArrayLike) -> FloatArray:
        """Logarithm of the prior density of each row of theta, (n, n_parameters) -> (n,)."""
        rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        total = np.sum([prior.log_density(rows[:, k]) for k, prior in enumerate(self.priors)], axis=0)
        # A factor of stiffness and a damping ratio are positive, whatever their priors.
        is_stiff = (rows[:, len(self.law_parameters) :] > 0).all(axis=1)
        return np.where(is_stiff, total, -np.inf)

    def sample_prior(self, n: int, rng: np.random.Generator) -> FloatArray:
        """(n, n_parameters) independent draws."""
        return np.stack([prior.sample(n, rng) for prior in self.priors], axis=1)


OneParameter = ClassParameter | DampingRatio | StiffnessFactor
"""One unknown parameter of a class."""


def group_joints(classes: Sequence[ModelClass], joints: Sequence[str]) -> list[tuple[str, ...]]:
    """Return groups of joints that have the same law in each of the classes.

    >>> everywhere = PAPER_CLASSES[1]
    >>> front = ModelClass("front", (UncertainTerm("cubic_stiffness", (1e8,), (Prior(),), ("a", "b")),))
    >>> group_joints([everywhere, front], ["a", "b", "c"])
    [('a', 'b'), ('c',)]
    """
    groups: dict[tuple[bool, ...], list[str]] = {}
    for joint in joints:
        groups.setdefault(tuple(term.acts_at(joint) for each in classes for term in each.terms), []).append(joint)
    return [tuple(each) for each in groups.values()]


def spline_terms(
    scales: Sequence[float],
    knots_m: Sequence[float],
    priors: Sequence[Prior | None] = (),
    joints: tuple[str, ...] = (),
) -> tuple[UncertainTerm, ...]:
    """Return the terms of an odd cubic spline of the extension, a law whose form is not known.

    f(z) = (k_0 |z|^3 + sum_i k_i (|z| - s_i)_+^3) sgn z has continuous second derivatives: k_0 is the coefficient of a
    cubic spring up to the first knot, and k_i its change at knot s_i. The linear part belongs to the structure.

    Args:
        scales: one for k_0 and for each k_i, N/m^3; with the coefficient that is expected for all, theta is about 1.
        knots_m: knots s_i, m, positive and increasing, below the extensions that the tests reach.
        priors: prior of k_0 and of each k_i over its scale. Where left out, uniform from 0 to 10 for k_0, and normal
            about 0 with the deviation 1 for each k_i, so that knots more than needed cost little evidence.
        joints: names of the joints that have it; all where empty.

    Raises:
        InputError: no knot, knots that are not positive or do not increase, counts that do not match, or a scale or a
            prior that `UncertainTerm` refuses.

    >>> ModelClass("spline", spline_terms([7e7, 7e7], [1e-3])).law_in_words
    'cubic + late cubic from 1 mm'
    """
    knots, n = np.asarray(knots_m, dtype=np.float64), len(knots_m) + 1
    if not (knots.size and np.isfinite(knots).all() and (np.diff(knots, prepend=0.0) > 0.0).all()):
        given = ", ".join(f"{1e3 * knot:g}" for knot in knots) or "none"
        raise InputError(f"the knots of a spline are {given} (mm): give at least one, positive and increasing")
    priors = priors or (Prior(), *(Prior("normal", 0.0, 1.0),) * knots.size)
    if len(scales) != n or len(priors) != n:
        raise InputError(
            f"a spline with {knots.size} knot(s) has {len(scales)} scale(s) and {len(priors)} prior(s): give {n}, for "
            "the cubic part and for each knot"
        )
    first = UncertainTerm("cubic_stiffness", (scales[0],), (priors[0],), joints)
    late = zip(scales[1:], knots.tolist(), priors[1:], strict=True)
    return first, *(UncertainTerm(LATE_CUBIC, (scale, knot), (prior, None), joints) for scale, knot, prior in late)


def short_kind(kind: str) -> str:
    """Return the name of a `kind` of spring, as in `opid.laws.LAWS`, without the word "stiffness".

    >>> short_kind("even_quadratic_stiffness"), short_kind("gas_column")
    ('even quadratic', 'gas column')
    """
    return kind.removesuffix("_stiffness").replace("_", " ")


_FIRST, _SECOND = Prior("uniform", 0.0, 10.0), Prior("uniform", -10.0, 10.0)


def _make_class(name: str, *terms: tuple[str, float, Prior]) -> ModelClass:
    return ModelClass(name, tuple(UncertainTerm(kind, (scale,), (prior,)) for kind, scale, prior in terms))


PAPER_CLASSES = (
    _make_class("class 1", ("quadratic_stiffness", 2.16e5, _FIRST)),
    _make_class("class 2", ("cubic_stiffness", 6.8e7, _FIRST)),
    _make_class("class 3", ("quartic_stiffness", 3e10, _FIRST)),
    _make_class("class 4", ("cubic_stiffness", 8.84e7, _FIRST), ("quartic_stiffness", -2.7e9, _SECOND)),
    _make_class("class 5", ("cubic_stiffness", 7.48e7, _FIRST), ("quintic_stiffness", -8.4e11, _SECOND)),
)
"""The classes of Table 3, with the priors of section 4.2; the table's scales are in N and mm."""

PAPER_THETA: Mapping[str, tuple[float, ...]] = {
    "class 1": (1.63,),
    "class 2": (1.58,),
    "class 3": (1.09,),
    "class 4": (1.34, 1.26),
    "class 5": (1.49, 0.51),
}
"""The means of Table 4."""
