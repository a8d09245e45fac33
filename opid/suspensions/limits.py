"""What limits the precision of an answer, what would better it, and which faults pass for a spring to the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.driven import UnboundedResponseError
from opid.signals.recording import FloatArray
from opid.suspensions.faults import GROUND
from opid.suspensions.fit import Fit, carried_over, rows_with_departures
from opid.suspensions.model import Model
from opid.suspensions.repeatability import Repeatability
from opid.suspensions.settings import IntervalSettings

if TYPE_CHECKING:
    from opid.suspensions.intervals import Parameters

_WORDS = {"gain": "gain", "corner": "AC-coupling corner", "lag": "lag", "leak": "cross-axis leak"}


@dataclass(frozen=True)
class GroundImitations:
    """How well a spring to the ground is told from nothing, and from faults of the sensors.

    Args:
        std_per_mass: standard deviation that K3/M2 has, or would have if it were free, 1/s^2, of each group; None where
            it cannot be said.
        sentences: the faults that pass for a ground spring, one sentence each.
    """

    std_per_mass: tuple[float | None, ...]
    sentences: tuple[str, ...]


def limits(known: Parameters, alike: Repeatability, mass: Estimate) -> Iterator[str]:
    """Yield what limits the mass and the laws, one sentence each.

    Args:
        known: parameters of a fit.
        alike: how much alike its runs are.
        mass: as it is told; nothing where it is not.
    """
    fit, covariance = known.fit, known.covariance
    yield from limits_of_mass(alike, fit, mass)
    if mass.std is not None:
        yield from _named(fit, covariance, fit.model.names.index("inverse_mass"), "the mass")
    for number in range(len(fit.model.groups)):
        places = fit.model.law_places(number)
        for place in range(places.start, places.stop):
            sentences = list(_named(fit, covariance, place, "the law"))
            if sentences:
                yield sentences[0]
                return


def limits_of_mass(alike: Repeatability, fit: Fit, mass: Estimate) -> Iterator[str]:
    """Yield which part of the interval of the mass is noise and which repeatability, and what would help most.

    Args:
        alike: how much alike the runs of a fit are.
        fit: of them.
        mass: as it is told; nothing where it is not.
    """
    if mass.value is not None and mass.std is not None:
        yield _interval_in_words(alike, 196 * mass.std / mass.value)
    if len(fit.model.runs) > 1:
        yield from _repeatability_in_words(alike)
    if mass.value is not None and mass.std is not None:
        yield from _what_would_help(alike, fit, mass.value)


def _interval_in_words(alike: Repeatability, percent: float) -> str:
    if alike.mass_if_alike is None:
        return f"the mass is known to +-{percent:.2g} %, all of it from the sensors' noise"
    noise = percent * alike.mass_if_alike
    return (
        f"the mass is known to +-{percent:.2g} %: +-{noise:.2g} % from the sensors' noise, "
        f"+-{float(np.sqrt(percent**2 - noise**2)):.2g} % from suspensions that may differ from run to run"
    )


def _repeatability_in_words(alike: Repeatability) -> Iterator[str]:
    if alike.estimated is not None:
        source = "the usual value, for the study states no `repeatability`" if alike.is_usual else "the stated value"
        yield (
            "the repeatability, by which stiffness, damping and friction differ from run to run, is taken to be "
            f"{100 * alike.stated:.2g} % ({source}); these runs show {100 * alike.estimated:.1g} %"
            f"{', and are too few to prove it' * alike.rules_mass}"
        )
    elif alike.stated == 0:
        yield "stiffness, damping and friction are stated to be the same in all runs (`repeatability = 0`)"


def _what_would_help(alike: Repeatability, fit: Fit, mass: float) -> Iterator[str]:
    runs = fit.model.runs
    # of several suspensions no single number says how much of the body a loading is
    changes = [float(run.loading[0, 0]) for run in runs] if fit.model.body.n_slots == 1 else [0.0]
    fraction = (max(changes) - min(changes)) / mass
    if fraction > 0:
        yield (
            f"the mass change is {100 * fraction:.0f} % of the mass, so that 1 % of stiffness in one run looks like "
            f"{1 / fraction:.0f} % of mass"
        )
    double = "twice the mass change" if fraction > 0 else "twice the loading"
    if alike.rules_mass:
        flown_twice = len({run.loading.tobytes() for run in runs}) < len(runs)
        again = "further runs with the masses in turn" if flown_twice else "each mass flown once more, in turn"
        yield (
            f"what would help most: {again}, for the runs then show how much alike they are; {double} would halve the "
            "interval"
        )
    else:
        duration_s = sum(len(run.sprung) / run.recorded_fs for run in runs)
        yield (
            f"what would help most: {double}, or four times the {duration_s:.0f} s of running; either would halve the "
            "interval"
        )
    if alike.mass_if_alike is not None:
        yield (
            "a run whose stiffness, damping and friction have all changed by one ratio cannot be told from one with "
            "another mass change: weigh what is added or taken off"
        )


def _named(fit: Fit, covariance: FloatArray, place: int, what: str) -> Iterator[str]:
    """The fault of the sensors without which the interval would be narrower by most."""
    faults, own = fit.model.faults, covariance[place, place]
    if not faults or own <= 0:
        return
    # the variance that is left once a fault is known: Schur complement
    left = []
    for fault in faults:
        k = fit.model.names.index(fault.name)
        left.append(own - covariance[place, k] ** 2 / max(covariance[k, k], 1e-300))
    best = int(np.argmin(left))
    widening = float(np.sqrt(own / max(left[best], 1e-300)))
    if widening > fit.model.settings.intervals.widening_named:
        fault = faults[best]
        side = "" if fault.kind in ("lag", "leak") else f" of the {fault.side} sensor"
        name = fit.model.sensors.names[fault.channel]
        where = f" at {name!r}" if name else ""
        times = f"{widening:.1f} times" if widening < 10 else "more than ten times"
        yield (
            f"{what} is limited by the {_WORDS[fault.kind]}{side}{where}, which widens its interval {times}: calibrate "
            "it and state a smaller tolerance"
        )


def ground_imitations(fit: Fit) -> GroundImitations:
    """Return how well springs to the ground are told from nothing and, of one gear, from faults of the sensors.

    The derivatives of the prediction errors by the spring and by a fault are compared once everything else that is
    fitted is taken out of both.
    """
    model = replace(fit.model, groups=tuple(replace(group, ground=True) for group in fit.model.groups))
    is_one = len(fit.model.sensors.sprung) == 1
    values: dict[str, float] = {}
    if is_one:
        model, values = _with_usual_faults(model, fit)
    try:
        errors = model.evaluate(carried_over(fit, model, values))
    except UnboundedResponseError:
        return GroundImitations((None,) * len(model.groups), ())
    jacobian = errors.jacobian[rows_with_departures(fit, model)]
    size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    gram = (jacobian / size).T @ (jacobian / size)
    names = list(model.names)
    springs = [names.index(group.called(GROUND)) for group in model.groups]
    kept = [names.index(name) for name in fit.model.names if name in names]
    fitted = [*kept, *range(len(names), size.size)]
    std = []
    for spring in springs:
        beside = [k for k in fitted if k != spring]
        alone = _schur(gram, beside, [spring])[0, 0]
        std.append(float(np.sqrt(fit.variance / max(alone, 1e-300))) / float(size[spring]))
    sentences = tuple(_sentences(gram, size, names, springs[0], fit)) if is_one else ()
    return GroundImitations(tuple(std), sentences)


def _with_usual_faults(model: Model, fit: Fit) -> tuple[Model, dict[str, float]]:
    """The model of one gear in which all usual faults are free, and values of those that cannot stay as they are."""
    settings, sensors, values = model.settings, model.sensors, dict[str, float]()
    for side in ("unsprung", "sprung"):
        corner_hz = sensors.facts(side)[0].corner_hz or settings.intervals.imitating_slight_hz
        tolerance = settings.faults.corner_tolerance
        sensors = sensors.changed(side, 0, corner_hz=corner_hz, corner_tolerance=tolerance)
    sensors = sensors.changed("unsprung", 0, gain_tolerance=0.0)
    gain, lag_s = settings.intervals.imitating_gain, settings.intervals.imitating_lag_s
    sensors = sensors.changed("sprung", 0, gain_tolerance=gain, lag_tolerance_s=lag_s)
    if "gain_unsprung" in fit.model.names:
        # only the ratio of the gains is seen
        values["gain_sprung"] = (fit.value("gain_sprung") or 1.0) / fit.value("gain_unsprung")
    return replace(model, sensors=sensors), values


def _schur(gram: FloatArray, others: list[int], kept: list[int]) -> FloatArray:
    """Products of columns once what others do is taken out of them."""
    cross = gram[np.ix_(kept, others)]
    inverse = np.linalg.pinv(gram[np.ix_(others, others)], rcond=1e-13, hermitian=True)
    return np.asarray(gram[np.ix_(kept, kept)] - cross @ inverse @ cross.T)


def _usual_faults(settings: IntervalSettings) -> tuple[tuple[str, str, float], ...]:
    """Faults of the sensors of the first interface: name, how it is said, size."""
    gain, corner_hz, lag_s = settings.imitating_gain, settings.imitating_corner_hz, settings.imitating_lag_s
    return (
        ("gain_sprung", f"{100 * gain:g} % of gain error between the sensors", gain),
        ("corner_sprung_hz", f"an AC coupling at {corner_hz:g} Hz of the sprung sensor alone", corner_hz),
        ("corner_unsprung_hz", f"an AC coupling at {corner_hz:g} Hz of the unsprung sensor alone", corner_hz),
        ("lag_s", f"a lag of {1e3 * lag_s:g} ms between the channels", lag_s),
    )


def _sentences(gram: FloatArray, size: FloatArray, names: list[str], spring: int, fit: Fit) -> Iterator[str]:
    settings = fit.model.settings.intervals
    faults = _usual_faults(settings)
    places = [spring, *(names.index(name) for name, _, _ in faults)]
    others = [k for k in range(size.size) if k not in places]
    left = _schur(gram, others, places) * np.outer(size[places], size[places])
    stiffness = float(fit.theta[0])
    for k, (_, words, usual) in enumerate(faults, start=1):
        cosine = left[0, k] / max(float(np.sqrt(max(left[0, 0] * left[k, k], 0.0))), 1e-300)
        feigned = usual * left[0, k] / max(left[0, 0], 1e-300) / stiffness
        if abs(cosine) > settings.alike_cosine:
            yield f"{words} passes for a ground spring of {100 * feigned:.2g} % of K2 (alike to {abs(cosine):.2f})"
