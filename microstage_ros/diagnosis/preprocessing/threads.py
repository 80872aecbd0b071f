"""Records side by side on the machine's cores: compiled code and numpy let other threads run.

The threads are made once: a fit asks for them hundreds of times, and making them anew takes as long as its arithmetic.
"""

import functools
import os
import threading
from concurrent.futures import ThreadPoolExecutor

MOST = 4     # threads of one diagnosis; derived: no result depends on it

_inside = threading.local()


@functools.cache
def _threads():
    return ThreadPoolExecutor(max_workers=min(os.cpu_count() or 1, MOST), thread_name_prefix="side_by_side")


os.register_at_fork(after_in_child=_threads.cache_clear)    # a child has none of its parent's threads


def side_by_side(function, items):
    """[function(item) for item in ``items``], shape (n,), in order, some at a time; one after the other where it is
    asked for inside itself, as its threads could then wait for each other for ever. The first error is raised."""
    items = list(items)
    if len(items) < 2 or getattr(_inside, "here", False):
        return [function(item) for item in items]

    def marked(item):
        _inside.here = True
        try:
            return function(item)
        finally:
            _inside.here = False

    return list(_threads().map(marked, items))
