import pytest

from smarts.config import ConfigError, read_config
from smarts.dynamics import vehicle, vehicle_names
from smarts.dynamics.parameters import SteeringParameters


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


@pytest.mark.parametrize(
    ("text", "line"), [("max_angle: 0.5\nrate: fast", 2), ("max_angle: 0.5\nrate: 1.0\nrat: 1.0", 3)]
)
def test_broken_files_are_refused(tmp_path, text, line):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as error:
        read_config(file, SteeringParameters)
    assert [problem.place for problem in error.value.problems] == [f"{file}:{line}"]
