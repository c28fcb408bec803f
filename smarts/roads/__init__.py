"""Roads: maps of any format become one lane graph of flat arrays, and kernels answer questions about it."""
