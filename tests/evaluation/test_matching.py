"""Eq. (15): by hand, by brute force, and what it refuses."""

import math

import numpy as np
import pytest

from edvo.errors import EvaluationError
from edvo.evaluation.matching import matching_success

RIGHT = np.array([[1.0, 0.0]])


def counts(matches, pixels, normals, true, **more):
    found = matching_success(np.array(matches, np.int32), pixels, normals, np.array(true), **more)
    return found.total, found.correct, found.same_line


def test_a_match_at_the_true_place_is_correct_up_to_the_tolerance_and_including_it():
    pixels, normals = np.array([[10.0, 20.0]]), RIGHT
    for distance, expected in ((0.0, 1), (1.99, 1), (2.0, 1), (2.01, 0)):
        true = [[10.0 + distance, 20.0]]
        assert counts([0], pixels, normals, true, tolerance_px=2.0) == (1, expected, expected)


def test_no_match_counts_as_wrong_and_an_unknown_place_not_at_all():
    pixels, normals = np.array([[10.0, 20.0]]), RIGHT
    true = [[10.0, 20.0], [10.0, 20.0], [math.nan, 20.0], [math.nan, math.nan]]
    found = matching_success(np.array([0, -1, 0, -1], np.int32), pixels, normals, np.array(true))
    assert (found.total, found.correct) == (2, 1)
    assert found.rate == 0.5


def test_a_match_slid_along_its_line_is_on_the_same_line_but_not_correct():
    pixels, normals = np.array([[10.0, 20.0]]), RIGHT
    along, across, far = [[10.0, 26.0]], [[16.0, 20.0]], [[10.0, 31.0]]
    assert counts([0], pixels, normals, along) == (1, 0, 1)
    assert counts([0], pixels, normals, across) == (1, 0, 0)
    assert counts([0], pixels, normals, far) == (1, 0, 0)  # further than slide_px
    assert counts([0], pixels, normals, far, slide_px=12.0) == (1, 0, 1)


def test_it_equals_a_loop_over_all_pixels():
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, 30, (40, 2)).astype(np.float32)
    angle = rng.uniform(0, 2 * np.pi, 40)
    normals = np.column_stack((np.cos(angle), np.sin(angle))).astype(np.float32)
    true = rng.uniform(0, 30, (500, 2))
    true[rng.random(500) < 0.1, 1] = np.nan
    matches = rng.integers(-1, 40, 500).astype(np.int32)
    total = correct = same = 0
    for m, t in zip(matches, true, strict=True):
        if math.isnan(t[0]) or math.isnan(t[1]):
            continue
        total += 1
        if m < 0:
            continue
        du, dv = float(pixels[m, 0]) - t[0], float(pixels[m, 1]) - t[1]
        correct += math.hypot(du, dv) <= 3
        near = abs(du * float(normals[m, 0]) + dv * float(normals[m, 1])) <= 3
        same += math.hypot(du, dv) <= 3 or (near and math.hypot(du, dv) <= 8)
    found = matching_success(matches, pixels, normals, true, tolerance_px=3.0, slide_px=8.0)
    assert (found.total, found.correct, found.same_line) == (total, correct, same)
    assert 0 < found.correct < found.same_line < found.total
    assert found.rate == correct / total
    assert found.line_rate == same / total


def test_nothing_to_match_has_no_rate():
    none = np.empty((0, 2))
    found = matching_success(np.empty(0, np.int32), none, none, none)
    assert (found.total, found.correct) == (0, 0)
    assert math.isnan(found.rate)
    assert math.isnan(found.line_rate)


@pytest.mark.parametrize(
    ("matches", "more", "message"),
    [
        ([0, 0], {}, "2 matches of 1 edges"),
        ([1], {}, "match 1 of 1 reference edges"),
        ([0], {"tolerance_px": 0.0}, "give positive"),
        ([0], {"slide_px": math.nan}, "give positive"),
    ],
)
def test_what_makes_no_sense_is_refused(matches, more, message):
    with pytest.raises(EvaluationError, match=message):
        counts(matches, np.zeros((1, 2)), RIGHT, [[0.0, 0.0]], **more)
