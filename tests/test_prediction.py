"""Predictions of a driven body: against plain filters, derivatives against differences, white where they should be."""

from dataclasses import fields, replace

import numpy as np
import pytest
from driven_response import driven_response
from scipy.linalg import block_diag, expm

from opid.errors import InputError
from opid.mechanics.driven import Interface, Noise, UnboundedResponseError, half_steps, predict
from opid.mechanics.laws.kinds import BUILT_IN, Kind, Parameter
from opid.mechanics.laws.law import default_law, law
from opid.mechanics.laws.own_kinds import register_kind, unregister_kind

FS, N = 1024.0, 120
ACCELERANCE = np.array([[1.0, 0.3], [0.3, 0.8]]) / 1500
NOISE = Noise([0.02, 0.03], [0.01, 0.02], [1e-3, 2e-3], [2e-3, 1e-3], [0.05, 0.03])
PUSHED = replace(NOISE, unmeasured=[0.2, 0.1], unmeasured_corner_hz=[15.0, 60.0])
# of sensors that are not at their interfaces, and what the change of the accelerance does to it
READING = np.array([[0.9, 0.35], [0.25, 1.1]]) / 1500
BY_READING = np.array([[0.5, -0.2], [0.1, 0.3]]) / 1500


def _resting(laws):
    """Default laws, each resting elsewhere."""
    return [default_law(name).resting_at(rest_m) for name, rest_m in zip(laws, (0.0035, -0.003), strict=True)]


def _first(noise, n):
    """The noise of the first interfaces."""
    return Noise(*(np.broadcast_to(getattr(noise, field.name), 2)[:n] for field in fields(noise)))


def _of(n, *, ground, laws=("linear", "linear"), noise=NOISE):
    """Interfaces, noise and signals of a small world with n interfaces."""
    rng = np.random.default_rng(n)
    stiffness, damping, springs = (3.9e5, 3e5), (6e3, 5e3), (1e5, 5e4) if ground else (0.0, 0.0)
    interfaces = [Interface(*row) for row in zip(stiffness, damping, springs, _resting(laws), strict=True)][:n]
    t = np.arange(2 * N - 1) / (2 * FS)
    drive = np.stack([np.sin(2 * np.pi * 1.9 * t), np.cos(2 * np.pi * 4.1 * t)], axis=1)[:, :n]
    rows = 6 if ground else 4
    start = 1e-3 * rng.standard_normal((rows, n))
    moving = start[:4] if ground else np.vstack([start[:2], np.zeros((2, n))])
    answer = driven_response(interfaces, ACCELERANCE[:n, :n], drive, fs=FS, start=moving, sensitivity=False)
    return {
        "interfaces": interfaces,
        "accelerance": ACCELERANCE[:n, :n],
        "drive": drive,
        "measured": answer.acceleration + 0.02 * rng.standard_normal((N, n)),
        "fs": FS,
        "noise": _first(noise, n),
        "start": start,
        "start_covariance": np.diag(1e-6 * (1 + rng.random(rows * n)) ** 2),
        "ground": ground,
    }


