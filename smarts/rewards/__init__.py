"""Rewards: weighted sums with the weights in YAML, and own rewards in Python."""
