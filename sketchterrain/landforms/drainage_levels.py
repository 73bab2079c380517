"""Levels of rasters that are drained: reduction by two, interpolation to the finer level, and margins."""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators, disable-error-code=assignment

import numpy as np

from sketchterrain.landforms.drainage_rounds import INNER, LEAST_RISE, OPEN_END, OUTLET
from sketchterrain.landforms.hashed_noise import compiled

WARP = 0.5  # coarse nodes by which heights are moved when they start a finer level: channels leave D8's axes
COARSE_REPOSE = 0.92  # share of repose that a level has of that of the finer one: channels there lie closer

RAMP, LEAST_RAMP, RAMP_SWEEPS = 0.8, 0.7, 2


@compiled
def _hash(row, column, level):
    """Return 64 hashed bits of a node (SplitMix64's finalizer)."""
    h = np.uint64(row) * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(29))) + np.uint64(column) * np.uint64(0xD1B54A32D192ED03)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9) + np.uint64(level)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return h ^ (h >> np.uint64(31))


@compiled
def pack(fields, topology, coarse, packed_fields, packed_topology):
    """Copy a level into rasters with a margin.

    Heights start from the coarser level or from noise; or from the heights `onto` which the coarser level's
    differences are added.
    """
    uplift, repose, rain, base = fields
    domain, course, origin, level = topology
    start, start_origin, spacing, onto = coarse
    uplifts, reposes, rains, heights = packed_fields
    kinds, forced = packed_topology
    rows, columns = base.shape
    width = columns + 2
    lowest = np.inf
    for i, j in np.ndindex(rows, columns):
        if domain[i, j] and base[i, j] < lowest:
            lowest = base[i, j]
    if lowest == np.inf:
        lowest = 0.0
    gentler = 1.0
    for _ in range(level):
        gentler *= COARSE_REPOSE
    shifts = _shifts(start.shape, start_origin, level)
    courses = False
    for i, j in np.ndindex(rows, columns):
        if not domain[i, j]:
            continue
        at = (i + 1) * width + j + 1
        uplifts[at], reposes[at], rains[at] = uplift[i, j], gentler * repose[i, j], rain[i, j]
        if base[i, j] == base[i, j]:
            kinds[at] = OUTLET
            heights[at] = base[i, j]
            continue
        kinds[at] = INNER
        to = course[i, j]
        if to >= 0 and domain[to // columns, to % columns]:
            if max(abs(to // columns - i), abs(to % columns - j)) != 1:
                raise ValueError("a course must lead to one of a node's eight neighbours")
            forced[at] = (to // columns + 1) * width + to % columns + 1
            courses = True
        z = np.nan
        if start.size:
            z = _upsampled(
                start, shifts, i + origin[0] - 2 * start_origin[0], j + origin[1] - 2 * start_origin[1]
            )
        if onto.size and onto[i, j] == onto[i, j]:
            heights[at] = onto[i, j] + (z if z == z else 0.0)
        elif z == z:
            heights[at] = z
        else:
            noise = np.float64(_hash(i + origin[0], j + origin[1], level) >> np.uint64(11)) * 2.0**-53
            heights[at] = lowest + (0.01 * spacing) * noise
    if courses:
        _carve_courses(kinds, forced, heights)


@compiled
def ramps(base, repose, domain, spacing):
    """Return heights from which the ground falls away from outlets at a share of repose."""
    rows, columns = base.shape
    least = base.copy()
    for i, j in np.ndindex(rows, columns):
        if base[i, j] != base[i, j]:
            least[i, j] = -np.inf
    for sweep in range(2 * RAMP_SWEEPS):
        back = sweep % 2
        for p in range(rows):
            i = rows - 1 - p if back else p
            for q in range(columns):
                j = columns - 1 - q if back else q
                if not domain[i, j] or base[i, j] == base[i, j]:
                    continue
                fall = max(RAMP * repose[i, j], LEAST_RAMP) * spacing
                for a in range(max(i - 1, 0), min(i + 2, rows)):
                    for b in range(max(j - 1, 0), min(j + 2, columns)):
                        slant = 2.0**0.5 if a != i and b != j else 1.0
                        if domain[a, b]:
                            least[i, j] = max(least[i, j], least[a, b] - slant * fall)
    return least


@compiled
def _shifts(shape, origin, level):
    """Return hashed vectors, in coarse nodes, at the coarse nodes and one more on each side."""
    shifts = np.empty((shape[0] + 2, shape[1] + 2, 2))
    scale = 2.0 * WARP * 2.0**-32
    for i, j in np.ndindex(shape[0] + 2, shape[1] + 2):
        bits = _hash(i - 1 + origin[0], j - 1 + origin[1], level)
        shifts[i, j, 0] = scale * np.float64(bits >> np.uint64(32)) - WARP
        shifts[i, j, 1] = scale * np.float64(bits & np.uint64(0xFFFFFFFF)) - WARP
    return shifts


@compiled
def _upsampled(coarse, shifts, row, column):
    """Interpolate coarse heights near a fine node, at a place moved by the vectors around it.

    Heights that are missing leave their weight to the others; NaN if all are.
    """
    i, j = row >> 1, column >> 1
    a, b = i + (row & 1), j + (column & 1)
    if i < -1 or j < -1 or a > coarse.shape[0] or b > coarse.shape[1]:
        return np.nan
    y = (
        shifts[i + 1, j + 1, 0]
        + shifts[a + 1, b + 1, 0]
        + (shifts[i + 1, b + 1, 0] + shifts[a + 1, j + 1, 0])
    )
    x = (
        shifts[i + 1, j + 1, 1]
        + shifts[a + 1, b + 1, 1]
        + (shifts[i + 1, b + 1, 1] + shifts[a + 1, j + 1, 1])
    )
    y, x = 0.5 * row + 0.25 * y, 0.5 * column + 0.25 * x
    i, j = int(np.floor(y)), int(np.floor(x))
    y, x = y - i, x - j
    if 0 <= i < coarse.shape[0] - 1 and 0 <= j < coarse.shape[1] - 1:
        south = coarse[i, j] + x * (coarse[i, j + 1] - coarse[i, j])
        north = coarse[i + 1, j] + x * (coarse[i + 1, j + 1] - coarse[i + 1, j])
        z = south + y * (north - south)
        if z == z:
            return z
    total, weights = 0.0, 0.0
    for a, b in np.ndindex(2, 2):
        p, q = i + a, j + b
        if 0 <= p < coarse.shape[0] and 0 <= q < coarse.shape[1] and coarse[p, q] == coarse[p, q]:
            weight = (y if a else 1.0 - y) * (x if b else 1.0 - x)
            total += weight * coarse[p, q]
            weights += weight
    return total / weights if weights > 0.0 else np.nan


@compiled
def _carve_courses(kinds, forced, heights):
    """Lower nodes below the course that flows into them: courses with an open end must not lead uphill."""
    heads = np.zeros(forced.size, np.bool_)
    for at in range(forced.size):
        if forced[at] >= 0:
            heads[at] = True
    for at in range(forced.size):
        if forced[at] >= 0:
            heads[forced[at]] = False
    for head in range(forced.size):
        if not heads[head]:
            continue
        at = head
        for _ in range(forced.size):
            to = forced[at]
            if to < 0 or kinds[to] == OUTLET:
                break
            below = heights[at] - LEAST_RISE
            if heights[to] > below:
                heights[to] = below
            at = to
            if forced[to] < 0:
                kinds[to] = OPEN_END


@compiled
def coarsened(uplift, repose, rain, base, domain, course, start, shape):
    """Reduce the arrays of a level by two, from the first node of an even global index on."""
    rows, columns = shape
    width = base.shape[1]
    uplifts, reposes, rains = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    bases, domains = np.full(shape, np.nan), np.zeros(shape, np.bool_)
    for i, j in np.ndindex(rows, columns):
        p, q = 2 * i + start[0], 2 * j + start[1]
        if not domain[p, q]:
            continue
        domains[i, j] = True
        count, lowest = 0.0, np.inf
        for a in range(max(p - 1, 0), min(p + 2, base.shape[0])):
            for b in range(max(q - 1, 0), min(q + 2, width)):
                if not domain[a, b]:
                    continue
                count += 1.0
                uplifts[i, j] += uplift[a, b]
                reposes[i, j] += repose[a, b]
                rains[i, j] += rain[a, b]
                if base[a, b] < lowest:
                    lowest = base[a, b]
        uplifts[i, j] /= count
        reposes[i, j] /= count
        rains[i, j] *= 4.0 / count
        if base[p, q] == base[p, q]:
            bases[i, j] = base[p, q]
        elif lowest < np.inf:
            bases[i, j] = lowest
    return uplifts, reposes, rains, bases, domains, _coarsened_courses(course, domains, start, shape)


@compiled
def _coarsened_courses(course, domains, start, shape):
    """Walk fine courses over coarse nodes: each drains to what the last fine node in it leads to."""
    rows, columns = shape
    width = course.shape[1]
    flat = course.ravel()
    left = _steps_to_end(flat)
    last = np.full(rows * columns, -1, np.int64)
    for at in range(flat.size):
        to = _coarse_node(at, width, start, shape)
        if left[at] >= 0 and to >= 0 and (last[to] < 0 or left[at] < left[last[to]]):
            last[to] = at
    result = np.full(shape, -1, np.int32)
    for at in range(rows * columns):
        if last[at] < 0 or flat[last[at]] < 0 or not domains[at // columns, at % columns]:
            continue
        to = _coarse_node(flat[last[at]], width, start, shape)
        if to >= 0 and domains[to // columns, to % columns]:
            result[at // columns, at % columns] = to
    return result


@compiled
def _coarse_node(at, width, start, shape):
    """Return the coarse node nearest to a fine one (halves are rounded up), −1 if the raster has none."""
    i, j = (at // width - start[0] + 1) // 2, (at % width - start[1] + 1) // 2
    return i * shape[1] + j if 0 <= i < shape[0] and 0 <= j < shape[1] else -1


@compiled
def _steps_to_end(course):
    """Return the steps from each node of a course to its end, −1 elsewhere."""
    left = np.full(course.size, -1, np.int64)
    path = np.empty(course.size, np.int64)
    for head in range(course.size):
        if course[head] < 0 or left[head] >= 0:
            continue
        at, count = head, 0
        while course[at] >= 0 and left[at] < 0:
            path[count] = at
            count += 1
            if count == course.size:
                raise ValueError("a course runs in a circle")
            at = course[at]
        steps = max(left[at], 0)
        left[at] = steps
        for k in range(count - 1, -1, -1):
            steps += 1
            left[path[k]] = steps
    return left
