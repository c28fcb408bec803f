"""The vocabulary of scenario files, usually imported as `t`.

from smarts.sstudio import gen_scenario, types as t
"""

import sys

from smarts.sstudio import sstypes
from smarts.sstudio.sstypes import *  # noqa: F403

# Between the two the original had this module as a package, and scenario files import from its submodules.
# They must be the very modules of sstypes: a second copy of a class would not equal the first.
_HOME = sstypes.__name__ + "."
sys.modules.update(
    {
        __name__ + "." + name.removeprefix(_HOME): module
        for name, module in list(sys.modules.items())
        if name.startswith(_HOME)
    }
)
