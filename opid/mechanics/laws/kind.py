"""A kind of restoring-force law: a force for unit amplitude, its parameters, and its use."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

ForceAndDerivatives = tuple[Any, Any, Any, Any, Any]
RateAndDerivatives = tuple[Any, Any, Any, Any, Any, Any]
CycleAndDerivatives = tuple[Any, Any, Any, Any, Any, Any]

# least |z| in log(|z|) and |z|^(n-1), which stay finite at z = 0
TINY = 1e-30

Values = tuple[float, ...]


def _give_no_limits(values: Values, rest_m: float) -> tuple[tuple[str, Values], ...]:
    return ()


@dataclass(frozen=True)
class Parameter:
    """One parameter of a kind of law: its name with the unit in it, unit, role and a default that suits a gear.

    The force is proportional to an `amplitude`. A `scale` or an `exponent` is positive, a `lag` or a `shape` any
    number; a search tries several lags, and a shape from its default on. `over_rms` is the range of a scale, in rms
    motions, in which it can be seen: below it friction is a step, above it a straight line. A scale in seconds is
    compared with the ratio of rms travel and rms velocity. `within` is the range in which an exponent is searched,
    `known` are its value and standard deviation before any measurement, and below `stiff_below` a joint with memory has
    a stiffness while nothing slides.
    """

    name: str
    unit: str
    role: Literal["amplitude", "scale", "exponent", "lag", "shape"]
    default: float
    over_rms: tuple[float, float] = (0.01, 3.0)
    within: tuple[float, float] = (0.0, math.inf)
    known: tuple[float, float] | None = None
    stiff_below: float = math.inf

    @property
    def words(self) -> str:
        """The name in words, without its unit: "static force", "gas length"."""
        name = self.name
        if self.role == "amplitude":
            # the unit begins at the first _n of amplitude_n, damping_n_s2_per_m2, stiffness_n_per_m3
            name = name.split("_n")[0]
        return name.removesuffix("_m").removesuffix("_s").removesuffix("_m_per").replace("_", " ")


@dataclass(frozen=True)
class Kind:
    """One kind of law: an amplitude times a force of unit amplitude.

    Args:
        name: the name in files, options and results.
        latex: the force as a formula, with r"\\dot z" for the rate.
        parameters: the amplitude first, then at most two inner parameters, a and b; four with a memory.
        function: function (z, v, a, b) -> the force for unit amplitude and its derivatives by z, v, a and b. It is pure
            and written with numpy, works on arrays and, compiled by numba, on numbers. A parameter that the kind does
            not have is passed, too, and its derivative is 0.0. Squares and products are twenty times faster than z**3.
        searched: whether a search for the law of a suspension tries it. The others are terms of a series that a search
            would mistake for their neighbours; a law has them only if it is named.
        bench_only: whether only the search on a test bench tries it, where the force is measured. Runs do not
            distinguish a free power from the kinds that it contains as special cases.
        is_about_rest: whether its extension is counted from the position at rest, anywhere on the spring's curve: the
            same curve about another position is the same kind with other parameters, and needs no origin.
        quasi_static: inner values of slow loading, None for those that are the same in quick motion; empty where all
            are the same. Such a kind comes to rest on its slow curve and moves from there on its quick one. Its
            amplitude is the force that it carries at its origin; at another extension it carries the fraction 1 less
            its force for unit amplitude.
        limits: function (values, rest_m) -> names and values of kinds that it imitates near some of its values, so well
            that no derivative suggests the exchange; they are about the position at rest, rest_m from its origin.
        is_stop: whether it is a stop, which has no force before it is reached and never pulls.
        is_even: whether its force is the same on both sides of its origin.
        is_pressed: whether it is friction that the load of the spring presses.
        is_friction: whether it is friction or yielding, whose force differs from run to run independently of springs
            and dampers.
        memory: None for a force of travel and velocity alone. A kind with memory has a state h: the function
            (h, v, a, b, c, u) -> h' and its derivatives by h, v, a, b and c. Its force for unit amplitude is h + d h',
            its inner parameters are a, b, c and d in this order, d = 0 where there is none, and `function` is the force
            of a slow motion that goes on in one direction.
        elements: values of u, one for each of several memories side by side.
        weights: weights of the elements, whose sum is 1: the force is their weighted mean.
        limit: largest |h|, at which an element slips. Such a kind has no d, and until it slips h moves with the travel:
            h' is v times a function of a, b, c and u.
        memory_start: standard deviation of h where a record begins, in the unit of h.
        cycle: function (z, reach, a, b, c) -> the mean of the forces of both directions at z, for unit amplitude, of a
            steady cycle between -reach and reach, less the force of the stiffness while nothing slides, and its
            derivatives by z, reach, a, b and c; nan where that stiffness has no end. It is odd in z.
        cycle_loss: function (reach, a, b, c) -> the energy that is lost in such a cycle, for unit amplitude.
    """

    name: str
    latex: str
    parameters: tuple[Parameter, ...]
    function: Callable[..., ForceAndDerivatives] = field(repr=False)
    searched: bool = True
    bench_only: bool = False
    is_about_rest: bool = False
    quasi_static: tuple[float | None, ...] = ()
    limits: Callable[[Values, float], tuple[tuple[str, Values], ...]] = field(default=_give_no_limits, repr=False)
    is_stop: bool = False
    is_even: bool = False
    is_pressed: bool = False
    is_friction: bool = False
    memory: Callable[..., RateAndDerivatives] | None = field(default=None, repr=False)
    elements: tuple[float, ...] = (1.0,)
    weights: tuple[float, ...] = (1.0,)
    limit: float = math.inf
    memory_start: float = 0.0
    cycle: Callable[..., CycleAndDerivatives] | None = field(default=None, repr=False)
    cycle_loss: Callable[..., Any] | None = field(default=None, repr=False)

    @property
    def slides(self) -> bool:
        """Whether it is friction that slides after some travel and has one memory."""
        return self.memory is not None and self.is_friction and not self.slips

    @property
    def slips(self) -> bool:
        """Whether its memories are elements that slip."""
        return self.memory is not None and self.limit < math.inf
