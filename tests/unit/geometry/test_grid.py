import numpy as np

from smarts.geometry.grid import build_grid


def grid_of(points, reach, size=2.0, outlines=()):
    start = np.array([0, len(points)], np.int32)
    outline = np.array(outlines, float).reshape(-1, 2)
    return build_grid(
        start,
        np.array(points, float),
        np.array([reach]),
        np.array([0, len(outline)], np.int32),
        outline,
        size,
    )


def runs(grid, cell):
    return grid.run[grid.run_start[cell] : grid.run_start[cell + 1]].tolist()


def test_cells_list_the_lines_that_cross_them():
    grid = grid_of([(0, 0), (1, 0), (3, 0), (5, 0)], reach=0.0)
    assert (grid.columns, grid.rows) == (3, 1)
    assert [runs(grid, cell) for cell in range(3)] == [[[0, 0, 2]], [[0, 1, 3]], [[0, 2, 3]]]


def test_a_line_that_reenters_a_cell_has_two_runs():
    grid = grid_of([(0, 0), (9, 0), (9, 9), (0.5, 0.5)], reach=0.0)
    assert runs(grid, 0) == [[0, 0, 1], [0, 2, 3]]


def test_cells_list_every_line_within_reach_of_their_points():
    generator = np.random.default_rng(0)
    points = np.cumsum(generator.normal(size=(200, 2)), axis=0)
    grid = grid_of(points, reach=1.5)
    for x, y in points[:-1] + generator.uniform(-1, 1, (199, 2)):
        column, row = ((np.array([x, y]) - grid.origin) // grid.size).astype(int)
        listed = {p for _, a, b in runs(grid, row * grid.columns + column) for p in range(a, b + 1)}
        close = np.flatnonzero(np.hypot(*(points - [x, y]).T) <= 1.5)
        assert set(close) <= listed


def test_outlines_are_listed_by_bounding_box():
    grid = grid_of([(0, 0), (10, 10)], reach=0.0, outlines=[(1, 1), (3, 1), (3, 1.5)])
    listed = [cell for cell in range(36) if grid.outline_start[cell] < grid.outline_start[cell + 1]]
    assert listed == [0, 1]
    assert grid.outline.tolist() == [0, 0]
