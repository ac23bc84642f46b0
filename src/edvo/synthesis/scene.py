"""Scenes as data: boxes, panels, strips, cylinders and meshes, in YAML.

The world has z up; lengths are metres and, in the files only, angles are degrees. A file holds
``about``, ``materials`` (name to albedo, texture, gloss), ``parts`` (name to a list of shapes, to
be placed several times), ``shapes``, ``lights``, ``background`` and ``camera`` (the path that
trajectories follow). The scenes that come with the package are in the folder ``scenes``.
"""

from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from edvo.errors import SceneError
from edvo.plain_yaml import read_plain
from edvo.synthesis.light import DirectionalLight, LightState, PointLight

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1)]
Vec2 = tuple[Number, Number]
Vec3 = tuple[Number, Number, Number]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Texture(_Entry):
    """A procedural texture: where a surface takes the other of its two albedos.

    Attributes
    ----------
    kind : str
        ``checker``, ``noise`` (Perlin), ``tiles`` (cells of random grey), ``bricks`` (joints),
        ``books`` (spines in rows), ``wood`` or ``text`` (lines of print).
    size : 2 positive floats
        Metres: of a field, of the largest noise wave, of a tile, a brick, a spine (width, height
        of a row), a ring, or (width of a letter, height of a line).
    albedo : 3 floats from 0 to 1
        The other albedo.
    octaves : int
        Of noise and tiles.
    hue : bool
        Draw red, green and blue each on its own.
    joint : positive float
        Metres, of bricks.
    seed : int
        Another seed, another pattern.
    """

    kind: Literal["checker", "noise", "tiles", "bricks", "books", "wood", "text"]
    size: tuple[Positive, Positive]
    albedo: tuple[Share, Share, Share] = (0.0, 0.0, 0.0)
    octaves: Annotated[int, Field(ge=1, le=8)] = 1
    hue: bool = False
    joint: Positive = 0.01
    seed: int = 0


class Material(_Entry):
    """What a surface is made of.

    Attributes
    ----------
    albedo : 3 floats from 0 to 1
        Share of light given back: red, green, blue.
    texture : Texture, optional
        Plain without.
    gloss : float
        Strength of the Blinn-Phong highlight.
    shininess : float
        Its exponent.
    glow : float
        Light of its own, as the radiance of a white surface.
    infrared : float, optional
        Share of a depth camera's infrared pattern that is scattered back; the mean of the albedo
        by default. Screens and polished black plastics mirror it away: 0.01 or less.
    """

    albedo: tuple[Share, Share, Share]
    texture: Texture | None = None
    gloss: Annotated[float, Field(ge=0)] = 0.0
    shininess: Positive = 30.0
    glow: Annotated[float, Field(ge=0)] = 0.0
    infrared: Share | None = None


class Repeat(_Entry):
    """Several copies of a shape, each further by a step."""

    count: Annotated[int, Field(ge=1, le=10_000)]
    step: Vec3
    turn: Number = 0.0


class Walk(_Entry):
    """A way that a thing goes by itself.

    Attributes
    ----------
    path : at least 2 points
        Control points of a closed spline; what moves is shifted by it.
    speed : float
        Metres per second.
    start : float
        Metres along the path at time 0.
    turn : float
        Degrees per second about the vertical through ``at``.
    closed : bool
        False goes there and back.
    """

    path: Annotated[tuple[Vec3, ...], Field(min_length=2)]
    speed: Number = 1.0
    start: Number = 0.0
    turn: Number = 0.0
    closed: bool = True


class _Placed(_Entry):
    """A shape, built at the origin, rolled (x), pitched (y), yawed (z), then put ``at``."""

    at: Vec3 = (0.0, 0.0, 0.0)
    yaw: Number = 0.0
    pitch: Number = 0.0
    roll: Number = 0.0
    repeat: Repeat | None = None
    walk: Walk | None = None


class _Solid(_Placed):
    material: str


class Box(_Solid):
    """A box of ``size`` (x, y, z); its origin is the middle of its bottom."""

    shape: Literal["box"]
    size: tuple[Positive, Positive, Positive]


