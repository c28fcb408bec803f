"""Environments: the simulation as Gymnasium, PettingZoo, RLlib and arrays."""
