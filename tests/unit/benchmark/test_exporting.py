"""Exported policies act as their checkpoints do, greedily, on the observations that those see."""

import errno
import json
import subprocess
import sys
from contextlib import closing, suppress
from functools import cache

import numpy as np
import pytest
import ray

from benchmark import load_policy
from benchmark.experiment.models import Resources
from benchmark.results.files import ResultsError
from benchmark.running.cluster import start_ray
from benchmark.running.environments import environment
from benchmark.running.exporting import export_policy
from benchmark.running.zoo_contract import check_entry
from smarts.agents.hosting.facts import interface_from
from smarts.agents.policy import ActionBatch
from smarts.errors import SmartsError, UnknownNameError
from smarts.observations.arrays import VECTOR
from smarts.observations.lists import feature_list
from smarts.registry import import_own
from smarts.zoo import make_agent, make_spec
from smarts_agent_kit.exported import TEAM, ExportError
from smarts_agent_kit.exported import ExportedPolicy as KitPolicy
from smarts_agent_kit.weights import weights_files
from tests.raising import raises
from tests.unit.benchmark.untrained import write_untrained

TINY = """
algorithms: [{name}]
tasks: [loop]
seeds: [3]
settings: {{{name}: {settings}}}
environment: {environment}
resources: {{num_envs_per_env_runner: 2}}
"""
ENVS = 16
SETS = ", observation: neighbor_rows"


def rest_of_the_family(*rows):
    """Return rows of a parametrised test that run in `make nightly` alone."""
    return [pytest.param(*row, marks=pytest.mark.nightly) for row in rows]


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    """Return the run, and its folder, of an untrained policy; tests that change the folder copy it."""
    start_ray(Resources())

    @cache
    def make(name, settings="{}", environment="{agents: 4}"):
        tiny = TINY.format(name=name, settings=settings, environment=environment)
        return write_untrained(tmp_path_factory.mktemp(name), tiny)

    yield make
    ray.shutdown()


def recorded(run, folder, decisions):
    """Yield observations, masks, active agents and the checkpoint's greedy actions in a simulation."""
    policy = load_policy(folder.path)
    with closing(environment(run.task_setting, num_envs=ENVS)) as env:
        now = env.reset(7, np.arange(ENVS), stride=ENVS)
        for _ in range(decisions):
            (actions,) = policy.act(now)
            (observations,) = now.observations
            (masks,) = now.masks
            leaves = {name or VECTOR: leaf.copy() for name, leaf in observations.items()}
            yield leaves, masks, now.alive.copy(), now.reset.copy(), actions.copy()
            now = env.step([actions])


def own_leaves(observation, leaves, rows, agents=4):
    """Return the leaves of some rows without the agents' numbers, which the exported policy fills in."""
    index = feature_list(observation).layout(agents)["agent_index"]
    own = {name: leaf[rows] for name, leaf in leaves.items()}
    return own | {VECTOR: np.delete(own[VECTOR], np.arange(index.start, index.stop), axis=1)}


def batch_of(leaves, mask, env_id, step, is_first):
    count = len(env_id)
    return ActionBatch(
        leaves,
        np.ones((count, 4), bool) if mask is None else mask,
        env_id.astype(np.int32),
        np.zeros(count, np.int32),
        np.zeros(count, np.int32),
        np.zeros(count, np.int32),
        np.full(count, step, np.int32),
        is_first,
        np.zeros(count, np.uint64),
        np.ones(count, bool),
    )


