"""A `transforms.json` for nerfstudio, and for what else reads instant-ngp's format.

Written after https://docs.nerf.studio/quickstart/data_conventions.html.
"""

import json
from collections.abc import Sequence

import numpy as np

from edvo.camera import Camera
from edvo.export.pixels import corner_principal_point
from edvo.trajectory import Trajectory

IMAGES = "images"
T_CAM_GL = np.diag([1.0, -1.0, -1.0, 1.0])
"""Maps points of OpenGL's camera (x right, y up, z back) to ours (x right, y down, z forward)."""


def to_nerfstudio(
    trajectory: Trajectory, camera: Camera, points_file: str | None, names: Sequence[str]
) -> str:
    """Format poses and camera as JSON.

    Parameters
    ----------
    trajectory : Trajectory
        ``T_world_cam``; only the axes of the camera are turned, the world stays.
    camera : Camera
        Of all images.
    points_file : str or None
        PLY file to start from, relative to this one.
    names : sequence of str
        Of the image of each pose.

    Returns
    -------
    str
        Images are named ``images/NAME``.
    """
    cx, cy = corner_principal_point(camera)
    k1, k2, p1, p2, k3 = camera.distortion
    matrices = (trajectory.poses @ T_CAM_GL + 0.0).tolist()
    content = {
        "camera_model": "OPENCV",
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": cx,
        "cy": cy,
        "k1": k1,
        "k2": k2,
        "k3": k3,
        "p1": p1,
        "p2": p2,
        **({} if points_file is None else {"ply_file_path": points_file}),
        "frames": [
            {"file_path": f"{IMAGES}/{name}", "transform_matrix": matrix}
            for name, matrix in zip(names, matrices, strict=True)
        ],
    }
    return json.dumps(content, indent=1) + "\n"
