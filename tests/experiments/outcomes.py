"""What must be true of the outcome of any experiment."""

import math

from edvo.experiments.experiment import Experiment, Outcome

PNG = b"\x89PNG\r\n\x1a\n"


def check(experiment: Experiment, outcome: Outcome) -> None:
    """It is named, has numbers, pictures and verdicts, and says where its frames come from."""
    assert (outcome.name, outcome.title) == (experiment.name, experiment.title)
    assert experiment.paper
    assert outcome.tables
    for table in outcome.tables:
        assert table.rows
        assert table.records
        keys = [tuple(record) for record in table.records]
        assert all(set(key) <= set(max(keys, key=len)) for key in keys)
    assert outcome.figures
    assert all(figure.png.startswith(PNG) and figure.caption for figure in outcome.figures)
    assert outcome.findings
    for finding in outcome.findings:
        assert finding.holds in (True, False, None)
        assert type(finding.holds) in (bool, type(None))
        assert finding.claim.endswith(".")
        assert finding.sentence.rstrip().endswith(".")
    assert any("synthetic" in note for note in outcome.notes)
    names = [item.name for item in (*outcome.tables, *outcome.figures)]
    assert len({*names}) >= len(outcome.tables)


def finite(value: object) -> bool:
    """Whether it is a number that can be printed."""
    return isinstance(value, int | float) and math.isfinite(value)
