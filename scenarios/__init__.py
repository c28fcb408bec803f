"""The scenario suite: one folder a scenario, listed in `suite.yaml`."""
