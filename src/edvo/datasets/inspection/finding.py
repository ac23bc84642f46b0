"""What a check of a recording found."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Finding:
    """What one check found, or why it could not tell.

    Parameters
    ----------
    check : str
        Its name.
    warnings : tuple of str
        What looks wrong, a line each.
    undecided : str
        Why it cannot tell; empty where it can.
    measured : dict
        What it measured, in plain types.
    """

    check: str
    warnings: tuple[str, ...] = ()
    undecided: str = ""
    measured: dict[str, Any] = field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """``suspect``, ``not observable`` or ``sound``."""
        if self.warnings:
            return "suspect"
        return "not observable" if self.undecided else "sound"

    def to_dict(self) -> dict[str, Any]:
        """Give verdict, reason and measurements in plain types."""
        told: dict[str, Any] = {"verdict": self.verdict}
        if self.undecided:
            told["why"] = self.undecided
        return {**told, **self.measured}
