"""A National Instruments data acquisition card: voltage out, quadrature encoder and current in, sampled by the card's
clock.

Encoder and current are sampled by the card's own sample clock, ``samples_per_period`` times per control period; `read`
takes the newest samples, so a reading is at most a share of a period old and its jitter is that of the card, not of the
computer. The output is written on demand, one value per period: nothing is regenerated from a buffer.

Limits. The driver of the vendor is needed (Linux and Windows, not every card). Without a watchdog in the card (few have
one, `WatchdogTask`) the output keeps its last voltage when this process dies: `outside_stop` says how another process
takes it away, and a drive enable in hardware is needed against the death of the whole computer. No card was at hand:
the calls are tested against the signatures of the package ``nidaqmx``.
"""

from microstage_ros.hardware.protocol import HardwareError, Reading
from microstage_ros.model.actuators import actuator_of
from microstage_ros.quantities.errors import InputError

OPTIONS = {
    "output": None,
    "counter": None,
    "current_input": None,
    "ampere_per_volt": 1.0,
    "sample_clock": None,
    "samples_per_period": 4,
    "watchdog": True,
    "enable_line": None,
    "e_stop_line": None,
    "limit_lines": None,
}
"""Options with their defaults: ``output`` (``Dev1/ao0``), ``counter`` (``Dev1/ctr0``), ``current_input`` (``Dev1/ai0``,
optional) and ``ampere_per_volt`` [A/V] of its sensor; ``sample_clock``: terminal that clocks the counter (default: the
clock of the analog input, ``/Dev1/ai/SampleClock``, which needs ``current_input``; a counter has no clock of its own);
``samples_per_period``; ``watchdog``: arm the card's own, where it has one; ``enable_line`` (``Dev1/port0/line0``):
digital output, high enables the drive; ``e_stop_line``: digital input, low is pressed or a broken wire;
``limit_lines``: two digital inputs, lower and upper end, low is actuated."""

SPAN = 2.0  # of the input buffer [s]


