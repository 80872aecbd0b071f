"""How packages get into an environment: by uv, which unpacks each wheel once for all checkouts, else by pip.

With the standard library alone, as set-up needs. uv does not read pip's configuration, so index, wheels' folders,
certificates and proxies that are configured for pip are handed on; where uv cannot work with them, pip does it.
"""

import ast
import os
import re
import shutil
import subprocess
from pathlib import Path

OPTIONS = {"index-url": "--default-index", "extra-index-url": "--index", "find-links": "--find-links",
           "trusted-host": "--allow-insecure-host"}
"""uv's option for each of pip's that names a source of packages."""


def pip(venv, requirements):
    """The command of pip for these requirements; modules are compiled when they are first imported, not all now."""
    options = ["--disable-pip-version-check", "--no-input", "--no-compile"]
    return [str(venv / "bin" / "python"), "-m", "pip", "install", *options, *requirements]


def uv(venv, requirements):
    """The command of uv and its environment for these requirements; None where there is no uv and none to be had.

    The newest version that any of the sources has is taken, as pip does.
    """
    program = _uv(venv)
    if not program:
        return None
    settings = _pip_settings(venv)
    options = []
    for name, option in OPTIONS.items():
        options += [word for value in settings.get(name, "").split() for word in (option, value)]
    if settings.get("no-index", "").lower() in ("1", "true", "yes", "on"):
        options.append("--no-index")
    environment = dict(os.environ)
    for name, variable in (("cert", "SSL_CERT_FILE"), ("proxy", "ALL_PROXY")):
        if settings.get(name):
            environment[variable] = settings[name]
    command = [program, "pip", "install", "--python", str(venv / "bin" / "python")]
    return [*command, "--index-strategy", "unsafe-best-match", *options, *requirements], environment


def _uv(venv):
    """The program uv: the user's, else one installed into the environment; None without."""
    found = shutil.which("uv")
    if not found:
        own = Path(venv) / "bin" / "uv"
        if not own.exists():
            subprocess.run(pip(venv, ["uv>=0.5"]), capture_output=True, check=False)
        found = str(own) if own.exists() else None
    return found


def _pip_settings(venv):
    """What is configured for ``pip install``: {option: value}; the environment before the command's section before the
    general one."""
    asked = [str(venv / "bin" / "python"), "-m", "pip", "config", "list"]
    said = subprocess.run(asked, capture_output=True, text=True, check=False).stdout
    found = {}
    for section in ("global", "install", ":env:"):
        for name, value in re.findall(rf"^{section}\.([a-z-]+)=(.*)$", said, re.MULTILINE):
            found[name] = str(ast.literal_eval(value))
    return found
