"""`edvo relight`."""

from contextlib import ExitStack
from pathlib import Path

from edvo.cli.terminal import Advance, note, progress, say
from edvo.synthesis.relight_folder import relight_folder
from edvo.synthesis.relight_models import LIGHT_MODELS


def list_models() -> None:
    """Say which light models there are."""
    width = max(map(len, LIGHT_MODELS))
    for name, model in LIGHT_MODELS.items():
        say(f"{name.ljust(width)}  {model.summary}, {model.frequency:g} Hz")


def relight(
    source: Path,
    target: Path,
    *,
    model: str,
    severity: float,
    frequency: float | None,
    seed: int,
    jumps: list[float] | None,
    camera: str | None,
    force: bool,
) -> None:
    """Write a sequence once more under another light; see `edvo.cli.commands.relight`."""
    with ExitStack() as bars:
        advance: Advance | None = None

        def step(done: int, total: int) -> None:
            nonlocal advance
            if advance is None:
                advance = bars.enter_context(progress(f"relighting {source.name}", total))
            advance()

        result = relight_folder(
            source,
            target,
            model,
            severity=severity,
            frequency=frequency,
            seed=seed,
            jumps=jumps,
            camera=camera,
            force=force,
            progress=step,
        )
    for problem in result.problems:
        note(f"not relit: {problem}")
    say(f"{result.relit} images relit by {model} into {result.path}")
