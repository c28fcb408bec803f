"""Readers of maps of lanelets, one file a format: `read(path: Path) -> list[Lanelet]`."""
