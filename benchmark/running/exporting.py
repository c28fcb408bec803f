"""Exports the policy of a run as an agent of the zoo: a folder with weights and a plain module."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import torch
from gymnasium.spaces import Discrete
from numpy.typing import NDArray
from torch import nn

from algorithms.commnet import CommNetModule
from algorithms.joint.env import CARRIED, MEMORY
from algorithms.joint.spec import Group
from algorithms.networked_q import NetworkedQModule
from algorithms.parts.distributions import DeterministicHead, GaussianHead
from algorithms.parts.networks import Encoder
from algorithms.registry import ALGORITHMS
from benchmark.experiment.runs import DEMONSTRATIONS, KL_TO, TEST, VERSION, Run
from benchmark.results.files import check_free, replaced_folder
from benchmark.results.run_folder import RunFolder
from benchmark.running.policy import checked_modules, read_run
from smarts.agents.hosting.facts import facts_of
from smarts.errors import SmartsError
from smarts.observations.arrays import VECTOR
from smarts.observations.lists import FeatureChoice, FeatureList, feature_list
from smarts.observations.own_state import AgentIndex
from smarts.zoo.exported import interface_of
from smarts_agent_kit.exported import JOINT_Q, TRAINED
from smarts_agent_kit.weights import CONTENT, DIGESTS, FORMAT, HEAR, policy_digests, weights_file

NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
MODULE = '''"""{title}; written by `smarts-bench export`."""

from functools import partial
from pathlib import Path

from smarts.zoo import register
from smarts.zoo.exported import exported_spec

register(
    "{locator}",
    partial(exported_spec, Path(__file__).parent),
    m_level="{level}",
    provenance="{provenance}",
)
'''
_INDEX = "agent_index"
TALKING = (CommNetModule, NetworkedQModule)
"""Policies whose messages are exported."""
LAYERS = {
    nn.Linear: ("linear", ("weight", "bias")),
    nn.GRUCell: ("gru", ("weight_ih", "bias_ih", "weight_hh", "bias_hh")),
    nn.Tanh: ("tanh", ()),
    nn.ReLU: ("relu", ()),
}
"""Layer -> its kind in an exported policy, and its parameters."""


def export_policy(
    path: Path,
    name: str,
    out: Path = Path(),
    *,
    checkpoint: Literal["last", "best"] = "best",
    imports: Sequence[str | Path] = (),
) -> Path:
    """Write the policy of a run as an agent of the zoo, and return its folder.

    Args:
        path: The run's folder.
        name: Name of the agent, without a version: "left-turner" becomes "left-turner-v0".
        out: The parent of the new folder.
        checkpoint: The last, or the best in validation.
        imports: Files and folders of own code, by default the ones of the training.

    Raises:
        ResultsError: There is no run or no such checkpoint, or it is damaged.
        CheckpointError: The run's algorithm, or a setting of its networks, is another than the checkpoint's.
        SmartsError: The policy cannot act by itself, the name is invalid, or the folder exists or cannot be
            written; nothing is left of it then.
    """
    if NAME.fullmatch(name) is None:
        raise SmartsError(
            f"{name!r} cannot be the agent's name",
            place="--zoo",
            remedy="use a-z, 0-9 and '-', as left-turner",
        )
    locator, folder = f"{name}-v0", out / name.replace("-", "_")
    check_free(folder)
    run_folder = RunFolder(path)
    run = read_run(run_folder, imports)
    content, weights = described(run, checked_modules(run, run_folder.kept(checkpoint)))
    provenance = "; ".join([f"{run}, {checkpoint} checkpoint", *learned_from(run, run_folder)])
    level = ALGORITHMS[run.algorithm].level if run.algorithm in ALGORITHMS else ""
    title = f"The agent {locator}: {provenance}".replace('"', "'").replace("\\", "/")
    text = MODULE.format(
        title=title, locator=locator, level=level.split("-")[0], provenance=title.partition(": ")[2]
    )

    with replaced_folder(folder) as partial:
        for number, arrays in enumerate(weights):
            np.savez_compressed(weights_file(partial, number), allow_pickle=False, **arrays)
        said = content | {DIGESTS: policy_digests(partial, content)}
        (partial / CONTENT).write_text(json.dumps(said, indent=1), encoding="utf-8")
        (partial / "__init__.py").write_text(text, encoding="utf-8")

    return folder


def learned_from(run: Run, folder: RunFolder) -> list[str]:
    """Return where the demonstrations come from that a policy has learned from, and their licence.

    They may be those of the run that it began with, or keeps near to.
    """
    said = folder.facts().get(DEMONSTRATIONS)
    if said is None:
        origins = run.task_setting.task.start_from, run.settings.get(KL_TO)
        others = [RunFolder(Path(each)) for each in origins if each]
        found = [learned_from(read_run(each), each) for each in others if each.config.exists()]
        return [*dict.fromkeys(line for lines in found for line in lines)]
    named = {"data": said.get("name") or said.get("scenario"), **said}
    return [f"{key}: {named[key]}" for key in ("data", "attribution", "licence") if named.get(key)]


def described(run: Run, modules: Mapping[str, Any]) -> tuple[dict[str, Any], list[dict[str, NDArray]]]:
    """Return what `policy.json` holds, and the files of weights: each those of a group.

    Args:
        run: The trained run.
        modules: Its policy networks by group.

    Raises:
        SmartsError: A policy cannot act by itself, or in the zoo.
    """
    if reason := next(_hindrances(run, modules), None):
        raise SmartsError(
            f"the policy cannot be exported: {reason}",
            place=str(run),
            remedy="export a run whose agents act on their own observation, such as ppo, dqn or maddpg",
        )
    environment, spec = run.task_setting.environment, next(iter(modules.values())).spec
    (block,) = spec.spaces.blocks
    observation, index = _without_index(feature_list(environment.observation), len(block.agents))
    driving, content = environment.driving(), {"format": FORMAT, "run": str(run)}
    agents: dict[str, Any] = {}
    groups: dict[str, Any] = {}
    weights: list[dict[str, NDArray]] = []
    for group in spec.groups:
        layers = [_exported_layer(each) for each in _chain(modules[group.id])]
        sets = _sets(modules[group.id])
        groups[group.id] = {
            "places": _places(modules[group.id]),
            "memory": modules[group.id].memory_size,
            "layers": [kind for kind, _ in layers],
            "sets": [*sets],
        }
        named = [*sets.items(), *((number, arrays) for number, (_, arrays) in enumerate(layers))]
        weights.append(
            {f"{group.id}/{name}/{k}": array for name, arrays in named for k, array in enumerate(arrays)}
        )
        for place, name in enumerate(group.agents):
            vehicle = {
                key: getattr(driving[name], key)
                for key in ("vehicle", "vehicle_model", "tyre_model", "flat_tyres")
            }
            agents[name] = {"group": group.id, "place": place, "number": block.agents.index(name)} | vehicle
            agents[name]["interface"] = facts_of(interface_of(vehicle, environment.action))
    content |= {
        "observation": observation,
        "index": index,
        "leaves": [leaf or VECTOR for leaf in block.observation if not leaf.startswith(CARRIED)],
        "period": environment.decision_interval,
        "action": environment.action,
        **_head(next(iter(modules.values())), block),
        JOINT_Q: isinstance(next(iter(modules.values())), NetworkedQModule),
        TRAINED: trained_content(run),
        "agents": {name: agents[name] for name in block.agents},
        "groups": groups,
    }
    return content, weights


def trained_content(run: Run) -> dict[str, Any]:
    """Return what a policy was trained on, and is tested on: `task`, `seed` and a task setting's content."""
    setting = run.task_setting
    kept = ("scenarios", "traffic", "environment", VERSION)
    given = {name: each for name, each in setting.content().items() if name in kept}
    test = {TEST: conditions} if (conditions := setting.test_content().get(TEST)) else {}
    return {"algorithm": run.label, "task": setting.task.name, "seed": run.seed, **given, **test}


