"""Intervals of the parameters, which hold for a coloured residual, absolute values, and what limits them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import fft

from opid.estimate import Estimate
from opid.mechanics.driven import UnboundedResponseError
from opid.mechanics.laws.law import LAWS, Law, TermSet
from opid.mechanics.memory import Loop, force_along, loop_area, sine_like
from opid.mechanics.weight import slopes_at_rest
from opid.signals.recording import FloatArray
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.fitting.least_squares import add_scores
from opid.suspensions.fitting.repeatability import Levels, Repeatability, levels
from opid.suspensions.model.driven_model import straight_equivalent
from opid.suspensions.model.law_parameters import from_free
from opid.suspensions.model.unknowns import GROUND
from opid.suspensions.result import BodyParameters, BodyRatios, GearRatios

_WORDS = {
    "gain": "gain",
    "corner": "AC-coupling corner",
    "lag": "lag",
    "drift": "clock's drift",
    "leak": "cross-axis leak",
}


def honest_covariance(fit: Fit) -> FloatArray:
    """Return the covariance of the vector, widened if the residual is coloured.

    It is the sandwich over cells of neighbouring lines; no interval becomes narrower than for a white residual.

    Returns:
        (n_unknowns, n_unknowns).
    """
    wider = std_over_white(fit)
    return np.asarray(fit.covariance * np.outer(wider, wider))


def known_parameters(fit: Fit, repeatability: float, more: FloatArray | float = 0.0) -> Parameters:
    """Return the parameters of a fit with their covariance.

    The repeatability is the stated one; `more` is the covariance of further errors, (n_unknowns, n_unknowns).
    """
    more = more + _add_few_elements(fit)
    if not fit.model.repeatability:
        return Parameters(fit, honest_covariance(fit) + more)
    found = levels(fit, repeatability).widen(std_over_white(fit))
    found = found.with_more(np.broadcast_to(more, found.covariance.shape[1:]))
    return Parameters(fit, found.second_moments(), found)


def _add_few_elements(fit: Fit) -> FloatArray:
    """Return the covariance of dampers beside joints of sliders: twenty sliders dissipate slightly less than many."""
    variance, fraction = np.zeros(fit.theta.size), fit.model.settings.intervals.few_elements_fraction
    for index, prediction in enumerate(fit.errors.predictions):
        interfaces = fit.model.resting_interfaces(fit.theta, index)
        for group, first in zip(fit.model.groups, fit.model.first_of_group, strict=True):
            law, fs = interfaces[group.members[0]].law, fit.model.runs[index].fs
            assert isinstance(law, Law)  # without candidates
            sliders = replace(law, terms=tuple(term for term in law.terms if term.kind.slips))
            if sliders.terms:
                z, v = prediction.travel[:, group.members[0]], prediction.velocity[:, group.members[0]]
                damping = float(v @ force_along(sliders, z, v, fs)) / float(v @ v)
                variance[first + 1] = max(variance[first + 1], (fraction * damping) ** 2)
    return np.diag(variance)


def std_over_white(fit: Fit) -> FloatArray:
    """Return the factor by which a coloured residual widens the interval of each unknown, at least 1."""
    posterior, jacobian, _ = _scale_to_std(fit)
    n, known = fit.n_data, fit.model.settings.intervals
    cells, n_cells = [], 0
    for run, line in zip(fit.model.runs, fit.errors.lines, strict=True):
        n_lines = run.omega.size
        # The cells hold the real and imaginary parts of all sensors.
        own = np.tile(np.arange(n_lines) // known.lines_per_cell, 2 * line.size // n_lines)
        cells.append(n_cells + own)
        n_cells += int(own.max()) + 1
    factor, scores = add_scores(jacobian[:n], fit.errors.stacked[:n] / fit.variance, np.concatenate(cells))
    moved = np.concatenate([np.sqrt(factor) * scores, jacobian[n:]]) @ posterior
    return np.sqrt(np.maximum(np.sum(moved**2, axis=0) / np.diag(posterior), 1.0))


def bootstrap_over_white(fit: Fit, rng: np.random.Generator) -> FloatArray:
    """Return the ratio of block-bootstrap to white-noise standard deviation of each unknown.

    Each resample draws blocks of half a second of the innovations with replacement (Kuensch 1989), so that correlation
    within a block is kept, and moves the parameters by -C J^T e/s^2, to first order.
    """
    posterior, jacobian, scale = _scale_to_std(fit)
    n, known, first = fit.n_data, fit.model.settings.intervals, 0
    back = posterior @ jacobian[:n].T / fit.variance
    moved = np.zeros((known.n_bootstrap, scale.size))
    n_sensors = len(fit.model.sensors.sprung) - fit.model.compared.start
    for run, prediction in zip(fit.model.runs, fit.errors.predictions, strict=True):
        block = max(1, min(round(known.bootstrap_s * run.fs), run.n_samples))
        n_blocks = -(-run.n_samples // block)
        drawn = rng.integers(0, run.n_samples, (known.n_bootstrap, n_blocks))
        for sensor in range(n_sensors):
            parts = [back[:, first + k * n_sensors * run.omega.size + sensor * run.omega.size :] for k in (0, 1)]
            spectrum = np.zeros((scale.size, run.n_samples // 2 + 1), dtype=np.complex128)
            spectrum[:, run.lines] = parts[0][:, : run.omega.size] + 1j * parts[1][:, : run.omega.size]
            # This is the transpose of `DrivenRun.transform`; the band holds neither the mean nor the highest line.
            influence = fft.irfft(spectrum, run.n_samples) * np.sqrt(run.n_samples / 2)
            # A block that is drawn near the end continues at the beginning.
            own = prediction.innovation[fit.model.compared][sensor]
            around = np.append(own, own[: block - 1])
            blocks = np.lib.stride_tricks.sliding_window_view(around, block)
            for number, first_samples in enumerate(drawn):
                moved[number] += influence @ blocks[first_samples].ravel()[: run.n_samples]
        first += 2 * n_sensors * run.omega.size
    # Prior knowledge is resampled as well.
    by_prior = np.sum((jacobian[n:] @ posterior) ** 2, axis=0)
    return np.sqrt((moved.var(axis=0) + by_prior) / np.diag(posterior))


def _scale_to_std(fit: Fit) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return covariance and Jacobian with every entry in units of its standard deviation, and these deviations."""
    scale = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-300))
    return fit.covariance / np.outer(scale, scale), fit.errors.jacobian * scale, scale


