"""Parameters from the options that several commands share."""

from pathlib import Path

from edvo.config import Config
from edvo.errors import ConfigError


def configure(
    preset: str | None, file: Path | None, overrides: list[str], seed: int | None
) -> Config:
    """Put parameters together: a preset or a file, then ``--set``, then ``--seed``."""
    if preset is not None and file is not None:
        raise ConfigError(f"--preset {preset} and --config {file} exclude each other; give one")
    config = Config.preset(preset or "default") if file is None else Config.load(file)
    if seed is not None:
        overrides = [*overrides, f"seed={seed}"]
    return config.with_overrides(overrides) if overrides else config
