"""PLY files: points or triangles, binary, little-endian."""

import numpy as np
from numpy.typing import NDArray


def to_ply(
    points: NDArray[np.floating],
    colours: NDArray[np.uint8],
    triangles: NDArray[np.integer] | None = None,
    *,
    comment: str = "",
) -> bytes:
    """Format points, or a mesh, as a PLY file.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        Metres.
    colours : ndarray of uint8, shape (N, 3)
        Red, green, blue.
    triangles : ndarray, shape (M, 3), optional
        Indices of points.
    comment : str
        A line for the header.

    Returns
    -------
    bytes
        Positions in single precision, as all readers expect them.
    """
    vertices = np.empty(len(points), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = points, colours
    header = ["ply", "format binary_little_endian 1.0"]
    header += [f"comment {comment}"] if comment else []
    header += [f"element vertex {len(points)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"property uchar {colour}" for colour in ("red", "green", "blue")]
    faces = b""
    if triangles is not None:
        header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
        rows = np.empty(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, triangles
        faces = rows.tobytes()
    return "\n".join([*header, "end_header", ""]).encode() + vertices.tobytes() + faces
