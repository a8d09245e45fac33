"""What the best class predicts of measured modes, with 95 % bands and their coverage of curves that are left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from opid.errors import NotDeterminedError
from opid.mechanics.backbones.family import BackboneFamily
from opid.signals.recording import FloatArray
from opid.updating.likelihood.backbones import BackboneData, IntArray, ModeData, shape_noise_of, without_curve
from opid.updating.likelihood.curves import Curves, describe_points, make_curves, make_solver, weigh_as_recommended
from opid.updating.likelihood.interactions import adapt_to_class, find_loop, find_pulled
from opid.updating.likelihood.noise import CurveNoise, NoiseSettings, draw_errors, draw_linear_errors
from opid.updating.measured import MeasuredBackbone
from opid.updating.result import BackboneBand, ClassPosterior, SensorBand
from opid.updating.settings import UPDATING

N_AMPLITUDES = 40  # points of each band


def predict(
    data: BackboneData, posterior: ClassPosterior, measured: tuple[MeasuredBackbone, ...], *, rng: np.random.Generator
) -> tuple[BackboneBand, ...]:
    """Return the 95 % band of each mode for one more point of one more curve (Song eq. 18).

    lambda = lambda(theta) + e - r_m with theta drawn from the posterior. In the paper's forms e is drawn from
    N(0, sigma_lambda^2) and r_m is the mean of the curves. In the recommended form offset and noise of a further curve
    are drawn from their posterior given the measured ones, and so are those of the motion of each sensor. The band is
    nan where the model converges for less than half of the draws.

    Args:
        data: the backbones, from `backbone_data`.
        posterior: posterior of the class that predicts.
        measured: the same backbones, for the coverage.
        rng: source of chance.

    Raises:
        NotDeterminedError: no mode has a band anywhere.
    """
    theta = posterior.chain.draw(UPDATING.n_predicted, rng)
    data = adapt_to_class(data, posterior.model_class, posterior.best)
    bands = tuple(_make_band(data, mode, posterior, measured, theta, rng) for mode in data.modes)
    if not any(np.isfinite(band.frequency_hz).any() for band in bands):
        every = np.ones(N_AMPLITUDES, dtype=bool)
        where = " or ".join(f"mode {b.mode} at {describe_points(b.amplitude, every, b.sensor)}" for b in bands)
        raise NotDeterminedError(
            f"most draws of {posterior.model_class.name!r} have no backbone of {where}: take fewer harmonics, or "
            "smaller amplitudes"
        )
    return bands


def _make_band(
    data: BackboneData,
    mode: ModeData,
    posterior: ClassPosterior,
    measured: tuple[MeasuredBackbone, ...],
    theta: FloatArray,
    rng: np.random.Generator,
) -> BackboneBand:
    sensor = mode.parts[0][0]
    curves = [one for one in measured if one.mode == mode.mode and sensor in one.sensors]
    held = np.concatenate([one.amplitude[:, one.sensors.index(sensor)] for one in curves])
    amplitude = np.linspace(np.abs(held).min(), np.abs(held).max(), N_AMPLITUDES)
    found = make_solver(data, posterior.model_class, mode, sensor, amplitude)(theta)
    growth = fill_gaps(found.eigenvalue, mode.linear) / mode.linear - 1
    pulled = find_pulled(data, mode, posterior.model_class, posterior.best, amplitude)
    at_nodes = None if mode.frequency_noise is None else make_curves(data, mode, posterior.model_class)(theta)
    errors = draw_frequency_errors(data, mode, at_nodes, found.eigenvalue, growth, rng)
    band = find_band(to_hz(found.eigenvalue + pulled + errors))
    hz = np.concatenate([one.frequency_hz for one in curves])
    sensors: tuple[SensorBand, ...] = ()
    # Draws of their own leave those of the other modes what they are without them.
    (own,) = rng.spawn(1)
    of_frequency, of_sensors = _leave_curves_out(data, mode, posterior, own)
    if at_nodes is not None:
        sensors = _band_sensors(data, mode, found, growth, at_nodes, curves, of_sensors, own)
    return BackboneBand(
        mode.mode, sensor, amplitude, band[1], band[0], band[2], _cover(np.abs(held), hz, amplitude, band),
        of_frequency, _leave_mode_out(data, mode, posterior, own), sensors=sensors,
        loop=find_loop(data, mode, posterior.model_class, posterior.best, amplitude),
    )  # fmt: skip


def draw_frequency_errors(
    data: BackboneData,
    mode: ModeData,
    at_nodes: Curves | None,
    eigenvalue: FloatArray,
    growth: FloatArray,
    rng: np.random.Generator,
    *,
    has_noise: bool = True,
) -> FloatArray:
    """Draw errors of lambda for a further curve, (n, N_AMPLITUDES); nan without a curve of the model.

    In the recommended form the points of that curve may have no noise.
    """
    if mode.frequency_noise is not None and at_nodes is not None:
        model, lost = at_nodes[0][..., None] / mode.linear, at_nodes[3]
        errors = mode.linear * draw_errors(mode.frequency_noise, model, growth, rng, has_noise=has_noise)[..., 0]
        return np.where(lost[:, None], np.nan, errors)
    first = np.unique(mode.curve, return_index=True)[1]
    r_m = float(np.mean(mode.linear - mode.eigenvalue[first]))
    return data.noise.weight_of(mode.mode) * mode.cov * eigenvalue * rng.standard_normal(eigenvalue.shape) - r_m


# ---- bands -----------------------------------------------------------------------------------------


def to_hz(eigenvalue: FloatArray) -> FloatArray:
    """Return the frequencies of lambda, 1/s^2, which errors may have made negative, Hz."""
    return np.sqrt(np.maximum(eigenvalue, 0.0)) / (2 * np.pi)


def find_band(values: FloatArray) -> FloatArray:
    """Return lower end, median and upper end of draws, (n, n_points) -> (3, n_points); nan where most are missing."""
    there = np.isfinite(values)
    band = np.full((3, values.shape[1]), np.nan)
    for index in np.flatnonzero(there.mean(axis=0) >= 0.5):
        band[:, index] = np.quantile(values[there[:, index], index], [0.025, 0.5, 0.975])
    return band


def fill_gaps(eigenvalue: FloatArray, otherwise: float) -> FloatArray:
    """Return rows with gaps interpolated, for the errors of a curve depend on all of it."""
    filled, index = eigenvalue.copy(), np.arange(eigenvalue.shape[1])
    for row in np.flatnonzero(np.isnan(eigenvalue).any(axis=1)):
        there = np.isfinite(eigenvalue[row])
        filled[row] = np.interp(index, index[there], eigenvalue[row, there]) if there.any() else otherwise
    return filled


def _cover(held: FloatArray, values: FloatArray, amplitude: FloatArray, band: FloatArray) -> float:
    """Return the fraction of values, measured at amplitudes `held`, that lie within a band; nan where it has none."""
    low, high = (np.interp(held, amplitude, end) for end in (band[0], band[2]))
    inside = ((values >= low) & (values <= high))[np.isfinite(low)]
    return float(inside.mean()) if inside.size else float("nan")


# ---- motion of every sensor ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _RelativeMotions:
    """Motions of sensors of a mode over that of the controlled one, as channels of a noise model.

    The likelihood compares shapes of unit length, whose length fixes one entry. At a given amplitude of the controlled
    sensor its entry is the one that is fixed: the channels are the other entries over it, so that an error that curves
    have at the controlled sensor stays in them. Their unit is that of an entry of a shape of unit length.
    """

    controlled: int  # column of the controlled sensor
    others: IntArray  # (n_others,) columns of other sensors, which the same curves have
    points: NDArray[np.bool_]  # (n_points,) whether each point has them and the controlled sensor
    unit: FloatArray  # (n_others,) motion over that of the controlled sensor, for a unit of each channel

    def relate(self, shapes: FloatArray) -> FloatArray:
        """Return the channels, (..., n_others), of shapes (..., n_sensors)."""
        return shapes[..., self.others] / (shapes[..., [self.controlled]] * self.unit)

    def make_noise(self, mode: ModeData, noise: NoiseSettings, kept: NDArray[np.bool_] | None = None) -> CurveNoise:
        """Return the noise model of these motions as the curves of a mode have them, or those of the `kept` points."""
        assert mode.errors is not None  # The recommended form has noise models.
        points = self.points if kept is None else self.points & kept
        return shape_noise_of(mode, points, self.relate(mode.shapes[points]), noise, mode.errors)


def _find_motions(data: BackboneData, mode: ModeData) -> list[_RelativeMotions]:
    """Return the motions that the curves of a mode tell, by the curves that have them; none without shapes."""
    if all(each.noise is None for each in mode.shape_sets):
        return []
    controlled = int(np.flatnonzero(mode.rows == data.system.sensor(mode.parts[0][0]))[0])
    seen = mode.seen & mode.seen[:, [controlled]]
    kinds, kind = np.unique(seen, axis=1, return_inverse=True)
    found = []
    for points, number in zip(kinds.T, range(kinds.shape[1]), strict=True):
        others = np.setdiff1d(np.flatnonzero(kind.ravel() == number), controlled)
        if points.any() and others.size:
            usual = np.sqrt(np.mean(mode.shapes[points] ** 2, axis=0))
            found.append(_RelativeMotions(controlled, others, points, find_units(usual, controlled)[others]))
    return found


def find_units(shapes: FloatArray, controlled: int) -> FloatArray:
    """Return the errors of motions over that of one sensor, (..., n_sensors), for errors of 1 of shapes of unit length.

    With u the shape and independent errors d of its entries, that of u_s / u_c is (d_s - u_s / u_c d_c) / u_c.
    """
    own, length = shapes[..., [controlled]], np.linalg.norm(shapes, axis=-1, keepdims=True)
    return np.asarray(length * np.hypot(own, shapes) / own**2)


def draw_motions(
    found: BackboneFamily, controlled: int, growth: FloatArray, std: float, std_growth: float, rng: np.random.Generator
) -> FloatArray:
    """Draw motions over that of the controlled sensor where none was measured, (n, n_points, n_sensors).

    `std` and `std_growth` are the error of a linear shape of unit length at each sensor, and its growth.
    """
    patterns = np.stack([np.ones_like(growth), std_growth * growth], axis=2)
    errors = draw_linear_errors(patterns, found.shapes.shape[2], std, rng)
    return found.shapes / found.shapes[..., [controlled]] + find_units(found.shapes, controlled) * errors


def draw_relative_motions(
    data: BackboneData,
    mode: ModeData,
    found: BackboneFamily,
    growth: FloatArray,
    at_nodes: Curves,
    rng: np.random.Generator,
    *,
    has_noise: bool = True,
) -> FloatArray:
    """Draw the motions of a further curve over that of the controlled sensor, (n, n_points, n_sensors).

    The points of that curve may have no noise. The motions are nan without a curve of the model. A sensor that the
    curves lack has the motion itself with its stated error.
    """
    assert mode.errors is not None  # The recommended form has noise models.
    controlled = data.system.sensor(found.sensor)
    relative = draw_motions(found, controlled, growth, data.noise.linear_shape_error, mode.errors.shape, rng)
    for each in _find_motions(data, mode):
        noise, rows = each.make_noise(mode, data.noise), mode.rows[each.others]
        errors = draw_errors(noise, each.relate(at_nodes[1]), growth, rng, has_noise=has_noise)
        relative[..., rows] = found.shapes[..., rows] / found.shapes[..., [controlled]] + each.unit * errors
    relative[at_nodes[3]] = np.nan
    return relative


def _band_sensors(
    data: BackboneData,
    mode: ModeData,
    found: BackboneFamily,
    growth: FloatArray,
    at_nodes: Curves,
    curves: list[MeasuredBackbone],
    fractions: dict[int, float],
    rng: np.random.Generator,
) -> tuple[SensorBand, ...]:
    """Return the band of each sensor but the controlled one; `fractions`, by the column, are of curves left out."""
    system = data.system
    controlled = system.sensor(found.sensor)
    relative = draw_relative_motions(data, mode, found, growth, at_nodes, rng)
    left_out = {int(mode.rows[column]): fraction for column, fraction in fractions.items()}
    bands = []
    for row, sensor in enumerate(system.sensors):
        if row == controlled:
            continue
        low, motion, high = band = found.amplitude * find_band(relative[..., row])
        seen = [one.amplitude[:, [one.sensors.index(s) for s in (found.sensor, sensor)]] for one in curves
                if sensor in one.sensors]  # fmt: skip
        coverage = float("nan")
        if seen:
            held, values = np.concatenate(seen).T
            coverage = _cover(np.abs(held), values * np.sign(held), found.amplitude, band)
        bands.append(SensorBand(sensor, motion, low, high, coverage, left_out.get(row)))
    return tuple(bands)


# ---- what is left out ------------------------------------------------------------------------------


def _leave_curves_out(
    data: BackboneData, mode: ModeData, posterior: ClassPosterior, rng: np.random.Generator
) -> tuple[float | None, dict[int, float]]:
    """Return which fractions of the points of a mode lie within the bands that its other curves give.

    The first is that of the frequency, the others are those of the motions that the curves tell, by the column of the
    sensor; there is none where no other curve has them. Each curve is left out in turn: the samples of the posterior
    get the weight of the likelihood of all curves but that one over the likelihood of all.
    """
    n_curves = int(mode.curve[-1]) + 1
    if mode.frequency_noise is None or n_curves < 2:
        return None, {}
    at_nodes, shapes = _draw_curves(data, mode, posterior, UPDATING.n_predicted, rng)
    if not len(at_nodes):
        return None, {}
    motions = _find_motions(data, mode)
    held, inside = [], np.full(mode.shapes.shape, np.nan)
    whole = weigh_as_recommended(mode, at_nodes, shapes)
    for curve in range(n_curves):
        rest, mine = without_curve(mode, curve, data.noise), mode.curve == curve
        chosen = _choose(weigh_as_recommended(rest, at_nodes, shapes) - whole, rng)
        eigenvalue, model = at_nodes[chosen] @ mode.between[mine].T, at_nodes[chosen][..., None] / mode.linear
        assert rest.frequency_noise is not None
        growth = eigenvalue / mode.linear - 1
        drawn = eigenvalue[..., None] + mode.linear * draw_errors(rest.frequency_noise, model, growth, rng)
        held.append(_lie_within(mode.eigenvalue[mine, None], drawn))
        for each in motions:
            if each.points[mine].any() and (each.points & ~mine).any():
                noise, model = each.make_noise(mode, data.noise, ~mine), each.relate(shapes[chosen])
                moved = mode.between[mine] @ model + draw_errors(noise, model, growth, rng)
                inside[np.ix_(mine, each.others)] = _lie_within(each.relate(mode.shapes[mine]), moved)
    told = {column: float(np.nanmean(row)) for column, row in enumerate(inside.T) if np.isfinite(row).any()}
    return float(np.concatenate(held).mean()), told


def _leave_mode_out(
    data: BackboneData, mode: ModeData, posterior: ClassPosterior, rng: np.random.Generator
) -> float | None:
    """Return the fraction of the points of a mode within the band of lambda that the other modes give; None without it.

    The samples of the posterior get the inverse of the likelihood of this mode as their weight. No curve of the mode
    tells its errors then: they are drawn as large as they are stated. There is none where the force is used, for its
    calibration is common to all modes, so that this weight does not take the mode out.
    """
    if mode.errors is None or len(data.modes) < 2 or data.force is not None:
        return None
    at_nodes, shapes = _draw_curves(data, mode, posterior, UPDATING.n_weighed, rng)
    if not len(at_nodes):
        return None
    log_weight = -weigh_as_recommended(mode, at_nodes, shapes)
    weight = np.exp(log_weight - log_weight.max())
    if weight.sum() ** 2 / (weight**2).sum() < UPDATING.fewest_left:
        return None
    eigenvalue = at_nodes[_choose(log_weight, rng)] @ mode.between.T
    growth, noise, errors = eigenvalue / mode.linear - 1, data.noise, mode.errors
    patterns = np.stack([np.ones_like(growth), errors.frequency * growth], axis=2)
    if errors.patterns is not None:
        further = np.broadcast_to(errors.patterns, (len(growth), *errors.patterns.shape))
        patterns = np.concatenate([patterns, further], axis=2)
    relative = draw_linear_errors(patterns, 1, 2 * noise.linear_error, rng)
    offset, slope = rng.standard_normal((2, len(growth), 1))
    slope = noise.curve_growth * noise.point_noise * slope
    relative[..., 0] += 2 * (noise.curve_offset * offset + slope * (growth - growth.mean(axis=1, keepdims=True)))
    relative[..., 0] += 2 * noise.point_noise * rng.standard_normal(growth.shape)
    return float(_lie_within(mode.eigenvalue[:, None], eigenvalue[..., None] + mode.linear * relative).mean())


def _draw_curves(
    data: BackboneData, mode: ModeData, posterior: ClassPosterior, n: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw lambda, (n, n_nodes), and unit shapes of a mode at its nodes from the posterior, without lost curves."""
    theta = posterior.chain.draw(n, rng)
    at_nodes, shapes, _, lost = make_curves(data, mode, posterior.model_class)(theta)
    return at_nodes[~lost], shapes[~lost]


def _choose(log_weight: FloatArray, rng: np.random.Generator) -> IntArray:
    """Return numbers of draws, (n_predicted,), drawn by the logarithms of their weights."""
    return np.asarray(np.argmax(log_weight + rng.gumbel(size=(UPDATING.n_predicted, log_weight.size)), axis=1))


def _lie_within(values: FloatArray, drawn: FloatArray) -> FloatArray:
    """Return 1 where values, (n_points, n_channels), lie within the 95 % band of draws (n, n_points, n_channels)."""
    low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
    return np.asarray((values >= low) & (values <= high), dtype=np.float64)
