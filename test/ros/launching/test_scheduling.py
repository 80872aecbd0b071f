"""Where threads run, in a process of its own, as it cannot be undone without rights."""

import json
import os
import signal
import subprocess
import sys

import pytest

PLACES = """
import json, os, sys, threading, logging
from microstage_ros.ros.transport.scheduling import take_place
threading.Thread(target=threading.Event().wait, daemon=True).start()
take_place(logging.getLogger(), {max(os.sched_getaffinity(0))}, sys.argv[1])
main = os.getpid()
print(json.dumps({name: [sorted(os.sched_getaffinity(int(t))) for t in os.listdir("/proc/self/task") if (int(t) == main) == (name == "loop")]
                  for name in ("loop", "others")}))
"""


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two processors")
@pytest.mark.parametrize("scheduling", ["normal", "batch"])
def test_only_who_claims_a_processor_sends_its_other_threads_away(scheduling):
    done = subprocess.run([sys.executable, "-c", PLACES, scheduling], check=True, stdout=subprocess.PIPE)
    found, allowed = json.loads(done.stdout), sorted(os.sched_getaffinity(0))
    assert found["loop"] == [allowed[-1:]]
    assert found["others"]
    expected = allowed[-1:] if scheduling == "normal" else allowed[:-1]
    assert all(places == expected for places in found["others"])


def test_bare_machine_counts_every_period():
    script = "import json; from microstage_ros.ros.benchmarks.bare_machine import measured; print(json.dumps(measured(0.3)))"
    done = subprocess.run([sys.executable, "-c", script], check=True, stdout=subprocess.PIPE)
    found = json.loads(done.stdout)
    assert 0.0 < found["in_time"] <= found["within_two"] <= 1.0
    assert found["rate"] > 0.0


SPINS = """
import os
from microstage_ros.ros.transport.scheduling import bound_real_time
bound_real_time(0.3)
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
except PermissionError:
    raise SystemExit(77)
while True:
    pass
"""


def test_the_kernel_ends_a_real_time_thread_that_turns_for_ever_and_says_where_it_stood():
    done = subprocess.run([sys.executable, "-c", SPINS], stderr=subprocess.PIPE, timeout=240.0)
    if done.returncode == 77:
        pytest.skip("real-time priorities are not permitted here")
    assert done.returncode == -signal.SIGXCPU
    assert b'File "<string>", line' in done.stderr
