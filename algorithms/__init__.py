"""A library of multi-agent reinforcement learning algorithms on RLlib."""
