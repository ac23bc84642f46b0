"""The TUM benchmark's evaluation, told plainly: one pair at a time, nothing vectorised.

Written from the definition in the benchmark's documentation and scripts (``evaluate_rpe
--fixed_delta``, ``evaluate_ate``, ``associate``), as an oracle for edvo.evaluation. Trajectories
are dictionaries from time to 4x4 matrix.
"""

import math
from itertools import pairwise

import numpy as np


def read(path):
    poses = {}
    for line in path.read_text().splitlines():
        if line and not line.startswith("#"):
            time, *pose = (float(word) for word in line.replace(",", " ").split())
            poses[time] = matrix(pose)
    return poses


def matrix(pose):
    """4x4 matrix of tx ty tz qx qy qz qw."""
    x, y, z, w = np.array(pose[3:]) / np.linalg.norm(pose[3:])
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = pose[:3]
    return T


def closest(times, wanted):
    """Bisection that keeps the best it has met; a later one must be strictly nearer."""
    low, high, best = 0, len(times), 0
    while low < high:
        middle = (low + high) // 2
        if abs(times[middle] - wanted) < abs(times[best] - wanted):
            best = middle
        if times[middle] == wanted:
            return middle
        if times[middle] > wanted:
            high = middle
        else:
            low = middle + 1
    return best


def difference(a, b):
    return np.linalg.inv(a) @ b


def evaluate_rpe(truth, estimate, delta=1.0, unit="s", formula="script", count_self_pairs=False):
    """Rows of (time, translation, rotation). The script counts self pairs; see edvo's note."""
    true_times, times = sorted(truth), sorted(estimate)
    axis = times if unit == "s" else list(range(len(times)))
    limit = 2 * np.median([b - a for a, b in pairwise(true_times)])
    rows = []
    for i in range(len(times)):
        j = closest(axis, axis[i] + delta)
        if j == len(times) - 1 or (j == i and not count_self_pairs):
            continue
        true_i = true_times[closest(true_times, times[i])]
        true_j = true_times[closest(true_times, times[j])]
        if abs(true_i - times[i]) > limit or abs(true_j - times[j]) > limit:
            continue
        P_i, P_j, Q_i, Q_j = estimate[times[i]], estimate[times[j]], truth[true_i], truth[true_j]
        if formula == "script":
            error = difference(difference(P_j, P_i), difference(Q_j, Q_i))
        else:  # Sturm et al. 2012, Eq. 1
            error = difference(difference(Q_i, Q_j), difference(P_i, P_j))
        cosine = min(1, max(-1, (np.trace(error[:3, :3]) - 1) / 2))
        rows.append((times[i], np.linalg.norm(error[:3, 3]), math.acos(cosine)))
    return rows


def associate(first, second, max_difference=0.02):
    candidates = sorted(
        (abs(a - b), a, b) for a in first for b in second if abs(a - b) < max_difference
    )
    free_first, free_second, pairs = set(first), set(second), []
    for _, a, b in candidates:
        if a in free_first and b in free_second:
            free_first.remove(a)
            free_second.remove(b)
            pairs.append((a, b))
    return sorted(pairs, key=lambda pair: pair[1])


def evaluate_ate(truth, estimate, max_difference=0.02):
    """Errors in order of the estimated time, and the alignment (rotation, translation)."""
    pairs = associate(truth, estimate, max_difference)
    data = np.array([truth[a][:3, 3] for a, _ in pairs]).T
    model = np.array([estimate[b][:3, 3] for _, b in pairs]).T
    model_mean, data_mean = model.mean(1, keepdims=True), data.mean(1, keepdims=True)
    W = np.zeros((3, 3))
    for column in range(model.shape[1]):
        W += np.outer((model - model_mean)[:, column], (data - data_mean)[:, column])
    U, _, Vh = np.linalg.svd(W.T)
    S = np.eye(3)
    if np.linalg.det(U) * np.linalg.det(Vh) < 0:
        S[2, 2] = -1
    R = U @ S @ Vh
    t = data_mean - R @ model_mean
    return np.linalg.norm(R @ model + t - data, axis=0), R, t[:, 0]
