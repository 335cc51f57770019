"""Programs of the repository that are no part of the package."""

import sys
from importlib import util


def script(path):
    """Return a file as a module, which it would be if it were run."""
    spec = util.spec_from_file_location(path.stem, path)
    module = util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
