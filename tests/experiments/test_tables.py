"""Tables II and III: what fails is marked, what is published stands beside, claims follow."""

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from edvo.errors import EvaluationError, MissingExtraError
from edvo.experiments import accuracy, table2, table3
from edvo.experiments.accuracy import BEST_OURS, LOW_TEXTURE, OURS, Score, Scores
from edvo.experiments.bench import Bench
from edvo.experiments.sequences import PAPER_SEQUENCES, TEXTURED
from edvo.report.outcomes import table_csv

SYSTEMS = (OURS, BEST_OURS, "opencv-rgb", "orb-pnp", "zero-motion")


def score(sequence: str, system: str, rmse: float | None) -> Score:
    error = math.nan if rmse is None else rmse
    reason = "diverged" if rmse is None and system != "zero-motion" else ""
    return Score(sequence, system, "real, 90 frames", 0, 90, 90, error, error, reason)


def scores(errors: Mapping[str, Mapping[str, float | None]] | None = None) -> Scores:
    """Make scores: 10 mm everywhere, but for those that are given."""
    of = {}
    for sequence in PAPER_SEQUENCES:
        for system in SYSTEMS:
            rmse = (errors or {}).get(system, {}).get(sequence, 0.01)
            of[sequence, system] = score(sequence, system, rmse)
    return Scores(of, tuple(PAPER_SEQUENCES), SYSTEMS, ())


def everywhere(rmse: float | None, names: Any = PAPER_SEQUENCES) -> dict[str, float | None]:
    return dict.fromkeys(names, rmse)


@pytest.mark.parametrize("table", [table2, table3])
def test_all_rows_of_the_paper(table: Any) -> None:
    for published in (table.RMSE, table.MEDIAN):
        assert list(published) == list(PAPER_SEQUENCES)
        assert {len(row) for row in published.values()} == {len(accuracy.SYSTEMS)}
        assert all(row[-1] is not None for row in published.values())


def test_published_values_as_printed() -> None:
    far = "fr3/structure_texture_far"
    assert table2.RMSE[far] == (0.027, 0.020, 0.000, 0.015, 0.016)
    assert table2.MEDIAN["fr3/cabinet"] == (None, None, 0.130, None, 0.043)
    assert table3.RMSE["fr3/long_office_household"] == (0.041, 0.021, 0.582, 0.031, 0.019)
    assert table3.MEDIAN["fr3/structure_notexture_near"][-1] == 0.019


def test_table_marks_failures_and_the_best() -> None:
    measured = scores({OURS: everywhere(0.005), "orb-pnp": everywhere(None)})
    table = accuracy.make_table(measured, table2.RMSE, "rmse", name="rmse", title="RMSE")
    row = dict(zip(table.header, table.rows[3], strict=True))
    assert row["sequence"] == "fr3/ntxt/str/far"
    assert (row["SVO [paper]"], row["Ours [paper]"]) == ("x", "0.012")
    assert (row[OURS], row["orb-pnp"], row["opencv-rgb"]) == ("**0.0050**", "x", "0.0100")
    written = list(csv.DictReader(io.StringIO(table_csv(table))))
    assert len(written) == 6 * (5 + len(SYSTEMS))
    lost = [r for r in written if r["system"] == "orb-pnp"]
    assert {r["rpe_rmse_m_s"] for r in lost} == {""}
    assert {r["failed"] for r in lost} == {"diverged"}


def test_other_sequences_have_no_published_values() -> None:
    measured = scores()
    of = dict(measured.of)
    for system in SYSTEMS:
        of["fr1/xyz", system] = score("fr1/xyz", system, 0.02)
    more = replace(measured, of=of, sequences=(*measured.sequences, "fr1/xyz"))
    table = accuracy.make_table(more, table2.RMSE, "rmse", name="rmse", title="RMSE")
    assert table.rows[-1][2:7] == ("-",) * 5


def test_claims_of_table_2_follow_the_numbers() -> None:
    as_in_the_paper = scores(
        {
            OURS: everywhere(0.012),
            "orb-pnp": everywhere(None, LOW_TEXTURE),
            "opencv-rgb": everywhere(0.3, LOW_TEXTURE),
        }
    )
    assert table2._similar(as_in_the_paper).holds is True
    assert table2._best_where_plain(as_in_the_paper).holds is True
    assert table2.features_fail(as_in_the_paper, "constant").holds is True
    assert table2._direct_jumps(as_in_the_paper).holds is True
    assert table2.robust(as_in_the_paper, "constant").holds is True
    otherwise = scores({OURS: {**everywhere(0.05), "fr3/cabinet": None}})
    assert table2._similar(otherwise).holds is False
    assert table2._best_where_plain(otherwise).holds is False
    assert table2.features_fail(otherwise, "constant").holds is False
    assert table2._direct_jumps(otherwise).holds is False
    lost = table2.robust(otherwise, "constant")
    assert lost.holds is False
    assert "fails on fr3/cabinet" in lost.sentence


