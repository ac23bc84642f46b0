"""Fig. 9 in a small setting."""

import numpy as np

from edvo.experiments import fig9
from edvo.experiments.bench import Bench
from edvo.experiments.fig9 import EXPERIMENT, PAPER, SETTINGS

from .outcomes import check, finite


def test_fig9(bench: Bench) -> None:
    outcome = EXPERIMENT.run(bench)
    check(EXPERIMENT, outcome)
    table = outcome.tables[0]
    assert table.rows[0][2:4] == ("28.8 ± 15.1", "18.7 ± 5.42")
    assert table.records[0]["normal_mean"] == PAPER["normal"][0]
    assert len(table.rows) == 1 + len(SETTINGS) * (1 + len(bench.names))
    for record in table.records[1:]:
        assert finite(record["robust_std"])
        assert int(record["normal_max"] or 0) <= 100
    assert len(outcome.findings) == len(SETTINGS)


def test_verdicts() -> None:
    few, many = np.array([9, 10, 11]), np.array([10, 20, 30])
    name = "as edvo runs"
    better = fig9.judge(name, {(name, "normal"): many, (name, "robust"): few})
    assert better.holds is True
    assert "-50 % in the mean" in better.sentence
    assert "-35 % and -64 %" in better.sentence
    assert fig9.judge(name, {(name, "normal"): few, (name, "robust"): many}).holds is False
