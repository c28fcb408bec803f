"""Plane geometry on arrays: frames, polylines, segments, boxes, spatial grids, rasters; and numba kernels."""
