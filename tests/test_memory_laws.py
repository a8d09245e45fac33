"""Laws that remember: rates and derivatives against differences, motions against solve_ivp and sliders, laws found."""

from dataclasses import replace

import numpy as np
import pytest
from driven_response import driven_response
from law_runs import gear_model, gear_study, runs_of, vector_of
from scipy.integrate import solve_ivp

from opid import identify, text
from opid.errors import InputError
from opid.estimate import Estimate
from opid.mechanics.driven import Interface, Noise, predict
from opid.mechanics.laws.kinds import BUILT_IN, Kind, Parameter
from opid.mechanics.laws.law import LINEAR, Law, Term, TermSet, WithCandidates, default_law, law
from opid.mechanics.laws.own_kinds import register_kind
from opid.mechanics.memory import Loop, loop_area, sine_like
from opid.mechanics.response import time_response
from opid.mechanics.structure import Joint, Sliders, Structure, iwan
from opid.mechanics.truth import GearNumbers, GearTruth
from opid.report.formulas import format_formula
from opid.suspensions.fitting.fit import Fit
from opid.suspensions.law_search.pursuit import library
from opid.suspensions.settings import FitSettings, Settings
from opid.suspensions.study import Run
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

WITH_MEMORY = [kind for kind in BUILT_IN if kind.memory is not None]
NAMES = [kind.name for kind in WITH_MEMORY]
FS, N, MASS_KG = 512.0, 1500, 1850.0
SINES = ((3.0, 0.7, 0.0), (2.0, 1.3, 1.0), (2.0, 2.9, 2.0), (1.0, 6.0, 3.0))


def _drive(t):
    return sum(size * np.sin(2 * np.pi * f * t + phase) for size, f, phase in SINES)


HALF_STEPS = np.arange(2 * N - 1) / (2 * FS)


@pytest.mark.parametrize("place", range(5))
@pytest.mark.parametrize("kind", WITH_MEMORY, ids=NAMES)
def test_a_derivative_of_a_rate_is_the_difference(kind, place):
    rng = np.random.default_rng(place)
    defaults = np.array([*(parameter.default for parameter in kind.parameters[1:4]), 0.5, 0.5, 0.5])[:3]
    points = np.array([0.9, 0.2, *defaults]) * rng.uniform(0.3, 1.0, (400, 5))
    points[:, :2] *= rng.choice([-1.0, 1.0], (400, 2))
    element = 0.37
    step = 1e-6 * np.abs(points[:, place]) * np.eye(5)[:, [place]]
    up, down = (kind.memory(*(points.T + sign * step), element)[0] for sign in (1.0, -1.0))
    difference = (up - down) / (2 * step[place])
    given = np.broadcast_to(kind.memory(*points.T, element)[1 + place], difference.shape)
    np.testing.assert_allclose(given, difference, rtol=1e-6, atol=1e-7 * np.abs(difference).max())


def _rate(name, h, v, inner):
    """The rates as the literature has them, h the force over A (of a Maxwell arm its stretch)."""
    if name == "dahl_friction":
        return (v - abs(v) * h) / inner[0]
    if name == "bouc_wen":
        s, n, c = inner
        return (v - 0.5 * abs(v) * abs(h) ** (n - 1) * h - c * v * abs(h) ** n) / s
    if name == "lugre_friction":
        s, b, w, _ = inner
        return (v - abs(v) * h / (1 + (b - 1) * np.exp(-((v / w) ** 2)))) / s
    return v - h / inner[0]


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 0.1])
@pytest.mark.parametrize("name", ["dahl_friction", "bouc_wen", "lugre_friction", "maxwell_arm"])
def test_a_motion_is_that_of_solve_ivp(name, scale):
    """Also where the memory turns over ten times faster, within less than the time between two samples."""
    usual = default_law(name)
    subject = Law((Term(name, (*usual.vector[:1], scale * usual.vector[1], *usual.vector[2:])),))
    amplitude, *inner = subject.vector.tolist()
    lag = inner[3] if name == "lugre_friction" else 0.0

    def rates(t, state):
        z, v, h = state
        rate = _rate(name, h, v, inner)
        force = 5e4 * z + 1500 * v + amplitude * (h + lag * rate)
        return [v, -force / MASS_KG - _drive(t), rate]

    end_s = (N - 1) / FS
    true = solve_ivp(rates, (0, end_s), [0.0] * 3, t_eval=HALF_STEPS[::2], rtol=1e-7, atol=1e-10, max_step=2e-3)
    found = driven_response(
        [Interface(5e4, 1500.0, law=subject)],
        [[1 / MASS_KG]],
        _drive(HALF_STEPS)[:, np.newaxis],
        fs=FS,
        ground=False,
        sensitivity=False,
    )
    for got, wanted in ((found.travel[:, 0], true.y[0]), (found.velocity[:, 0], true.y[1])):
        np.testing.assert_allclose(got, wanted, atol=1e-4 * np.abs(wanted).max())