@pytest.mark.parametrize("noise", [NOISE, PUSHED], ids=["measured", "unmeasured"])
@pytest.mark.parametrize("ground", [False, True])
@pytest.mark.parametrize("n", [1, 2])
def test_a_linear_suspension_is_filtered_as_the_textbook_does(n, ground, noise):
    """Exact transition by the matrix exponential of a quadratic drive, Joseph form, innovations whitened last."""
    world = _of(n, ground=ground, noise=noise)
    found = predict(**world, sensitivity=False)
    a, rows = world["accelerance"], 6 if ground else 4
    k, c, g = np.array([[i.stiffness, i.damping, i.ground_stiffness] for i in world["interfaces"]]).T
    one, zero = np.eye(n), np.zeros((n, n))
    body = [-a * (k + g), -a * c, *([-a * g, zero] if ground else [])]
    reading = np.hstack([*body, zero, one])
    # the offset of the drive enters like the drive, that of the readings moves nothing
    rates = [[zero, one, *[zero] * (rows - 2)], [*body, -one, zero]]
    if ground:
        rates += [[zero, zero, zero, one, zero, zero], [*[zero] * 4, one, zero]]
    system = np.block([*rates, [zero] * rows, [zero] * rows])
    of_motion = np.vstack([zero, one, *[zero] * (rows - 2)])
    push = np.vstack([zero, -one, *([zero, one] if ground else []), zero, zero])

    h, size = 1 / FS, n * rows
    # drive u0 + a t + b t^2 as a chain of integrators
    chain = np.kron(np.array([[0.0, 1, 0], [0, 0, 2], [0, 0, 0]]), one)
    whole = np.block([[system, push, np.zeros((size, 2 * n))], [np.zeros((3 * n, size)), chain]])
    step = expm(whole * h)[:size]
    phi, of_drive = step[:, :size], step[:, size:]
    moved = expm(np.block([[system, of_motion], [np.zeros((n, size + n))]]) * h)[:size, size:]
    q, r, walk, reading_walk, motion, unmeasured, rate = world["noise"].table(n)
    q_matrix = of_drive[:, :n] * q**2 @ of_drive[:, :n].T + moved * motion**2 @ moved.T
    q_matrix += block_diag(np.zeros((size - 2 * n, size - 2 * n)), np.diag(walk**2), np.diag(reading_walk**2))
    x, p = world["start"].ravel(), world["start_covariance"]
    if unmeasured.any():
        # w is one state more: a straight line from w to decay * w + push
        decay, line = np.diag(np.exp(-rate * h)), np.block([[zero, one / h], [zero, zero]])
        by_w = expm(np.block([[system, np.hstack([of_motion, 0 * of_motion])], [np.zeros((2 * n, size)), line]]) * h)
        of_w, of_slope = by_w[:size, size : size + n], by_w[:size, size + n :]
        phi = np.block([[phi, of_w + of_slope @ (decay - one)], [np.zeros((n, size)), decay]])
        of_drive, reading = np.vstack([of_drive, np.zeros((n, 3 * n))]), np.hstack([reading, one])
        new = np.vstack([of_slope, one])
        q_matrix = block_diag(q_matrix, zero) + new @ ((one - decay**2) * unmeasured**2) @ new.T
        x, p = np.append(x, np.zeros(n)), block_diag(p, np.diag(unmeasured**2))
    drive, innovation, spread = world["drive"], [], []
    for now, measured in enumerate(world["measured"]):
        raw, s = measured - reading @ x, reading @ p @ reading.T + np.diag(r**2)
        factor = np.linalg.cholesky(s)
        innovation.append(np.linalg.solve(factor, raw))
        spread.append(np.diag(factor))
        gain = np.linalg.solve(s, reading @ p).T
        rest = np.eye(x.size) - gain @ reading
        x, p = x + gain @ raw, rest @ p @ rest.T + gain * r**2 @ gain.T
        if now + 1 < len(world["measured"]):
            u0, u1, u2 = drive[2 * now : 2 * now + 3]
            chain_state = np.concatenate([u0, (4 * u1 - 3 * u0 - u2) / h, 2 * (u0 - 2 * u1 + u2) / h**2])
            x, p = phi @ x + of_drive @ chain_state, phi @ p @ phi.T + q_matrix
    np.testing.assert_allclose(found.spread.T, spread, rtol=1e-6)
    np.testing.assert_allclose(found.innovation.T, innovation, atol=1e-6 * np.abs(innovation).max())


LAWS = ("arctan_mixed+cubic_stiffness", "gas_column")


