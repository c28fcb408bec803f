"""A multi-agent driving simulator whose road users can all be intelligent.

Its packages are layers: see the table in CONTRIBUTING.md.
"""
