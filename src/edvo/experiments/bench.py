"""What the experiments work with: sequences, sizes, seed, progress."""

from collections.abc import Callable, Hashable, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numba
import numpy as np

from edvo import __version__
from edvo.camera import Camera
from edvo.datasets import open_source
from edvo.errors import DatasetError, EdvoError
from edvo.experiments.fingerprint import code_digest, recording_digest
from edvo.experiments.sequences import (
    PAPER_SEQUENCES,
    FrameMemory,
    Sequence,
    find_recordings,
    real_sequence,
    stand_in,
)
from edvo.synthesis.sequence import DEFAULT_CAMERA, make_recipe

Size = TypeVar("Size")
Made = TypeVar("Made")

_LIMITS = (1200, 90)  # frames of a recording, full and quick
_STAND_INS = (300, 90)  # frames of a synthetic sequence
_RENDERED = "sequences"


class Bench:
    """Gives the experiments what they need.

    Parameters
    ----------
    folder : path-like
        Where what is rendered is kept, in ``sequences/``.
    data : path-like, optional
        A folder of recordings; synthetic sequences alone without.
    quick : bool
        Whether a rough result soon is wanted.
    seed : int
        Of light, synthetic sequences and whatever else is drawn.
    limit : int, optional
        Most frames of a recording; 1200, or 90 if quick.
    stand_in_frames : int, optional
        Frames of a synthetic sequence; 300, or 90 if quick.
    camera : Camera
        Of synthetic sequences.
    render_again : bool
        Whether synthetic sequences are rendered even where they are complete in the folder.
    advance : callable, optional
        Told what is being done.

    Raises
    ------
    DatasetError
        If the data folder is missing or holds no recording.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        data: str | Path | None = None,
        quick: bool = False,
        seed: int = 0,
        limit: int | None = None,
        stand_in_frames: int | None = None,
        camera: Camera = DEFAULT_CAMERA,
        render_again: bool = False,
        advance: Callable[[str], None] | None = None,
    ) -> None:
        self.folder = Path(folder)
        self.quick = quick
        self.seed = seed
        self._limit = limit or self.count(*_LIMITS)
        self._stand_in_frames = stand_in_frames or self.count(*_STAND_INS)
        self._camera = camera
        self._render_again = render_again
        self._told = advance
        self._memory = FrameMemory()
        self._made: dict[str, Sequence] = {}
        self._remembered: dict[Hashable, Any] = {}
        self.notes: tuple[str, ...] = ()
        """Recordings that are not used, and why."""
        self._real: dict[str, Path] = {}
        recordings = {} if data is None else find_recordings(Path(data))
        for name, place in recordings.items():
            try:
                source = open_source(place)
                self._made[name] = real_sequence(name, source, self._limit, self._memory)
            except EdvoError as error:
                self.notes += (f"not used: {error}",)
            else:
                self._real[name] = source.path

    def count(self, full: Size, quick: Size) -> Size:
        """Choose by how long it may take.

        Parameters
        ----------
        full, quick : any
            What is used in a full run and in a quick one.

        Returns
        -------
        any
            One of them.
        """
        return quick if self.quick else full

    def advance(self, text: str) -> None:
        """Tell whoever watches what is being done.

        Parameters
        ----------
        text : str
            A few words.
        """
        if self._told is not None:
            self._told(text)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all sequences: the paper's, then the other real ones at hand."""
        return tuple(dict.fromkeys([*PAPER_SEQUENCES, *self._real]))

    def sequence(self, name: str) -> Sequence:
        """Give a sequence: the recording where there is one, else the synthetic one of its kind.

        Parameters
        ----------
        name : str
            One of the paper's, of `names`, or of a scene.

        Returns
        -------
        Sequence
            Not decoded or rendered before its frames are asked for.

        Raises
        ------
        DatasetError
            If there is no such sequence.
        SceneError
            If it is taken for a scene and there is none of that name.
        """
        if name not in self._made:
            if name not in PAPER_SEQUENCES and "/" in name:
                raise DatasetError(f"no sequence {name!r}; there are {', '.join(self.names)}")
            self._made[name] = self._render(name, PAPER_SEQUENCES.get(name, name))
        return self._made[name]

    def sequences(self, names: Iterable[str] | None = None) -> list[Sequence]:
        """Give several sequences.

        Parameters
        ----------
        names : iterable of str, optional
            Which; all by default.

        Returns
        -------
        list of Sequence
            In that order.
        """
        return [self.sequence(name) for name in (self.names if names is None else names)]

    def remember(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Do once what several experiments need.

        Parameters
        ----------
        key : hashable
            What it is called.
        make : callable
            Makes it, when it is first asked for.

        Returns
        -------
        any
            What was made.
        """
        if key not in self._remembered:
            self._remembered[key] = make()
        found: Made = self._remembered[key]
        return found

    def release(self) -> None:
        """Forget all frames in memory; they are read again when asked for."""
        self._memory.clear()

    def settings(self) -> dict[str, Any]:
        """Say in plain types what decides the results of every experiment.

        Returns
        -------
        dict
            The same for the same results; made of what JSON knows.
        """
        return {
            "edvo": __version__,
            "code": code_digest(),
            "numpy": np.__version__,
            "numba": numba.__version__,
            "opencv": cv2.__version__,
            "open3d": find_spec("open3d") is not None,
            "quick": self.quick,
            "seed": self.seed,
            "camera": self._camera.to_dict(),
            "sequences": {name: self.sequence(name).label for name in self.names},
            "recordings": {
                name: [recording_digest(place), self.sequence(name).camera.to_dict()]
                for name, place in self._real.items()
            },
        }

    def _render(self, name: str, scene: str) -> Sequence:
        recipe = make_recipe(
            scene, frames=self._stand_in_frames, camera=self._camera, seed=self.seed
        )
        size = f"{self._camera.width}x{self._camera.height}"
        code = code_digest("synthesis")
        folder = f"{scene}-{size}-{recipe.frames}-seed{self.seed}-{code}"
        return stand_in(
            name,
            recipe,
            self.folder / _RENDERED / folder,
            self._memory,
            paper=name in PAPER_SEQUENCES,
            again=self._render_again,
            advance=self.advance,
        )
