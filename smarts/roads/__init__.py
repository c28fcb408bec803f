"""The road map as flat arrays, and the kernels that read it."""