class Panel(_Solid):
    """A flat parallelogram from one corner along two sides."""

    shape: Literal["panel"]
    corner: Vec3 = (0.0, 0.0, 0.0)
    along: Vec3
    up: Vec3

    @model_validator(mode="after")
    def _has_area(self) -> "Panel":
        a, b = self.along, self.up
        cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
        if sum(c * c for c in cross) <= 1e-16:
            raise ValueError("along and up span no area")
        return self


class Strip(_Solid):
    """A folded screen: upright panels over a polyline in the plane, from bottom to top."""

    shape: Literal["strip"]
    points: Annotated[tuple[Vec2, ...], Field(min_length=2)]
    bottom: Number = 0.0
    top: Number

    @model_validator(mode="after")
    def _has_area(self) -> "Strip":
        if self.top <= self.bottom:
            raise ValueError("top must be above bottom")
        if any(a == b for a, b in zip(self.points, self.points[1:], strict=False)):
            raise ValueError("two neighbouring points are the same")
        return self


class Cylinder(_Solid):
    """A closed cylinder that stands on its origin."""

    shape: Literal["cylinder"]
    radius: Positive
    height: Positive


class Mesh(_Solid):
    """Triangles: from a file (needs the extra ``edvo[mesh]``) or given here.

    Attributes
    ----------
    file : str, optional
        OBJ, PLY, STL, GLB, ...; relative to the scene's file.
    vertices, faces : optional
        In place of a file.
    scale : float
        Metres per unit.
    """

    shape: Literal["mesh"]
    file: str | None = None
    vertices: tuple[Vec3, ...] = ()
    faces: tuple[tuple[int, int, int], ...] = ()
    scale: Positive = 1.0

    @model_validator(mode="after")
    def _has_triangles(self) -> "Mesh":
        if (self.file is None) == (not self.faces):
            raise ValueError("give either file or vertices and faces")
        if any(not 0 <= i < len(self.vertices) for face in self.faces for i in face):
            raise ValueError("a face names a vertex that is not there")
        return self


class Part(_Placed):
    """Shapes defined once under ``parts``, placed here."""

    shape: Literal["part"]
    name: str


Shape = Annotated[
    Box | Panel | Strip | Cylinder | Mesh | Part,
    Field(discriminator="shape"),
]


class _Directional(_Entry):
    direction: Vec3
    intensity: Annotated[float, Field(ge=0)]
    angle: Annotated[float, Field(ge=0, lt=80)] = 0.0
    shadows: bool = False

    @model_validator(mode="after")
    def _has_direction(self) -> "_Directional":
        if not any(self.direction):
            raise ValueError("the direction is zero")
        return self


class _Point(_Entry):
    position: Vec3
    intensity: Annotated[float, Field(ge=0)]
    radius: Annotated[float, Field(ge=0)] = 0.0
    shadows: bool = False


class Lights(_Entry):
    """The lamps of a scene; see `edvo.synthesis.light`. The angle is in degrees here."""

    ambient: Annotated[float, Field(ge=0)] = 0.5
    directional: tuple[_Directional, ...] = ()
    point: tuple[_Point, ...] = ()

    def state(self) -> LightState:
        """Give the light as the renderer takes it."""
        return LightState(
            self.ambient,
            tuple(
                DirectionalLight(
                    x.direction, x.intensity, x.angle * 0.017453292519943295, x.shadows
                )
                for x in self.directional
            ),
            tuple(PointLight(x.position, x.intensity, x.radius, x.shadows) for x in self.point),
        )


