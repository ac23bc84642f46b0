"""A COLMAP model as text: cameras, images with poses, and edges as points.

Written after https://colmap.github.io/format.html#text-format.
"""

from collections.abc import Sequence
from pathlib import Path

from edvo import se3
from edvo.camera import Camera
from edvo.export.edge_map import EdgePoints
from edvo.export.pixels import corner_principal_point
from edvo.trajectory import Trajectory


def to_colmap(
    trajectory: Trajectory,
    camera: Camera,
    points: EdgePoints,
    names: Sequence[str],
    folder: Path | None = None,
) -> dict[str, str]:
    """Format a model.

    Parameters
    ----------
    trajectory : Trajectory
        ``T_world_cam``; COLMAP wants its inverse, which maps world points to the camera. Its
        camera axes are ours.
    camera : Camera
        Of all images: PINHOLE; with distortion OPENCV, and FULL_OPENCV where k3 is not zero.
    points : EdgePoints
        For programs that start from points; none was seen in any image, as far as COLMAP knows.
    names : sequence of str
        Of the image of each pose.
    folder : pathlib.Path, optional
        Where the images are; said in a comment.

    Returns
    -------
    dict of str to str
        ``cameras.txt``, ``images.txt`` and ``points3D.txt``.
    """
    return {
        "cameras.txt": _camera(camera),
        "images.txt": _images(trajectory, names, folder),
        "points3D.txt": _points(points),
    }


def _camera(camera: Camera) -> str:
    cx, cy = corner_principal_point(camera)
    k1, k2, p1, p2, k3 = camera.distortion
    model, parameters = "PINHOLE", [camera.fx, camera.fy, cx, cy]
    if camera.is_distorted:
        model = "FULL_OPENCV" if k3 else "OPENCV"
        parameters += [k1, k2, p1, p2, *([k3, 0.0, 0.0, 0.0] if k3 else [])]
    values = " ".join(f"{value:.12g}" for value in parameters)
    row = f"1 {model} {camera.width} {camera.height} {values}"
    return f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n{row}\n"


def _images(trajectory: Trajectory, names: Sequence[str], folder: Path | None) -> str:
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME", "# (points: none)"]
    if folder is not None:
        lines.append("# images: " + " ".join(str(folder).split()))
    for number, (name, T_world_cam) in enumerate(
        zip(names, trajectory.poses, strict=True), start=1
    ):
        translation, quaternion = se3.to_quaternion(se3.inverse(T_world_cam))
        x, y, z, w = quaternion.tolist()
        values = " ".join(f"{value + 0.0:.12g}" for value in (w, x, y, z, *translation.tolist()))
        lines += [f"{number} {values} 1 {name}", ""]
    return "\n".join(lines) + "\n"


def _points(points: EdgePoints) -> str:
    lines = ["# POINT3D_ID X Y Z R G B ERROR TRACK[]"]
    rows = zip(points.points.tolist(), points.grey.tolist(), strict=True)
    for number, ((x, y, z), grey) in enumerate(rows, start=1):
        lines.append(f"{number} {x:.6f} {y:.6f} {z:.6f} {grey} {grey} {grey} 0")
    return "\n".join(lines) + "\n"
