"""Compiled rounds of the drainage solver: routing, drainage areas, and heights.

Nodes are flat indices of rasters with a margin of one node outside of the domain, where heights are infinite.
Loops stand instead of array expressions, which take numba seconds to compile.
"""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators, disable-error-code=assignment

from heapq import heappop, heappush
from math import floor, sqrt

import numpy as np

from sketchterrain.landforms.hashed_noise import compiled

LEAST_SLOPE = 2.0**-13  # of a node to its receiver, where nothing is uplifted
SLOPE_SWEEPS = 2  # each there and back
LEAST_RISE = 1e-6  # m
BESIDE = 2  # nodes to each side of a course that are not to lie lower
LAYERS = 5.0  # thickness of a pair of hard and soft layers of rock, spacings of level 0
LAYER_EDGE = 2.0  # steepness of the change between them
CLIFF, BENCH = 1.7, 0.35  # slopes of full strata over those of even rock, in hard layers and in soft ones
RELAXATION = 0.5  # share of the step to the built heights that every round but the last takes

OUTSIDE, INNER, OUTLET, OPEN_END = 0, 1, 2, 3  # odd: drained; an open end is the last node of a course
_DIAGONAL = sqrt(0.5)


@compiled
def new_state(size):
    """Return the state of nodes before a level is packed.

    Heights, drainage areas, receivers, the order of flow, numbers of donors, the rise of each node over its
    receiver, and heights before the last routing.
    """
    height, area, receiver = np.full(size, np.inf), np.zeros(size), np.full(size, -1, np.int32)
    return (
        height,
        area,
        receiver,
        np.empty(size, np.int32),
        np.zeros(size, np.int8),
        np.zeros(size),
        np.empty(size),
    )


@compiled
def run(topology, fields, state, geometry, rounds):
    """Route and integrate some times; every round but the last goes a part of the way."""
    height, previous = state[0], state[-1]
    for number in range(rounds):
        count = route(topology, fields, state, geometry)
        integrate(topology, fields, state, geometry, count)
        limit_slopes(topology, fields, state, geometry)
        if number < rounds - 1:
            relax(topology[0], height, previous)
    settle(topology, fields, state, geometry)


@compiled
def settle(topology, fields, state, geometry):
    """Build the heights that belong to the receivers as they are after the last round."""
    integrate(topology, fields, state, geometry, accumulate(topology, fields, state))


@compiled
def route(topology, fields, state, geometry):
    """Find receivers and drainage areas; return the number of nodes in the order of flow."""
    kinds, forced = topology
    height, area, receiver, order, donors, _, previous = state
    width = geometry[0]
    for at in range(height.size):
        previous[at] = height[at]
    _find_lowest(height.reshape(-1, width), receiver.reshape(-1, width))
    roots = _apply_courses(kinds, forced, receiver, donors, order)
    if roots:
        _connect(order[:roots].copy(), height, kinds, forced, width, receiver)
        _count_donors(receiver, donors)
    return _accumulate(kinds, fields[2], receiver, donors, area, order)


@compiled
def accumulate(topology, fields, state):
    """Sum drainage areas along given receivers; return the number of nodes in the order of flow."""
    _, area, receiver, order, donors, _, _ = state
    _count_donors(receiver, donors)
    return _accumulate(topology[0], fields[2], receiver, donors, area, order)


@compiled
def accumulate_inside(weight, rain, area, state, count):
    """Turn weights of nodes, 0 … 1, into the shares that they have of drainage areas (in place)."""
    receiver, order = state[2], state[3]
    for at in range(weight.size):
        weight[at] *= rain[at]
    for k in range(count):
        at = order[k]
        if receiver[at] >= 0:
            weight[receiver[at]] += weight[at]
        weight[at] /= area[at]


@compiled
def integrate(topology, fields, state, geometry, count):
    """Build heights up from the outlets, against the order of flow.

    The slope is that of the drainage area at the middle of a node, so that levels agree.
    """
    _, forced = topology
    uplift, repose, rain, least, strata = fields
    height, area, receiver, order, _, rise, _ = state
    width, spacing, scale = geometry
    for at in range(height.size):
        middle = area[at] - 0.5 * rain[at]
        quarter = sqrt(sqrt(max(middle * scale, 1e-9)))
        steep = max(uplift[at] / (quarter * sqrt(quarter)), LEAST_SLOPE)
        most = max(repose[at], LEAST_SLOPE)
        rise[at] = (_smooth_minimum(steep, most) if forced[at] < 0 else min(steep, most)) * spacing
    diagonal = sqrt(2.0)
    for k in range(count - 1, -1, -1):
        at = order[k]
        to = receiver[at]
        if to >= 0:
            step = abs(at - to)
            up = rise[at] if step == 1 or step == width else diagonal * rise[at]
            if strata[at] > 0.0:
                up *= _resistance((height[to] + 0.5 * up) * sqrt(scale) / LAYERS, strata[at])
            height[at] = max(height[to] + up, least[at])


