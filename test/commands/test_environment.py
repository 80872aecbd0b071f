"""What ./microstage writes for the shell, with the wheels and with a sourced ROS 2; what compiles the interfaces."""

import importlib
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import SimpleNamespace

import pytest

from microstage_ros.commands.project import environment, packages, toolchain
from microstage_ros.commands.project import test as command
from microstage_ros.commands.project.environment import _exports
from microstage_ros.places import SOURCE


@pytest.mark.parametrize("sourced", ["", "jazzy"])
@pytest.mark.parametrize("folder", ["plain", "with space, $dollar and \"quote\""])
def test_the_environment_is_a_shell_text_that_keeps_a_sourced_ros(tmp_path, sourced, folder):
    root = tmp_path / folder
    prefix, venv = root / "interfaces", root / "venv"
    (prefix / "lib" / "python3.12" / "site-packages").mkdir(parents=True)
    (tmp_path / "environment.sh").write_text(_exports(root, venv, prefix, sourced), encoding="utf-8")
    asked = 'set -eu; source environment.sh; echo "$PATH"; echo "$AMENT_PREFIX_PATH"; echo "$PYTHONPATH"; echo "$MICROSTAGE_ROS"'
    done = subprocess.run(["bash", "-c", asked], cwd=tmp_path, capture_output=True, text=True, check=True, env={
        "PATH": "/opt/ros/bin:/usr/bin:/bin", "AMENT_PREFIX_PATH": "/opt/ros", "PYTHONPATH": "/opt/ros/python"})
    path, prefixes, python, which = done.stdout.splitlines()
    assert path.startswith(f"{venv}/bin:") and "/opt/ros/bin" in path
    assert python.split(":")[0] == str(root) and python.endswith("/opt/ros/python")
    assert prefixes.startswith(str(prefix)) and ("/opt/ros" in prefixes) == bool(sourced)
    assert ("sourced" in which) and (sourced in which)


def _bare_path(folder):
    """A PATH with a Python and no compiler, no make, no apt-get."""
    folder.mkdir()
    (folder / "python3").symlink_to(sys.executable)
    return str(folder)


def test_without_a_compiler_the_package_index_has_one(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", _bare_path(tmp_path / "bin"))
    tools = toolchain.find()
    assert tools.zig and tools.packages == ("ziglang", "ninja") and tools.generator == ["-G", "Ninja"]
    assert "no C and C++ compiler" in tools.says
    assert set(tools.packages) <= set(environment._requirements(SOURCE, "", tools))
    package = tmp_path / "a folder" / "ziglang"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "zig").write_text('#!/bin/sh\nprintf "<%s>" "$@"\n', encoding="utf-8")
    (package / "zig").chmod(0o755)
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    variables = toolchain.zig_wrappers(tmp_path / "zig tools", sys.executable)
    said = subprocess.run([variables["CXX"], "-c", "a file.cpp"], capture_output=True, text=True, check=True, env={"PATH": "/bin"}).stdout
    headers = Path(sysconfig.get_path("include")).parent
    assert said.startswith("<c++>") and said.endswith(f"<-idirafter><{headers}><-c><a file.cpp>")
    archive = subprocess.run([variables["AR"], "q"], capture_output=True, text=True, check=True, env={"PATH": "/bin"}).stdout
    assert archive == "<ar><q>"


def python_in(venv):
    """A file that stands for the Python of an environment."""
    (venv / "bin").mkdir(parents=True, exist_ok=True)
    (venv / "bin" / "python").touch(mode=0o755)


