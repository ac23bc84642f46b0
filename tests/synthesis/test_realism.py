"""Made sequences are as busy, as steep and as full of holes as the real ones they stand for."""

from pathlib import Path

import numpy as np
import pytest

from edvo.datasets import open_source
from edvo.synthesis.realism import MODELLED_ON, Look, look_of, look_of_source
from edvo.synthesis.sequence import SyntheticSource, make_recipe

FACTOR = 1.5


def test_a_frame_of_which_all_is_known() -> None:
    grey = np.full((100, 100), 50, np.uint8)
    grey[:, 50:] = 250
    depth = np.ones((100, 100), np.float32)
    depth[:10] = 0
    look = look_of(grey, depth)
    assert look.edges == pytest.approx(0.01)  # one column
    assert look.gradient == pytest.approx(16.0)  # a step of 200, four times, over both its sides
    assert look.missing == pytest.approx(0.1)
    assert look.over(look) == Look(1, 1, 1)


@pytest.mark.parametrize("scene", MODELLED_ON)
def test_within_a_factor_of_the_real_thing(real_data: Path, scene: str) -> None:
    made = look_of_source(SyntheticSource(make_recipe(scene, frames=300)), 7)
    for sequence, figures in MODELLED_ON[scene].items():
        ratio = made.over(look_of_source(open_source(real_data / sequence)))
        for figure in figures:
            assert 1 / FACTOR < getattr(ratio, figure) < FACTOR, (sequence, figure)
