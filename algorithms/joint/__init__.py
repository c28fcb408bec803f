"""The joint core: environments stepped together, dense arrays, replay, learners, RLlib glue."""
