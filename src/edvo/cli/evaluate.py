"""`edvo evaluate`."""

import json
import math
from pathlib import Path

from edvo.cli.scores import score_table
from edvo.cli.terminal import note, say
from edvo.errors import DatasetError, EvaluationError
from edvo.evaluation import evaluate as evaluate_trajectories
from edvo.trajectory import Trajectory

_USUAL_SPAN_S = 1.0


def evaluate(
    reference: Path,
    estimate: Path,
    *,
    delta: float | None,
    frames: Path | None,
    as_json: bool,
    plot: Path | None,
) -> None:
    """Compare a trajectory with the truth; see `edvo.cli.commands.evaluate`."""
    truth, estimated = Trajectory.read(reference), Trajectory.read(estimate)
    count = None if frames is None else count_frames(frames)
    span = _USUAL_SPAN_S if delta is None else delta
    errors = evaluate_trajectories(truth, estimated, count, delta=span)
    asked_in_vain = delta is not None and errors.rpe is None
    if as_json:
        say(json.dumps(errors.to_dict(), indent=2))
    else:
        say(score_table({estimate.name: errors}))
        for line in errors.notes[1:] if asked_in_vain else errors.notes:  # the first is last
            note(line)
    if plot is not None:
        from edvo.report.plots import draw_evaluation

        draw_evaluation(plot, truth, estimated, errors, title=estimate.name)
        note(f"wrote {plot}")
    if asked_in_vain:
        raise EvaluationError(f"{estimate}: {errors.notes[0]}")


def count_frames(file: Path) -> int:
    """Count the rows of a list of frames: rgb.txt, an association or a frames.csv."""
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        reason = error.strerror or error
        raise DatasetError(f"cannot read {file}: {reason}; give a list of frames") from error
    except UnicodeDecodeError as error:
        raise DatasetError(f"{file} is no text file; give a list of frames") from error
    count = 0
    for number, line in enumerate(lines, start=1):
        begin = " ".join(line.replace(",", " ").split()[:1])
        if not begin or begin.startswith("#") or (begin == "timestamp" and not count):
            continue
        if not _is_time(begin):
            raise DatasetError(
                f"{file}:{number}: {begin!r:.40} is no time in seconds; give a list whose rows "
                "begin with one, as rgb.txt or frames.csv"
            )
        count += 1
    if not count:
        raise DatasetError(f"{file} lists no frames; give rgb.txt or frames.csv")
    return count


def _is_time(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
