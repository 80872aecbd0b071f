"""The fenced blocks of a page, and their execution in the order of the page.

- ``sh`` blocks run by bash, line after line, in a folder that looks like a clone. ``./microstage cell`` and whatever
  carries the comment "until interrupted" stay in the background until the next heading of the second level.
- A block whose first line is a comment with a file name (``# run.yaml``) is saved under that name before anything runs.
- Other ``python`` blocks run in the environment of ``./microstage shell``; names of earlier blocks of the page stay.
- ``yaml`` is read; ``text`` is what a program shows, or a drawing.
- An HTML comment ``<!-- example: REASON -->`` above a block keeps it from being run here: see `REASONS`.
"""

import os
import re
import resource
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
LANGUAGES = ("sh", "python", "yaml", "text")
REASONS = {
    "minutes": "takes minutes; runs where MICROSTAGE_LONG_BLOCKS=1",
    "days": "needs records of several days",
    "hardware": "commands an axis that is not simulated",
    "computers": "needs several computers",
    "workspace": "needs a ROS 2 workspace beside the clone",
    "data": "needs measured data that are not part of the project; runs where they are",
}
DATA = ROOT.parent / "shared" / "data" / "emps"
LONG = os.environ.get("MICROSTAGE_LONG_BLOCKS") == "1"
FENCE = re.compile(r"^(?:<!-- example: (?P<reason>[^>]*?) -->\n\s*)?(?P<indent>[ ]*)```(?P<language>[^\n]*)\n(?P<text>.*?)^(?P=indent)```",
                   flags=re.M | re.S)
NAMED = re.compile(r"#\s*([\w./-]+\.(?:py|yaml|txt|csv))\s*$")


def allowed(reason):
    """Whether a block with this reason is run nevertheless."""
    return (reason == "minutes" and LONG) or (reason == "data" and DATA.is_dir())


class Block(NamedTuple):
    """One fenced block: language, reason not to run it here (or empty), text without its indentation, line, section."""

    language: str
    reason: str
    text: str
    line: int
    section: int

    @property
    def name(self):
        """The file name in its first line, or None."""
        found = NAMED.match(self.text.split("\n", 1)[0])
        return found[1] if found else None

    @property
    def runs(self):
        """Whether it is to be executed here."""
        return all(allowed(reason) for reason in self.reasons)

    @property
    def reasons(self):
        """Why it may not be run here."""
        return [word.strip() for word in self.reason.split(",") if word.strip()]


def blocks(page):
    """All fenced blocks of a page, in order."""
    text = page.read_text(encoding="utf-8")
    return [Block(found["language"].strip(), (found["reason"] or "").strip(), re.sub(rf"^{found['indent']}", "", found["text"], flags=re.M),
                  text.count("\n", 0, found.start("text")) + 1, text.count("\n## ", 0, found.start())) for found in FENCE.finditer(text)]


def command_lines(page):
    """Words of every ``./microstage`` line in the shell blocks of a page."""
    lines = [line for block in blocks(page) if block.language == "sh" for line in block.text.replace("\\\n", " ").splitlines()]
    words = [shlex.split(line, comments=True) for line in lines if line.strip().startswith("./microstage")]
    return [line[1: line.index(">")] if ">" in line else line[1:] for line in words]


def stays(line):
    """Whether a command line goes on until it is interrupted."""
    return line.startswith("./microstage cell") or "until interrupted" in line


def processor_time():
    """What the processes that were started and have ended took of the processor [s]."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


class Reader:
    """Someone who tries a page: runs its blocks in ``folder``, one after the other.

    Parameters
    ----------
    folder : with what a clone has (``microstage``, ``config``, ...). said : collects what was run and how long it took.
    """

    def __init__(self, folder):
        self.folder, self.said, self._staying, self._names, self._section = folder, [], [], {}, 0
        self.environment = {name: value for name, value in os.environ.items() if name != "MICROSTAGE_ROOT"}

    def save_named(self, page_blocks):
        """Save every block that names its file."""
        for block in page_blocks:
            if block.name:
                path = self.folder / block.name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(block.text, encoding="utf-8")

    def run(self, block):
        """Run one block; what the section before left running ends."""
        if block.section != self._section:
            self.close()
            self._section = block.section
        if block.language == "sh":
            for line in block.text.replace("\\\n", " ").splitlines():
                if line.strip() and not line.strip().startswith(("#", "./microstage test")):  # this is it
                    (self._stay if stays(line) else self._do)(line.strip())
        elif block.language == "python" and not block.name:
            self._python(block)

    def _do(self, line):
        began, spent = time.monotonic(), processor_time()
        done = subprocess.run(["bash", "-c", line], cwd=self.folder, env=self.environment, capture_output=True, text=True,
                              timeout=600, check=False, stdin=subprocess.DEVNULL)
        self.said.append(f"{time.monotonic() - began:6.1f} s ({processor_time() - spent:5.1f} of the processor)  {line}")
        assert done.returncode == 0, f"{line}: status {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-3000:]}"
        assert "Traceback" not in done.stderr, done.stderr

    def _stay(self, line):
        began, output = time.monotonic(), self.folder / f"staying{len(self._staying)}.txt"
        with open(output, "w", encoding="utf-8") as file:
            process = subprocess.Popen(["bash", "-c", f"exec {line}"], cwd=self.folder, env=self.environment, stdout=file,
                                       stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True)
        self._staying.append((line, process, output))
        while line.startswith("./microstage cell") and "is active" not in output.read_text(encoding="utf-8"):
            assert process.poll() is None and time.monotonic() < began + 120, f"{line}\n{output.read_text(encoding='utf-8')}"
            time.sleep(0.1)
        while not line.startswith("./microstage cell") and not output.stat().st_size and time.monotonic() < began + 10:
            assert process.poll() is None, line
            time.sleep(0.1)  # it shows that it runs
        self.said.append(f"{time.monotonic() - began:6.1f} s  {line} &")

    def _python(self, block):
        began, here = time.monotonic(), os.getcwd()
        os.chdir(self.folder)
        try:
            exec(compile(block.text, f"block at line {block.line}", "exec"), self._names)
        finally:
            os.chdir(here)
        self.said.append(f"{time.monotonic() - began:6.1f} s  python, line {block.line}")

    def close(self):
        """Interrupt what is still there, as Ctrl-C does; each ends with status 0."""
        for _, process, _ in self._staying:
            if process.poll() is None:
                os.kill(process.pid, signal.SIGINT)
        ends = []
        for line, process, output in self._staying:
            try:
                status = process.wait(60)
            except subprocess.TimeoutExpired:
                process.kill()
                status = "none: it had to be killed"
            ends.append((line, status, output.read_text(encoding="utf-8")[-2000:] if status else ""))
        self._staying.clear()
        print(*self.said, sep="\n", file=sys.stderr)
        self.said.clear()
        # 130: the interrupt came before the command had begun its work
        assert all(status == 0 or status == 130 and output.rstrip().endswith(": interrupted") for _, status, output in ends), ends