def test_libraries_are_installed_beside_the_interfaces(tmp_path, monkeypatch):
    """What the interfaces need comes first, the rest beside them; a failure of either ends both."""
    steps = []
    monkeypatch.setattr(packages, "uv", lambda venv, requirements: None)
    monkeypatch.setattr(environment, "_step", lambda what, command, *_, stop=None: steps.append((what, command[7:], stop)))
    venv, tools = tmp_path / "venv", toolchain.Toolchain("", ("ziglang",), True)
    python_in(venv)
    with environment._libraries_beside(SOURCE, venv, sys.executable, tmp_path, "", tools):
        assert [what for what, _, _ in steps][:1] == ["ROS 2"]
    (_, first, _), (name, everything, stop), (ahead, _, _) = steps
    assert ahead == "compiled code"
    assert name == "libraries" and set(first) < set(everything) and {"ziglang", "numpy>=1.26"} <= set(first) and not stop.is_set()
    assert (venv / environment.MARK).read_text(encoding="utf-8").splitlines() == everything
    steps.clear()
    with environment._libraries_beside(SOURCE, venv, sys.executable, tmp_path, "", tools):
        pass
    assert [what for what, _, _ in steps] == ["compiled code"]  # nothing is installed again
    (venv / environment.MARK).unlink()
    with pytest.raises(environment.Failure, match="interfaces"), environment._libraries_beside(
            SOURCE, venv, sys.executable, tmp_path, "", tools):
        raise environment.Failure("interfaces: failed")
    assert steps[-1][2].is_set()


