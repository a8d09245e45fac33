"""The paper's chain to the letter: each printed step against an independent computation, and its settings (Table 2)."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

import opid
from opid.errors import InputError
from opid.mechanics.laws.law import Law, Term
from opid.mechanics.memory import Motion
from opid.signals.spectra import BY_METHOD, TransmissibilitySettings
from opid.suspensions.paper.identification import identify_by_paper
from opid.suspensions.paper.printed import run_as_printed
from opid.suspensions.paper.restoring_force import SliceCurve, fit_slice
from opid.suspensions.paper.settings import MENDED, TABLE_2, PaperSettings, PrintedSettings
from opid.suspensions.study import Run, study_of_gear
from opid.virtual.taxi_tests.airframe import LandingGear
from opid.virtual.taxi_tests.taxiing import taxi_test

FS = 256.0


@pytest.fixture(scope="module")
def runs():
    test = taxi_test(LandingGear(), rng=np.random.default_rng(3), duration_s=40, fs=FS)
    return (
        Run("heavy", test.heavy.recording, 0.0, weighed_mass_kg=1850.0),
        Run("light", test.light.recording, -220.0),
    )


def _study(runs, **stated):
    stated = TransmissibilitySettings(**stated)
    return study_of_gear("taxi", sprung="upper_z", unsprung="lower_z", runs=runs, transmissibility=stated)


@pytest.fixture(scope="module")
def result(runs):
    return identify_by_paper(_study(runs), method="paper", law="arctan_velocity")


@pytest.mark.parametrize(("along", "name"), [("travel", "arctan_displacement"), ("velocity", "arctan_velocity")])
def test_the_arctangent_of_eq_3_has_a_fixed_amplitude(along, name):
    u = np.linspace(-0.2, 0.2, 4000)
    motion = Motion(u, np.zeros_like(u)) if along == "travel" else Motion(np.zeros_like(u), u)
    y = 3 * u - 0.1 + motion.force(Law((Term(name, (np.pi / 2, 0.02)),)))
    fit = fit_slice(SliceCurve(along, u, y, np.arange(u.size), 1e-3, FS), amplitude_m_per_s2=np.pi / 2)
    np.testing.assert_allclose(fit.law.vector, [np.pi / 2, 0.02], rtol=1e-4)
    np.testing.assert_allclose(list(fit.straight.values()), [3.0, -0.1], rtol=2e-3)
    assert fit.law_std[0] == 0.0
    assert fit.residual_rms < 1e-4
    assert fit.verdicts[0].distinguishable


def test_every_step_is_the_printed_one(runs, result):
    fs, (unsprung, sprung) = FS, (runs[0].recording.channel(name) for name in ("lower_z", "upper_z"))
    step, relative = result.chain.reference.printed, _centred(sprung - unsprung)
    velocity = np.concatenate([[0], np.cumsum((relative[1:] + relative[:-1]) / (2 * fs))])
    np.testing.assert_allclose(step.motion.velocity, _centred(velocity), atol=1e-9)
    force = sum(
        np.pi / 2 * 2 / np.pi * np.arctan(motion / term.inner[0])
        for term in step.law.terms
        for motion in [step.motion.displacement if term.name == "arctan_displacement" else step.motion.velocity]
    )
    block = round(32 * fs)
    spectra = {"fs": fs, "window": "flattop", "nperseg": block, "noverlap": int(0.3 * block)}
    frequency_hz, cross = signal.csd(unsprung, sprung + force, **spectra)
    _, power = signal.welch(unsprung, **spectra)
    np.testing.assert_allclose(step.T.frequency_hz, frequency_hz)
    assert frequency_hz[1] == 1 / 32
    np.testing.assert_allclose(step.T.value[1:-1], (cross / power)[1:-1], rtol=1e-6)
    low = np.abs(step.T.value)[(frequency_hz > 0) & (frequency_hz <= 0.5)]
    np.testing.assert_allclose(result.chain.static_transmissibility, np.median(low))


def _centred(values):
    return values - values.mean()


def test_the_slope_can_be_subtracted_too(runs):
    unsprung, sprung = (runs[0].recording.channel(name) for name in ("lower_z", "upper_z"))
    usual = run_as_printed(unsprung, sprung, fs=FS)
    whole = run_as_printed(
        unsprung, sprung, fs=FS, settings=PaperSettings(printed=PrintedSettings(subtracts_slope=True))
    )
    assert usual.law == whole.law
    assert not np.allclose(usual.T.value, whole.T.value)


def test_table_3_numbers_the_strongest_pairs_by_frequency(result):
    chain = result.chain
    assert len(chain.table_3) == PrintedSettings.n_pairs
    assert set(chain.table_3) <= set(chain.pairs)
    assert chain.strongest_pair in chain.table_3
    frequencies = [pair.match.reference.frequency_hz for pair in chain.table_3]
    assert frequencies == sorted(frequencies)
    text = opid.text(result)
    assert "The chain as printed (Table 3 of the paper)" in text
    assert f"{chain.strongest_pair.as_printed.sprung_mass_kg:.0f}" in text
    # eq. (11) of each pair, also where the answer has no mass
    pair = chain.table_3[0].as_printed.sprung_mass_kg
    assert f"{100 * (1850 - pair) / 1850:+.0f}" in text


def test_the_settings_of_table_2_are_recorded_by_every_method(runs):
    for method in ("model", "classical", "paper"):
        found = opid.identify(_study(runs, window="flattop", estimator="H2"), method=method, law="arctan_velocity")
        for run in found.to_dict()["diagnostics"]["runs"]:
            mended, printed = run["transmissibility"], run["printed"]["transmissibility"]
            assert (mended["window"], mended["overlap"], mended["estimator"]) == ("flattop", 0.5, "H2")
            assert (printed["window"], printed["estimator"], printed["block_s"]) == ("flattop", "H2", 32.0)
            np.testing.assert_allclose(printed["overlap"], 0.3, atol=1e-4)
    settings = found.to_dict()["diagnostics"]["settings"]["estimator"]
    assert settings["printed"]["transmissibility"] == vars(replace(TABLE_2, estimator="H2"))


def test_the_answer_of_classical_does_not_depend_on_its_spectra(runs):
    usual, other = (
        identify_by_paper(_study(runs, **stated), law="arctan_velocity")
        for stated in ({}, {"block_s": 4, "overlap": 0})
    )
    assert usual.chain.runs[0].T.spectra.nperseg == 2 * other.chain.runs[0].T.spectra.nperseg
    assert usual.settings.transmissibility == MENDED
    assert usual.chain.runs[0].T.spectra.noverlap == usual.chain.runs[0].T.spectra.nperseg // 2
    for (_, one), (_, two) in zip(usual.parameters.items(), other.parameters.items(), strict=True):
        assert abs(one.value - two.value) < 0.1 * one.std


def test_the_printed_chain_warns_and_gives_no_interval(result):
    assert any("parabola" in each for each in result.warnings)
    assert any("1.0 independent averages" in each for each in result.warnings)
    assert all(estimate.std is None for _, estimate in (*result.parameters.items(), *result.ratios.items()))
    assert {term.name for term in result.law.terms} == {"arctan_displacement", "arctan_velocity"}


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"window": "flat_top"}, "there is no window 'flat_top': did you mean 'flattop'"),
        ({"estimator": "H3"}, "there is no estimator 'H3': "),
        ({"overlap": 30}, "the overlap is 30: give a fraction of a block, 0 to 0.95 .30 % are 0.3"),
        ({"overlap": -0.1}, "the overlap is -0.1: give a fraction"),
        ({"overlap": "30 %"}, "the overlap is '30 %': give a fraction"),
        ({"block_s": 0}, "block_s is 0: give the length of a block in s"),
        ({"block_s": float("nan")}, "block_s is nan"),
    ],
)
def test_wrong_settings_are_named(stated, words):
    with pytest.raises(InputError, match=words):
        TransmissibilitySettings(**stated)


def test_settings_are_completed_by_those_of_the_method():
    assert BY_METHOD.completed_by(TABLE_2) == TABLE_2
    stated = PaperSettings().stated_by(TransmissibilitySettings(block_s=16))
    assert stated.transmissibility == replace(MENDED, block_s=16)
    assert stated.printed.transmissibility == replace(TABLE_2, block_s=16)
