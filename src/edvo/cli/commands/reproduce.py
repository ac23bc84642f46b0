"""Arguments and options of `edvo reproduce`."""

from pathlib import Path
from typing import Annotated

import typer

from edvo.cli.commands.options import Out


def reproduce(
    what: Annotated[
        list[str],
        typer.Argument(
            help="table1 table2 table3 fig2 fig3 fig5 fig6 fig7 fig8 fig9 fig10 fig11, or all.",
            metavar="WHAT...",
        ),
    ],
    out: Out = Path("edvo-reproduce"),
    data: Annotated[
        Path | None,
        typer.Option(
            help="Folder of recordings by their TUM names; synthetic scenes stand in for those "
            "that are missing.",
            metavar="DIR",
            envvar="EDVO_DATA",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer frames and repeats: minutes, rough figures.")
    ] = False,
    seed: Annotated[
        int, typer.Option(help="Of light, synthetic scenes and what is drawn.", min=0)
    ] = 0,
    max_frames: Annotated[
        int | None,
        typer.Option(help="Most frames of a recording; 1200, or 90 if quick.", min=45),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Also what is complete in DIR already.")
    ] = False,
) -> None:
    """Make tables and figures of the paper again, and hold its claims against them.

    Writes numbers (CSV) and pictures of each to DIR/NAME, and all of it with the published values
    beside to DIR/index.html and DIR/summary.md. The same command goes on where it was stopped.
    """
    from edvo.cli.reproduce import reproduce as body

    body(
        what,
        out,
        data=data,
        quick=quick,
        seed=seed,
        max_frames=max_frames,
        force=force,
    )
