"""A user's own structure on suspensions that are measured on both sides: laws, springs inside and masses, found.

A machine on isolators, a car on its dampers, a building on its bearings: mass matrix and connections are given, and of
the entries that are not known the runs tell.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from opid.errors import InputError, nearest
from opid.estimate import Estimate
from opid.identify.band_lines import BAND_HZ
from opid.identify.body.candidates import EXPLAINS, Fitted, fitted, mass_is_told
from opid.identify.body.equation import HIGH_PASS_HZ, Start
from opid.identify.body.fit import BodyFit, body_model, first_vector
from opid.identify.body.intervals import mass_of, per_force, suspension_estimates
from opid.identify.body.levels import (
    LOOSELY_KNOWN,
    REFUSED,
    WITHHELD,
    is_white,
    level_of,
    noise_levels,
    thinned,
    widened,
)
from opid.identify.body.model import Group
from opid.identify.body.run import BodyRun, body_run
from opid.identify.body.structure import Body, own_body
from opid.identify.study import SAME_RATE
from opid.mechanics.laws import LINEAR, Law, default_law
from opid.mechanics.structure import Structure
from opid.signals.health import without_spikes
from opid.signals.motion import integrate
from opid.signals.recording import FloatArray, Recording

# the step puts a motion of this rate times its length off by two parts in a thousand
FASTEST = 0.7


@dataclass(frozen=True, eq=False)
class SpringEstimate:
    """A suspension, or a joint inside of the structure.

    Args:
        name: of the degree of freedom that the suspension carries, or of the joint.
        stiffness: K, N/m; per kg of the first unknown mass where no mass is determined.
        damping: C, N s/m, likewise.
        law: f(z, z') beside them, N, likewise; linear for a joint.
        law_estimates: {kind: {parameter: Estimate}} of it.
        travel: (n,) z of all runs, thinned for figures, m.
        velocity: (n,) z', m/s.
    """

    name: str
    stiffness: Estimate
    damping: Estimate
    law: Law
    law_estimates: Mapping[str, Mapping[str, Estimate]]
    travel: FloatArray
    velocity: FloatArray


@dataclass(frozen=True, eq=False)
class StructureIdentification:
    """The result for a user's own structure.

    Args:
        masses: of the degrees of freedom whose mass was to be found, kg; over the first of them with `per_mass`.
        interfaces: the suspensions, by degree of freedom.
        joints: the joints that were to be found, by name.
        per_mass: whether only ratios to the first unknown mass are told.
        noise_m_per_s2: level of the sensors that was known beforehand or estimated from the records.
        residual_over_noise: of the whole fit.
        residual_of: of the sensor at each degree of freedom.
        left_out_over_noise: of runs that the others predict; None for a single run.
        warnings: what to doubt, one sentence each.
        not_determined: what the runs do not tell; None if they tell all.
        fit: what the numbers were read from.
    """

    masses: Mapping[str, Estimate]
    interfaces: Mapping[str, SpringEstimate]
    joints: Mapping[str, SpringEstimate]
    per_mass: bool
    noise_m_per_s2: float
    residual_over_noise: float
    residual_of: Mapping[str, float]
    left_out_over_noise: float | None
    warnings: tuple[str, ...]
    not_determined: str | None
    fit: BodyFit


def identify_structure(
    structure: Structure,
    runs: Sequence[Recording],
    *,
    interfaces: Mapping[str, str],
    sensors: Mapping[str, str],
    unknown: Sequence[str] = (),
    unknown_mass: Sequence[str] = (),
    law: str | None = None,
    loadings: Sequence[Mapping[str, float]] | None = None,
    start: Mapping[str, tuple[float, float]] | None = None,
    noise_m_per_s2: float | None = None,
    band_hz: tuple[float, float] = BAND_HZ,
    progress: Callable[[str], None] | None = None,
) -> StructureIdentification:
    """Identify the suspensions of a structure, and the joints and masses of it that are not known.

    Every sensor on the structure is predicted from all sensors below its suspensions. What the structure says of an
    unknown joint or mass is where to begin if the sensors do not see all degrees of freedom, and unused otherwise.

    Args:
        structure: mass, damping and stiffness matrices, and linear joints, of what the suspensions carry.
        runs: recordings of accelerations, m/s^2, all at one rate.
        interfaces: channel below each suspension, by the degree of freedom that it carries.
        sensors: channel on the structure, by degree of freedom.
        unknown: names of joints whose stiffness and damping are to be found.
        unknown_mass: degrees of freedom whose mass is to be found. In kg if another mass or spring is known or the
            loading changes, as ratios to the first of them else.
        law: of every suspension (`opid.mechanics.laws.LAWS`, sums joined by "+"); searched where left out.
        loadings: for each run the masses, kg, that it carries more than the structure, by degree of freedom.
        start: stiffness (N/m) and damping (N s/m) of each suspension, roughly, by degree of freedom: needed where the
            sensors do not see all degrees of freedom.
        noise_m_per_s2: rms of the white noise of all sensors, m/s^2; estimated where left out.
        band_hz: lines of the prediction errors that count, Hz.
        progress: called with the name of each step as it begins.

    Raises:
        InputError: unknown names, runs of different rates, loadings that are not one a run, or no start where one is
            needed.
        NotDeterminedError: the model cannot follow the runs.

    >>> carrier = Structure([[300.0]], [[0.0]], [[0.0]], names=("body",))
    >>> identify_structure(carrier, [], interfaces={"body": "hub"}, sensors={"body": "tower"})
    Traceback (most recent call last):
    opid.errors.InputError: there are no runs: give at least one recording
    """
    body = own_body(structure, tuple(interfaces), tuple(sensors), unknown=unknown, unknown_mass=unknown_mass)
    arrays = _arrays(runs, interfaces, sensors)
    masses = _loadings(structure, loadings, len(runs))
    fs = runs[0].fs
    noises = noise_levels(noise_m_per_s2, arrays, fs=fs)
    prepared = [
        body_run(below, above, fs=fs, loading=loading, band_hz=band_hz)
        for (below, above), loading in zip(arrays, masses, strict=True)
    ]
    kinds = None if law is None else default_law(law)
    groups = tuple(Group(name, (slot,), kinds or LINEAR) for slot, name in enumerate(interfaces))
    begun = None
    if np.linalg.matrix_rank(body.readings) < structure.n_dof:
        begun = _stated(structure, prepared, body, groups, start or {}, unknown, unknown_mass)
    part = fitted(
        "own", tuple(range(len(groups))), prepared, body, groups, noises, law=kinds, start=begun, progress=progress
    )
    return _answer(part, tuple(sensors), tuple(unknown), tuple(unknown_mass))


def _arrays(
    runs: Sequence[Recording], interfaces: Mapping[str, str], sensors: Mapping[str, str]
) -> list[tuple[FloatArray, FloatArray]]:
    """Accelerations below and on the structure of each run, single spikes mended."""
    if not runs:
        raise InputError("there are no runs: give at least one recording")
    if not interfaces or not sensors:
        raise InputError(
            "give at least one interface and one sensor on the structure, each as degree of freedom: channel"
        )
    used = [*interfaces.values(), *sensors.values()]
    for name in used:
        if used.count(name) > 1:
            raise InputError(f"the channel {name!r} is named {used.count(name)} times: each sensor is one channel")
    for place, run in enumerate(runs, start=1):
        if abs(run.fs / runs[0].fs - 1) > SAME_RATE:
            raise InputError(f"run 1 has {runs[0].fs:.9g} Hz and run {place} has {run.fs:.9g} Hz: resample one of them")
        for name in used:
            if name not in run.names:
                raise InputError(f"run {place} has no channel {name!r}: {nearest(name, run.names)}")
            if run.unit(name) != "m/s^2":
                raise InputError(f"channel {name!r} of run {place} is in {run.unit(name)}: an acceleration is needed")

    def samples(run: Recording, names: Sequence[str]) -> FloatArray:
        return np.stack([without_spikes(run.channel(name), fs=run.fs)[0] for name in names], axis=1)

    return [(samples(run, tuple(interfaces.values())), samples(run, tuple(sensors.values()))) for run in runs]


def _loadings(structure: Structure, loadings: Sequence[Mapping[str, float]] | None, n_runs: int) -> list[FloatArray]:
    """Mass matrix of what each run carries more than the structure, (n_dof, n_dof) kg."""
    given = [{}] * n_runs if loadings is None else list(loadings)
    if len(given) != n_runs:
        raise InputError(f"there are {len(given)} loadings for {n_runs} run(s): give one a run, {{}} for none")
    matrices = []
    for loading in given:
        diagonal = np.zeros(structure.n_dof)
        for name, mass_kg in loading.items():
            if not np.isfinite(mass_kg):
                raise InputError(f"the loading at {name!r} is {mass_kg}: give a mass in kg")
            diagonal[structure.index(name)] += mass_kg
        matrices.append(np.diag(diagonal))
    return matrices


def _stated(
    structure: Structure,
    runs: Sequence[BodyRun],
    body: Body,
    groups: tuple[Group, ...],
    start: Mapping[str, tuple[float, float]],
    unknown: Sequence[str],
    unknown_mass: Sequence[str],
) -> Start:
    """Start values from what the user says, where the sensors do not see all degrees of freedom."""
    hidden = f"the sensors see {np.linalg.matrix_rank(body.readings)} of {structure.n_dof} degrees of freedom"
    for name in start:
        if name not in [group.name for group in groups]:
            raise InputError(f"start has {name!r}, which is no interface: {nearest(name, [g.name for g in groups])}")
    missing = [group.name for group in groups if group.name not in start]
    if missing:
        raise InputError(
            f"{hidden}: give `start`, stiffness and damping roughly, of the suspension of {', '.join(missing)}"
        )
    joints = {joint.name: (joint.stiffness_n_per_m, joint.damping_n_s_per_m) for joint in structure.joints}
    for name in unknown:
        if joints[name][0] <= 0.0:
            raise InputError(f"{hidden}: give the joint {name!r} a stiffness from which to begin, N/m")
    places = [structure.index(name) for name in unknown_mass]
    mass = np.diag(structure.mass)
    reference = float(mass[places[0]]) if places else 1.0
    # in the order of the slots, as `body.inside` has them
    springs = [start[group.name] for group in groups]
    springs += [joints[spring.name] for spring in body.inside if spring.stiffness_n_per_m is None]
    stiffness, damping = np.array(springs, dtype=np.float64).T / reference
    scaled = tuple(
        replace(group, law=group.law.scaled(1 / reference)) if group.law.terms else group for group in groups
    )
    mass_free = mass_is_told(runs, body)
    of_ground = [[integrate(u, fs=run.fs, high_pass_hz=HIGH_PASS_HZ) for u in run.unsprung.T] for run in runs]
    rms = np.array([[[m.displacement.std(), m.velocity.std()] for m in motions] for motions in of_ground]).mean(axis=0)
    begun = Start(
        scaled,
        stiffness,
        damping,
        mass[places[1:]] / reference,
        1 / reference if mass_free else None,
        rms,
        np.zeros((len(runs), len(groups), 2)),
        0.0,
    )
    # how far the suspensions move, from a first prediction
    model = body_model(runs, body, begun, mass_free=mass_free, noise_m_per_s2=(1.0, 1.0))
    predictions = model.evaluate(first_vector(model, begun), sensitivity=False).predictions
    moved = [[[p.travel[:, k].std(), p.velocity[:, k].std()] for k in range(len(groups))] for p in predictions]
    return replace(begun, motion_rms=np.mean(moved, axis=0))


def _answer(
    part: Fitted, sensors: tuple[str, ...], unknown: tuple[str, ...], unknown_mass: tuple[str, ...]
) -> StructureIdentification:
    fit, covariance, ratio = part.found, widened(part), part.residual_over_noise
    model = fit.model
    per_mass = not (model.mass_free or model.body.absolute)
    masses: dict[str, Estimate] = {}
    for k, name in enumerate(unknown_mass):
        if k:
            masses[name] = per_force(fit, covariance, model.names.index(model.body.names[k - 1]))
        else:
            masses[name] = Estimate(1.0) if per_mass else mass_of(fit, covariance)
    interfaces = {group.name: _suspension(fit, covariance, number) for number, group in enumerate(fit.groups())}
    joints = {name: _joint(fit, covariance, name) for name in unknown}
    reason = _not_determined(masses, interfaces, joints, ratio, per_mass, _too_fast(fit))
    if ratio > WITHHELD:
        keep = ratio <= REFUSED
        masses = {name: _bare(each, keep) for name, each in masses.items()}
        interfaces, joints = ({n: _bare_spring(s, keep) for n, s in t.items()} for t in (interfaces, joints))
    return StructureIdentification(
        masses=masses,
        interfaces=interfaces,
        joints=joints,
        per_mass=per_mass,
        noise_m_per_s2=part.noise,
        residual_over_noise=ratio,
        residual_of={name: level_of(fit, slot) / part.noise for slot, name in enumerate(sensors)},
        left_out_over_noise=None if part.left_out is None else part.left_out / part.noise,
        warnings=tuple(_warnings(fit, ratio)),
        not_determined=reason,
        fit=fit,
    )


def _suspension(fit: BodyFit, covariance: FloatArray, number: int) -> SpringEstimate:
    group = fit.groups()[number]
    stiffness, damping, law = suspension_estimates(fit, covariance, number)
    mu = fit.model.inverse_mass(fit.theta) if fit.model.mass_free else 1.0
    found = group.law.scaled(1 / mu) if group.law.terms else LINEAR
    none = np.empty(0)
    return _moved(fit, group.slots[0], SpringEstimate(group.name, stiffness, damping, found, law, none, none))


def _joint(fit: BodyFit, covariance: FloatArray, name: str) -> SpringEstimate:
    first = fit.model.names.index(f"stiffness_per_mass[{name}]", fit.model.law_places(len(fit.model.groups) - 1).stop)
    stiffness, damping = (per_force(fit, covariance, place) for place in (first, first + 1))
    slot = fit.model.body.n_interfaces + [spring.name for spring in fit.model.body.inside].index(name)
    none = np.empty(0)
    return _moved(fit, slot, SpringEstimate(name, stiffness, damping, LINEAR, {}, none, none))


def _moved(fit: BodyFit, slot: int, bare: SpringEstimate) -> SpringEstimate:
    """Return a suspension or joint with its motion."""
    predictions = fit.errors.predictions
    return replace(
        bare,
        travel=thinned([p.travel[:, slot] for p in predictions]),
        velocity=thinned([p.velocity[:, slot] for p in predictions]),
    )


def _bare(estimate: Estimate, keep: bool) -> Estimate:
    """Without the interval, or without anything."""
    return Estimate(estimate.value if keep else None)


def _bare_spring(spring: SpringEstimate, keep: bool) -> SpringEstimate:
    law = {kind: {name: _bare(e, keep) for name, e in table.items()} for kind, table in spring.law_estimates.items()}
    return replace(
        spring, stiffness=_bare(spring.stiffness, keep), damping=_bare(spring.damping, keep), law_estimates=law
    )


def _not_determined(
    masses: Mapping[str, Estimate],
    interfaces: Mapping[str, SpringEstimate],
    joints: Mapping[str, SpringEstimate],
    ratio: float,
    per_mass: bool,
    too_fast: str,
) -> str | None:
    if ratio > REFUSED:
        return (
            f"the structure leaves {ratio:.0f} times the sensors' noise, so every number of it would be a guess: check "
            "channels, masses and loadings, and which joints there are"
        )
    if per_mass:
        return (
            "no mass is known and all runs have the same loading: only ratios to the first unknown mass are told; give "
            "`loadings` to runs that carried more, or state a mass"
        )
    known = [(f"the mass of {name}", each) for name, each in masses.items()]
    known += [(f"the stiffness of {name}", each.stiffness) for t in (interfaces, joints) for name, each in t.items()]
    loose = [
        name
        for name, each in known
        if each.std is None or each.value is None or each.std > LOOSELY_KNOWN * abs(each.value)
    ]
    # a joint that nothing holds runs to where the steps no longer follow
    if joints and too_fast:
        return f"these runs do not tell the stiffness of {', '.join(joints)}: {too_fast}"
    if loose:
        return f"these runs do not tell {', '.join(loose)}: measure at more places, or change the loading more"
    return None


def _warnings(fit: BodyFit, ratio: float) -> Iterator[str]:
    if ratio > EXPLAINS:
        yield (
            f"the structure leaves {ratio:.2f} times the sensors' noise: a joint, a mass, a law or a degree of "
            "freedom is not as it is described"
        )
        if ratio <= WITHHELD:
            yield f"all intervals are widened {ratio / EXPLAINS:.2g} times for what the structure leaves"
        elif ratio <= REFUSED:
            yield "the intervals are withheld: what the structure leaves is no noise"
    elif not is_white(fit):
        yield "what the structure leaves is not white: the intervals allow for it, a law may be missing"
    if too_fast := _too_fast(fit):
        yield too_fast


def _too_fast(fit: BodyFit) -> str:
    rate, fs = fastest_rate(fit), fit.model.runs[0].fs
    if rate <= FASTEST * fs:
        return ""
    return (
        f"the structure has a motion of {rate / (2 * np.pi):.3g} Hz, too fast for steps of {fs:.4g} Hz: record faster, "
        "or tie its degrees of freedom together"
    )


def fastest_rate(fit: BodyFit) -> float:
    """Return the largest rate of the linear structure, frequency or decay, rad/s or 1/s.

    Args:
        fit: a fitted body.
    """
    model = fit.model
    slots, _ = model.interfaces(fit.theta)
    accelerance = model.mobility(fit.theta, 0).accelerance
    stiffness, damping = (np.array([getattr(slot, name) for slot in slots]) for name in ("stiffness", "damping"))
    zero = np.zeros_like(accelerance)
    system = np.block([[zero, np.eye(len(slots))], [-accelerance * stiffness, -accelerance * damping]])
    return float(np.abs(np.linalg.eigvals(system)).max())