@pytest.mark.parametrize(
    "subject",
    [
        law(
            "lugre_friction",
            amplitude_n=1000.0,
            scale_m=1e-4,
            breakaway_ratio=1.6,
            stribeck_m_per_s=2e-3,
            bristle_lag_s=1e-3,
        ),
        law("dahl_friction", amplitude_n=1500.0, scale_m=1e-4),
    ],
    ids=lambda subject: subject.name,
)
def test_a_body_that_sticks_and_slips_is_that_of_solve_ivp(subject):
    """A drive of 0.25 Hz holds the friction below its breakaway for most of a second, then tears it off, and again."""
    (name,), (amplitude, *inner) = (term.name for term in subject.terms), subject.vector.tolist()
    lag = inner[3] if name == "lugre_friction" else 0.0
    half_steps = np.arange(2 * int(4.5 * FS) - 1) / (2 * FS)
    time_s = half_steps[::2]

    def drive(t):
        return np.sin(0.5 * np.pi * t)

    def rates(t, state):
        z, v, h = state
        rate = _rate(name, h, v, inner)
        force = 5e4 * z + 1500 * v + amplitude * (h + lag * rate)
        return [v, -force / MASS_KG - drive(t), rate]

    true = solve_ivp(rates, (0, time_s[-1]), [0.0] * 3, "Radau", t_eval=time_s, rtol=1e-7, atol=1e-10).y
    speed = np.abs(true[1])
    # what creeps at a fiftieth of the fastest slip sticks: how long each time, and how fast it slips between
    edges = np.flatnonzero(np.diff(speed > 0.02 * speed.max(), prepend=True, append=True))
    stuck_s = [(last - first) / FS for first, last in zip(edges[::2], edges[1::2], strict=True)]
    assert sum(each > 0.4 for each in stuck_s) >= 3
    assert speed.max() > 0.05
    assert np.ptp(true[0]) > 100 * inner[0]
    interface = Interface(5e4, 1500.0, law=subject)
    given = drive(half_steps)[:, np.newaxis]
    found = driven_response([interface], [[1 / MASS_KG]], given, fs=FS, ground=False, sensitivity=False)
    for got, wanted in ((found.travel[:, 0], true[0]), (found.velocity[:, 0], true[1])):
        np.testing.assert_allclose(got, wanted, atol=2e-4 * np.abs(wanted).max())


def test_an_iwan_joint_is_its_sliders():
    """Elements whose slip travels are those of the law, as the sliders of a structure."""
    subject = law("iwan_friction", amplitude_n=900.0, scale_m=4e-3, spread=0.6, jump=0.4)
    u = np.array(subject.terms[0].kind.elements)
    reach = 4e-3 * np.minimum(1.4 * u, 1.0) ** 0.6
    slip_n = 900.0 * np.array(subject.terms[0].kind.weights)
    sliders = Sliders(slip_n / reach, slip_n)
    given = _drive(HALF_STEPS)[:, np.newaxis]
    motions = []
    for joint in (Joint("strut", (1.0,), 5e4, 1500.0, subject), Joint("strut", (1.0,), 5e4, 1500.0, sliders=sliders)):
        structure = Structure([[MASS_KG]], [[0.0]], [[0.0]], (joint,))
        motions.append(time_response(structure, -MASS_KG * given, fs=FS, duration_s=N / FS).displacement[:, 0])
    driven = driven_response(
        [Interface(5e4, 1500.0, law=subject)], [[1 / MASS_KG]], given, fs=FS, ground=False, sensitivity=False
    )
    # the corners of slipping cost an order of the steps
    for other in (motions[1], driven.travel[:, 0]):
        np.testing.assert_allclose(other, motions[0], atol=2e-3 * np.abs(motions[0]).max())


