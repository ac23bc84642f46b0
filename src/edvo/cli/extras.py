"""What `edvo run` writes beyond its results where it is asked to: the report and the exports."""

from collections.abc import Sequence
from pathlib import Path

from edvo.config import Config
from edvo.evaluation import Evaluation
from edvo.export.edge_map import EdgeMap
from edvo.files import Unwritten, write_atomically
from edvo.odometry import Odometry, Status
from edvo.report.tracking import Run
from edvo.report.watch import Watch


class Extras:
    """Report and exports of one run.

    Parameters
    ----------
    report : bool
        Whether there is to be a report.
    exports : sequence of str
        Kinds of exports.

    Raises
    ------
    ConfigError
        If there is no such export.
    MissingExtraError
        If it needs a package that is not there.

    Attributes
    ----------
    exports : sequence of str
        Those kinds.
    written : list of str
        Names of the files that are there so far, relative to the folder.
    """

    def __init__(self, report: bool, exports: Sequence[str]) -> None:
        self._report, self.exports = report, exports
        self.written: list[str] = []
        if exports:
            from edvo.export.registry import check_kinds

            check_kinds(exports)

    def files(self) -> list[str]:
        """Name the files that will be written.

        Returns
        -------
        list of str
            Relative to the folder.
        """
        files: list[str] = []
        if self._report:
            from edvo.report.run_page import PAGE

            files.append(PAGE)
        if self.exports:
            from edvo.export.registry import FILES

            files += [file for kind in self.exports for file in FILES[kind]]
        return files

    def watch(self, odometry: Odometry, frames: int) -> Watch:
        """Give a tracker that keeps what will be needed, which may be nothing.

        Parameters
        ----------
        odometry : Odometry
            What tracks.
        frames : int
            How many there will be.

        Returns
        -------
        Watch
        """
        self._map = EdgeMap(odometry.camera, odometry.config.edges)
        wanted = self._report or bool(self.exports)
        edge_map = self._map if wanted else None
        return Watch(odometry, frames, keep_sights=self._report, edge_map=edge_map)

    def write(
        self,
        run: Run,
        indices: Sequence[int],
        config: Config,
        errors: Evaluation | None,
        watch: Watch,
        folder: Path,
    ) -> None:
        """Write what was asked for; where no frame has a pose, there is nothing to export.

        Parameters
        ----------
        run : Run
            What was tracked.
        indices : sequence of int
            Which frames of the source that was.
        config : Config
            Its parameters.
        errors : Evaluation or None
            Its errors.
        watch : Watch
            What tracked it.
        folder : pathlib.Path
            Where to; it holds the results of the run.

        Raises
        ------
        OutputError
            If a file cannot be written; the others are.
        """
        unwritten = Unwritten()
        if self._report and run.frames:
            from edvo.datasets.inspection import inspect
            from edvo.report.run_page import PAGE, page

            warnings = [*run.source.warnings, *inspect(run.source)]
            html = page(run, config, errors, watch, self._map.points(), warnings)
            with unwritten.noted():
                write_atomically(folder / PAGE, html)
                self.written.append(PAGE)
        if self.exports:
            with unwritten.noted():
                self._export(run, indices, folder)
        unwritten.check()

    def _export(self, run: Run, indices: Sequence[int], folder: Path) -> None:
        from edvo.export.registry import Material, export

        trajectory = run.trajectory()
        if not len(trajectory):
            return
        index_at: dict[float, int] = {}
        for index, record in zip(indices, run.frames, strict=False):
            if record.status is not Status.LOST:
                index_at.setdefault(record.timestamp, index)
        posed = [index_at[time] for time in trajectory.timestamps.tolist()]
        material = Material(run.source, posed, trajectory, self._map.points())
        export(self.exports, material, folder, self.written.append)
