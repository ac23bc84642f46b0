"""What the tests of several experiments share."""

import pytest

from edvo.experiments.bench import Bench

from .tiny import tiny_bench


@pytest.fixture(scope="session")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """Small synthetic sequences, rendered once for all tests."""
    return tiny_bench(tmp_path_factory.mktemp("bench"))
