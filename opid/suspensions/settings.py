"""Every tuned number of the estimator, with its reason. To change one, pass another `Settings`.

Each result prints the values, so that an answer can be traced to them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

METHODS = ("model", "classical", "paper")
"""Methods of identification: the driven model, the paper's chain mended, and the paper's chain as printed."""

METHODS_OF_LAW = ("pursuit", "sparse regression", "both")
"""Methods of searching the law of the driven model."""


@dataclass(frozen=True)
class Verdicts:
    """Thresholds of the whole package, on the residual over the noise known beforehand unless something else is said.

    Args:
        explained: up to this the model explains the runs: estimated noise floors scatter by a tenth.
        noted: above this the residual of a single gear is worth a warning.
        doubtful: above this the answer is limited by what the model lacks, no longer by noise.
        refused: above this laws and faults are searched only if their expected improvement is large, and no number is
            reported for a body on several suspensions, for a user's own structure, or by the classical chain.
        refused_fraction: a doubtful model is refused where its free motion leaves more than this fraction of the body's
            rms acceleration: it then explains less than 36 % of the power.
        contact_fraction: a body that is refused is said to rub on the ground if friction against the ground explains
            more than this fraction of the power that its suspension leaves while it slides.
        followed_fraction: a model whose prediction errors are noise and less than this fraction of the readings follows
            them, although its free motion may not: the motion of a very hard spring depends on its start forever.
        loosely_known: a value is not determined if its standard deviation exceeds this fraction of it.
    """

    explained: float = 1.2
    noted: float = 1.5
    doubtful: float = 3.0
    refused: float = 20.0
    refused_fraction: float = 0.8
    contact_fraction: float = 0.8
    followed_fraction: float = 0.01
    loosely_known: float = 0.25


@dataclass(frozen=True)
class RunSettings:
    """How runs are prepared, and what is known of them beforehand.

    Args:
        band_hz: band in which prediction errors are compared, Hz: below it sensors drift, above it struts respond
            little.
        highest_fraction: lines above this fraction of the sampling rate are not compared: the filters of loggers cut
            there.
        lowest_rate_hz: the model takes at least this many steps a second, so that runs of a lower rate are sampled
            finer ...
        rate_over_band: ... or this many times the highest compared line, Hz, if that is less: a building that is
            compared up to 8 Hz needs fewer steps than a gear.
        finer_without_drive: a run whose drive was not measured takes this many times as many steps: the drive is then
            constant over each step, and at 250 Hz the damping seems to grow by 8 % up to 40 Hz, which a law with memory
            and a delay made up for (BIC up to 98 better than that of the true law; at 500 Hz never better).
        least_lines: a band of fewer lines is refused.
        stop_db: attenuation in dB of what decimation would alias into the band.
        stop_width: transition width of the anti-aliasing filter, as a fraction of the coarse rate.
        least_noise_fraction: least noise, as a fraction of the motion: no strut model is better, however quiet the
            sensor.
        most_noise_fraction: the residual of a low-pass filtered log counts as sensor noise up to this fraction of
            the motion: sensors with more noise are not used in such tests.
        offset_m_per_s2: standard deviation of the offset that is left in an acceleration once its mean is removed.
        offset_ac_m_per_s2: the same for an AC-coupled sensor, which loses more of the slow motion.
        start_rms: standard deviation of travel and velocity at the first sample, in rms motions.
        start_displacement_m: standard deviation of the height of the ground below an AC-coupled sensor at the first
            sample.
        start_velocity_m_per_s: the same for the velocity of that ground.
        ground_drift_m: standard deviation of the ground's height about its mean. A spring to the ground needs the
            position of the body, which accelerometers do not observe; without this prior a wrong law lets it drift by
            metres and is never found out. It is ten times the unevenness of a taxiway.
        ground_drift_paths: the same as a multiple of what a parabola leaves of the measured path: on a hill the offset
            of the sensor may hide more than on flat ground.
        least_s: shortest run of a body on several suspensions, s: three periods of the lowest compared line.
        reduced_above_hz: runs from files with a higher rate are decimated, unless the study gives `fs_hz`: every sample
            costs time, and the band ends far below ...
        reduced_to_hz: ... by a whole number, to no less than this rate.
        drive_steps: rms step of a drive that was not measured, from sample to sample, in those of the acceleration that
            the travel shows below the suspension: more than one, because fast motion is lost in the noise of a travel.
        coherence_s: length of the blocks for the coherence with the motion below, s.
    """

    band_hz: tuple[float, float] = (0.3, 40.0)
    highest_fraction: float = 0.4
    lowest_rate_hz: float = 250.0
    rate_over_band: float = 6.25
    finer_without_drive: float = 2.0
    least_lines: int = 20
    stop_db: float = 60.0
    stop_width: float = 0.1
    least_noise_fraction: float = 0.003
    most_noise_fraction: float = 0.1
    offset_m_per_s2: float = 0.03
    offset_ac_m_per_s2: float = 0.1
    start_rms: float = 2.0
    start_displacement_m: float = 0.05
    start_velocity_m_per_s: float = 0.3
    ground_drift_m: float = 0.02
    ground_drift_paths: float = 4.0
    least_s: float = 10.0
    reduced_above_hz: float = 1100.0
    reduced_to_hz: float = 500.0
    drive_steps: float = 3.0
    coherence_s: float = 2.0


@dataclass(frozen=True)
class StartSettings:
    """How start values are found: from the equation of motion on integrated accelerations.

    Args:
        band_hz: band of the equation, Hz: there integration is accurate and a suspension responds.
        high_pass_hz: corner of the high-pass filter of the integration.
        least_fraction: a term must explain this fraction of what is left without it.
        most_terms: most terms of the law that the fit begins with.
        n_scales: number of scales at which each term is tried ...
        scale_fractions: ... in logarithmic steps between these fractions of the range in which a scale can be seen: at
            the lower end friction is a step, at the upper end a term hardly bends.
        ground_fraction: a fit begins with a ground spring where the equation finds one above this fraction of K ...
        ground_std: ... and above this many of its standard deviations.
        lag_std: a delay with a stated tolerance is searched within this many standard deviations ...
        n_lags: ... on a grid of this many values ...
        lag_rounds: ... in this many rounds, each between the neighbours of the best value of the last grid ...
        lag_fraction: ... in the band from this fraction of the highest line up to it.
        sliding_fractions: a body that rubs on the ground slides while its speed is above the second of these fractions
            of its rms, because near rest the low-pass of a record rounds what a friction does; the others tell how much
            the value depends on that.
        n_parts: number of parts of the runs without each of which the natural frequency of such a body is found again.
    """

    band_hz: tuple[float, float] = (0.5, 12.0)
    high_pass_hz: float = 0.3
    least_fraction: float = 0.08
    most_terms: int = 2
    n_scales: int = 5
    scale_fractions: tuple[float, float] = (0.28, 0.98)
    ground_fraction: float = 0.03
    ground_std: float = 5.0
    lag_std: float = 2.5
    n_lags: int = 11
    lag_rounds: int = 2
    lag_fraction: float = 0.1
    sliding_fractions: tuple[float, float, float] = (0.25, 0.5, 1.0)
    n_parts: int = 8


@dataclass(frozen=True)
class FitSettings:
    """How the vector of unknowns is fitted: by nonlinear least squares of the prediction errors.

    Args:
        noisier: decreasing factors on the noise of the lower sensors (continuation): with much noise below, the
            readings on the body hold the motion near the truth while the parameters are still wrong. The second
            sequence is tried where the first leaves too much: sequences reach different local minima.
        start_reach_rms: travel and velocity at the start of one gear's run are searched up to this many rms motions ...
        n_start_grid: ... on a grid of this many points along each ...
        start_rounds: ... in rounds of a time, s, and a number: the points that are left are predicted over this time,
            and this number of the best is kept.
        most_evaluations: most predictions of all runs in a fit from start values.
        most_refit_evaluations: the same in a fit that begins near its minimum.
        mass_fractions: a fit that begins with the runs without loading alone tries masses of which the largest loading
            is a fraction between these ...
        n_mass_fractions: ... at this many values, in logarithmic steps.
        usual_mass_fraction: a usual loading, as a fraction of the mass. It gives about how far apart runs rest, and so
            how long the scales of their laws may be: in a gear whose runs rest four rms travels apart, a scale of 3.8
            rms travels was held at 3, and the mass came out 17 % too large.
        hopeless_piece_s: while the residual is far above the noise, laws and faults are tried on a piece of this length
            of each run, s; it is longer where it would not hold four periods of the lowest line.
        most_hopeless_evaluations: most evaluations at the full rate of a fit far above the noise: it has already been
            fitted at the coarse rate.
        least_promise: a fit ends when the next step promises a smaller fall of the squared error over its variance.
        promise_in_search: the same while laws are searched, and in fits that leave one run out.
        promise_from_afar: the same during continuation.
        negligible_promise: where the last step promised less than this, the errors before it are kept as those
            after it: it moves no parameter by more than three hundredths of its standard deviation.
        largest_log_step: largest step of the logarithm of a positive entry.
        farthest_std: coordinates and faults of sensors are fitted within this many standard deviations of their stated
            values.
        slide_beyond: friction with memory slides after some travel, which is fitted up to this many times the longest
            that a search offers: a travel of 13 rms travels, held at 3, left 4 times the noise and a stiffness 33 %
            off.
        unknown_periods: the initial force of each slider of a joint is unknown, so this many mean periods of the motion
            are not compared: in a run of 40 s the first 4 s, 15 times the noise, biased the mass by 1.5 % ...
        most_unknown_fraction: ... but never more than this fraction of a run.
        held_fraction: during continuation the standard deviations of coordinates and carried weight are multiplied by
            this, so that they cannot compensate for what is still wrong.
        fastest: largest rate of the motion times the step length: at this value one step shifts the motion by 0.2 %.
        turnover_in_step: largest rate at which friction lets a velocity die away at rest, times the step length. Beyond
            it the found model is fitted with more steps for each sample: at 0.6 damping was off by seven standard
            deviations, at 0.2 by none.
        most_steps: most steps of the model for each sample.
        most_folded: most power that a coarse rate may alias into the band, over that of the noise.
        same_std: fits of one model ended at the same minimum if no parameter differs by more standard deviations.
        first_damping: Levenberg-Marquardt damping after a step that failed, over the squared norm of each column ...
        least_damping: ... and below this it becomes zero: a Gauss-Newton step is taken.
    """

    noisier: tuple[tuple[float, ...], ...] = ((100.0, 20.0, 4.0), (30.0, 5.0))
    start_reach_rms: float = 2.5
    n_start_grid: int = 9
    start_rounds: tuple[tuple[float, int], ...] = ((0.5, 16), (2.0, 1))
    most_evaluations: int = 50
    most_refit_evaluations: int = 15
    hopeless_piece_s: float = 12.0
    most_hopeless_evaluations: int = 4
    mass_fractions: tuple[float, float] = (0.01, 0.6)
    n_mass_fractions: int = 16
    usual_mass_fraction: float = 0.15
    least_promise: float = 1e-2
    promise_in_search: float = 1.0
    promise_from_afar: float = 10.0
    negligible_promise: float = 1e-3
    largest_log_step: float = 1.0
    farthest_std: float = 8.0
    slide_beyond: float = 7.0
    unknown_periods: float = 10.0
    most_unknown_fraction: float = 0.25
    held_fraction: float = 1e-3
    fastest: float = 0.7
    turnover_in_step: float = 0.2
    most_steps: int = 8
    most_folded: float = 2.0
    same_std: float = 0.1
    first_damping: float = 1e-3
    least_damping: float = 1e-6


@dataclass(frozen=True)
class SearchSettings:
    """How the law of a suspension is searched.

    Args:
        n_scales: number of scales at which a kind is simulated, in logarithmic steps over the range where they can be
            seen.
        n_between: columns that are interpolated between two simulated scales.
        faint: force of a candidate in the simulation, over the noise: small enough not to change the motion.
        largest_log_step: a scale is shifted along its derivative by at most this in its logarithm, about as far as the
            next one.
        nearly_parallel: a column is skipped if the part of it outside the span of the others has less than this
            fraction of its squared norm.
        bic_margin: a larger law must lower the information criterion by this ...
        error_margin: ... and the error by this fraction, divided by the number of laws: smaller gains come from sensor
            faults.
        inner_margin: a law with as many terms must lower the criterion by this for each further inner parameter: of
            laws that fit alike the simpler one is taken.
        first_order_error: laws whose expected improvement is too small by this fraction of the error are fitted
            nevertheless, because the expectation holds to first order only.
        n_refitted: number of laws that are fitted in a round.
        n_rounds: most rounds; in each the law may change by one step.
        most_terms: most terms of the law of one suspension.
        most_exchanged: most terms that are exchanged at once: two similar terms can each keep the other in the law.
        n_neighbours: number of rejected laws that are fitted for comparison in the report.
        alike_bic: laws whose criteria are closer cannot be distinguished.
        surely_behind_bic: a law behind by more than this at the coarse rate is dropped. It is neither fitted at the
            full rate, which doubles the difference, nor for the report: departures between runs, which are fitted after
            the search, change differences by tens.
        far_fraction: a law whose error at the coarse rate exceeds that of the chosen one by more than this fraction is
            not fitted at the full rate. For gears with memory the excess was up to 0.0005 for similar laws and 0.7 to
            11 for others.
        overfit_fraction: a law is too large only if a smaller one leaves at most this fraction more: a needless term
            lowers the error by a few per cent; where a right law was given up, the smaller one left 5 and 11 times as
            much.
        good_fraction: if a fit would be refused, laws are tried only if the best of them are expected to explain this
            fraction of the squared error, to first order: no law explains the residual of a wrong structure. In
            aircraft that bend, the best laws are expected to explain 1 to 6 %.
        scale_fractions: scales are tried between these fractions, in the logarithm, of the range in which they can
            be seen: at its lower end friction is a step, at its upper end a straight line.
        lags: delays at which a law that mixes travel and velocity is tried, over the ratio of their rms.
        most_measured_rms: scales cover the predicted motion, but at most this many times the measured one: while a
            model is wrong, its slow travel may be far off.
        least_damping_std: beside a law with memory, the damping must not be negative by more standard deviations.
        rest_fraction: the tangent stiffness at rest must not be negative by more than this fraction of its mean over
            the motion: the body would fall away from such a rest.
        farthest_mean_rms: beside a spring to the ground, the mean travel of some run must lie within this many rms
            travels of rest: a law about a rest 3.5 rms away had 2.6 times the true stiffness, and an interval that did
            not hold.
        every_sample: the rms force of a candidate uses every n-th sample; a rough value is enough.
        least_shared: no law is searched for a gear where less than this fraction of the body's power is coherent with
            the motion below. It is within 0.02 of zero for two channels of noise, and large even for gears that stick
            and slip.
    """

    n_scales: int = 4
    n_between: int = 4
    faint: float = 1e-5
    largest_log_step: float = 0.5
    nearly_parallel: float = 1e-7
    bic_margin: float = 10.0
    error_margin: float = 0.005
    inner_margin: float = 0.0
    first_order_error: float = 0.0
    n_refitted: int = 3
    n_rounds: int = 8
    most_terms: int = 4
    most_exchanged: int = 2
    n_neighbours: int = 2
    alike_bic: float = 10.0
    surely_behind_bic: float = 100.0
    far_fraction: float = 0.1
    overfit_fraction: float = 0.2
    good_fraction: float = 0.1
    scale_fractions: tuple[float, float] = (0.4, 0.98)
    lags: tuple[float, ...] = (0.3, 1.0, 3.0)
    most_measured_rms: float = 3.0
    least_damping_std: float = 2.0
    rest_fraction: float = 0.1
    farthest_mean_rms: float = 2.0
    every_sample: int = 7
    least_shared: float = 0.05


@dataclass(frozen=True)
class OriginSettings:
    """How the origin of a law is searched elsewhere than at rest.

    Args:
        distances: distances of the origin from rest, in static deflections of a linear spring of the tangent stiffness:
            a spring that stiffens deflects less, one that softens more.
        finer_reach: around the best of them the origin is searched on a finer grid, up to this factor away ...
        n_finer: ... at this many distances: a fit that begins far off takes many steps along a valley.
        n_scales: number of scales of each kind, in logarithmic steps.
        n_travels: number of travels at which forces are compared.
        n_fitted: number of laws that are fitted, those with the nearest force.
        n_rounds: rounds of the search, each from the better law of the last one.
        least_bend: a force closer to a straight line than this fraction of it needs no law.
        balance_std: of laws with nearly the same force, those are preferred that balance the weight to about this
            fraction.
    """

    distances: tuple[float, ...] = (0.25, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 2.0, 2.8)
    finer_reach: float = 1.4
    n_finer: int = 29
    n_scales: int = 12
    n_travels: int = 200
    n_fitted: int = 4
    n_rounds: int = 3
    least_bend: float = 1e-4
    balance_std: float = 0.2


@dataclass(frozen=True)
class GasSettings:
    """What is known of a column of gas that carries a gear.

    Args:
        carried: standard deviation of the static force of the gas about weight plus air pressure on the piston,
            relative; also of a spring beside the gas about zero, over the stiffness of the gas. Lift and seals carry
            about this much of a taxiing gear. Runs that contradict it clearly are believed.
        carried_unstated: the same where the piston area is not stated: the air pushes with 1 to 5 % of the weight, and
            with more of it the lower the pressure of the gas.
        pressures_pa: range of gauge pressures at which struts are serviced, from light aircraft to large ones; beyond
            it the stated piston area is doubtful.
        far_std: an exponent that lies this many standard deviations from its known value is not that of gas alone.
    """

    carried: float = 0.005
    carried_unstated: float = 0.02
    pressures_pa: tuple[float, float] = (3e5, 4e7)
    far_std: float = 2.0


@dataclass(frozen=True)
class RegressionSettings:
    """How sparse regression, the second method beside the search above, proposes laws.

    Args:
        n_samples: number of samples in the regression.
        n_blocks: number of blocks of time, each left out in turn.
        thresholds: a term is dropped if its coefficient is smaller, as a fraction of the force beyond stiffness and
            damping.
        relaxation: relaxation of SR3: how closely the sparse coefficients follow the full ones.
        block_margin: a larger law must lower the error of the blocks left out by this fraction.
        n_rounds: rounds in which inner scales are fitted and terms chosen in turn.
        n_refitted: number of laws that are fitted by the model in a pass.
        n_passes: number of passes; each regresses on the motion that the better model predicts.
        most_terms: most terms of a law.
    """

    n_samples: int = 6000
    n_blocks: int = 10
    thresholds: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.4)
    relaxation: float = 1.0
    block_margin: float = 0.01
    n_rounds: int = 3
    n_refitted: int = 3
    n_passes: int = 4
    most_terms: int = 3


@dataclass(frozen=True)
class ProcessSettings:
    """How it is decided whether a fit is limited by unmeasured forces or by the model itself.

    Args:
        fractions: rms accelerations from unmeasured forces that are tried, over that of the readings: from the smallest
            on the readings hold the predicted motion, and beyond the largest nothing changes.
        corners: corners of the spectral density of these accelerations that are tried, over the highest line.
        bands_per_octave: number of bands in an octave; in each the errors may have their own rms ...
        least_lines: ... and each has at least this many lines, so that the rms is known to a fifth.
        n_rounds: most rounds of fitting and of estimating these rms values in turn.
        least_gain: the rounds end when the log likelihood rises by less.
        same_std: the fits with and without process noise agree if no parameter differs by more standard deviations.
            True models with an unmeasured force on the body differed by 0.2 to 0.7, wrong ones by 5 and more.
        same_std_of_body: the same for several suspensions, whose structure is judged by `least_coherent`: in 27 true
            models the largest of seven departures was 0.4 to 2.1.
        most_promised: a given law is wrong if another one is expected to explain more than this fraction of the squared
            error. For a stop that one run hit, and that the law lacked, the fraction was 0.23 to 0.43 and the mass was
            biased by 5 %; beside unmeasured forces it was at most 0.001.
        most_left_by_simpler: if a law compensates for an error of the model, one with fewer terms is tried, which may
            leave this many times the rms error. An Iwan joint of six sliders in place of forty leaves 1.2 times as much
            alone as beside a damper, which only biases its values.
        surely_other_std: beyond this departure, in standard deviations, no better process noise is searched.
        piece_s: under a wrong model the parameters are fitted to pieces of this length, s, ...
        most_pieces: ... at most this many of each run.
        n_free_fits: number of fits of the free motion, in which each run is weighted by what the last fit left of it.
        least_coherent: the residual of several suspensions is due to an unmeasured force if a smaller fraction
            of its power is coherent with the motion below. The fraction was -0.01 to 0.01 in 27 true models with such a
            force and two runs of 20 s, 0.12 to 0.23 in fits at a wrong minimum, and 0.9 in a body that bends.
        most_coherent: laws are searched under process noise if a smaller fraction is coherent: a missing friction
            leaves 0.1.
    """

    fractions: tuple[float, ...] = (0.03, 0.3)
    corners: tuple[float, ...] = (0.075, 0.75)
    bands_per_octave: float = 3.0
    least_lines: int = 12
    n_rounds: int = 4
    least_gain: float = 1.0
    same_std: float = 2.0
    same_std_of_body: float = 3.0
    most_promised: float = 0.05
    most_left_by_simpler: float = 1.5
    surely_other_std: float = 6.0
    piece_s: float = 20.0
    most_pieces: int = 3
    n_free_fits: int = 2
    least_coherent: float = 0.05
    most_coherent: float = 0.5


@dataclass(frozen=True)
class FaultSettings:
    """What is added to the model if the runs demand it: ground springs, or sensor faults that are not stated.

    Args:
        least_score: hypotheses with a lower score are not fitted; under a right model it is chi-square with one degree
            of freedom.
        bic_margin: a hypothesis must lower the information criterion by this ...
        error_margin: ... and the error by this fraction.
        alike_bic: explanations whose criterion is this close to the best one cannot be distinguished from it.
        gain_tolerance: standard deviation of the gain of an uncalibrated sensor, relative.
        lag_samples: standard deviation of the delay between channels of a multiplexing logger, in samples.
        corner_hz: corner of a usual AC coupling.
        corner_tolerance: standard deviation of that corner, relative.
        slight_corner_hz: corner of a negligible AC coupling. Scores are taken here, and no lower corner is fitted: a
            sensor that is stated to be AC-coupled may not be, however narrow the tolerance.
        least_corner_hz: an AC coupling with all corners below this is no coupling: it only frees the offsets of the
            sensors and compensates for something else.
        least_gain: lower bound of a fitted gain: readings are divided by it.
        alone_fraction: runs stated to be alike contradict each other if each fitted alone leaves less than this
            fraction of what all leave together. The cause is an unstated mass change, for which sensor faults would be
            fitted otherwise.
        ground_fraction: the equation of motion demands a ground spring only above this fraction of the stiffness: below
            it, the bias from noise is as large.
        sure_ground_std: if no ground spring that a fit began with is this many standard deviations from zero, a fit
            without them is tried, too. A spring that matters is known to a per cent.
        plausible_std: a fault that lies this many standard deviations from what such sensors do may stand in for
            something else. AC coupling is added all the same where it leaves less than `Verdicts.noted`.
        n_farther: number of rounds in which such corners are searched about those found, each up to five times as high.
        helps_fraction: faults that do not yet explain the runs are kept only if the error falls by this fraction.
        coupling_helps: an AC coupling that lowers the error by this fraction before any law is searched is kept during
            the first law search, and springs to the ground are left out. On five aircraft with couplings it lowered the
            error by 3.2 to 31 %, on others by 0 to 1.4 %, on four that bend by 1.6 to 2.4 %, where it only costs time.
        nearly_explained: below this residual over the noise, added faults are kept and the noise of the two sides is
            estimated separately: the little that is left may be due to the law.
        good_fraction: if a fit would be refused, faults other than AC coupling are tried only if they are expected to
            explain this fraction of the squared error. In an aircraft that bends, gains were expected to explain 10 to
            20 % and explained 4.
        most: most faults that are added.
        looked_at: number of hypotheses fitted in a round, those with the highest scores.
        contradicted_std: the runs contradict a stated fact if the fit moves it by more standard deviations.
    """

    least_score: float = 30.0
    bic_margin: float = 20.0
    error_margin: float = 0.002
    alike_bic: float = 10.0
    gain_tolerance: float = 0.03
    lag_samples: float = 2.0
    corner_hz: float = 0.25
    corner_tolerance: float = 0.5
    slight_corner_hz: float = 2e-4
    least_corner_hz: float = 2e-3
    least_gain: float = 0.2
    alone_fraction: float = 0.5
    ground_fraction: float = 0.005
    sure_ground_std: float = 20.0
    plausible_std: float = 5.0
    n_farther: int = 2
    helps_fraction: float = 0.3
    coupling_helps: float = 0.025
    nearly_explained: float = 2.0
    good_fraction: float = 0.2
    most: int = 3
    looked_at: int = 4
    contradicted_std: float = 3.0


@dataclass(frozen=True)
class RepeatabilitySettings:
    """How much suspensions may differ from run to run.

    Args:
        usual: relative standard deviation of springs, damping and friction from run to run where the study states none:
            seals settle, gas and oil warm up by some kelvins.
        doubt: log standard deviation of the stated repeatability, as a factor. Intervals then hold in 92 to 95 % of
            flights that differ as stated (`benchmarks/unlike_flights.py`), and in more of those that differ less.
        reach: range of the values that are weighed, as powers of that factor: from far below what data can show to
            where runs would contradict each other.
        n_levels: number of these values, about ten to a power of ten.
        bic_margin: once departures between runs are fitted, laws and faults are searched again if the criterion falls
            by this: those found for runs that are alike may compensate for the departures.
        farthest_std: departures are fitted up to this many standard deviations: runs that differ by more contradict
            each other.
        contradicted: the runs contradict the stated repeatability if they show more than this many times as much ...
        contradicted_weight: ... with this probability.
        rules_below: if the interval of the mass would shrink below this fraction were all runs alike, repeatability
            limits it.
        gain_doubt: log standard deviation, as a factor, of the stated repeatability of the gain of a strut sensor: less
            than that of suspensions, because amplifiers and gauges are made to stay as they are.
        gain_powers: values of it that are weighed, as powers of that factor; smaller ones do not widen an interval.
    """

    usual: float = 0.01
    doubt: float = 10.0
    reach: tuple[float, float] = (-3.5, 1.0)
    n_levels: int = 46
    bic_margin: float = 20.0
    farthest_std: float = 5.0
    contradicted: float = 2.0
    contradicted_weight: float = 0.9
    rules_below: float = 0.5
    gain_doubt: float = 2.0
    gain_powers: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0)


@dataclass(frozen=True)
class IntervalSettings:
    """How well the parameters are known, and what is reported of it.

    Args:
        lines_per_cell: number of neighbouring lines whose errors may be correlated: as wide is a mode with some per
            cent damping in a run of 40 s.
        white_below: bound on Kolmogorov's statistic of the cumulative periodogram (Bartlett 1955), which white noise
            exceeds in 1 of 1000 runs.
        n_bands: number of bands among which the largest residual is searched.
        bootstrap_s: length of the blocks of time that are resampled, s.
        n_bootstrap: number of resamples: standard deviations from so few scatter by 7 %.
        equal_gains: gains of two sensors are never closer than this, relative, and their difference imitates a ground
            spring.
        largest_noise_ratio: largest ratio of the noise below to the noise on the body, and of the reverse.
        least_noise_gain: the assumed ratio of the noise is kept unless another one raises the log likelihood by this.
        noise_probe: step of the logarithm of that ratio, to test whether another one would.
        widening_named: a sensor fault that widens an interval by this factor is named.
        alike_cosine: one cause imitates another if the cosine between their effects on the errors is larger.
        least_motion: a motion below this many times the noise does not determine its inertia.
        far_std: a coordinate is named if the fit moves it by more standard deviations.
        negligible_ground: a ground spring below this fraction of K is not worth a warning.
        impossible_ground_std: a ground spring this many standard deviations below zero is not one: something else pulls
            at the body. Noise alone makes two of them, and usual differences of gains three.
        same_frequency: runs of one mass differ if their natural frequencies do by more than this fraction.
        least_remainder: a run that is left with less than this fraction of the mass has a mistyped mass change.
        softened: a joint inside a structure is determined if reducing its spring and damper to this fraction ...
        least_hold: ... raises the squared error over its variance by this: its own resonance always finds some noise to
            explain.
        few_elements_fraction: standard deviation of a damper beside a joint of sliders, as a fraction of the damping
            that dissipates as much as the joint. Twenty elements dissipate slightly less than the sliders of a joint,
            and the damper compensates for it; row iwan_friction of benchmarks/memory_laws.py shows that intervals then
            hold.
        imitating_gain: gain error that is compared with a ground spring. This value and the next ones are easy to
            picture; how far a fit may move them is in `FaultSettings`.
        imitating_corner_hz: corner of an AC coupling of one sensor alone, for the same comparison.
        imitating_lag_s: delay between the channels, for the same comparison.
        imitating_slight_hz: corner at which the derivative is taken for a sensor without AC coupling.
    """

    lines_per_cell: int = 16
    white_below: float = 1.95
    n_bands: int = 10
    bootstrap_s: float = 0.5
    n_bootstrap: int = 100
    equal_gains: float = 0.001
    largest_noise_ratio: float = 10.0
    least_noise_gain: float = 4.0
    noise_probe: float = 0.3
    widening_named: float = 1.2
    alike_cosine: float = 0.7
    least_motion: float = 2.0
    far_std: float = 3.5
    negligible_ground: float = 0.002
    impossible_ground_std: float = 5.0
    same_frequency: float = 0.01
    least_remainder: float = 0.2
    softened: float = 0.01
    least_hold: float = 40.0
    few_elements_fraction: float = 0.002
    imitating_gain: float = 0.01
    imitating_corner_hz: float = 0.1
    imitating_lag_s: float = 1e-3
    imitating_slight_hz: float = 1e-3


@dataclass(frozen=True)
class SurfaceSettings:
    """The force without a law, cell by cell.

    Args:
        n_cells: number of cells along each coordinate.
        reach_rms: the cells cover this many rms motions on either side.
        least_count: a cell with fewer samples has no value.
        section_rms: a section uses the samples within this many rms of the other coordinate.
        seen_std: a departure is significant above this many standard errors.
    """

    n_cells: int = 16
    reach_rms: float = 3.0
    least_count: int = 20
    section_rms: float = 0.3
    seen_std: float = 3.0


@dataclass(frozen=True)
class WarningSettings:
    """When something is worth a warning. The thresholds for explained, doubtful and refused are in `Verdicts`.

    Args:
        least_loading_kg: a loading below this may have been given in tonnes; the runs cannot show it, for weight and
            forces are proportional to the mass ...
        least_mass_kg: ... and so may one that gives a smaller mass than this. A small shaker rig gets this warning
            needlessly.
        most_mass_of_gear_kg: a loading that gives one gear a larger mass may be in grams: no gear carries more than 50
            t ...
        most_mass_kg: ... and so may one that gives a whole body more: the heaviest aircraft has 640 t.
        straight_rms: a term whose scale exceeds this many rms motions is a straight line over the motion ...
        usual_reach_rms: ... unless its kind is searched beyond this many: such a kind bends within even a long scale.
        least_way_to_slide: friction with memory that slides after some travel can be distinguished from stiffness if
            the motion covers more than this many times that travel: at 1.3 times its force was found a twelfth of the
            true one, with an interval of 5 %, at 2.2 times within its interval.
        turnover_between_samples: friction that stops a motion at more than this many times the sampling rate cannot be
            distinguished from damping: at 1.3 damping was off by five standard deviations, at 0.8 by two. The same
            bound holds for the presliding travels that a motion covers, on average, between two samples.
        memory_left: a law with memory that leaves more than this many times the noise cannot be distinguished
            from damping: one law in place of two left 2.6 to 3, and damping was off by three to five standard
            deviations; a true one left up to 1.4.
        left_out_more: a run of one gear is worth a warning if its prediction by the others leaves this many times what
            the fit leaves.
        left_out_more_of_body: the same for a body, used only where the structure does not explain the runs: a smaller
            excess then points to a run.
        least_of_stated_noise: white noise below this fraction of the stated noise is worth a warning: a data sheet may
            state the worst specimen, but stating twice the noise hides effects of that size.
        unlike_std: springs, damping or friction of two runs are named if they differ by more standard deviations; of
            many comparisons some exceed three.
        as_one: if all of them changed by more than this many times their differences, the mass changed.
        slow_fraction: a residual below this fraction of the resonance frequency is slow motion ...
        fast_fraction: ... and one above this multiple of it is another resonance.
        loose_mass: a mass that is known no better than this, relative, is worth the advice to double the mass change.
    """

    least_loading_kg: float = 5.0
    least_mass_kg: float = 50.0
    most_mass_of_gear_kg: float = 1e5
    most_mass_kg: float = 1e6
    straight_rms: float = 2.0
    usual_reach_rms: float = 3.0
    least_way_to_slide: float = 2.0
    turnover_between_samples: float = 1.0
    memory_left: float = 2.0
    left_out_more: float = 1.2
    left_out_more_of_body: float = 1.1
    least_of_stated_noise: float = 0.5
    unlike_std: float = 4.0
    as_one: float = 5.0
    slow_fraction: float = 0.6
    fast_fraction: float = 2.5
    loose_mass: float = 0.02


@dataclass(frozen=True)
class WeighingSettings:
    """How identified masses are compared with weighed ones.

    Args:
        usual_fraction: standard deviation of a scale that states none, over the mass: scales for aircraft are
            calibrated to 0.1 to 0.2 %.
        used_within_std: a weighed mass takes part in the answer if it is within so many standard deviations of what the
            runs say. Of right scales one in 22 is further off; a scale that is wrong by four of its tolerances, and is
            used, moved the mass by more than its interval in 5 of 20 gears at a limit of three.
        rules_above: the tolerance of a force causes most of the interval of the mass if it is above this fraction of
            the standard deviation: half of the variance.
        contradicts_std: a difference of more standard deviations is a contradiction; one in 370 is larger by chance.
    """

    usual_fraction: float = 0.002
    used_within_std: float = 2.0
    rules_above: float = 0.7
    contradicts_std: float = 3.0


@dataclass(frozen=True)
class Settings:
    """All settings of the estimator.

    Args:
        verdicts: what counts as explained, doubtful and refused.
        runs: how runs are prepared.
        start: how start values are found.
        fit: how the vector is fitted.
        search: how laws are searched.
        origin: how the origin of a law is searched.
        gas: what is known of a carrying gas.
        regression: how sparse regression proposes laws.
        process: how unmeasured forces are distinguished from model errors.
        faults: what is added if the runs demand it.
        repeatability: how much suspensions may differ between runs.
        intervals: how well the parameters are known.
        surface: the force without a law.
        warnings: when something is worth a warning.
        weighing: how masses are compared with weighed ones.

    >>> from dataclasses import replace
    >>> stricter = replace(Settings(), verdicts=Verdicts(refused=10.0))
    >>> stricter.verdicts.refused, stricter.fit == Settings().fit
    (10.0, True)
    """

    verdicts: Verdicts = field(default_factory=Verdicts)
    runs: RunSettings = field(default_factory=RunSettings)
    start: StartSettings = field(default_factory=StartSettings)
    fit: FitSettings = field(default_factory=FitSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    origin: OriginSettings = field(default_factory=OriginSettings)
    gas: GasSettings = field(default_factory=GasSettings)
    regression: RegressionSettings = field(default_factory=RegressionSettings)
    process: ProcessSettings = field(default_factory=ProcessSettings)
    faults: FaultSettings = field(default_factory=FaultSettings)
    repeatability: RepeatabilitySettings = field(default_factory=RepeatabilitySettings)
    intervals: IntervalSettings = field(default_factory=IntervalSettings)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    warnings: WarningSettings = field(default_factory=WarningSettings)
    weighing: WeighingSettings = field(default_factory=WeighingSettings)
