"""The step: ownership of vehicles, agents that come and go, and the order of the stages."""
