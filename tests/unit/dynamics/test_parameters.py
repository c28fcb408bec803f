import pytest

from smarts.dynamics import vehicle, vehicle_names


@pytest.mark.parametrize("name", vehicle_names())
def test_every_vehicle_is_complete_and_plausible(name):
    car = vehicle(name)
    assert car.source
    assert all(car.source)
    assert car.tyre.source
    assert car.front.drive_share + car.rear.drive_share == pytest.approx(1.0)
    assert car.wheelbase < car.length
    assert car.front_overhang + car.wheelbase < car.length
    roll, pitch, yaw = car.inertia
    assert max(roll, pitch, yaw) <= min(roll + pitch, pitch + yaw, yaw + roll), "no solid has such inertias"
