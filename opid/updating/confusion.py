"""Which class these data would choose if another one were true."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from opid.updating.likelihood.backbones import BackboneData, ErrorGrowth, draw_curves, with_noise
from opid.updating.likelihood.curves import make_curves
from opid.updating.likelihood.force import draw_force
from opid.updating.likelihood.interactions import adapt_to_class
from opid.updating.posterior import estimate_evidence
from opid.updating.result import ClassPosterior, Confusion
from opid.updating.sampling.chains import Progress


def find_confusion(
    data: BackboneData,
    classes: Sequence[ClassPosterior],
    *,
    n_sets: int,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Confusion:
    """Return how often each class is chosen from sets of curves that are drawn with each of them as the truth.

    The sets have the amplitudes, the number of curves and the levels of noise of the measured ones, and laws drawn from
    the posterior of the class that is true. Classes are compared by Laplace's method.

    Args:
        data: the measured backbones in the recommended form, from `backbone_data`.
        classes: the classes with their posteriors.
        n_sets: number of sets for each true class.
        rng: source of chance.
        progress: a function that is called with the fraction that is done.
    """
    chosen = np.zeros((len(classes), len(classes)))
    for number, true in enumerate(classes):
        own = adapt_to_class(data, true.model_class, true.best)
        curves = [make_curves(own, mode, true.model_class) for mode in own.modes]
        for repeat in range(n_sets):
            theta = true.chain.draw(1, rng)
            solved = [make.solve(theta) for make in curves]
            found = [make.complete(each) for make, each in zip(curves, solved, strict=True)]
            modes = [
                draw_curves(mode, eigenvalue[0], shapes[0], rng)
                for mode, (eigenvalue, shapes, _, _) in zip(own.modes, found, strict=True)
            ]
            force = data.force
            if force is not None:
                losses = [make.find_losses(theta, each)[0] for make, each in zip(curves, solved, strict=True)]
                force = draw_force(force, np.concatenate(losses), data.noise, rng)
            errors = [mode.errors or ErrorGrowth.of(data.noise) for mode in data.modes]
            known = (with_noise(mode, data.noise, each) for mode, each in zip(modes, errors, strict=True))
            # The sets are of the smooth backbone, which no other mode pulls.
            drawn = replace(data, modes=tuple(known), force=force, met_damping=None)
            evidence = [estimate_evidence(drawn, other.model_class, rng) for other in classes]
            if max(evidence) > -np.inf:
                chosen[number, int(np.argmax(evidence))] += 1.0 / n_sets
            if progress:
                progress((number * n_sets + repeat + 1) / (len(classes) * n_sets))
    return Confusion(tuple(each.model_class.name for each in classes), chosen, n_sets)
