from pathlib import Path

import pytest

from edvo.camera import Camera
from edvo.datasets.known_cameras import KNOWN_CAMERAS, choose_camera, recognise_camera
from edvo.errors import CameraError, DatasetError


@pytest.mark.parametrize(
    ("path", "camera"),
    [
        ("rgbd_dataset_freiburg1_xyz", "tum-fr1"),
        ("rgbd_dataset_freiburg2_desk", "tum-fr2"),
        ("rgbd_dataset_freiburg3_long_office_household", "tum-fr3"),
        ("tum_fr3_structure_notexture_far", "tum-fr3"),
        ("fr1-desk", "tum-fr1"),
        ("Freiburg1_XYZ", "tum-fr1"),
        ("fr3/cabinet", "tum-fr3"),
        ("rgbd_bonn_balloon2", "bonn"),
        ("icl_office_kt3", "icl-nuim"),
        ("living_room_traj2n_frei_png", "icl-nuim"),
        ("livingroom1", "icl-nuim"),
        ("office_traj0_frei_png", "icl-nuim"),
        ("lr_kt2", "icl-nuim"),
        ("office", None),
        ("fr12", None),
        ("afr1", None),
        ("vehicles", None),
        ("recording", None),
    ],
)
def test_the_name_of_a_sequence_tells_the_camera(path, camera):
    found = recognise_camera(Path("/data") / path)
    assert (found and found[0].name) == camera


def test_the_published_numbers():
    fr1 = KNOWN_CAMERAS["tum-fr1"]
    assert (fr1.fx, fr1.fy, fr1.cx, fr1.cy) == (517.306, 516.469, 318.643, 255.314)
    assert fr1.distortion == (0.262383, -0.953104, -0.005358, 0.002628, 1.163314)
    for camera in KNOWN_CAMERAS.values():
        assert (camera.width, camera.height, camera.depth_scale) == (640, 480, 5000.0)


def test_they_equal_the_files_beside_the_real_sequences(real_data):
    for folder in ("tum_fr1_xyz", "tum_fr3_structure_notexture_far", "icl_office_kt3"):
        known, name = recognise_camera(Path("/elsewhere") / folder)
        assert name == folder
        beside = Camera.from_yaml(real_data / folder / "camera.yaml")
        for key in ("width", "height", "fx", "fy", "cx", "cy", "distortion", "depth_scale"):
            assert getattr(known, key) == pytest.approx(getattr(beside, key)), (folder, key)


def test_the_user_wins_over_the_folder_and_the_folder_over_its_name(tmp_path):
    folder = tmp_path / "freiburg1_xyz"
    folder.mkdir()
    camera, origin = choose_camera(folder)
    assert camera == KNOWN_CAMERAS["tum-fr1"]
    assert "freiburg1_xyz" in origin
    KNOWN_CAMERAS["bonn"].to_yaml(folder / "camera.yaml")
    camera, origin = choose_camera(folder)
    assert camera.fx == KNOWN_CAMERAS["bonn"].fx
    assert origin == "camera.yaml in the folder"
    KNOWN_CAMERAS["icl-nuim"].to_yaml(tmp_path / "mine.yaml")
    camera, origin = choose_camera(folder, tmp_path / "mine.yaml")
    assert camera.fx == KNOWN_CAMERAS["icl-nuim"].fx
    assert "mine.yaml" in origin
    assert choose_camera(folder, "tum-fr3")[0] == KNOWN_CAMERAS["tum-fr3"]
    assert choose_camera(folder, KNOWN_CAMERAS["tum-fr2"])[0] is KNOWN_CAMERAS["tum-fr2"]


def test_no_camera_is_an_error_with_the_mend(tmp_path):
    folder = tmp_path / "recording"
    folder.mkdir()
    with pytest.raises(DatasetError, match=r"put a camera.yaml .* or add --camera"):
        choose_camera(folder)
    with pytest.raises(CameraError, match=r"missing\.yaml"):
        choose_camera(folder, tmp_path / "missing.yaml")
    (folder / "camera.yaml").write_text("width: 640\nheight: four\n")
    with pytest.raises(CameraError, match=r"camera\.yaml"):
        choose_camera(folder)
