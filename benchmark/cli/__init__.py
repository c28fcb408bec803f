"""The command line, `smarts-bench`."""
