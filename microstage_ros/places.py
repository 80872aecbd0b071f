"""Where the package's own files lie: beside the sources, or in the share folder of an installed package."""

import os
from pathlib import Path

from microstage_ros.quantities.errors import InputError

SOURCE = Path(__file__).resolve().parent.parent


def share():
    """The folder that holds ``config/`` and ``launch/``.

    Raises InputError: a workspace is installed but not sourced.
    """
    if (SOURCE / "config").is_dir():
        return SOURCE
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        folder = Path(prefix) / "share" / "microstage_ros"
        if (folder / "config").is_dir():
            return folder
    raise InputError("microstage_ros", "share folder not found", "a sourced workspace (AMENT_PREFIX_PATH)")


def config_file(name):
    """The file ``config/NAME``. Raises `InputError` if there is none."""
    path = share() / "config" / name
    if not path.is_file():
        raise InputError("config", name, "one of " + ", ".join(sorted(p.name for p in path.parent.glob("*.yaml"))))
    return path
