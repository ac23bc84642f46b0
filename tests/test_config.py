import pickle

import numpy as np
import pytest
import yaml
from pydantic import BaseModel

from edvo.config import PRESETS, Config, EdgesConfig, SamplingConfig
from edvo.errors import ConfigError, OutputError


def fields(model=Config, path=()):
    """Every leaf of the tree: its path and its field."""
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from fields(field.annotation, (*path, name))
        else:
            yield (*path, name), field


LEAVES = {".".join(path): field for path, field in fields()}


@pytest.mark.parametrize("key", LEAVES)
def test_every_parameter_says_what_it_is(key):
    assert len(LEAVES[key].description or "") > 10


@pytest.mark.parametrize("key", [key for key in LEAVES if not key.startswith("preset")])
def test_every_parameter_takes_its_default_and_refuses_a_mapping(key):
    value = LEAVES[key].get_default()
    text = str(value).lower() if isinstance(value, bool) else value
    config = Config().with_overrides([f"{key}={text}"])
    assert config == Config()
    with pytest.raises(ConfigError, match=key.replace(".", r"\.")):
        Config().with_overrides([f"{key}={{a: 1}}"])


# --------------------------------------------------------------------------------------- errors

BAD = [
    # assignment, what the message must hold
    ("sampling.cuont=900", ["sampling.cuont", "cell_px", "count", "per_cell"]),
    ("smapling.count=900", ["smapling.count", "sampling", "registration"]),
    ("cuont=900", ["cuont", "seed"]),
    ("sampling.count.x=900", ["sampling.count.x"]),
    ("sampling.count=many", ["sampling.count", "many", "integer"]),
    ("sampling.count=1.5", ["sampling.count", "1.5", "integer"]),
    ("sampling.count=-1", ["sampling.count", "-1", "greater than or equal to 0"]),
    ("sampling.count=", ["sampling.count", "None"]),
    ("sampling=5", ["sampling", "5"]),
    ("seed=-1", ["seed", "-1"]),
    ("seed=2147483648", ["seed", "2147483648"]),
    ("edges.extractor=prewitt", ["edges.extractor", "prewitt", "canny", "sobel", "dog"]),
    ("edges.blur_px=4", ["edges.blur_px", "4", "odd"]),
    ("edges.depth_window_px=0", ["edges.depth_window_px"]),
    ("edges.low=0", ["edges.low", "greater than 0"]),
    ("edges.low=.nan", ["edges.low", "nan"]),
    ("edges.low=.inf", ["edges.low", "finite"]),
    ("edges.low=100", ["override: edges.low = 100 is above edges.high = 40"]),
    ("edges.high=10", ["override: edges.low = 20 is above edges.high = 10"]),
    ("matching.max_angle_deg=181", ["matching.max_angle_deg", "181", "180"]),
    ("matching.gamma=-0.1", ["matching.gamma", "-0.1"]),
    ("registration.weight=l1", ["registration.weight", "l1", "tukey"]),
    ("registration.damping_up=1", ["registration.damping_up", "greater than 1"]),
    ("registration.damping_down=1", ["registration.damping_down", "less than 1"]),
    ("registration.min_matches=5", ["registration.min_matches", "6"]),
    ("status.min_inliers=1.1", ["status.min_inliers", "1.1"]),
    ("preset_name=paper", ["preset_name", "--preset"]),
    ("sampling.count=yes", ["sampling.count", "true"]),
    ("sampling.count", ["sampling.count", "KEY=VALUE"]),
    ("=3", ["KEY=VALUE"]),
    ("sampling.count=[1", ["sampling.count", "[1"]),
    ("seed=2020-13-45", ["seed: cannot read the value '2020-13-45'"]),
    ("seed=0b_", ["seed: cannot read the value '0b_'"]),
    ("seed=!!int abc", ["seed: cannot read the value '!!int abc'"]),
]


@pytest.mark.parametrize(("assignment", "parts"), BAD, ids=[bad[0] for bad in BAD])
def test_a_bad_override_is_refused_in_one_line(assignment, parts):
    with pytest.raises(ConfigError) as caught:
        Config().with_overrides([assignment])
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_thresholds_that_do_not_rise_are_refused_however_they_are_given():
    told = r"edges\.low = 100 is above edges\.high = 40"
    with pytest.raises(ConfigError, match=f"^mine: {told}"):
        Config.from_dict({"edges": {"low": 100}}, where="mine")
    with pytest.raises(ConfigError, match=told):
        Config(edges=EdgesConfig(low=100))
    assert Config().with_overrides(["edges.low=100", "edges.high=100"]).edges.low == 100


