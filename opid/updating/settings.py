"""The tuned numbers of Bayesian updating, each with its reason; the choices of users are in `study`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class UpdatingThresholds:
    """Where the fits and samplers of an updating end, and what is refused or warned of."""

    farthest: float = 3.0  # ratio of frequencies (nine in stiffness) beyond which no updating explains them
    alike: float = 0.8  # modal assurance from which on a measured shape is that of a mode
    unlike: float = 0.3  # modal assurance below which a measured shape is not that of a mode
    # parts of even width of the amplitudes of a decay that give a point each: enough for any law, and few enough that
    # the many windows at small amplitudes do not outweigh those at large ones
    n_parts: int = 20
    least_range: float = 2.0  # ratio of amplitudes of a decay below which its frequency can hardly show a law
    apart: float = 0.1  # fraction by which curves of one mode may begin at different frequencies
    # fraction of the largest extension of a joint in any mode, below which its law has no effect
    least_extension: float = 1e-3
    # scatter of the points of good tests, as fractions of frequency and of motion: two curves that agree in coarser
    # digits may still be two tests
    repeated_frequency: float = 2e-4
    repeated_motion: float = 5e-3
    modes_above: int = 8  # modes above the highest that is named, among which the right one is searched
    prior_reach: float = 5.0  # standard deviations that are the range of a prior without an end
    # fraction of the upper end of a prior with the lower end 0, from which on the Ritz vectors are right
    least_ratio: float = 0.01
    peak_tolerance: float = 1e-6  # largest distance of the log density from its maximum; its rounding is 1e-9
    most_starts: int = 5  # draws of the prior at which the search for the linear parameters may begin
    unmixed_r_hat: float = 1.1  # R-hat of the linear parameters above which their chains cannot be trusted
    few_sets: int = 4  # number of curves of a mode below which their scatter is a poor estimate
    # standard deviations by which the updated eigenvalue may miss the mean of the measured ones, the curves of a mode
    # its linear frequency, and the force of a mode what the best parameters need
    missed_sigma: float = 3.0
    poor_mac: float = 0.8  # MAC of the updated shape with the measured ones below which they are hardly of one mode
    # ratio of the part of the lowest eigenvalues that nonlinearity makes to their other errors
    moved_sigma: float = 1.0
    # probability of the better fit of another power than the first below which it is taken: by chance it widens an
    # interval that is right
    lowest_chance: float = 0.2
    # powers of the amplitude by which small motions are extrapolated to none: springs, joints that slip (Iwan, Dahl),
    # and friction that slides at once
    lowest_powers: tuple[float, ...] = (2.0, 1.0, 0.5)
    lowest_reach: float = 3.0  # amplitude over the lowest one up to which points are taken for this
    n_amplitudes: int = 12  # amplitudes at which trial backbones are compared to find how the linear error grows
    fewest_amplitudes: int = 3  # amplitudes at which all of these backbones must have converged
    # growth of lambda below which a curve is linear, so that an error cannot grow with it
    least_growth: float = 1e-3
    # rms of a pattern of errors over that of the growth of lambda, from which on it is one of its own: below it, an
    # error of 0.4 % of a frequency bends a curve by less than a thousandth of its growth
    least_pattern: float = 0.02
    most_missing: float = 0.25  # largest fraction of the points of a curve that may be interpolated
    # smallest fraction of the amplitude range that solved points must span: the remainder is extrapolated
    least_span: float = 0.9
    # relative distance of a harmonic to a mode within which they may interact for some theta
    interaction_reach: float = 0.03
    # rms error of the pull of a mode that is met over the noise of a point, below which it is a part of that noise: few
    # points have all of it
    least_pull_error: float = 0.02
    # detunings of a mode that is met among which the most probable is searched, how far they reach in standard
    # deviations, and sweeps over several such modes
    n_detunings: int = 61
    farthest_detuning: float = 3.0
    n_sweeps: int = 2
    most_detuned: float = 2.5  # ... and from where on the structure has the mode elsewhere: by chance in one of 80
    detuning_step: float = 0.05  # step of their derivatives, in standard deviations: less than the width of a resonance
    # relative error of the damping ratio of the modes that are met: those of other modes are known no better
    damping_error: float = 0.5
    # standard deviation of the damping ratio of all modes where it is not stated, counted from none: ratios of metal
    # structures are a few tenths of a per cent
    unknown_damping: float = 0.005
    # maxima that are sought in turn with the interactions at the one before
    n_paired: int = 3
    # fraction of the points of a mode within the resonance of one that is met, above which its losses decide: with two
    # thirds the coefficient of a small structure was off by three of its standard deviations, with a fifth by two
    most_within: float = 0.4
    most_steps_of_pull: int = 60  # steps, each half of the remaining one, by which a curve finds its own pull
    n_weighings: int = 10  # fits of a curve's offset and slope, after which single points far off hardly count
    # damping ratio of the modes that are met for what their pull on omitted interactions would do to theta: at usual
    # ones the points next to the resonance, which are told apart by pairing alone, would count too much
    omitted_damping: float = 0.01
    # standard deviations by which that may move theta: an interval that is off by so much holds in 92 % of cases. It is
    # 0 on the wing, and 4.6 to 19 where an interaction moves the joints much (updating_figures.py, rows interaction)
    most_omitted: float = 0.5
    # standard deviations by which a point in an interaction may lie off the curve: no point of a sound set is as far
    unpaired_sigma: float = 5.0
    n_starts: int = 256  # draws of the prior among which the search for the maximum starts
    # of them, those from which the slopes are followed where a joint slips
    n_approached: int = 12
    most_iterations: int = 40  # iterations of a search for a maximum; ten are usual, unless the density has steps
    rough_drop: float = 1.0  # drop of the log density to which a rough quadratic reaches along each parameter
    most_chains: int = 20  # Metropolis chains side by side
    shortest_chain: int = 250  # samples of one chain below which there are fewer chains
    n_walks: int = 4  # chains of the no-U-turn sampler: the fewest with which R-hat tells whether they agree
    # samples in which each of them learns its steps; its coordinates begin with the covariance of the posterior
    steps_learnt: int = 200
    usual_steps: int = 4  # steps of a walk along the slope for one sample, by which its progress is told
    most_divergent: float = 0.01  # fraction of walks that went astray above which a bound cuts the posterior off
    warm_up: int = 11  # number of samples of which one is warm-up: 500 of 5500, as in Song et al
    n_moves: int = 5  # Metropolis steps of each particle in each stage of transitional Monte Carlo
    most_by_quadrature: int = 3  # parameters up to which the evidence is integrated by quadrature
    most_nodes: int = 6_000  # evaluations after which quadrature of one or two parameters gives up ...
    most_nodes_of_three: int = 60_000  # ... and of three parameters
    proposal_freedom: float = (
        5.0  # degrees of freedom of the proposal for the evidence: tails that weigh no draw too much
    )
    # fraction of those draws that they are worth, below which their scatter does not tell their error
    least_worth: float = 0.05
    aimed_acceptance: float = 0.3  # fraction of accepted proposals to which the jumps of transitional MCMC are scaled
    # coefficient of variation of the weights in each stage; a smaller one needs more stages (Ching & Chen 2007)
    weight_variation: float = 1.0
    most_stages: int = 500  # stages after which the likelihood has no maximum that particles can reach
    few_samples: float = 200.0  # effective samples below which a 95 % interval is rough, ...
    fewest_samples: float = 10.0  # ... and below which it is none: its ends are then the extremes of a few values
    most_r_hat: float = 1.05  # R-hat above which the chains of a class have not found the same distribution
    # two evidences get a warning if their logarithms differ by more than this ...
    methods_differ: float = 0.5
    methods_sigma: float = 3.0  # ... and this number of their standard deviations
    # probability, for all modes together, below which a misfit that is common to all curves is not chance
    rare: float = 1e-3
    # fraction of the measured growth of lambda; many curves may show a smaller misfit, but it does no harm
    least_misfit: float = 0.05
    # fraction of that growth that a bump alike in all curves may have: that of points in a right interaction is 0.4 %,
    # in one that the structure has elsewhere 1.6 % and more (tests/test_kept_interactions.py)
    least_bump: float = 0.01
    n_bump_parts: int = 10  # parts of the amplitude in which a bump is looked for: half of the points of a usual curve
    fewest_alike: int = 3  # curves that must show a part, so that their scatter tells what is chance
    # rms error of the force over the amplitude, as a fraction, that calibration and noise do not explain: dampers of
    # another kind miss it by more
    least_force_misfit: float = 0.03
    # standard deviations of an error that is stated up to which it may explain a misfit
    stated_sigma: float = 3.0
    most_force_noise: float = 4.0  # rms error of the force over the noise that is stated, above which it is no noise
    # distances of a band's end from its median beyond which a higher harmonic contradicts the model: about four
    # standard deviations, for the errors of a sensor are common to all of its points, and there are many sensors
    far_from_band: float = 2.0
    most_far: float = 0.1  # fraction of the points of a sensor that may be as far: single points are read wrong
    # relative distance of a harmonic to a mode within which an error of that mode changes it noticeably: 0.4 % of the
    # frequency are then 3 % of the harmonic
    harmonic_reach: float = 0.15
    # A mode near a harmonic counts from this motion on, over that of the mode that moves the sensor most.
    least_part: float = 0.3
    # fraction of the points whose band excludes 0 that a wrong sign or unit must explain
    explained: float = 0.8
    # standard deviations beyond which measurements contradict the others or the structure: many are looked at
    contradicting_sigma: float = 4.0
    # ratio less 1 of amplitudes from which on it is told: a wrong law, or a shape that is wrong, imitates less
    least_apart: float = 0.15
    # ratio of the amplitudes at which a curve and the others of its mode have grown alike, from which on its unit is
    # another one: the model tells smaller ones better
    another_unit: float = 1.8
    # first amplitude of a curve over that at the compared growth up to which it begins at small amplitudes
    small_start: float = 0.4
    # misfit of the shapes with two sensors exchanged over that as they are, from which on it is no chance
    better_exchanged: float = 0.8
    # growth of a curve over that of the model below which it counts as this, for its logarithm is needed
    least_grown: float = 0.01
    # standard deviations of the gain of a sensor beyond which it is an error of its calibration: below it, the
    # intervals of sound sets would grow by chance
    odd_gain_sigma: float = 2.0
    # velocity beyond which no amplitude is one of a structure: stress is velocity times density times speed of sound,
    # and metals yield at 10 to 20 m/s, fibres at twice that (Hunt 1960)
    most_velocity_m_per_s: float = 50.0
    # motion over that of the sensor that moves most, from which on a sensor tells its gain
    least_motion: float = 0.3
    # deviations at which the misfit of an entry of a shape counts no more, so that one sensor does not decide
    most_misfit: float = 6.0
    # fraction of that growth that a class may leave unexplained where curves are too short to show their noise
    most_unexplained: float = 0.3
    # degrees of freedom with which the expected scatter between curves counts beside the observed one
    expected_weight: int = 10
    # fraction of the growth of the frequencies; a class that moves them less anywhere in its prior has no effect
    least_moved: float = 0.05
    n_tried: int = 20  # draws of the prior at which a class must move the frequencies
    n_checked: int = 200  # samples at which the convergence of the model is checked, ...
    far_out: float = 3.0  # ... and factor of their distance from the best theta at which it is checked, too
    too_close: float = 1.0  # difference of log evidence below which two classes cannot be distinguished
    ruled_out: float = 10.0  # log evidence below that of the best, odds of 22,000 to 1, of a class that data rule out
    # fraction of the measured points in a 95 % band below which law or linear structure are wrong
    poor_coverage: float = 0.8
    # the same fraction for curves that are left out, of which there may be few: one odd curve of five lowers it to 0.8
    poor_left_out: float = 0.7
    n_predicted: int = 400  # draws that make a band: its ends are then 0.1 deviations off
    # draws that are weighed by the likelihood of the other modes, ...
    n_weighed: int = 2000
    # ... and number of equal ones that they must be worth: fewer do not tell how uncertain the parameters are
    fewest_left: float = 30.0
    # smallest amplitude of a mode without curves over its largest one, as in usual tests
    least_amplitude: float = 0.05
    # draws of a response to a force, each of which takes a tenth of a second: the ends of its interval are then 0.2
    # deviations off, ...
    n_responses: int = 100
    n_drawn: int = 30  # ... and those of them that a figure shows: more hide each other
    # degrees between the phases of a response: a parabola through three of them misses its peak by 4e-5
    phase_step: int = 10
    # fraction of the draws without a resonance above which the others do not tell the interval
    most_lost: float = 0.05


UPDATING = UpdatingThresholds()