class DaqCard:
    """An axis on a DAQ card.

    Parameters
    ----------
    setup : `protocol.Setup`; options as in `OPTIONS`, ``output`` and ``counter`` are required.
    """

    simulated = False

    def __init__(self, setup):
        given = dict(setup.options or {})
        for name in given:
            if name not in OPTIONS:
                raise InputError(f"DAQ card: option {name}", given[name], "one of " + ", ".join(OPTIONS))
        self._options = {**OPTIONS, **given}
        for name in ("output", "counter"):
            if not isinstance(self._options[name], str):
                raise InputError(
                    f"DAQ card: option {name}", self._options[name], "a channel such as Dev1/ao0 or Dev1/ctr0"
                )
        lines = self._options["limit_lines"]
        if lines is not None and (not isinstance(lines, list) or len(lines) != 2):
            raise InputError("DAQ card: option limit_lines", lines, "two lines, [Dev1/port0/line2, Dev1/port0/line3]")
        if not isinstance(self._options["samples_per_period"], int) or self._options["samples_per_period"] < 1:
            raise InputError(
                "DAQ card: option samples_per_period", self._options["samples_per_period"], "a whole number from 1"
            )
        factor = self._options["ampere_per_volt"]
        if isinstance(factor, bool) or not isinstance(factor, (int, float)):
            raise InputError("DAQ card: option ampere_per_volt", factor, "a number of A/V")
        self._range = setup.axis.value("drive.dac_range")
        self._holds = actuator_of(setup.axis).holds_on_fault
        self._count = setup.axis.value("sensors.encoder.resolution")
        self._rate = self._options["samples_per_period"] / setup.axis.value("period")
        self._tasks, self._watchdog = {}, None
        self.watchdog_armed = False

    def open(self):
        """Reserve the channels with the output at zero, start the sample clock. Raises `HardwareError`."""
        try:
            import nidaqmx
        except ImportError:
            raise HardwareError(
                "the DAQ backend needs the package nidaqmx (pip install nidaqmx) and the vendor's "
                "driver; backend 'simulated' needs neither"
            ) from None
        try:
            self._output(nidaqmx)
            self._inputs(nidaqmx)
            self._lines(nidaqmx)
        except Exception as error:  # the vendor's errors, and a driver that is not installed, are of many kinds
            self.close()
            raise HardwareError(" ".join(str(error).split())) from None

    def _output(self, nidaqmx):
        task = self._tasks["output"] = nidaqmx.Task()
        task.ao_channels.add_ao_voltage_chan(self._options["output"], min_val=-self._range, max_val=self._range)
        if not self._holds:
            task.write(0.0, auto_start=True)

    def _lines(self, nidaqmx):
        """Digital lines of the safety chain, where there are any; the drive is not enabled."""
        wanted = {
            "enable": self._options["enable_line"],
            "e_stop": self._options["e_stop_line"],
            "lower": (self._options["limit_lines"] or (None, None))[0],
            "upper": (self._options["limit_lines"] or (None, None))[1],
        }
        for name, line in wanted.items():
            if line is None:
                continue
            task = self._tasks[name] = nidaqmx.Task()
            if name == "enable":
                task.do_channels.add_do_chan(line)
                task.write(False, auto_start=True)
            else:
                task.di_channels.add_di_chan(line)

    def enable(self, on):
        """The drive's enable output, where there is one."""
        if "enable" in self._tasks:
            self._call("enable", "write", bool(on))

    def e_stop(self):
        """True while the line of the emergency stop is low; False where there is none."""
        return "e_stop" in self._tasks and not self._call("e_stop", "read")

    def limit_switches(self):
        """True for each end whose line is low; False where there is none."""
        return tuple(name in self._tasks and not self._call(name, "read") for name in ("lower", "upper"))

    def _inputs(self, nidaqmx):
        """Counter and analog input on one sample clock; the analog input is started last, since its clock drives
        both."""
        from nidaqmx.constants import AcquisitionType, EncoderType, OverwriteMode, ReadRelativeTo

        counter = self._tasks["counter"] = nidaqmx.Task()
        # four counts per signal period: the card counts edges of both tracks
        counter.ci_channels.add_ci_lin_encoder_chan(
            self._options["counter"], decoding_type=EncoderType.X_4, dist_per_pulse=4 * self._count
        )
        clocked, source = [counter], self._clock()
        if self._options["current_input"] is not None:
            current = self._tasks["current"] = nidaqmx.Task()
            current.ai_channels.add_ai_voltage_chan(self._options["current_input"])
            clocked.append(current)
        samples = max(int(SPAN * self._rate), 2)
        for task in clocked:
            if source is None:
                break
            own = task is not counter
            task.timing.cfg_samp_clk_timing(
                self._rate,
                source="" if own else source,
                sample_mode=AcquisitionType.CONTINUOUS,
                samps_per_chan=samples,
            )
            task.in_stream.overwrite = OverwriteMode.OVERWRITE_UNREAD_SAMPLES
            task.in_stream.relative_to = ReadRelativeTo.MOST_RECENT_SAMPLE
            task.in_stream.offset = -1
        for task in clocked:
            task.start()

    def _clock(self):
        """Terminal of the sample clock; None: the counter is read on demand."""
        if self._options["sample_clock"] is not None:
            return self._options["sample_clock"]
        if self._options["current_input"] is None:
            return None
        return "/" + str(self._options["current_input"]).split("/", maxsplit=1)[0] + "/ai/SampleClock"

    def read(self):
        """Encoder and, where there is a sensor, current: the newest samples."""
        encoder = self._call("counter", "read")
        if "current" not in self._tasks:
            return Reading(encoder)
        return Reading(encoder, self._call("current", "read") * self._options["ampere_per_volt"])

    def write(self, voltage):
        """``voltage`` [V] at the amplifier's input, now; pets the card's watchdog where it is armed.

        Raises `HardwareError` where the card is not open or its driver reports an error.
        """
        self._call("output", "write", float(voltage))
        if self._watchdog is not None and self.watchdog_armed:
            try:
                self._watchdog.reset_timer()
            except Exception as error:
                raise HardwareError(" ".join(str(error).split())) from error

    def watchdog(self, seconds):
        """Arm the card's own watchdog, where it has one: zero volts after ``seconds`` [s] without a write; 0 disarms.

        Most cards have none; then `watchdog_armed` stays False, and `outside_stop` is what there is.
        """
        task, self._watchdog, self.watchdog_armed = self._watchdog, None, False
        if task is not None:
            task.close()
        if not self._options["watchdog"] or seconds <= 0.0:
            return
        try:
            from nidaqmx.constants import WatchdogAOExpirState
            from nidaqmx.system.watchdog import AOExpirationState, WatchdogTask

            task = WatchdogTask(self._options["output"].split("/")[0], timeout=seconds)
            task.cfg_watchdog_ao_expir_states(
                [AOExpirationState(self._options["output"], 0.0, WatchdogAOExpirState.VOLTAGE)]
            )
            task.start()
            self._watchdog, self.watchdog_armed = task, True
        except Exception:  # a card without one says so in an error of its own
            if task is not None:
                task.close()

    def outside_stop(self):
        """How another process puts the output to zero."""
        return "microstage_ros.hardware.daq_stop:zero_output", {"output": self._options["output"], "span": self._range}

    def close(self):
        """Output to zero (as it is, for a drive that holds a position), channels free; may be called twice.

        Raises `HardwareError` where the card's driver reports an error.
        """
        self.watchdog(0.0)
        tasks, self._tasks = self._tasks, {}
        try:
            if "output" in tasks and not self._holds:
                tasks["output"].write(0.0)
            if "enable" in tasks:
                tasks["enable"].write(False)
        except Exception as error:
            raise HardwareError(" ".join(str(error).split())) from error
        finally:
            for task in tasks.values():
                task.close()

    def _call(self, task, method, *arguments):
        if task not in self._tasks:
            raise HardwareError("the DAQ card is not open")
        try:
            return getattr(self._tasks[task], method)(*arguments)
        except Exception as error:  # the vendor's errors have no class without the vendor's package
            raise HardwareError(" ".join(str(error).split())) from error
