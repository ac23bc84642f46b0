"""Readers of recordings: one file a format, and a registry that tells them apart."""

from edvo.datasets.readahead import read_ahead
from edvo.datasets.registry import Format, formats, open_source
from edvo.datasets.source import Reading, Source

__all__ = ["Format", "Reading", "Source", "formats", "open_source", "read_ahead"]
