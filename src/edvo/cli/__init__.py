"""The command line: thin commands, no numerics."""

import errno
import os
import sys

from edvo.cli.interrupt import exit_status, terminated_as_interrupted
from edvo.cli.streams import open_closed_streams

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def cannot_print(error: OSError) -> str:
    """Say what is wrong with standard output, and the mend."""
    return f"cannot print: {error.strerror or error}; send the output to where there is room"


def silence_output() -> None:
    """Send to nowhere what standard output still holds, so that it cannot fail once more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run the command that ``sys.argv`` names, and exit with its status.

    Nothing heavy is imported before a command asks for it, so that ``--help`` is instant.
    """
    open_closed_streams()
    try:
        from edvo.cli.app import app

        try:
            with terminated_as_interrupted():
                app(prog_name="edvo")
        finally:
            # Here, since at exit it is too late to be quiet about a pipe that nobody reads.
            sys.stdout.flush()
    except KeyboardInterrupt as interrupt:
        sys.exit(exit_status(interrupt))
    except BrokenPipeError:
        silence_output()
        sys.exit(1)
    except OSError as error:
        # Of what has a name the library tells itself; this is what the help is printed to.
        if error.errno not in _NO_ROOM or error.filename is not None:
            raise
        silence_output()
        sys.exit(f"edvo: {cannot_print(error)}")