@pytest.mark.parametrize(
    ("name", "settings", "more"),
    [
        ("ppo", "{gru: 8, set_width: 8}", SETS),
        ("maddpg", "{}", ", action: Continuous"),
        *rest_of_the_family(
            ("dqn", "{sharing: all}", ""),
            ("dqn", "{sharing: all, identity: false}", ""),
            ("ppo", "{}", ""),
            ("ppo", "{}", ", action: Continuous"),
            ("maac", "{}", ""),
            ("centralised_v", "{}", ""),
            ("qmix", "{}", ""),
            ("dqn", "{gru: 8, set_width: 8}", SETS),
            ("maddpg", "{set_width: 8}", f"{SETS}, action: Continuous"),
        ),
    ],
)
def test_the_actions_are_those_of_the_checkpoint(make, tmp_path, name, settings, more):
    """On 2,000 and more observations that it sees while it drives; bit for bit where actions are numbers."""
    run, folder = make(name, settings, f"{{agents: 4{more}}}")
    exported = export_policy(folder.path, "own-one", tmp_path, checkpoint="last")
    agents = [make_spec_of(exported, f"agent-{k}").build_agent() for k in range(4)]
    of_the_kit = [KitPolicy(exported, f"agent-{k}") for k in range(4)]
    observation = "neighbor_rows" if SETS in more else "benchmark"
    compared = 0
    for step, (leaves, masks, alive, reset, actions) in enumerate(recorded(run, folder, 80)):
        for k, agent in enumerate(agents):
            rows = np.flatnonzero(alive[:, k])
            own = own_leaves(observation, leaves, (rows, k))
            mask = None if masks is None else masks[rows, k]
            batch = batch_of(own, mask, rows, step, (step == 0) | reset[rows])
            given = agent.act(batch)
            assert of_the_kit[k].act(batch).tobytes() == given.tobytes()
            compared += len(rows)
            if given.ndim == 1:
                np.testing.assert_array_equal(given, actions[rows, k])
            else:
                np.testing.assert_allclose(given, actions[rows, k], rtol=0, atol=2e-6)
    assert compared >= 2000


@pytest.mark.parametrize(
    ("name", "settings", "more"),
    [
        ("commnet", "{}", ""),
        *rest_of_the_family(
            ("ppo", "{sharing: {one: [agent-0, agent-2], two: [agent-1, agent-3]}}", ""),
            ("commnet", "{sharing: all, set_width: 8}", SETS),
            ("networked_q", "{}", ""),
            ("networked_q", "{set_width: 8}", SETS),
            ("ppo", "{sharing: all, gru: 8}", ""),
        ),
    ],
)
def test_a_team_acts_as_the_checkpoint_also_where_agents_talk(make, tmp_path, name, settings, more):
    """With agents that leave one by one, in simulations side by side."""
    run, folder = make(name, settings, f"{{agents: 4{more}}}")
    exported = export_policy(folder.path, "own-one", tmp_path, checkpoint="last")
    assert len(weights_files(exported)) == len([*exported.glob("*.npz")]) == len(run_groups(exported))
    team, of_the_kit = make_spec_of(exported, TEAM).build_agent(), KitPolicy(exported, TEAM)
    assert team.talks == of_the_kit.talks == (name in ("commnet", "networked_q"))
    observation = "neighbor_rows" if SETS in more else "benchmark"
    compared, chosen = 0, set()
    for step, (leaves, masks, alive, reset, actions) in enumerate(recorded(run, folder, 80)):
        envs, agents = np.nonzero(alive)
        own = own_leaves(observation, leaves, (envs, agents))
        mask = None if masks is None else masks[envs, agents]
        batch = batch_of(own, mask, envs, step, (step == 0) | reset[envs])._replace(
            agent_id=agents.astype(np.int32)
        )
        given = team.act(batch)
        np.testing.assert_array_equal(given, actions[envs, agents])
        np.testing.assert_array_equal(of_the_kit.act(batch), given)
        compared += len(envs)
        chosen |= {*given.tolist()}
    assert compared >= 2000
    assert len(chosen) > 1


def run_groups(exported):
    """Return the groups of agents of an exported policy; each has a network."""
    return json.loads((exported / "policy.json").read_text())["groups"]


def of_an_earlier_version(exported):
    """Return an exported policy's folder, without its digests."""
    file = exported / "policy.json"
    content = json.loads(file.read_text())
    assert content.pop("digests").keys() == {"policy.json", *(each.name for each in weights_files(exported))}
    file.write_text(json.dumps(content))
    return exported


