"""Response curves: the law that they give, files and study files of them, and worlds in which an assumption fails."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cli_runs import opid, refused
from made_resonance import (
    C2,
    K3,
    MODE,
    curves_study,
    held_study,
    hurried_study,
    requires_truth_inside,
    with_amplitudes_in_g,
    with_phases_turned,
    with_samples,
    with_shapes_scaled,
    with_softer_curves,
)

from opid.errors import InputError
from opid.modal.resonance.curve_file import CurveColumns, read_curve, write_curve
from opid.modal.resonance.curve_fit import fit_curves, make_curve
from opid.modal.resonance.curves import ResponseCurve, read_curve_states
from opid.modal.resonance.held_out import choose_held_out, predict_held_out
from opid.modal.resonance.identification import identify_resonance
from opid.modal.study import ModalStudy
from opid.signals.log import ChannelSettings
from opid.studies.study_file import read_study, write_study
from opid.virtual.modal_tests.series import virtual_series

MODES = virtual_series("cubic").case.modes
K0, C0 = (float(each[MODE - 1]) for each in (MODES.stiffness(), MODES.damping()))
PLACE = {"modes": MODES, "mode": MODE, "drive_point": "case_x"}

# ---- the law by curves that harmonic balance makes ----------------------------------------------------


def response_curve(force_n, rng, sensor="lid_x", drive_point="case_x", noise=0.01):
    """Return the curve of one force at a sensor, by harmonic balance; all modes move it."""
    row, push = MODES.row(sensor), MODES.row(drive_point)
    modal_force = push[MODE - 1] * force_n
    peak = next(
        a for a in np.linspace(1e-3, 1e-6, 4000) if modal_force > _resonance(a) * _damping(a, _resonance(a)) * a
    )
    points = []
    for a in np.linspace(0.3, 0.98, 12) * peak:
        for side in (1.0, -1.0):
            omega = np.sqrt(K0)
            for _ in range(60):
                reach = np.sqrt(max((modal_force / a) ** 2 - (omega * _damping(a, omega)) ** 2, 0.0))
                omega = np.sqrt(K0 + 0.75 * K3 * a**2 - side * reach)
            q = push * force_n / (MODES.stiffness() - omega**2 + 1j * omega * MODES.damping())
            q[MODE - 1] = modal_force / (side * reach + 1j * omega * _damping(a, omega))
            points.append((omega / (2 * np.pi), -(omega**2) * (row @ q)))
    hz, motion = (np.array(each) for each in zip(*points, strict=True))
    motion = motion * (1 + noise / np.sqrt(2) * (rng.standard_normal(hz.size) + 1j * rng.standard_normal(hz.size)))
    return ResponseCurve(f"{force_n:g} N", sensor, hz, np.abs(motion), np.degrees(np.angle(motion)), force_n)


def _resonance(amplitude):
    return np.sqrt(K0 + 0.75 * K3 * amplitude**2)


def _damping(amplitude, omega):
    return C0 + C2 * 8 / (3 * np.pi) * omega * amplitude


def turned(curve, degrees=0.0, sign=1.0):
    return replace(curve, phase_deg=sign * (curve.phase_deg + degrees))


def some_curves(forces=(1.0, 4.0, 8.0, 16.0), seed=0, noise=0.01):
    rng = np.random.default_rng(seed)
    return [response_curve(force, rng, noise=noise) for force in forces]


def test_response_curves_at_several_levels_give_the_law():
    law = fit_curves(some_curves(), **PLACE).law
    assert law.stiffness[3].holds(K3)
    assert law.stiffness[3].value == pytest.approx(K3, rel=0.02)
    assert law.damping[2].value == pytest.approx(C2, rel=0.03)


def test_response_curves_show_a_phase_that_nobody_knows():
    law = fit_curves([turned(each, -5.0) for each in some_curves()], **PLACE).law
    assert law.force_phase_deg.value == pytest.approx(5.0, abs=0.7)
    assert law.stiffness[3].holds(K3)


def test_a_law_makes_the_curve_that_it_was_fitted_to_and_a_higher_one():
    *fitted, highest = some_curves(noise=1e-5)
    law = fit_curves(fitted, **PLACE, stiffness_order=3, damping_order=2).law
    for curve, error in ((fitted[0], 1e-3), (fitted[-1], 2e-3), (highest, 5e-3)):
        made = make_curve(law, curve, **PLACE)
        assert np.mean(np.isfinite(made.response)) > 0.9
        # Where the curve turns over, a frequency off by 1e-5 changes the amplitude by a tenth: the median tells.
        assert np.nanmedian(np.abs(made.response / curve.acceleration - 1.0)) < error
        if np.isfinite(made.response).all():
            assert made.peak_ratio == pytest.approx(1.0, abs=5 * error)
    # Far above the amplitudes that were fitted the law has no answer.
    beyond = replace(highest, force_n=50 * highest.force_n, amplitude=50 * highest.amplitude)
    assert np.isnan(make_curve(law, beyond, **PLACE).response).all()


def test_a_response_curve_with_the_phase_the_other_way_round_is_refused():
    with pytest.raises(InputError, match="sign = -1 where a lag counts positive"):
        read_curve_states(turned(response_curve(4.0, np.random.default_rng(0)), sign=-1.0), **PLACE)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"amplitude": [1.0]}, "one of each for every point"),
        ({"amplitude": [1.0, -1.0]}, "not finite and positive"),
        ({"error_fraction": 0.0}, "give a fraction, 0.01 for 1 %"),
    ],
)
def test_faulty_curves_are_refused(change, words):
    given = {"frequency_hz": [100.0, 101.0], "amplitude": [1.0, 1.0], "phase_deg": [90.0, 80.0], "force_n": 1.0}
    with pytest.raises(InputError, match=words):
        ResponseCurve("faulty", "lid_x", **given | change)


def test_too_few_levels_give_the_reason_and_no_law():
    near = response_curve(4.0, np.random.default_rng(0))
    top = np.argsort(near.amplitude)[-6:]
    picked = {name: getattr(near, name)[top] for name in ("frequency_hz", "amplitude", "phase_deg", "force_n")}
    found = fit_curves([replace(near, **picked)], **PLACE)
    assert found.law is None
    assert "record lower levels" in found.reason


# ---- a curve that is held out, and states that differ ---------------------------------------------------

FORCES = (1.0, 2.0, 4.0, 8.0, 14.0)


def with_states(curves, seed, spread=3e-4):
    """Return curves of a structure whose frequency is a little different in each of them."""
    rng = np.random.default_rng(seed)
    return [replace(each, frequency_hz=each.frequency_hz * (1 + spread * rng.standard_normal())) for each in curves]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("is_scattered", [False, True])
def test_the_law_of_the_lower_curves_predicts_the_highest(seed, is_scattered):
    curves = some_curves(FORCES, seed=seed)
    curves = with_states(curves, seed) if is_scattered else curves
    held = choose_held_out(curves, "highest", MODES, MODE)
    others = [each for each in curves if each is not held]
    assert held.name == "14 N"
    found = predict_held_out(held, others, fit_curves(others, **PLACE).law, **PLACE)
    low, high = found.resonance_hz.interval95
    assert low < found.measured_hz.value < high
    assert is_scattered or abs(found.error_fraction) < 0.05
    has = np.isfinite(found.low)
    inside = (found.low <= held.amplitude) & (held.amplitude <= found.high)
    # A curve of another state is off at all of its points at once.
    assert is_scattered or inside[has].mean() > 0.85
    json.dumps(found.as_json()["fitted"])


def test_the_states_of_the_structure_widen_the_law_of_curves():
    """Points of one curve share its state: many of them do not make a law more certain."""
    held_by, sound = [], fit_curves(some_curves(FORCES), **PLACE).law
    for seed in range(4):
        law = fit_curves(with_states(some_curves(FORCES, seed=seed), seed), **PLACE).law
        held_by.append(law.stiffness[3].holds(K3) if 3 in law.stiffness else True)
        assert law.frequency_std_hz.min() > sound.frequency_std_hz.min()
    assert sum(held_by) >= 3


def test_too_few_curves_and_a_wrong_name_are_refused():
    curves = some_curves(FORCES[:2])
    with pytest.raises(InputError, match="needs 3: give more"):
        choose_held_out(curves, "highest", MODES, MODE)
    with pytest.raises(InputError, match="there is no curve '15 N' to hold out"):
        choose_held_out(some_curves(FORCES[:3]), "15 N", MODES, MODE)


@pytest.mark.parametrize("factor", [0.5, 1.3])
def test_the_scale_of_a_shape_is_found_from_the_curves(factor):
    study = with_shapes_scaled(curves_study(), factor)
    assert identify_resonance(study).law is None
    found = identify_resonance(study, free_mass=True)
    assert found.modal_mass.value == pytest.approx(factor**2, rel=0.03)
    assert found.modal_mass.holds(factor**2) or abs(found.modal_mass.value / factor**2 - 1) < 0.02
    requires_truth_inside(found.law)


def test_a_sign_of_the_amplitude_that_is_stated_turns_the_phase(tmp_path):
    curve = some_curves((4.0,))[0]
    path = tmp_path / "curve.csv"
    write_curve(turned(curve, 180.0), path)
    columns = CurveColumns(amplitude=ChannelSettings("amplitude", sign=-1))
    again = read_curve(path, sensor="lid_x", columns=columns)
    np.testing.assert_allclose(again.acceleration, curve.acceleration, rtol=1e-9)


# ---- whole studies, simulated in time ------------------------------------------------------------------


def test_curves_alone_give_law_and_curves():
    result = identify_resonance(curves_study())
    assert result.appropriation is None
    assert result.law is result.curves_law
    requires_truth_inside(result.law)
    assert result.law.stiffness[3].value == pytest.approx(K3, rel=0.06)
    assert result.curve_check.inertia.value == pytest.approx(1.0, abs=0.02)
    for each in result.curve_fits:
        assert not each.is_prediction
        assert each.error < 0.04
        assert each.peak_ratio == pytest.approx(1.0, abs=0.04)
    written = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert len(written["curves"]) == 4


def test_levels_predict_the_curves_and_both_together_give_the_law():
    result = identify_resonance(held_study(n_curves=4))
    for law in (result.records_law, result.curves_law, result.joint_law):
        requires_truth_inside(law)
    assert result.joint_law.n_states == result.records_law.n_states + result.curves_law.n_states
    assert result.joint_law.stiffness[3].std <= 1.01 * result.records_law.stiffness[3].std
    for each in result.curve_fits:
        assert each.is_prediction
        assert each.error < 0.04
    assert {row.name for row in result.summary()} >= {"k3", "records.k3", "curves.k3"}


def test_a_curve_beyond_the_levels_of_its_law_is_told():
    study = held_study(n_curves=4)
    whole = identify_resonance(study)
    last = whole.level_start_s[len(whole.states) // 2]
    lower = with_samples(study, lambda samples, record: samples[: round(last * record.fs)])
    reached = identify_resonance(lower).records_law.amplitude.max()
    for result, most in ((whole, whole.records_law.amplitude.max()), (identify_resonance(lower), reached)):
        beyond = {fit.curve.name for fit in result.curve_fits if fit.resonance.amplitude > 1.1 * most}
        told = [text for text in result.warnings if "the curve by this law is an extrapolation" in text]
        assert {text.split("'")[1] for text in told} == beyond
        assert bool(beyond) == (result is not whole)


def test_amplitudes_in_another_unit_withhold_the_law():
    result = identify_resonance(with_amplitudes_in_g(curves_study()))
    assert result.law is None
    assert "accelerations in g taken for m/s^2" in result.not_determined
    # With levels beside them the law is that of the levels, and the curves are not drawn into it.
    result = identify_resonance(with_amplitudes_in_g(held_study(n_curves=4)))
    assert result.law is result.records_law
    assert any("show a modal mass of" in text for text in result.warnings)


def test_a_phase_of_the_force_is_found_in_the_curves():
    result = identify_resonance(with_phases_turned(curves_study(), 5.0))
    assert result.law.force_phase_deg.value == pytest.approx(5.0, abs=1.0)
    requires_truth_inside(result.law)
    assert any("the response curves show that the force is" in text for text in result.warnings)


@pytest.mark.parametrize("settling", [0.1, 0.3, 1.0])
def test_steps_that_are_too_fast_withhold_the_law_or_widen_it(settling):
    result = identify_resonance(hurried_study(settling=settling))
    if result.law is None:
        assert "lag behind the frequency" in result.not_determined
    else:
        assert any("standard deviations of their noise" in text for text in result.warnings)
        requires_truth_inside(result.law)


def test_curves_of_another_state_are_not_fitted_with_the_levels():
    result = identify_resonance(with_softer_curves(held_study(n_curves=4)))
    assert result.joint_law is None
    assert result.law is result.records_law
    assert any("contradicts that by the levels" in text for text in result.warnings)


def test_what_has_neither_levels_nor_curves_is_refused():
    with pytest.raises(InputError, match=r"there are no \[\[curves\]\]"):
        identify_resonance(replace(held_study(), tests=(replace(held_study().tests[0], use="fit"),)))
    with pytest.raises(InputError, match="choose one with mode, like 3"):
        identify_resonance(replace(curves_study(), nonlinear=(), curves=_with_another_mode()))


def _with_another_mode():
    first, *others = curves_study().curves
    return (first, replace(others[0], mode=2))


def test_the_mode_of_a_curve_is_the_nearest_to_its_peak():
    study = replace(curves_study(), nonlinear=())
    unnamed = tuple(replace(each, mode=None) for each in study.curves)
    assert identify_resonance(replace(study, curves=unnamed)).mode == MODE


# ---- files ---------------------------------------------------------------------------------------------


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "rows", "columns"),
    [
        ("frequency [Hz],response [g],phase [deg],force [N]", ["100,0.5,100,2", "101,0.4,80,2"], {}),
        ("f [kHz];a [mm/s^2];phi [rad];load [kN]",
         ["0,1;4903,325;1,7453292;0,002", "0,101;3922,66;1,3962634;0,002"], {}),
        # The lag of a displacement, 90 degrees less one sign, counted positive.
        ("freq,x,lag,load", ["100,0.0124209,80,2", "101,0.0097402,100,2"], {
            "amplitude": ChannelSettings("x", unit="mm"), "phase": ChannelSettings("lag", unit="deg", sign=-1),
            "force": ChannelSettings(4, unit="N"),
        }),
    ],
    ids=["plain", "German", "lag of a displacement"],
)  # fmt: skip
def test_columns_in_any_unit_are_read(tmp_path, header, rows, columns):
    path = write(tmp_path / "curve.csv", "\n".join([header, *rows]) + "\n")
    curve = read_curve(path, sensor="tip", columns=CurveColumns(**columns))
    np.testing.assert_allclose(curve.frequency_hz, [100.0, 101.0])
    np.testing.assert_allclose(curve.amplitude, [4.903325, 3.92266], rtol=1e-4)
    np.testing.assert_allclose(curve.phase_deg, [100.0, 80.0], atol=1e-4)
    np.testing.assert_allclose(curve.force_n, 2.0)
    assert curve.name == "curve"


@pytest.mark.parametrize(
    ("header", "given", "words"),
    [
        ("frequency [Hz],a [g],phase [deg]", {}, "no column in a unit of N for the force"),
        ("frequency [Hz],a [g],b [g],phase [deg]", {"force_n": 1.0}, "2 columns in a unit of .* for the amplitude"),
        ("frequency [Hz],a,phase [deg]", {"force_n": 1.0, "columns": CurveColumns(amplitude=ChannelSettings("a"))},
         "states no unit"),
        ("frequency [Hz],a [g],phase [deg]",
         {"force_n": 1.0, "columns": CurveColumns(phase=ChannelSettings("phse"))}, "did you mean 'phase'"),
        ("frequency [Hz],a [g],phase [deg]",
         {"force_n": 1.0, "columns": CurveColumns(force=ChannelSettings("a"))}, "give one of them"),
        ("time [s],a [g],phase [deg]", {"force_n": 1.0}, "no column of frequencies"),
    ],
)  # fmt: skip
def test_files_without_what_is_needed_are_refused(tmp_path, header, given, words):
    path = write(tmp_path / "curve.csv", f"{header}\n{','.join(['1'] * (header.count(',') + 1))}\n")
    with pytest.raises(InputError, match=f"curve.csv: .*{words}"):
        read_curve(path, sensor="tip", **given)
    with pytest.raises(InputError, match="there is no response curve"):
        read_curve(tmp_path / "none.csv", sensor="tip")


def test_a_curve_that_is_written_is_read_again(tmp_path):
    curve = curves_study().curves[0]
    write_curve(curve, tmp_path / "curve_1.csv")
    again = read_curve(tmp_path / "curve_1.csv", sensor=curve.sensor, mode=curve.mode)
    for name in ("frequency_hz", "amplitude", "phase_deg", "force_n"):
        np.testing.assert_allclose(getattr(again, name), getattr(curve, name), rtol=1e-12)


def test_a_study_file_names_curves_columns_and_units(tmp_path):
    study = curves_study()
    write_study(study, tmp_path / "study.toml")
    again = read_study(tmp_path / "study.toml", kind=ModalStudy)
    assert [each.name for each in again.curves] == [each.name for each in study.curves]
    assert again.tests == ()
    assert len(again.curves[0].files) == 3  # the study, the modes and the curve
    curve = study.curves[0]
    rows = zip(curve.frequency_hz, curve.amplitude / 9.80665, -np.radians(curve.phase_deg), strict=True)
    lines = ["f,response,lag", *(",".join(map(repr, map(float, row))) for row in rows)]
    write(tmp_path / "plain.csv", "\n".join(lines) + "\n")
    head = (tmp_path / "study.toml").read_text(encoding="utf-8").split("[[curves]]")[0]
    table = f'''
[[curves]]
file = "plain.csv"
sensor = "{curve.sensor}"
force_n = {curve.force_n[0]}
mode = {MODE}
error_fraction = 0.02
amplitude = {{channel = "response", unit = "g"}}
phase = {{channel = "lag", unit = "rad", sign = -1}}
'''
    (read,) = read_study(write(tmp_path / "plain.toml", head + table), kind=ModalStudy).curves
    np.testing.assert_allclose(read.amplitude, curve.amplitude)
    np.testing.assert_allclose(np.exp(1j * np.radians(read.phase_deg - curve.phase_deg)), 1.0)
    assert read.error_fraction == 0.02


def test_the_faults_of_curves_in_a_study_are_told_at_once(tmp_path):
    write_study(curves_study(), tmp_path / "study.toml")
    text = (tmp_path / "study.toml").read_text(encoding="utf-8").split("[[curves]]")[0]
    wrong = '[[curves]]\nfile = "curve_1.csv"\nsensor = "lid_z"\n[[curves]]\nfile = "none.csv"\nsensor = "lid_x"\n'
    with pytest.raises(InputError, match="there is no response curve"):
        read_study(write(tmp_path / "a.toml", text + wrong))
    with pytest.raises(InputError, match="curve 'curve_1' is of 'lid_z', did you mean 'lid_y'"):
        read_study(write(tmp_path / "b.toml", text + wrong.split('[[curves]]\nfile = "none')[0]))
    with pytest.raises(InputError, match="the study lacks 'tests', give one table"):
        read_study(write(tmp_path / "c.toml", text))
    study = curves_study()
    for change, words in (
        ({"mode": 9}, "curve 'curve_1' is of mode 9, give a number from 1 to 4"),
        ({"name": "curve_2"}, "2 tests are called 'curve_2', rename them"),
    ):
        with pytest.raises(InputError, match=words):
            replace(study, curves=(replace(study.curves[0], **change), *study.curves[1:]))
    with pytest.raises(InputError, match="no drive_point"):
        replace(study, drive_point=None)


def test_the_commands_write_and_read_curves(tmp_path):
    folder, out = tmp_path / "bracket", tmp_path / "out"
    done = opid("simulate", "resonance", folder, "--levels", 8, "--curves", 3)
    assert done.exit_code == 0, done.output
    assert "8 levels, 3 response curves" in done.stdout
    done = opid("resonance", folder / "study.toml", "--truth", folder / "truth.json", "--out", out, "--png")
    assert done.exit_code == 0, done.output
    for words in ("By the response curves alone", "Response curves", "which have not seen the"):
        assert words in done.stdout
    result = json.loads((out / "result.json").read_text(encoding="utf-8"))
    assert [each["sensor"] for each in result["curves"]] == ["lid_x"] * 3
    assert (out / "response_curves.png").is_file()
    curves = (folder / "study.toml").read_text(encoding="utf-8")
    alone = write(folder / "alone.toml", curves.split("[[tests]]")[0] + "[[curves]]" + curves.split("[[curves]]", 1)[1])
    done = opid("resonance", alone, "--no-figures", "--out", tmp_path / "alone")
    assert done.exit_code == 0, done.output
    assert "Frequency and damping by the law" in done.stdout
    refused(opid("resonance", alone, "--mode", 2, "--out", tmp_path / "no"), "no test holds mode 2: they hold 3")
