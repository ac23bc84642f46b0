"""`edvo info`."""

import json
from pathlib import Path
from typing import Any

from edvo.cli.compiling import compile_now
from edvo.cli.recording import open_recording
from edvo.cli.terminal import say
from edvo.config import Config
from edvo.datasets.inspection import examine
from edvo.datasets.inspection.delay import DEPTH_DELAY
from edvo.datasets.inspection.depth_range import DEPTH_RANGE
from edvo.datasets.inspection.repeats import REPEATED_DEPTH


def info(
    path: Path,
    *,
    camera: str | None,
    format: str | None,
    colour_topic: str | None,
    depth_topic: str | None,
    as_json: bool,
) -> None:
    """Say what would be assumed about a recording, and what looks wrong with it."""
    source = open_recording(
        path, format=format, camera=camera, colour_topic=colour_topic, depth_topic=depth_topic
    )
    described = source.describe()
    compile_now(Config())
    findings = examine(source)
    # A reader and a check may see the same.
    seen = [warning for finding in findings for warning in finding.warnings]
    described["warnings"] = list(dict.fromkeys([*described["warnings"], *seen]))
    if as_json:
        described["checks"] = {finding.check: finding.to_dict() for finding in findings}
        say(json.dumps(described, indent=2))
        return
    warnings = described.pop("warnings")
    for key, value in described.items():
        say(f"{key.replace('_', ' ')}: {_text(value)}")
    for finding in findings:
        if finding.check == DEPTH_RANGE:
            say(f"depth: {_depth(finding.measured)}")
        if finding.check == DEPTH_DELAY and (delay := finding.measured["median_s"]):
            order = "after" if delay > 0 else "before"
            say(f"depth is {1e3 * abs(delay):.3g} ms {order} colour (median of the stamps)")
        if finding.check == REPEATED_DEPTH and (share := finding.measured.get("share")):
            say(f"in {share:.0%} of the frames depth is that of the frame before")
        if finding.undecided:
            say(f"not checked: {finding.check}: {finding.undecided}")
    for warning in warnings:
        say(f"warning: {warning}")


def _depth(measured: dict[str, Any]) -> str:
    nearest, median, farthest = (
        measured[f"{which}_m"] for which in ("nearest", "median", "farthest")
    )
    return (
        f"{nearest:.3g} to {farthest:.3g} m, half of it beyond {median:.3g} m; "
        f"{measured['valid']:.1%} of the pixels have it"
    )


def _text(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return "[" + " ".join(_text(item) for item in value) + "]"
    return str(value)
