"""`python -m smarts_agent_kit MODULE:CLASS --address HOST:PORT` serves an agent to simulators."""

from __future__ import annotations

import argparse
import json
import os
import sys

from smarts_agent_kit.server import AddressError, serve_address
from smarts_agent_kit.service import load


def main() -> None:
    """Serve the agent that the command line names."""
    parser = argparse.ArgumentParser(prog="python -m smarts_agent_kit", description=__doc__)
    parser.add_argument("agent", metavar="MODULE:CLASS", help="a subclass of smarts_agent_kit.BatchAgent")
    parser.add_argument("--address", required=True, metavar="HOST:PORT", help="where simulators find it")
    parser.add_argument("--options", default="{}", metavar="JSON", help="keywords of the class")
    given = parser.parse_args()
    sys.path.insert(0, os.getcwd())
    try:
        values = {"agent": given.agent, "options": json.loads(given.options)}
        load(values)  # what cannot be made is said now, not to the first simulator
        serve_address(given.address, "smarts_agent_kit.service", values, paths=sys.path, ready=_say)
    except (AddressError, ImportError, AttributeError, TypeError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _say(address: str) -> None:
    print(f"serving {address}", flush=True)


if __name__ == "__main__":
    main()
