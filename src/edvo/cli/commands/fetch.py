"""Arguments and options of `edvo fetch`."""

from pathlib import Path
from typing import Annotated

import typer


def fetch(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Sequences, such as fr1/xyz; none: list all.", metavar="NAME"),
    ] = None,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Folder for them.", metavar="DIR", envvar="EDVO_DATA"),
    ] = Path("edvo-data"),
    mirror: Annotated[
        str | None,
        typer.Option(help="Server to take archives from instead.", metavar="URL"),
    ] = None,
    checksum: Annotated[
        str | None,
        typer.Option(help="What the archive must have, whatever edvo knows.", metavar="SHA256"),
    ] = None,
    keep_archive: Annotated[
        bool, typer.Option("--keep-archive", help="Leave the archive beside the folder.")
    ] = False,
    list_: Annotated[
        bool, typer.Option("--list", help="Show sequences, sizes and licences.")
    ] = False,
) -> None:
    """Fetch public sequences: TUM RGB-D, ICL-NUIM, Bonn RGB-D Dynamic.

    Prints the folder of each. A download that broke off goes on where it was; what is complete is
    not fetched again.
    """
    from edvo.cli import fetch as body

    if list_ or not names:
        body.list_sequences()
        return
    body.fetch(names, out, mirror=mirror, checksum=checksum, keep_archive=keep_archive)
