"""Each table and figure of the paper as an experiment: one file each, found by name."""