def _predicted(interfaces, *, ground=False, correct=False, sensitivity=True):
    n, rng = len(interfaces), np.random.default_rng(0)
    rows, accelerance = 6 if ground else 4, np.eye(n) / MASS_KG + 0.05 / MASS_KG
    drive = np.stack([_drive(HALF_STEPS) * (1 + 0.3 * i) for i in range(n)], axis=1)
    noise = Noise(5e-3, 5e-3, 1e-4, 1e-4) if correct else Noise(0.0, 1.0)
    straight = [replace(each, law=LINEAR) for each in interfaces]
    # where nothing is corrected the readings change nothing
    measured = driven_response(straight, accelerance, drive, fs=FS, sensitivity=False).acceleration if correct else 0.0
    covariance = np.eye(rows * n) * (1e-6 if correct else 0.0)
    return predict(
        interfaces,
        accelerance,
        drive,
        measured + 5e-3 * rng.standard_normal((N, n)),
        fs=FS,
        noise=noise,
        start=np.zeros((rows, n)),
        start_covariance=covariance,
        ground=ground,
        sensitivity=sensitivity,
    )


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.parametrize("name", [*NAMES, "cubic_stiffness+dahl_friction", "coulomb_friction+bouc_wen+maxwell_arm"])
def test_derivatives_are_those_of_the_steps(name, n):
    subject, ground = default_law(name), n == 2

    def world(theta):
        own = theta.reshape(n, -1)
        return [Interface(k, c, g, subject.with_vector(rest)) for k, c, g, _, *rest in own.tolist()]

    theta = np.concatenate([[5e4 + 1e3 * i, 1500.0, 500.0 * ground, 0.0, *subject.vector] for i in range(n)])
    given = _predicted(world(theta), ground=ground).sensitivity
    for place in np.flatnonzero(theta):
        step = 1e-6 * abs(theta[place]) * np.eye(theta.size)[place]
        up, down = (
            _predicted(world(theta + sign * step), ground=ground, sensitivity=False).innovation for sign in (1, -1)
        )
        difference = (up - down) / (2 * step[place])
        np.testing.assert_allclose(given[:, place], difference, atol=2e-5 * np.abs(difference).max())


@pytest.mark.parametrize("name", NAMES)
def test_a_faint_term_has_the_derivatives_of_a_small_one(name):
    """What a candidate would do is computed beside the motion: the same columns as those of a state, nearly."""
    faint = default_law(name).scaled(1e-6).terms[0]
    straight = Term("cubic_stiffness", (1.0,))
    beside, within = (
        _predicted([Interface(5e4, 1500.0, law=each)], correct=True).sensitivity[0]
        for each in (WithCandidates((straight, faint), 0.0, 1), TermSet((straight, faint)))
    )
    first = 5
    for column in range(first, first + len(faint.values)):
        # where one of many elements slips between two samples, single samples differ by more
        assert np.linalg.norm(beside[column] - within[column]) < 0.05 * np.linalg.norm(within[column])
        assert np.corrcoef(beside[column], within[column])[0, 1] > 0.998


def test_a_long_record_takes_no_more_memory_than_a_short_one():
    """np.where of single numbers makes an array that a kernel never gives back."""
    import resource

    subject = [Interface(5e4, 1500.0, law=default_law("iwan_friction"))]
    _predicted(subject, correct=True)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(20):
        _predicted(subject, correct=True)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000


@pytest.mark.parametrize(
    ("scale_m", "message"),
    [(6e-4, r"reverses within .* ms .* steps"), (1e-4, r"a law with memory reverses fast")],
)
def test_steps_that_are_too_long_for_a_memory_are_refused(scale_m, message):
    subject = law("dahl_friction", amplitude_n=400.0, scale_m=scale_m)
    structure = Structure([[MASS_KG]], [[0.0]], [[0.0]], (Joint("strut", (1.0,), 5e4, 1500.0, subject),))
    with pytest.raises(InputError, match=message):
        time_response(structure, -MASS_KG * _drive(HALF_STEPS)[:, np.newaxis], fs=FS, duration_s=N / FS)


