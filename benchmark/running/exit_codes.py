"""Exit codes of the commands; 0 is success, 2 a user error."""

INTERRUPTED = 130
"""Exit code after Ctrl-C or SIGTERM."""
FAILED = 1
"""A run failed."""
