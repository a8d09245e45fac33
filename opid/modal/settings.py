"""The tuned numbers of nonlinear modal models, each with its reason; the choices of users are in `study`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModalThresholds:
    """Where bands, fits and decays of modes end, and what is refused or warned of."""

    # condition number of the shapes above which noise of other coordinates dominates (the paper accepts 9)
    most_condition: float = 30.0
    # largest damping ratio of a bolted structure: if every elastic mode has more, the numbers are percent
    most_damping: float = 0.2
    # standard errors by which a shift with the level must exceed its threshold: chance alone does that once in 370
    # times
    shift_sigma: float = 3.0
    # highest amplitude over the lowest, below which the levels do not show whether a mode is nonlinear
    least_level_ratio: float = 1.5
    # fraction of the natural frequency to either side that is searched (the paper's modes shifted by 7 %)
    searched: float = 0.1
    # half width of the band of a level, in zeta f from the peak: noise and other modes dominate beyond it
    level_half_widths: float = 8.0
    fewest_lines: int = 16  # lines of such a band, which has to give three coefficients and two noise levels
    # third strongest line of a band over the median line of the record, below which no mode is seen
    least_peak: float = 4.0
    # fraction of the mean power in the quietest quarter: noise falls below it once in 80 times at most
    quiet_fraction: float = 0.15
    # fraction of the peak at the end of a record above which the unknown end state gets terms of its own
    not_decayed: float = 0.02
    widest_band: tuple[float, float] = (0.6, 1.5)  # ends of the widest band of a mode, in natural frequencies
    # fraction of the distance to a neighbour at which the band ends at the latest: the modal filter leaves little of
    # the neighbour, and the frequency of a nonlinear mode moves there
    to_neighbour: float = 0.8
    half_widths: float = 4.0  # half-power bandwidths on either side of the natural frequency that the band always holds
    # fraction of the largest line of the modal acceleration: smaller lines hold nothing of the mode
    least_line: float = 0.01
    least_signal: float = 3.0  # force or motion in the band over its noise, rms, that a test needs
    # fraction of the largest motion that may be left at an end of a record: a test with more is refused ...
    most_left: float = 0.05
    parts_of_record: int = 50  # the last of so many parts of a record shows what is left at its end
    warned_left: float = 0.01  # ... and a test with more than this gets a warning
    # least multiple of the natural frequency that a record holds, for the third harmonic with some of its width
    third_harmonic: float = 3.1
    # a mode without tests of its own is fitted to those that reach this fraction of its largest amplitude
    part_of_largest: float = 0.1
    # half of the swing of a strain above which its unit is wrong: metals yield at 0.002 and carbon tears at 0.02
    most_strain: float = 0.05
    most_outside: float = 0.5  # rms fraction of the motion that no shapes make: a test with more is refused ...
    warned_outside: float = 0.1  # ... and a test with more than this gets a warning
    left_by_cause: float = 0.3  # part of the motion outside the shapes that is left where its cause is found
    # standard deviation of the gain of a sensor with its amplifier where a study states none: half of the 3 % within
    # which such a chain is usually calibrated over its band; shapes with errors of 3 % look like more
    gain_tolerance: float = 0.015
    # standard deviation of the rate of a logger's clock, as a fraction: usual crystals are specified to 50 ppm
    clock_tolerance: float = 5e-5
    # standard deviation of the drift of a gain over a record, as a fraction: a change of 30 K moves a sensor's so far
    gain_drift: float = 0.005
    # fraction of the motion that the sensors' own errors of calibration, those that differ, put outside exact shapes
    outside_by_gains: float = 0.01
    # standard deviation of the gain of a mode's coordinate from which it is told: a cubic coefficient is then known to
    # a tenth, and shapes with errors of 3 % at six sensors and more seldom make it worse
    doubtful_gain: float = 0.05
    # departure of a sensor's gain from 1 from which it is named: no calibration, and hardly an error of a shape, is
    # off by as much
    least_wrong_gain: float = 0.1
    # fraction of the motion of the mode under test, rms of modal accelerations, from which another mode is named as
    # coupled
    least_answer: float = 0.3
    # fraction of that motion that the force may have driven by itself, for a shaker has harmonics, too
    most_driven: float = 0.3
    # condition number of the scaled columns beyond which the tests cannot distinguish the powers
    most_column_condition: float = 1e6
    parsimony: float = 0.01  # fraction of the error that a further power must save on tests that were left out
    # parts of a band, or stretches of a decay, that are left out in turn; tests are instead where there are three
    n_blocks: int = 5
    # range of the modal mass that tests may show; outside it, shapes or force have another unit
    mass_range: tuple[float, float] = (0.5, 2.0)
    # Gauss-Newton steps for a delay of the accelerations: three are usual, and what takes more has another cause
    most_delay_steps: int = 10
    weighted_delay_steps: int = 3  # of these, the first ones that weigh the lines anew
    # phase of the force, rad, that is added to the standard deviation of a delay as it is told: neighbours that leak
    # through shapes with errors of 3 %, and joints that are no polynomial, made 0.2 to 4.6 mrad
    delay_phase_std: float = 2e-3
    # standard deviations from zero at which a delay of the accelerations is corrected: chance does that once in 16,000
    # fits
    delay_sigma: float = 4.0
    warned_mass: float = 0.05  # departure of the modal mass from 1 above which there is a warning
    # departure of the modal mass from 1 from which on simulated fits are repeated with the scale that it asks for: what
    # less does to a cubic coefficient is below the error of the equation
    least_mass_error: float = 1e-3
    # half width of a force curve's band at its end, over the force: if it is wider, the orders are too high
    widest_force: float = 0.3
    most_unexplained: float = 0.5  # fraction of the modal force that a fit may leave without a warning
    # largest amplitude of a truth test over that of the fitted tests: beyond it the polynomials extrapolate
    extrapolated: float = 1.1
    # multiple of the largest motion of the fit up to which its powers must stay stable, or they are held beyond that
    # motion: truth tests seldom go beyond 1.5 times it, and joints are known up to twice (`slip_travels`)
    stable_up_to: float = 2.0
    # rms fraction of the motion of a sensor that the model may miss in a truth test without a warning
    most_missed: float = 0.3
    # upper end of the band of a truth test over the highest natural frequency: faster motion belongs to other modes
    above_modes: float = 1.25
    # lower end of that band over the lowest elastic natural frequency: slower motion is offset and drift of the sensors
    below_modes: float = 0.3
    # cycles of a decay: with fewer, neither frequency nor damping can be found as functions of the amplitude
    fewest_cycles: int = 10
    # damping ratio above which nothing oscillates that windows of several cycles could follow
    most_followed: float = 0.5
    kernel_cycles: int = 6  # length of the Hann kernel that gives the first envelope
    # cycles after which an impact is over: a hammer that drives a mode at all touches for less than half of its period
    after_peak_cycles: float = 0.75
    # peak over the motion before it, from which on a record holds an impact and not the end of a dwell
    impact_rise: float = 2.5
    acting: float = 0.05  # fraction of the largest force from which on a force acts on a decay ...
    acting_over_noise: float = 6.0  # ... if it also exceeds its noise, rms, by so much, which chance never does
    # periods of a force in which it falls from half to its end, above which it may be one that the motion itself causes
    sudden_end: float = 10.0
    # step between levels of an envelope, a fraction: a dwell swings by less, and so does the first envelope at an end
    steady_step: float = 0.1
    # time that a dwell stays within such a step, over that of the decay in the next steps: the damping of a mode does
    # not change by that from one step to the next
    steady_times: float = 5.0
    least_steady: float = 0.2  # fraction of the largest envelope below which no dwell is searched
    # rms of a cycle over that of each of the three before it, at which the next impact has come
    next_impact_rise: float = 3.0
    clipped_samples: int = 3  # successive samples at the largest value that make a record clipped
    # steps of the converter by which a clipped signal leaves its limit; three samples within one step leave it by less
    clipped_steps: float = 4.0
    # cycles of the mode in a window, for frequency and damping beside an offset and a trend
    fewest_window_cycles: float = 6.0
    fewest_windows: int = 4  # windows of a decay that gives a curve over the amplitude
    most_windows: int = 160  # windows of a decay, whose fit takes the covariance of all of them
    window_decay: float = 0.6  # decay of the log-amplitude in a window, where nothing else sets its length
    resolved: float = 2.5  # window length times distance of two frequencies from which a Hann window separates them
    smallest_signal: float = 5.0  # amplitude over its standard deviation at which the decay has reached the noise
    longest_decay: float = 3.0  # largest decay of the log-amplitude in a window that has to separate neighbours
    most_neighbours: int = 6  # frequencies beside the mode that are searched
    glide_gain: float = 0.5  # fraction of the residual that a frequency which glides must leave, to be preferred
    # highest neighbour over the frequency of the mode: the taper of the windows suppresses those beyond
    highest_neighbour: float = 10.0
    smallest_neighbour: float = 0.005  # fraction of the mode's peak from which on a neighbour is fitted
    # fraction of the mode's peak from which on a neighbour is reported that is too close to be fitted
    unresolved: float = 0.1
    least_range: float = 1.5  # largest amplitude over the smallest, below which nonlinear terms are warned of
    # lowest amplitude over the highest, above which the values at zero amplitude would extrapolate and are not told
    reaches_zero: float = 1.0 / 3.0
    # Bayesian criterion over the lowest one, up to which a form of the law is fitted: the criterion of the start values
    # is a rough one
    rival_score: float = 25.0
    # criterion by which a form with more coefficients must be better; less is not worth a mention (Kass, Raftery 1995)
    bare_mention: float = 2.0
    # criterion by which a rival takes the damping at zero amplitude from a law without it: very strong evidence (same)
    decisive: float = 10.0
    rivals_with_friction: int = 2  # such rivals that are fitted where the orders are given: each takes a second
    # what dry friction or an Iwan joint must gain in that criterion: strong evidence (Kass and Raftery 1995), for with
    # friction there is no damping ratio at zero amplitude
    joint_evidence: float = 6.0
    # what each power above 1 must gain: beside friction, with ten windows, powers would follow noise at low amplitude
    power_evidence: float = 3.0
    # windows of a decay for each term of damping beside friction: with nine windows, the powers 2 and 3 took so much of
    # a friction that both it and the viscous damping were wrong by three standard deviations in one of 24 decays
    windows_per_term: float = 4.0
    # terms of damping with friction that may be tried in spite of that, where fewer miss the decay beyond its noise:
    # with six, powers imitated a damping by the root of the speed, and viscous damping was six times too large
    most_terms_with_friction: int = 3
    # error of a law of the highest order over what the last order changed: powers up to N leave errors as 1 / N^2 of a
    # term like |q'|^1.5, 1.8 times the last step of N = 5
    last_step: float = 2.0
    # standard deviations by which friction or slip must stand out, and the largest one of the exponent of slip: an
    # exponent that nothing determines takes any stiffness to zero amplitude
    joint_sigma: float = 3.0
    widest_exponent: float = 0.3
    # exponents with which the search for slip begins: those of joints measured so far, closely enough for the fit
    first_exponents: tuple[float, ...] = (-0.8, -0.65, -0.5, -0.35, -0.2, 0.0, 0.2)
    # travels, spreads, jumps and exponents with which the search for a joint of a named kind begins: the travels over
    # the largest displacement, and the others about those of `opid.laws`
    first_travels: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)
    first_spreads: tuple[float, ...] = (0.4, 0.5, 0.65)
    first_jumps: tuple[float, ...] = (0.2, 1.0)
    first_sharpness: tuple[float, ...] = (1.2, 2.5, 6.0)
    # ranges within which such a search moves. A joint of a smaller travel, over the largest displacement, is friction,
    # and one of a larger is a spring; a spread of 1 has no stiffness at rest, and one below 0.15 is a corner; a part of
    # the force that slides at once has no sense below a jump of -1/2; an exponent above 50 is a corner, too
    searched_travels: tuple[float, float] = (1e-4, 1e2)
    searched_spreads: tuple[float, float] = (0.15, 0.99)
    least_jump: float = -0.5
    searched_sharpness: tuple[float, float] = (0.2, 50.0)
    # steps by which the linear damping that begins such a search is lowered, to 0.7 of it each, where the law has
    # decayed before the record ends: with eight it is 6 %
    slower_starts: int = 8
    # relative standard deviation of the values of such a joint, and of k0 and c0 beside it, over the largest damping
    # ratio: the slow flow averages the joint to the first order of how fast the amplitude falls, and windows round the
    # corner where it begins to slide. With ratios of 0.8 to 2 % simulated decays gave forces that were off by up to 6 %
    # (where the motion reached only 1.5 times the travel), and a c0 that was off by 2 %
    joint_error: tuple[float, float] = (4.0, 1.5)
    # acceleration, m/s^2, above which a decay is in a wrong unit: 100,000 g, more than any structure bears
    most_acceleration: float = 1e6
    # that of k0 over the stiffness of the joint at rest and that damping ratio: k0 was off by up to 0.25 of both
    rest_error: float = 0.2
    # exponent of Bouc and Wen above which the windows round off the corner where the joint yields: one slider with a
    # spring was given exponents of 8 to 13
    sharp_exponent: float = 5.0
    slip_exponents: tuple[float, float] = (-0.95, 1.5)  # range of chi; joints measured so far have -0.8 to 0.2
    most_rivals: int = 6  # forms of the law that are fitted to amplitude and phase, which takes most of the time
    least_weight: float = 0.01  # weight below which a rival form no longer widens the intervals
    # distance of a line from a multiple of 50 or 60 Hz at which it may be hum, a fraction of these: mains keep 0.2 %
    mains_width: float = 0.004
    # distance of a mode from a multiple of the mains, a fraction, within which hum is searched in the end of its decay:
    # farther off it is a neighbour, unless the decay is too short for windows that separate it
    hum_width: float = 0.02
    # last amplitude of a decay over the largest, and over its standard deviation, from which on the record ends within
    # the decay, so that hum in the frequency of the mode does not show. Hum of 0.4 % in a decay that fell to 8 % looked
    # like friction; farther down it bends the curves, and a decay that meets the noise ends at `smallest_signal`
    left_at_end: float = 0.03
    loud_end: float = 30.0
    fewest_hum: int = 8  # phasors of that end, half a kernel apart, that the line and the rest of the mode need
    # factor by which the standard deviation of that line is enlarged: what is left of the mode beside it is not quite
    # an exponential decay, and of four hardening modes two were off by 2.6 and 3.8 standard deviations without it
    hum_error: float = 2.0
    hum_sigma: float = 12.0  # standard deviations of the line from which on it is subtracted
    # the mode at the end of the record over the line: with more, what deviates from an exponential decay is like a line
    left_beside_hum: float = 0.3
    # distance from 2 or 3 times the frequency of the mode at which another one may exchange energy with it, a fraction
    # of that multiple; nearer than 0.06 in the ratio a line cannot be told from the harmonic of the mode itself
    partner_width: float = 0.05
    # beats in a decay with which the search for two close linear modes begins; more are seen as a swing, and resolved
    first_beats: tuple[float, ...] = (0.1, 0.25, 0.5, 0.8, 1.2, 1.8, 2.5, -0.1, -0.25, -0.5, -0.8, -1.2, -1.8, -2.5)
    tried_beats: int = 5  # the likeliest of these starts, from which the search goes on
    alike_damping: float = 3.0  # largest ratio of the damping of two close modes: others imitate slip and friction
    # chance by which noise alone gives the misfit of a decay, below which a line too close to be separated is searched:
    # a weak one that turns once in the decay left a misfit of 1.4, and k3 was 3.6 standard deviations off
    chance_line: float = 0.05
    # orders of stiffness and damping that are tried beside a line too close to be separated: powers of higher orders
    # imitate such a line
    orders_beside_line: tuple[tuple[int, int], ...] = ((1, 1), (3, 1), (3, 2))
    # distance from the mode that is searched for such a line, a fraction: farther off the windows separate it
    searched_line: float = 0.06
    # angle that a line turns against the mode in the decay, rad: with less than a beat it looks like a law
    least_turn: float = 6.28
    # windows for each value of a law and of a line: with 1.5, both imitated a damping by the root of the speed
    windows_per_value: float = 2.0
    # rate at which such a line may rise, over that at which the mode falls: hum is steady, but for noise
    rising_line: float = 0.05
    # factor of the error of a subtracted line in the covariance of a track: so large that a law which is fitted
    # afterwards gets the intervals of a fit of both
    free_line: float = 10.0
    # part of such a line, as it stands in frequency and damping from window to window, that may be left in them
    line_error: float = 0.1
    # squared errors that a last step would save, beyond chance and as a fraction of all, from which the search for a
    # law was stopped at the edge of the possible laws; searches that end at a minimum save less than three
    least_saved: float = 9.0
    fraction_saved: float = 0.1
    # smallest singular value over the largest, of the scaled columns of a law, below which coefficients cannot be told
    # apart: differences of the slow flow have errors of 1e-8
    least_shown: float = 3e-7
    drift_error: float = 0.1  # relative error of the drift of the frequency, which is taken from a smooth curve
    # probability that noise alone gives the misfit of a decay from which on its law has a model error: chance then adds
    # one in a thousand decays
    chance_misfit: float = 1e-3
    most_misfit: float = 3.0  # largest misfit of a law without a warning, in standard deviations of the noise
    # rms of the residual over the record, above which the first quarter of a decay is left out
    most_residual: float = 0.5
    # largest swing of frequency and damping about a smooth curve that is still noise, in standard deviations
    beating: float = 4.0
    # fraction of the fundamental: if it varies more than this from period to period, the response is not periodic
    unsteady: float = 0.02
    # time constants 1 / (zeta omega) that the first level waits before the loop is closed: what the sudden start
    # excites in all modes must be gone, or the loop follows it
    settling: float = 3.0
    # fraction of the natural frequency by which the loop moves at most to either side, unless a range is given
    widest_range: float = 0.15


MODAL = ModalThresholds()


@dataclass(frozen=True)
class SimulationSettings:
    """How laws are fitted by simulating the tests."""

    # largest step, in rad of the fastest mode: Runge-Kutta then keeps its frequency to 2e-6, which is less than tests
    # tell; forms are compared with longer steps, whose error of 1e-4 they share
    step_rad: float = 0.12
    first_step_rad: float = 0.35
    # largest change of the memory of a joint in a step, over its largest force
    memory_step: float = 0.5
    # times by which this may shorten the steps of a search: joints with less travel are dry friction, and sharper ones
    # are sliders
    most_finer: float = 16.0
    # Jenkins elements of a joint: with 24, responses differed by 0.1 %, and couplings of modes by 0.2 %
    sliders: int = 60
    # slip travels of the first and the last element, over the largest displacement of the tests: what would slip only
    # beyond stays stuck, for no test shows it
    slip_travels: tuple[float, float] = (3e-3, 2.0)
    # travel before dry friction slides, over the largest displacement: a step in the force needs endless stiffness
    friction_travel: float = 1e-3
    # steps of a search while forms are compared, and of the last one for the form that is chosen
    first_steps: int = 10
    most_steps: int = 40
    # relative change of errors and coefficients at which these searches end
    first_converged: float = 3e-4
    converged: float = 1e-6
    boundless: float = 1e50  # acceleration from which on a motion grows without bound, long before squares overflow
    unbounded: float = 3.0  # errors of a model that grows without bound, over those of no motion at all
    # rms misfit of the powers over the noise, from which on friction and slip are tried: with the right law it is 1
    excess: float = 1.5
    # misfit of other terms of the mode under test over that of the best ones, up to which they are tried again with the
    # joint: without it they can hardly be told apart
    own_rivals: float = 2.0
    # fits of a law whose forces are delayed anew by what is left beside it, and the part of its standard deviation
    # below which a delay is not corrected again: each fit leaves a tenth of the delay before it
    delay_steps: int = 3
    delay_left: float = 0.2
    # dry friction from which its search begins, over the force of the linear damping at the largest motion
    first_frictions: tuple[float, ...] = (0.02, 0.1, 0.3, 1.0, 3.0)
    first_slip: float = 0.3  # likewise the force of slip, from which the search for that of a driven mode begins
    # exponents with which the search for slip of the mode under test begins: every second one of those of decays, for
    # here each of them takes a simulation of all tests
    first_slip_exponents: tuple[float, ...] = (-0.8, -0.5, -0.2, 0.2)
    # exponent of Segalman's joint, amid those measured so far: it begins the search for the slip of a driven mode, and
    # turns the softening of powers into the slip from which that of the mode under test begins
    first_slip_exponent: float = -0.5
    # softening by a joint at the largest motion, over that by all of its stiffness, below which a search does not begin
    # with a larger force: it only just slides there
    least_softening: float = 0.02
    # largest forces of a joint with which its search begins, over that which softens the mode as the powers do: these
    # follow a joint badly where it begins to slide
    first_forces: tuple[float, ...] = (0.5, 1.0, 2.0)
    # misfit of a law by simulation over that of the noise of accelerations and forces, from which on joints of named
    # kinds are tried, and up to which one of them explains the tests. The motion that the noise of a force would cause
    # is only roughly known: true laws had 0.9 to 1.7
    unexplained: float = 2.5
    # misfit of a joint for which nobody asked over that of the best other law, up to which it is taken although it
    # leaves more than noise: the sliders of an Iwan joint are a sum of 60, and left 4 times the noise where friction
    # left 60
    far_less: float = 0.2
    # least size of a coefficient, over that force: of the slip from which a search begins where powers do not soften,
    # and of the steps of searches and differences; a tenth of the damping is the least that a test shows clearly
    least_size: float = 0.1
    # relative standard deviation of dry friction because nobody knows how far it bends before it slides: with travels
    # of zero and of a thousandth of the largest displacement it differs by this
    friction_std: float = 0.003
    # relative standard deviation of the values of a joint of a named kind, of k0 and of c0, by the steps of the
    # simulation: forces of one slider were off by 0.0006 on the average of 20 tests, k0 by 2.5e-6 (by up to 1.4e-5 of
    # friction that bends), and c0 by 0.0007
    joint_std: float = 0.001
    stiffness_std: float = 5e-6
    damping_std: float = 1e-3
    # directions of a joint with which the search begins, as ratio of the stretches by the largest displacements: its
    # sign decides which half of the cycle is softer, and a search does not cross zero
    first_ratios: tuple[float, ...] = (-3.0, -1.0, -0.3, 0.3, 1.0, 3.0)
    # misfit over the motion of a mode, from which on its law is not given and the interaction stays a warning
    most_missed: float = 0.3
    warned_missed: float = 0.05  # ... and from which on there is a warning


SIMULATED = SimulationSettings()
