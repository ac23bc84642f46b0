"""What the pictures of all experiments have in common."""

import io

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

NORMAL_COLOUR = "#4c6ef5"
ROBUST_COLOUR = "#c2255c"
PUBLISHED_COLOUR = "0.45"

_DPI = 110


def new_figure(width: float, height: float) -> Figure:
    """Make a figure that is drawn off-screen.

    Parameters
    ----------
    width, height : float
        Inches.

    Returns
    -------
    matplotlib.figure.Figure
        Empty.
    """
    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def tidy(axes: Axes) -> None:
    """Put a light grid behind the lines, and leave out the frame above and to the right.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        What to change.
    """
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def to_png(figure: Figure) -> bytes:
    """Draw a figure.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        What to draw.

    Returns
    -------
    bytes
        A PNG file, the same for the same figure.
    """
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()
