"""Golden manoeuvres; `python perf/manoeuvres.py --record tests/unit/dynamics/manoeuvres.npz` renews them."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
SCRIPT = Path(__file__).resolve().parents[3] / "perf" / "manoeuvres.py"

SPEC = importlib.util.spec_from_file_location("manoeuvres", SCRIPT)
manoeuvres = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(manoeuvres)

TOLERANCE = {
    "time": 1e-6,
    "steering": 1e-3,
    "speed": 0.02,
    "lateral": 0.05,
    "yaw_rate": 5e-3,
    "x": 0.05,
    "y": 0.05,
    "spin": 0.2,
    "slip": 5e-3,
    "load": 30.0,
}


@pytest.mark.parametrize("name", manoeuvres.MANOEUVRES)
def test_manoeuvre_goes_as_recorded(name):
    golden = np.load(HERE / "manoeuvres.npz")
    record = manoeuvres.drive(name)
    assert set(record) == set(TOLERANCE)
    for column, values in record.items():
        assert values == pytest.approx(golden[f"{name}/{column}"], abs=TOLERANCE[column]), column


def test_the_record_is_of_these_manoeuvres():
    golden = np.load(HERE / "manoeuvres.npz")
    assert {key.split("/")[0] for key in golden.files} == set(manoeuvres.MANOEUVRES)