# the step of the numerical derivatives, in standard deviations
_SMALL_STEP = 1e-2
# damping is averaged over about this many samples of a run
_AT_REST_SAMPLES = 2000


@dataclass(frozen=True, eq=False)
class Parameters:
    """The shared parameters of a fit and their covariance, from which all numbers of an answer are read.

    Args:
        fit: the fitted model.
        covariance: (n_unknowns, n_unknowns) covariance of its vector, see `honest_covariance`.
        levels: the posterior at each value of the repeatability; None if the runs were fitted as alike. The mixture has
            long tails, so standard deviations are those of its 95 % intervals.
    """

    fit: Fit
    covariance: FloatArray
    levels: Levels | None = None

    def std(self, index: int) -> float:
        """Return the standard deviation of an entry of the vector."""
        return self.deviation(np.eye(1, self.fit.theta.size, index)[0])

    def deviation(self, slopes: FloatArray) -> float:
        """Return the standard deviation of a function of the vector with these derivatives, (n_unknowns,)."""
        if self.levels is not None:
            return self.levels.deviation(slopes)
        return float(np.sqrt(max(float(slopes @ self.covariance @ slopes), 0.0)))

    def estimate(self, value: float, gradient: Mapping[str | int, float]) -> Estimate:
        """Return a function of the parameters with its interval, by the delta method.

        The gradient holds the derivatives by parameters, each under its name or its index in the vector.
        """
        names, slopes = self.fit.model.names, np.zeros(self.fit.theta.size)
        for key, slope in gradient.items():
            slopes[names.index(key) if isinstance(key, str) else key] = slope
        return Estimate.normal(value, self.deviation(slopes))

    def per_force(self, index: int, *, per_mass: bool = False) -> Estimate:
        """Return an entry of the vector that is per unit of the mass, times the mass if that is fitted."""
        model, value = self.fit.model, float(self.fit.theta[index])
        if per_mass or not model.mass_free:
            return self.estimate(value, {index: 1.0})
        mu = model.inverse_mass(self.fit.theta)
        return self.estimate(value / mu, {index: 1 / mu, "inverse_mass": -value / mu**2})

    @property
    def inverse_mass(self) -> tuple[float, float]:
        """One over the reference mass, if it is free, and its standard deviation, 1/kg."""
        return self.fit.model.inverse_mass(self.fit.theta), self.std(self.fit.model.names.index("inverse_mass"))

    @property
    def mass(self) -> Estimate:
        """The reference mass, if it is free; its interval follows from that of 1/M and is longer upwards."""
        mu, std = self.inverse_mass
        if mu <= 1.96 * std:
            return Estimate(1 / mu if mu > 0 else None)
        return Estimate(1 / mu, std / mu**2, (1 / (mu + 1.96 * std), 1 / (mu - 1.96 * std)))

    @property
    def has_negative_mass(self) -> bool:
        """Whether the reference mass is significantly negative."""
        if not self.fit.model.mass_free:
            return False
        mu, std = self.inverse_mass
        return mu < -1.96 * std

    def suspension(
        self, number: int, *, per_mass: bool = False
    ) -> tuple[Estimate, Estimate, dict[str, dict[str, Estimate]]]:
        """Return stiffness, damping and law of a group: in N, or per kg of the body if the mass is not fitted."""
        model, theta = self.fit.model, self.fit.theta
        first, indices, law = model.first_of_group[number], model.law_indices(number), model.groups[number].law
        estimates: dict[str, dict[str, Estimate]] = {}
        if law.terms:
            law, slopes = from_free(law, theta[indices])
            index = indices.start
            for term in law.terms:
                table: dict[str, Estimate] = {}
                estimates[term.name] = table
                for parameter, value in zip(LAWS[term.name].parameters, term.values, strict=True):
                    if not table:
                        table[parameter.name] = self.per_force(index, per_mass=per_mass)
                    else:
                        slope = float(slopes[index - indices.start])
                        table[parameter.name] = Estimate.normal(value, slope * self.std(index))
                    index += 1
        stiffness, damping = (self.per_force(entry, per_mass=per_mass) for entry in (first, first + 1))
        return stiffness, damping, estimates

    def rest(self, number: int) -> Estimate:
        """Return where a group rests on its law in the reference run, from the origin of the law, m."""
        group = self.fit.model.groups[number]
        if not group.has_origin:
            return Estimate(0.0)
        index = self.fit.model.first_of_group[number] + group.n_head - 1
        return self.estimate(float(self.fit.theta[index]), {index: 1.0})

    def estimate_function(self, function: Callable[[FloatArray], FloatArray]) -> list[Estimate]:
        """Return the values of a function of the vector with intervals; its derivatives are taken numerically.

        There is no estimate if the function is not defined at the fit or near it.
        """
        values = function(self.fit.theta)
        model, slopes = self.fit.model, np.zeros((values.size, self.fit.theta.size))
        departures = [np.arange(slopes.shape[1])[model.indices_of_run(index)[1]] for index in range(len(model.runs))]
        # The reported numbers do not depend on the initial states.
        for index in (*range(model.n_shared), *np.concatenate(departures)):
            # An entry that the runs do not determine has a huge standard deviation.
            farthest = max(1.0, abs(float(self.fit.theta[index])))
            step = min(_SMALL_STEP * self.std(index), farthest)
            if step > 0.0:
                ahead, back = self.fit.theta.copy(), self.fit.theta.copy()
                ahead[index], back[index] = ahead[index] + step, back[index] - step
                slopes[:, index] = (function(ahead) - function(back)) / (2 * step)
        # A value that depends on no unknown is known exactly.
        return [
            Estimate.normal(value, self.deviation(each) if each.any() else 0.0)
            if np.isfinite([value, *each]).all()
            else Estimate()
            for value, each in zip(values.tolist(), slopes, strict=True)
        ]

    def at_rest(self, run: int, *, per_mass: bool = False) -> list[tuple[Estimate, Estimate, Estimate]]:
        """Return static travel (m), tangent stiffness and equivalent damping of each suspension in a run.

        The equivalent damping dissipates as much as damper and law over the motion of the run: it is the sum of
        (f(z, z') - f(z, 0)) z' over that of z'^2, with the memory of the law.
        """
        model, prediction = self.fit.model, self.fit.errors.predictions[run]
        n, has_mass, fs = model.body.n_interfaces, model.mass_free and not per_mass, model.runs[run].fs
        thinner = max(1, prediction.travel.shape[0] // _AT_REST_SAMPLES)

        @cache
        def damping_of(law: Law, attachment: int) -> float:
            every = 1 if law.has_memory else thinner
            z, v = prediction.travel[::every, attachment], prediction.velocity[::every, attachment]
            lost = (force_along(law, z, v, fs) if law.has_memory else law.force(z, v)) - law.force(z, 0.0)
            return float(lost @ v) / float(v @ v)

        def read(theta: FloatArray) -> FloatArray:
            resting, moved = model.resting_interfaces(theta, run)[:n], model.rest(theta, run, straight=True)
            scale = 1.0 / model.inverse_mass(theta) if has_mass else 1.0
            return np.array(
                [
                    (
                        0.0 if moved is None else moved.travel[attachment],
                        scale * (here.stiffness + float(here.law.gradient(0.0, 0.0)[0])),
                        scale * (here.damping + damping_of(here.law, attachment)),
                    )
                    for attachment, here in enumerate(resting)
                ]
            ).ravel()

        try:
            estimates = self.estimate_function(read)
        except UnboundedResponseError:
            # The springs can hardly carry the weight: a step of the derivative goes beyond what they can carry.
            return [(Estimate(), Estimate(), Estimate())] * n
        has_travel = model.body.fall is not None and (model.mass_free or not model.runs[run].loading.any())
        return [
            (travel if has_travel else Estimate(), stiffness, damping)
            for travel, stiffness, damping in zip(estimates[::3], estimates[1::3], estimates[2::3], strict=True)
        ]

    def loop(self, attachment: int, run: int, *, per_mass: bool = False) -> Loop | None:
        """Return the energy per cycle that the terms with memory take, in a motion like that of a run.

        None without memory. There is no area if its interval reaches zero: terms with memory dissipate energy, and near
        zero the area is not a linear function of the parameters.
        """
        model, prediction = self.fit.model, self.fit.errors.predictions[run]
        here = model.resting_interfaces(self.fit.theta, run)[attachment]
        if not here.law.has_memory:
            return None
        z, v = prediction.travel[:, attachment], prediction.velocity[:, attachment]
        sine, has_mass = sine_like(float(z.std()), float(v.std())), model.mass_free and not per_mass

        @cache
        def area_of(law: TermSet) -> float:
            return loop_area(law, *sine)

        def read(theta: FloatArray) -> FloatArray:
            scale = 1.0 / model.inverse_mass(theta) if has_mass else 1.0
            return np.array([scale * area_of(model.resting_interfaces(theta, run)[attachment].law)])

        try:
            (area,) = self.estimate_function(read)
        except UnboundedResponseError:
            area = Estimate()
        if area.interval95 is not None and area.interval95[0] <= 0.0:
            area = Estimate()
        force = here.stiffness * z + here.damping * v + force_along(here.law, z, v, model.runs[run].fs)
        scale = 1.0 / model.inverse_mass(self.fit.theta) if has_mass else 1.0
        pace = float(v.std() / z.std()) / (2 * np.pi)
        return Loop(float(sine[0].max()), pace, area).within(abs(scale) * float(force.std()))

    def equivalent(self, run: int) -> list[Estimate]:
        """Return stiffness and damping over mass, frequency and damping ratio of the straight suspension nearest to it.

        Of one gear over the motion of a run, see `straight_equivalent`.
        """
        model, motion = self.fit.model, self.fit.errors.predictions[run]
        try:
            # A suspension with negative stiffness has no frequency.
            return self.estimate_function(straight_equivalent(model, run, motion))
        except UnboundedResponseError:
            return [Estimate()] * 4

    def ground(self, number: int, std_per_mass: float | None, *, per_mass: bool) -> Estimate:
        """Return the spring from the body to the ground at a group of interfaces, N/m, or per kg.

        If no ground spring was fitted, it is zero with the standard deviation that a fit would have had:
        `std_per_mass`, 1/s^2, None if the user excluded such springs. A ground spring is known no better than the gains
        of two sensors agree.
        """
        model = self.fit.model
        equal, first = model.settings.intervals.equal_gains, model.first_of_group[number]
        stiffness = self.per_force(first, per_mass=per_mass).value or 0.0
        if not model.groups[number].ground:
            if std_per_mass is None:
                return Estimate(0.0)
            mu = 1.0 if per_mass or not model.mass_free else model.inverse_mass(self.fit.theta)
            return Estimate.normal(0.0, float(np.hypot(std_per_mass / mu, equal * stiffness)))
        found = self.per_force(first + 2, per_mass=per_mass)
        if found.std is None:
            return found
        return Estimate.normal(found.value or 0.0, float(np.hypot(found.std, equal * stiffness)))

    def gear_ratios(self, ground: Estimate) -> GearRatios:
        """Return ratios to the mass, and frequency and damping ratio on a still wheel, of one gear.

        The frequency is that of the tangent stiffness at rest, which is K2 + K3 if the law has no slope there. `ground`
        is the stiffness of the spring to the ground over the mass.
        """
        fit, group = self.fit, self.fit.model.groups[0]
        k, c = (fit.value(group.name_of(what)) for what in ("stiffness_per_mass", "damping_per_mass"))
        ratios = GearRatios(self.per_force(0, per_mass=True), self.per_force(1, per_mass=True), ground)
        total = k + fit.value(group.name_of(GROUND))
        if slopes_at_rest(fit.model.interfaces(fit.theta)[0][0].law):

            def at_rest(theta: FloatArray) -> FloatArray:
                suspension = fit.model.interfaces(theta)[0][0]
                square = (
                    suspension.stiffness + suspension.ground_stiffness + float(suspension.law.gradient(0.0, 0.0)[0])
                )
                omega = float(np.sqrt(max(square, 1e-300)))
                return np.array([omega / (2 * np.pi), suspension.damping / (2 * omega)])

            frequency, zeta = withhold_frequency(*self.estimate_function(at_rest))
            return replace(ratios, natural_frequency_hz=frequency, damping_ratio=zeta)
        if total <= 0:
            return ratios
        omega = float(np.sqrt(total))
        springs = (0, 2) if group.ground else (0,)
        frequency = self.estimate(omega / (2 * np.pi), dict.fromkeys(springs, 1 / (4 * np.pi * omega)))
        zeta = self.estimate(c / (2 * omega), {1: 1 / (2 * omega), **dict.fromkeys(springs, -c / (4 * omega**3))})
        frequency, zeta = withhold_frequency(frequency, zeta)
        return replace(ratios, natural_frequency_hz=frequency, damping_ratio=zeta)

    def estimate_rigid_body(self) -> tuple[BodyParameters, BodyRatios]:
        """Return absolute parameters and ratios of a rigid body; parameters are empty without the mass."""
        x, y = (self.estimate(self.fit.value(name), {name: 1.0}) for name in ("x_cg_m", "y_cg_m"))
        roll_radius, roll_inertia = self._shift_to_cg("rxx_m2", "y_cg_m")
        pitch_radius, pitch_inertia = self._shift_to_cg("ryy_m2", "x_cg_m")
        parameters = BodyParameters()
        if self.fit.model.mass_free:
            parameters = BodyParameters(self.mass, roll_inertia, pitch_inertia, x, y)
        return parameters, BodyRatios(roll_radius, pitch_radius, x, y)

    def _shift_to_cg(self, about: str, offset: str) -> tuple[Estimate, Estimate]:
        """Return radius and inertia from the moment about the origin minus the square of the offset."""
        model, away, radius = self.fit.model, self.fit.value(offset), Estimate()
        square = self.fit.value(about) - away**2
        if square > 0:
            root = float(np.sqrt(square))
            radius = self.estimate(root, {about: 0.5 / root, offset: -away / root})
        if not model.mass_free:
            return radius, Estimate()
        mu = model.inverse_mass(self.fit.theta)
        gradient: dict[str | int, float] = {about: 1 / mu, offset: -2 * away / mu, "inverse_mass": -square / mu**2}
        return radius, self.estimate(square / mu, gradient)


def withhold_frequency(frequency: Estimate, damping_ratio: Estimate) -> tuple[Estimate, Estimate]:
    """Return both, the interval of the frequency cut at zero; neither if its standard deviation exceeds it.

    The runs then do not say whether there is a restoring spring, and near zero neither number is a linear function of
    the parameters, so that no interval of them would hold.
    """
    if frequency.value is None or frequency.std is None or frequency.interval95 is None:
        return frequency, damping_ratio
    if frequency.std >= frequency.value:
        return Estimate(), Estimate()
    low, high = frequency.interval95
    return replace(frequency, interval95=(max(low, 0.0), high)), damping_ratio


def limits(known: Parameters, alike: Repeatability, mass: Estimate, *, is_pushed: bool = False) -> Iterator[str]:
    """Yield what limits the mass and the laws, one sentence each."""
    fit, covariance = known.fit, known.covariance
    yield from limits_of_mass(alike, fit, mass, is_pushed=is_pushed)
    if mass.std is not None:
        yield from _name_fault(fit, covariance, fit.model.names.index("inverse_mass"), "the mass")
    for number in range(len(fit.model.groups)):
        indices = fit.model.law_indices(number)
        for index in range(indices.start, indices.stop):
            sentences = list(_name_fault(fit, covariance, index, "the law"))
            if sentences:
                yield sentences[0]
                return


def limits_of_mass(alike: Repeatability, fit: Fit, mass: Estimate, *, is_pushed: bool = False) -> Iterator[str]:
    """Yield which part of the mass interval is due to noise and to repeatability, and what would help most.

    Args:
        alike: the repeatability of the suspensions in the runs.
        fit: the fit of these runs.
        mass: the reported mass; empty if it is not reported.
        is_pushed: whether unmeasured forces leave more than the noise of the sensors.
    """
    if fit.model.has_prior_mass:
        if mass.value is not None and mass.std is not None:
            percent = 196 * mass.std / mass.value
            yield f"the mass is known to {percent:.2g} % (half of its 95 % interval) by the weighed mass and the runs"
        return
    if fit.model.scales:
        if mass.value is not None and mass.std is not None:
            percent = 196 * mass.std / mass.value
            force = "forces in the struts" if len(fit.model.scales) > 1 else "force in the strut"
            beside = " and the mass change" * any(run.loading.any() for run in fit.model.runs)
            yield (
                f"the mass is known to {percent:.2g} % (half of its 95 % interval) by the {force}{beside}; "
                "a gain that is known better would narrow the interval"
            )
        return
    if mass.value is not None and mass.std is not None:
        source = "unmeasured forces" if is_pushed else "the sensors' noise"
        yield _describe_interval(alike, 196 * mass.std / mass.value, source)
    if len(fit.model.runs) > 1:
        yield from _describe_repeatability(alike)
    if mass.value is not None and mass.std is not None:
        yield from _list_remedies(alike, fit, mass.value)


def _describe_interval(alike: Repeatability, percent: float, source: str) -> str:
    if alike.mass_if_alike is None:
        return f"the mass is known to {percent:.2g} % (half of its 95 % interval), all of it from {source}"
    noise = percent * alike.mass_if_alike
    return (
        f"the mass is known to {percent:.2g} % (half of its 95 % interval): {noise:.2g} % from {source}, "
        f"{float(np.sqrt(percent**2 - noise**2)):.2g} % from suspensions that may differ from run to run"
    )


def _describe_repeatability(alike: Repeatability) -> Iterator[str]:
    if alike.estimated is not None and not alike.stated:
        yield (
            "stiffness, damping and friction are stated to be the same in all runs (`repeatability = 0`), which these "
            f"runs contradict: they show {100 * alike.estimated:.1g} %, and the intervals allow for it"
        )
    elif alike.estimated is not None:
        source = "the usual value, for the study states no `repeatability`" if alike.is_usual else "the stated value"
        yield (
            "the repeatability, by which stiffness, damping and friction differ from run to run, is taken to be "
            f"{100 * alike.stated:.2g} % ({source}); these runs show {100 * alike.estimated:.1g} %"
            f"{', but are too few to prove it' * alike.rules_mass}"
        )
    elif alike.stated == 0:
        yield "stiffness, damping and friction are stated to be the same in all runs (`repeatability = 0`)"


def _list_remedies(alike: Repeatability, fit: Fit, mass: float) -> Iterator[str]:
    runs = fit.model.runs
    # With several suspensions no single number gives the ratio of a loading to the body.
    changes = [float(run.loading[0, 0]) for run in runs] if fit.model.body.is_one_gear else [0.0]
    fraction = (max(changes) - min(changes)) / mass
    if fraction > 0:
        yield (
            f"the mass change is {100 * fraction:.0f} % of the mass, so that 1 % of stiffness in one run looks like "
            f"{1 / fraction:.0f} % of mass"
        )
    double = "twice the mass change" if fraction > 0 else "twice the loading"
    if alike.rules_mass:
        flown_twice = len({run.loading.tobytes() for run in runs}) < len(runs)
        again = "repeat the loadings further" if flown_twice else "repeat each loading once more"
        yield (
            f"what would help most: {again}, alternately, for the repeats show the repeatability; {double} would halve "
            "the interval"
        )
    else:
        duration_s = sum(len(run.sprung) / run.recorded_fs for run in runs)
        yield (
            f"what would help most: {double}, or four times the {duration_s:.0f} s of running; either would halve the "
            "interval"
        )
    if alike.mass_if_alike is not None and fit.model.body.of_force is None:
        yield (
            "a run whose stiffness, damping and friction have all changed by one ratio cannot be distinguished from "
            "one with another mass change: weigh what is added or taken off"
        )


def _name_fault(fit: Fit, covariance: FloatArray, index: int, what: str) -> Iterator[str]:
    """Yield the sensor fault whose knowledge would narrow the interval most."""
    faults, own = fit.model.faults, covariance[index, index]
    if not faults or own <= 0:
        return
    # This is the variance that is left if a fault is known (Schur complement).
    left = []
    for fault in faults:
        k = fit.model.names.index(fault.name)
        left.append(own - covariance[index, k] ** 2 / max(covariance[k, k], 1e-300))
    best = int(np.argmin(left))
    widening = float(np.sqrt(own / max(left[best], 1e-300)))
    if widening > fit.model.settings.intervals.widening_named:
        fault = faults[best]
        where = f" of the {fit.model.describe_sensor(fault)}"
        if fault.kind in ("lag", "drift", "leak"):
            name = fit.model.sensors.names[fault.channel]
            where = f" at {name!r}" if name else ""
        if fault.run is not None:
            where += f" in run {fit.model.sensors.runs[fault.run]!r}"
        times = f"{widening:.1f} times" if widening < 10 else "more than ten times"
        yield (
            f"{what} is limited by the {_WORDS[fault.kind]}{where}, which widens its interval {times}: calibrate "
            "it and state a smaller standard deviation"
        )
