"""What the README says can be run, runs."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_ten_lines_of_python_track_a_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    assert len(code[1].strip().splitlines()) <= 12
    source = SyntheticSource(make_recipe("texture_near", frames=4))

    def my_camera() -> Iterator[tuple[float, Any, Any]]:
        for index in range(len(source)):
            frame = source.read(index).frame
            assert frame is not None
            bgr = np.repeat(frame.grey[..., None], 3, axis=2)
            yield frame.timestamp, bgr, np.round(frame.depth * 1000).astype(np.uint16)

    monkeypatch.chdir(tmp_path)
    exec(compile(code[1], str(README), "exec"), {"my_camera": my_camera})
    assert len(capsys.readouterr().out.splitlines()) == 4
    estimate = Trajectory.read(tmp_path / "trajectory.txt")
    truth = source.ground_truth
    start = np.linalg.inv(truth.at(estimate.timestamps[0]))
    end = start @ truth.at(estimate.timestamps[-1])
    assert np.linalg.norm(end[:3, 3] - estimate.poses[-1][:3, 3]) < 0.01


def test_every_file_that_it_points_to_is_there() -> None:
    links = re.findall(r"\]\((?!https?:|#)([^)#]+)", README.read_text(encoding="utf-8"))
    missing = [link for link in links if not (README.parent / link).exists()]
    assert links
    assert not missing