def test_own_kinds_have_no_memory():
    parameters = (Parameter("amplitude_n", "N", "amplitude", 1.0), Parameter("scale_m", "m", "scale", 1e-3))
    own = Kind("own_dahl", "A h", parameters, WITH_MEMORY[0].function, memory=WITH_MEMORY[0].memory)
    with pytest.raises(InputError, match="memory"):
        register_kind(own)


def _area(truth, loop):
    """The energy of the fourth cycle of a sine, by solve_ivp."""
    amplitude, *inner = truth.vector.tolist()
    lag = inner[3] if truth.name == "lugre_friction" else 0.0
    omega = 2 * np.pi * loop.frequency_hz

    def rates(t, state):
        v = loop.travel_amplitude_m * omega * np.cos(omega * t)
        rate = _rate(truth.name, state[0], v, inner)
        return [rate, amplitude * (state[0] + lag * rate) * v]

    ends = 3 / loop.frequency_hz, 4 / loop.frequency_hz
    found = solve_ivp(rates, (0, ends[1]), [0, 0], rtol=1e-9, atol=1e-11, max_step=ends[1] / 800, t_eval=ends)
    return found.y[1, 1] - found.y[1, 0]


@pytest.mark.parametrize("scale", [1.0, 20.0])
@pytest.mark.parametrize("name", ["dahl_friction", "bouc_wen", "lugre_friction", "maxwell_arm"])
def test_the_energy_of_a_cycle_is_that_of_solve_ivp(name, scale):
    """Where friction slides, and where it hardly does."""
    usual = default_law(name)
    subject = usual.with_vector([usual.vector[0], scale * usual.vector[1], *usual.vector[2:]])
    loop = Loop(0.012, 1.7, Estimate())
    size, pace = loop.travel_amplitude_m / np.sqrt(2), 2 * np.pi * loop.frequency_hz
    assert loop_area(subject + default_law("cubic_stiffness"), *sine_like(size, size * pace)) == pytest.approx(
        _area(subject, loop), rel=1e-4
    )


def _holds_loops(result, truth):
    """Whether the energy per cycle of each run is held, and how wide the widest interval is, over the truth."""
    loops = [each.loop for each in result.interfaces[0].at_rest]
    true = [_area(truth, each) for each in loops]
    widths = [np.ptp(each.area_j.interval95) / area for each, area in zip(loops, true, strict=True)]
    return [each.area_j.holds(area) for each, area in zip(loops, true, strict=True)], max(widths)


def _study_of(gear, seed=0, duration_s=20):
    test = taxi_test(gear, rng=np.random.default_rng(seed), duration_s=duration_s, fs=256, lowest_step_rate_hz=16384.0)
    return gear_study(Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dahl_friction", "bouc_wen", "lugre_friction", "maxwell_arm"])
def test_a_law_that_remembers_is_found(name):
    gear = replace(LandingGear(), law=default_law(name))
    found = identify(_study_of(gear))
    assert found.law.name == name
    mass = found.parameters.sprung_mass_kg
    assert abs(mass.value / gear.sprung_mass_kg - 1) < 0.006
    assert mass.holds(gear.sprung_mass_kg)
    np.testing.assert_allclose(found.law.vector[:2], gear.law.vector[:2], rtol=0.03)
    held, width = _holds_loops(found, gear.law)
    assert held == [True, True]
    assert width < 0.03
    for run, motion in zip(found.interfaces[0].at_rest, found.evidence[0].fit.errors.predictions, strict=True):
        assert run.loop.travel_amplitude_m == pytest.approx(np.sqrt(2) * motion.travel.std())
        assert run.loop.frequency_hz == pytest.approx(motion.velocity.std() / motion.travel.std() / (2 * np.pi))
    (told,) = found.to_dict()["interfaces"]
    assert told["at_rest"][1]["loop"]["area_j"]["value"] == run.loop.area_j.value
    numbers = GearNumbers(
        gear.sprung_mass_kg, gear.suspension_stiffness_n_per_m, gear.suspension_damping_n_s_per_m, 0.0
    )
    rows = [line for line in text(found, GearTruth(numbers, gear.law)).splitlines() if "energy per cycle" in line]
    assert [row.split()[-1] for row in rows] == ["yes", "yes"]


def test_presliding_within_a_sample_is_not_told_from_damping():
    """The motion passes two and a half presliding travels between samples."""
    friction = law("dahl_friction", amplitude_n=400.0, scale_m=1e-4)
    test = taxi_test(
        replace(LandingGear(), law=friction),
        rng=np.random.default_rng(0),
        duration_s=20,
        fs=256,
        lowest_step_rate_hz=65536.0,
    )
    runs = Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg)
    found = identify(gear_study(*runs), law="dahl_friction")
    assert any("dahl_friction turns over faster than the runs were sampled" in each for each in found.warnings)
    assert found.parameters.suspension_damping_n_s_per_m.interval95 is None
    assert all(each.loop.area_j.interval95 is None for each in found.interfaces[0].at_rest)
    assert found.parameters.sprung_mass_kg.holds(1850.0)


