"""Scenes: what comes with the package, what people write themselves, and what cannot be."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from edvo.errors import MissingExtraError, SceneError
from edvo.synthesis.geometry import World
from edvo.synthesis.scene import Scene, load_scene, scene_names

NAMES = {
    "texture_far",
    "texture_near",
    "office",
    "notexture_far",
    "notexture_near",
    "cabinet",
    "corridor",
    "white_wall",
    "stairs",
    "crowd",
}
BOX = {"shape": "box", "material": "grey", "size": [1, 1, 1]}


def small(*shapes: dict[str, Any], **more: Any) -> dict[str, Any]:
    """A scene with one material and the shapes given."""
    return {
        "materials": {"grey": {"albedo": [0.5, 0.5, 0.5]}},
        "shapes": list(shapes) or [BOX],
        "camera": {"points": [[0, -3, 1], [1, -3, 1]], "targets": [[0, 0, 1], [1, 0, 1]]},
        **more,
    }


def refused(data: Any) -> str:
    """The one-line message that a scene is refused with."""
    with pytest.raises(SceneError) as error:
        World(Scene.from_dict(data, where="mine.yaml"))
    message = str(error.value)
    assert "mine.yaml" in message
    assert "\n" not in message
    return message


def test_the_promised_scenes_are_there() -> None:
    assert set(scene_names()) == NAMES


@pytest.mark.parametrize("name", sorted(NAMES))
def test_a_packaged_scene_can_be_built_and_says_what_it_is(name: str) -> None:
    scene = load_scene(name)
    world = World(scene)
    assert scene.about
    assert scene.name == name
    assert len(world.things) > 5
    assert len(world.at(0.0).kind) < 5000


def test_an_unknown_scene_lists_what_there_is() -> None:
    with pytest.raises(SceneError, match=r"no scene 'kitchen'; there are cabinet, corridor, crowd"):
        load_scene("kitchen")


def test_a_scene_of_the_users_own(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(small(BOX, about="a box")))
    scene = load_scene(file)
    assert scene.about == "a box"
    assert World(scene).things == ("box",)


def test_a_scene_like_another(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("like: notexture_near\nabout: darker\nlights: {ambient: 0.1}\n")
    scene, base = load_scene(file), load_scene("notexture_near")
    assert scene.lights.ambient == 0.1
    assert scene.shapes == base.shapes
    assert scene.camera == base.camera != load_scene("notexture_far").camera


@pytest.mark.parametrize("text", ["a: [1", "- 1\n- 2\n", "", "like: nowhere\n", "shapes: []\n"])
def test_a_file_that_is_no_scene(tmp_path: Path, text: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(SceneError) as error:
        load_scene(file)
    assert "\n" not in str(error.value)


def test_a_missing_file(tmp_path: Path) -> None:
    for text, said in (("a: 2020-13-45", "a value that cannot be read"), ("a: 1\na: 2", "twice")):
        (tmp_path / "bad.yaml").write_text(text)
        with pytest.raises(SceneError, match=rf"bad\.yaml: not YAML: .*{said}"):
            load_scene(tmp_path / "bad.yaml")
    with pytest.raises(SceneError, match=r"cannot read .*none\.yaml"):
        load_scene(tmp_path / "none.yaml")


@pytest.mark.parametrize("size", [[0, 1, 1], [1, -1, 1], [1, 1, float("nan")], [1, 1]])
def test_sizes_must_be_above_zero(size: list[float]) -> None:
    assert "size" in refused(small({**BOX, "size": size}))


@pytest.mark.parametrize(
    ("shape", "word"),
    [
        ({"shape": "cylinder", "material": "grey", "radius": 0, "height": 1}, "radius"),
        ({"shape": "cylinder", "material": "grey", "radius": 1, "height": -1}, "height"),
        ({"shape": "panel", "material": "grey", "along": [1, 0, 0], "up": [2, 0, 0]}, "area"),
        ({"shape": "strip", "material": "grey", "points": [[0, 0], [0, 0]], "top": 1}, "same"),
        ({"shape": "strip", "material": "grey", "points": [[0, 0], [1, 0]], "top": 0}, "top"),
        ({**BOX, "material": "gold"}, "'gold' is not defined (there are: grey)"),
        ({**BOX, "colour": "red"}, "colour"),
        ({"shape": "ball", "material": "grey"}, "ball"),
        ({"shape": "part", "name": "chair"}, "'chair' is not defined (there are: none)"),
        ({"shape": "mesh", "material": "grey"}, "file or vertices"),
        (
            {"shape": "mesh", "material": "grey", "vertices": [[0, 0, 0]], "faces": [[0, 1, 2]]},
            "vertex",
        ),
        ({**BOX, "repeat": {"count": 0, "step": [1, 0, 0]}}, "count"),
        ({**BOX, "walk": {"path": [[0, 0, 0]]}}, "path"),
    ],
)
def test_what_cannot_be_is_named(shape: dict[str, Any], word: str) -> None:
    assert word in refused(small(shape))


def test_lights_without_direction_and_cameras_without_view_are_refused() -> None:
    dark = {"directional": [{"direction": [0, 0, 0], "intensity": 1}]}
    assert "direction" in refused(small(lights=dark))
    down = {"points": [[0, 0, 2], [1, 0, 2]], "targets": [[0, 0, 0], [1, 0, 0]]}
    assert "upright" in refused(small(camera=down))


def test_parts_must_not_hold_themselves() -> None:
    endless = {"a": [{"shape": "part", "name": "a"}]}
    assert "hold themselves" in refused(small({"shape": "part", "name": "a"}, parts=endless))


def test_a_walk_inside_a_walk_is_refused() -> None:
    walk = {"path": [[0, 0, 0], [1, 0, 0]]}
    shape = {"shape": "part", "name": "a", "walk": walk}
    assert "walk" in refused(small(shape, parts={"a": [{**BOX, "walk": walk}]}))


def test_parts_and_copies_lie_where_their_frames_say() -> None:
    part = {**BOX, "at": [1, 0, 0]}
    placed = {"shape": "part", "name": "a", "at": [0, 5, 0], "yaw": 90}
    copies = {**placed, "repeat": {"count": 3, "step": [0, 0, 2]}}
    world = World(Scene.from_dict(small(copies, parts={"a": [part]})))
    solids = world.at(0.0)
    assert world.things == ("box",) * 3
    # At yaw 90 the part's x is the world's y.
    np.testing.assert_allclose(solids.node[0], [-0.5, 5.5, 0, 0.5, 6.5, 5], atol=1e-6)


def test_a_mesh_file_without_the_extra_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    scene = Scene.from_dict(small({"shape": "mesh", "material": "grey", "file": "cup.obj"}))
    with pytest.raises(MissingExtraError, match=r"cup\.obj needs trimesh: .*edvo\[mesh\]"):
        World(scene)


def test_a_mesh_file(tmp_path: Path) -> None:
    pytest.importorskip("trimesh", reason="the extra edvo[mesh] is not installed")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    file = tmp_path / "mine.yaml"
    mesh = {"shape": "mesh", "material": "grey", "file": "flat.obj", "scale": 2}
    file.write_text(yaml.safe_dump(small(mesh)))
    assert World(load_scene(file)).at(0.0).kind.tolist() == [1]
    (tmp_path / "flat.obj").unlink()
    with pytest.raises(SceneError, match=r"cannot read mesh .*flat\.obj"):
        World(load_scene(file))
