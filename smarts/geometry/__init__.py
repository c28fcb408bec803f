"""Geometry in the plane, arrays in and arrays out: frames, polylines, segments, boxes, spatial grids."""
