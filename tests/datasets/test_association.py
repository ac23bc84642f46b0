import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from edvo.datasets.association import associate

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
