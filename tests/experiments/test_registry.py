"""Every experiment of the paper is there, by its name."""

import pytest

from edvo.experiments.registry import EXPERIMENTS, NAMES


@pytest.mark.parametrize("name", NAMES)
def test_each_is_what_it_is_called(name: str) -> None:
    experiment = EXPERIMENTS[name]
    assert experiment.name == name
    assert experiment.title
    assert experiment.paper


def test_all_and_no_other() -> None:
    figures = {f"fig{n}" for n in (2, 3, 5, 6, 7, 8, 9, 10, 11)}
    assert set(EXPERIMENTS) == figures | {"table1", "table2", "table3"}
    assert len(EXPERIMENTS) == 12
    with pytest.raises(KeyError):
        EXPERIMENTS["fig4"]
