"""The viewer's library, imported where it is used: 170 MB that most installations do without."""

import importlib
from typing import Any

from edvo.errors import MissingExtraError


def load_rerun() -> Any:
    """Import Rerun's logging library.

    Returns
    -------
    module
        ``rerun``, untyped.

    Raises
    ------
    MissingExtraError
        If it is not installed or does not load.
    """
    try:
        rerun = importlib.import_module("rerun")
        importlib.import_module("rerun.blueprint")
    except ImportError as error:
        raise MissingExtraError(
            f'the viewer needs rerun-sdk ({error}); pip install "edvo[view]"'
        ) from error
    if not hasattr(rerun, "RecordingStream"):  # another project has the name rerun too
        raise MissingExtraError(
            'the package "rerun" is not the viewer\'s; pip uninstall rerun, then '
            'pip install --force-reinstall "edvo[view]"'
        )
    return rerun