@compiled
def _smooth_minimum(a, b):
    """Return (a⁻⁴ + b⁻⁴)^(−1/4) of two positive numbers."""
    share = a * a / (b * b) if a < b else b * b / (a * a)
    return min(a, b) / sqrt(sqrt(1.0 + share * share))


@compiled
def _resistance(z, strata):
    """Return the slope over that of even rock at a height, in pairs of layers."""
    cliff, bench = 1.0 + strata * (CLIFF - 1.0), 1.0 + strata * (BENCH - 1.0)
    hard = min(max(0.5 + LAYER_EDGE * (abs(2.0 * (z - floor(z)) - 1.0) - 0.5), 0.0), 1.0)
    return bench + (cliff - bench) * hard


@compiled
def limit_slopes(topology, fields, state, geometry):
    """Lower nodes that stand above any neighbour by more than repose allows, and let them drain there.

    Courses stay. Divides between valleys of unequal depth move as far as the slope reaches, not by one node a
    round.
    """
    kinds, forced = topology
    height, receiver = state[0], state[2]
    repose = fields[1] * (1.0 + (CLIFF - 1.0) * fields[4])
    width, spacing, _ = geometry
    for _ in range(SLOPE_SWEEPS):
        _limit_sweep(kinds, forced, height, receiver, repose, spacing, width, 1)
        _limit_sweep(kinds, forced, height, receiver, repose, spacing, width, -1)
    sink_courses(topology, height, width)


@compiled
def sink_courses(topology, height, width):
    """Lower courses to the lowest ground beside them, so that it drains to them; none leads uphill."""
    kinds, forced = topology
    for at in range(height.size):
        if kinds[at] != INNER or forced[at] < 0:
            continue
        z = height[at]
        for row in range(-BESIDE, BESIDE + 1):
            for other in range(at + row * width - BESIDE, at + row * width + BESIDE + 1):
                if 0 <= other < height.size and kinds[other] == INNER and forced[other] < 0:
                    z = min(z, height[other])
        height[at] = z
        while forced[at] >= 0 and kinds[forced[at]] & 1 and height[forced[at]] >= height[at]:
            height[forced[at]] = height[at] - LEAST_RISE
            at = forced[at]


@compiled
def _limit_sweep(kinds, forced, height, receiver, repose, spacing, width, direction):
    """Limit heights by the four neighbours that precede a node in reading order, or in its reverse."""
    diagonal = sqrt(2.0)
    for k in range(height.size):
        at = k if direction > 0 else height.size - 1 - k
        if kinds[at] != INNER or forced[at] >= 0:
            continue
        step = max(repose[at], LEAST_SLOPE) * spacing
        z, to = height[at - direction] + step, at - direction
        other = at - direction * width
        if height[other] + step < z:
            z, to = height[other] + step, other
        for other in (at - direction * (width + 1), at - direction * (width - 1)):
            if height[other] + diagonal * step < z:
                z, to = height[other] + diagonal * step, other
        if z < height[at]:
            height[at], receiver[at] = z, to


@compiled
def carve(kinds, floor, state, geometry, count):
    """Lower nodes that stand above those which drain to them, down the flow, but not below a floor."""
    height, receiver, order = state[0], state[2], state[3]
    for k in range(count):
        at = order[k]
        to = receiver[at]
        if to >= 0 and kinds[to] & 1:
            height[to] = min(height[to], max(height[at] - LEAST_SLOPE * geometry[1], floor[to]))


@compiled
def relax(kinds, height, previous):
    """Move heights back towards those before the last routing: fewer channels change their course."""
    for at in range(height.size):
        if kinds[at] & 1:
            height[at] = previous[at] + RELAXATION * (height[at] - previous[at])


@compiled
def _find_lowest(height, receiver):
    """Find each node's neighbour of steepest descent, −1 if there is none."""
    rows, width = height.shape
    for i in range(1, rows - 1):
        here, south, north, to = height[i], height[i - 1], height[i + 1], receiver[i]
        for j in range(1, width - 1):
            z, step = here[j - 1], -1
            if here[j + 1] < z:
                z, step = here[j + 1], 1
            if south[j] < z:
                z, step = south[j], -width
            if north[j] < z:
                z, step = north[j], width
            corner, slant = south[j - 1], -width - 1
            if south[j + 1] < corner:
                corner, slant = south[j + 1], 1 - width
            if north[j - 1] < corner:
                corner, slant = north[j - 1], width - 1
            if north[j + 1] < corner:
                corner, slant = north[j + 1], width + 1
            fall, steep = here[j] - z, (here[j] - corner) * _DIAGONAL
            if steep > fall:
                fall, step = steep, slant
            to[j] = i * width + j + step if fall > 0.0 else -1


@compiled
def _apply_courses(kinds, forced, receiver, donors, roots):
    """Apply courses, count donors, and list drained nodes without receiver; return their number."""
    donors[:] = 0
    count = 0
    for at in range(kinds.size):
        if not kinds[at] & 1:
            receiver[at] = -1
            continue
        if forced[at] >= 0:
            receiver[at] = forced[at]
        to = receiver[at]
        if to >= 0:
            donors[to] += 1
        else:
            roots[count] = at
            count += 1
    return count


