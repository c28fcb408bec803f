import os
import signal
import sys
import tempfile
import time
from contextlib import ExitStack

import pytest

from tests.leftovers import resources

os.environ["RAY_ADDRESS"] = "local"
"""A test starts a Ray of its own, whatever cluster runs on this machine, or ran and was killed."""
os.environ["RAY_prestart_worker_first_driver"] = "0"  # noqa: SIM112 - Ray's name
"""Ray starts no process of each core in advance: many tests need none, and others start them when needed."""
os.environ.setdefault("OMP_NUM_THREADS", "1")
"""One thread for PyTorch in each process: its threads wait busily, and other tests run on the other core."""
LONGEST = (
    *("test_many_machines", "test_experiment_runs", "test_sweep_runs", "test_own_code_page"),
    *("test_live_page", "test_served", "test_page", "test_robustness", "test_exporting", "test_policies"),
    *("test_whole_registry", "test_several_learners", "test_games", "test_documents", "test_scenarios"),
)
"""Modules that take minutes, which begin first: at the end both cores share what is short."""


def pytest_collection_modifyitems(items):
    """Put the longest modules first; the others stay in their order."""
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.stem, len(LONGEST)))


@pytest.fixture(autouse=True)
def _ctrl_c():
    """Enable Ctrl-C in tests and the processes that they start: background jobs of a shell ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module", autouse=True)
def _ray_ends_with_the_module():
    """Stop Ray after each module, if its tests have started it directly or by building an algorithm.

    Otherwise the next module of the process would join this Ray with its options.
    """
    yield
    if "ray" in sys.modules:
        sys.modules["ray"].shutdown()


@pytest.fixture(scope="module", autouse=True)
def _own_code_ends_with_the_module():
    """Remove the metrics `module:NAME` that a module's tests have loaded, since registries list them."""
    yield
    if "benchmark.metrics.registry" in sys.modules:
        sys.modules["benchmark.metrics.registry"].METRICS._own.clear()


_OWN_CODE = {"smarts.registry": ("_GIVEN", "_OWN_ROOTS"), "smarts.zoo.registry": ("_SEARCHED",)}
"""Module -> dicts in which it keeps where own code is."""


def _own_code():
    """Yield where own code is kept: module, name, the dict."""
    for module in _OWN_CODE.keys() & sys.modules.keys():
        for name in _OWN_CODE[module]:
            yield module, name, getattr(sys.modules[module], name)


@pytest.fixture(autouse=True)
def _own_code_is_forgotten():
    """Forget after each test which files it made importable, and in which folders locators search.

    Otherwise other tests of the process find them, and pass them to the processes that they start.
    """
    before = {(module, name): dict(kept) for module, name, kept in _own_code()}
    yield
    for module, name, kept in _own_code():
        kept.clear()
        kept.update(before.get((module, name), {}))


@pytest.fixture
def closing():
    """Return a function that closes what it is given when the test ends, and returns it."""
    with ExitStack() as stack:

        def keep(made, closed=None):
            stack.callback((closed or made).close)
            return made

        yield keep


@pytest.fixture
def nothing_is_left(tmp_path_factory, monkeypatch):
    """Check that after the test no process, temporary file or socket is left that was not there before."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("temporary")))
    processes, files, sockets = resources()
    yield
    # Processes of earlier tests may end meanwhile.
    until = time.monotonic() + 5.0
    while (left := _beyond(processes, files, sockets)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not left


def _beyond(processes, files, sockets):
    """Return what there is now and was not before: processes, files, how many sockets; empty if nothing."""
    now = resources()
    new = now[0] - processes, now[1] - files, max(now[2] - sockets, 0)
    return new if any(new) else ()
