"""The experiments by name; each module is imported when it is asked for."""

from collections.abc import Iterator, Mapping
from importlib import import_module

from edvo.experiments.experiment import Experiment

NAMES = (
    "fig2",
    "fig3",
    "fig5",
    "table1",
    "fig6",
    "fig7",
    "fig8",
    "fig9",
    "fig10",
    "fig11",
    "table2",
    "table3",
)
"""In the order of the paper."""


class Experiments(Mapping[str, Experiment]):
    """Experiments by name: ``EXPERIMENT`` of the module of that name in this package."""

    def __getitem__(self, name: str) -> Experiment:
        """Import and give one."""
        if name not in NAMES:
            raise KeyError(name)
        found: Experiment = import_module(f"edvo.experiments.{name}").EXPERIMENT
        return found

    def __iter__(self) -> Iterator[str]:
        """Give the names."""
        return iter(NAMES)

    def __len__(self) -> int:
        """Count them."""
        return len(NAMES)


EXPERIMENTS = Experiments()
"""All there are."""