def _places(module: Any) -> int:
    """Return how many numbers say which agent of its group an agent is; 0 where a policy does without."""
    is_alike = isinstance(module, TALKING) or module.group.places == 1
    return 0 if is_alike else module.group.places


def _hindrances(run: Run, modules: Mapping[str, Any]) -> Iterator[str]:
    """Yield why policies cannot act by themselves, or in the zoo."""
    environment, spec = run.task_setting.environment, next(iter(modules.values())).spec
    if environment.adapter is not None:
        yield f"the run's own adapter {environment.adapter!r} makes its observations"
    if len(spec.spaces.blocks) > 1:
        yield "its agents have different observations or actions"
    features = feature_list(environment.observation)
    for each in (*features.stacked, *features.features):
        kind = each.kind()
        if not isinstance(each.source, str):
            yield f"it observes the class {each.name!r}, which has no name"
        depends = kind.size_for(1) != kind.size_for(2)
        if depends and (kind is not AgentIndex or each in features.stacked):
            yield f"its observation {each.name!r} depends on the number of agents"
    for group in spec.groups:
        yield from _hindrances_of(group, modules[group.id])


def _hindrances_of(group: Group, module: Any) -> Iterator[str]:
    """Yield why a group's policy cannot act by itself."""
    if module.acts_jointly or (module.communicates and not isinstance(module, TALKING)):
        yield "its policies need messages or actions of other agents to act"
    if foreign := [name for name in group.observation if name.startswith(CARRIED) and name != MEMORY]:
        yield f"its policies see what others do, or draw ({', '.join(foreign)})"
    if any(len(space.shape) == 3 for space in group.observation.values()):
        yield "its policies see images, whose convolutions are not exported"
    layers = _chain(module)
    if unknown := [type(each).__name__ for each in layers if not isinstance(each, (tuple, *LAYERS))]:
        yield f"its policy has a layer {unknown[0]}, which is not exported"
    if not layers:
        yield "its policy is no chain of layers"


