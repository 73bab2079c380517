"""Distance of a triangle mesh from the grid that it was made of, at each of the grid's vertices."""

from numba import njit


@njit(cache=True, nogil=True)
def largest_distance(triangles, columns, rows, corners, height, missed):  # type: ignore[no-untyped-def]
    """Return the largest vertical distance of a mesh from heights (rows, columns).

    `corners` are the heights of its vertices. Grid vertices in a triangle, its edges included, are set to
    False in `missed`: rows are cut in integers, so that none on an edge is left out.
    """
    largest = 0.0
    for n in range(len(triangles)):
        a, b, c = triangles[n, 0], triangles[n, 1], triangles[n, 2]
        x = (int(columns[a]), int(columns[b]), int(columns[c]))
        y = (int(rows[a]), int(rows[b]), int(rows[c]))
        ux, uy, uz = x[1] - x[0], y[1] - y[0], corners[b] - corners[a]
        vx, vy, vz = x[2] - x[0], y[2] - y[0], corners[c] - corners[a]
        area = ux * vy - uy * vx
        if area == 0:  # a degenerate triangle: its corners are in its neighbours too
            continue
        slope_x, slope_y = (uz * vy - uy * vz) / area, (ux * vz - uz * vx) / area
        for row in range(min(y), max(y) + 1):
            first, last = max(x), min(x)
            for k in range(3):  # edges that cross the row
                start, end = k, (k + 1) % 3
                down, across, below = y[end] - y[start], x[end] - x[start], row - y[start]
                if down != 0 and min(y[start], y[end]) <= row <= max(y[start], y[end]):
                    first = min(first, x[start] - (-below * across // down))
                    last = max(last, x[start] + below * across // down)
            for column in range(first, last + 1):
                surface = corners[a] + slope_x * (column - x[0]) + slope_y * (row - y[0])
                largest = max(largest, abs(surface - height[row, column]))
                missed[row, column] = False
    return largest
