"""Experiments that come with the package; `smarts-bench run NAME` finds them wherever it is called."""
