"""Indices of evaluation episodes; those of training environments count from 0."""

FIRST_VALIDATION_EPISODE = 1_000_000
"""First index of validations during training, which select checkpoints."""
FIRST_TEST_EPISODE = 2_000_000
"""First index of tests, whose scores are reported."""
