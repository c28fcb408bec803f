"""What commands end with, beside 0 and the 2 of what the user can mend."""

INTERRUPTED = 130
"""After Ctrl-C or SIGTERM."""
FAILED = 1
"""Where a run could not be finished."""
