"""The scenario language and its build."""