def _directions(n):
    rng = np.random.default_rng(7)
    return {
        "accelerance_directions": ACCELERANCE[np.newaxis, :n, :n] * (1 + 0.2 * np.eye(n)),
        "drive_directions": np.stack([rng.standard_normal((2 * N - 1, n)), np.ones((2 * N - 1, n))], axis=1),
        "measured_directions": rng.standard_normal((N, 1, n)),
    }


def _vector(world):
    """The parameters in the order of the sensitivity; the fractions of the directions are zero."""
    own = [[i.stiffness, i.damping, i.ground_stiffness, i.law.rest_m, *i.law.vector] for i in world["interfaces"]]
    return np.concatenate([*own, [0.0] * 4, world["start"][:-2].ravel()])


def _at(world, theta):
    """The world with other parameters."""
    n, place, interfaces = len(world["interfaces"]), 0, []
    for old in world["interfaces"]:
        own = theta[place : place + old.n_parameters]
        interfaces.append(Interface(*own[:3], old.law.with_vector(own[4:]).resting_at(own[3])))
        place += old.n_parameters
    by_mass, by_drive, by_measured = _directions(n).values()
    return world | {
        "interfaces": interfaces,
        "accelerance": world["accelerance"] + theta[place] * by_mass[0],
        "drive": world["drive"] + theta[place + 1] * by_drive[:, 0] + theta[place + 2] * by_drive[:, 1],
        "measured": world["measured"] + theta[place + 3] * by_measured[:, 0],
        **({"reading": world["reading"] + theta[place] * BY_READING} if "reading" in world else {}),
        "start": np.vstack([theta[place + 4 :].reshape(-1, n), world["start"][-2:]]),
    }


def _check_derivatives(world, innovation, off=2e-6):
    """Derivatives of `predict` are the differences of `innovation`, a function of a world."""
    n, base = len(world["interfaces"]), _vector(world)
    displaced = {"reading_directions": BY_READING[np.newaxis]} if "reading" in world else {}
    found = predict(**world, **_directions(n), **displaced).sensitivity
    assert found.shape == (n, base.size, N)
    firsts = np.cumsum([0, *(i.n_parameters for i in world["interfaces"])])[:n]
    for place, value in enumerate(base):
        if not world["ground"] and place in firsts + 2:
            assert not found[:, place].any()
            continue
        step = np.zeros(base.size)
        step[place] = 1e-5 * (abs(value) or 0.1)
        difference = (innovation(_at(world, base + step)) - innovation(_at(world, base - step))) / (2 * step[place])
        np.testing.assert_allclose(found[:, place], difference, atol=off * np.abs(difference).max())


