"""`edvo evaluate`."""

import json
from pathlib import Path

from edvo.cli.scores import score_table
from edvo.cli.terminal import note, say
from edvo.errors import DatasetError
from edvo.evaluation import evaluate as evaluate_trajectories
from edvo.trajectory import Trajectory


def evaluate(
    reference: Path,
    estimate: Path,
    *,
    delta: float,
    frames: Path | None,
    as_json: bool,
    plot: Path | None,
) -> None:
    """Compare a trajectory with the truth; see `edvo.cli.commands.evaluate`."""
    truth, estimated = Trajectory.read(reference), Trajectory.read(estimate)
    count = None if frames is None else count_frames(frames)
    errors = evaluate_trajectories(truth, estimated, count, delta=delta)
    if as_json:
        say(json.dumps(errors.to_dict(), indent=2))
    else:
        say(score_table({estimate.name: errors}))
        for line in errors.notes:
            note(line)
    if plot is not None:
        from edvo.report.plots import draw_evaluation

        draw_evaluation(plot, truth, estimated, errors, title=estimate.name)
        note(f"wrote {plot}")


def count_frames(file: Path) -> int:
    """Count the rows of a list of frames: rgb.txt, an association or a frames.csv."""
    try:
        lines = file.read_text().splitlines()
    except OSError as error:
        reason = error.strerror or error
        raise DatasetError(f"cannot read {file}: {reason}; give a list of frames") from error
    except UnicodeDecodeError as error:
        raise DatasetError(f"{file} is no text file; give a list of frames") from error
    rows = [line for line in lines if line.strip() and not line.startswith(("#", "timestamp"))]
    if not rows:
        raise DatasetError(f"{file} lists no frames; give rgb.txt or frames.csv")
    return len(rows)
