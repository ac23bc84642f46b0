"""The makers' packages, which are not installed with edvo."""

from importlib import import_module
from typing import Any

from edvo.errors import MissingExtraError


def load_package(module: str, extra: str, distribution: str | None = None) -> Any:
    """Import a maker's package.

    Parameters
    ----------
    module : str
        Its module.
    extra : str
        edvo's extra that brings it, named in the error; empty for none.
    distribution : str, optional
        What pip calls it, where there is no extra.

    Returns
    -------
    module
        The package.

    Raises
    ------
    MissingExtraError
        If it is not installed or does not load.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        wanted = f"'edvo[{extra}]'" if extra else distribution or module
        raise MissingExtraError(
            f"this camera needs {module}, which is not installed ({error}); pip install {wanted}"
        ) from error
    except ImportError as error:
        raise MissingExtraError(
            f"this camera needs {module}, which does not load: {error}; install what that names "
            "with the system's package manager"
        ) from error
