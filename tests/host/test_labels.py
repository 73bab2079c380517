"""The choice of labels against a plain one."""

import numpy as np

from sketchterrain.host.library import host_function


def chosen_plainly(order, boxes, labels, state, most, margin, repeat):
    """Return what is chosen, and how near it is to what was placed before."""
    placed, chosen = [], np.zeros(len(boxes), np.bool_)
    for i in order:
        if state[i] != 1 and chosen.sum() == most:
            continue
        before = np.array(placed, np.int64)
        gaps = np.maximum(boxes[i, :2] - boxes[before, 2:], boxes[before, :2] - boxes[i, 2:]).max(axis=1)
        middles = boxes[:, :2] + boxes[:, 2:]
        between = 0.5 * np.abs(middles[before] - middles[i]).max(axis=1)
        reach = repeat if state[i] == 0 else 0.5 * repeat
        clash = (gaps < (margin if state[i] == 0 else 0.0)) | (
            (labels[before] == labels[i]) & (between < reach)
        )
        if state[i] == 1 or not clash.any():
            placed.append(i)
            chosen[i] = state[i] != 1
    return chosen


def test_labels_are_chosen_in_order_by_distance_and_repetition():
    random = np.random.default_rng(1)
    for n in (0, 1, 2, 7, 60, 200):
        for most in (0, 5, 1000):
            low = np.round(random.uniform(0.0, 500.0, (n, 2)) / 10.0) * 10.0  # some touch
            boxes = np.concatenate([low, low + random.integers(1, 9, (n, 2)) * 10.0], axis=1)
            labels, state = random.integers(0, n // 4 + 1, n), random.integers(0, 3, n).astype(np.int8)
            order = random.permutation(n)[: n - n // 5]
            given, chosen = (order, boxes, labels, state, most, 10.0, 120.0), np.ones(n, np.bool_)
            host_function("choose_labels")(*given, chosen, np.zeros(len(order), np.int64))
            assert np.array_equal(chosen, chosen_plainly(*given)), (n, most)
