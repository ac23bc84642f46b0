"""Fuse depth into a surface while the camera moves: a TSDF map by Open3D.

    pip install 'edvo[open3d]'
    python tsdf_fusion.py rgbd_dataset_freiburg1_xyz mesh.ply

Only frames whose pose may be trusted are fused: one wrong pose spoils a map for good. The loop is
the same for a camera; `edvo run SOURCE -o out --export mesh` does it after a run.
"""

import sys

import numpy as np
import open3d as o3d

import edvo

VOXEL_M = 0.01
FARTHEST_M = 4.0
TRUNCATION_VOXELS = 4.0


class Map:
    """A volume of signed distances that grows with what is seen.

    Parameters
    ----------
    camera : edvo.Camera
        Of the frames to come.
    """

    def __init__(self, camera: edvo.Camera) -> None:
        self.camera = camera
        self._pinhole = o3d.core.Tensor(np.ascontiguousarray(camera.matrix))
        number = o3d.core.float32
        self._grid = o3d.t.geometry.VoxelBlockGrid(
            ("tsdf", "weight", "color"),
            (number, number, number),
            ((1,), (1,), (3,)),
            VOXEL_M,
            block_resolution=8,
            block_count=10_000,
        )

    def add(self, frame: edvo.Frame, T_world_cam: np.ndarray) -> None:
        """Fuse a frame.

        Parameters
        ----------
        frame : edvo.Frame
            With registered depth.
        T_world_cam : ndarray, shape (4, 4)
            Its pose.
        """
        # Open3D's camera has no distortion, so the images must not have any either.
        grey = self.camera.undistort_image(frame.grey).astype(np.float32) / 255
        depth = self.camera.undistort_depth(frame.depth)
        colour = o3d.t.geometry.Image(np.repeat(grey[:, :, None], 3, axis=2))
        metres = o3d.t.geometry.Image(np.ascontiguousarray(depth))
        T_cam_world = o3d.core.Tensor(np.linalg.inv(T_world_cam))
        limits = (1.0, FARTHEST_M, TRUNCATION_VOXELS)  # a depth of 1 is a metre
        blocks = self._grid.compute_unique_block_coordinates(
            metres, self._pinhole, T_cam_world, *limits
        )
        self._grid.integrate(
            blocks, metres, colour, self._pinhole, self._pinhole, T_cam_world, *limits
        )

    def mesh(self) -> o3d.geometry.TriangleMesh:
        """Give the surface so far, without what only one frame has seen."""
        mesh = self._grid.extract_triangle_mesh(weight_threshold=1.5).to_legacy()
        mesh.compute_vertex_normals()
        return mesh


def main(recording: str, target: str, every: int = 3) -> None:
    """Track a recording and write its surface.

    Parameters
    ----------
    recording : str
        Whatever `edvo run` reads.
    target : str
        A mesh file: .ply, .obj, .stl.
    every : int
        Fuse each n-th frame: neighbouring ones show the same.
    """
    source = edvo.open_source(recording)
    odometry, world = edvo.Odometry(source.camera), Map(source.camera)
    fused = 0
    for index in range(len(source)):
        reading = source.read(index)
        if reading.frame is None:
            print(reading.problem, file=sys.stderr)
            continue
        tracked = odometry.track(reading.frame)
        if tracked.status is edvo.Status.TRACKED and index % every == 0:
            world.add(reading.frame, tracked.T_world_cam)
            fused += 1
    mesh = world.mesh()
    if not o3d.io.write_triangle_mesh(target, mesh):
        sys.exit(f"cannot write {target}")
    print(f"{target}: {len(mesh.triangles)} triangles of {fused} frames")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(f"usage: {sys.argv[0]} RECORDING MESH.ply")
    main(*sys.argv[1:])
