"""Runs, and registrations made again."""

from typing import Any

import numpy as np
import pytest

from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.experiments import registrations
from edvo.experiments.bench import Bench
from edvo.experiments.registrations import pairs, registration
from edvo.experiments.runs import track
from edvo.odometry import Status
from edvo.sampling import sample_edges
from edvo.sensor import DEPTH_NOISE


def test_a_run_says_what_the_odometry_says(bench: Bench) -> None:
    sequence = bench.sequence("fr3/long_office_household")
    run = track(sequence, ["sampling.count=200"])
    assert len(run.tracked) == len(run.seconds) == len(sequence.frames)
    assert run.tracked[-1].samples == 200
    assert len(run.iterations) == len(sequence.frames) - 1  # the first has nothing to register
    assert run.iterations.min() >= 1
    assert 0 < run.rmse < 0.2
    assert run.coverage == np.mean([t.status is not Status.LOST for t in run.tracked])
    assert (run.seconds > 0).all()


def test_a_run_too_short_has_no_error(bench: Bench) -> None:
    from edvo.experiments.fig10 import thinned

    run = track(thinned(bench.sequence("fr3/long_office_household"), 30))
    assert run.errors is None
    assert np.isnan(run.rmse)


def test_samples_of_pairs_are_told_the_noise_of_the_sensor(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = []

    def noted(*given: Any, **more: Any) -> EdgePixels:
        told.append(more.get("noise"))
        return sample_edges(*given, **more)

    monkeypatch.setattr(registrations, "sample_edges", noted)
    config = Config.preset("paper").with_overrides(["planes.sensor=azure_kinect"])
    pairs(bench.sequence("fr3/long_office_household"), config, 1)
    assert told == [DEPTH_NOISE["azure_kinect"]]


def test_pairs_register_to_what_the_run_found(bench: Bench) -> None:
    sequence, config = bench.sequence("fr3/long_office_household"), Config.preset("paper")
    chosen = pairs(sequence, config, 5)
    assert len(chosen) == 5
    align = registration(sequence, config)
    for pair in chosen:
        again = align.align(pair.reference, pair.samples, pair.starts)
        assert again.converged
        # a frame moves little, and a constant velocity leads nearer than standing still
        assert np.abs(again.T_ref_cur - pair.T_ref_last).max() < 0.05
        assert np.abs(again.T_ref_cur - pair.T_ref_ahead).max() < 0.02
        assert pair.from_last.shape == (1, 4, 4)
