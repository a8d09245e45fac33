"""The tuned numbers with which measured resonance tests are read, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from opid.modal.settings import MODAL


@dataclass(frozen=True)
class ResonanceSettings:
    """Where a level is steady, which levels count, and how far the phase of a measured force is trusted.

    Args:
        frame_periods: periods in a Hann frame that follows amplitude and frequency; with these a mode whose frequency
            differs by a quarter lies at the first zero of the frame.
        window_periods: periods in which a steady level may not drift, and fewest that it lasts; some time constants of
            a mode with 1 % damping.
        most_drift: change of the log-amplitude over a window, up to which it is steady whatever the noise.
        drift_sigma: standard deviations by which a drift must exceed its noise to count; a step in the middle of a
            window makes 5.5, and chance 4 in one window of thousands.
        most_wander: rms departure of the log-amplitude from its trend in a window, above which it is not steady.
        block_periods: periods of a block in a transient, which is short beside the time constant of a bolted mode.
        same_level_deg: phase over the force by which stretches of one amplitude of the drive may differ in one level: a
            loop that still settles moves it by a degree, and a step of the frequency that a curve needs by several.
        still_driven: rms of the force at the end of a log over that of its last steady level, above which the force
            still drives the mode there; the force of a mode that decays freely is far smaller.
        quadrature_deg: phase error up to which a level counts as held at quadrature, as in the phase lock.
        farthest_deg: phase error from which a level is left out: there stiffness no longer follows from a small part of
            the force, but from most of it.
        least_signal: amplitude over its standard deviation that force and motion of a level need.
        phase_tolerance_deg: standard deviation of an unknown phase between force and accelerations: that of
            conditioners of one rack.
        unseen_phase_deg: the same where a log has no transients, which would show it: filters of two channels differ by
            some degrees at a few hundred hertz.
        gain_tolerance: standard deviation of an unknown gain of the force over the accelerations and the shape, as a
            fraction: that of a calibration.
        disbelief: phase that the motions show over this standard deviation, from which it is no longer believed.
        doubted_phase_deg: standard deviation that is believed then: any phase that a filter or a delay makes.
        fewest_levels: levels that a law needs at least.
        least_range: largest amplitude over the smallest, below which powers cannot be told from k0 and c0.
        hidden_sigma: standard deviations from which a phase that the data show is warned of.
        warned_phase_deg: phase of the force against the accelerations below which there is no warning.
        warned_misfit: misfit of the law in standard deviations above which there is a warning.
        warned_outside: motion that no shape makes, as a fraction, below which there is no warning.
        most_named: levels left out that are named one by one.
        below_clipping: a transient counts up to this fraction of the least amplitude at which a sensor is clipped.
        least_of_peak: amplitude of a point of a response curve over the largest, below which other modes and noise
            dominate.
        largest_jump: change of the logarithm of a complex amplitude between two points of a curve above which it has
            jumped, or points between them are missing: a third of the way round resonance.
        most_lag: rate of the frequency over the square of the half-power half-bandwidth, above which a curve is no
            longer steady: a rate of 2 % changes the damping by as much.
        near_unit: difference of a modal mass from that of a mistaken unit, as a fraction, up to which the unit is
            named: what other modes add to the sensor is subtracted in the wrong unit, too.
        n_curve: amplitudes at which frequency and damping by the law are given.
        least_weight: weight of a choice of powers among all, from which it counts.
        n_draws: laws that are drawn for the band of a prediction: its ends are known to a tenth of its width.
        near_deg: phase error up to which the points of a curve show its resonance: there their amplitudes differ by an
            eighth at most, so that frequency over the square of the amplitude is a line.
        least_line: largest square of their amplitudes over the least, below which no line is drawn through them.
        farthest_reach: largest amplitude that a prediction searches, over the largest that was fitted.
        most_mass_steps: steps in which a modal mass that nobody knows is fitted; two are usual.
        mass_converged: change of the modal mass, as a fraction, at which these steps end.
        flat_fraction: samples of a level that lie at its largest value, beyond those of a sine of that resolution, from
            which it is clipped.
    """

    frame_periods: float = 8.0
    window_periods: float = 40.0
    most_drift: float = 0.004
    drift_sigma: float = 4.0
    most_wander: float = 0.02
    block_periods: float = 12.0
    same_level_deg: float = 2.0
    still_driven: float = 0.5
    quadrature_deg: float = 1.0
    farthest_deg: float = 45.0
    least_signal: float = 10.0
    phase_tolerance_deg: float = 0.5
    unseen_phase_deg: float = 3.0
    gain_tolerance: float = MODAL.gain_tolerance
    disbelief: float = 2.0
    doubted_phase_deg: float = 20.0
    fewest_levels: int = 5
    least_range: float = 1.5
    hidden_sigma: float = 4.0
    warned_phase_deg: float = 1.0
    warned_misfit: float = 3.0
    warned_outside: float = 0.01
    most_named: int = 5
    below_clipping: float = 0.9
    least_of_peak: float = 0.2
    largest_jump: float = 1.0
    most_lag: float = 0.02
    near_unit: float = 0.25
    n_curve: int = 60
    least_weight: float = 0.001
    n_draws: int = 400
    near_deg: float = 30.0
    least_line: float = 1.05
    farthest_reach: float = 4.0
    most_mass_steps: int = 6
    mass_converged: float = 1e-4
    flat_fraction: float = 0.01
