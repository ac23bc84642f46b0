"""Sequences with known truth: scenes, renderer, motion, sensors and light (paper, section V-A)."""
