"""The DAQ backend: its calls against the signatures of the real package nidaqmx, no card needed."""

import inspect

import pytest

from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.daq import zero_output
from microstage_ros.hardware.protocol import HardwareError, Setup
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

nidaqmx = pytest.importorskip("nidaqmx")
AXIS = load_axis(config_file("axis.yaml"))
OPTIONS = {"output": "Dev1/ao0", "counter": "Dev1/ctr0", "current_input": "Dev1/ai0", "ampere_per_volt": 0.5}


class Checked:
    """An object whose calls must fit the methods of a real class; every call is noted."""

    def __init__(self, kind, name, log, results=None):
        self.__dict__.update(_kind=kind, _name=name, _log=log, _results=results or {})

    def __getattr__(self, name):
        real = inspect.getattr_static(self._kind, name)  # AttributeError for what the package has not

        def call(*arguments, **named):
            inspect.signature(real).bind(self, *arguments, **named)
            self._log.append((self._name, name, arguments, named))
            return self._results.get(name)

        return call

    def __setattr__(self, name, value):
        assert isinstance(inspect.getattr_static(self._kind, name), property), name
        self._log.append((self._name, name, value))


class Task:
    """As nidaqmx.Task, with its parts checked."""

    made, log, failing = 0, [], ""

    def __init__(self, new_task_name=""):
        from nidaqmx.task._in_stream import InStream
        from nidaqmx.task._timing import Timing
        from nidaqmx.task.collections import AIChannelCollection, AOChannelCollection, CIChannelCollection

        name = f"task{Task.made}"
        Task.made += 1
        self.name = name
        self.ao_channels, self.ai_channels, self.ci_channels, self.timing, self.in_stream = (
            Checked(kind, name, Task.log) for kind in (AOChannelCollection, AIChannelCollection, CIChannelCollection, Timing, InStream))

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()

    def _real(self, method, *arguments, **named):
        inspect.signature(getattr(nidaqmx.Task, method)).bind(self, *arguments, **named)
        Task.log.append((self.name, method, arguments, named))
        if Task.failing == method:
            raise nidaqmx.errors.DaqError("cable out", -1)
        return {"read": 0.25}.get(method)

    def write(self, *a, **n):
        return self._real("write", *a, **n)

    def read(self, *a, **n):
        return self._real("read", *a, **n)

    def start(self):
        return self._real("start")

    def close(self):
        return self._real("close")


@pytest.fixture
def log(monkeypatch):
    Task.made, Task.log, Task.failing = 0, [], ""
    monkeypatch.setattr(nidaqmx, "Task", Task)
    return Task.log


def card(**options):
    return make_hardware("daq", Setup(AXIS, options={**OPTIONS, **options}))


def test_tasks_are_clocked_by_the_card(log):
    daq = card()
    daq.open()
    timed = [entry for entry in log if entry[1] == "cfg_samp_clk_timing"]
    assert [entry[2] for entry in timed] == [(40000.0,), (40000.0,)]
    assert [entry[3]["source"] for entry in timed] == ["/Dev1/ai/SampleClock", ""]
    started = [entry[0] for entry in log if entry[1] == "start"]
    assert started == ["task1", "task2"]  # the counter waits for the clock of the analog input
    assert ("task1", "offset", -1) in log
    reading = daq.read()
    assert reading.encoder == 0.25 and reading.current == 0.125
    daq.write(1.5)
    daq.close()
    writes = [entry[2][0] for entry in log if entry[1] == "write"]
    assert writes == [0.0, 1.5, 0.0] and [entry[1] for entry in log][-3:] == ["close"] * 3
    with pytest.raises(HardwareError, match="not open"):
        daq.read()


def test_without_a_clock_the_counter_is_read_on_demand(log):
    daq = card(current_input=None)
    daq.open()
    assert not [entry for entry in log if entry[1] == "cfg_samp_clk_timing"]
    assert daq.read()[0] == 0.25


def test_errors_of_the_vendor_are_errors_of_the_hardware(log):
    daq = card()
    daq.open()
    Task.failing = "read"
    with pytest.raises(HardwareError, match="cable out"):
        daq.read()
    Task.failing = "start"
    with pytest.raises(HardwareError, match="cable out"):
        card().open()


def test_another_process_can_take_the_voltage_away(log):
    place, arguments = card().outside_stop()
    assert place == "microstage_ros.hardware.daq:zero_output"
    zero_output(**arguments)
    assert [entry[2] for entry in log if entry[1] == "write"] == [(0.0,)]


def test_the_watchdog_of_a_card_that_has_one(log, monkeypatch):
    import nidaqmx.system.watchdog as real

    kind = real.WatchdogTask

    def made(*arguments, **named):
        inspect.signature(kind.__init__).bind(None, *arguments, **named)
        return Checked(kind, "watchdog", log)

    monkeypatch.setattr(real, "WatchdogTask", made)
    daq = card()
    daq.open()
    daq.watchdog(0.01)
    assert daq.watchdog_armed
    (states,) = next(entry[2][0] for entry in log if entry[1] == "cfg_watchdog_ao_expir_states")
    assert states.expiration_state == 0.0
    daq.write(0.5)
    assert ("watchdog", "reset_timer", (), {}) in log
    monkeypatch.setattr(real, "WatchdogTask", lambda *a, **n: (_ for _ in ()).throw(nidaqmx.errors.DaqError("not supported", -1)))
    daq.watchdog(0.01)
    assert not daq.watchdog_armed
    daq.close()


@pytest.mark.parametrize("options, words", [({"output": 3}, "output"), ({"samples_per_period": 0}, "samples_per_period"), ({"colour": 1}, "colour")])
def test_bad_options(options, words):
    with pytest.raises(InputError, match=words):
        card(**options)


def test_without_the_vendors_driver_it_says_so():
    with pytest.raises(HardwareError):
        card().open()


def test_the_lines_of_the_safety_chain(log, monkeypatch):
    from nidaqmx.task.collections import DIChannelCollection, DOChannelCollection

    made = Task.__init__

    def with_lines(self, new_task_name=""):
        made(self, new_task_name)
        self.do_channels, self.di_channels = (Checked(kind, self.name, Task.log) for kind in (DOChannelCollection, DIChannelCollection))

    monkeypatch.setattr(Task, "__init__", with_lines)
    without = card()
    without.open()
    without.enable(True)
    assert not without.e_stop() and without.limit_switches() == (False, False)
    daq = card(enable_line="Dev1/port0/line0", e_stop_line="Dev1/port0/line1", limit_lines=["Dev1/port0/line2", "Dev1/port0/line3"])
    log.clear()
    daq.open()
    lines = [entry[2][0] for entry in log if entry[1] in ("add_do_chan", "add_di_chan")]
    assert lines == [f"Dev1/port0/line{k}" for k in range(4)]
    assert [entry[2] for entry in log if entry[1] == "write"][-1] == (False,)  # not enabled at first
    daq.enable(True)
    assert log[-1][1:3] == ("write", (True,))
    assert not daq.e_stop() and daq.limit_switches() == (False, False)  # the stand-in reads 0.25, which is high
    monkeypatch.setattr(Task, "read", lambda self: False)
    assert daq.e_stop() and daq.limit_switches() == (True, True)
    daq.close()
    assert [entry[2] for entry in log if entry[1] == "write"][-2:] == [(0.0,), (False,)]
    with pytest.raises(InputError, match="limit_lines"):
        card(limit_lines="Dev1/port0/line2")
