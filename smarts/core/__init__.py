"""Import aliases of the original's module paths that its scenario files use, and nothing else."""
