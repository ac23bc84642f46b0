"""What `edvo run --export` knows, by name."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from edvo.baselines.open3d import load_open3d
from edvo.datasets import Source
from edvo.errors import ConfigError
from edvo.export.colmap import to_colmap
from edvo.export.edge_map import EdgePoints
from edvo.export.euroc import to_euroc
from edvo.export.kitti import to_kitti
from edvo.export.mesh import fuse
from edvo.export.nerfstudio import to_nerfstudio
from edvo.export.pixels import image_names
from edvo.export.ply import to_ply
from edvo.files import Unwritten, output_folder, write_atomically
from edvo.report.plots import direction_colours
from edvo.trajectory import Trajectory

_EDGES = "edges.ply"
_STARTING_POINTS = 100_000  # more than splatting starts from, and few enough for a text file


@dataclass(frozen=True, eq=False)
class Material:
    """What exports are made of.

    Attributes
    ----------
    source : Source
        What was tracked.
    indices : sequence of int, length N
        Its frames that have a pose.
    trajectory : Trajectory
        Those N poses.
    edges : EdgePoints
        The 3-D edge map.
    """

    source: Source
    indices: Sequence[int]
    trajectory: Trajectory
    edges: EdgePoints


def check_kinds(names: Sequence[str]) -> None:
    """Refuse, before a long run, what cannot be exported after it.

    Parameters
    ----------
    names : sequence of str
        Kinds of exports.

    Raises
    ------
    ConfigError
        If there is no such kind.
    MissingExtraError
        If it needs a package that is not there.
    """
    for name in names:
        if name not in KINDS:
            raise ConfigError(f"--export {name}: no such format; known: {', '.join(KINDS)}")
    if "mesh" in names:
        load_open3d()


def export(
    names: Sequence[str],
    material: Material,
    folder: Path,
    on_written: Callable[[str], None] | None = None,
) -> list[str]:
    """Write exports, each file whole or not at all.

    Parameters
    ----------
    names : sequence of str
        Kinds of exports; see `KINDS`.
    material : Material
        At least one pose.
    folder : pathlib.Path
        Where to; it must exist.
    on_written : callable, optional
        Told the name of each file once it is there.

    Returns
    -------
    list of str
        Names of the files, relative to the folder.

    Raises
    ------
    OutputError
        If a file cannot be written; the others are.
    """
    written: list[str] = []
    unwritten = Unwritten()
    for name in dict.fromkeys(names):
        for file, content in KINDS[name](material).items():
            with unwritten.noted():
                output_folder((folder / file).parent)
                write_atomically(folder / file, content)
                written.append(file)
                if on_written is not None:
                    on_written(file)
    unwritten.check()
    return written


def _edges(material: Material) -> dict[str, str | bytes]:
    return {_EDGES: _edges_by_direction(material.edges)}


def _kitti(material: Material) -> dict[str, str | bytes]:
    poses, times = to_kitti(material.trajectory)
    return {"kitti_poses.txt": poses, "kitti_times.txt": times}


def _euroc(material: Material) -> dict[str, str | bytes]:
    return {"euroc.csv": to_euroc(material.trajectory)}


def _colmap(material: Material) -> dict[str, str | bytes]:
    points = material.edges.thinned(_STARTING_POINTS)
    names, folder = image_names(material.source, material.indices, material.trajectory.stamps)
    files = to_colmap(material.trajectory, material.source.camera, points, names, folder)
    return {f"colmap/{name}": content for name, content in files.items()}


def _nerfstudio(material: Material) -> dict[str, str | bytes]:
    points = material.edges.thinned(_STARTING_POINTS)
    grey = np.repeat(points.grey[:, None], 3, axis=1)
    names, _ = image_names(material.source, material.indices, material.trajectory.stamps)
    return {
        f"nerfstudio/{_EDGES}": to_ply(points.points, grey, comment="edvo edges"),
        "nerfstudio/transforms.json": to_nerfstudio(
            material.trajectory, material.source.camera, _EDGES, names
        ),
    }


def _mesh(material: Material) -> dict[str, str | bytes]:
    return {"mesh.ply": fuse(material.source, material.indices, material.trajectory.poses)}


def _edges_by_direction(edges: EdgePoints) -> bytes:
    colours = np.rint(255 * direction_colours(edges.gradients)).astype(np.uint8)
    return to_ply(edges.points, colours, comment="edvo edges, coloured by gradient direction")


KINDS: Mapping[str, Callable[[Material], dict[str, str | bytes]]] = {
    "edges": _edges,
    "kitti": _kitti,
    "euroc": _euroc,
    "colmap": _colmap,
    "nerfstudio": _nerfstudio,
    "mesh": _mesh,
}
"""Kinds of exports by name; each makes files by their names."""

FILES: Mapping[str, Sequence[str]] = {
    "edges": (_EDGES,),
    "kitti": ("kitti_poses.txt", "kitti_times.txt"),
    "euroc": ("euroc.csv",),
    "colmap": ("colmap/cameras.txt", "colmap/images.txt", "colmap/points3D.txt"),
    "nerfstudio": (f"nerfstudio/{_EDGES}", "nerfstudio/transforms.json"),
    "mesh": ("mesh.ply",),
}
"""What each kind writes, relative to the folder."""
