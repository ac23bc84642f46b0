"""What commands there are, and what becomes of their errors."""

import logging
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from edvo.cli.commands.compare import compare
from edvo.cli.commands.demo import demo
from edvo.cli.commands.evaluate import evaluate
from edvo.cli.commands.fetch import fetch
from edvo.cli.commands.info import info
from edvo.cli.commands.live import live
from edvo.cli.commands.relight import relight
from edvo.cli.commands.reproduce import reproduce
from edvo.cli.commands.run import run
from edvo.cli.commands.synth import synth
from edvo.cli.commands.warmup import warmup
from edvo.cli.interrupt import exit_status
from edvo.cli.terminal import Notes
from edvo.errors import EdvoError


class Commands(TyperGroup):
    """Turns what goes wrong on purpose into one line and an exit status."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; `EdvoError` exits with 1, Ctrl-C with 130, SIGTERM with 143."""
        try:
            return super().invoke(ctx)
        except EdvoError as error:
            typer.echo(f"edvo: {error}", err=True)
            raise typer.Exit(1) from error
        except KeyboardInterrupt as interrupt:
            typer.echo("edvo: interrupted", err=True)
            raise typer.Exit(exit_status(interrupt)) from interrupt


logging.getLogger("edvo").addHandler(Notes(logging.WARNING))

app = typer.Typer(
    name="edvo",
    cls=Commands,
    help="RGB-D visual odometry from image edges, on a plain CPU.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from edvo import __version__

        typer.echo(f"edvo {__version__}")
        raise typer.Exit


@app.callback()
def edvo(
    version: Annotated[
        bool,
        typer.Option("--version", help="Show the version.", is_eager=True, callback=_version),
    ] = False,
) -> None:
    """RGB-D visual odometry from image edges, on a plain CPU."""


for _command in (  # in the order in which --help lists them
    run,
    live,
    info,
    evaluate,
    compare,
    demo,
    synth,
    relight,
    fetch,
    reproduce,
    warmup,
):
    app.command()(_command)
