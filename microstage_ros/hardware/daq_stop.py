"""How a process of its own takes the voltage of a DAQ card away; the vendor's package is loaded before it is needed.

A driver that hangs still holds its output channel, and a second task on it is refused (NI-DAQmx error -50103, the
resource is reserved). Then the card is reset, which ends all of its tasks and puts its outputs to their state of
power-up, and zero is written. No card was at hand: tested against the signatures of the package ``nidaqmx``.
"""

import nidaqmx
import nidaqmx.system


def zero_output(output, span):
    """Zero volts at the channel ``output``, whose range is ± ``span`` [V]. Raises nidaqmx's errors."""
    try:
        _write_zero(output, span)
    except nidaqmx.errors.Error:
        nidaqmx.system.Device(output.split("/")[0]).reset_device()
        _write_zero(output, span)


def _write_zero(output, span):
    with nidaqmx.Task() as task:
        task.ao_channels.add_ao_voltage_chan(output, min_val=-span, max_val=span)
        task.write(0.0, auto_start=True)
