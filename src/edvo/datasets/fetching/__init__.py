"""Public sequences from their data sets' own servers: the catalogue, download, unpacking."""

from edvo.datasets.fetching.catalogue import DataSet, Entry, catalogue, find
from edvo.datasets.fetching.sequence import Fetched, Watch, fetch

__all__ = ["DataSet", "Entry", "Fetched", "Watch", "catalogue", "fetch", "find"]
