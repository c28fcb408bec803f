"""Lane types of OpenStreetMap roads: SUMO's table, with some roads opened to cars."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

_ROAD = "highway.unclassified"
OPENED = {
    # SUMO lets only "vip" vehicles on race tracks, at 300 km/h. Above 79 km/h netconvert takes pit lanes for
    # motorway ramps and widens the track.
    "highway.raceway": {"numLanes": "2", "speed": "21.9", "allow": "passenger bus truck motorcycle vip"},
    # A road whose class is not mapped yet; SUMO does not know the type.
    "highway.road": {},
}
"""Types of roads that SUMO's table closes to cars: how they differ from unclassified roads.

Service roads (deliveries only), tracks (motorcycles), fords and paths stay closed; busways are for buses.
"""


def write_road_types(sumo: Path, folder: Path) -> Path:
    """Write the table of road types as a file for netconvert's option `type-files`; return the file.

    Args:
        sumo: The folder of the SUMO package.
        folder: Where to.
    """
    root = ElementTree.parse(sumo / "data" / "typemap" / "osmNetconvert.typ.xml").getroot()
    known = {element.get("id", ""): element for element in root.iter("type")}
    for name, changes in OPENED.items():
        attributes = dict(known[_ROAD].attrib) | {"id": name} | changes
        if "allow" in changes:
            del attributes["disallow"]
        if name in known:
            root.remove(known[name])
        root.append(ElementTree.Element("type", attributes))
    file = folder / "osm.typ.xml"
    ElementTree.ElementTree(root).write(file)
    return file