@compiled
def _count_donors(receiver, donors):
    donors[:] = 0
    for to in receiver:
        if to >= 0:
            donors[to] += 1


@compiled
def _connect(roots, height, kinds, forced, width, receiver):
    """Route the basins of pits through their lowest passes: the minimum spanning tree of basins, by Borůvka.

    A component of basins drains through its lowest pass, if that does not lead into it. Links are ordered by
    height and position. A part of the domain without any outlet keeps one of its pits.
    """
    steps = (-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1)
    drained = roots.size
    basin = np.full(height.size, drained, np.int32)
    nodes = np.empty(height.size, np.int32)
    open_ended = np.zeros(roots.size, np.bool_)
    count = 0
    for number in range(roots.size):
        first = count
        count = _upstream(roots[number], number, receiver, steps, basin, nodes, count)
        for at in nodes[first:count]:
            if kinds[at] == OPEN_END:
                open_ended[number] = True
        if open_ended[number]:  # paths in it must not be reversed, since courses may be part of them
            basin[nodes[first:count]] = drained
            count = first
    joined = np.arange(roots.size + 1).astype(np.int32)
    pass_height = np.empty(roots.size + 1)
    pass_from, pass_to = np.empty(roots.size + 1, np.int32), np.empty(roots.size + 1, np.int32)
    while count:
        pass_from[:] = -1
        kept = 0
        for k in range(count):
            at = nodes[k]
            label = _component(joined, basin[at])
            if label == drained:
                continue
            border = False
            for step in steps:
                other = at + step
                if basin[other] == basin[at] or kinds[other] == OUTSIDE:
                    continue
                if _component(joined, basin[other]) == label:
                    continue
                border = True
                z = max(height[at], height[other])
                if pass_from[label] >= 0:
                    if z > pass_height[label]:
                        continue
                    if z == pass_height[label]:
                        low = min(pass_from[label], pass_to[label])
                        if (min(at, other), max(at, other)) >= (low, max(pass_from[label], pass_to[label])):
                            continue
                pass_height[label], pass_from[label], pass_to[label] = z, at, other
            if border:
                nodes[kept] = at
                kept += 1
        count = kept
        for label in range(roots.size):
            if pass_from[label] < 0:
                continue
            to = _component(joined, basin[pass_to[label]])
            if to != label:
                _reroot(pass_from[label], pass_to[label], receiver)
                joined[label] = to
    for number in range(roots.size):
        if open_ended[number]:
            _release(roots[number], height, kinds, forced, steps, receiver)


@compiled
def _component(joined, label):
    """Return the component that a basin has been joined with."""
    while joined[label] != label:
        joined[label] = joined[joined[label]]
        label = joined[label]
    return label


@compiled
def _upstream(root, label, receiver, steps, basin, nodes, count):
    """Label what drains to a root, and append it to the nodes; return their number."""
    basin[root] = label
    nodes[count] = root
    seen, count = count, count + 1
    while seen < count:
        at = nodes[seen]
        seen += 1
        for step in steps:
            other = at + step
            if receiver[other] == at:
                basin[other] = label
                nodes[count] = other
                count += 1
    return count


@compiled
def _reroot(at, to, receiver):
    """Reverse the path from a node to its pit, and let the node drain elsewhere."""
    while at >= 0:
        following = receiver[at]
        receiver[at] = to
        to, at = at, following


@compiled
def _release(root, height, kinds, forced, steps, receiver):
    """Route a pit that a course leads to out of its basin, the least-cost way that crosses no course."""
    basin = np.full(height.size, -1, np.int32)
    nodes = np.empty(height.size, np.int32)
    _upstream(root, 0, receiver, steps, basin, nodes, 0)
    came = np.full(height.size, -1, np.int32)
    came[root] = root
    heap = [(height[root], np.int64(root))]
    while len(heap):
        level, at = heappop(heap)
        if basin[at] < 0:
            to = at
            at = came[at]
            while True:
                receiver[at] = to
                if at == root:
                    return
                to, at = at, came[at]
        for step in steps:
            other = at + step
            if kinds[other] == OUTSIDE or came[other] >= 0 or (basin[other] >= 0 and forced[other] >= 0):
                continue
            came[other] = at
            heappush(heap, (max(level, height[other]), np.int64(other)))


@compiled
def _accumulate(kinds, rain, receiver, donors, area, order):
    """Sum drainage areas; write nodes in an order in which donors come before their receivers."""
    for at in range(area.size):
        area[at] = rain[at]
    count = 0
    for start in range(kinds.size):
        if kinds[start] == OUTSIDE or donors[start] != 0:
            continue
        at = start
        while True:
            donors[at] = -1
            order[count] = at
            count += 1
            to = receiver[at]
            if to < 0:
                break
            area[to] += area[at]
            donors[to] -= 1
            if donors[to] != 0:
                break
            at = to
    return count
