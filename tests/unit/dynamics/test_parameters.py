import dataclasses

import pytest
import yaml

from smarts.dynamics import VehicleParametersError, layout, parameters, vehicle, vehicle_names
from smarts.dynamics.parameters import SteeringParameters, VehicleParameters, parse, tyre
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


@pytest.mark.parametrize("name", ["trailer", "pasenger"])
def test_unknown_vehicle(name):
    with pytest.raises(UnknownNameError, match=name) as error:
        vehicle(name)
    assert "passenger" in error.value.remedy


def test_unknown_tyre():
    with pytest.raises(UnknownNameError, match="slick"):
        tyre("slick")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{max_angle: 0.5, rate: fast}", "'fast' is not a number"),
        ("{max_angle: 0.5}", "'rate' is missing"),
        ("{max_angle: 0.5, rat: 1.0}", "did you mean 'rate'"),
        ("[0.5, 1.0]", "not a mapping"),
    ],
)
def test_broken_files_are_refused(text, message):
    with pytest.raises(VehicleParametersError) as error:
        parse(SteeringParameters, yaml.safe_load(text), "vehicles/mine.yaml")
    assert message in str(error.value)
    assert "vehicles/mine.yaml" in str(error.value)


def test_scientific_notation_is_a_number():
    assert parse(SteeringParameters, yaml.safe_load("{max_angle: 5e-1, rate: 1}"), "").max_angle == 0.5


def test_springs_too_close_together_are_refused(monkeypatch):
    car = vehicle("bus")
    topheavy = dataclasses.replace(car, front=dataclasses.replace(car.front, roll_stiffness=-2e6))
    monkeypatch.setattr(parameters, "vehicle", lambda name: topheavy)
    with pytest.raises(VehicleParametersError, match="roll_stiffness"):
        layout.pack("topheavy", "pacejka")


def test_fields_are_documented_by_name():
    assert {field.name for field in dataclasses.fields(VehicleParameters)} >= {
        "mass",
        "inertia",
        "tyre",
        "drive",
    }
