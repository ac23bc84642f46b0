"""Whatever is wrong with a folder: one line that names it, or a recording without that part."""

import pytest

from edvo.datasets import open_source
from edvo.errors import EdvoError

from .layouts import CAMERA, FRAMES, recording, write_tum
from .test_folders import write_generic, write_open3d, write_replica
from .test_tum_kin import write_eth3d, write_icl, write_povray
from .test_two_cameras import write_7scenes, write_scannet, write_sens


def _with_camera(folder, of):
    of.camera.to_yaml(folder / "camera.yaml")
    return folder


WRITERS = {
    "tum": lambda folder, of: write_tum(folder / "fr1", of),
    "icl": lambda folder, of: write_icl(folder / "living_room_traj2_frei_png", of),
    "povray": lambda folder, of: _with_camera(write_povray(folder / "lr", of), of),
    "bonn": lambda folder, of: write_tum(folder / "rgbd_bonn_crowd", of),
    "eth3d": lambda folder, of: write_eth3d(folder / "plant_1", of),
    "7scenes": lambda folder, of: write_7scenes(folder / "seq-01", of, of.poses),
    "scannet": lambda folder, of: write_scannet(folder / "scene0000_00", of, CAMERA),
    "sens": lambda folder, of: write_sens(folder / "a/a.sens", of).parent,
    "replica": lambda folder, of: write_replica(folder / "Replica/office0", of),
    "open3d": lambda folder, of: write_open3d(folder / "lounge", of),
    "folder": lambda folder, of: write_generic(folder / "mine", of),
}

DAMAGE = {
    "missing": None,
    "empty": lambda data: b"",
    "cut short": lambda data: data[: len(data) // 2],
    "binary": lambda data: b"\xff\xfe\x00\x89PNG\r\n" + bytes(range(256)),
    "other text": lambda data: b"<html>\n<body>404 not found</body>\n</html>\n",
    "numbers that cannot be": lambda data: b"nan inf -1e999 1e400 0\n" * 20,
    "one huge number": lambda data: b"9" * 5000,
    "json of another kind": lambda data: b'{"camera": null, "intrinsic_matrix": {}, "width": []}',
    "deep json": lambda data: b"[" * 100_000,
}


def use(folder, format):
    """Open and look at what `edvo info` and `edvo run` look at: good frames, or the error."""
    try:
        source = open_source(folder, format=format)
    except EdvoError as error:
        return str(error)
    readings = [source.read(index) for index in range(min(len(source), 3))]
    told = [reading.problem for reading in readings if reading.problem is not None]
    told += source.describe()["warnings"]
    assert all("\n" not in line for line in told), told
    return sum(reading.frame is not None for reading in readings)


@pytest.mark.parametrize("format", list(WRITERS))
def test_every_file_in_turn(tmp_path, format):
    whole = WRITERS[format](tmp_path / "whole", recording())
    assert open_source(whole).format == format
    seen = set()
    for file in sorted((tmp_path / "whole").rglob("*")):
        kind = (file.parent, file.suffix)
        # One of many images or poses is enough.
        if not file.is_file() or (kind in seen and len(list(file.parent.iterdir())) >= FRAMES):
            continue
        seen.add(kind)
        data = file.read_bytes()
        for name, spoil in DAMAGE.items():
            if spoil is None:
                file.unlink()
            else:
                file.write_bytes(spoil(data))
            for forced in (None, format) if spoil is None else (None,):
                assert "\n" not in str(use(whole, forced)), (file, name)
            file.write_bytes(data)


@pytest.mark.parametrize("format", list(WRITERS))
def test_without_its_images(tmp_path, format):
    folder = WRITERS[format](tmp_path, recording())
    for file in folder.rglob("*"):
        if file.suffix in {".png", ".jpg", ".sens", ".depth"}:
            file.write_bytes(b"")
    found = use(folder, format)
    assert found == 0 or str(folder) in found


@pytest.mark.parametrize("format", list(WRITERS))
def test_an_empty_folder_and_a_file(tmp_path, format):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_bytes(b"")
    for path in (tmp_path / "empty", tmp_path / "file"):
        found = use(path, format)
        assert str(path) in found
        assert "\n" not in found
