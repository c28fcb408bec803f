import signal
import sys

import pytest


@pytest.fixture(autouse=True)
def _ctrl_c():
    """Take Ctrl-C, also in processes that tests start: a shell's background ignores it, and so would they."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module", autouse=True)
def _ray_ends_with_the_module():
    """Stop a Ray that a module's tests have started, themselves or by building an algorithm.

    The next module of the process would join it, whatever it asks for.
    """
    yield
    if "ray" in sys.modules:
        sys.modules["ray"].shutdown()


@pytest.fixture(scope="module", autouse=True)
def _own_code_ends_with_the_module():
    """Forget the metrics that a module's tests have named as `module:NAME`: registries list them."""
    yield
    if "benchmark.metrics.registry" in sys.modules:
        sys.modules["benchmark.metrics.registry"].METRICS._own.clear()
