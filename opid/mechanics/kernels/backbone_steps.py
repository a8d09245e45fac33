"""Newton's method for a backbone, condensed on the joints, compiled."""

from __future__ import annotations

import numpy as np

from opid.mechanics.kernels.compilation import evaluate, evaluate_cycle, kernel, part

# relative step after which Newton's method stops; the error is then about its square
_SMALL_STEP = 1e-8
_MOST_ITERATIONS = 12
# number of halvings of a step of the amplitude after which a point is given up
_MOST_HALVINGS = 8
# fractions of the eigenvalue and of the extensions by which a point may differ from its prediction; a point that is
# farther off may be on another branch, and smaller steps are taken
_FARTHEST = 0.05
_FARTHEST_EXTENSION = 0.2
# code among the powers of a kind with memory, whose force depends on the largest extension of the cycle, too
CYCLIC = -2
# least |z| of powers of |z|, which stay finite at z = 0
_LEAST_TRAVEL = 1e-30


@part(inline=False)
def _compute_power_forces(law, sample, z, force, slope):  # type: ignore[no-untyped-def]
    """Compute the first harmonic of sums of c |z|^(p-1) z for one harmonic: c beta_p |z|^(p-1) z, and its slope."""
    first_rows, last_rows, _, powers, values, factors = law
    for j in range(force.shape[1]):
        travel = abs(z[j])
        total, by_z = 0.0, 0.0
        for row in range(first_rows[j], last_rows[j]):
            power = float(powers[row])
            if powers[row] == 3:
                stiffness = travel * travel
            elif powers[row] == 2:
                stiffness = travel
            elif powers[row] == 4:
                stiffness = travel * travel * travel
            elif powers[row] == 5:
                stiffness = travel * travel * (travel * travel)
            else:
                power = values[sample, row, 1]
                stiffness = max(travel, _LEAST_TRAVEL) ** (power - 1.0)
            stiffness *= factors[sample, row]
            total += stiffness * z[j]
            by_z += power * stiffness
        force[0, j] = total
        slope[j, 0, 0] = by_z


@part(inline=True, freedom="any order")
def _sum_weighted(weights, row, values):  # type: ignore[no-untyped-def]
    total = 0.0
    for t in range(values.size):
        total += weights[row, t] * values[t]
    return total


@part(inline=True, freedom="any order")
def _compute_motion_of_joint(z, n_joints, j, cosines, motion):  # type: ignore[no-untyped-def]
    for t in range(motion.size):
        total = 0.0
        for k in range(cosines.shape[0]):
            total += z[k * n_joints + j] * cosines[k, t]
        motion[t] = total


@part(inline=True)
def _add_term(code, power, amplitude, a, b, motion, force, slope):  # type: ignore[no-untyped-def]
    """Add one term of a law at all times of a period; powers have loops of their own that take several at once."""
    for t in range(motion.size):
        z = motion[t]
        if power == 3:
            tangent = amplitude * z * z
        elif power == 2:
            tangent = amplitude * abs(z)
        elif power == 4:
            tangent = amplitude * abs(z) * z * z
        elif power == 5:
            tangent = amplitude * z * z * z * z
        else:
            shape, by_z, _, _, _ = evaluate(code, z, 0.0, a, b)
            force[t] += amplitude * shape
            slope[t] += amplitude * by_z
            continue
        force[t] += tangent * z
        slope[t] += power * tangent


@part(inline=False)
def _add_cycle(code, values, motion, reach, force, slope, slope_of_reach):  # type: ignore[no-untyped-def]
    """Add one term with memory at all times of a period."""
    for t in range(motion.size):
        shape, by_z, by_reach, _, _, _ = evaluate_cycle(code, motion[t], reach, values[1], values[2], values[3])
        force[t] += values[0] * shape
        slope[t] += values[0] * by_z
        slope_of_reach[t] += values[0] * by_reach