def test_a_changed_bit_of_an_exported_policy_is_refused(make, tmp_path):
    _, folder = make("ppo", "{sharing: all, hidden: [8]}")
    exported = export_policy(folder.path, "own-one", tmp_path, checkpoint="last")
    known = json.loads((exported / "policy.json").read_text())
    for file in (exported / "policy.json", exported / "policy.npz"):
        whole = file.read_bytes()
        for place in range(0, len(whole), 97):
            changed = bytearray(whole)
            changed[place] ^= 1
            file.write_bytes(changed)
            with suppress(ExportError):
                KitPolicy(exported)
                assert file.suffix == ".json"  # a space is another space, or the key of the digests another
                found = json.loads(file.read_text())
                assert [found[name] for name in known if name != "digests"] == [
                    each for name, each in known.items() if name != "digests"
                ]
        file.write_bytes(whole)
    KitPolicy(of_an_earlier_version(exported))


def test_an_export_that_fails_leaves_nothing(make, tmp_path, monkeypatch):
    _, folder = make("ppo", "{sharing: all}")
    (tmp_path / "file").write_text("")
    with raises(ResultsError, values=["cannot be written"]):
        export_policy(folder.path, "own-one", tmp_path / "file", checkpoint="last")

    def full(*arguments, **given):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez_compressed", full)
        with raises(ResultsError, values=["No space left"]):
            export_policy(folder.path, "own-one", tmp_path / "out", checkpoint="last")
    assert not [*(tmp_path / "out").iterdir()]
    export_policy(folder.path, "own-one", tmp_path / "out", checkpoint="last")


def make_spec_of(folder, agent=""):
    """Return the spec of an exported folder, imported under a name that no other test uses."""
    link = folder.parent / f"zoo_{abs(hash(str(folder)))}"
    if not link.exists():
        link.symlink_to(folder)
    import_own([link])
    return make_spec(f"{link.name}:own-one-v0", agent=agent)


@pytest.mark.parametrize(
    ("name", "settings", "environment", "reason"),
    [
        ("bicnet", "{}", "{agents: 2}", "messages"),
        ("mf_q", "{}", "{agents: 2}", "others"),
        ("ppo", "{}", "{agents: 2, observation: paper}", "images"),
    ],
)
def test_policies_that_cannot_act_alone_are_refused(make, tmp_path, name, settings, environment, reason):
    _, folder = make(name, settings, environment)
    with pytest.raises(SmartsError, match=reason):
        export_policy(folder.path, "own-one", tmp_path, checkpoint="last")
    assert not (tmp_path / "own_one").exists()


def test_an_exported_agent_keeps_the_contract_and_needs_no_learner(make, tmp_path):
    _, folder = make("ppo", "{sharing: all}")
    exported = export_policy(folder.path, "plain-driver", tmp_path, checkpoint="last")
    assert {each.name for each in exported.iterdir()} == {"__init__.py", "policy.json", "policy.npz"}
    import_own([exported])
    assert len([*check_entry("plain_driver:plain-driver-v0", steps=60)]) == 6
    spec = make_spec("plain_driver:plain-driver-v0", agent="agent-2")
    assert spec.build_agent().period == 5
    with pytest.raises(UnknownNameError):
        make_agent("plain_driver:plain-driver-v0", agent="agent-9")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r});"
        "from smarts.zoo import build_agent; build_agent('plain_driver:plain-driver-v0');"
        "assert not {'algorithms', 'benchmark', 'torch', 'ray'} & {*sys.modules}, 'imports a learner'"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    code = (
        "import json, sys; from smarts_agent_kit.exported import ExportedPolicy;"
        f"policy = ExportedPolicy({str(exported)!r}); print(json.dumps(policy.interface));"
        "assert not {'smarts', 'numba', 'torch', 'ray'} & {*sys.modules}, 'needs more than the kit'"
    )
    said = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert interface_from(json.loads(said), "there") == spec.interface
    with pytest.raises(ExportError):
        KitPolicy(exported, "agent-9")
    with pytest.raises(SmartsError, match=r"holds '__init__\.py'"):
        export_policy(folder.path, "plain-driver", tmp_path, checkpoint="last")
    with pytest.raises(SmartsError, match="Plain"):
        export_policy(folder.path, "Plain", tmp_path, checkpoint="last")
    (exported / "policy.npz").write_bytes(b"broken")
    with pytest.raises(SmartsError, match=r"policy\.npz"):
        make_agent("plain_driver:plain-driver-v0")
    (exported / "policy.json").write_text("{}")
    with pytest.raises(SmartsError, match="format"):
        make_spec("plain_driver:plain-driver-v0")
