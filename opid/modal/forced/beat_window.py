"""The windows of sine beats and the width of their spectra, from the window's own transform."""

from __future__ import annotations

import numpy as np

from opid.errors import InputError
from opid.signals.recording import FloatArray
from opid.signals.spectra import Window

_IN_SAMPLES = (
    *("gaussian", "gauss", "gss", "general gaussian", "general_gaussian", "general gauss", "general_gauss", "ggs"),
    *("exponential", "poisson"),
)
_FINE, _WIDEST = 4096, 96.0  # samples of a window, and how far its spectrum is searched, in 1/T


def first_minimum_hz(window: Window, duration_s: float) -> float:
    """Return the distance from the centre of a beat's spectrum to its first minima, Hz: 4/T for Blackman-Harris.

    Args:
        window: as in `SineBeat`.
        duration_s: length T of the window, s.

    Raises:
        InputError: a window that is not known or whose spectrum has no minimum, or a duration that is not positive.

    >>> round(first_minimum_hz("blackmanharris", 2.0), 6)
    2.0
    """
    require_positive("duration_s", duration_s)
    return _first_minimum(window) / duration_s


def main_lobe_width_hz(window: Window, duration_s: float, *, level_db: float | None = None) -> float:
    """Return the width of the main lobe of a beat's spectrum, Hz.

    Args:
        window: as in `SineBeat`.
        duration_s: length of the window, s.
        level_db: level below the peak at which the width is taken, dB, e.g. -20; between the first minima where None.

    Raises:
        InputError: as `first_minimum_hz`, or a level that is not negative or that the main lobe does not reach.

    >>> round(main_lobe_width_hz("hann", 1.0), 6), round(main_lobe_width_hz("hann", 1.0, level_db=-3.0), 2)
    (4.0, 1.44)
    """
    require_positive("duration_s", duration_s)
    return _lobe_width(window, level_db) / duration_s


def window_samples(window: Window, n_samples: int) -> FloatArray:
    """Return the samples of a window from its first to its last, (n_samples,).

    Args:
        window: any name or tuple that scipy.signal.get_window takes, except those whose width counts samples.
        n_samples: number of samples.

    Raises:
        InputError: no window of scipy's, or one whose width counts samples.
    """
    from scipy import signal

    name = window if isinstance(window, str) else window[0]
    if name in _IN_SAMPLES:
        raise InputError(
            f"the width of the window {name!r} counts samples: take one that scales with time, e.g. 'hann'"
        )
    try:
        return np.asarray(signal.get_window(window, n_samples, fftbins=False), dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise InputError(
            f"the window {window!r} is none of scipy's ({error}): give a name like 'blackmanharris', or a tuple like "
            "('kaiser', 14.0)"
        ) from None


def _spectrum(window: Window, distance: FloatArray) -> FloatArray:
    """Magnitude of a window's spectrum over that at its centre; the distance is in 1/T."""
    shape = window_samples(window, _FINE + 1)
    shape[[0, -1]] /= 2  # the trapezoidal rule, exact for sums of cosines
    place = np.arange(_FINE + 1) / _FINE - 0.5
    return np.abs(np.exp(-2j * np.pi * np.multiply.outer(distance, place)) @ shape) / abs(shape.sum())


def _padded_spectrum(window: Window) -> tuple[FloatArray, FloatArray]:
    """The same on a fine grid of distances, by zero padding."""
    shape = window_samples(window, _FINE + 1)
    shape[[0, -1]] /= 2
    finer = 32
    value = np.abs(np.fft.rfft(shape, finer * _FINE)) / abs(shape.sum())
    n = round(_WIDEST * finer)
    return np.arange(n) / finer, value[:n]


def _first_minimum(window: Window) -> float:
    """Of the spectrum of a window, in 1/T."""
    from scipy import optimize

    distance, value = _padded_spectrum(window)
    falls = np.diff(value)
    turns = np.flatnonzero((falls[:-1] < 0) & (falls[1:] >= 0))
    if not turns.size:
        raise InputError(f"the spectrum of the window {window!r} has no minimum: take another window")
    bounds = distance[turns[0]], distance[turns[0] + 2]
    found = optimize.minimize_scalar(
        lambda x: float(_spectrum(window, np.array([x]))[0]), bounds=bounds, method="bounded", options={"xatol": 1e-9}
    )
    return float(found.x)


def _lobe_width(window: Window, level_db: float | None) -> float:
    """Width of the main lobe in 1/T."""
    from scipy import optimize

    minimum = _first_minimum(window)
    if level_db is None:
        return 2 * minimum
    if not (np.isfinite(level_db) and level_db < 0):
        raise InputError(f"level_db is {level_db}: give a negative number of decibels, e.g. -20")
    level = 10 ** (level_db / 20)
    if _spectrum(window, np.array([minimum]))[0] >= level:
        raise InputError(f"the main lobe of {window!r} ends above {level_db:g} dB: give a level nearer to 0")
    return 2 * float(optimize.brentq(lambda x: float(_spectrum(window, np.array([x]))[0]) - level, 0, minimum))


def require_positive(name: str, value: float) -> None:
    """Refuse what is no positive number.

    Args:
        name: of the value.
        value: given.

    Raises:
        InputError: it is none.
    """
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{name} is {value}: give a positive number")
