"""A fit as result.json holds it, and the model that it is again for a record of the same sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from opid.errors import InputError, list_names, nearest, refuse
from opid.mechanics.laws.law import default_law
from opid.signals.recording import FloatArray
from opid.suspensions.candidates import Arrays, prepare_alone, prepare_rigid
from opid.suspensions.model.driven_model import Model
from opid.suspensions.model.unknowns import Group
from opid.suspensions.result import Evidence, Identification
from opid.suspensions.sensor_facts import Sensors
from opid.suspensions.settings import Settings
from opid.suspensions.study import Study

# number of a record that is no run of the fit
_NO_RUN = -1


@dataclass(frozen=True)
class StoredGroup:
    """Interfaces that share a suspension.

    Args:
        name: name of the group; empty for one gear.
        members: indices of its interfaces in the fit.
        law: name of its law.
        has_ground: whether a spring to the ground is fitted.
        origin_m: approximate distance of the origin of the law from the position of rest; None if the law rests there.
    """

    name: str
    members: tuple[int, ...]
    law: str
    has_ground: bool
    origin_m: float | None


@dataclass(frozen=True)
class StoredFit:
    """A fit with the covariance of its vector.

    Args:
        kind: kind of the structure.
        interfaces: names of its interfaces.
        runs: names of its runs, in the order in which their entries follow the shared ones in the vector.
        groups: groups of interfaces.
        sensors: facts known of the sensors, with faults that the runs demanded.
        noise_m_per_s2: noise of each sensor below the suspensions and on the body.
        over_noise: residual of the fit over this noise.
        motion_rms: rms travel (m) and velocity (m/s) of each interface.
        names: names of the shared entries of the vector.
        vector: all entries of the vector.
        covariance: covariance of the vector, row by row.
        has_mass: whether the mass is given; if not, forces are per unit of mass.
        is_mass_fitted: whether one over the mass is an entry of the vector.
        held_inverse_mass: one over the mass if it is no entry, 1/kg; 0 for ratios alone.
        repeatability: relative standard deviation of springs, damping and friction from run to run.
        band_hz: band in which readings were compared.
        rate_hz: steps of the model a second.
        forgets: whether the first periods of a run were not compared.
    """

    kind: Literal["single", "pair", "rigid_body"]
    interfaces: tuple[str, ...]
    runs: tuple[str, ...]
    groups: tuple[StoredGroup, ...]
    sensors: Sensors
    noise_m_per_s2: tuple[tuple[float, ...], tuple[float, ...]]
    over_noise: float
    motion_rms: tuple[tuple[float, ...], ...]
    names: tuple[str, ...]
    vector: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    has_mass: bool
    is_mass_fitted: bool
    held_inverse_mass: float
    repeatability: float
    band_hz: tuple[float, float]
    rate_hz: float
    forgets: bool


def store_fits(result: Identification) -> tuple[StoredFit, ...]:
    """Return the fits that an answer consists of; none if it gives no number with an interval.

    Args:
        result: an identification by the model.
    """
    given = [each for interface in result.interfaces for _, each in interface.items()]
    if result.is_refused or not any(each.std for each in given):
        return ()
    return tuple(_store_fit(result, each) for each in result.evidence)


def take_fits(
    result: Identification | Sequence[StoredFit], estimator: Settings | None
) -> tuple[tuple[StoredFit, ...], Settings]:
    """Return the fits of an identification, or those of a result.json, and the settings that they were made with.

    Args:
        result: an identification by the model, or its fits.
        estimator: the settings if they are known; those of the identification, or the usual ones, if not.
    """
    if isinstance(result, Identification):
        return store_fits(result), estimator or result.settings
    return tuple(result), estimator or Settings()


def _store_fit(result: Identification, evidence: Evidence) -> StoredFit:
    fit, model = evidence.fit, evidence.fit.model
    below, above = (tuple(np.atleast_1d(side).tolist()) for side in model.noise)
    is_alone = model.body.dof == ("heave",)
    return StoredFit(
        kind="rigid_body" if not is_alone else "single" if len(evidence.interfaces) == 1 else "pair",
        interfaces=tuple(result.study.names[k] for k in evidence.interfaces),
        runs=tuple(run.name for run in result.study.runs),
        groups=tuple(
            StoredGroup(group.name, group.members, group.law.name, group.ground, group.origin_m)
            for group in model.groups
        ),
        sensors=model.sensors,
        noise_m_per_s2=(below, above),
        over_noise=fit.ratio,
        motion_rms=tuple(map(tuple, model.motion_rms.tolist())),
        names=model.names,
        vector=tuple(fit.theta.tolist()),
        covariance=tuple(map(tuple, evidence.covariance.tolist())),
        has_mass=not result.per_mass and model.inverse_mass(fit.theta) > 0.0,
        is_mass_fitted=model.mass_free,
        held_inverse_mass=model.held_inverse_mass,
        repeatability=model.repeatability,
        band_hz=model.settings.runs.band_hz,
        rate_hz=model.runs[0].fs,
        forgets=model.forgets,
    )


@dataclass(frozen=True, eq=False)
class KnownModel:
    """The model of one record, with what is known of its vector.

    Args:
        model: the model; the record is its only run.
        mean: (n_unknowns,) expected vector.
        covariance: (n_unknowns, n_unknowns) its covariance.
        is_of_run: whether the record is a run of the fit, whose readings the vector knows already.
    """

    model: Model
    mean: FloatArray
    covariance: FloatArray
    is_of_run: bool


def restore_model(fit: StoredFit, study: Study, arrays: Arrays, settings: Settings, *, is_run: bool) -> KnownModel:
    """Return the model of a fit for a record of the same sensors.

    Args:
        fit: the fit.
        study: the study with the record as its only run.
        arrays: accelerations of the record.
        settings: settings of the estimator.
        is_run: whether the record is one of the runs of the fit.

    Raises:
        InputError: a result of other interfaces or of the mean of several, an unknown law, or a record that is too
            short.
    """
    _require_sound_fit(fit)
    unknown = [name for name in fit.interfaces if name not in study.names]
    if unknown or (fit.kind == "rigid_body" and fit.interfaces != study.names):
        raise InputError(
            f"the result is of {_list_names(fit.interfaces)}, and the study has {_list_names(study.names)}: give the "
            "result of this study"
        )
    if fit.kind == "pair":
        raise InputError(
            f"the result is of the mean of {' and '.join(fit.interfaces)}, which does not tell the force of either: "
            'identify the study again with kind = "single" or "rigid_body" in [structure]'
        )
    known = replace(settings, runs=replace(settings.runs, band_hz=fit.band_hz))
    if fit.kind == "single":
        picked = (study.names.index(fit.interfaces[0]),)
        data = prepare_alone(study, arrays, study.sensor_facts(), picked, settings=known)
    else:
        data = prepare_rigid(study, arrays, study.sensor_facts(), settings=known)
    finer = max(1, round(fit.rate_hz / data.runs[0].fs))
    # What differs from run to run, as clocks do, is that of the run of the fit; a further record has none of it.
    if is_run and study.runs[0].name not in fit.runs:
        raise InputError(
            f"the result is of runs {list_names(map(repr, fit.runs))}, and the study has run {study.runs[0].name!r}: "
            "give the result of this study"
        )
    number = fit.runs.index(study.runs[0].name) if is_run else _NO_RUN
    runs = tuple(replace(run if finer == 1 else run.sample_finer(finer), number=number) for run in data.runs)
    groups = tuple(
        Group(each.name, each.members, default_law(each.law), each.has_ground, each.origin_m) for each in fit.groups
    )
    usual = settings.repeatability.usual if study.repeatability is None else study.repeatability
    model = Model(
        runs,
        data.body,
        groups,
        fit.sensors,
        fit.is_mass_fitted,
        np.array(fit.motion_rms),
        known,
        repeatability=fit.repeatability if is_run else fit.repeatability or usual,
        held_inverse_mass=fit.held_inverse_mass,
        noise=(np.array(fit.noise_m_per_s2[0]), np.array(fit.noise_m_per_s2[1])),
        forgets=fit.forgets,
    )
    vector, covariance = np.array(fit.vector), np.array(fit.covariance)
    if model.names != fit.names or covariance.shape != (vector.size, vector.size):
        raise InputError(
            "the result has other parameters than a model of this study: the study has changed, or the result is of "
            "another one; identify it again"
        )
    shared = list(range(model.n_shared))
    if is_run:
        n_own = (vector.size - model.n_shared) // len(fit.runs)
        first = model.n_shared + n_own * fit.runs.index(study.runs[0].name)
        kept = [*shared, *range(first, first + n_own)]
        return KnownModel(model, vector[kept], covariance[np.ix_(kept, kept)], True)
    n = model.n_shared + model.n_own
    known_before = np.zeros((n, n))
    known_before[: len(shared), : len(shared)] = covariance[: len(shared), : len(shared)]
    own = np.arange(len(shared), n)
    starts = model.indices_of_run(0)[0]
    known_before[own, own] = model.repeatability**2
    at_start = settings.runs.start_rms * model.motion_rms.ravel()
    known_before[range(starts.start, starts.stop), range(starts.start, starts.stop)] = at_start**2
    return KnownModel(model, np.concatenate([vector[: len(shared)], np.zeros(own.size)]), known_before, False)


def _require_sound_fit(fit: StoredFit) -> None:
    """Refuse a fit that no identification leaves: what a file says may be lost in part, or edited."""
    n, n_interfaces = len(fit.vector), len(fit.interfaces)
    rows = [len(row) for row in fit.covariance]
    sides = [len(side) for side in fit.noise_m_per_s2]
    rms = [len(row) for row in fit.motion_rms]
    if rows != [n] * n or rms != [2] * n_interfaces or not n or not fit.runs or len(fit.names) > n or 0 in sides:
        raise InputError(
            f"the fit in the result has {n} values, a covariance of {len(rows)} rows, and the motion of {len(rms)} of "
            f"{n_interfaces} interfaces, which do not belong together: identify the study again"
        )
    refuse([f"the fit in the result {fault}: identify the study again" for fault in _find_faults(fit)], None)


def _find_faults(fit: StoredFit) -> Iterator[str]:
    """Yield what is wrong with a fit whose lists belong together."""
    if not _is_covariance(np.array(fit.covariance)):
        yield "has a covariance that is none"
    if fit.is_mass_fitted and "inverse_mass" not in fit.names:
        yield f"names no 'inverse_mass' among its values ({nearest('inverse_mass', fit.names)})"
    for name, value in zip(fit.names, fit.vector, strict=False):
        if name == "inverse_mass" and not value > 0.0:
            yield f"has the inverse mass {value:g} 1/kg, which is not positive"
    for what, number in (("held inverse mass", fit.held_inverse_mass), ("repeatability", fit.repeatability)):
        if number < 0.0:
            yield f"has the {what} {number:g}, which is negative"
    for what, table in (("noise", fit.noise_m_per_s2), ("motion", fit.motion_rms)):
        if not all(each > 0.0 for row in table for each in row):
            yield f"has a {what} that is not positive"
    if not fit.rate_hz > 0.0:
        yield f"has the rate {fit.rate_hz:g} Hz, which is not positive"
    if sorted(k for group in fit.groups for k in group.members) != [*range(len(fit.interfaces))]:
        yield "has groups of other interfaces than its own"


def _is_covariance(covariance: FloatArray) -> bool:
    """Return whether a matrix is symmetric and has no negative eigenvalue, but for rounding."""
    variances = np.diag(covariance)
    std = np.sqrt(np.maximum(variances, np.finfo(float).tiny))
    correlation = covariance / np.outer(std, std)
    is_symmetric = np.allclose(correlation, correlation.T, atol=1e-6)
    return bool(variances.min() >= 0.0 and is_symmetric and np.linalg.eigvalsh(correlation)[0] > -1e-6 * len(std))


def _list_names(names: Sequence[str]) -> str:
    return f"interface{'s' * (len(names) > 1)} {', '.join(map(repr, names))}"
