"""Spellings of units and what they are worth."""

import warnings

import numpy as np
import pytest

from opid.errors import InputError
from opid.signals.log import ChannelSettings
from opid.signals.units import _SPELLINGS, _TABLE, STANDARD_GRAVITY, _simplify, si_unit, to_si

G = 9.80665


@pytest.mark.parametrize("unit", ["g", "gn", "g0", "g_n", "G", " g ", "gee"])
def test_g_is_standard_gravity_and_never_the_gram(unit):
    assert to_si(unit) == (G, "m/s^2")


METRES_PER_SECOND_SQUARED = (
    *("m/s^2", "m/s2", "m/s²", "m/s/s", "m/s**2", "m/(s^2)", "m/(s*s)", "m / s^2", "m/sec^2", "M/S^2"),
    *("m s-2", "ms^-2", "m s^-2", "m·s⁻²", "m*s^-2", "m.s-2"),
)


@pytest.mark.parametrize("unit", METRES_PER_SECOND_SQUARED)
def test_metres_per_second_squared(unit):
    assert to_si(unit) == (1.0, "m/s^2")


@pytest.mark.parametrize(
    ("unit", "factor", "name"),
    [
        ("mg", G / 1000, "m/s^2"),
        ("µg", G / 1e6, "m/s^2"),  # micro sign
        ("μg", G / 1e6, "m/s^2"),  # Greek mu
        ("mm/s^2", 1e-3, "m/s^2"),
        ("cm/s²", 1e-2, "m/s^2"),
        ("gal", 1e-2, "m/s^2"),
        ("Gal", 1e-2, "m/s^2"),
        ("in/s^2", 0.0254, "m/s^2"),
        ("ft/s2", 0.3048, "m/s^2"),
        ("mm/s", 1e-3, "m/s"),
        ("m s^-1", 1.0, "m/s"),
        ("km/h", 1000 / 3600, "m/s"),
        ("mm", 1e-3, "m"),
        ("in", 0.0254, "m"),
        ("kN", 1e3, "N"),
        ("lbf", 4.4482216152605, "N"),
        ("kip", 4448.2216152605, "N"),
        ("kg", 1.0, "kg"),
        ("s", 1.0, "s"),
        ("ms", 1e-3, "s"),
        ("us", 1e-6, "s"),
        ("Sec", 1.0, "s"),
        ("min", 60.0, "s"),
        ("deg/s", 0.017453292519943295, "rad/s"),
        ("deg/s^2", 0.017453292519943295, "rad/s^2"),
        ("°/s²", 0.017453292519943295, "rad/s^2"),
        ("strain", 1.0, "strain"),
        ("ustrain", 1e-6, "strain"),
        ("µε", 1e-6, "strain"),
        ("UE", 1e-6, "strain"),
        ("µm/m", 1e-6, "strain"),
        ("ustrain/s^2", 1e-6, "strain/s^2"),
        ("mV", 1e-3, "V"),
        ("%", 1e-2, "1"),
        ("-", 1.0, "1"),
        ("°C", 1.0, "degC"),
    ],
)
def test_other_units(unit, factor, name):
    assert to_si(unit) == (pytest.approx(factor, rel=1e-12), name)


def test_case_counts_where_it_carries_meaning():
    assert to_si("MN") == (1e6, "N")
    assert to_si("mN") == (1e-3, "N")
    for unit in (
        "Mg",
        "Mm",
        "mn",
        "KN/m2",
    ):  # megagram, megametre, neither or both of mN and MN, no such unit
        with pytest.raises(InputError, match="not known"):
            to_si(unit)


@pytest.mark.parametrize("unit", [*_TABLE])
def test_an_si_unit_is_itself(unit):
    assert to_si(unit) == (1.0, unit)


def test_every_spelling_of_the_table_is_found():
    """A key that `_simplify` changes, like rad/s^2, could never match."""
    assert [each for each in _SPELLINGS if to_si(each) != _SPELLINGS[each]] == []
    assert [each for each in _SPELLINGS if _simplify(each) != each] == []


@pytest.mark.parametrize("unit", ["%", "count", "ratio", "-", "1", "V", "mV/V"])
def test_a_ratio_a_count_or_a_voltage_is_no_strain(unit):
    assert si_unit(unit) != "strain"


@pytest.mark.parametrize("unit", ["m/m", "mm/m"])
def test_what_may_be_a_slope_is_no_strain(unit):
    with pytest.raises(InputError, match="not known"):
        to_si(unit)


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("m/s^3", "did you mean 'm/s\\^2'"),
        ("furlong", "known are 'm/s\\^2', 'g'"),
        ("furlong", "'deg', 'rad', 'strain', 'ustrain'$"),
        ("", "known are"),
        ("k", "not known"),
    ],
)
def test_an_unknown_unit_names_the_nearest(unit, words):
    with pytest.raises(InputError, match=words):
        to_si(unit)


def test_the_constant():
    assert STANDARD_GRAVITY == G


def test_a_value_that_is_none_is_converted_without_a_warning():
    """A damaged file may hold the kind of NaN that warns when it is used."""
    signalling = np.array([0x7FF4000000000000], dtype=np.uint64).view(np.float64)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values, unit = ChannelSettings("a").to_si(signalling, "g")
    assert np.isnan(values).all()
    assert unit == "m/s^2"