@pytest.mark.slow
def test_two_memories_at_once_are_no_damping():
    """A searched law has one of them: what the other leaves must not pass for a damper that is known well."""
    both = default_law("dahl_friction") + law("maxwell_arm", stiffness_n_per_m=8e4, relaxation_s=0.03)
    found = identify(_study_of(replace(LandingGear(), law=both), duration_s=12), law="dahl_friction")
    assert found.residual_over_noise > 2.0
    assert any("the force with memory is only partly this one" in each for each in found.warnings)
    assert found.parameters.suspension_damping_n_s_per_m.interval95 is None
    assert all(each.loop.area_j.interval95 is None for each in found.interfaces[0].at_rest)
    mass = found.parameters.sprung_mass_kg
    assert mass.interval95 is None or mass.holds(1850.0)


def test_every_memory_is_searched():
    assert set(NAMES) <= set(library())


@pytest.mark.parametrize("kind", BUILT_IN, ids=[kind.name for kind in BUILT_IN])
def test_a_formula_is_plain_text_in_a_terminal(kind):
    assert "\\" not in format_formula(kind.latex)


@pytest.mark.slow
def test_friction_that_never_slides_is_no_stiffness_and_the_mass_is_told_all_the_same():
    """It slides after 50 mm and moves over 20 to 30 mm; held at three rms travels it bent all other numbers."""
    gear = LandingGear(law=law("dahl_friction", amplitude_n=8000.0, scale_m=0.05))
    test = taxi_test(gear, rng=np.random.default_rng([0, 5]), duration_s=20, fs=256)
    runs = Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg)
    held = identify(gear_study(*runs), law="dahl_friction", settings=Settings(fit=FitSettings(slide_beyond=1.0)))
    assert held.residual_over_noise > 1.5
    result = identify(gear_study(*runs), law="dahl_friction")
    assert result.residual_over_noise < 1.1
    assert result.parameters.sprung_mass_kg.holds(MASS_KG)
    assert result.parameters.suspension_stiffness_n_per_m.interval95 is None
    assert all(each.stiffness.interval95 is None for each in result.interfaces[0].at_rest)
    # what it takes is known, however little of it slides
    held, width = _holds_loops(result, gear.law)
    assert held == [True, True]
    assert width < 0.2
    assert all(each.interval95 is None for each in result.law_estimates["dahl_friction"].values())
    assert any("dahl_friction slides after" in each and "from end to end" in each for each in result.warnings)


def test_an_energy_near_nothing_is_not_told():
    """A yielding spring that never yields takes a ten-thousandth of what the whole strut takes."""
    usual = default_law("bouc_wen")
    stiff = usual.with_vector([usual.vector[0], 80 * usual.vector[1], *usual.vector[2:]])
    found = identify(_study_of(replace(LandingGear(), law=stiff), 1), law="bouc_wen")
    assert [each.loop.area_j for each in found.interfaces[0].at_rest] == [Estimate(), Estimate()]
    assert "these runs do not determine" in " ".join(text(found).split())


