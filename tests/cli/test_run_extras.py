"""`edvo run --report` and `--export`: what is in the page and in the files."""

import base64
import json
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo import files
from edvo.cli import run as run_module
from edvo.cli.extras import Extras
from edvo.export.registry import FILES
from edvo.trajectory import Trajectory

from .conftest import Command, full_disk, interrupting, make_sequence

RESULTS = {"trajectory.txt", "frames.csv", "summary.json", "config.yaml"}
VOID = {"meta", "img", "input", "br"}
EXPORTED = {
    "edges": ["edges.ply"],
    "kitti": ["kitti_poses.txt", "kitti_times.txt"],
    "euroc": ["euroc.csv"],
    "colmap": ["colmap/cameras.txt", "colmap/images.txt", "colmap/points3D.txt"],
    "nerfstudio": ["nerfstudio/edges.ply", "nerfstudio/transforms.json"],
}


class Page(HTMLParser):
    """Tags that close, ids, what is referred to, and the text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href", "action", "srcset", "poster"):
                self.references.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def odd_sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with a name that HTML must not take for its own, one image broken."""
    folder = make_sequence(tmp_path_factory.mktemp("recordings") / "wall <b> & co")
    (folder / "rgb/20.png").write_bytes(b"")
    return folder


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the results of one run."""
    return tmp_path_factory.mktemp("results")


@pytest.fixture
def report(edvo: Command, odd_sequence: Path, results: Path) -> Path:
    """The page of that run, made by the first test that asks for it; no test may change it."""
    page = results / "report.html"
    if not page.exists():
        done = edvo("run", odd_sequence, "-o", results, "--report", "--set", "keyframes.rule=gap")
        assert done.status == 0, done.err
        assert "report.html" in done.out
    return page


def test_page_needs_no_other_file(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    assert len(page.ids) == len(set(page.ids))
    assert {"path", "path-view", "errors", "status", "times", "frames", "setting"} <= set(page.ids)
    assert all(reference.startswith("data:image/") for reference in page.references)
    assert not re.search(r"https?://|url\(|@import|fetch\(|import\(|XMLHttp", text)


def test_page_says_what_happened(report: Path) -> None:
    text = Page(report.read_text(encoding="utf-8")).text
    assert "wall <b> & co" in text
    assert "lost in 1 of 36 frames" in text
    assert "20.png" in text  # why frame 20 was lost
    assert "keyframes.rule=gap (preset: " in text
    assert "fx" in text
    assert "150.0" in text
    assert "rmse of standing still" in text
    assert "Worst" in text
    assert "Typical" in text


def test_pictures_are_pictures(report: Path) -> None:
    found = re.findall(r'src="data:image/(\w+);base64,([^"]+)"', report.read_text("utf-8"))
    assert [kind for kind, _ in found].count("png") == 4  # path, errors, status, times
    assert [kind for kind, _ in found].count("jpeg") >= 5
    for _, data in found:
        image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.std() > 5


def data_of(report: Path) -> dict:
    text = report.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="path-data">(.*?)</script>', text, re.DOTALL)[1])


def test_data_of_the_turning_view(report: Path) -> None:
    data = data_of(report)
    places = [row[:3] for row in data["estimate"] if row is not None]
    assert data["estimate"].count(None) == 1  # the broken frame parts the line
    found = Trajectory.read(report.parent / "trajectory.txt").poses[:, :3, 3]
    np.testing.assert_allclose(places, found, atol=1e-4)
    assert len(data["truth"]) == 36
    np.testing.assert_allclose(np.array(data["truth"])[:, 0], 0.02 * np.r_[:21, 19:4:-1], atol=0.02)
    edges = np.frombuffer(base64.b64decode(data["map"]["places"]), "<i2").reshape(-1, 3)
    assert len(edges) > 500
    np.testing.assert_allclose(np.median(edges[:, 2]) * data["map"]["unit"], 1.5, atol=0.05)
    assert len(base64.b64decode(data["map"]["colours"])) == 3 * len(edges)


STAND_IN = r"""
const fs = require("fs"), vm = require("vm");
const page = fs.readFileSync(process.argv[2], "utf8");
const data = page.match(/id="path-data">(.*?)<\/script>/s)[1];
const script = page.match(/<script>\n(.*?)<\/script>/s)[1];
const elements = {};
let calls = [];
const pen = new Proxy({}, {
  get: (kept, key) => key in kept ? kept[key] : (...values) => { calls.push([key, values]); },
  set: (kept, key, value) => { kept[key] = value; return true; },
});
function element(id) {
  if (!page.includes('id="' + id + '"')) throw new Error("no element " + id);
  return elements[id] ||= {
    checked: true, listeners: {}, clientWidth: 900, clientHeight: 500, textContent: data,
    addEventListener(kind, action) { (this.listeners[kind] ||= []).push(action); },
    setPointerCapture() {},
    getContext: () => pen,
  };
}
const window = { devicePixelRatio: 2, addEventListener() {} };
vm.runInNewContext(script, { document: { getElementById: element }, window, atob });
const result = { start: calls };
function act(name, id, kind, event = {}) {
  calls = [];
  for (const action of elements[id].listeners[kind]) action({ preventDefault() {}, ...event });
  result[name] = calls;
}
for (const name of ["top", "behind", "side"]) act(name, "view-" + name, "click");
act("held", "path-view", "pointerdown", { clientX: 0, clientY: 0, pointerId: 1 });
act("turned", "path-view", "pointermove", { clientX: 90, clientY: 30, buttons: 1 });
act("let go", "path-view", "pointerup");
act("passed", "path-view", "pointermove", { clientX: 10, clientY: 10, buttons: 0 });
act("zoomed", "path-view", "wheel", { deltaY: -300 });
elements["show-map"].checked = false;
act("without edges", "show-map", "change");
console.log(JSON.stringify(result));
"""


def test_script_draws_and_turns(report: Path, tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node to run the page's script")
    (tmp_path / "stand_in.js").write_text(STAND_IN)
    done = subprocess.run(
        [node, str(tmp_path / "stand_in.js"), str(report)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    drawn = json.loads(done.stdout)

    def dots(name: str) -> np.ndarray:
        return np.array([values[:2] for call, values in drawn[name] if call == "fillRect"])

    data = data_of(report)
    edges = np.frombuffer(base64.b64decode(data["map"]["places"]), "<i2").reshape(-1, 3)
    for name in ("start", "top", "behind", "side", "turned", "zoomed"):
        assert len(dots(name)) == len(edges)
        assert np.isfinite(dots(name)).all()
    assert drawn["held"] == drawn["let go"] == drawn["passed"] == []
    assert len(dots("without edges")) == 0
    # From above the wall is a line across; from behind its x goes right and its y goes down.
    assert np.ptp(dots("top")[:, 1]) < 0.1 * np.ptp(dots("top")[:, 0])
    for axis in (0, 1):
        assert np.corrcoef(dots("behind")[:, axis], edges[:, axis])[0, 1] > 0.99
    assert np.corrcoef(dots("side")[:, 1], edges[:, 1])[0, 1] > 0.99
    assert np.ptp(dots("zoomed")[:, 0]) > 1.3 * np.ptp(dots("turned")[:, 0])
    assert not np.allclose(dots("turned"), dots("side"))


def test_in_a_browser(report: Path, tmp_path: Path) -> None:
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("no Chromium: apt-get install chromium")
    picture = tmp_path / "page.png"
    done = subprocess.run(
        [
            browser,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--enable-logging=stderr",
            "--virtual-time-budget=3000",
            "--window-size=1100,900",
            f"--user-data-dir={tmp_path / 'profile'}",
            f"--screenshot={picture}",
            report.as_uri() + "#path",
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert "Uncaught" not in done.stderr
    image = cv2.imread(str(picture))
    assert image is not None
    assert image.shape[:2] == (900, 1100)
    assert image.std() > 10


def test_page_without_truth_and_without_poses(
    edvo: Command, sequence: Path, tmp_path: Path
) -> None:
    (sequence / "groundtruth.txt").unlink()
    done = edvo("run", sequence, "-o", tmp_path, "--report", "--set", "edges.high=20000")
    assert done.status == 0, done.err
    page = Page((tmp_path / "report.html").read_text("utf-8"))
    assert "lost throughout" in page.text
    assert "No frame has a pose." in page.text
    assert "errors" not in page.ids
    assert page.open == []


def test_page_shows_warnings(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    camera = sequence / "camera.yaml"
    camera.write_text(camera.read_text().replace("5000", "200"))
    done = edvo("run", sequence, "-o", tmp_path, "--report", "--max-frames", 5)
    assert done.status == 0, done.err
    assert re.search(r'class="warning">[^<]*depth', (tmp_path / "report.html").read_text("utf-8"))


def test_no_report_unasked(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    edvo("run", whole_sequence, "-o", tmp_path, "--max-frames", 3)
    assert len(list(tmp_path.iterdir())) == 4


def test_watching_does_not_change_the_poses(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    edvo("run", whole_sequence, "-o", tmp_path / "a")
    edvo("run", whole_sequence, "-o", tmp_path / "b", "--report", "--export", "edges")
    a, b = ((tmp_path / name / "trajectory.txt").read_bytes() for name in "ab")
    assert a == b


def test_exports(edvo: Command, odd_sequence: Path, tmp_path: Path) -> None:
    options = [word for kind in EXPORTED for word in ("--export", kind)]
    done = edvo("run", odd_sequence, "-o", tmp_path, "--start", 4, "--stride", 2, *options)
    assert done.status == 0, done.err
    assert {kind: list(FILES[kind]) for kind in EXPORTED} == EXPORTED
    for file in chain(*EXPORTED.values()):
        assert (tmp_path / file).stat().st_size > 0
        assert file in done.out
    trajectory = Trajectory.read(tmp_path / "trajectory.txt")
    assert len((tmp_path / "kitti_poses.txt").read_text().splitlines()) == len(trajectory) == 15
    frames = json.loads((tmp_path / "nerfstudio/transforms.json").read_text())["frames"]
    # As the files of the source are called, so that their folder can be linked.
    names = [f"{index}.png" for index in range(4, 36, 2) if index != 20]  # that one is broken
    assert [frame["file_path"] for frame in frames] == [f"images/{name}" for name in names]
    rows = (tmp_path / "colmap/images.txt").read_text().splitlines()
    assert f"# images: {odd_sequence / 'rgb'}" in rows
    assert [row.split()[9] for row in rows if row and not row.startswith("#")] == names
    count = re.search(rb"element vertex (\d+)", (tmp_path / "edges.ply").read_bytes())
    assert int(count[1]) > 500


def test_mesh(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d")
    done = edvo("run", whole_sequence, "-o", tmp_path, "--export", "mesh")
    assert done.status == 0, done.err
    mesh = open3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    assert np.median(np.asarray(mesh.vertices)[:, 2]) == pytest.approx(1.5, abs=0.02)


def test_unknown_export_is_refused_before_anything_is_done(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--export", "betamax")
    assert done.status == 1
    assert "betamax" in done.err
    assert "colmap" in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_missing_package_is_named_before_anything_is_done(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--export", "mesh")
    assert done.status == 1
    assert "edvo[open3d]" in done.err
    assert not (tmp_path / "out").exists()


def test_full_disk_leaves_the_results(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    with full_disk(files=4):
        done = edvo("run", whole_sequence, "-o", tmp_path, "--report")
    assert done.status == 1
    assert "report.html" in done.err
    assert "RPE" in done.out
    assert {file.name for file in tmp_path.iterdir()} == RESULTS


@pytest.mark.parametrize("name", ["trajectory.txt", "kitti_poses.txt", "report.html"])
def test_a_folder_in_the_way_is_told_before_anything_is_done(
    edvo: Command, whole_sequence: Path, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).mkdir()
    done = edvo("run", whole_sequence, "-o", tmp_path, "--report", "--export", "kitti")
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(f"edvo: cannot write {tmp_path / name}: a folder stands there")
    assert done.err.count("\n") == 1
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_file_that_cannot_be_written_leaves_the_others(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("trajectory.txt", "kitti_poses.txt"):  # as if they came while it ran
        (tmp_path / name).mkdir()
    monkeypatch.setattr(files, "_check_place", lambda folder, name: None)
    kinds = ("--export", "kitti", "--export", "euroc")
    done = edvo("run", whole_sequence, "-o", tmp_path, "--max-frames", 5, *kinds)
    assert done.status == 1
    assert f"cannot write {tmp_path / 'trajectory.txt'}" in done.err.splitlines()[-1]
    written = ("frames.csv", "summary.json", "config.yaml", "kitti_times.txt", "euroc.csv")
    assert all((tmp_path / name).stat().st_size for name in written)


def test_nothing_to_export(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    done = edvo("run", sequence, "-o", tmp_path, "--export", "kitti", "--set", "edges.high=20000")
    assert done.status == 1
    (line,) = (line for line in done.err.splitlines() if "export" in line)
    assert line.startswith(f"edvo: {sequence}: no frame has a pose: nothing to export; ")
    assert {file.name for file in tmp_path.iterdir()} == {*RESULTS, sequence.name}
    assert "36 lost" in done.out


KINDS = ("--report", "--export", "edges", "--export", "colmap")


def all_files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def more_files(folder: Path) -> list[str]:
    return json.loads((folder / "summary.json").read_text())["more_files"]


def test_a_folder_used_again_holds_the_last_run_alone(
    edvo: Command, whole_sequence: Path, sequence: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert edvo("run", whole_sequence, "-o", out, *KINDS).status == 0
    assert more_files(out) == ["report.html", "edges.ply", *EXPORTED["colmap"]]
    (out / "colmap/mine.txt").write_text("mine")
    (out / "mesh.ply").write_text("mine")
    done = edvo("run", sequence, "-o", out, "--max-frames", 5, "--export", "kitti")
    assert done.status == 0, done.err
    gone = ["report.html", "edges.ply", *EXPORTED["colmap"]]
    assert f"removed what is of an earlier run: {', '.join(gone)}\n" in done.err
    mine = {"colmap/mine.txt", "mesh.ply"}
    assert all_files(out) == {*RESULTS, *EXPORTED["kitti"], *mine}
    assert more_files(out) == EXPORTED["kitti"]
    before = (out / "kitti_poses.txt").read_bytes()
    done = edvo("run", sequence, "-o", out, "--max-frames", 7, "--export", "kitti")
    assert (done.status, "removed" in done.err) == (0, False)
    assert (out / "kitti_poses.txt").read_bytes() != before
    options = ("--export", "kitti", "--set", "edges.high=20000")
    assert edvo("run", sequence, "-o", out, "--max-frames", 5, *options).status == 1
    assert all_files(out) == {*RESULTS, *mine}  # no frame has a pose
    assert more_files(out) == []


def test_an_interrupted_run_leaves_nothing_of_the_one_before(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert edvo("run", whole_sequence, "-o", tmp_path, *KINDS).status == 0
    monkeypatch.setattr(run_module, "progress", interrupting)
    done = edvo("run", whole_sequence, "-o", tmp_path, "--export", "edges")
    assert done.status == 130
    assert all_files(tmp_path) == {*RESULTS, "edges.ply"}
    assert more_files(tmp_path) == ["edges.ply"]


def test_files_are_named_before_they_are_there_and_removed_after(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert edvo("run", whole_sequence, "-o", tmp_path, "--max-frames", 5, *KINDS).status == 0

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    (tmp_path / "kitti_times.txt").write_text("mine")
    wanted = ("--max-frames", 5, "--export", "kitti", "--export", "edges")
    with monkeypatch.context() as patched:
        patched.setattr(Extras, "write", killed)
        assert edvo("run", whole_sequence, "-o", tmp_path, *wanted).status != 0
    before = ["report.html", "edges.ply", *EXPORTED["colmap"]]
    assert more_files(tmp_path) == [*before, "kitti_poses.txt"]
    assert all_files(tmp_path) == {*RESULTS, *before, "kitti_times.txt"}
    assert edvo("run", whole_sequence, "-o", tmp_path, *wanted).status == 0
    assert all_files(tmp_path) == {*RESULTS, *EXPORTED["kitti"], "edges.ply"}
    assert more_files(tmp_path) == [*EXPORTED["kitti"], "edges.ply"]


def test_exports_are_named_though_a_result_could_not_be_written(
    edvo: Command, whole_sequence: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = ("run", whole_sequence, "-o", tmp_path, "--max-frames", 5, "--export")
    assert edvo(*run, "edges").status == 0
    (tmp_path / "config.yaml").unlink()
    (tmp_path / "config.yaml").mkdir()  # as if it came while it ran
    (tmp_path / "euroc.csv").write_text("mine")
    monkeypatch.setattr(files, "_check_place", lambda folder, name: None)
    assert edvo(*run, "euroc").status == 1
    assert (tmp_path / "edges.ply").exists()
    assert more_files(tmp_path) == ["edges.ply", "euroc.csv"]


@pytest.mark.parametrize("files", [0, 1, 3])
def test_a_full_disk_leaves_what_the_run_before_wrote(
    edvo: Command, whole_sequence: Path, tmp_path: Path, files: int
) -> None:
    assert edvo("run", whole_sequence, "-o", tmp_path, "--export", "edges").status == 0
    with full_disk(files):
        assert edvo("run", whole_sequence, "-o", tmp_path, "--max-frames", 5).status == 1
    assert all_files(tmp_path) == {*RESULTS, "edges.ply"}
    assert edvo("run", whole_sequence, "-o", tmp_path, "--max-frames", 5).status == 0
    assert all_files(tmp_path) == RESULTS
