"""Command lines whose usage errors are one line, like every other bad input."""

import argparse
import sys


class Parser(argparse.ArgumentParser):
    """An `argparse.ArgumentParser` that tells a usage error in one line on standard error and exits with 2."""

    def error(self, message):
        """Print ``message`` and where help is; exit status 2."""
        print(f"{self.prog}: {' '.join(message.split())} ({self.prog} --help tells the options)", file=sys.stderr)
        sys.exit(2)
