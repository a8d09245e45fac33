"""Figures of posterior samples: histograms, pairs with the contours of a Gaussian, running mean and deviation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from opid.plots.style import BLUE, GREEN, INK, VERMILION, WIDTH_IN, every, house_style, panels, thick
from opid.signals.recording import FloatArray

__all__ = ["parameter_samples", "running_moments"]

# of the Gaussian: fractions of the samples within its contours
_WITHIN = (0.5, 0.9, 0.99)
# points of the running moments
_N_RUNNING = 400
# parameters with panels of their own at most: more are no figure
_N_SHOWN = 5


def parameter_samples(
    samples: FloatArray, labels: Sequence[str], *, truth: Sequence[float | None] | None = None, axes: Any = None
) -> np.ndarray:
    """Draw histograms of the parameters and scatters of their pairs, with the Gaussian of the same mean and covariance.

    Histograms are densities, as the Gaussians beside them; the contours hold 50, 90 and 99 % of the Gaussian (Song et
    al. 2021, Figs. 6 and 8 to 10).

    Args:
        samples: (n_samples, n_parameters); the first five parameters are drawn.
        labels: of the parameters, for the axes.
        truth: value of each parameter in a simulation; None where it has none.
        axes: n x n Axes, or None for a new figure.

    Returns:
        (n, n) Axes, those above the diagonal empty.
    """
    shown = np.asarray(samples, dtype=np.float64)[:, :_N_SHOWN]
    n = shown.shape[1]
    known = [None] * n if truth is None else list(truth)[:n]
    with house_style():
        grid = panels(axes, n, n, height_in=1.0 + 2.0 * n, width_in=max(WIDTH_IN, 2.2 * n))
        for (row, column), ax in np.ndenumerate(grid):
            if column > row:
                ax.set_axis_off()
                continue
            if row == column:
                _histogram(ax, shown[:, row], known[row])
            else:
                _pair(ax, shown[:, [column, row]], (known[column], known[row]))
                if column == 0:
                    ax.set_ylabel(labels[row])
            ax.xaxis.set_major_locator(MaxNLocator(nbins=5))
            if row == n - 1:
                ax.set_xlabel(labels[column])
        grid[0, 0].set_ylabel("density")
        thick(grid[0, 0].legend(loc="best", fontsize=7.5))
    return grid


def running_moments(samples: FloatArray, labels: Sequence[str], axes: Any = None) -> np.ndarray:
    """Draw how mean and standard deviation settle as samples come in (Song et al. 2021, Figs. 6b and 8b).

    Args:
        samples: (n_samples, n_parameters) in the order in which they were drawn, chain after chain; the first five
            parameters are drawn.
        labels: of the parameters, for the axes.
        axes: n x 2 Axes, or None for a new figure.

    Returns:
        (n, 2) Axes.
    """
    shown = np.asarray(samples, dtype=np.float64)[:, :_N_SHOWN]
    count = np.arange(1, len(shown) + 1)
    # about the mean of all, so that no digits are lost
    centre = shown.mean(axis=0)
    mean = np.cumsum(shown - centre, axis=0) / count[:, None]
    square = np.cumsum((shown - centre) ** 2, axis=0) / count[:, None]
    deviation = np.sqrt(np.maximum(square - mean**2, 0.0))
    thin = every(len(shown), _N_RUNNING)
    with house_style():
        grid = panels(axes, shown.shape[1], 2, height_in=0.9 + 1.5 * shown.shape[1], sharex="all")
        for row, label in enumerate(labels[: shown.shape[1]]):
            for ax, values in zip(grid[row], ((mean + centre)[:, row], deviation[:, row]), strict=True):
                ax.plot(count[thin], values[thin], color=BLUE)
                ax.axhline(values[-1], color=INK, linestyle="--", linewidth=0.9)
            grid[row, 0].set_ylabel(label)
        for ax, title in zip(grid[0], ("Mean", "Standard deviation"), strict=True):
            ax.set_title(title)
        for ax in grid[-1]:
            ax.set_xlabel("samples")
    return grid


def _histogram(ax: Axes, values: np.ndarray, truth: float | None) -> None:
    mean, deviation = float(values.mean()), float(values.std())
    ax.hist(values, bins="auto", range=_span(values), density=True, color=BLUE, alpha=0.45, label="samples")
    if deviation > 0:
        x = np.linspace(mean - 4 * deviation, mean + 4 * deviation, 300)
        density = np.exp(-0.5 * ((x - mean) / deviation) ** 2) / (np.sqrt(2 * np.pi) * deviation)
        ax.plot(x, density, color=INK, linewidth=1.2, label="Gaussian")
    if truth is not None:
        ax.axvline(truth, color=GREEN, linestyle="--", label="truth")
    ax.set_yticks([])


def _pair(ax: Axes, pair: np.ndarray, truth: tuple[float | None, float | None]) -> None:
    thinned = pair[every(len(pair))]
    ax.plot(*thinned.T, linestyle="none", marker=".", markersize=2.5, color=BLUE, alpha=0.35, rasterized=True)
    mean, covariance = pair.mean(axis=0), np.cov(pair.T)
    angle = np.linspace(0, 2 * np.pi, 200)
    values, directions = np.linalg.eigh(covariance)
    circle = np.vstack([np.cos(angle), np.sin(angle)])
    ellipse = directions @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
    for within in _WITHIN:
        # of a Gaussian in the plane, exp(-r^2/2) lies beyond r
        ax.plot(*(mean[:, None] + np.sqrt(-2 * np.log(1 - within)) * ellipse), color=VERMILION, linewidth=1.0)
    if truth[0] is not None and truth[1] is not None:
        ax.plot(truth[0], truth[1], marker="+", markersize=11, markeredgewidth=2, color=GREEN, linestyle="none")


def _span(values: np.ndarray) -> tuple[float, float]:
    """The range of the values without the last 0.1 % at either side, which would make the bins wide."""
    low, high = (float(each) for each in np.quantile(values, [0.001, 0.999]))
    return (low, high) if high > low else (low - 0.5, low + 0.5)
