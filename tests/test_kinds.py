"""Every built-in kind of law: derivatives written by hand against differences, away from where a kind has a corner."""

import numpy as np
import pytest

from opid.mechanics.laws.kinds import BUILT_IN

CASES = [
    pytest.param(kind, place, id=f"{kind.name}-{('z', 'v', 'a', 'b')[place]}")
    for kind in BUILT_IN
    for place in range(4)
]


@pytest.mark.parametrize(("kind", "place"), CASES)
def test_a_derivative_written_by_hand_is_the_difference(kind, place):
    rng = np.random.default_rng(place)
    defaults = np.array([*(parameter.default for parameter in kind.parameters[1:]), 1.0, 1.0])[:2]
    # motions of a landing gear, on both sides of zero
    size = np.array([0.01, 0.2, *defaults])
    low, high = np.array([0.02, 0.02, 0.8, 0.8]), np.array([1.0, 1.0, 1.25, 1.25])
    points = size * rng.uniform(low, high, (400, 4))
    points[:, :2] *= rng.choice([-1.0, 1.0], (400, 2))
    # a dead zone ends, or a valve opens, at the first inner parameter
    by_corner = np.abs(np.abs(points[:, :2]) / points[:, 2:3] - 1.0).min(axis=1)
    points = points[by_corner > 0.02]
    assert len(points) > 300
    step = 1e-5 * np.abs(points[:, place]) * np.eye(4)[:, [place]]
    up, down = (kind.function(*(points.T + sign * step))[0] for sign in (1.0, -1.0))
    difference = (up - down) / (2.0 * step[place])
    given = np.broadcast_to(kind.function(*points.T)[1 + place], difference.shape)
    np.testing.assert_allclose(given, difference, rtol=1e-7, atol=1e-7 * np.abs(difference).max())
