from dataclasses import replace

import cv2
import numpy as np
import pytest

from edvo.datasets.ros_camera import camera_from_info
from edvo.datasets.ros_messages import CameraInfo, Header
from edvo.errors import DatasetError

K = (525.0, 0.0, 320.5, 0.0, 526.0, 239.5, 0.0, 0.0, 1.0)
P = (500.0, 0.0, 310.0, 0.0, 0.0, 501.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0)
INFO = CameraInfo(Header(0, "camera"), 480, 640, "plumb_bob", (), K, P)
# A factory calibration of an Azure Kinect at 640x480-like angles.
RATIONAL = (0.46, -2.59, 0.0006, -0.0003, 1.52, 0.34, -2.41, 1.45)


def camera(rectified=False, **info):
    return camera_from_info(
        replace(INFO, **info), rectified=rectified, depth_scale=1000.0, name="/camera_info"
    )


@pytest.mark.parametrize("distortion", [(), (0.0,) * 5, (0.0,) * 8])
@pytest.mark.parametrize("model", ["", "plumb_bob", "rational_polynomial", "equidistant"])
def test_no_distortion_is_none_whatever_the_model(distortion, model):
    taken = camera(model=model, distortion=distortion)
    assert (taken.fx, taken.fy, taken.cx, taken.cy) == (525.0, 526.0, 320.5, 239.5)
    assert not taken.is_distorted
    assert taken.depth_scale == 1000.0


def test_plumb_bob_is_taken_as_it_is():
    five = (0.05, -0.06, -0.005358, 0.002628, 0.01)
    assert camera(distortion=five).distortion == five
    assert camera(distortion=five[:4]).distortion == (*five[:4], 0.0)


def test_rectified_images_have_the_projection_and_no_distortion():
    taken = camera(rectified=True, distortion=(0.2, -0.9, 0.0, 0.0, 1.0))
    assert (taken.fx, taken.fy, taken.cx, taken.cy) == (500.0, 501.0, 310.0, 230.0)
    assert not taken.is_distorted


def test_a_rational_model_is_met_to_a_third_of_a_pixel():
    taken = camera(model="rational_polynomial", distortion=RATIONAL)
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 25), np.linspace(-0.45, 0.45, 25))
    points = np.column_stack((x.ravel(), y.ravel(), np.ones(x.size)))
    matrix = np.array(K).reshape(3, 3)
    still = np.zeros(3)
    shown = cv2.projectPoints(points, still, still, matrix, np.array(RATIONAL))[0][:, 0]
    inside = ((shown >= 0) & (shown <= (639, 479))).all(axis=1)
    ideal = (points @ matrix.T)[:, :2]
    assert np.abs(ideal - shown)[inside].max() > 1.0, "it is some distortion"
    assert np.abs(taken.project(points) - shown)[inside].max() < 0.3


def test_a_rational_model_with_nothing_below_is_plumb_bob():
    eight = (0.1, -0.2, 0.001, 0.002, 0.05, 0.0, 0.0, 0.0)
    taken = camera(model="rational_polynomial", distortion=eight)
    assert taken.distortion == eight[:5]


@pytest.mark.parametrize(
    ("info", "said"),
    [
        ({"width": 0}, "no image size"),
        ({"intrinsics": (0.0,) * 9}, "not calibrated"),
        ({"intrinsics": (float("nan"), *K[1:])}, "not calibrated"),
        ({"model": "equidistant", "distortion": (0.1, 0.0, 0.0, 0.0)}, "'equidistant'"),
        ({"model": "plumb_bob", "distortion": (0.1,)}, "1 coefficients"),
        ({"distortion": (float("nan"),) * 5}, "no number"),
        ({"distortion": (-9.0, 0.0, 0.0, 0.0, 0.0)}, "folds"),
        (
            {"model": "rational_polynomial", "distortion": (*(0.0,) * 5, -9.0, 0.0, 0.0)},
            "/camera_info",
        ),
    ],
)
def test_what_cannot_be_is_one_line_with_the_mend(info, said):
    with pytest.raises(DatasetError, match="--camera FILE") as caught:
        camera(**info)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
