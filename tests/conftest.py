import signal
import sys

import pytest


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
