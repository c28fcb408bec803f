"""Runs: training, validation, test, and what of them is on disk, whatever is killed when."""
