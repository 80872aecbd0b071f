"""A National Instruments data acquisition card: voltage out, quadrature encoder and current in.

Needs the package ``nidaqmx`` and the vendor's driver; without them opening says so. Timing is the
driver node's (``mode: paced``): one software-timed sample per call.
"""

from microstage_ros.hardware.protocol import HardwareError, Reading
from microstage_ros.quantities.errors import InputError

OPTIONS = ("output", "counter", "current_input", "ampere_per_volt")


class DaqCard:
    """An axis on a DAQ card.

    Parameters
    ----------
    setup : `protocol.Setup`; options: ``output`` (channel of the amplifier's input, ``Dev1/ao0``), ``counter``
        (counter of the encoder, ``Dev1/ctr0``), ``current_input`` (``Dev1/ai0``, optional) and
        ``ampere_per_volt`` [A/V] of the current sensor.
    """

    simulated = False

    def __init__(self, setup):
        self._options = dict(setup.options or {})
        for name in self._options:
            if name not in OPTIONS:
                raise InputError(f"DAQ card: option {name}", self._options[name], "one of " + ", ".join(OPTIONS))
        for name in ("output", "counter"):
            if name not in self._options:
                raise InputError(f"DAQ card: option {name}", None, "a channel such as Dev1/ao0 or Dev1/ctr0")
        self._range = setup.axis.value("drive.dac_range")
        self._count = setup.axis.value("sensors.encoder.resolution")
        self._tasks = {}

    def open(self):
        """Reserve the channels, output at zero."""
        try:
            import nidaqmx
            from nidaqmx.constants import EncoderType
        except ImportError:
            raise HardwareError("the DAQ backend needs the package nidaqmx (pip install nidaqmx) and the vendor's "
                                "driver; backend 'simulated' needs neither") from None
        try:
            output, counter = nidaqmx.Task(), nidaqmx.Task()
            self._tasks = {"output": output, "counter": counter}
            output.ao_channels.add_ao_voltage_chan(self._options["output"], min_val=-self._range, max_val=self._range)
            output.write(0.0)
            # four counts per signal period: the card counts edges of both tracks
            counter.ci_channels.add_ci_lin_encoder_chan(
                self._options["counter"], decoding_type=EncoderType.X_4, dist_per_pulse=4 * self._count)
            counter.start()
            if "current_input" in self._options:
                self._tasks["current"] = current = nidaqmx.Task()
                current.ai_channels.add_ai_voltage_chan(self._options["current_input"])
        except nidaqmx.errors.Error as error:
            self.close()
            raise HardwareError(str(error)) from None

    def read(self):
        """Encoder and, where there is a sensor, current; one sample each."""
        encoder = self._call("counter", "read")
        if "current" not in self._tasks:
            return Reading(encoder)
        return Reading(encoder, self._call("current", "read") * self._options.get("ampere_per_volt", 1.0))

    def write(self, voltage):
        """Voltage [V] at the amplifier's input."""
        self._call("output", "write", float(voltage))

    def close(self):
        """Output to zero, channels free."""
        tasks, self._tasks = self._tasks, {}
        try:
            if "output" in tasks:
                tasks["output"].write(0.0)
        finally:
            for task in tasks.values():
                task.close()

    def _call(self, task, method, *arguments):
        if task not in self._tasks:
            raise HardwareError("the DAQ card is not open")
        try:
            return getattr(self._tasks[task], method)(*arguments)
        except Exception as error:  # noqa: BLE001 - the vendor's errors have no class without the vendor's package
            raise HardwareError(str(error)) from error
