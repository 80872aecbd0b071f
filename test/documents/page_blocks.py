"""The fenced blocks of a page, and their execution in the order of the page.

- ``sh`` blocks run line after line in a folder that looks like a clone: what starts processes of its own
  (`OWN_PROCESS`) and whatever is more than one ``./microstage`` command by bash, as printed; the others by the same
  `main` in the tests' own process, so that the libraries are loaded once.
- ``./microstage cell`` and whatever carries the comment "until interrupted" stay in the background until the next
  heading of the second level. A cell that two pages start with the same words is started once: see `Cells`.
- A block whose first line is a comment with a file name (``# run.yaml``) is saved under that name before anything runs.
- Other ``python`` blocks run in the environment of ``./microstage shell``; names of earlier blocks of the page stay.
- ``yaml`` is read; ``text`` is what a program shows, or a drawing.
- An HTML comment ``<!-- example: REASON -->`` above a block keeps it from being run here: see `REASONS`.
"""

import contextlib
import glob
import io
import itertools
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

from answers import check_answer

from microstage_ros.commands.__main__ import main

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
    return [list(itertools.takewhile(lambda word: word not in (">", "&"), line[1:])) for line in words]


def stays(line):
    """Whether a command line goes on until it is interrupted."""
    return line.startswith("./microstage cell") or "until interrupted" in line


def processor_time():
    """What this process and those that it started and that have ended took of the processor [s]."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_CHILDREN, resource.RUSAGE_SELF)]
    return sum(each.ru_utime + each.ru_stime for each in spent)


OWN_PROCESS = ("demo", "shell", "cell", "watch")
"""Commands that start processes, become another program or take signals: run by bash, through the script itself."""


def words_here(line, folder):
    """Words after ``./microstage`` of a line that this process can run, and the file for its output, or None.

    Patterns of file names are expanded as bash does.
    """
    words = shlex.split(line, comments=True)
    if words[0] != "./microstage" or words[1] in OWN_PROCESS or re.search(r"[|;&<$`]", line.partition(" #")[0]):
        return None
    words, output = (words[1:-2], folder / words[-1]) if words[-2] == ">" else (words[1:], None)
    found = [sorted(glob.glob(word, root_dir=folder)) or [word] if re.search(r"[*?[]", word) else [word] for word in words]
    return [word for names in found for word in names], output


@contextlib.contextmanager
def working_in(folder):
    """``folder`` is the current one inside."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


class Staying:
    """A command that goes on in the background until it is interrupted.

    Parameters
    ----------
    line : as printed. folder : where it runs; its output goes to a file there. environment : variables.
    """

    def __init__(self, line, folder, environment):
        self.line, self._output = line, folder / f"staying{len(list(folder.glob('staying*.txt')))}.txt"
        self._began, cell = time.monotonic(), line.startswith("./microstage cell")
        environment = {**environment, "PYTHONFAULTHANDLER": "1"}
        with open(self._output, "w", encoding="utf-8") as file:
            self._process = subprocess.Popen(["bash", "-c", f"exec {line}"], cwd=folder, env=environment, stdout=file,
                                             stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, start_new_session=True)
        while cell and "is active" not in self.said:
            assert self._process.poll() is None and time.monotonic() < self._began + 120, f"{line}\n{self.said}"
            time.sleep(0.05)
        while not cell and not self.said and time.monotonic() < self._began + 10:
            assert self._process.poll() is None, line
            time.sleep(0.05)  # it shows that it runs

    @property
    def said(self):
        """What it has printed so far."""
        return self._output.read_text(encoding="utf-8")

    def interrupt(self):
        """Ctrl-C, if it is still there."""
        if self._process.poll() is None:
            os.kill(self._process.pid, signal.SIGINT)

    def end(self):
        """Its exit status after an interrupt, and why that is no good end; None where it is."""
        try:
            status = self._process.wait(60)
        except subprocess.TimeoutExpired:
            self._process.send_signal(signal.SIGABRT)  # Python's fault handler prints where its threads stand
            self._process.wait()
            return f"{self.line}: had to be killed\n{self.said[-5000:]}"
        # 1: the interrupt came before the command had begun its work
        good = status == 0 or status == 1 and self.said.rstrip().endswith(": interrupted")
        return None if good else f"{self.line}: status {status}\n{self.said[-2000:]}"


