"""Maps that cannot be shown are refused once, in words."""

import logging

from smarts.sim.publisher_maps import PublishedMaps
from smarts.stream import container
from tests.maps import straight


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
