"""Readers of recorded traffic, one file a format; `smarts.recordings.reading` finds and completes."""
