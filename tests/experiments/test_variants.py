"""Changes of one part at a time."""

import pytest

from edvo.config import PRESETS, Config
from edvo.errors import ConfigError
from edvo.experiments.variants import VARIANTS, variants_of


def leaves(values: dict[str, object], above: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in values.items():
        name = f"{above}{key}"
        found |= leaves(value, f"{name}.") if isinstance(value, dict) else {name: value}
    return found


@pytest.mark.parametrize("preset", PRESETS)
def test_each_changes_what_it_says_and_nothing_else(preset: str) -> None:
    unchanged = leaves(Config.preset(preset).to_dict())
    changes = {variant.name: variant.changes for variant in VARIANTS}
    for name, config in variants_of(preset).items():
        differing = {k for k, v in leaves(config.to_dict()).items() if v != unchanged[k]}
        assert differing
        assert differing <= {change.split("=")[0] for change in changes[name]}
        assert len({key.split(".")[0] for key in differing}) == 1  # one part


def test_what_a_preset_has_already_is_no_change() -> None:
    paper, default = variants_of("paper"), variants_of("default")
    assert "weights: t, nu = 2" not in paper
    assert "samples: 450" not in paper
    assert {"weights: Tukey", "samples: 1500"} <= set(paper)
    assert {"weights: t, nu = 2", "samples: 450"} & set(default)


def test_every_part_of_the_method_is_among_them() -> None:
    parts = {change.split(".")[0] for variant in VARIANTS for change in variant.changes}
    assert {"edges", "sampling", "matching", "registration", "keyframes", "motion"} <= parts
    assert len({variant.name for variant in VARIANTS}) == len(VARIANTS)


def test_each_thing_that_default_adds_to_the_paper_can_be_left_out() -> None:
    paper, default = (leaves(Config.preset(name).to_dict()) for name in ("paper", "default"))
    variants = [leaves(config.to_dict()) for config in variants_of("default").values()]
    added = {key for key in default if default[key] != paper[key]} - {"preset_name"}
    assert {"edges.position", "status.max_conflict", "status.min_agreeing"} <= added
    for key in added:
        assert any(values[key] == paper[key] for values in variants), key


def test_no_such_preset() -> None:
    with pytest.raises(ConfigError, match="there are default, paper"):
        variants_of("best")
