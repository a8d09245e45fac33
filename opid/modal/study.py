"""A modal study: linear modes, which of them are nonlinear, and the tests to fit and to judge by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

from opid.errors import InputError, count_repeats, nearest, refuse, require_fraction
from opid.modal.couplings import DEGREES, Product
from opid.modal.joint_terms import read_memory
from opid.modal.linear.modes import ACCELERATION, LinearModes, ModalTest, with_units
from opid.modal.power_laws import HIGHEST_ORDER
from opid.modal.resonance.curves import ResponseCurve
from opid.modal.settings import MODAL
from opid.result import first_lines

Use = Literal["fit", "truth", "level", "decay", "resonance"]
USES: tuple[Use, ...] = get_args(Use)

THRESHOLDS = ("frequency_threshold", "damping_threshold")  # the relative shifts from which a mode counts as nonlinear


@dataclass(frozen=True, eq=False)
class StudyTest:
    """A test and its use.

    Args:
        test: the test in modal coordinates.
        use: "fit" to fit laws to it, "truth" to compare the model with it, "level" for one of several levels that are
            compared mode by mode, "decay" for a free decay (no force), "resonance" for levels at phase
            resonance.
        mode: number of the nonlinear mode that the test excites, from 1; found from its response where None.
        displacement: modal displacement at the first sample of a truth test by the number of the mode, m kg^1/2; modes
            that are not named begin at zero.
        velocity: modal velocity at the first sample, likewise, m/s kg^1/2.
    """

    test: ModalTest
    use: Use = "fit"
    mode: int | None = None
    displacement: Mapping[int, float] = field(default_factory=dict)
    velocity: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ModalStudy:
    """What a nonlinear modal model is identified from.

    Args:
        title: the title of the study.
        modes: linear modes of the structure, on which the model is built; their sensors have the units that they have
            in the tests.
        nonlinear: numbers of the nonlinear modes, from 1; where empty, those that the level tests show.
        tests: the tests, each with the linear modes that belong to it.
        drive_point: the sensor where the force acts in tests that name none of their own; the first one by which a
            test is driven where None, and None where no test has a force.
        stiffness_order: N_s of every nonlinear mode, 1 for a linear spring; chosen by cross-validation where None.
        damping_order: N_d of every nonlinear mode, 1 for linear damping; chosen by cross-validation where None.
        free_linear: whether k0 and c0 are corrected in the fit; the data decide where None.
        memory: name of the kind of joint that every nonlinear mode has, "iwan_friction", "dahl_friction" or "bouc_wen";
            where None, joints of these kinds are tried where nothing else explains the tests of a mode.
        couplings: products of modal coordinates in the potential by which modes drive each other, each as the numbers
            of its modes, (10, 10, 18) for q10^2 q18 and (10, 10, 10) for a mode that is softer in one direction; where
            None, the interactions that the tests show are searched, and where empty, none.
        frequency_threshold: relative shift of the natural frequency between level tests from which a mode counts as
            nonlinear, 0.002 for 0.2 %; see `level_shifts`.
        damping_threshold: relative shift of the damping ratio from which a mode counts as nonlinear, 0.15 for 15 %.
        gain_tolerance: standard deviation of the gains of the accelerations and of the force by their calibration, as a
            fraction, 0.01 for 1 %; 0 for exact ones. The intervals of nonlinear coefficients hold it.
        curves: stepped-sine response curves, from which `identify_resonance` takes the law of a mode, too.
        source: the study file, if there is one.

    Raises:
        InputError: everything that is wrong with it, at once.
    """

    title: str
    modes: LinearModes
    nonlinear: tuple[int, ...]
    tests: tuple[StudyTest, ...]
    drive_point: str | None = None
    stiffness_order: int | None = None
    damping_order: int | None = None
    free_linear: bool | None = None
    memory: str | None = None
    couplings: tuple[tuple[int, ...], ...] | None = None
    frequency_threshold: float = 0.002
    damping_threshold: float = 0.15
    gain_tolerance: float = MODAL.gain_tolerance
    curves: tuple[ResponseCurve, ...] = ()
    source: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "tests", tuple(self.tests))
        object.__setattr__(self, "nonlinear", tuple(self.nonlinear))
        object.__setattr__(self, "curves", tuple(self.curves))
        if self.drive_point is None:
            points = [point for each in self.tests for point in each.test.drive_points]
            object.__setattr__(self, "drive_point", points[0] if points else None)
        units = {name: each.test.modes.unit(name) for each in self.tests for name in each.test.sensors}
        object.__setattr__(self, "modes", with_units(self.modes, units))
        refuse(list(_find_faults(self)), self.source)

    def find_couplings(self, mode: int) -> tuple[Product, ...]:
        """Return the products that are named in the study and whose first nonlinear mode is this one."""
        products = [Product(each) for each in self.couplings or ()]
        return tuple(each for each in products if mode == next((n for n in each.modes if n in self.nonlinear), None))

    def __repr__(self) -> str:
        modes = [f"mode {number}: {value:.4g} Hz" for number, value in enumerate(self.modes.frequency_hz, start=1)]
        tests = [f"test {each.test.name}: {each.use}" for each in self.tests]
        curves = [f"curve {each.name}: {each.sensor}" for each in self.curves]
        lines = [*first_lines(modes, "modes"), *first_lines(tests, "tests"), *first_lines(curves, "curves")]
        return "\n".join([f"ModalStudy: {self.title}", *lines])

    def of_use(self, *uses: Use) -> tuple[StudyTest, ...]:
        """Return the tests of some uses."""
        return tuple(each for each in self.tests if each.use in uses)


def _find_faults(study: ModalStudy) -> Iterator[str]:
    for mode in study.nonlinear:
        if not 1 <= mode <= study.modes.n_modes:
            yield f"nonlinear names mode {mode}, give numbers from 1 to {study.modes.n_modes}"
        elif not study.modes.elastic[mode - 1]:
            yield f"nonlinear names mode {mode}, a rigid-body mode (0 Hz): only elastic modes can be nonlinear"
    if len(set(study.nonlinear)) < len(study.nonlinear):
        yield f"nonlinear is {list(study.nonlinear)}, name each mode once"
    for word, order in (("stiffness_order", study.stiffness_order), ("damping_order", study.damping_order)):
        if order is not None and not 1 <= order <= HIGHEST_ORDER:
            yield f"{word} is {order}, give 1 (linear) to {HIGHEST_ORDER}"
    try:
        read_memory(study.memory)
        require_fraction("gain_tolerance", study.gain_tolerance)
    except InputError as error:
        yield str(error)
    for word in THRESHOLDS:
        threshold = getattr(study, word)
        if not 0 < threshold <= 1:
            yield f"{word} is {threshold}, give a fraction above 0 and up to 1, 0.01 for 1 %"
    for coupling in study.couplings or ():
        wrong = [mode for mode in coupling if not 1 <= mode <= study.modes.n_modes or not study.modes.elastic[mode - 1]]
        if wrong:
            yield f"couplings has {list(coupling)}, and {wrong[0]} is no elastic mode: give numbers of modes, from 1"
        elif len(coupling) not in DEGREES:
            yield f"couplings has {list(coupling)}: give three or four modes, [10, 10, 18] for q10^2 q18"
        elif not set(coupling) & set(study.nonlinear) and study.nonlinear:
            yield f"couplings has {list(coupling)}, none of which is among nonlinear = {list(study.nonlinear)}"
    names = [each.test.name for each in study.tests] + [each.name for each in study.curves]
    for name, n in count_repeats(names).items():
        yield f"{n} tests are called {name!r}, rename them"
    yield from _find_curve_faults(study)
    for each in study.tests:
        name = each.test.name
        if each.use not in USES:
            yield f"test {name!r} has use = {each.use!r}, give one of {', '.join(USES)}"
        if each.use in ("truth", "level", "resonance") and not each.test.forces:
            yield f"test {name!r} has use = {each.use!r} and no force, name the channel of its force"
        if each.use == "resonance" and len(each.test.forces) > 1:
            yield (
                f"test {name!r} has use = 'resonance' and {len(each.test.forces)} forces: one force is in phase with "
                "the motion there, so give a test with one shaker"
            )
        if each.use == "fit" and not each.test.forces:
            yield f'test {name!r} has no force, name its channel or give use = "decay" for a free decay'
        if each.use != "truth" and (each.displacement or each.velocity):
            yield (
                f"test {name!r} has use = {each.use!r} and an initial condition, which a simulation needs: give it to "
                'a test with use = "truth" (free decays are followed from wherever they begin)'
            )
        for mode in {*each.displacement, *each.velocity}:
            if not 1 <= mode <= study.modes.n_modes:
                yield f"test {name!r} has an initial condition of mode {mode}, give 1 to {study.modes.n_modes}"
        if each.mode is not None and not 1 <= each.mode <= study.modes.n_modes:
            yield f"test {name!r} is for mode {each.mode}, give a number from 1 to {study.modes.n_modes}"
        elif each.mode is not None and each.mode not in study.nonlinear and study.nonlinear:
            yield f"test {name!r} is for mode {each.mode}, which is none of nonlinear = {list(study.nonlinear)}"
        for sensor in each.test.sensors:
            own = each.test.modes.unit(sensor)
            if sensor in study.modes.sensors and own != study.modes.unit(sensor):
                yield (
                    f"sensor {sensor!r} is in {own} in test {name!r} and in {study.modes.unit(sensor)} in another one: "
                    "give it the unit that belongs to its row of the shapes"
                )
        if each.test.modes.n_modes != study.modes.n_modes:
            yield (
                f"test {name!r} has {each.test.modes.n_modes} modes of its own and the study {study.modes.n_modes}: "
                "give every test the same modes in the same order"
            )
    if not study.of_use("fit", "decay", "level", "resonance") and not study.curves:
        yield 'there is no test to identify from, give one the use = "fit" (or "decay", "level", "resonance")'


def _find_curve_faults(study: ModalStudy) -> Iterator[str]:
    for each in study.curves:
        if each.sensor not in study.modes.sensors:
            yield f"curve {each.name!r} is of {each.sensor!r}, {nearest(each.sensor, study.modes.sensors)}"
        elif study.modes.unit(each.sensor) != ACCELERATION:
            yield f"curve {each.name!r} is of {each.sensor!r}, which reads a strain: give one of a sensor of motion"
        if each.mode is not None and not 1 <= each.mode <= study.modes.n_modes:
            yield f"curve {each.name!r} is of mode {each.mode}, give a number from 1 to {study.modes.n_modes}"
        elif each.mode is not None and not study.modes.elastic[each.mode - 1]:
            yield f"curve {each.name!r} is of mode {each.mode}, a rigid-body mode (0 Hz): give an elastic one"
    if study.curves and study.drive_point is None:
        yield "the curves have a force and the study no drive_point, name the sensor at which it acts"
