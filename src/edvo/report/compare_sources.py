"""What `edvo compare` takes as a source: recordings, folders of them, and rendered scenes."""

from collections.abc import Callable, Sequence
from pathlib import Path

from edvo.datasets import Source, open_source
from edvo.datasets.known_cameras import find_camera
from edvo.datasets.registry import recognise
from edvo.errors import DatasetError, SceneError
from edvo.synthesis.relighting import Relighter, RelitSource
from edvo.synthesis.sequence import DEFAULT_CAMERA, SyntheticSource, make_recipe

SCENE_PREFIX = "synth:"
"""Before the name of a scene that is rendered instead of read."""

SCENE_FRAMES = 90
"""Frames of a scene where no other number is asked for: three seconds."""


def open_any(
    text: str,
    *,
    format: str | None = None,
    camera: str | None = None,
    frames: int = SCENE_FRAMES,
    light: str | None = None,
    severity: float = 0.5,
    seed: int = 0,
    open_path: Callable[..., Source] = open_source,
) -> Source:
    """Open a recording or a scene, under another light if one is asked for.

    Parameters
    ----------
    text : str
        A path, or the name of a scene after `SCENE_PREFIX`.
    format, camera : str, optional
        As for `edvo.datasets.open_source`; the camera is also that of a scene.
    frames : int
        Length of a scene.
    light : str, optional
        Model of light, see `edvo.synthesis.relighting.Relighter`; as it was by default.
    severity : float
        How hard the light changes.
    seed : int
        Of scene and light.
    open_path : callable
        Opens a path with ``format`` and ``camera``.

    Returns
    -------
    Source
        Its frames.

    Raises
    ------
    DatasetError, CameraError, SceneError
        If it cannot be.
    """
    source: Source
    if text.startswith(SCENE_PREFIX):
        lens = DEFAULT_CAMERA if camera is None else find_camera(camera)
        scene = text.removeprefix(SCENE_PREFIX)
        source = SyntheticSource(make_recipe(scene, frames=frames, camera=lens, seed=seed))
    else:
        source = open_path(Path(text), format=format, camera=camera)
    if light is None:
        return source
    return RelitSource(source, Relighter(light, severity=severity, seed=seed))


def find_sources(
    texts: Sequence[str], *, format: str | None = None, note: Callable[[str], None]
) -> list[str]:
    """Tell the recordings among some paths, as a shell's pattern gives them.

    Parameters
    ----------
    texts : sequence of str
        Paths and scenes. A folder that is no recording stands for the recordings in it.
    format : str, optional
        Format of all of them; found out by default.
    note : callable
        Told, in a line each, what is no recording and left out.

    Returns
    -------
    list of str
        At least one, each once.

    Raises
    ------
    DatasetError
        If a path does not exist, or none is a recording.
    SceneError
        If a scene has no name.
    """
    found: list[str] = []
    for text in texts:
        if text == SCENE_PREFIX:
            raise SceneError(f"{text}: no scene; give its name behind, see edvo synth --list")
        if text.startswith(SCENE_PREFIX):
            found.append(text)
            continue
        path = Path(text)
        if not path.exists():
            raise DatasetError(f"{text}: no such file or folder; check the path")
        if format is not None or recognise(path.absolute()) is not None:
            found.append(text)
            continue
        inside = _recordings_in(path)
        if not inside and len(texts) == 1:
            open_source(path)  # says what it is not
        if not inside:
            note(f"{text}: no known recording; left out")
        found += inside
    if not found:
        raise DatasetError(f"{', '.join(texts)}: no recording among them; give one at least")
    return list(dict.fromkeys(found))


def _recordings_in(path: Path) -> list[str]:
    if not path.is_dir():
        return []
    return [str(each) for each in sorted(path.iterdir()) if recognise(each.absolute()) is not None]
