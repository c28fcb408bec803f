"""Every agent of the zoo keeps its contract, and drives as its name says."""

import numpy as np
import pytest

from benchmark.running.zoo_contract import ZooDrive, check_entry
from smarts.agents.policy import BatchAgent
from smarts.errors import SmartsError
from smarts.registry import import_own
from smarts.types.actions import ActionSpaceType
from smarts.zoo import make_agent, make_spec
from smarts.zoo.agents import AGENTS
from smarts.zoo.driving import DRIVER
from tests.blocks import ROOT

OPTIONS = {"trajectory-v0": {"poses": [[0.5 * n, 0.0] for n in range(200)], "relative": True}}
"""Options of agents that need some."""
PLANNED = ("cut-in-v0", "overtaking-v0", "u-turn-v0")
LIKE_DRIVERS = [
    name
    for name in AGENTS
    if name not in ("gap-acceptance-v0", "trajectory-v0", "chase-via-points-v0", *PLANNED)
]

ALWAYS = ("mobil-v0", "cut-in-v0", "chase-via-points-v0")
"""One agent of each kind: by speed and lane, by paths, by objects."""
FAMILY = [pytest.param(name, marks=() if name in ALWAYS else pytest.mark.nightly) for name in AGENTS]


@pytest.mark.parametrize("name", FAMILY)
def test_every_agent_keeps_the_contract(name):
    found = [*check_entry(name, OPTIONS.get(name), steps=60)]
    agent, _ = make_agent(name, **OPTIONS.get(name, {}))
    assert len(found) == (6 if isinstance(agent, BatchAgent) else 3), found


@pytest.mark.parametrize("name", LIKE_DRIVERS)
def test_rule_based_drivers_share_their_columns(name):
    assert make_spec(name).interface == DRIVER
    assert DRIVER.action == ActionSpaceType.LaneWithContinuousSpeed
    assert DRIVER.vehicle_model == "kinematic"


@pytest.mark.parametrize("name", PLANNED)
def test_planned_drivers_act_by_paths(name):
    assert make_spec(name).interface == DRIVER.replace(action=ActionSpaceType.Trajectory)


BROKEN = """
import itertools
import numpy as np
from smarts.agents.policy import BatchAgent
from smarts.zoo import register
from smarts.zoo.driving import DRIVER

class Right(BatchAgent):
    interface = DRIVER
    observation = ["speed"]
    def act(self, batch):
        return np.zeros((len(batch.env_id), 2))

class Nan(Right):
    def act(self, batch):
        return np.full((len(batch.env_id), 2), np.nan)

COUNT = itertools.count()

class Repeats(Right):
    def act(self, batch):
        return np.full((len(batch.env_id), 2), [float(next(COUNT) % 50), 0.0])

class Rows(Right):
    def act(self, batch):
        return np.full((len(batch.env_id), 2), [float(len(batch.env_id)), 0.0])

class Sticky(Right):
    def __init__(self):
        self.count = {}
    def act(self, batch):
        actions = np.zeros((len(batch.env_id), 2))
        for row, key in enumerate(zip(batch.env_id.tolist(), batch.agent_id.tolist())):
            self.count[key] = self.count.get(key, 0) + 1
            actions[row, 0] = self.count[key] % 50
        return actions

for kind in (Right, Nan, Repeats, Rows, Sticky):
    register(kind.__name__.lower() + "-v0", kind)
"""

REASONS = {
    "nan": "not finite",
    "repeats": "the same requests get other actions",
    "rows": "a vehicle alone acts otherwise",
    "sticky": "the next vehicle in a column",
}
"""Part of the message for each."""


@pytest.fixture
def broken(tmp_path):
    (tmp_path / "broken_zoo.py").write_text(BROKEN)
    import_own([tmp_path / "broken_zoo.py"])
    return "broken_zoo"


def test_agents_that_break_the_contract_are_named(broken, tmp_path):
    assert len([*check_entry(f"{broken}:right-v0", steps=20)]) == 6
    for name, reason in REASONS.items():
        with pytest.raises(SmartsError, match=reason):
            print(name, [*check_entry(f"{broken}:{name}-v0", steps=20)])


def test_the_page_lists_all_agents():
    rows = [line.split("|") for line in (ROOT / "docs" / "guide" / "zoo.md").read_text().splitlines()]
    listed = {row[1].strip(" `"): row[2].strip() for row in rows if len(row) > 4 and "-v0" in row[1]}
    assert listed == {name: entry.description() for name, entry in AGENTS.items()}
    assert all(entry.author and entry.provenance and entry.m_level == "M0" for entry in AGENTS.values())


@pytest.mark.parametrize("name", [each for each in FAMILY if "chase-via-points-v0" not in each.values])
def test_nothing_begins_in_the_air_lock(name):
    """What an agent sees while traffic drives its vehicle changes nothing of what it does when it drives."""
    spec = make_spec(name, **OPTIONS.get(name, {}))
    with ZooDrive(spec, spec.build_agent(), "loop", egos=1) as drive:
        drive.reset()
        batches = [asked[0] for _ in range(90) if (asked := drive.step())]
    begin = len(batches) // 2
    fresh, shadow = spec.build_agent(), spec.build_agent()
    for batch in batches[:begin]:
        shadow.act(batch._replace(drives=np.zeros(1, bool)))
    for number, batch in enumerate(batches[begin:]):
        wanted = fresh.act(batch._replace(is_first=np.full(1, number == 0)))
        np.testing.assert_array_equal(wanted, shadow.act(batch._replace(is_first=np.zeros(1, bool))))
