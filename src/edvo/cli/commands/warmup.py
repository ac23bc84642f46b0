"""Arguments and options of `edvo warmup`."""


def warmup() -> None:
    """Compile the tracker once, so that later runs start at once."""
    from edvo.cli.warmup import warmup as body

    body()
