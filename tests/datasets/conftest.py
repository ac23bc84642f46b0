"""What the tests of the readers share."""

import cv2
import numpy as np
import pytest

SIZE = (64, 48)

CAMERA = """\
width: 64
height: 48
fx: 50.0
fy: 51.0
cx: 31.5
cy: 23.5
depth_scale: 5000
"""


def colour_image(seed, size=SIZE, channels=3):
    rng = np.random.default_rng(seed)
    shape = (size[1], size[0]) if channels == 1 else (size[1], size[0], channels)
    return rng.integers(0, 256, shape, dtype=np.uint8)


def depth_image(seed, size=SIZE):
    rng = np.random.default_rng(1000 + seed)
    return rng.integers(2000, 20000, (size[1], size[0]), dtype=np.uint16)


@pytest.fixture
def make_folder(tmp_path):
    """Write a folder in TUM layout; images are noise by the index of their row."""

    def make(
        name="sequence",
        colour=("1.000000", "1.100000", "1.200000"),
        depth=("1.005000", "1.105000", "1.205000"),
        suffix=".png",
        channels=3,
        camera=CAMERA,
    ):
        folder = tmp_path / name
        for kind, stamps in (("rgb", colour), ("depth", depth)):
            (folder / kind).mkdir(parents=True)
            rows = ["# timestamp filename"]
            for index, stamp in enumerate(stamps):
                file = f"{kind}/{index}{suffix if kind == 'rgb' else '.png'}"
                image = colour_image(index, SIZE, channels) if kind == "rgb" else depth_image(index)
                assert cv2.imwrite(str(folder / file), image)
                rows.append(f"{stamp} {file}")
            (folder / f"{kind}.txt").write_text("\n".join(rows) + "\n")
        if camera is not None:
            (folder / "camera.yaml").write_text(camera)
        return folder

    return make
