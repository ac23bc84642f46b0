"""How the viewer's window is laid out before anyone has touched it."""

from typing import Any

from edvo.report.viewer_library import load_rerun
from edvo.report.viewer_names import (
    DEPTH,
    EDGES,
    ERROR,
    FIT,
    IMAGE,
    ITERATIONS,
    KEYFRAMES,
    LOG,
    MAP,
    MATCHES,
    PATH,
    SAMPLES,
    STATE,
    TIME,
    TIMES,
    TRUTH,
    WORLD,
)

EYE = (-0.9, -1.9, -2.6)  # behind, above and left of the first camera, metres
LOOKED_AT = (0.0, 0.0, 1.5)


def layout(*, truth: bool, following: bool) -> Any:
    """Lay out the window.

    Parameters
    ----------
    truth : bool
        Whether there are errors to plot.
    following : bool
        Whether it shows the newest frame as it comes, else it plays from the start.

    Returns
    -------
    rerun.blueprint.Blueprint
    """
    rr = load_rerun()
    rrb = rr.blueprint
    # What is logged bit by bit is shown from the beginning up to now.
    so_far = rrb.VisibleTimeRanges(
        timeline=TIME,
        start=rrb.TimeRangeBoundary.infinite(),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    space = rrb.Spatial3DView(
        name="world: edge map, path, keyframes",
        origin=WORLD,
        contents=[f"+ {WORLD}/**", f"- {EDGES}", f"- {SAMPLES}", f"- {MATCHES}", f"- {DEPTH}/**"],
        overrides=dict.fromkeys((MAP, PATH, TRUTH, KEYFRAMES), so_far),
        eye_controls=rrb.EyeControls3D(position=EYE, look_target=LOOKED_AT, eye_up=(0, -1, 0)),
        line_grid=rrb.LineGrid3D(visible=False),
    )
    dim = {IMAGE: rr.EncodedImage.from_fields(opacity=0.5)}
    images = rrb.Vertical(
        rrb.Spatial2DView(
            name="edges by direction of gradient",
            origin=IMAGE,
            contents=[f"+ {IMAGE}", f"+ {EDGES}"],
            overrides=dim,
        ),
        rrb.Spatial2DView(
            name="matches; residual < 0 blue, 0 green, > 0 red",
            origin=IMAGE,
            contents=[f"+ {IMAGE}", f"+ {SAMPLES}", f"+ {MATCHES}"],
            overrides=dim,
        ),
        rrb.Spatial2DView(name="depth", origin=DEPTH, contents=[f"+ {DEPTH}"]),
    )
    plots = [("sigma (px), inliers", FIT), ("iterations", ITERATIONS), ("time (ms)", TIMES)]
    if truth:
        plots.insert(0, ("error over 1 s", ERROR))
    curves = [
        rrb.TimeSeriesView(name=name, origin=origin, plot_legend=rrb.Corner2D.LeftTop)
        for name, origin in plots
    ]
    words = rrb.Horizontal(
        rrb.StateTimelineView(name="status", origin=STATE),
        rrb.TextLogView(
            name="what happened",
            origin=LOG,
            columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
        ),
        column_shares=[2, 3],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(space, rrb.Horizontal(*curves), words, row_shares=[4.4, 2.2, 1.5]),
            images,
            column_shares=[2, 1],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline=TIME, play_state="following" if following else "playing"
        ),
    )
