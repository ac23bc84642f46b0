import json

import numpy as np
import pytest

from edvo.errors import EvaluationError
from edvo.evaluation import (
    absolute_trajectory_error,
    coverage,
    evaluate,
    relative_pose_error,
    span_coverage,
)
from edvo.trajectory import Trajectory


def test_it_holds_every_error_beside_standing_still(make_pair):
    reference, estimate = make_pair(11)
    evaluation = evaluate(reference, estimate, frames=len(estimate) + 6)
    assert evaluation.rpe.formula == "script"
    assert evaluation.rpe_sturm.formula == "sturm"
    assert evaluation.rpe.rmse == relative_pose_error(reference, estimate).rmse
    assert evaluation.rpe_zero_motion.rmse > 5 * evaluation.rpe.rmse
    assert evaluation.ate_zero_motion.rmse > 5 * evaluation.ate.rmse
    assert evaluation.coverage == len(estimate) / (len(estimate) + 6)
    assert evaluation.notes == ()


def test_it_goes_to_json_and_says_what_it_is(make_pair):
    reference, estimate = make_pair(11)
    told = json.loads(json.dumps(evaluate(reference, estimate).to_dict()))
    assert told["rpe"]["delta"] == 1.0
    assert told["rpe"]["unit"] == "s"
    assert told["rpe"]["translation_m"]["rmse"] > 0
    assert told["rpe"]["rotation_deg"]["rmse"] > 0
    assert told["ate"]["poses"] == len(estimate)
    assert told["coverage"] is None
    assert told["span_coverage"] > 0.95


def test_standing_still_in_ate_is_the_spread_of_the_truth(make_pair):
    reference, _ = make_pair(12)
    evaluation = evaluate(reference, reference)
    positions = reference.poses[:, :3, 3]
    spread = np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert evaluation.ate_zero_motion.rmse == pytest.approx(spread)
    assert evaluation.ate.rmse < 1e-12


def test_too_short_for_one_error_gets_the_other_with_a_note(make_pair):
    reference, estimate = make_pair(13)
    evaluation = evaluate(reference, estimate.between(101.0, 101.5))
    assert evaluation.rpe is None
    assert evaluation.rpe_zero_motion is None
    assert evaluation.ate is not None
    assert "shorter delta" in evaluation.notes[0]
    assert evaluation.to_dict()["rpe"] is None

    sparse = Trajectory.from_poses(estimate.timestamps + 0.0049, estimate.poses)
    evaluation = evaluate(reference, sparse, max_difference=1e-5)
    assert evaluation.ate is None
    assert evaluation.rpe is not None
    assert "absolute" in evaluation.notes[0]


def test_nothing_to_compare_is_an_error(make_pair):
    reference, estimate = make_pair(13)
    later = Trajectory(estimate.timestamps + 1000, estimate.poses, estimate.stamps)
    with pytest.raises(EvaluationError, match="nothing to compare"):
        evaluate(reference, later)
    with pytest.raises(EvaluationError, match="positive"):
        evaluate(reference, estimate, delta=-1)


@pytest.mark.parametrize("how", [evaluate, relative_pose_error, absolute_trajectory_error])
@pytest.mark.parametrize("given", [np.eye(4), None, "truth.txt"])
def test_what_is_no_trajectory_is_an_error(make_pair, how, given):
    reference, estimate = make_pair(11)
    kind = type(given).__name__
    with pytest.raises(EvaluationError, match=f"^reference is {kind}; give a Trajectory, as"):
        how(given, estimate)
    with pytest.raises(EvaluationError, match=f"^estimate is {kind}; give a Trajectory, as"):
        how(reference, given)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"delta": "1"}, "^delta is '1'; give a positive number$"),
        ({"delta": None}, "^delta is None; give a positive number$"),
        ({"delta": True}, "^delta is True; give a positive number$"),
        ({"frames": "12"}, "^frames is '12'; give how many there are$"),
        ({"frames": True}, "^frames is True; give how many there are$"),
        ({"max_difference": "1"}, "^max_difference is '1'; give seconds$"),
        ({"max_pairs": "1"}, "^max_pairs is '1'; give how many, or 0 for all$"),
    ],
)
def test_an_option_that_is_no_number_is_an_error(make_pair, options, words):
    with pytest.raises(EvaluationError, match=words):
        evaluate(*make_pair(11), **options)


def test_numbers_of_numpy_are_numbers(make_pair):
    reference, estimate = make_pair(11)
    told = evaluate(reference, estimate, np.int64(1000), delta=np.float32(1))
    assert told.coverage == len(estimate) / 1000
    assert told.rpe is not None


def test_coverage_counts_frames():
    assert coverage(123, 123) == 1.0
    assert coverage(0, 10) == 0.0
    for poses, frames in [(11, 10), (0, 0), (-1, 5)]:
        with pytest.raises(EvaluationError, match="count the frames"):
            coverage(poses, frames)


def test_span_coverage_sees_holes(make_pair):
    reference, estimate = make_pair(14)
    assert span_coverage(reference, estimate) == pytest.approx(1.0, abs=0.03)
    early, late = estimate.between(0, 101.0), estimate.between(103.0, 200.0)
    holed = Trajectory.from_poses(
        np.concatenate([early.timestamps, late.timestamps]),
        np.concatenate([early.poses, late.poses]),
    )
    assert span_coverage(reference, holed) == pytest.approx(0.5, abs=0.05)
    assert span_coverage(reference, Trajectory.from_poses([], [])) == 0.0