@pytest.mark.parametrize(
    ("overrides", "parts"),
    [
        ("sampling.count=900", ["'sampling.count=900'", "give a list"]),
        (None, ["None", "give a list"]),
        (900, ["900", "give a list"]),
        ([None], ["None", "KEY=VALUE"]),
        ([b"seed=1"], ["b'seed=1'", "KEY=VALUE"]),
    ],
)
def test_overrides_are_a_list_of_text(overrides, parts):
    with pytest.raises(ConfigError) as caught:
        Config().with_overrides(overrides)
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


FILES = [
    ("preset_name: best\n", ["preset_name", "best", "default", "paper"]),
    ("sampling:\n  cuont: 3\n", ["sampling.cuont", "count"]),
    ("sampling:\n  count: lots\n", ["sampling.count", "lots"]),
    ("sampling: [1, 2]\n", ["sampling"]),
    ("- a\n- b\n", ["sampling:"]),
    ("just words\n", ["just words"]),
    ("sampling: {count: 3\n", ["no YAML"]),
    (b"\xff\xfe\x00", ["no YAML"]),
    ("preset_name: best\n", ["preset_name", "best"]),
    ("preset_name: [1]\n", ["preset_name"]),
    ("1: 2\n", ["1"]),
    ("seed: 2020-13-45\n", ["no YAML: a value that cannot be read"]),
    (
        "edges: {low: 10}\nsampling: {count: 9}\nedges: {high: 5}\n",
        ["'edges' comes twice", "line 3"],
    ),
    ("edges: {low: 10, low: 9}\n", ["the key 'low' comes twice"]),
    ("? [1]\n: 2\n", ["no YAML", "unhashable key"]),
    ("[" * 100_000, ["no YAML: nested too deeply"]),
]


@pytest.mark.parametrize(("content", "parts"), FILES, ids=[str(c)[:60] for c, _ in FILES])
def test_a_bad_file_is_refused_in_one_line_that_names_it(tmp_path, content, parts):
    path = tmp_path / "mine.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigError) as caught:
        Config.load(path)
    message = str(caught.value)
    assert "\n" not in message
    for part in (str(path), *parts):
        assert part in message


@pytest.mark.parametrize("values", [None, [1], "edges", 3])
def test_what_are_no_keys_are_refused(values):
    with pytest.raises(ConfigError, match="here: expected keys such as 'sampling:', got"):
        Config.from_dict(values, where="here")


def test_keys_may_be_merged_from_another_part(tmp_path):
    """As YAML has it, where it is no mistake that one is there again."""
    path = tmp_path / "mine.yaml"
    path.write_text("sampling: {<<: &few {count: 300}, cell_px: 30, <<: *few}\n")
    sampling = Config.load(path).sampling
    assert (sampling.count, sampling.cell_px) == (300, 30)


def test_a_missing_file(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: No such file"):
        Config.load(tmp_path / "nowhere.yaml")
    with pytest.raises(ConfigError, match="cannot read"):
        Config.load(tmp_path)


def test_a_preset_that_is_not():
    with pytest.raises(ConfigError, match="no preset 'best'; there are default, paper"):
        Config.preset("best")


def test_nothing_changes_in_place():
    config = Config()
    for section in (config, config.sampling):
        with pytest.raises(ConfigError, match=r"a configuration does not change; .*with_overrides"):
            section.seed = 3
        with pytest.raises(ConfigError, match="a configuration does not change"):
            del section.count
    assert config == Config()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Config(foo=1), r"Config: unknown key 'foo'; known here: preset_name, seed, edges"),
        (lambda: Config(seed=-1), r"Config: seed = -1: .*greater than or equal to 0"),
        (lambda: Config(preset_name="best"), r"Config: preset_name = 'best': .*'default' or"),
        (lambda: Config(sampling={"cout": 1}), r"unknown key 'sampling.cout'; known here: count"),
        (lambda: SamplingConfig(cout=1), r"SamplingConfig: unknown key 'cout'; known here: count"),
        (lambda: Config(self=1), r"Config: unknown key 'self'"),
        (lambda: Config(seed=np.zeros(30)), r"Config: seed = array\(\[0., 0.,.*integer"),
        (lambda: SamplingConfig(count="x"), r"SamplingConfig: count = 'x': .*integer"),
    ],
)
def test_what_cannot_be_is_refused_wherever_it_is_made(make, said):
    with pytest.raises(ConfigError, match=said) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_sections_make_what_keys_make():
    whole = Config.from_dict({"preset_name": "paper", "sampling": {"count": 900}})
    assert Config(preset_name="paper", sampling={"count": 900}) == whole
    one = SamplingConfig(count=900)  # counts whole
    assert Config(preset_name="paper", sampling=one).sampling == one != whole.sampling
    assert Config(**whole.to_dict()) == pickle.loads(pickle.dumps(whole)) == whole


