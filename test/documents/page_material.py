"""Files that a page supposes its reader to have: records of an axis, its axis file, logs of a machine, a card.

Each is made when a page names it. What a page prints itself is not here.
"""

import functools
import re
import shutil
import tempfile

import numpy as np
from page_blocks import DATA, ROOT, blocks, command_lines

from microstage_ros.control.runs.run_file import load_run
from microstage_ros.control.runs.simulate import simulated_record
from microstage_ros.model.axis_file import load_axis
from microstage_ros.records import write_record

RUN = """\
controller: {type: pid}
program:
  - {move_to_m: 2.0e-4, dwell_s: 0.1}
  - {scan: {to_m: -2.0e-4, speed_m_s: 1.0e-3}}
  - {sine: {amplitude_m: 1.0e-4, frequency_hz: 2.0, cycles: 2}}
"""
CLONE = ("microstage", "config", "docs", "microstage_ros", "msg_defs", "setup.cfg", "package.xml", ".venv")


def clone(folder):
    """Make ``folder`` look like a clone."""
    for name in CLONE:
        if (ROOT / name).exists():
            (folder / name).symlink_to(ROOT / name)
    return folder


@functools.lru_cache
def record(seed):
    """A short record of the shipped axis."""
    with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
        file.write(RUN)
        file.flush()
        return simulated_record(load_axis(ROOT / "config" / "axis.yaml"), load_run(file.name), seed, None, None)


def log(path, seed):
    """One run of a foreign machine as its drive would export it: moves to and fro, in mm and A."""
    rng, rate = np.random.default_rng(seed), 200.0
    t = np.arange(0.0, 8.0, 1 / rate)
    speed = 20.0 * np.sign(np.sin(2 * np.pi * t / 4.0)) * np.minimum(1.0, 10 * np.abs(np.sin(2 * np.pi * t / 4.0)))
    place = np.cumsum(speed) / rate
    level = 1.3 if path.parent.name in ("autumn",) or path.name.startswith("2024") else 1.0
    current = level * 0.4 * np.tanh(speed) + 0.004 * speed + 0.2 * np.gradient(speed, 1 / rate) / 1e3
    current = current + 0.01 * rng.standard_normal(len(t)) + 0.005 * rng.standard_normal()
    error = 0.02 * current + 1e-3 * rng.standard_normal(len(t))
    rows = np.stack([t, place, place - error, error, current], axis=1)
    np.savetxt(path, rows, delimiter=",", fmt="%.5f", header="time,set_point,actual,position_error,current", comments="")


def _copy(source):
    return lambda path: shutil.copy(ROOT / source, path)


def _record(seed):
    return lambda path: write_record(record(seed), path)


def _log(seed):
    return lambda path: log(path, seed)


def _card(path):
    """README's own class."""
    path.write_text(next(block.text for block in blocks(ROOT / "README.md") if block.name == "my_lab/card.py"), encoding="utf-8")


MATERIAL = {
    r"(my_axis|mine)\.yaml": _copy("config/axis.yaml"), r"today/axis\.yaml": _copy("config/axis.yaml"),
    r"my_lab\.card:Card": None, r"card\.yaml": lambda path: path.write_text("{}\n", encoding="utf-8"),
    r"(rec1|now1|monday)\.\w+": _record(1), r"(rec2|now2|tuesday)\.\w+": _record(2), r"(rec3|now3|today)\.(csv|mcap)": _record(3),
    r"(healthy|spring)\.csv": _record(4), r"export\.csv": _log(1),
    r"DATA_EMPS\.mat": lambda path: path.symlink_to(DATA / path.name) if DATA.is_dir() else None,
    r"runs/\w+": _record(1),
}
"""{pattern of a name: what makes it}."""

FOLDERS = {"spring/*.csv": [f"spring/run{n}.csv" for n in range(4)], "autumn/*.csv": ["autumn/run1.csv", "autumn/run2.csv"],
           "2024-*.csv": [f"2024-0{n}.csv" for n in range(1, 5)]}
"""{what a page writes for several logs: their names}."""


def provide(folder, page):
    """Make what the command lines of ``page`` name and the page does not print or write itself."""
    words, printed = [word for line in command_lines(page) for word in line], {block.name for block in blocks(page)}
    written = {value for line in command_lines(page) for option, value in zip(line, line[1:]) if option in ("--out", "--record")}
    quoted = [found for block in blocks(page) if block.language == "python" for found in re.findall(r'"([\w./-]+)"', block.text)]
    for word in words + quoted:
        for seed, name in enumerate(FOLDERS.get(word, ()), start=10):
            (folder / name).parent.mkdir(exist_ok=True)
            log(folder / name, seed)
        if word == "my_lab.card:Card" and "my_lab/card.py" not in printed:
            (folder / "my_lab").mkdir(exist_ok=True)
            _card(folder / "my_lab" / "card.py")
        elif word not in printed | written and not (folder / word).exists():
            for pattern, make in MATERIAL.items():
                if make and re.fullmatch(pattern, word):
                    (folder / word).parent.mkdir(parents=True, exist_ok=True)
                    make(folder / word)
