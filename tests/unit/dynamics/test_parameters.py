import pytest

from smarts.config import ConfigError, read_config
from smarts.dynamics import layout, vehicle, vehicle_names
from smarts.dynamics.parameters import SteeringParameters
from smarts.errors import UnknownNameError


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


@pytest.mark.parametrize("name", vehicle_names())
def test_static_loads_carry_the_weight_without_a_moment(name):
    record = layout.pack(name, "pacejka")
    assert record["static_load"].sum() == pytest.approx(record["mass"] * layout.GRAVITY)
    assert record["static_load"] @ record["wheel_x"] == pytest.approx(0.0, abs=1e-6)


def test_sedan_is_the_passenger_car():
    assert vehicle("sedan") is vehicle("sedan")
    assert vehicle("sedan") == vehicle("passenger")


def test_bmw_320i_in_its_publishers_units():
    car = vehicle("passenger")
    assert car.mass == pytest.approx(74.91452 * 14.5939, rel=1e-3)
    assert car.cog_to_front_axle == pytest.approx(3.793293 * 0.3048, rel=1e-3)
    assert car.inertia[2] == pytest.approx(1321.416 * 1.35582, rel=1e-3)
    assert car.front.spring == pytest.approx(1675 * 14.5939, rel=1e-3)


def test_unknown_vehicle():
    with pytest.raises(UnknownNameError) as error:
        vehicle("pasenger")
    assert "passenger" in error.value.remedy


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("max_angle: 0.5\nrate: fast", 2),
        ("max_angle: 0.5\nrate: 1.0\nrat: 1.0", 3),
    ],
)
def test_broken_files_are_refused(tmp_path, text, line):
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as error:
        read_config(file, SteeringParameters)
    assert [problem.place for problem in error.value.problems] == [f"{file}:{line}"]
