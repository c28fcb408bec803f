"""Small files of recorded traffic and of lanelets, as data sets have them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
"""Real recordings, which are not part of the project."""
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no real recordings in ../shared/data")


def tags(**values):
    """Return XML elements without attributes."""
    return "".join(f"<{name}>{value}</{name}>" for name, value in values.items())


def exact(value):
    return tags(exact=value)


def state(step, x, y, heading, speed, tag="state"):
    """Return a state of CommonRoad."""
    position = tags(point=tags(x=x, y=y))
    return tags(
        **{tag: tags(time=exact(step), position=position, orientation=exact(heading), velocity=exact(speed))}
    )


def obstacle(name, kind, states, shape="<rectangle><length>4</length><width>2</width></rectangle>"):
    """Return a dynamic obstacle of CommonRoad; states as texts or as arguments of `state`."""
    texts = [each if isinstance(each, str) else state(*each) for each in states]
    first = texts[0].replace("<state>", "<initialState>").replace("</state>", "</initialState>")
    parts = tags(type=kind, shape=shape) + first + tags(trajectory="".join(texts[1:]))
    return f'<dynamicObstacle id="{name}">{parts}</dynamicObstacle>'


def lanelet(name, centre, width=3.5, successors=(), left="", kind="urban", right=""):
    """Return a lanelet of CommonRoad around a centreline of points with normals along y."""
    points = np.array(centre, float)
    bounds = [points + np.array([0, side * width / 2]) for side in (1, -1)]
    texts = ["".join(tags(point=tags(x=x, y=y)) for x, y in bound) for bound in bounds]
    links = "".join(f'<successor ref="{each}"/>' for each in successors)
    for side, other in (("adjacentLeft", left), ("adjacentRight", right)):
        links += f'<{side} ref="{other}" drivingDir="same"/>' if other else ""
    parts = tags(leftBound=texts[0], rightBound=texts[1]) + links + tags(laneletType=kind)
    return f'<lanelet id="{name}">{parts}</lanelet>'


def commonroad(path, *parts, dt=0.1, version="2020a"):
    """Write a scenario of CommonRoad; return its path."""
    root = f'<commonRoad commonRoadVersion="{version}" timeStepSize="{dt}" benchmarkID="X-1" source="S">'
    path.write_text(f"{root}{''.join(parts)}</commonRoad>")
    return path


def argoverse(path, cars):
    """Write a scenario of Argoverse 2: (name, type, positions in the direction of x from a time step on)."""
    columns = ["track_id", "object_type", "timestep", "position_x", "position_y", "heading"]
    rows = [(name, kind, first + k, x, y, 0.0) for name, kind, first, y, xs in cars for k, x in enumerate(xs)]
    table = pd.DataFrame(rows, columns=columns).assign(velocity_x=10.0, velocity_y=0.0)
    table.to_parquet(path)
    return path
