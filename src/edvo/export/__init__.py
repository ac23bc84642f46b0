"""Poses and maps in the formats of other programs; `edvo.export.registry` lists them."""
