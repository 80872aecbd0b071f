"""The machine as mathematics: parameters, friction laws, drive train, sensors, effects, the compiled step."""

import pathlib


def config_path(name):
    """Path of a shipped file of ``config/``: beside the sources, or in the installed package's share folder."""
    here = pathlib.Path(__file__).resolve()
    for root in here.parents:
        for folder in (root / "config", root / "share" / "microstage_ros" / "config"):
            if (folder / "axis.yaml").is_file():
                return folder / name
    raise FileNotFoundError(f"config/{name} beside the sources or in share/microstage_ros")
