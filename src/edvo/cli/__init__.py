"""The command line: thin commands, no numerics."""

import os
import sys

INTERRUPTED = 130  # what a shell says of a program that Ctrl-C ended


def main() -> None:
    """Run the command that ``sys.argv`` names, and exit with its status.

    Nothing heavy is imported before a command asks for it, so that ``--help`` is instant.
    """
    try:
        from edvo.cli.app import app

        try:
            app(prog_name="edvo")
        finally:
            # Here, since at exit it is too late to be quiet about a pipe that nobody reads.
            sys.stdout.flush()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
