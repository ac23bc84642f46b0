"""YAML as edvo's files have it: plain values, and each key once."""

from collections.abc import Hashable
from typing import Any

import yaml

MERGE = "tag:yaml.org,2002:merge"  # of "<<", which may come again


class _Loader(yaml.SafeLoader):
    """PyYAML's safe one, which would take the last of two that have the same key."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen = set()
        for key_node, _ in node.value:
            if key_node.tag == MERGE:
                continue
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                break  # PyYAML says so
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} comes twice", key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


def read_plain(text: str) -> Any:
    """Read YAML.

    Parameters
    ----------
    text : str

    Returns
    -------
    object
        Mappings, lists, strings, numbers, truth values, dates, or None.

    Raises
    ------
    yaml.YAMLError
        If it is none, a key comes twice in a mapping, or a value cannot be read. PyYAML itself
        lets errors of other kinds through, as of a date in a thirteenth month.
    """
    try:
        return yaml.load(text, _Loader)
    except RecursionError as error:
        raise yaml.MarkedYAMLError(problem="nested too deeply") from error
    except (ValueError, OverflowError) as error:
        raise yaml.MarkedYAMLError(problem="a value that cannot be read") from error