@part(inline=True)
def _find_reach(z, n_harmonics, n_joints, j):  # type: ignore[no-untyped-def]
    """Find the extension of a joint where all harmonics are at their largest, which may be negative."""
    total = 0.0
    for k in range(n_harmonics):
        total += z[k * n_joints + j]
    return total


@part(inline=False)
def _transform_forces(law, sample, transform, z, force, slope, work):  # type: ignore[no-untyped-def]
    """Compute harmonics of forces, and their slopes by harmonics of the extensions, from times of a period."""
    first_rows, last_rows, codes, powers, values, _ = law
    cosines, weights, products = transform
    motion, force_then, slope_then, slope_of_reach = work
    n_harmonics, n_joints = force.shape
    for j in range(n_joints):
        _compute_motion_of_joint(z, n_joints, j, cosines, motion)
        for t in range(motion.size):
            force_then[t] = 0.0
            slope_then[t] = 0.0
            slope_of_reach[t] = 0.0
        top, is_cyclic = _find_reach(z, n_harmonics, n_joints, j), False
        for row in range(first_rows[j], last_rows[j]):
            if powers[row] == CYCLIC:
                is_cyclic = True
                _add_cycle(codes[row], values[sample, row], motion, abs(top), force_then, slope_then, slope_of_reach)
                continue
            amplitude, a, b = values[sample, row, 0], values[sample, row, 1], values[sample, row, 2]
            _add_term(codes[row], powers[row], amplitude, a, b, motion, force_then, slope_then)
        for k in range(n_harmonics):
            force[k, j] = _sum_weighted(weights, k, force_then)
            for other in range(n_harmonics):
                slope[j, k, other] = _sum_weighted(products, k * n_harmonics + other, slope_then)
            if is_cyclic:
                by_top = np.sign(top) * _sum_weighted(weights, k, slope_of_reach)
                for other in range(n_harmonics):
                    slope[j, k, other] += by_top


@part(inline=False)
def _compute_receptance(eigenvalue, products, square, at, once, twice):  # type: ignore[no-untyped-def]
    """Compute sums over modes of products / (l_i - h^2 l), and of products / (l_i - h^2 l)^2."""
    for c in range(once.size):
        once[c] = 0.0
        twice[c] = 0.0
    for i in range(eigenvalue.size):
        inverse = 1.0 / (eigenvalue[i] - square * at)
        squared = inverse * inverse
        for c in range(once.size):
            once[c] += products[i, c] * inverse
            twice[c] += products[i, c] * squared


@part(inline=False)
def _fill(system, harmonics, amplitude, y, force, slope, onces, twices, matrix):  # type: ignore[no-untyped-def]
    """Fill Newton's matrix with, in its last column, the equations' values; the unknowns are z_h and the eigenvalue.

    The sensor's equation replaces the coordinate of the target mode, q = (A + r F_1) / phi_m(a) with
    r = sum phi_i(a) psi_i / (l_i - l), so the equations are regular at its resonance.
    """
    own, own_joints, others, others_products, eigenvalue, products = system
    n_harmonics, n_joints = force.shape
    n = y.size
    at = y[n - 1]
    for row in range(n):
        for column in range(n):
            matrix[row, column] = 0.0
    for k in range(n_harmonics):
        square = float(harmonics[k] * harmonics[k])
        first = harmonics[k] == 1
        once, twice = onces[k], twices[k]
        if first:
            _compute_receptance(others, others_products, square, at, once, twice)
        else:
            _compute_receptance(
                eigenvalue, products, square, at, once[: n_joints * n_joints], twice[: n_joints * n_joints]
            )
        for j in range(n_joints):
            row = k * n_joints + j
            value = y[row]
            by_eigenvalue = 0.0
            for i in range(n_joints):
                value += once[j * n_joints + i] * force[k, i]
                by_eigenvalue += twice[j * n_joints + i] * force[k, i]
                for other in range(n_harmonics):
                    matrix[row, other * n_joints + i] = once[j * n_joints + i] * slope[i, k, other]
            matrix[row, row] += 1.0
            matrix[row, n - 1] = square * by_eigenvalue
            matrix[row, n] = value - own_joints[j] * amplitude / own[1] if first else value
        if first:
            seen, seen_slope, pushed = amplitude, 0.0, 0.0
            for i in range(n_joints):
                seen += once[n_joints * n_joints + i] * force[k, i]
                seen_slope += twice[n_joints * n_joints + i] * force[k, i]
                pushed += own_joints[i] * force[k, i]
                by_force = (own[0] / at - 1.0) * once[n_joints * n_joints + i] / own[1] + own_joints[i] / at
                for other in range(n_harmonics):
                    matrix[n - 1, other * n_joints + i] = by_force * slope[i, k, other]
            # Division by the eigenvalue makes all rows of similar size.
            matrix[n - 1, n] = (own[0] / at - 1.0) * seen / own[1] + pushed / at
            matrix[n - 1, n - 1] = (-seen / at + (own[0] / at - 1.0) * seen_slope) / own[1]


