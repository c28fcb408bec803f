"""Maps that cannot be shown are refused once, in words."""

import logging

from smarts.sim import publisher_maps
from smarts.sim.publisher_maps import PublishedMaps
from smarts.stream import container
from smarts.stream.container import pack, unpack
from tests.maps import crossing, straight


def test_maps_are_made_once(monkeypatch):
    made, make = [], publisher_maps.map_message
    monkeypatch.setattr(publisher_maps, "map_message", lambda *given: made.append(given) or make(*given))
    maps = PublishedMaps([straight(), crossing()])
    for number in (0, 1, 0, 1):
        message = unpack(pack(maps.message(number)))
        assert (message["type"], message["map"], message["message"]["type"]) == ("map", number, "map")
    assert len(made) == 2
    assert not maps.refused


def test_a_map_that_is_too_large_is_refused_and_said_once(monkeypatch, caplog):
    monkeypatch.setattr(container, "MOST_BYTES", 100)
    maps = PublishedMaps([straight()])
    with caplog.at_level(logging.WARNING, "smarts"):
        for _ in range(3):
            maps.message(0)
    assert maps.refused == {0}
    (record,) = caplog.records
    assert "map 0" in record.getMessage()
    assert "a message 'map' of " in record.getMessage()
    assert "smaller map" in record.getMessage()