# -------------------------------------------------------------------------------------- presets


def test_the_presets():
    assert Config() == Config.preset("default") == Config.from_dict({})
    assert set(PRESETS) == {"default", "paper"}
    for name in PRESETS:
        assert Config.preset(name).preset_name == name


def test_the_paper_preset_is_the_method_as_published():
    config = Config.preset("paper")
    assert config.edges.extractor == "canny"
    assert config.sampling.count == 450
    assert config.sampling.per_cell == 5
    assert config.matching.criterion == "robust-then-normal"
    assert config.matching.gamma == 0.7
    assert config.registration.residual == "divergence"
    assert config.registration.weight == "t"
    assert config.registration.nu == 2.0


# ------------------------------------------------------------------------------- overrides, files


def test_overrides():
    config = Config.preset("paper").with_overrides(
        ["sampling.count=900", "matching.criterion=normal", " keyframes.rule =gap", "seed=7"]
    )
    assert config.sampling.count == 900
    assert config.matching.criterion == "normal"
    assert config.keyframes.rule == "gap"
    assert config.seed == 7
    assert config.preset_name == "paper"
    assert config.registration == Config.preset("paper").registration


def test_numbers_without_a_point_are_numbers():
    """YAML 1.1 takes 1e-3 for text."""
    config = Config().with_overrides(["registration.damping=1e-3"])
    assert config.registration.damping == 1e-3


def test_the_last_override_wins():
    config = Config().with_overrides(["seed=1", "seed=2"])
    assert config.seed == 2
    assert Config().with_overrides([]) == Config()


@pytest.mark.parametrize("preset", PRESETS)
def test_yaml_there_and_back(tmp_path, preset):
    config = Config.preset(preset).with_overrides(["seed=3", "edges.low=12.345678901234567"])
    path = tmp_path / "config.yaml"
    config.to_yaml(path)
    assert Config.load(path) == config
    assert Config.from_dict(config.to_dict()) == config
    written = yaml.safe_load(path.read_text())
    assert list(written) == list(Config.model_fields)
    assert len([key for key in LEAVES if "." in key]) == sum(
        len(section) for section in written.values() if isinstance(section, dict)
    )


def test_a_file_may_hold_little_or_nothing(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_text("")
    assert Config.load(path) == Config()
    path.write_text("preset_name: paper\nsampling: {cell_px: 40}\n")
    config = Config.load(path)
    assert config == Config.preset("paper").with_overrides(["sampling.cell_px=40"])
    assert config.sampling.count == 450


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(OutputError, match="missing"):
        Config().to_yaml(tmp_path / "missing" / "config.yaml")


@pytest.mark.parametrize("name", ["readout", "exposure"])
def test_a_readout_or_exposure_that_is_known_is_said(name):
    for given in ([f"motion.{name}=known"], [f"motion.{name}_s=0.02"]):
        with pytest.raises(ConfigError, match=rf"motion\.{name}_s = .*{name}: known .* give both"):
            Config().with_overrides(given)
    known = Config().with_overrides(["motion.exposure=known", "motion.exposure_s=0.02"])
    assert known.motion.exposure_s == 0.02
    with pytest.raises(ConfigError, match=r"motion\.exposure_s"):
        Config().with_overrides(["motion.exposure=known", "motion.exposure_s=-0.02"])
    known = Config().with_overrides(["motion.readout=known", "motion.readout_s=-0.02"])
    assert known.motion.readout_s == -0.02
