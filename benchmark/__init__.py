"""The benchmark: train, evaluate, report."""