class Cells:
    """The one cell that pages share: ``./microstage cell`` without any option, which is the same in every folder."""

    PLAIN = "./microstage cell"

    def __init__(self):
        self._plain = None

    def plain(self, folder, environment):
        """Start it, unless it runs already."""
        self._plain = self._plain or Staying(self.PLAIN, folder, environment)

    def close(self):
        """End it, with status 0."""
        if self._plain:
            self._plain.interrupt()
            ended, self._plain = self._plain.end(), None
            assert ended is None, ended


def _is_plain_cell(line):
    """Whether a line is the shared cell's command."""
    return line.partition("#")[0].strip() == Cells.PLAIN


class Reader:
    """Someone who tries a page: runs its blocks in ``folder``, one after the other.

    Parameters
    ----------
    folder : with what a clone has (``microstage``, ``config``, ...). cells : `Cells` that this page shares with others.
    """

    def __init__(self, folder, cells):
        self.folder, self.said, self._cells, self._staying, self._names, self._section = folder, [], cells, [], {}, None
        self._with_plain_cell = set()
        self.environment = {name: value for name, value in os.environ.items() if name != "MICROSTAGE_ROOT"}

    def save_named(self, page_blocks):
        """Save every block that names its file; note the sections that use the shared cell."""
        for block in page_blocks:
            if any(_is_plain_cell(line) for line in block.text.splitlines()):
                self._with_plain_cell.add(block.section)
            if block.name:
                path = self.folder / block.name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(block.text, encoding="utf-8")

    def run(self, block):
        """Run one block; what the section before left running ends."""
        if block.section != self._section:
            self.close()
            self._section = block.section
            if block.section not in self._with_plain_cell:
                self._cells.close()  # simulated time never rests: it would take the processor from what comes
        if block.language == "sh":
            for line in map(str.strip, block.text.replace("\\\n", " ").splitlines()):
                if line and not line.startswith(("#", "./microstage test")):  # this is it
                    with self._timed(line):
                        (self._stay if stays(line) else self._do)(line)
        elif block.language == "python" and not block.name:
            with self._timed(f"python, line {block.line}"), working_in(self.folder):
                exec(compile(block.text, f"block at line {block.line}", "exec"), self._names)

    @contextlib.contextmanager
    def _timed(self, what):
        began, spent = time.monotonic(), processor_time()
        yield
        self.said.append(f"{time.monotonic() - began:6.1f} s ({processor_time() - spent:5.1f} of the processor)  {what}")

    def _do(self, line):
        here = words_here(line, self.folder)
        status, out, err = self._here(*here) if here else self._by_bash(line)
        assert status == 0, f"{line}: status {status}\n{out[-2000:]}\n{err[-3000:]}"
        assert "Traceback" not in err, err

    def _by_bash(self, line):
        done = subprocess.run(["bash", "-c", line], cwd=self.folder, env=self.environment, capture_output=True, text=True,
                              timeout=600, check=False, stdin=subprocess.DEVNULL)
        return done.returncode, done.stdout, done.stderr

    def _here(self, words, output):
        out, err = io.StringIO(), io.StringIO()
        with working_in(self.folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = main(words)
        if status == 0:
            check_answer(words)
        if output:
            output.write_text(out.getvalue(), encoding="utf-8")
        return status, out.getvalue(), err.getvalue()

    def _stay(self, line):
        if _is_plain_cell(line):
            self._cells.plain(self.folder, self.environment)
            return
        if line.startswith(Cells.PLAIN) and "--namespace" not in line:
            self._cells.close()  # the name is theirs now
        self._staying.append(Staying(line, self.folder, self.environment))

    def close(self):
        """Interrupt what is still there, as Ctrl-C does; each ends with status 0."""
        with self._timed("the end of what ran in the background"):
            for command in self._staying:
                command.interrupt()
            ends = [command.end() for command in self._staying]
        self._staying.clear()
        print(*self.said, sep="\n", file=sys.stderr)
        self.said.clear()
        assert not any(ends), ends