@pytest.mark.parametrize("ground", [False, True])
@pytest.mark.parametrize("n", [1, 2])
def test_derivatives_are_those_of_the_steps_where_nothing_is_corrected(n, ground):
    world = _of(n, ground=ground, laws=LAWS)
    world |= {"noise": Noise(0.0, NOISE.table(2)[1, :n]), "start_covariance": 0 * world["start_covariance"]}
    _check_derivatives(world, lambda changed: predict(**changed, sensitivity=False).innovation)
    free = driven_response(
        world["interfaces"],
        world["accelerance"],
        world["drive"] + np.repeat(world["start"][-2:-1], 2 * N - 1, axis=0),
        fs=FS,
        start=world["start"][:4] if ground else np.vstack([world["start"][:2], np.zeros((2, n))]),
        ground=ground,
        sensitivity=False,
    )
    expected = (world["measured"] - free.acceleration - world["start"][-1]) / world["noise"].measured
    np.testing.assert_allclose(predict(**world).innovation.T, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", [kind.name for kind in BUILT_IN])
@pytest.mark.parametrize("n", [1, 2])
def test_every_kind_is_differentiated(n, name):
    world = _of(n, ground=True, laws=(name, name))
    world |= {"noise": Noise(0.0, NOISE.table(2)[1, :n]), "start_covariance": 0 * world["start_covariance"]}
    # near a corner of a law a difference takes in both sides of it
    _check_derivatives(world, lambda changed: predict(**changed, sensitivity=False).innovation, off=1e-4)


def _rate(world, state, drive, motion=0.0):
    """Rates of columns of states and what the sensors read; `motion` accelerates z alone."""
    n = len(world["interfaces"])
    z, v, *rest = state.reshape(-1, n, state.shape[1])
    force = np.array(
        [i.stiffness * z[k] + i.damping * v[k] + i.law.force(z[k], v[k]) for k, i in enumerate(world["interfaces"])]
    )
    if world["ground"]:
        force += np.array([[i.ground_stiffness] for i in world["interfaces"]]) * (z + rest[0])
    body = -world["accelerance"] @ force
    still = np.zeros_like(z)
    below = drive[:, np.newaxis] + rest[-2]
    moving = [v, body - below + motion, *([rest[1], below] if world["ground"] else [])]
    read = -world.get("reading", world["accelerance"]) @ force
    return np.concatenate([*moving, still, still]), read + rest[-1]


def _is_pushed(world):
    return bool(np.any(world["noise"].unmeasured))


def _read(world, state, drive):
    """What the sensors read; the acceleration by unmeasured forces comes last in the state."""
    n = len(world["interfaces"])
    if not _is_pushed(world):
        return _rate(world, state, drive)[1]
    return _rate(world, state[:-n], drive)[1] + state[-n:]


def _step(world, state, drives, motion=0.0, push=0.0):
    h, n = 1 / FS, len(world["interfaces"])
    moving, begin, end = state, 0.0, 0.0
    if _is_pushed(world):
        moving, begin = state[:-n], state[-n:]
        end = np.exp(-world["noise"].table(n)[6] * h)[:, np.newaxis] * begin + push
    middle = (begin + end) / 2
    first = _rate(world, moving, drives[0], motion + begin)[0]
    second = _rate(world, moving + h / 2 * first, drives[1], motion + middle)[0]
    third = _rate(world, moving + h / 2 * second, drives[1], motion + middle)[0]
    fourth = _rate(world, moving + h * third, drives[2], motion + end)[0]
    moving = moving + h / 6 * (first + 2 * second + 2 * third + fourth)
    return np.concatenate([moving, end]) if _is_pushed(world) else moving


def _plain_filter(world, frozen=None):
    """White innovations; and gains with the factors of the variance, made by differences unless given."""
    n, x, p = len(world["interfaces"]), world["start"].reshape(-1, 1), world["start_covariance"]
    q, r, *walks, motion, unmeasured, rate = world["noise"].table(n)
    offsets, n_plain = slice(x.size - 2 * n, x.size - n), x.size
    scales = np.repeat(np.array([1e-6, 1e-4, 1e-6, 1e-4, 1e-3, 1e-3])[[*range(n_plain // n - 2), 4, 5]], n)
    if _is_pushed(world):
        x, p = np.vstack([x, np.zeros((n, 1))]), block_diag(p, np.diag(unmeasured**2))
        scales = np.append(scales, np.full(n, 1e-3))
    size = x.size
    around = np.hstack([np.diag(scales), -np.diag(scales)])
    innovation, gains = [], []
    for now, measured in enumerate(world["measured"]):
        raw = measured[:, np.newaxis] - _read(world, x, measured)
        if frozen is None:
            readings = _read(world, x + around, measured)
            by_state = (readings[:, :size] - readings[:, size:]) / (2 * scales)
            s = by_state @ p @ by_state.T + np.diag(r**2)
            gain = np.linalg.solve(s, by_state @ p).T
            p = p - gain @ s @ gain.T
            gains.append((gain, np.linalg.cholesky(s)))
        else:
            gains.append(frozen[now])
        gain, factor = gains[-1]
        innovation.append(np.linalg.solve(factor, raw)[:, 0])
        x = x + gain @ raw
        drives = world["drive"][2 * now : 2 * now + 3]
        if len(drives) < 3:
            break
        if frozen is None:
            after = _step(world, x + around, drives)
            phi = (after[:, :size] - after[:, size:]) / (2 * scales)
            push = phi[:, offsets] * np.where(np.arange(size) < n_plain - 2 * n, 1.0, 0.0)[:, np.newaxis]
            ahead, back = (_step(world, np.repeat(x, n, axis=1), drives, sign * np.eye(n)) for sign in (1e-3, -1e-3))
            moved = (ahead - back) / 2e-3
            p = phi @ p @ phi.T + push * q**2 @ push.T + moved * motion**2 @ moved.T
            p[np.arange(n_plain - 2 * n, n_plain), np.arange(n_plain - 2 * n, n_plain)] += np.concatenate(walks) ** 2
            if _is_pushed(world):
                many = np.repeat(x, n, axis=1)
                ahead, back = (_step(world, many, drives, push=sign * np.eye(n)) for sign in (1e-3, -1e-3))
                moved = (ahead - back) / 2e-3
                p += moved * unmeasured**2 * (1 - np.exp(-2 * rate / FS)) @ moved.T
        x = _step(world, x, drives)
    return np.transpose(innovation), gains


@pytest.mark.slow
@pytest.mark.parametrize("noise", [NOISE, PUSHED], ids=["measured", "unmeasured"])
@pytest.mark.parametrize(("n", "ground"), [(1, False), (1, True), (2, True)])
def test_corrected_predictions_and_their_derivatives_are_those_of_a_plain_filter(n, ground, noise):
    """Derivatives hold the gain: of the plain filter it is recorded, then kept."""
    world = _of(n, ground=ground, laws=LAWS, noise=noise)
    innovation, gains = _plain_filter(world)
    found = predict(**world)
    np.testing.assert_allclose(found.innovation, innovation, atol=1e-5 * np.abs(innovation).max())
    np.testing.assert_allclose(found.spread.T, [np.diag(factor) for _, factor in gains], rtol=1e-5)
    _check_derivatives(world, lambda changed: _plain_filter(changed, gains)[0])


def test_a_sensor_beside_its_interface_is_filtered_and_differentiated_as_the_plain_filter_does():
    world = _of(2, ground=False, laws=LAWS) | {"reading": READING}
    innovation, gains = _plain_filter(world)
    found = predict(**world)
    np.testing.assert_allclose(found.innovation, innovation, atol=1e-5 * np.abs(innovation).max())
    np.testing.assert_allclose(found.spread.T, [np.diag(factor) for _, factor in gains], rtol=1e-5)
    _check_derivatives(world, lambda changed: _plain_filter(changed, gains)[0])
    assert np.abs(found.innovation - predict(**_of(2, ground=False, laws=LAWS)).innovation).max() > 0.1


def test_a_displaced_sensor_reads_the_body_where_it_is():
    """Of a bar on two springs: the acceleration at another place is that of the line through both ends."""
    world = _of(2, ground=False) | {"noise": Noise(0.0, 1e9), "start_covariance": np.zeros((8, 8))}
    line = np.array([[0.8, 0.2], [-0.3, 1.3]])
    here = predict(**world)
    there = predict(**world, reading=line @ ACCELERANCE)
    np.testing.assert_allclose(there.travel, here.travel, rtol=1e-12)
    size = np.abs(here.acceleration).max()
    np.testing.assert_allclose(there.acceleration, here.acceleration @ line.T, atol=1e-9 * size)


@pytest.mark.parametrize("ground", [False, True])
def test_sensors_at_their_interfaces_need_no_reading(ground):
    world, ways = _of(2, ground=ground, laws=LAWS), _directions(2)
    old = predict(**world, **ways)
    new = predict(**world, **ways, reading=world["accelerance"], reading_directions=ways["accelerance_directions"])
    for name in ("innovation", "spread", "sensitivity", "travel", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(new, name), getattr(old, name))


@pytest.mark.parametrize("noise", [NOISE, PUSHED], ids=["measured", "unmeasured"])
@pytest.mark.parametrize("ground", [False, True])
def test_one_interface_is_the_first_of_two_that_know_nothing_of_each_other(ground, noise):
    alone = _of(1, ground=ground, laws=LAWS, noise=noise)
    n_own = alone["interfaces"][0].n_parameters
    both = {key: np.repeat(alone[key], 2, axis=1) for key in ("drive", "measured", "start")}
    both |= {"start_covariance": np.kron(alone["start_covariance"], np.eye(2))}
    both |= {"interfaces": alone["interfaces"] * 2, "accelerance": np.eye(2) * alone["accelerance"]}
    both |= {"fs": FS, "ground": ground, "noise": _first(alone["noise"], 1)}
    ways = _directions(1)
    one = predict(**alone, **ways)
    # the second knows nothing of the directions either
    only = {"accelerance_directions": np.diag([1.0, 0.0])} | {key: [1.0, 0.0] for key in ways if "acc" not in key}
    two = predict(**both, **{key: way * only[key] for key, way in ways.items()})
    own = [*range(n_own), *range(2 * n_own, 2 * n_own + 4)]
    own += range(2 * n_own + 4, two.sensitivity.shape[1], 2)
    for name in ("innovation", "spread"):
        np.testing.assert_allclose(getattr(two, name)[0], getattr(one, name)[0], rtol=1e-7, atol=1e-7)
    for name in ("travel", "velocity", "acceleration"):
        size = np.abs(getattr(one, name)).max()
        np.testing.assert_allclose(getattr(two, name)[:, :1], getattr(one, name), atol=1e-8 * size)
    off, size = np.abs(two.sensitivity[:1, own] - one.sensitivity).max(axis=2), np.abs(one.sensitivity).max(axis=2)
    assert (off <= 1e-8 * size).all()
    assert not two.sensitivity[1, :n_own].any()


def _autocorrelation(x, n_lags=20):
    return np.array([np.mean(x[lag:] * x[:-lag]) for lag in range(1, n_lags + 1)]) / np.mean(x**2)


def test_at_the_truth_the_innovations_are_white_whatever_the_law():
    """A stiff cubic spring carries the noise of the drive along: free simulation leaves coloured errors."""
    rng, fs, settle = np.random.default_rng(4), 256.0, 512
    n = 40 * 256
    gear = [Interface(2e5, 2e3, law=law("cubic_stiffness", stiffness_n_per_m3=4e9))]
    lines = np.fft.rfftfreq(n, 1 / fs)
    amplitude = np.where((lines > 0.3) & (lines < 20.0), 1.0, 0.0)
    u = np.fft.irfft(amplitude * np.exp(2j * np.pi * rng.random(lines.size)), n)[:, np.newaxis]
    u *= 3.0 / u.std()
    truth = driven_response(gear, [[1 / 1800]], half_steps(u), fs=fs, sensitivity=False)
    # the cubic force matters
    assert 4e9 * np.std(truth.travel**3) > 0.3 * 2e5 * truth.travel.std()
    drive = half_steps(u + 0.02 * rng.standard_normal((n, 1)))
    measured = truth.acceleration + 0.02 * rng.standard_normal((n, 1))
    settings = {"fs": fs, "start": np.zeros((4, 1)), "start_covariance": np.zeros((4, 4)), "sensitivity": False}
    chance = 1 / np.sqrt(n - settle)
    white = predict(gear, [[1 / 1800]], drive, measured, noise=Noise(0.02, 0.02), **settings).innovation[0, settle:]
    free = predict(gear, [[1 / 1800]], drive, measured, noise=Noise(0.0, 0.02), **settings).innovation[0, settle:]
    assert np.abs(_autocorrelation(white)).max() < 4 * chance
    assert abs(np.var(white) - 1) < 4 * np.sqrt(2) * chance
    assert np.abs(_autocorrelation(free)).max() > 0.3
    assert np.var(free) > 1.5


def _cubic(z, v, a, _):
    return z * z * z, 3.0 * z * z, 0.0, 0.0, 0.0


def test_an_own_kind_is_predicted_like_a_built_in_one():
    world = _of(1, ground=False, laws=("cubic_stiffness", "linear"))
    stiffness = Parameter("stiffness_n_per_m3", "N/m^3", "amplitude", 3e9)
    register_kind(Kind("own_cubic", "k z^3", (stiffness,), _cubic))
    try:
        own = predict(**world | {"interfaces": [Interface(3.9e5, 6e3, law=law("own_cubic", stiffness_n_per_m3=3e9))]})
    finally:
        unregister_kind("own_cubic")
    built_in = Interface(3.9e5, 6e3, law=law("cubic_stiffness", stiffness_n_per_m3=3e9))
    expected = predict(**world | {"interfaces": [built_in]})
    np.testing.assert_allclose(own.innovation, expected.innovation, rtol=1e-9, atol=1e-9)
    size = np.abs(expected.sensitivity).max(axis=2, keepdims=True)
    assert (np.abs(own.sensitivity - expected.sensitivity) <= 1e-9 * size).all()


@pytest.mark.parametrize(("ground", "n"), [(False, 200_000), (True, 200_000)])
def test_the_covariance_stays_one_over_many_samples(ground, n):
    """P - K K' loses nothing: the filter comes to its steady state and stays there."""
    rows = 6 if ground else 4
    found = predict(
        [Interface(3.9e5, 6e3, 1e5 if ground else 0.0)],
        [[1 / 1800]],
        np.zeros((2 * n - 1, 1)),
        np.zeros((n, 1)),
        fs=FS,
        noise=Noise(0.02, 0.01, 1e-5, 1e-5),
        start=np.zeros((rows, 1)),
        start_covariance=1e-4 * np.eye(rows),
        ground=ground,
        sensitivity=False,
    ).spread[0]
    np.testing.assert_allclose(found[n // 2 :], found[-1], rtol=2e-8 if ground else 1e-12)


def test_bad_input_is_named():
    world = _of(2, ground=False)
    with pytest.raises(InputError, match=r"give \(2, 2\), \(239, 2\), \(120, 2\), \(4, 2\), \(8, 8\) for 2 interface"):
        predict(**world | {"drive": world["drive"][:-1]})
    with pytest.raises(InputError, match=r"\(6, 2\), \(12, 12\) for 2 interface"):
        predict(**world | {"ground": True})
    with pytest.raises(InputError, match="ground is False"):
        predict(**world | {"interfaces": _of(2, ground=True)["interfaces"]})
    with pytest.raises(InputError, match=r"reading and its directions have shapes \(1, 2\) and \(0, 2, 2\): give"):
        predict(**world | {"reading": READING[:1]})
    ways = {"accelerance_directions": np.ones((2, 2, 2)), "reading_directions": np.ones((1, 2, 2))}
    with pytest.raises(InputError, match=r"have shapes \(2, 2\) and \(1, 2, 2\): give .* \(2, 2, 2\)"):
        predict(**world | ways)
    for name, way in _directions(2).items():
        with pytest.raises(InputError, match=rf"{name} has shape .*: give \(.*n_directions"):
            predict(**world | {name: way[..., :1]})


def test_a_motion_without_bound_is_named():
    world = _of(1, ground=False)
    falling = {"interfaces": [Interface(-4e12, 0.0)], "noise": Noise(0.0, 0.01), "start_covariance": np.zeros((4, 4))}
    with pytest.raises(UnboundedResponseError, match="grows without bound"):
        predict(**world | falling)
