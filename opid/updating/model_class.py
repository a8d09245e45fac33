"""Model classes: sums of laws whose coefficients are updated, scaled to be near 1, with their priors.

The five classes of Song et al. (2021) follow at the end.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from opid.errors import InputError, nearest
from opid.mechanics.laws.kinds import LAWS
from opid.mechanics.laws.law import Law, Term
from opid.signals.recording import FloatArray

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

    @property
    def wider(self) -> Prior:
        """The prior twice as wide about the same centre."""
        if self.family == "uniform":
            half = (self.second - self.first) / 2
            return Prior("uniform", self.first - half, self.second + half)
        return Prior(self.family, self.first, 2 * self.second)

    def log_density(self, value: ArrayLike) -> FloatArray:
        """Logarithm of the density, of the shape of `value`; -inf outside the support."""
        return np.asarray(self._distribution.logpdf(value))

    def sample(self, n: int, rng: np.random.Generator) -> FloatArray:
        """(n,) independent draws."""
        return np.asarray(self._distribution.rvs(n, rng))


@dataclass(frozen=True)
class ModelClass:
    """One candidate law of the joints: f(z) = sum theta_i scale_i g_i(z), the same at all joints.

    Args:
        name: the name of the class.
        kinds: names of the kinds in `opid.laws.LAWS`, each with an amplitude and no other parameter.
        scales: factor of each parameter, in the unit of the kind's amplitude; it may be negative.
        priors: one prior for each parameter.

    Raises:
        InputError: an unknown kind, one with inner parameters or of velocity, counts that do not match, a scale of 0.

    >>> cubic = ModelClass("class 2", ("cubic_stiffness",), (6.8e7,), (Prior("uniform", 0, 10),))
    >>> cubic.law([1.58]).parameters
    {'cubic_stiffness': {'stiffness_n_per_m3': 107440000.0}}
    """

    name: str
    kinds: tuple[str, ...]
    scales: tuple[float, ...]
    priors: tuple[Prior, ...]

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in LAWS:
                raise InputError(f"class {self.name!r}: there is no law {kind!r}: {nearest(kind, LAWS)}")
            if len(LAWS[kind].parameters) != 1 or "damping" in kind:
                raise InputError(
                    f"class {self.name!r}: {kind!r} is not a spring with one coefficient: take another law"
                )
        if not self.kinds or not len(self.kinds) == len(self.scales) == len(self.priors):
            raise InputError(
                f"class {self.name!r} has {len(self.kinds)} law(s), {len(self.scales)} scale(s) and {len(self.priors)} "
                "prior(s): give one of each for every law"
            )
        if len(set(self.kinds)) < len(self.kinds):
            raise InputError(f"class {self.name!r} names a law twice: name each once")
        if not all(np.isfinite(scale) and scale for scale in self.scales):
            raise InputError(f"class {self.name!r} has the scales {self.scales}: give numbers other than 0")

    @property
    def law_in_words(self) -> str:
        """The law in short words: "cubic + quintic"."""
        return " + ".join(map(short_kind, self.kinds))

    @property
    def n_parameters(self) -> int:
        """Number of parameters."""
        return len(self.kinds)

    def coefficients(self, theta: ArrayLike) -> FloatArray:
        """theta times the scales, of the shape of theta, (..., n_parameters)."""
        return np.asarray(theta, dtype=np.float64) * np.array(self.scales)

    def law(self, theta: Sequence[float] | FloatArray) -> Law:
        """Return the law for one theta, (n_parameters,)."""
        values = self.coefficients(theta)
        return Law(tuple(Term(kind, (float(value),)) for kind, value in zip(self.kinds, values, strict=True)))

    def log_prior(self, theta: ArrayLike) -> FloatArray:
        """Logarithm of the prior density of each row of theta, (n, n_parameters) -> (n,)."""
        rows = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        return np.sum([prior.log_density(rows[:, k]) for k, prior in enumerate(self.priors)], axis=0)

    def sample_prior(self, n: int, rng: np.random.Generator) -> FloatArray:
        """(n, n_parameters) independent draws."""
        return np.stack([prior.sample(n, rng) for prior in self.priors], axis=1)


def short_kind(kind: str) -> str:
    """Return the name of a `kind` of spring, as in `opid.laws.LAWS`, without the word "stiffness".

    >>> short_kind("even_quadratic_stiffness"), short_kind("gas_column")
    ('even quadratic', 'gas column')
    """
    return kind.removesuffix("_stiffness").replace("_", " ")


_FIRST, _SECOND = Prior("uniform", 0.0, 10.0), Prior("uniform", -10.0, 10.0)

PAPER_CLASSES = (
    ModelClass("class 1", ("quadratic_stiffness",), (2.16e5,), (_FIRST,)),
    ModelClass("class 2", ("cubic_stiffness",), (6.8e7,), (_FIRST,)),
    ModelClass("class 3", ("quartic_stiffness",), (3e10,), (_FIRST,)),
    ModelClass("class 4", ("cubic_stiffness", "quartic_stiffness"), (8.84e7, -2.7e9), (_FIRST, _SECOND)),
    ModelClass("class 5", ("cubic_stiffness", "quintic_stiffness"), (7.48e7, -8.4e11), (_FIRST, _SECOND)),
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