@part(inline=False)
def _compute_value_changes(system, harmonics, at, changed, onces, values):  # type: ignore[no-untyped-def]
    """Compute the derivatives of the equations' values for those of the forces."""
    own, own_joints, _, _, _, _ = system
    n_harmonics, n_joints = changed.shape
    for k in range(n_harmonics):
        for j in range(n_joints):
            total = 0.0
            for i in range(n_joints):
                total += onces[k, j * n_joints + i] * changed[k, i]
            values[k * n_joints + j] = total
        if harmonics[k] == 1:
            total = 0.0
            for i in range(n_joints):
                by_force = (own[0] / at - 1.0) * onces[k, n_joints * n_joints + i] / own[1] + own_joints[i] / at
                total += by_force * changed[k, i]
            values[values.size - 1] = total


@part(inline=False)
def _compute_force_changes(law, sample, transform, columns, z, changed, work):  # type: ignore[no-untyped-def]
    """Compute harmonics of the derivatives of forces by coefficients, whose numbers `columns` holds, -1 for none."""
    first_rows, last_rows, codes, powers, values, _ = law
    cosines, weights, _ = transform
    motion, by_value, _, _ = work
    changed[:] = 0.0
    n_harmonics, n_joints = changed.shape[1:]
    for j in range(n_joints):
        _compute_motion_of_joint(z, n_joints, j, cosines, motion)
        reach = abs(_find_reach(z, n_harmonics, n_joints, j))
        for row in range(first_rows[j], last_rows[j]):
            amplitude, a, b, c = (
                values[sample, row, 0],
                values[sample, row, 1],
                values[sample, row, 2],
                values[sample, row, 3],
            )
            for inner in range(columns.shape[1]):
                column = columns[row, inner]
                if column < 0:
                    continue
                for t in range(motion.size):
                    if powers[row] == CYCLIC:
                        shape, _, _, by_a, by_b, by_c = evaluate_cycle(codes[row], motion[t], reach, a, b, c)
                    else:
                        shape, _, _, by_a, by_b = evaluate(codes[row], motion[t], 0.0, a, b)
                        by_c = 0.0
                    by_inner = by_a if inner == 1 else by_b if inner == 2 else by_c
                    by_value[t] = shape if inner == 0 else amplitude * by_inner
                for k in range(n_harmonics):
                    changed[column, k, j] += _sum_weighted(weights, k, by_value)


