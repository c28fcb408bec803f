"""Small maps for the tests, as netconvert's and netgenerate's sources."""

import math
from pathlib import Path

ARMS = {"west": (-100, 0), "east": (100, 0), "north": (0, 100), "south": (0, -100)}


def write(folder: Path, **files: str) -> Path:
    """Write `map.<suffix>` files, `nod` meaning `map.nod.xml`; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for suffix, text in files.items():
        ending = f"{suffix}.xml" if len(suffix) == 3 else suffix
        (folder / f"map.{ending}").write_text(text)
    return folder


def cross() -> dict[str, str]:
    """Four arms of two lanes each way, 3.2 m wide, that meet at a signal at the origin."""
    nodes = ['<node id="centre" x="0" y="0" type="traffic_light"/>']
    edges = []
    for arm, (x, y) in ARMS.items():
        nodes.append(f'<node id="{arm}" x="{x}" y="{y}"/>')
        edges.append(f'<edge id="{arm}_in" from="{arm}" to="centre" numLanes="2" speed="15"/>')
        edges.append(f'<edge id="{arm}_out" from="centre" to="{arm}" numLanes="2" speed="15"/>')
    return {"nod": f"<nodes>{''.join(nodes)}</nodes>", "edg": f"<edges>{''.join(edges)}</edges>"}


def junction(kind: str) -> dict[str, str]:
    """Four arms of one lane each way that meet at a junction of some type at the origin."""
    sources = cross()
    return {
        "nod": sources["nod"].replace("traffic_light", kind),
        "edg": sources["edg"].replace('numLanes="2"', 'numLanes="1"'),
    }


def zipper() -> dict[str, str]:
    """Two lanes that merge into one, like a zip."""
    return {
        "nod": """<nodes>
            <node id="a" x="0" y="0"/> <node id="b" x="100" y="0" type="zipper"/> <node id="c" x="200" y="0"/>
        </nodes>""",
        "edg": """<edges>
            <edge id="two" from="a" to="b" numLanes="2"/> <edge id="one" from="b" to="c" numLanes="1"/>
        </edges>""",
        "con": """<connections>
            <connection from="two" to="one" fromLane="0" toLane="0"/>
            <connection from="two" to="one" fromLane="1" toLane="0"/>
        </connections>""",
    }


def roundabout() -> dict[str, str]:
    """Four arms of one lane each way at a ring of radius 20 m with two lanes."""
    nodes, edges = [], []
    places = {"east": 0, "north": 90, "west": 180, "south": 270}
    names = list(places)
    for number, (name, degrees) in enumerate(places.items()):
        cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        nodes.append(f'<node id="{name}" x="{120 * cosine:.2f}" y="{120 * sine:.2f}"/>')
        nodes.append(f'<node id="ring_{name}" x="{20 * cosine:.2f}" y="{20 * sine:.2f}"/>')
        edges.append(f'<edge id="{name}_in" from="{name}" to="ring_{name}" numLanes="1" speed="14"/>')
        edges.append(f'<edge id="{name}_out" from="ring_{name}" to="{name}" numLanes="1" speed="14"/>')
        following = names[(number + 1) % 4]
        arc = (math.radians(degrees + 9 * step) for step in range(11))
        shape = " ".join(f"{20 * math.cos(angle):.2f},{20 * math.sin(angle):.2f}" for angle in arc)
        edges.append(
            f'<edge id="ring_{name}" from="ring_{name}" to="ring_{following}" numLanes="2" speed="8" '
            f'priority="5" shape="{shape}"/>'
        )
    ring = " ".join(f"ring_{name}" for name in names)
    edges.append(f'<roundabout nodes="{ring}" edges="{ring}"/>')
    return {"nod": f"<nodes>{''.join(nodes)}</nodes>", "edg": f"<edges>{''.join(edges)}</edges>"}


def curve() -> dict[str, str]:
    """An S-bend of three lanes of unequal width one way and one lane back, with a change to two lanes."""
    xs = range(0, 201, 10)
    shape = " ".join(f"{x},{20 * math.sin(x * math.pi / 100):.2f}" for x in xs)
    back = " ".join(reversed(shape.split()))
    lanes = "".join(f'<lane index="{index}" width="{width}"/>' for index, width in enumerate((4.0, 3.5, 3.0)))
    return {
        "nod": """<nodes>
            <node id="a" x="0" y="0"/> <node id="b" x="200" y="0"/> <node id="c" x="300" y="80"/>
        </nodes>""",
        "edg": f"""<edges>
            <edge id="bend" from="a" to="b" numLanes="3" speed="20" shape="{shape}">{lanes}</edge>
            <edge id="back" from="b" to="a" numLanes="1" speed="10" shape="{back}"/>
            <edge id="straight" from="b" to="c" numLanes="2" speed="25"/>
            <edge id="straight_back" from="c" to="b" numLanes="1" speed="25"/>
        </edges>""",
    }


def gaps() -> dict[str, str]:
    """Two lanes east and one back, 3.2 m wide with 0.1 m between them, as netconvert built until 2016."""
    ways = {"there_0": "0,-4.9 100,-4.9", "there_1": "0,-1.6 100,-1.6", "back_0": "100,1.7 0,1.7"}
    lanes = [f'<lane index="{name[-1]}" shape="{shape}"/>' for name, shape in ways.items()]
    return {
        "nod": '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>',
        "edg": f"""<edges>
            <edge id="there" from="a" to="b" numLanes="2" speed="14">{"".join(lanes[:2])}</edge>
            <edge id="back" from="b" to="a" numLanes="1" speed="14">{lanes[2]}</edge>
        </edges>""",
    }


def city(iterations: int = 40) -> dict[str, str]:
    """A random town."""
    return {
        "netgcfg": f"""<configuration>
            <rand value="true"/> <rand.iterations value="{iterations}"/> <seed value="3"/>
            <rand.max-distance value="200"/> <default.lanenumber value="2"/>
        </configuration>"""
    }


def lane_kinds() -> dict[str, str]:
    """A straight road whose lanes are, from the right: sidewalk, bicycles, buses, cars, nobody."""
    users = ("pedestrian", "bicycle", "bus", "passenger bus")
    lanes = [f'<lane index="{index}" allow="{allow}"/>' for index, allow in enumerate(users)]
    return {
        "nod": '<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0"/></nodes>',
        "edg": f"""<edges><edge id="road" from="a" to="b" numLanes="5" speed="14">
            {"".join(lanes)}<lane index="4" disallow="all"/></edge></edges>""",
    }


def bus_lane() -> dict[str, str]:
    """A road of one lane that becomes one of two, of which the right one is for buses, and a side road."""
    return {
        "nod": """<nodes><node id="a" x="0" y="0"/><node id="b" x="100" y="0" type="priority"/>
            <node id="c" x="200" y="0"/><node id="d" x="100" y="-100"/></nodes>""",
        "edg": """<edges><edge id="in" from="a" to="b"/><edge id="side" from="b" to="d"/>
            <edge id="out" from="b" to="c" numLanes="2"><lane index="0" allow="bus"/></edge></edges>""",
    }


MAPS = {"cross": cross(), "roundabout": roundabout(), "curve": curve(), "city": city()}
