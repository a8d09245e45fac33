"""A small modal test made by hand: four modes, one of them softening, sine beats, a truth test, and what was found."""

from functools import cache

import numpy as np

from opid.estimate import Estimate
from opid.mechanics.structure import modal_assurance
from opid.modal.couplings import Coupling, Product
from opid.modal.decay.free_decay import decay_of
from opid.modal.forced.mode_fit import ForceCurve, ModeFit
from opid.modal.forced.restoring_fit import OrderRung
from opid.modal.forced.system_fit import DrivenLaw, LawTrial, SystemFit
from opid.modal.joint_terms import JointEstimates
from opid.modal.linear.level_shifts import LevelShift
from opid.modal.linear.modes import LinearModes, condition_number, modal_test
from opid.modal.model import NonlinearModalModel, simulate, truth_test
from opid.modal.power_laws import power_law
from opid.modal.resonance.appropriation import Appropriation, AppropriationLevel
from opid.modal.resonance.phase_lock import PhaseLock
from opid.modal.result import ModalIdentification
from opid.modal.study import ModalStudy, StudyTest
from opid.signals.recording import Channel, Recording

FS = 512.0
SOFT = 3
"""The mode that is nonlinear, 60 Hz."""
LAW = power_law({3: -1.5e11}, {2: 30.0})
SENSORS = ("case_x", "case_y", "lid_x", "lid_y", "board_x", "board_y")


def small_modes():
    rng = np.random.default_rng(5)
    shapes = np.linalg.qr(rng.standard_normal((6, 4)))[0] * 0.5
    shapes[0] = (0.3, 0.25, -0.3, 0.25)
    return LinearModes([0.0, 40.0, 60.0, 85.0], [0.0, 0.006, 0.005, 0.007], shapes, SENSORS)


def beat(level, *, duration_s=6.0, cycles=24, frequency_hz=60.0):
    """A sine beat of a Hann window: rest, the beat, and time to decay."""
    time = np.arange(round(duration_s * FS)) / FS
    length = cycles / frequency_hz
    window = np.where((time > 0.2) & (time < 0.2 + length), np.sin(np.pi * (time - 0.2) / length) ** 2, 0.0)
    return level * window * np.sin(2 * np.pi * frequency_hz * time)


def measured(force, *, seed=0, noise=0.003, law=LAW):
    """What the sensors and the force cell record of the structure."""
    rng = np.random.default_rng(seed)
    motion = simulate(NonlinearModalModel(small_modes(), {SOFT: law}), force, fs=FS, drive_point="case_x")
    samples = np.column_stack([motion.samples, force])
    samples = samples + noise * samples.std(axis=0) * rng.standard_normal(samples.shape)
    return Recording(samples, fs=FS, channels=(*motion.channels, Channel("force", "N")))


@cache
def small_study():
    """Three sine beats to fit, a stronger one as the truth test."""
    modes = small_modes()

    def test(name, level, seed):
        return modal_test(measured(beat(level), seed=seed), modes, name=name, force="force", drive_point="case_x")

    tests = [StudyTest(test(f"beat_{level}", level, level), "fit", SOFT) for level in (2, 5, 10)]
    tests.append(StudyTest(test("strong", 12, 99), "truth"))
    return ModalStudy("A small structure", modes, (SOFT,), tuple(tests), "case_x", 3, 3)


def small_result(study=None, *, shifts=(), decays=(), warnings=("the shapes do not look mass-normalised",)):
    """An identification of it, made by hand."""
    study = study or small_study()
    model = NonlinearModalModel(study.modes, {SOFT: LAW})
    truth = truth_test(model, study.of_use("truth")[0].test)
    return ModalIdentification(
        title=study.title,
        modes=study.modes,
        drive_point="case_x",
        tests=tuple(each.test for each in study.tests),
        fits=(small_fit(),),
        model=model,
        truth_tests=(truth,),
        decays=tuple(decays),
        shifts=tuple(shifts),
        condition_number=condition_number(study.modes),
        auto_mac=modal_assurance(study.modes.shapes),
        warnings=tuple(warnings),
        not_determined="",
        settings={"stiffness_order": 3, "damping_order": 3, "free_linear": None, "study": "study.toml"},
        systems=(small_system(),),
    )


