"""Random zones, and bubbles made of shapely areas."""

import math

import numpy as np
from hypothesis import strategies as st
from shapely import affinity
from shapely.geometry import Polygon, box

from smarts.types.bubbles import PlacedBubble

NUMBERS = st.integers(0, 2**32 - 1)


def rings(area):
    parts = getattr(area, "geoms", (area,))
    return tuple(np.array(ring.coords)[:, :2] for part in parts for ring in (part.exterior, *part.interiors))


def bubble(zone, margin=0.0, **more):
    """Return a bubble of a shapely area, with a mitred margin."""
    wide = zone.buffer(margin, cap_style="square", join_style="mitre") if margin else zone
    return PlacedBubble(
        id=more.pop("id", "bubble"),
        actor=more.pop("actor", "agent"),
        policy=more.pop("policy", 0),
        interface=more.pop("interface", 0),
        zone=rings(zone),
        margin=rings(wide),
        centroid=(zone.centroid.x, zone.centroid.y),
        **more,
    )


def random_zone(random):
    """Return a star-shaped area, a rectangle, one with a hole, or two apart."""
    kind = random.integers(4)
    x, y = random.uniform(-50, 50, 2)
    if kind == 0:
        angles = np.sort(random.uniform(0, 2 * math.pi, 9)) + np.arange(9) * 1e-3
        radii = random.uniform(3, 20, 9)
        star = Polygon(np.stack([x + radii * np.cos(angles), y + radii * np.sin(angles)], 1))
        return star if star.is_valid else star.convex_hull
    rectangle = affinity.rotate(
        box(x, y, x + random.uniform(0.2, 30), y + random.uniform(0.2, 30)), random.uniform(0, 360)
    )
    if kind == 1:
        return rectangle
    if kind == 2:
        return rectangle.buffer(6).difference(rectangle)
    return rectangle.union(box(x + 60, y, x + 65, y + 20))
