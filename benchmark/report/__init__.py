"""Reports of experiments, made again at any time from what is on disk: pages, tables, plots, leaderboards."""