def small_system():
    """The softening mode with mode 4, which it drives, as their fit might come out."""
    trials = [("mode 3: k3; k q3^2 q4", 0.03), ("mode 3: k3", 0.7), ("mode 3: k3; joint k z^3", 0.003)]
    return SystemFit(
        modes=(SOFT, 4),
        fit=small_fit(),
        driven={
            4: DrivenLaw(
                {1: Estimate.normal(12.0, 30.0)}, {1: Estimate.normal(0.01, 0.02)}, JointEstimates(), largest=2e-4
            )
        },
        couplings=(Coupling(Product((SOFT, SOFT, 4)), Estimate.normal(2e7, 1e5)),),
        ratios={4: Estimate.normal(1.6, 0.02)},
        missed={SOFT: 0.004, 4: 0.006},
        trials=tuple(LawTrial(terms, 7, error, 0.1 * error, error == 0.003) for terms, error in trials),
        warnings=(),
    )


def small_fit():
    """The fit of the softening mode, as it might come out."""
    modes = small_modes()
    k0, c0 = modes.stiffness()[SOFT - 1], modes.damping()[SOFT - 1]
    q = np.linspace(0, 2.5e-4, 101)
    v = np.linspace(0, 0.09, 101)
    stiffness, damping = -1.5e11 * q**3, 30.0 * v**2
    omega = np.sqrt(k0 - 0.75 * 1.5e11 * q**2)
    return ModeFit(
        mode=SOFT,
        frequency_hz=60.0,
        damping_ratio=0.005,
        stiffness_order=3,
        damping_order=3,
        free_linear=False,
        stiffness={2: Estimate.normal(-1.2e4, 9e4), 3: Estimate.normal(-1.503e11, 4.1e8)},
        damping={2: Estimate.normal(30.1, 0.3), 3: Estimate.normal(-0.8, 2.2)},
        band_hz=(52.0, 68.0),
        n_lines=291,
        tests=("beat_2", "beat_5", "beat_10"),
        residual_fraction=0.012,
        condition_raw=3e7,
        condition_scaled=21.0,
        modal_mass=Estimate.normal(1.002, 0.003),
        stiffness_curve=ForceCurve(q, stiffness, stiffness * 0.97 - 0.03, stiffness * 1.03 + 0.03, k0 * q),
        damping_curve=ForceCurve(v, damping, damping * 0.9, damping * 1.1, c0 * v),
        frequency_at_hz=omega / (2 * np.pi),
        damping_at=(c0 + 30.0 * 8 / (3 * np.pi) * omega * q) / (2 * omega),
        orders=tuple(
            OrderRung(n_s, n_d, 0.3 / (n_s * n_d) + 0.01 * (n_s + n_d), 0.004, (n_s, n_d) == (3, 3))
            for n_s in range(1, 6)
            for n_d in range(1, 6)
        ),
        interactions=(),
        misfit=1.1,
        warnings=("test 'beat_2' ends with 1.2 % of its largest motion in mode 3: record it for longer",),
    )


def small_shift(mode=SOFT, *, nonlinear=True, determined=True):
    """How the level moves a mode, as it might come out."""
    return LevelShift(
        mode=mode,
        levels=("low", "high"),
        amplitude=(1.0, 20.0),
        frequency_hz=(Estimate.normal(60.0, 0.01), Estimate.normal(59.4, 0.02)) if determined else (Estimate(),) * 2,
        damping_ratio=(Estimate.normal(0.005, 1e-5), Estimate.normal(0.008, 1e-4)) if determined else (Estimate(),) * 2,
        frequency_shift=Estimate.normal(-0.01, 4e-4) if determined else Estimate(),
        damping_shift=Estimate.normal(0.6, 0.02) if determined else Estimate(),
        nonlinear=nonlinear,
        determined=determined,
        reason="mode 3 shifts in frequency by -1 %",
    )


def small_decay():
    """A free decay of the softening mode, from the end of a sine beat."""
    test = small_study().tests[2].test
    return decay_of(test, SOFT, start_s=0.8)


def appropriation(n=12):
    """Levels of an appropriation of the softening mode; the second harmonic of mode 4 grows with the level."""
    modes = small_modes()
    levels = []
    for k in range(1, n + 1):
        modal = np.zeros((4, 5), dtype=np.complex128)
        modal[SOFT - 1] = k * np.array([1j, 0.02, 0.01 * k, 0.001, 0.001])
        modal[3, 1] = 0.08 * k**2
        levels.append(
            AppropriationLevel(
                voltage_v=float(k),
                frequency_hz=60.0 - 0.01 * k**2,
                locked=k != 5,
                lock_time_s=0.4,
                phase_error_deg=0.2,
                unsteadiness=0.001,
                force=np.array([0.5 * k, 1e-3, 1e-3, 1e-4, 1e-4], dtype=np.complex128),
                sensors=modes.shapes @ modal,
                modal=modal,
                text="",
            )
        )
    return Appropriation(SOFT, modes, "case_x", tuple(levels), (51.0, 69.0), PhaseLock(), 0.01)
