"""Tables for people and for programs say the same."""

import csv
import io
import json
import math
from dataclasses import replace

import pytest

from edvo.report.compare import Comparison, System, compare_source
from edvo.report.compare_plots import draw_errors, draw_paths
from edvo.report.compare_tables import (
    cells,
    describe,
    markdown,
    records,
    summary_cells,
    to_csv,
    to_json,
)

from .fakes import FakeSource, FakeTracker, path

PNG = b"\x89PNG\r\n\x1a\n"


def made(scale: float, *, name: str = "room", variants: bool = False) -> Comparison:
    def system(name: str, kind: str, scale: float, repeats: int = 1) -> System:
        return System(name, name, kind, lambda c, seed: FakeTracker(scale), repeats)  # type: ignore[arg-type]

    systems = [
        system("edvo-default", "edvo", scale, 2),
        system("peer", "baseline", 0.8),
        system("wild", "baseline", 1e9),
    ]
    if variants:
        systems.append(system("edges: fewer | none", "variant", 1 - 2 * (1 - scale)))
    return compare_source(
        FakeSource(name=name, unreadable=[7]),
        systems,
        trajectories={"orb-slam3": path([i / 10 for i in range(40)], 0.95)},
    )


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    return made(0.9)


def column(comparison: Comparison, name: str) -> dict[str, str]:
    header, rows = cells(comparison)
    return {row[0]: row[header.index(name)] for row in rows}


def test_cells(comparison: Comparison) -> None:
    assert column(comparison, "RPE rmse m/s") == {
        "edvo-default": "0.0300",
        "peer": "0.0600",
        "wild": "x",
        "orb-slam3": "0.0150",
        "zero-motion": "0.3000",
    }
    assert column(comparison, "rank")["orb-slam3"] == "1"
    assert column(comparison, "worst")["edvo-default"] == "0.0300"
    assert column(comparison, "coverage")["peer"] == "97.5%"
    assert column(comparison, "wall ms (p95)")["orb-slam3"] == "-"
    assert column(comparison, "time (CPU)")["edvo-default"] == "1.00x (1.00x)"
    assert column(comparison, "why")["wild"].startswith("diverged: RPE")
    assert column(comparison, "why")["zero-motion"] == ""
    header, rows = cells(comparison)
    assert "MB" not in header
    assert all(len(row) == len(header) for row in rows)


def test_memory_is_a_column_once_it_is_measured(comparison: Comparison) -> None:
    first, *others = comparison.rows
    measured = replace(comparison, rows=(replace(first, memory_mb=12.4), *others))
    assert column(measured, "MB") == {
        "edvo-default": "12",
        "peer": "-",
        "wild": "-",
        "orb-slam3": "-",
        "zero-motion": "-",
    }


def test_csv_reads_back_to_the_last_digit(comparison: Comparison) -> None:
    lines = list(csv.DictReader(io.StringIO(to_csv([comparison, made(0.99, name="hall")]))))
    assert len(lines) == 10
    assert {line["sequence"] for line in lines} == {"room", "hall"}
    for line, record in zip(lines, records(comparison), strict=False):
        for key, value in record.items():
            if isinstance(value, float):
                assert float(line[key]) == value
            else:
                assert line[key] == ("" if value is None else str(value))


def test_json_reads_back(comparison: Comparison) -> None:
    read = json.loads(to_json([comparison], command="edvo compare room"))
    (sequence,) = read["sequences"]
    rows = {row["system"]: row for row in sequence["rows"]}
    assert read["command"] == "edvo compare room"
    assert sequence["unreadable"] == ["7.png is broken"]
    assert sequence["verdicts"][0].startswith("edvo-default: 2nd of 4 in RPE")
    for row, record in zip(sequence["rows"], records(comparison), strict=True):
        assert {key: row[key] for key in record} == record
    assert [run["seed"] for run in rows["edvo-default"]["runs"]] == [0, 1]
    assert rows["edvo-default"]["rpe_rmse_m_s"] == pytest.approx(0.03)
    assert rows["wild"]["rank"] is None
    assert rows["wild"]["failure"]
    assert rows["wild"]["worst_rpe_rmse_m_s"] is None  # JSON has no infinity
    assert rows["wild"]["rpe_rmse_m_s"] > 1e6
    assert rows["zero-motion"]["wall_ms_median"] is None
    assert rows["orb-slam3"]["runs"][0]["seed"] is None


def test_markdown_is_a_page_of_tables(comparison: Comparison) -> None:
    page = markdown(
        [comparison, made(0.99, name="hall")],
        command="edvo compare room hall",
        pictures=[["room-paths.png"], []],
    )
    assert "`edvo compare room hall`" in page
    assert page.count("\n### ") == 3
    assert "![room](room-paths.png)" in page
    assert "- edvo-default: 1st in 1 of 2 sequences by RPE (2nd, 1st)" in page
    for line in page.splitlines():
        if line.startswith("|"):
            assert line.endswith("|")


def test_summary_of_variants_has_ratios() -> None:
    both = [made(0.9, variants=True), made(0.95, name="hall", variants=True)]
    header, rows = summary_cells(both)
    assert header == ["RPE rmse m/s", "room", "hall", "mean ratio"]
    lines = {row[0]: row[1:] for row in rows}
    assert lines["edges: fewer | none"] == ["0.0600 (2.00x)", "0.0300 (2.00x)", "2.00x"]
    assert lines["wild"] == ["x", "x", "-"]
    assert column(both[0], "to edvo-default")["edges: fewer | none"] == "2.00x"


def test_summary_tells_times() -> None:
    header, rows = summary_cells([made(0.9), made(0.95, name="hall")])
    assert header[1:] == ["room", "hall"]
    assert rows[0][1].startswith("0.0300, ")
    assert rows[0][1].endswith(" ms")
    assert rows[-1] == ["zero-motion", "0.3000", "0.3000"]


def test_describe(comparison: Comparison) -> None:
    assert describe(comparison) == "40 frames, 1 of them unreadable"
    stopped = replace(comparison, frames=12, truth=None)
    assert "12 frames of 40, then interrupted" in describe(stopped)
    assert "no ground truth" in describe(stopped)


def test_pictures_are_drawn_whatever_fails(comparison: Comparison) -> None:
    for draw in (draw_paths, draw_errors):
        picture = draw(comparison)
        assert picture is not None
        assert picture.startswith(PNG)
        assert picture != draw(made(0.99))


def test_pictures_without_truth() -> None:
    blind = compare_source(
        FakeSource(truth=False), [System("a", "", "edvo", lambda c, s: FakeTracker())]
    )
    picture = draw_paths(blind)
    assert picture is not None
    assert picture.startswith(PNG)
    assert draw_errors(blind) is None


def test_no_picture_of_nothing() -> None:
    nobody = compare_source(
        FakeSource(), [System("a", "", "edvo", lambda c, s: FakeTracker(lost=range(40)))]
    )
    assert draw_paths(nobody) is None
    assert draw_errors(nobody) is None
    assert math.isinf(nobody.rows[0].rpe)


def test_pictures_of_many_show_edvo_and_the_best() -> None:
    def system(i: int) -> System:
        name, kind = (f"b{i}", "baseline") if i else ("edvo-default", "edvo")
        return System(name, "", kind, lambda c, s: FakeTracker(0.5 + i / 100))  # type: ignore[arg-type]

    many = compare_source(FakeSource(), [system(i) for i in range(30)])
    picture = draw_paths(many)
    assert picture is not None
    assert picture.startswith(PNG)
