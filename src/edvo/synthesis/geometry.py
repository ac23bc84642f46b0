"""From a scene's shapes to the arrays that the renderer hits, at any instant."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from edvo.errors import MissingExtraError, SceneError
from edvo.synthesis import kernels
from edvo.synthesis.scene import Box, Cylinder, Mesh, Panel, Part, Scene, Shape, Strip, Walk
from edvo.synthesis.spline import ClosedSpline

F64 = NDArray[np.float64]
_MOST_PARTS = 8  # how deep parts may hold parts
_KINDS = {
    "checker": kernels.CHECKER,
    "noise": kernels.NOISE,
    "tiles": kernels.TILES,
    "bricks": kernels.BRICKS,
    "books": kernels.BOOKS,
    "wood": kernels.WOOD,
    "text": kernels.TEXT,
}


class _Walker:
    """A `Walk` of the scene: the shift of what it moves, over time."""

    def __init__(self, walk: Walk, T_world_parent: F64, at: tuple[float, float, float]) -> None:
        self._walk = walk
        self._spline = ClosedSpline(np.array(walk.path), closed=walk.closed)
        self._T_world_parent = T_world_parent
        self._at = np.array(at)

    def at(self, t: float) -> F64:
        """Give the 4x4 that takes what moves from its place in the file to that of time t."""
        way, _ = self._spline.at(self._walk.start + self._walk.speed * t)
        angle = np.radians(self._walk.turn * t)
        local = np.eye(4)
        local[:3, :3] = _turn(angle, 2)
        local[:3, 3] = way + self._at - local[:3, :3] @ self._at
        moved: F64 = self._T_world_parent @ local @ np.linalg.inv(self._T_world_parent)
        return moved


@dataclass
class _Heap:
    """Primitives while they are collected."""

    kind: list[int] = field(default_factory=list)
    shape: list[F64] = field(default_factory=list)
    grain: list[F64] = field(default_factory=list)
    corner: list[F64] = field(default_factory=list)
    surface: list[int] = field(default_factory=list)
    thing: list[int] = field(default_factory=list)
    material: list[int] = field(default_factory=list)
    walker: list[int] = field(default_factory=list)
    walkers: list[_Walker] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    surfaces: int = 0


class World:
    """The primitives of a scene and the tree over them.

    Parameters
    ----------
    scene : Scene
        What to build.

    Raises
    ------
    SceneError
        For a mesh that cannot be read, parts that hold themselves, or a walk inside a walk.
    MissingExtraError
        For a mesh file without the extra that reads it.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        heap = _Heap()
        self._materials = list(scene.materials)
        for shape in scene.shapes:
            self._add(heap, shape, np.eye(4), -1, 0)
        self.things = tuple(heap.names)
        self.paint = self._paint()
        materials = scene.materials.values()
        #: (K,) reflectance for a depth camera's pattern; -1 for the mean of the albedo.
        self.infrared = np.array([-1.0 if m.infrared is None else m.infrared for m in materials])
        self._walkers = heap.walkers
        self._walker = np.array(heap.walker, np.int32)
        self._moving = np.flatnonzero(self._walker >= 0)
        self._corner = np.array(heap.corner)
        count = len(heap.kind)
        kind, shape_rows = np.array(heap.kind, np.int32), np.array(heap.shape)
        low, high = _bounds(kind, shape_rows, self._corner)
        node, link = np.zeros((2 * count, 6)), np.zeros((2 * count, 2), np.int32)
        order = np.zeros(count, np.int32)
        used = kernels.build_tree(low, high, node, link, order)
        self._home = kernels.Solids(
            kind,
            shape_rows,
            np.array(heap.grain),
            np.array(heap.surface, np.int32),
            np.array(heap.thing, np.int32),
            np.array(heap.material, np.int32),
            node[:used].copy(),
            link[:used].copy(),
            order,
        )

    def at(self, t: float) -> kernels.Solids:
        """Give the primitives where they are at ``t`` seconds.

        Parameters
        ----------
        t : float
            Seconds from the start.

        Returns
        -------
        kernels.Solids
            Ready to be hit; to be read only.
        """
        if len(self._moving) == 0:
            return self._home
        shape, grain = self._home.shape.copy(), self._home.grain.copy()
        corner = self._corner.copy()
        for k, walker in enumerate(self._walkers):
            rows = np.flatnonzero(self._walker == k)
            _move(walker.at(t), self._home.kind, shape, grain, corner, rows)
        low, high = _bounds(self._home.kind, shape, corner)
        node = self._home.node.copy()
        kernels.refit_tree(low, high, node, self._home.link, self._home.order)
        return self._home._replace(shape=shape, grain=grain, node=node)

    def _add(self, heap: _Heap, shape: Shape, T_world_parent: F64, walker: int, level: int) -> None:
        """Collect a shape, its copies and what it is made of."""
        if level > _MOST_PARTS:
            raise SceneError(f"{self.scene.name}: parts hold themselves; break the circle")
        if shape.walk is not None:
            if walker >= 0:
                raise SceneError(f"{self.scene.name}: a walk inside a walk; keep the outer one")
            heap.walkers.append(_Walker(shape.walk, T_world_parent, shape.at))
            walker = len(heap.walkers) - 1
        count = 1 if shape.repeat is None else shape.repeat.count
        for copy in range(count):
            T_parent_shape = np.eye(4)
            turn = _turn(np.radians(shape.yaw), 2) @ _turn(np.radians(shape.pitch), 1)
            T_parent_shape[:3, :3] = turn @ _turn(np.radians(shape.roll), 0)
            T_parent_shape[:3, 3] = shape.at
            if shape.repeat is not None:
                extra = _turn(np.radians(shape.repeat.turn * copy), 2)
                T_parent_shape[:3, :3] = extra @ T_parent_shape[:3, :3]
                T_parent_shape[:3, 3] += np.array(shape.repeat.step) * copy
            T_world_shape = T_world_parent @ T_parent_shape
            if isinstance(shape, Part):
                for inner in self.scene.parts[shape.name]:
                    self._add(heap, inner, T_world_shape, walker, level + 1)
                continue
            start = len(heap.kind)
            self._collect(heap, shape)
            added = range(start, len(heap.kind))
            heap.material += [self._materials.index(shape.material)] * len(added)
            heap.thing += [len(heap.names)] * len(added)
            heap.walker += [walker] * len(added)
            heap.names.append(shape.shape)
            rows = np.array(added)
            new_shape, new_grain = np.array(heap.shape[start:]), np.array(heap.grain[start:])
            new_corner = np.array(heap.corner[start:])
            kinds = np.array(heap.kind[start:])
            _move(T_world_shape, kinds, new_shape, new_grain, new_corner, rows - start)
            heap.shape[start:], heap.grain[start:] = list(new_shape), list(new_grain)
            heap.corner[start:] = list(new_corner)

    def _collect(self, heap: _Heap, shape: Shape) -> None:
        """Collect the primitives of one solid in its own frame."""
        if isinstance(shape, Box):
            x, y, z = shape.size
            low = np.array([-x / 2, -y / 2, 0.0])
            ex, ey, ez = np.diag([x, y, z])
            for origin, a, b in (
                (low, ex, ez),
                (low + ey, ex, ez),
                (low, ey, ez),
                (low + ex, ey, ez),
                (low, ex, ey),
                (low + ez, ex, ey),
            ):
                _patch(heap, origin, a, b)
        elif isinstance(shape, Panel):
            _patch(heap, np.array(shape.corner), np.array(shape.along), np.array(shape.up))
        elif isinstance(shape, Strip):
            travelled = 0.0
            for here, there in zip(shape.points, shape.points[1:], strict=False):
                along = np.array([there[0] - here[0], there[1] - here[1], 0.0])
                up = np.array([0.0, 0.0, shape.top - shape.bottom])
                _patch(heap, np.array([*here, shape.bottom]), along, up, shift=travelled)
                travelled += float(np.linalg.norm(along))
        elif isinstance(shape, Cylinder):
            heap.kind.append(kernels.CYLINDER)
            row = [0, 0, 0, shape.radius, 0, 0, 1, shape.height, 1, 0, 0, 0]
            heap.shape.append(np.array(row, float))
            heap.grain.append(np.zeros(8))
            end = np.array([0.0, 0.0, shape.height])
            heap.corner.append(np.array([np.zeros(3), end, end, end]))
            heap.surface.append(heap.surfaces)
            heap.surfaces += 1
        elif isinstance(shape, Mesh):
            vertices, faces = self._triangles(shape)
            for face in faces:
                _triangle(heap, *(vertices[face] * shape.scale))
            heap.surfaces += 1

    def _triangles(self, mesh: Mesh) -> tuple[F64, NDArray[np.int64]]:
        """Give the vertices and faces of a mesh, out of its file where it has one."""
        if mesh.file is None:
            return np.array(mesh.vertices), np.array(mesh.faces)
        try:
            import trimesh  # type: ignore[import-not-found,import-untyped,unused-ignore]
        except ImportError as error:
            raise MissingExtraError(
                f"reading {mesh.file} needs trimesh: pip install 'edvo[mesh]'"
            ) from error
        path = Path(self.scene.folder) / mesh.file
        try:
            loaded: Any = trimesh.load(path, force="mesh")
            vertices = np.array(loaded.vertices, np.float64)
            faces = np.array(loaded.faces, np.int64)
        except Exception as error:  # trimesh raises what its many readers raise
            reason = " ".join(str(error).split()) or type(error).__name__
            raise SceneError(f"cannot read mesh {path}: {reason}") from error
        if len(faces) == 0:
            raise SceneError(f"mesh {path} has no triangles; give another file")
        return vertices, faces

    def _paint(self) -> kernels.Paint:
        """Give the materials as arrays."""
        entries = list(self.scene.materials.values())
        textures = [m.texture for m in entries]
        joints = [0.0 if x is None else x.joint for x in textures]
        sizes = [(1.0, 1.0) if x is None else x.size for x in textures]
        return kernels.Paint(
            np.array([m.albedo for m in entries], float),
            np.array([(0, 0, 0) if x is None else x.albedo for x in textures], float),
            np.array([kernels.PLAIN if x is None else _KINDS[x.kind] for x in textures], np.int32),
            np.array([(*s, j, 0.0) for s, j in zip(sizes, joints, strict=True)], float),
            np.array([1 if x is None else x.octaves for x in textures], np.int32),
            np.array([0 if x is None else x.hue for x in textures], np.int32),
            np.array([0 if x is None else x.seed for x in textures], np.int32),
            np.array([(m.gloss, m.shininess, m.glow) for m in entries], float),
        )