class CameraPath(_Entry):
    """Where a camera is led through the scene.

    Attributes
    ----------
    points : at least 2 points
        Control points of a smooth curve, metres.
    targets : as many points
        What is looked at, there.
    closed : bool
        Whether the path is a loop; else it goes there and back.
    centre, radius, height
        Of the orbit round the scene's main thing.
    speed : float
        Metres per second that suit the scene.
    """

    points: Annotated[tuple[Vec3, ...], Field(min_length=2)]
    targets: Annotated[tuple[Vec3, ...], Field(min_length=2)]
    closed: bool = False
    centre: Vec3 = (0.0, 0.0, 0.0)
    radius: Positive = 2.0
    height: Number = 1.0
    speed: Positive = 0.2

    @model_validator(mode="after")
    def _pairs(self) -> "CameraPath":
        if len(self.points) != len(self.targets):
            raise ValueError("as many targets as points are needed")
        for point, target in zip(self.points, self.targets, strict=True):
            if point[:2] == target[:2]:
                raise ValueError("a target right above or below its point has no upright view")
        return self


class Scene(_Entry):
    """A scene as read from its file."""

    name: str = ""
    about: str = ""
    background: tuple[Share, Share, Share] = (0.0, 0.0, 0.0)
    materials: dict[str, Material]
    parts: dict[str, tuple[Shape, ...]] = {}
    shapes: Annotated[tuple[Shape, ...], Field(min_length=1)]
    lights: Lights = Lights()
    camera: CameraPath
    folder: str = "."

    @model_validator(mode="after")
    def _known_names(self) -> "Scene":
        for shape in (*self.shapes, *(s for part in self.parts.values() for s in part)):
            if isinstance(shape, Part):
                if shape.name not in self.parts:
                    known = ", ".join(self.parts) or "none"
                    raise ValueError(f"part {shape.name!r} is not defined (there are: {known})")
            elif shape.material not in self.materials:
                known = ", ".join(self.materials)
                raise ValueError(f"material {shape.material!r} is not defined (there are: {known})")
        return self

    @classmethod
    def from_dict(cls, data: Any, *, where: str = "scene", folder: str = ".") -> "Scene":
        """Check a scene that is given as plain data.

        Parameters
        ----------
        data : dict
            As in a file.
        where : str
            What the error message calls it.
        folder : str
            Where mesh files are looked for.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            Naming the first entry that cannot be.
        """
        if not isinstance(data, dict):
            raise SceneError(f"{where}: no scene; it needs materials, shapes and camera")
        try:
            return cls.model_validate({"name": where, **data, "folder": folder})
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(str(part) for part in first["loc"]) or "scene"
            raise SceneError(f"{where}: {place}: {first['msg']}; mend this entry") from error


def scene_names() -> list[str]:
    """List the scenes that come with the package."""
    folder = resources.files("edvo.synthesis") / "scenes"
    return sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".yaml"))


def load_scene(scene: str | Path) -> Scene:
    """Read a scene.

    Parameters
    ----------
    scene : str or path
        A name of `scene_names`, or a YAML file. A file with ``like: NAME`` starts from the
        packaged scene of that name; its own entries then replace whole entries of it.

    Returns
    -------
    Scene
        The scene.

    Raises
    ------
    SceneError
        If there is none of that name, or the file cannot be a scene.
    """
    path = Path(scene)
    if path.suffix.lower() in (".yaml", ".yml"):
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "no text file"
            raise SceneError(f"cannot read {path}: {reason}; give a scene in YAML") from error
        data, folder = _parse(text, str(path)), str(path.parent)
    else:
        data, folder = _packaged(str(scene)), "."
    while isinstance(data, dict) and "like" in data:
        own = {key: value for key, value in data.items() if key != "like"}
        data = {**_packaged(str(data["like"])), **own}
    return Scene.from_dict(data, where=str(scene), folder=folder)


def _packaged(name: str) -> dict[str, Any]:
    """Give the data of a scene that comes with the package."""
    if name not in scene_names():
        raise SceneError(
            f"no scene {name!r}; there are {', '.join(scene_names())}, "
            "or give a YAML file of your own"
        )
    file = resources.files("edvo.synthesis") / "scenes" / f"{name}.yaml"
    data: dict[str, Any] = _parse(file.read_text(encoding="utf-8"), name)
    return data


def _parse(text: str, where: str) -> Any:
    """Read YAML, with an error that names the file."""
    try:
        return read_plain(text)
    except yaml.YAMLError as error:
        raise SceneError(f"{where}: not YAML: {' '.join(str(error).split())}") from error