def _chain(module: Any) -> list[Any]:
    """Return a policy's layers in order, of CommNet some as kind and arrays; empty if they are no chain."""
    if isinstance(module, CommNetModule):
        return [*module.first, *_hearing_layers(module), *module.decoder]
    if isinstance(module, NetworkedQModule):
        return [*module.q.folded()]
    parts = module.feedforward_parts()
    if parts is not None:
        return [*parts[1]]
    if module.memory_size and hasattr(module, "trunk"):
        return [*module.trunk, module.memory.cell, *module.body]
    if module.memory_size and hasattr(module, "q"):
        return [*module.q.trunk, module.q.memory.cell, module.q.folded()[-1]]
    return []


def _sets(module: Any) -> dict[str, list[NDArray]]:
    """Return the weights and biases of each observation that a policy reads as a set of rows."""
    if isinstance(module, NetworkedQModule):
        (encoder,) = module.q.encoders.values()
    else:
        parts = module.feedforward_parts()
        encoder = parts[0] if parts is not None else getattr(getattr(module, "q", module), "encoder", None)
    if not isinstance(encoder, Encoder):
        return {}
    return {name: _arrays(*rows.layers.parameters()) for name, rows in encoder.set_networks.items()}


def _hearing_layers(module: CommNetModule) -> Iterator[tuple[str, list[NDArray]]]:
    """Yield CommNet's communication layers as kind and arrays."""
    for keep, hear in zip(module.keep, module.hear, strict=True):
        weight = cast("nn.Linear", hear).weight
        heard = weight if module.settings["channel"] else torch.zeros_like(weight)
        yield HEAR, _arrays(keep.weight, keep.bias, heard)


def _arrays(*tensors: Any) -> list[NDArray]:
    return [np.ascontiguousarray(each.detach().cpu().numpy().T) for each in tensors]


def _exported_layer(layer: Any) -> tuple[str, list[NDArray]]:
    """Return a layer as kind and arrays; matrices have the shape (inputs, outputs)."""
    if isinstance(layer, tuple):
        return layer
    kind, names = next(found for known, found in LAYERS.items() if isinstance(layer, known))
    return kind, _arrays(*(getattr(layer, name) for name in names))


def _head(module: Any, block: Any) -> dict[str, Any]:
    """Return how outputs become greedy actions."""
    if isinstance(block.action, Discrete):
        return {"head": "best", "bounds": {"masked": block.masked, "start": int(block.action.start)}}
    kinds = {GaussianHead: "mean", DeterministicHead: "tanh"}
    bounds = {"low": block.action.low.tolist(), "high": block.action.high.tolist()}
    return {"head": kinds[type(module.head)], "bounds": bounds}


def _without_index(features: FeatureList, agents: int) -> tuple[Any, dict[str, int] | None]:
    """Return the observation without the feature `agent_index`, and where that was in the vector.

    In the zoo there is another number of agents; the exported policy fills in which one it is.
    """
    kept = [each for each in features.features if each.name != _INDEX]
    index = None
    if len(kept) < len(features.features):
        index = {"at": features.layout(agents)[_INDEX].start, "size": agents}
    observation = {
        "frames": features.frames,
        "stacked": [*map(_plain, features.stacked)],
        "features": [*map(_plain, kept)],
    }
    return observation, index


def _plain(choice: FeatureChoice) -> Any:
    return {choice.source: dict(choice.options)} if choice.options else choice.source