def _turn(angle: float, axis: int) -> F64:
    """Give the rotation matrix about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


def _dual(origin: F64, a: F64, b: F64) -> F64:
    """Give plane and dual vectors of a parallelogram as a row of `kernels.Solids.shape`."""
    n = np.cross(a, b)
    square = n @ n
    u, v = np.cross(b, n) / square, np.cross(n, a) / square
    n = n / np.sqrt(square)
    return np.concatenate([n, [n @ origin], u, [u @ origin], v, [v @ origin]])


def _patch(heap: _Heap, origin: F64, a: F64, b: F64, shift: float = 0.0) -> None:
    """Collect a parallelogram; its texture starts ``shift`` metres before its corner."""
    row = _dual(origin, a, b)
    heap.kind.append(kernels.PATCH)
    heap.shape.append(row)
    grain = np.concatenate([row[4:8] * np.linalg.norm(a), row[8:12] * np.linalg.norm(b)])
    grain[3] -= shift
    heap.grain.append(grain)
    heap.corner.append(np.array([origin, origin + a, origin + b, origin + a + b]))
    heap.surface.append(heap.surfaces)
    heap.surfaces += 1


def _triangle(heap: _Heap, p: F64, q: F64, r: F64) -> None:
    """Collect a triangle; a sliver without area is left out."""
    if np.linalg.norm(np.cross(q - p, r - p)) < 1e-14:
        return
    row = _dual(p, q - p, r - p)
    heap.kind.append(kernels.TRIANGLE)
    heap.shape.append(row)
    # Texture is cast along the axis that the face is turned to most.
    side = int(np.argmax(np.abs(row[:3])))
    grain = np.zeros(8)
    grain[0 if side != 0 else 1], grain[6 if side != 2 else 5] = 1.0, 1.0
    heap.grain.append(grain)
    heap.corner.append(np.array([p, q, r, r]))
    heap.surface.append(heap.surfaces)


def _move(
    T: F64,
    kind: NDArray[np.int32],
    shape: F64,
    grain: F64,
    corner: F64,
    rows: NDArray[np.int64],
) -> None:
    """Move some primitives in place by a rigid motion."""
    if len(rows) == 0:
        return
    R, shift = T[:3, :3], T[:3, 3]
    corner[rows] = corner[rows] @ R.T + shift
    flat = rows[kind[rows] != kernels.CYLINDER]
    for table, columns in ((shape, (0, 4, 8)), (grain, (0, 4))):
        for c in columns:
            # f(p) = g . p - g0, moved: f(T^-1 p).
            table[flat, c : c + 3] = table[flat, c : c + 3] @ R.T
            table[flat, c + 3] += table[flat, c : c + 3] @ shift
    round_ = rows[kind[rows] == kernels.CYLINDER]
    shape[round_, 0:3] = shape[round_, 0:3] @ R.T + shift
    for c in (4, 8):
        shape[round_, c : c + 3] = shape[round_, c : c + 3] @ R.T


def _bounds(kind: NDArray[np.int32], shape: F64, corner: F64) -> tuple[F64, F64]:
    """Give lower and upper corners (P, 3), a hair wider than the primitives."""
    axis = shape[:, 4:7]
    spread = np.where(
        (kind == kernels.CYLINDER)[:, None],
        shape[:, 3:4] * np.sqrt(np.clip(1.0 - axis**2, 0.0, 1.0)),
        0.0,
    )
    return corner.min(1) - spread - 1e-7, corner.max(1) + spread + 1e-7