@part(inline=False)
def _eliminate(matrix):  # type: ignore[no-untyped-def]
    """Solve in place, with pivots; the solutions are the columns after a square. False where that is singular."""
    n, n_columns = matrix.shape
    for step in range(n):
        pivot = step
        for row in range(step + 1, n):
            if abs(matrix[row, step]) > abs(matrix[pivot, step]):
                pivot = row
        if not abs(matrix[pivot, step]) > 0.0:
            return False
        if pivot != step:
            for column in range(step, n_columns):
                matrix[step, column], matrix[pivot, column] = matrix[pivot, column], matrix[step, column]
        inverse = 1.0 / matrix[step, step]
        for row in range(step + 1, n):
            factor = matrix[row, step] * inverse
            for column in range(step + 1, n_columns):
                matrix[row, column] -= factor * matrix[step, column]
    for solution in range(n, n_columns):
        for step in range(n - 1, -1, -1):
            for column in range(step + 1, n):
                matrix[step, solution] -= matrix[step, column] * matrix[column, solution]
            matrix[step, solution] /= matrix[step, step]
    return True


@part(inline=False)
def _solve_by_newton(system, harmonics, law, sample, transform, amplitude, fraction, y, rooms):  # type: ignore[no-untyped-def]
    """Move y to a solution for a fraction of the law, and leave its forces in `rooms`; False where none is near."""
    force, slope, once, twice, matrix, work, moved = rooms
    n = y.size
    predicted = y[n - 1]
    done = False
    for k in range(n - 1):
        moved[k] = 0.0
    for _ in range(_MOST_ITERATIONS):
        # The closed form needs no times of a period.
        if work[0].size == 0:
            _compute_power_forces(law, sample, y, force, slope)
        else:
            _transform_forces(law, sample, transform, y, force, slope, work)
        if fraction != 1.0:
            for j in range(force.shape[1]):
                for k in range(force.shape[0]):
                    force[k, j] *= fraction
                    for other in range(force.shape[0]):
                        slope[j, k, other] *= fraction
        if done:
            # Only the first harmonic counts, because an interaction may change the others abruptly.
            farthest, size = 0.0, 0.0
            for k in range(n - 1):
                if harmonics[k // force.shape[1]] == 1:
                    farthest = max(farthest, abs(moved[k]))
                    size = max(size, abs(y[k]))
            near = abs(y[n - 1] - predicted) <= _FARTHEST * abs(predicted)
            return near and farthest <= _FARTHEST_EXTENSION * size
        _fill(system, harmonics, amplitude, y, force, slope, once, twice, matrix)
        if not _eliminate(matrix):
            return False
        step, size = 0.0, 0.0
        for k in range(n - 1):
            y[k] -= matrix[k, n]
            moved[k] += matrix[k, n]
            step = max(step, abs(matrix[k, n]))
            size = max(size, abs(y[k]))
        y[n - 1] -= matrix[n - 1, n]
        # In this form the comparison fails for nan.
        if not abs(y[n - 1] - predicted) < abs(predicted):
            return False
        done = step <= _SMALL_STEP * size and abs(matrix[n - 1, n]) <= _SMALL_STEP * y[n - 1]
    return False


@part(inline=False)
def _predict(positions, ratios, n_known, position, amplitude, y):  # type: ignore[no-untyped-def]
    """Extrapolate z / A and the eigenvalue by the polynomial through the last (at most three) points."""
    for k in range(y.size):
        y[k] = 0.0
    for known in range(n_known):
        weight = 1.0
        for other in range(n_known):
            if other != known:
                weight *= (position - positions[other]) / (positions[known] - positions[other])
        for k in range(y.size):
            y[k] += weight * ratios[known, k]
    for k in range(y.size - 1):
        y[k] *= amplitude


@part(inline=False)
def _remember(positions, ratios, n_known, position, amplitude, y):  # type: ignore[no-untyped-def]
    """Put a point in front of the others, and return their number."""
    for known in range(min(n_known, 2), 0, -1):
        positions[known] = positions[known - 1]
        for k in range(y.size):
            ratios[known, k] = ratios[known - 1, k]
    positions[0] = position
    for k in range(y.size - 1):
        ratios[0, k] = y[k] / amplitude
    ratios[0, y.size - 1] = y[y.size - 1]
    return min(n_known + 1, 3)


@part(inline=False)
def _march(system, harmonics, law, sample, transform, known, n_known, goal, held, y, rooms):  # type: ignore[no-untyped-def]
    """Go from the last known point to a goal, in smaller steps where needed, and return the number of known points.

    The goal is an amplitude or, where an amplitude is held (not 0), a fraction of the law. Where it is not reached, 0
    is returned and the known points stay as they were.
    """
    positions, ratios, trial_positions, trial_ratios = known
    for point in range(n_known):
        trial_positions[point] = positions[point]
        for k in range(y.size):
            trial_ratios[point, k] = ratios[point, k]
    last, n_trial, halvings = positions[0], n_known, 0
    step = goal - last
    while last < goal:
        # The last step ends on the goal itself.
        target = goal if last + step >= goal * (1.0 - 1e-12) else last + step
        # An extrapolation from close points does not reach far.
        near = target - last <= last - trial_positions[n_trial - 1]
        amplitude, fraction = (target, 1.0) if held == 0.0 else (held, target)
        _predict(trial_positions, trial_ratios, n_trial if near else 1, target, amplitude, y)
        if _solve_by_newton(system, harmonics, law, sample, transform, amplitude, fraction, y, rooms):
            n_trial = _remember(trial_positions, trial_ratios, n_trial, target, amplitude, y)
            last = target
        else:
            step *= 0.5
            halvings += 1
            if halvings > _MOST_HALVINGS:
                return 0
    for point in range(n_trial):
        positions[point] = trial_positions[point]
        for k in range(y.size):
            ratios[point, k] = trial_ratios[point, k]
    return n_trial


@part(inline=False)
def _list_shapes(system, sensors, amplitude, y, force, first, seen):  # type: ignore[no-untyped-def]
    """Compute the first harmonic at all sensors."""
    own, _, others, _, _, _ = system
    own_sensors, others_sensors, others_joints, at_sensor = sensors
    n_joints = force.shape[1]
    q = amplitude
    for s in range(seen.size):
        seen[s] = 0.0
    for i in range(others.size):
        pushed = 0.0
        for j in range(n_joints):
            pushed += others_joints[i, j] * force[first, j]
        pushed /= others[i] - y[y.size - 1]
        q += at_sensor[i] * pushed
        for s in range(seen.size):
            seen[s] -= others_sensors[i, s] * pushed
    q /= own[1]
    for s in range(seen.size):
        seen[s] += own_sensors[s] * q


@kernel()
def backbones(system, sensors, harmonics, law, transform, amplitudes):  # type: ignore[no-untyped-def]
    """Return eigenvalue, shapes and extensions (harmonic by harmonic) of all samples at all growing amplitudes."""
    own, own_joints, _, others_products, _, _ = system
    n_samples, n_points, n_joints = law[4].shape[0], amplitudes.size, own_joints.size
    n_harmonics, n_times = transform[0].shape
    n = n_harmonics * n_joints + 1
    eigenvalue = np.full((n_samples, n_points), np.nan)
    shapes = np.full((n_samples, n_points, sensors[0].size), np.nan)
    extension = np.full((n_samples, n_points, n - 1), np.nan)
    force, slope = np.empty((n_harmonics, n_joints)), np.empty((n_joints, n_harmonics, n_harmonics))
    once, twice = np.empty((n_harmonics, others_products.shape[1])), np.empty((n_harmonics, others_products.shape[1]))
    work = (np.empty(n_times), np.empty(n_times), np.empty(n_times), np.empty(n_times))
    rooms = (force, slope, once, twice, np.empty((n, n + 1)), work, np.empty(n))
    y, seen = np.empty(n), np.empty(sensors[0].size)
    positions, ratios = np.empty(3), np.empty((3, n))
    known = (positions, ratios, np.empty(3), np.empty((3, n)))
    first = 0
    for k in range(n_harmonics):
        first = k if harmonics[k] == 1 else first
    n_known = 1
    for sample in range(n_samples):
        begun = False
        for point in range(n_points):
            amplitude, reached = amplitudes[point], 0
            # The second method, by fractions of the law, is for laws that are stiff at rest, whose curve does not begin
            # in the linear mode.
            for method in range(1 if begun else 2):
                if not begun:
                    n_known = 1
                    positions[0] = 0.0
                    for k in range(n - 1):
                        ratios[0, k] = 0.0
                    for j in range(n_joints):
                        ratios[0, first * n_joints + j] = own_joints[j] / own[1]
                    ratios[0, n - 1] = own[0]
                goal, held = (amplitude, 0.0) if method == 0 else (1.0, amplitude)
                reached = _march(system, harmonics, law, sample, transform, known, n_known, goal, held, y, rooms)
                if reached > 0:
                    n_known = reached if method == 0 else 1
                    positions[0] = amplitude
                    begun = True
                    break
            if reached == 0:
                continue
            _list_shapes(system, sensors, amplitude, y, force, first, seen)
            eigenvalue[sample, point] = y[n - 1]
            for s in range(seen.size):
                shapes[sample, point, s] = seen[s]
            for k in range(n - 1):
                extension[sample, point, k] = y[k]
    return eigenvalue, shapes, extension


@part(inline=False)
def _compute_modal_motion(modes, harmonics, amplitude, y, force, motion):  # type: ignore[no-untyped-def]
    """Compute the harmonics of all modal coordinates; that of the target mode follows from the sensor."""
    eigenvalue, at_joints, at_sensors, target, sensor = modes
    n_joints = force.shape[1]
    for k in range(harmonics.size):
        square = float(harmonics[k] * harmonics[k])
        left = amplitude
        for i in range(eigenvalue.size):
            if i == target and harmonics[k] == 1:
                continue
            pushed = 0.0
            for j in range(n_joints):
                pushed += at_joints[i, j] * force[k, j]
            motion[k, i] = -pushed / (eigenvalue[i] - square * y[y.size - 1])
            left -= at_sensors[i, sensor] * motion[k, i]
        if harmonics[k] == 1:
            motion[k, target] = left / at_sensors[target, sensor]


@part(inline=False)
def _compute_pushed_values(modes, harmonics, y, pushes, values):  # type: ignore[no-untyped-def]
    """Compute the derivatives of the equations' values for those of the forces on the modal coordinates."""
    eigenvalue, at_joints, at_sensors, target, sensor = modes
    n_joints, at = at_joints.shape[1], y[y.size - 1]
    values[:] = 0.0
    for k in range(harmonics.size):
        square = float(harmonics[k] * harmonics[k])
        seen = 0.0
        for i in range(eigenvalue.size):
            if i == target and harmonics[k] == 1:
                continue
            moved = pushes[k, i] / (eigenvalue[i] - square * at)
            seen += at_sensors[i, sensor] * moved
            for j in range(n_joints):
                values[k * n_joints + j] += at_joints[i, j] * moved
        if harmonics[k] == 1:
            own = at_sensors[target, sensor]
            for j in range(n_joints):
                values[k * n_joints + j] -= seen / own * at_joints[target, j]
            values[y.size - 1] = (eigenvalue[target] / at - 1.0) * seen / own + pushes[k, target] / at


@part(inline=False)
def _list_shape_slopes(modes, y, motion, pushes, by_force, by_eigenvalue, seen):  # type: ignore[no-untyped-def]
    """Compute the derivatives of the first harmonic at all sensors, for those of forces and eigenvalue.

    `motion` is that of the modal coordinates, `by_force` are the derivatives of the joints' forces, and `pushes` those
    of forces on the modal coordinates.
    """
    eigenvalue, at_joints, at_sensors, target, sensor = modes
    left = 0.0
    for s in range(seen.size):
        seen[s] = 0.0
    for i in range(eigenvalue.size):
        if i == target:
            continue
        away = eigenvalue[i] - y[y.size - 1]
        changed = pushes[i] - motion[i] * by_eigenvalue
        for j in range(by_force.size):
            changed += at_joints[i, j] * by_force[j]
        changed /= away
        left += at_sensors[i, sensor] * changed
        for s in range(seen.size):
            seen[s] -= at_sensors[i, s] * changed
    for s in range(seen.size):
        seen[s] += at_sensors[target, s] / at_sensors[target, sensor] * left


@kernel()
def backbone_slopes(  # type: ignore[no-untyped-def]
    system, modes, couplings, harmonics, law, transform, columns, amplitudes, eigenvalue, extension
):
    """Return the derivatives of eigenvalue and shapes of solved points by implicit differentiation.

    They are those by the coefficients that `columns` numbers, then by each linear parameter, whose change of the
    stiffness between modal coordinates `couplings` holds: it acts like forces on these coordinates.
    """
    n_samples, n_points = eigenvalue.shape
    n_joints, n_harmonics, n_times = system[1].size, transform[0].shape[0], transform[0].shape[1]
    n_modes, n_sensors = modes[2].shape
    n, n_columns = n_harmonics * n_joints + 1, columns.max() + 1
    n_all = n_columns + couplings.shape[0]
    of_eigenvalue = np.full((n_samples, n_points, n_all), np.nan)
    of_shapes = np.full((n_samples, n_points, n_sensors, n_all), np.nan)
    force, slope = np.empty((n_harmonics, n_joints)), np.empty((n_joints, n_harmonics, n_harmonics))
    first = 0
    for k in range(n_harmonics):
        first = k if harmonics[k] == 1 else first
    changed, pushes = np.empty((n_columns, n_harmonics, n_joints)), np.zeros((n_all, n_harmonics, n_modes))
    n_products = system[3].shape[1]
    once, twice = np.empty((n_harmonics, n_products)), np.empty((n_harmonics, n_products))
    work = (np.empty(n_times), np.empty(n_times), np.empty(n_times), np.empty(n_times))
    matrix, whole, values = np.empty((n, n + 1)), np.empty((n, n + n_all)), np.empty(n)
    y, seen, by_force, motion = np.empty(n), np.empty(n_sensors), np.empty(n_joints), np.empty((n_harmonics, n_modes))
    for sample in range(n_samples):
        for point in range(n_points):
            if not eigenvalue[sample, point] > 0.0:
                continue
            amplitude = amplitudes[point]
            for k in range(n - 1):
                y[k] = extension[sample, point, k]
            y[n - 1] = eigenvalue[sample, point]
            _transform_forces(law, sample, transform, y, force, slope, work)
            _compute_force_changes(law, sample, transform, columns, y, changed, work)
            _fill(system, harmonics, amplitude, y, force, slope, once, twice, matrix)
            for row in range(n):
                for column in range(n):
                    whole[row, column] = matrix[row, column]
            _compute_modal_motion(modes, harmonics, amplitude, y, force, motion)
            for column in range(n_all):
                if column < n_columns:
                    _compute_value_changes(system, harmonics, y[n - 1], changed[column], once, values)
                else:
                    coupling = couplings[column - n_columns]
                    for k in range(n_harmonics):
                        for i in range(n_modes):
                            pushes[column, k, i] = _sum_weighted(coupling, i, motion[k])
                    _compute_pushed_values(modes, harmonics, y, pushes[column], values)
                for row in range(n):
                    whole[row, n + column] = values[row]
            if not _eliminate(whole):
                continue
            for column in range(n_all):
                by_eigenvalue = -whole[n - 1, n + column]
                for j in range(n_joints):
                    by_force[j] = changed[column, first, j] if column < n_columns else 0.0
                    for k in range(n_harmonics):
                        by_force[j] -= slope[j, first, k] * whole[k * n_joints + j, n + column]
                of_eigenvalue[sample, point, column] = by_eigenvalue
                _list_shape_slopes(modes, y, motion[first], pushes[column, first], by_force, by_eigenvalue, seen)
                for s in range(n_sensors):
                    of_shapes[sample, point, s, column] = seen[s]
    return of_eigenvalue, of_shapes
