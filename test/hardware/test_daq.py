"""The DAQ backend: its calls against the signatures of the real package nidaqmx, no card needed."""

import inspect

import pytest

from microstage_ros.hardware import make_hardware
from microstage_ros.hardware.protocol import HardwareError, Setup
from microstage_ros.model.axis_file import load_axis
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

nidaqmx = pytest.importorskip("nidaqmx")
from microstage_ros.hardware.daq_stop import zero_output  # noqa: E402  (needs the package)
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
    assert place == "microstage_ros.hardware.daq_stop:zero_output"
    zero_output(**arguments)
    assert [entry[2] for entry in log if entry[1] == "write"] == [(0.0,)]


def test_a_channel_that_a_hanging_driver_holds_is_reset_and_put_to_zero(log, monkeypatch):
    """The second task on a reserved channel is refused (-50103) until the card is reset, which ends the first."""
    write, resets = Task.write, []

    def reserved(self, *arguments, **named):
        if not resets:
            raise nidaqmx.errors.DaqError("the resource is reserved", -50103)
        return write(self, *arguments, **named)

    class Device:
        def __init__(self, name):
            inspect.signature(real.__init__).bind(self, name)
            self.name = name

        def reset_device(self):
            inspect.signature(real.reset_device).bind(self)
            resets.append(self.name)

    real = nidaqmx.system.Device
    monkeypatch.setattr(Task, "write", reserved)
    monkeypatch.setattr(nidaqmx.system, "Device", Device)
    zero_output("Dev1/ao0", 10.0)
    assert resets == ["Dev1"] and of(log, "write") == [(0.0, {"auto_start": True})]


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


def of(log, call):
    """What one call of a task was given: positional arguments and named ones together."""
    return [(*entry[2], entry[3]) for entry in log if entry[1] == call]


def test_channels_with_their_ranges_and_clock(log):
    from nidaqmx.constants import AcquisitionType, EncoderType, OverwriteMode, ReadRelativeTo

    daq = card(samples_per_period=2, sample_clock="/Dev1/PFI0")
    daq.open()
    span = AXIS.value("drive.dac_range")
    assert of(log, "add_ao_voltage_chan") == [("Dev1/ao0", {"min_val": -span, "max_val": span})]
    count = AXIS.value("sensors.encoder.resolution")
    assert of(log, "add_ci_lin_encoder_chan") == [("Dev1/ctr0", {"decoding_type": EncoderType.X_4, "dist_per_pulse": 4 * count})]
    assert of(log, "add_ai_voltage_chan") == [("Dev1/ai0", {})]
    timing = {"sample_mode": AcquisitionType.CONTINUOUS, "samps_per_chan": 40_000}
    assert of(log, "cfg_samp_clk_timing") == [(20_000.0, {"source": "/Dev1/PFI0", **timing}), (20_000.0, {"source": "", **timing})]
    for task in ("task1", "task2"):
        assert (task, "overwrite", OverwriteMode.OVERWRITE_UNREAD_SAMPLES) in log and (task, "relative_to", ReadRelativeTo.MOST_RECENT_SAMPLE) in log
    assert of(log, "write") == [(0.0, {"auto_start": True})] and not daq.simulated and not daq.watchdog_armed
    log.clear()
    card(current_input=None, sample_clock="/Dev1/PFI0").open()
    assert [arguments[0] for arguments in of(log, "cfg_samp_clk_timing")] == [40_000.0] and len(of(log, "start")) == 1


def test_a_drive_that_holds_a_position_is_never_put_to_zero(log):
    """Zero would be a move of a piezo: neither at the start nor at the end."""
    piezo = make_hardware("daq", Setup(load_axis(config_file("axes/piezo.yaml")), options={"output": "Dev1/ao0", "counter": "Dev1/ctr0"}))
    piezo.open()
    piezo.write(2.0)
    piezo.close()
    piezo.close()
    assert of(log, "write") == [(2.0, {})] and [entry[1] for entry in log][-2:] == ["close"] * 2


@pytest.fixture
def watchdogs(log, monkeypatch):
    """The vendor's watchdog, with its calls noted."""
    import nidaqmx.system.watchdog as real

    kind = real.WatchdogTask
    monkeypatch.setattr(real, "WatchdogTask", lambda device, timeout: (log.append(("made", "watchdog", (device, timeout), {})), Checked(kind, "watchdog", log))[1])
    return log


def test_a_watchdog_is_armed_and_disarmed(watchdogs):
    daq = card()
    daq.open()
    daq.watchdog(0.01)
    assert of(watchdogs, "watchdog") == [("Dev1", 0.01, {})]
    assert [entry[1] for entry in watchdogs if entry[0] == "watchdog"] == ["cfg_watchdog_ao_expir_states", "start"]
    daq.watchdog(0.0)
    assert not daq.watchdog_armed and watchdogs[-1][:2] == ("watchdog", "close")
    daq.write(0.5)
    assert "reset_timer" not in [entry[1] for entry in watchdogs]
    daq.watchdog(0.02)
    daq.close()
    assert not daq.watchdog_armed and [entry[1] for entry in watchdogs if entry[0] == "watchdog"][-1] == "close"
    without = card(watchdog=False)
    without.open()
    without.watchdog(0.01)
    assert not without.watchdog_armed and len(of(watchdogs, "watchdog")) == 2


def test_a_watchdog_that_cannot_be_petted_is_an_error(watchdogs, monkeypatch):
    daq = card()
    daq.open()
    daq.watchdog(0.01)
    daq._watchdog = None
    daq.write(0.5)  # armed by nobody: nothing to pet

    class Broken:
        def reset_timer(self):
            raise nidaqmx.errors.DaqError("expired", -1)

        def close(self):
            """Nothing."""

    daq._watchdog = Broken()
    with pytest.raises(HardwareError, match="expired"):
        daq.write(0.5)


def test_a_voltage_that_cannot_be_taken_away_at_the_end_is_an_error_and_frees_the_channels(log):
    daq = card()
    daq.open()
    Task.failing = "write"
    with pytest.raises(HardwareError, match="cable out"):
        daq.close()
    assert [entry[1] for entry in log][-3:] == ["close"] * 3
    daq.close()  # the second time there is nothing left
    with pytest.raises(HardwareError, match="cable out"):
        card().open()


def test_the_span_of_the_output_is_told_to_who_takes_the_voltage_away(log):
    span = AXIS.value("drive.dac_range")
    assert card().outside_stop()[1] == {"output": "Dev1/ao0", "span": span}
    zero_output("Dev1/ao0", span)
    assert of(log, "add_ao_voltage_chan") == [("Dev1/ao0", {"min_val": -span, "max_val": span})]
    assert of(log, "write") == [(0.0, {"auto_start": True})] and log[-1][1] == "close"


@pytest.mark.parametrize("options, words", [
    ({"limit_lines": ["Dev1/port0/line2"]}, "limit_lines.*two lines"), ({"limit_lines": ["a", "b", "c"]}, "limit_lines"),
    ({"counter": None}, "option counter.*Dev1/ao0 or Dev1/ctr0"), ({"samples_per_period": 1.5}, "a whole number from 1")])
def test_options_that_do_not_fit(options, words):
    with pytest.raises(InputError, match=words):
        card(**options)
    assert card(samples_per_period=1, limit_lines=["a", "b"])
