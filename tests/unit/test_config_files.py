"""Reading YAML into typed sections: every mistake at once, with its line and the nearest name."""

from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from smarts.config import ConfigError, Section, fitted, read_config, sources
from tests.raising import raises


class Wheel(Section):
    radius: Annotated[float, Field(gt=0)]
    tyre: Literal["summer", "winter"] = "summer"


class Car(Section):
    name: str
    wheels: tuple[Wheel, ...] = Field(min_length=1, strict=False)
    seats: int = 5
    extra: dict[str, int] = Field(default_factory=dict)
    description: str = ""


class Fleet(Section):
    cars: dict[str, Car]


@pytest.fixture
def write(tmp_path):
    def write(text, name="car.yaml"):
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return tmp_path / name

    return write


def problems(file, *overrides):
    with pytest.raises(ConfigError) as caught:
        read_config(file, Car, overrides)
    return {str(problem).replace(f"{file.parent}/", "") for problem in caught.value.problems}


def test_all_mistakes_are_named_with_their_lines(write):
    file = write("nmae: a\nwheels:\n- radius: -1\n  tyre: wintr\n- {radius: wide}\nseats: 4.5\n")
    assert problems(file) == {
        "car.yaml:1: there is no key nmae; did you mean 'name'?",
        "car.yaml:1: name is missing; add it",
        "car.yaml:3: wheels[0].radius is -1; input should be greater than 0",
        "car.yaml:4: wheels[0].tyre is 'wintr'; input should be 'summer' or 'winter'",
        "car.yaml:5: wheels[1].radius is 'wide'; input should be a valid number",
        "car.yaml:6: seats is 4.5; input should be a valid integer",
    }


def test_a_file_extends_another_and_mistakes_are_placed_where_they_stand(write):
    write(
        "name: base\nseats: two\nextra: {a: 1, b: 2}\nwheels: [{radius: 1}, {radius: 2}]\ndescription: A\n",
        "base.yaml",
    )
    file = write("extends: base.yaml\nextra: {b: 3, c: x}\nwheels: [{radius: 0}]\n")
    assert problems(file) == {
        "base.yaml:2: seats is 'two'; input should be a valid integer",
        "car.yaml:2: extra.c is 'x'; input should be a valid integer",
        "car.yaml:3: wheels[0].radius is 0; input should be greater than 0",
    }
    good = write("extends: base.yaml\nseats: 2\nextra: {b: 3}\nwheels: [{radius: 3}]\n")
    assert read_config(good, Car) == Car(
        name="base", seats=2, extra={"a": 1, "b": 3}, wheels=(Wheel(radius=3.0),)
    )


def test_keys_after_a_section_within_a_section_hold_as_well(write):
    wheels = "wheels: [{radius: 1}]"
    write(f"cars:\n  a: {{name: a, {wheels}, extra: {{x: 1}}}}\n  b: {{name: b, {wheels}}}\n", "base.yaml")
    own = f"cars:\n  a: {{extra: {{y: 2}}, seats: 2, name: c}}\n  d: {{name: d, {wheels}}}\n"
    cars = read_config(write(f"extends: base.yaml\n{own}"), Fleet, ["cars.b.seats=1"]).cars
    assert {key: (car.name, car.seats, car.extra) for key, car in cars.items()} == {
        "a": ("c", 2, {"x": 1, "y": 2}),
        "b": ("b", 1, {}),
        "d": ("d", 5, {}),
    }


def test_the_command_line_goes_before_the_file(write):
    file = write("name: a\nwheels: [{radius: 1}]\nextra: {a: 1}\n")
    car = read_config(file, Car, ["extra.b=2", "seats=2"])
    assert (car.extra, car.seats) == ({"a": 1, "b": 2}, 2)
    assert problems(file, "seats=x") == {
        "command line, seats=x: seats is 'x'; input should be a valid integer",
    }
    assert problems(file, "seats", "seats=x") == {
        "command line: 'seats' is not KEY=VALUE; as in budget.minutes=5"
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b"\xff\xfe\x00", "not YAML"),
        ("a: [", "not YAML"),
        ("- a\n- b\n", "the file holds a list, not keys with values"),
        ("name: a\nname: b\nwheels: [{radius: 1}]\n", "name is there twice"),
        ("extends: other.yaml\n", "cannot read"),
        ("extends: car.yaml\n", "extends itself"),
        ("", "name is missing"),
    ],
)
def test_files_that_cannot_be_read_at_all(write, text, said):
    assert any(said in problem for problem in problems(write(text)))


def test_a_file_that_is_extended_and_not_there_is_placed_where_it_is_named(write):
    write("", "bus.yaml")
    assert problems(write("name: a\nextends: buss.yaml\n")) == {
        "car.yaml:2: cannot read buss.yaml: No such file or directory; did you mean 'bus.yaml'?"
    }
    # The file itself is no suggestion, and neither is what lies around its folder.
    assert problems(write("extends: cra.yaml\n")) == {
        "car.yaml:1: cannot read cra.yaml: No such file or directory; did you mean 'bus.yaml'?"
    }


def test_values_that_come_from_no_file_are_told_with_their_place():
    assert fitted({"radius": 1}, Wheel) == Wheel(radius=1.0)
    with pytest.raises(ConfigError) as caught:
        fitted({"radius": -1, "tyre": "x"}, Wheel, "here")
    assert str(caught.value).splitlines() == [
        "here: radius is -1; input should be greater than 0",
        "  here: tyre is 'x'; input should be 'summer' or 'winter'",
    ]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *[(text, text) for text in ("12:30", "010", "-07", "0.1.2", "1e1e1", "2026-01-02")],
        *[("0", 0), ("-10", -10), ("+1_000", 1000), ("0x1F", 31), ("0b11", 3), ("1e400", float("inf"))],
        *[
            ("0.5", 0.5),
            (".5", 0.5),
            ("5.", 5.0),
            ("-.inf", -float("inf")),
            (".5e1", 5),
            ("1.5E-1", 0.15),
            ("1e-3", 0.001),
            ("1_0e2", 1000),
        ],
    ],
)
def test_what_is_a_number_and_what_only_looks_like_one(write, text, value):
    class Anything(Section):
        it: Any

    assert read_config(write(f"it: {text}\n"), Anything) == Anything(it=value)


def test_names_that_are_not_beside_the_file_are_those_of_the_package(write, monkeypatch, tmp_path):
    packaged = tmp_path / "configs"
    packaged.mkdir()
    (packaged / "base.yaml").write_text("name: packaged\nwheels: [{radius: 1}]\n")
    monkeypatch.setattr(sources, "PACKAGED", packaged)
    own = tmp_path / "elsewhere"
    own.mkdir()
    monkeypatch.chdir(own)
    (own / "car.yaml").write_text("extends: base.yaml\nseats: 2\n")
    (own / "below.yaml").write_text("extends: below/base.yaml\n")
    assert read_config(Path("base.yaml"), Car).name == "packaged"
    assert read_config(Path("configs/base.yaml"), Car).name == "packaged"
    assert read_config(Path("car.yaml"), Car) == Car(name="packaged", wheels=(Wheel(radius=1.0),), seats=2)
    (problem,) = problems(Path("bse.yaml"))
    assert "'base.yaml'" in problem
    # What names a folder means that folder.
    with raises(ConfigError, values=["below/base.yaml"]):
        read_config(Path("below.yaml"), Car)
    (own / "base.yaml").write_text("name: nearest\nwheels: [{radius: 1}]\n")
    assert read_config(Path("car.yaml"), Car).name == "nearest"
