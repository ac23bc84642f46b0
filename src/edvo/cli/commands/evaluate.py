"""Arguments and options of `edvo evaluate`."""

from pathlib import Path
from typing import Annotated

import typer

from edvo.cli.commands.options import AsJson


def evaluate(
    reference: Annotated[Path, typer.Argument(help="True poses, TUM format.")],
    estimate: Annotated[Path, typer.Argument(help="Estimated poses, TUM format.")],
    delta: Annotated[
        float | None,
        typer.Option(help="Span of the relative pose error; 1 by default.", metavar="SECONDS"),
    ] = None,
    frames: Annotated[
        Path | None,
        typer.Option(
            help="List of the frames that could have had a pose (rgb.txt, frames.csv), "
            "for the coverage.",
            metavar="FILE",
        ),
    ] = None,
    as_json: AsJson = False,
    plot: Annotated[
        Path | None, typer.Option(help="Draw both paths and the errors.", metavar="FILE.png")
    ] = None,
) -> None:
    """Compare a trajectory with the truth by the TUM protocol.

    Prints relative pose error, absolute trajectory error and coverage, and beside them the errors
    of an estimate that never moves.
    """
    from edvo.cli.evaluate import evaluate as body

    body(reference, estimate, delta=delta, frames=frames, as_json=as_json, plot=plot)