@pytest.mark.parametrize("jump", [0.05, 0.5])
def test_how_many_elements_slip_last_is_told_from_how_far(jump):
    """With the middle of each element alone, a jump below 0.2 was a longer travel, and fits ended there."""
    kind = default_law("iwan_friction").terms[0].kind
    by_scale, by_jump = [], []
    for u, weight in zip(kind.elements, kind.weights, strict=True):
        slopes = kind.memory(0.0, 1.0, 1e-3, 0.6, jump, u)
        by_scale.append(weight * slopes[3]), by_jump.append(weight * slopes[5])
    cosine = abs(np.dot(by_scale, by_jump)) / np.linalg.norm(by_scale) / np.linalg.norm(by_jump)
    assert cosine < 0.99999
    assert (np.asarray(by_jump) / np.asarray(by_scale)).std() > 1e-9


def test_what_sliders_held_at_first_does_not_move_the_answer():
    """The first periods of a joint of sliders are not compared, and tell nothing."""
    joint = law("iwan_friction", amplitude_n=400.0, scale_m=1e-3, spread=0.6, jump=0.6)
    model = replace(gear_model(runs_of(joint), joint), forgets=True)
    theta = vector_of(model)
    here = model.evaluate(theta)
    own = model.indices_of_run(0)[0]
    other = theta.copy()
    other[own.start] += 1e-3
    moved = np.linalg.norm(model.evaluate(other).lines[0] - here.lines[0])
    whole = replace(model, settings=replace(Settings(), fit=replace(FitSettings(), unknown_periods=0.0)))
    assert moved < 0.05 * np.linalg.norm(whole.evaluate(other).lines[0] - whole.evaluate(theta).lines[0])
    assert 0.7 < model.compared_fraction < 0.99
    assert whole.compared_fraction == pytest.approx(1.0)
    assert replace(model, forgets=False).compared_fraction == 1.0
    # white errors stay as large as they were, and fewer of them tell less
    wide, narrow = Fit(model, theta, here, 1), Fit(whole, theta, here, 1)
    shared = slice(0, model.n_shared)
    ratio = np.diag(wide.covariance)[shared] / np.diag(narrow.covariance)[shared]
    np.testing.assert_allclose(ratio, 1 / model.compared_fraction, rtol=0.02)


@pytest.fixture(scope="module")
def joint():
    """A gear with forty sliders and a damper, and what two runs of it tell."""
    sliders = iwan(stiffness_n_per_m=6e5, slip_force_n=400.0, chi=-0.4, beta=0.5)
    gear = replace(LandingGear(), law=LINEAR, sliders=sliders)
    test = taxi_test(gear, rng=np.random.default_rng(4), fs=256, lowest_step_rate_hz=32768.0)
    runs = Run("heavy", test.heavy.recording), Run("light", test.light.recording, test.mass_change_kg)
    return gear, gear_study(*runs)


@pytest.mark.slow
def test_a_joint_of_sliders_is_found_with_what_is_beside_it(joint):
    gear, study = joint
    found = identify(study)
    assert found.law.name == "iwan_friction"
    assert found.parameters.sprung_mass_kg.holds(gear.sprung_mass_kg)
    assert found.parameters.suspension_stiffness_n_per_m.holds(gear.suspension_stiffness_n_per_m)
    assert found.parameters.suspension_damping_n_s_per_m.holds(gear.suspension_damping_n_s_per_m)
    assert found.residual_over_noise < 1.2


@pytest.mark.slow
def test_a_damper_beside_sliders_is_as_uncertain_as_twenty_of_them_stand_for_many(joint):
    """The mass is right, and the interval of the damper holds what twenty elements cost."""
    gear, study = joint
    found = identify(study, law="iwan_friction")
    assert found.parameters.sprung_mass_kg.holds(gear.sprung_mass_kg)
    damping = found.parameters.suspension_damping_n_s_per_m
    assert damping.holds(gear.suspension_damping_n_s_per_m)
    sharp = identify(study, law="iwan_friction", settings=_without_few_elements())
    assert damping.std > 1.2 * sharp.parameters.suspension_damping_n_s_per_m.std


def _without_few_elements():
    settings = Settings()
    return replace(settings, intervals=replace(settings.intervals, few_elements_fraction=0.0))
