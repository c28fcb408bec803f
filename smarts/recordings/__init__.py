"""Recorded traffic: tracks of vehicles that were measured in the world, or in a simulation."""
