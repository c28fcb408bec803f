"""What is to be run: typed configs from YAML, and the runs that they stand for."""
