import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edvo.datasets.association import associate, stamped_delay

times = st.lists(st.integers(0, 400), max_size=30, unique=True).map(
    lambda numbers: np.sort(np.array(numbers, dtype=float)) / 200.0
)


@given(times, times)
def test_each_colour_image_with_depth_near_is_there_with_the_nearest(colour, depth):
    kept, partners = associate(colour, depth)
    distances = np.abs(depth[None] - colour[:, None])
    near = (distances <= 0.02).any(axis=1) if len(depth) else np.zeros(len(colour), bool)
    np.testing.assert_array_equal(kept, np.flatnonzero(near))
    np.testing.assert_array_equal(
        np.abs(depth[partners] - colour[kept]), distances.min(axis=1, initial=9)[kept]
    )


@pytest.mark.parametrize(
    ("depth", "delay"),
    [(5.0, 0.0), (5.01, 0.01), (4.99, -0.01), (5.0199, 0.0199), (5.0201, 0.0), (4.9, 0.0), (0, 0)],
)
def test_a_delay_is_that_of_the_stamps_if_they_are_of_one_clock(depth, delay):
    assert stamped_delay(5.0, depth) == pytest.approx(delay, abs=1e-12)
