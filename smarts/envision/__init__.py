"""Draws scenarios and recorded episodes."""