def test_claims_of_table_3_follow_the_numbers() -> None:
    constant = scores()
    changed = scores({"opencv-rgb": everywhere(None), OURS: everywhere(0.011)})
    assert table3._kept(constant, changed).holds is True
    assert table3._orb_kept(constant, changed).holds is True
    assert table3._others_worse(constant, changed).holds is True
    changed = scores({OURS: {TEXTURED[0]: 0.013}, "orb-pnp": {TEXTURED[1]: None}})
    assert table3._kept(constant, changed).holds is False
    assert table3._orb_kept(constant, changed).holds is False
    assert table3._others_worse(constant, changed).holds is False


def test_published_errors_are_compared_on_real_sequences_only(bench: Bench) -> None:
    stand_ins = bench.sequences()
    assert table2.as_published(scores(), stand_ins, table2.RMSE).holds is None
    real = [replace(sequence, is_real=True) for sequence in stand_ins]
    assert table2.as_published(scores(), real, table2.RMSE).holds is True
    assert table2.as_published(scores({OURS: everywhere(0.05)}), real, table2.RMSE).holds is False


def test_what_is_not_installed_is_said(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    make = accuracy.make_tracker

    def lacking(name: str, *more: Any) -> Any:
        if name == "orb-pnp":
            raise MissingExtraError("pip install edvo[orb]")
        return make(name, *more)

    monkeypatch.setattr(accuracy, "make_tracker", lacking)
    found = accuracy._installed(("zero-motion", "orb-pnp"), bench.sequences()[0])
    assert found == (("zero-motion",), ("orb-pnp is left out: pip install edvo[orb]",))


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (EvaluationError("no more of this"), "no more of this"),
        (RuntimeError("singular\nat line 3"), "RuntimeError: singular"),
        (cv2.error("bad size"), "error: bad size"),
        (np.linalg.LinAlgError("no inverse"), "LinAlgError: no inverse"),
    ],
)
def test_a_tracker_that_raises_has_failed(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, error: Exception, reason: str
) -> None:
    class Raising:
        def track(self, frame: object) -> None:
            raise error

    monkeypatch.setattr(accuracy, "make_tracker", lambda *_: Raising())
    found = accuracy.follow(bench.sequence("fr3/cabinet"), "any", 0)
    assert found.failed
    assert found.reason == reason
    assert found.poses == 0


def test_standing_still_is_the_measure_and_no_failure(bench: Bench) -> None:
    found = accuracy.follow(bench.sequence("fr3/structure_texture_far"), "zero-motion", 0)
    assert not found.failed
    assert 0.05 < found.rmse < 0.5


def test_the_middle_of_several_seeds() -> None:
    line = [score("a", OURS, rmse) for rmse in (0.03, None, 0.01)]
    assert accuracy._middle(line).rmse == 0.03
    assert accuracy._middle(line[:1]).rmse == 0.03


def test_in_a_small_setting(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    systems = (OURS, BEST_OURS, "opencv-rgb", "zero-motion")
    monkeypatch.setattr(accuracy, "QUICK", systems)
    constant, changing = table2.EXPERIMENT.run(bench), table3.EXPERIMENT.run(bench)
    for outcome in (constant, changing):
        rmse = outcome.tables[0]
        assert [row[0] for row in rmse.rows][3] == "fr3/ntxt/str/far"
        assert all("stand-in: synthetic" in row[1] for row in rmse.rows)
        of = {(r["sequence"], r["system"]): r for r in rmse.records if r["data"] != "published"}
        assert len(of) == 6 * len(systems)
        for name in TEXTURED:
            still = of[name, "zero-motion"]["rpe_rmse_m_s"]
            assert of[name, BEST_OURS]["rpe_rmse_m_s"] < 0.5 * still
        not_run = [f for f in outcome.findings if f.sentence == "orb-pnp was not run."]
        assert not_run
        assert all(finding.holds is None for finding in not_run)
        assert outcome.figures[0].png.startswith(b"\x89PNG")
