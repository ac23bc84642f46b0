"""Fig. 7 in a small setting."""

import numpy as np

from edvo.experiments import fig7
from edvo.experiments.bench import Bench
from edvo.experiments.fig7 import EXPERIMENT, Residuals
from edvo.experiments.residual_fits import fit_gaussian, fit_student

from .outcomes import check, finite


def test_fig7(bench: Bench) -> None:
    outcome = EXPERIMENT.run(bench)
    check(EXPERIMENT, outcome)
    records = outcome.tables[0].records
    assert {record["iteration"] for record in records} == {3, 20}
    for record in records:
        assert all(finite(value) for key, value in record.items() if key.endswith("likelihood"))
        best, paper = (float(record[f"{n}_log_likelihood"] or 0) for n in ("t_ml", "t_nu2"))
        assert best >= paper - 1e-6


def test_more_iterations_leave_smaller_residuals(bench: Bench) -> None:
    found = fig7.residuals_after(bench.sequence("fr3/long_office_household"), 6)
    assert len(found[3]) > 1000
    assert np.isfinite(found[20]).all()
    assert fit_student(found[20], 2.0).scale <= fit_student(found[3], 2.0).scale * 1.02


def test_verdicts(bench: Bench) -> None:
    rng = np.random.default_rng(0)
    sequence = bench.sequence("fr3/long_office_household")

    def residuals(iteration: int, values: np.ndarray) -> Residuals:
        fits = fit_gaussian(values), fit_student(values, 2.0), fit_student(values)
        return Residuals(sequence, iteration, values, *fits)

    heavy = [residuals(n, rng.standard_t(2, 4000)) for n in (3, 20)]
    assert fig7._judge_fit(heavy).holds
    assert fig7._judge_nu(heavy).holds
    assert fig7._judge_steepness(heavy).holds is False
    gaussian = [residuals(n, rng.normal(0, 9, 4000)) for n in (3, 20)]
    assert fig7._judge_fit(gaussian).holds is False
    assert fig7._judge_nu(gaussian).holds is False
    assert fig7._judge_steepness(heavy + gaussian).holds
