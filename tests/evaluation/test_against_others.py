"""Stored numbers, the project's scorer where it is at hand, and evo run as a program of its own."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from edvo.evaluation import absolute_trajectory_error, relative_pose_error
from edvo.trajectory import Trajectory


def test_the_stored_numbers(golden):
    reference = Trajectory.read(golden / "reference.txt")
    estimate = Trajectory.read(golden / "estimate.txt")
    expected = json.loads((golden / "expected.json").read_text())
    for formula in ("script", "sturm"):
        found = relative_pose_error(reference, estimate, formula=formula).to_dict()
        wanted = expected[f"rpe_{formula}"]
        assert found["pairs"] == wanted["pairs"]
        for kind in ("translation_m", "rotation_deg"):
            for name, value in wanted[kind].items():
                assert found[kind][name] == pytest.approx(value, rel=1e-9), (formula, kind, name)
    ate = absolute_trajectory_error(reference, estimate).to_dict()
    assert ate["poses"] == expected["ate"]["poses"]
    for name, value in expected["ate"]["translation_m"].items():
        assert ate["translation_m"][name] == pytest.approx(value, rel=1e-9)


def test_the_stored_trajectories_have_what_is_hard(golden, script):
    """Skipped pairs, pairs with themselves, formulas that differ: else the test above is lame."""
    truth, estimate = (script.read(golden / f"{name}.txt") for name in ("reference", "estimate"))
    everything = script.evaluate_rpe(truth, estimate, count_self_pairs=True)
    expected = json.loads((golden / "expected.json").read_text())
    assert len(everything) > expected["rpe_script"]["pairs"]
    times = sorted(estimate)
    with_partner = sum(
        script.closest(times, time + 1.0) not in (len(times) - 1, index)
        for index, time in enumerate(times)
    )
    assert with_partner > expected["rpe_script"]["pairs"] + 5
    rmse = [expected[f"rpe_{name}"]["translation_m"]["rmse"] for name in ("script", "sturm")]
    assert abs(rmse[0] - rmse[1]) > 1e-4 * rmse[0]


@pytest.fixture(scope="session")
def scorer(real_data):
    file = real_data.parent / "tools" / "score.py"
    if not file.is_file():
        pytest.skip(f"no scorer at {file}: it lies beside the real sequences' folder")
    spec = importlib.util.spec_from_file_location("score", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compare_with_scorer(scorer, reference_file, estimate_file):
    truth, estimated = scorer.read_poses(reference_file), scorer.read_poses(estimate_file)
    reference, estimate = Trajectory.read(reference_file), Trajectory.read(estimate_file)
    translation, rotation = scorer.rpe(truth, estimated)
    ours = relative_pose_error(reference, estimate)
    np.testing.assert_allclose(ours.translation, translation, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(ours.rotation), rotation, rtol=0, atol=1e-5)
    ate = absolute_trajectory_error(reference, estimate)
    assert ate.rmse == pytest.approx(scorer.ate(truth, estimated), rel=1e-9)


def test_it_equals_the_scorer(scorer, golden):
    compare_with_scorer(scorer, golden / "reference.txt", golden / "estimate.txt")


def test_it_equals_the_scorer_on_real_truth(scorer, real_data, tmp_path):
    for name in ("tum_fr1_xyz", "tum_fr3_structure_notexture_far", "icl_office_kt3"):
        truth_file = real_data / name / "groundtruth.txt"
        truth = Trajectory.read(truth_file)
        stamps = [
            line.split()[0]
            for line in (real_data / name / "rgb.txt").read_text().splitlines()
            if not line.startswith("#")
        ]
        times = np.array([float(stamp) for stamp in stamps])
        inside = (times >= truth.timestamps[0]) & (times <= truth.timestamps[-1])
        poses = np.array([truth.at(time) for time in times[inside]])
        poses[:, :3, 3] += np.random.default_rng(0).normal(size=(len(poses), 3)) * 0.005
        kept = [stamp for stamp, take in zip(stamps, inside, strict=True) if take]
        Trajectory.from_poses(times[inside], poses, kept).write(tmp_path / f"{name}.txt")
        compare_with_scorer(scorer, truth_file, tmp_path / f"{name}.txt")


@pytest.fixture(scope="module")
def run_evo(tmp_path_factory):
    """Run an evo program in a home of its own and give back its array of errors."""
    home = tmp_path_factory.mktemp("evo")

    def run(program, *arguments):
        beside = Path(sys.executable).parent / program
        found = str(beside) if beside.is_file() else shutil.which(program)
        if found is None:
            pytest.skip(f"{program} is not installed: pip install 'edvo[test]'")
        result = home / "result.zip"
        result.unlink(missing_ok=True)
        environment = {**os.environ, "HOME": str(home), "MPLBACKEND": "Agg", "TMPDIR": str(home)}
        done = subprocess.run(
            [found, "tum", *map(str, arguments), "--save_results", str(result), "--no_warnings"],
            capture_output=True,
            text=True,
            cwd=home,
            env=environment,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        with zipfile.ZipFile(result) as archive, archive.open("error_array.npy") as file:
            return np.load(file)

    return run


@pytest.fixture(scope="module")
def regular(make_pair, tmp_path_factory):
    """Truth and estimate at the same regular 30 Hz, where evo's definitions coincide."""
    folder = tmp_path_factory.mktemp("regular")
    _, walk = make_pair(21, seconds=6.0)
    rng = np.random.default_rng(21)
    times = np.arange(len(walk)) / 30.0
    reference = Trajectory.from_poses(times, walk.poses)
    poses = walk.poses.copy()
    poses[:, :3, 3] += rng.normal(size=(len(poses), 3)) * 0.01
    estimate = Trajectory.from_poses(times, poses)
    files = folder / "reference.txt", folder / "estimate.txt"
    reference.write(files[0])
    estimate.write(files[1])
    return reference, estimate, *files


@pytest.mark.parametrize(
    ("relation", "kind"), [("trans_part", "translation"), ("angle_rad", "rotation")]
)
def test_rpe_equals_evo(run_evo, regular, relation, kind):
    reference, estimate, reference_file, estimate_file = regular
    errors = run_evo(
        "evo_rpe", reference_file, estimate_file,
        *("-d", 30, "-u", "f", "--all_pairs", "-r", relation),
    )  # fmt: skip
    ours = relative_pose_error(reference, estimate, formula="sturm")
    # evo keeps the pair that ends on the last pose, the TUM script drops it.
    np.testing.assert_allclose(getattr(ours, kind), errors[:-1], rtol=0, atol=1e-7)
    in_frames = relative_pose_error(reference, estimate, delta=30, unit="f", formula="sturm")
    np.testing.assert_array_equal(in_frames.translation, ours.translation)


def test_ate_equals_evo(run_evo, regular):
    reference, estimate, reference_file, estimate_file = regular
    errors = run_evo("evo_ape", reference_file, estimate_file, "-a", "--t_max_diff", 0.02)
    ours = absolute_trajectory_error(reference, estimate)
    np.testing.assert_allclose(ours.errors, errors, rtol=0, atol=1e-8)
