"""How Sphinx builds the documentation: `make docs`."""

import os
import sys
from pathlib import Path

from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from edvo import __version__

# The compiled functions are documented, not run.
os.environ.setdefault("NUMBA_DISABLE_JIT", "1")

project = "edvo"
author = "the edvo authors"
release = version = __version__
copyright = author

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

myst_enable_extensions = ["amsmath", "dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3

napoleon_google_docstring = False
napoleon_numpy_docstring = True
napoleon_use_rtype = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 88

html_theme = "furo"
html_title = f"edvo {__version__}"


class CommandHelp(Directive):
    """What ``edvo COMMAND --help`` prints, so that the page cannot go stale."""

    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        from typer.testing import CliRunner

        from edvo.cli.app import app

        words = [*self.arguments, "--help"]
        shown = CliRunner().invoke(app, words, prog_name="edvo", terminal_width=88)
        if shown.exit_code:
            raise self.error(f"edvo {' '.join(words)} failed: {shown.output}")
        block = nodes.literal_block(text=shown.output.strip())
        block["language"] = "text"
        return [block]


def setup(app: Sphinx) -> None:
    """Register the directive."""
    sys.path.insert(0, str(Path(__file__).parent.parent / "src"))
    app.add_directive("command-help", CommandHelp)
