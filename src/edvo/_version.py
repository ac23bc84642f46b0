"""The version of edvo, the single place that states it."""

__version__ = "0.1.0"
