"""Records side by side on the machine's cores: compiled code and numpy let other threads run."""

import os
from concurrent.futures import ThreadPoolExecutor

MOST = 4     # threads of one diagnosis


def side_by_side(function, items):
    """[function(item) for item in items], in order, some at a time."""
    with ThreadPoolExecutor(max_workers=min(os.cpu_count() or 1, MOST)) as threads:
        return list(threads.map(function, items))