def test_packages_come_from_where_pip_is_configured_to_look(tmp_path, monkeypatch):
    """uv is handed pip's sources, the environment's before the file's; where it fails, pip installs."""
    (tmp_path / "pip.conf").write_text("[global]\nindex-url = https://a/simple\nextra-index-url = https://b\n  https://c\nfind-links = /old\n")
    for name in [name for name in os.environ if name.startswith("PIP_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("PIP_CONFIG_FILE", str(tmp_path / "pip.conf"))
    monkeypatch.setenv("PIP_FIND_LINKS", "/wheels /more")
    monkeypatch.setenv("PIP_CERT", "/certificates")
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    (tmp_path / "uv").write_text("#!/bin/sh\n")
    (tmp_path / "uv").chmod(0o755)
    command, variables = packages.uv(Path(sys.prefix), ["numpy>=1.26"])
    assert command[0] == str(tmp_path / "uv") and command[-1] == "numpy>=1.26" and variables["SSL_CERT_FILE"] == "/certificates"
    assert " ".join(command).endswith("--default-index https://a/simple --index https://b --index https://c "
                                      "--find-links /wheels --find-links /more numpy>=1.26")
    steps = []

    def step(what, command, *_, **options):
        steps.append(command)
        if command[0].endswith("uv"):
            raise environment.Failure("no index")

    monkeypatch.setattr(environment, "_step", step)
    environment._install("libraries", Path(sys.prefix), ["numpy>=1.26"], tmp_path)
    environment._install("libraries", Path(sys.prefix), ["numpy>=1.26"], tmp_path, "jazzy")
    assert [command[1:3] for command in steps] == [["pip", "install"], ["-m", "pip"], ["-m", "pip"]]


def test_with_compilers_nothing_more_is_installed(tmp_path, monkeypatch):
    folder = tmp_path / "bin"
    _bare_path(folder)
    for name in ("gcc", "g++", "make"):
        (folder / name).symlink_to("/bin/true")
    monkeypatch.setenv("PATH", str(folder))
    assert toolchain.find() == ("C and C++ compilers of this machine", (), toolchain.find().headers)
    assert toolchain.find().generator == []


def test_what_is_missing_is_said_before_anything_is_downloaded(tmp_path, monkeypatch):
    """No compiler, no Python.h and no way to either: one line, and no step was run."""
    monkeypatch.setenv("PATH", _bare_path(tmp_path / "bin"))
    monkeypatch.setenv("MICROSTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(environment, "_headers_of", lambda python: str(tmp_path / "no headers"))
    monkeypatch.setattr(environment, "_step", lambda *_: pytest.fail("a step was run"))
    with pytest.raises(environment.Failure, match="Python.h is missing.*python3-dev"):
        environment._make(SOURCE, tmp_path, tmp_path / "environment.sh", "digest")


def test_an_interrupted_set_up_is_one_line_and_status_1(tmp_path, monkeypatch, capsys):
    def interrupted(place):
        raise KeyboardInterrupt

    monkeypatch.setattr(environment, "_locked", interrupted)
    assert environment.main(tmp_path, "digest") == 1
    assert capsys.readouterr().err.strip() == "microstage: set-up interrupted; the next command goes on with it"


def test_interfaces_are_built_once_for_all_checkouts(tmp_path, monkeypatch):
    monkeypatch.setenv("MICROSTAGE_CACHE", str(tmp_path / "cache"))
    built = []

    def build(root, venv, build_folder, sourced, tools, folder):
        built.append(folder)
        (folder / "install" / "microstage_msgs").mkdir(parents=True)

    monkeypatch.setattr(environment, "_build", build)
    venv = Path(sys.prefix)
    first = environment._interfaces(SOURCE, venv, tmp_path, "", toolchain.Toolchain("", (), True))
    other = tmp_path / "other checkout"
    shutil.copytree(SOURCE / "msg_defs", other / "msg_defs")
    shutil.copy(SOURCE / "setup.cfg", other)
    assert environment._interfaces(other, venv, tmp_path, "", None) == first and len(built) == 1
    (other / "msg_defs" / "msg" / "Credit.msg").write_text("int64 until\n", encoding="utf-8")
    assert environment._interfaces(other, venv, tmp_path, "", None) != first and len(built) == 2


def test_compiled_code_is_shared_between_checkouts(tmp_path):
    """A function compiled in one folder is loaded from the cache in another; a changed source is compiled anew."""
    asked = ("import sys; sys.path.insert(0, '.'); from microstage_ros.numerics.random import next_bits as f; "
             "from microstage_ros.numerics.compiled import PACKAGE; print(PACKAGE, f.stats.cache_path)")
    said = []
    for number in range(3):
        root = tmp_path / f"checkout {number}"
        for part in ("__init__.py", "places.py", "files.py", "numerics", "quantities"):
            source = SOURCE / "microstage_ros" / part
            if source.exists():
                (shutil.copytree if source.is_dir() else shutil.copy)(source, _parent(root / "microstage_ros" / part))
        if number == 2:
            with open(root / "microstage_ros/numerics/random.py", "a", encoding="utf-8") as file:
                file.write("\n# changed\n")
        done = subprocess.run([sys.executable, "-c", asked], cwd=root, capture_output=True, text=True, check=True,
                              env={**os.environ, "MICROSTAGE_CACHE": str(tmp_path / "cache"), "PYTHONPATH": ""})
        package, place = done.stdout.strip().split(" " + str(tmp_path / "cache"))
        assert package.startswith(str(root))
        said.append(place)
    assert said[0] == said[1] != said[2]


def test_a_function_that_cannot_be_cached_is_a_warning():
    """Numba says the file of such a function, as the place of its compiled code knows it."""
    from numba.core.errors import NumbaWarning

    from microstage_ros.numerics.random import next_bits
    compiled = SimpleNamespace(lifted=(), library=SimpleNamespace(has_dynamic_globals=True), fndesc=SimpleNamespace(qualname="f"))
    with pytest.warns(NumbaWarning, match="Cannot cache") as caught:
        assert not next_bits._cache._impl.check_cachable(compiled)
    assert caught[0].filename.endswith("random.py")


def _parent(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def test_a_removed_cache_is_noticed(tmp_path):
    """Where the interfaces or the Python have been removed, the environment is made again."""
    ready = tmp_path / "environment.sh"
    (tmp_path / "prefix").mkdir()
    python_in(tmp_path)
    ready.write_text(f"# digest\n# {tmp_path / 'prefix'}\n# {tmp_path}\n", encoding="utf-8")
    assert environment._still_there(ready, "digest") and not environment._still_there(ready, "other")
    (tmp_path / "bin" / "python").unlink()  # as when the system's Python has gone
    assert not environment._still_there(ready, "digest")
    python_in(tmp_path)
    (tmp_path / "prefix").rmdir()
    assert not environment._still_there(ready, "digest")


@pytest.mark.parametrize("at", ["venv", "libraries and ROS 2"])
def test_what_an_interrupted_set_up_left_is_made_anew(tmp_path, monkeypatch, at):
    """The next run took half of a package for installed and marked the environment as complete; half of one had no pip."""
    commands, venv = [], tmp_path / ".venv"

    def step(what, command, *_, **__):
        commands.append(command)
        python_in(venv)
        if at in command or at == what:
            raise KeyboardInterrupt

    monkeypatch.setattr(environment, "_step", step)
    monkeypatch.setattr(packages, "uv", lambda venv, requirements: None)
    with pytest.raises(KeyboardInterrupt):
        environment._environment(venv, ["numpy"], sys.executable, tmp_path, "")
    assert not (venv / environment.MARK).exists()
    at = "nothing"
    commands.clear()
    environment._environment(venv, ["numpy"], sys.executable, tmp_path, "")
    assert commands[0][1:4] == ["-m", "venv", "--clear"] and (venv / environment.MARK).read_text() == "numpy"
    commands.clear()
    environment._environment(venv, ["numpy"], sys.executable, tmp_path, "")
    assert not commands  # complete
    (venv / "bin" / "python").unlink()
    environment._environment(venv, ["numpy"], sys.executable, tmp_path, "")
    assert "--clear" in commands[0]


def test_test_tools_of_an_interrupted_set_up_are_installed_anew(tmp_path, monkeypatch):
    commands = []
    monkeypatch.setattr(environment, "_step", lambda what, command, *_, **__: commands.append(command))
    monkeypatch.setattr(packages, "uv", lambda venv, requirements: None)
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "venv"))
    (tmp_path / "venv").mkdir()
    (tmp_path / ".build").mkdir()
    (tmp_path / ".build" / "environment.sh").touch()
    shutil.copy(SOURCE / "setup.cfg", tmp_path)
    (tmp_path / ".build" / "venv.tools").touch()
    environment.add_test_tools(tmp_path)
    assert commands[0][-1] == "--force-reinstall" and not (tmp_path / ".build" / "venv.tools").exists()
    environment.add_test_tools(tmp_path)
    assert len(commands) == 1


def test_interfaces_that_somebody_else_has_built_are_taken_as_they_are(tmp_path, monkeypatch):
    """In a cache that this user cannot write, the set-up ended at the lock."""
    monkeypatch.setenv("MICROSTAGE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(environment, "_locked", lambda path: pytest.fail("it was locked"))
    folder = environment._interfaces_folder(SOURCE, sys.executable, "")
    folder.mkdir(parents=True)
    (folder / "complete").touch()
    assert environment._interfaces(SOURCE, Path(sys.prefix), tmp_path, "", None) == folder / "install" / "microstage_msgs"


def test_beside_a_sourced_ros_without_its_build_tool_one_line_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", _bare_path(tmp_path / "bin"))
    with pytest.raises(environment.Failure, match="colcon is needed .*python3-colcon-common-extensions"):
        environment._build(SOURCE, tmp_path, tmp_path, "jazzy", toolchain.Toolchain("", (), True), tmp_path / "interfaces")


def test_a_ros_for_another_python_does_not_hide_the_wheels(tmp_path):
    site = tmp_path / "venv" / "lib" / "python3.11" / "site-packages"
    site.mkdir(parents=True)
    text = _exports(tmp_path, tmp_path / "venv", tmp_path / "prefix", "")
    (line,) = [line for line in text.splitlines() if line.startswith("export PYTHONPATH")]
    assert line.endswith(f':{site}${{PYTHONPATH:+:$PYTHONPATH}}"')
    assert str(site) not in _exports(tmp_path, tmp_path / "venv", tmp_path / "prefix", "jazzy")


def test_what_is_compiled_first_is_there():
    for place in command.COMPILED_FIRST:
        module, name = place.split(":")
        assert callable(getattr(importlib.import_module(f"microstage_ros.{module}"), name)), place


def test_bytecode_is_kept_although_the_environment_forbids_it():
    """In a folder of its own: else every node compiles a thousand modules at each start. A variable that the user gives stays."""
    asked = {name: value for name, value in os.environ.items() if name != "MICROSTAGE_ROOT"} | {"PYTHONDONTWRITEBYTECODE": "1"}
    for given, expected in (({}, f"{SOURCE}/.build/bytecode"), ({"PYTHONPYCACHEPREFIX": "/elsewhere"}, "/elsewhere")):
        environ = {name: value for name, value in asked.items() if name != "PYTHONPYCACHEPREFIX"} | given
        said = subprocess.run([SOURCE / "microstage", "shell", "env"], env=environ, capture_output=True, text=True, check=True).stdout
        assert f"PYTHONPYCACHEPREFIX={expected}\n" in said and "PYTHONDONTWRITEBYTECODE" not in said
