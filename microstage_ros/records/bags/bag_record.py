"""From the project's bags to records, and back: topics joined by the number of the control period.

| topic (below the axis's namespace) | type | columns |
|---|---|---|
| `state` | AxisState | encoder, current, motor angle; the voltage that was held in the period before |
| `command` | VoltageCommand | reference, disturbance; the voltage, where no later state tells what was held |
| `interferometer` | InterferometerReading | interferometer, air and stage temperature, pressure, humidity |
| `simulation` | SimulationTruth | what only a simulation knows |
"""

import json
from pathlib import Path

import numpy as np
import yaml
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import microstage_ros
from microstage_ros.model.actuators import BY_NAME
from microstage_ros.quantities.command import COMMANDS, FORCE, VOLTAGE, command_of
from microstage_ros.quantities.errors import InputError
from microstage_ros.records.bags.bag_reader import Bag
from microstage_ros.records.bags.bag_writer import BagWriter
from microstage_ros.records.bags.definition import SEPARATOR, TIME, installed_definition, parse_definition
from microstage_ros.records.bags.layout import layout_of_type
from microstage_ros.records.columns import FINE_COLUMNS
from microstage_ros.records.record import Record, metadata_value
from microstage_ros.records.timebase import short_period

PACKAGE = "microstage_msgs"
FIELDS = {
    "state": ("AxisState", {"encoder_m": "position", "current_A": "current", "motor_angle_rad": "motor_angle"}),
    "command": ("VoltageCommand", {"reference_m": "reference", "voltage_V": "voltage", "disturbance_V": "disturbance"}),
    "interferometer": ("InterferometerReading", {
        "interferometer_m": "position", "air_temperature_K": "air_temperature", "air_pressure_Pa": "air_pressure",
        "air_humidity": "air_humidity", "stage_temperature_K": "stage_temperature"}),
    "simulation": ("SimulationTruth", {
        "stage_m": "stage_position", "stage_velocity_m_s": "stage_velocity", "actuator_friction_Nm": "actuator_torque",
        "guideway_friction_N": "guideway_force"}),
}
"""Topic to message type and column to field."""

NAMESPACE = "/axis"
STATUS_ACTIVE, STATUS_SIMULATED, SENDER_CONTROLLER = 1, 32, 1
ROWS_AT_ONCE = 5000
PERIOD_TOLERANCE = 2e-3
"""How far the mean period of a clock may be from the nominal one, relative."""

STRETCH, LEAST_STRETCHES = 100, 10
"""Periods over which the jitter of stamps is averaged, and fewer where there would be less than so many stretches."""

STOP = 10
"""Periods beyond which time that is missing in the numbers is told: a stop of the host."""

FIRST_ROWS = 10  # that may lack a reference while a cell starts
LAST_ROWS = 1000
"""Rows that may lack a command where a recorder left a running cell: states come sooner than their answers."""
MOST_ROWS = 10**10


def own_definition(name):
    """Definition of one of the project's messages: as installed, else from the source tree.

    Raises
    ------
    InputError : neither is there.
    """
    full = f"{PACKAGE}/msg/{name}"
    source = Path(microstage_ros.__file__).parents[1] / "msg_defs" / "msg" / f"{name}.msg"
    try:
        return installed_definition(full)
    except InputError:
        if not source.exists():
            raise
    header = f"MSG: {PACKAGE}/ServoHeader\n" + source.with_name("ServoHeader.msg").read_text(encoding="utf-8")
    text = f"{SEPARATOR}\n".join([source.read_text(encoding="utf-8"), header, TIME])
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, full))
    return parse_definition(full, text, store.hash_rihs01(full))


def bag_to_record(path, namespace=None):
    """The record of one axis in a bag of this project.

    Parameters
    ----------
    path : an MCAP file or a rosbag2 folder.
    namespace : of the axis; needed only if the bag has several.

    Returns
    -------
    Record : one row per control period; a period that a topic lacks is NaN.  If the driver was
        activated several times, the longest of these runs. Its remarks tell of stops of the host, and
        of a file that was cut off.

    Raises
    ------
    InputError : not a bag of this project, no or several axes, fewer than two periods.
    """
    bag = Bag(path)
    prefix = _prefix(bag, namespace)
    present = [topic for topic in FIELDS if prefix + topic in bag.topics]
    arrays = bag.read([prefix + topic for topic in present])
    states, span = _longest_run(arrays[prefix + "state"])
    if len(states) < 2:
        raise InputError(f"{path}: topic {prefix}state", f"{len(states)} messages", "at least 2")
    sequence = states["sequence"].astype(np.int64)
    first, rows = int(sequence.min()), int(sequence.max() - sequence.min()) + 1
    if rows > MOST_ROWS:
        raise InputError(f"{path}: topic {prefix}state, field sequence", int(sequence.max()), "numbers that count on")
    period_s = _period(states)
    if not period_s > 0.0:
        raise InputError(f"{path}: topic {prefix}state, sequence and header.stamp", period_s, "numbers that count on")
    columns = {}
    for topic in present:
        messages = _within(arrays[prefix + topic], span)
        period = _periods(messages, states, period_s) - first
        for column, field in FIELDS[topic][1].items():
            columns[column] = _by_period(rows, period, messages[field])
    held = _by_period(rows, sequence - first - 1, states["applied_voltage"])
    columns["voltage_V"] = np.where(np.isnan(held), columns.get("voltage_V", held), held)
    columns = {name: values for name, values in columns.items() if name == "encoder_m" or not np.isnan(values).all()}
    columns = _where_commanded(columns, joined=first > FIRST_ROWS)
    rows = len(columns["encoder_m"])
    command = _command(bag.custom_data)
    names = {VOLTAGE.column: command.column, VOLTAGE.disturbance: command.disturbance}
    columns = {names.get(name, name): values for name, values in columns.items()}
    metadata = {name: metadata_value(text) for name, text in bag.custom_data.items()}
    remarks = (*bag.remarks, *(f"{path}: {sentence}" for sentence in _stops(states, period_s)))
    return Record(period_s, {"t_s": np.arange(rows) * period_s, **columns}, str(path), metadata, remarks)


def _where_commanded(columns, joined):
    """The columns from the first row with a reference on, where a recorder that ``joined`` a running cell heard of the
    controller later, and up to the last one, where it left before the commands came that answer its last states.

    A few such rows go too where it joined; those of a cell that starts or ends stay."""
    if "reference_m" not in columns:
        return columns
    known, few = np.isfinite(columns["reference_m"]), 0 if joined else FIRST_ROWS
    lead, lag = int(np.argmax(known)), int(np.argmax(known[::-1]))
    first, last = lead if lead > few else 0, len(known) - (lag if few < lag <= LAST_ROWS else 0)
    return {name: values[first:last] for name, values in columns.items()}


def record_to_bag(record, path, namespace=NAMESPACE):
    """Write a record as the bag that a cell with this axis would have left.

    Parameters
    ----------
    record : with a command, of whatever unit; a record of forces belongs into a CSV file.
    path : a folder to make, or a file ending in `.mcap`.

    Raises
    ------
    InputError : no voltage, columns that no message holds, or the place cannot be written.
    """
    command = command_of(record.columns)
    if command is None or command is FORCE:
        raise InputError(f"{path}: column voltage_V", "missing", "a record of voltages; forces go into a .csv file")
    lost = [name for name in FINE_COLUMNS if name in record]
    lost += [each.column for each in COMMANDS if each is not command and each.column in record]
    if lost:
        raise InputError(f"{path}: column {lost[0]}", "in the record", "columns that a bag has messages for; "
                         "write the record into a .csv file")
    if command is not VOLTAGE:         # the messages' fields keep their names, the metadata says what they hold
        renamed = {command.column: VOLTAGE.column, command.disturbance: VOLTAGE.disturbance}
        record = Record(
            record.period_s,
            {renamed.get(name, name): values for name, values in record.columns.items()},
            record.source,
            {**record.metadata, "command": command.as_dict()},
        )
    topics = [topic for topic in FIELDS if topic in ("state", "command") or _any(record, topic)]
    custom_data = {name: value if isinstance(value, str) else json.dumps(value, default=str)
                   for name, value in record.metadata.items()}
    origin = min(float(record["t_s"][0]), 0.0)   # stamps are not negative, and a reader counts from the first row
    with BagWriter(path, custom_data) as bag:
        channels = {topic: bag.add_channel(f"{namespace.rstrip('/')}/{topic}", own_definition(FIELDS[topic][0]))
                    for topic in topics}
        layouts = {topic: layout_of_type(own_definition(FIELDS[topic][0])) for topic in topics}
        for start in range(0, len(record), ROWS_AT_ONCE):
            rows = np.arange(start, min(start + ROWS_AT_ONCE, len(record)))
            times = np.round((record["t_s"][rows] - origin) * 1e9).astype(np.int64)
            for topic in topics:
                bag.write_block(channels[topic], times, _messages(record, topic, layouts[topic], rows, times))


def _command(custom_data):
    """The `Command` that a bag's field ``voltage`` holds: as its metadata or its axis file says, volts if neither
    does."""
    saved = metadata_value(custom_data.get("command", "null"))
    column = saved.get("column") if isinstance(saved, dict) else None
    if column is None and "axis_file" in custom_data:
        try:
            drive = yaml.safe_load(custom_data["axis_file"])["drive"]["type"]
        except (yaml.YAMLError, KeyError, TypeError):
            drive = None
        column = BY_NAME[drive].command.column if isinstance(drive, str) and drive in BY_NAME else None
    return next((command for command in COMMANDS if command.column == column), VOLTAGE)


def _any(record, topic):
    """True if the record has any column of a topic."""
    return any(column in record for column in FIELDS[topic][1])


def _messages(record, topic, layout, rows, times):
    """Messages of one topic for some rows of a record, uint8 of shape (n, size)."""
    raw = np.tile(np.frombuffer(layout.blank(), np.uint8), (len(rows), 1))
    seen = raw.reshape(-1).view(layout.dtype)
    seen["header.stamp.sec"], seen["header.stamp.nanosec"] = times // 10**9, times % 10**9
    seen["sequence"] = rows
    for name in layout.dtype.names:
        if layout.dtype[name] == np.float64:
            seen[name] = 0.0 if name == "disturbance" else np.nan
    for column, field in FIELDS[topic][1].items():
        if column in record.columns:
            seen[field] = record[column][rows]
    if topic == "state":
        seen["applied_voltage"] = np.where(rows > 0, record["voltage_V"][rows - 1], np.nan)
        seen["status"] = STATUS_ACTIVE | (STATUS_SIMULATED if "stage_m" in record else 0)
    if topic == "command":
        seen["sender"] = SENDER_CONTROLLER
    return raw


def _prefix(bag, namespace):
    """What stands before the topics of the axis, ending in a slash."""
    found = sorted(name.removesuffix("state") for name, topic in bag.topics.items()
                   if topic.type == f"{PACKAGE}/msg/AxisState" and name.endswith("/state"))
    if namespace is not None:
        prefix = f"/{namespace.strip('/')}/".replace("//", "/")
        if prefix not in found:
            raise InputError(f"{bag.path}: namespace", namespace, "one of " + ", ".join(found or ["none"]))
        return prefix
    if len(found) != 1:
        other = f"topics {', '.join(sorted(bag.topics))}" if bag.topics else "no topics"
        raise InputError(f"{bag.path}: axes", ", ".join(found) or other,
                         "one axis (a topic `state` of type AxisState), or its namespace")
    return found[0]


def _longest_run(states):
    """The messages of the longest activation, and its span of log time [ns] up to the next one."""
    sequence = states["sequence"].astype(np.int64)
    restarts = np.flatnonzero(sequence[1:] < sequence[:-1] // 2) + 1
    edges = [0, *restarts.tolist(), len(states)]
    longest = max(range(len(edges) - 1), key=lambda k: edges[k + 1] - edges[k])
    start, stop = edges[longest], edges[longest + 1]
    times = states["log_time_ns"]
    begin = times[start] if start else np.iinfo(np.int64).min
    end = times[stop] if stop < len(states) else np.iinfo(np.int64).max
    return states[start:stop], (begin, end)


def _within(messages, span):
    """The messages logged in a span, end excluded unless it is the last."""
    times = messages["log_time_ns"]
    return messages[(times >= span[0]) & (times < span[1])]


def _by_period(rows, period, values):
    """Values in the rows of their periods, NaN where there is none."""
    column = np.full(rows, np.nan)
    inside = (period >= 0) & (period < rows)
    column[period[inside]] = values[inside]
    return column


def _stamps(messages):
    """Stamps of messages [ns]."""
    return messages["header.stamp.sec"].astype(np.int64) * 10**9 + messages["header.stamp.nanosec"]


def _periods(messages, states, period_s):
    """Control periods of messages: by their number, or by their stamps if the sender does not know it."""
    sequence = messages["sequence"].astype(np.int64)
    if len(sequence) < 2 or sequence.any():
        return sequence
    numbers, stamps = _numbered(states)
    before = np.clip(np.searchsorted(stamps, _stamps(messages), "right") - 1, 0, None)
    since = np.floor((_stamps(messages) - stamps[before]) * 1e-9 / period_s + 1e-6).astype(np.int64)
    until_next = np.append(np.diff(numbers), MOST_ROWS)
    return numbers[before] + np.minimum(since, until_next[before] - 1)


def _numbered(states):
    """Numbers of the periods that have a state, rising, and the states' stamps [ns]."""
    numbers, first = np.unique(states["sequence"].astype(np.int64), return_index=True)
    return numbers, _stamps(states)[first]


def _period(states):
    """Control period [s] by the stamps: the median of the means over `STRETCH` periods, so that it does not hold the
    time for which the host stopped."""
    numbers, stamps = _numbered(states)
    if len(numbers) < 2:
        return 0.0
    every = slice(None, None, max(min(STRETCH, (len(numbers) - 1) // LEAST_STRETCHES), 1))
    period = float(np.median(np.diff(stamps[every]) / np.diff(numbers[every]))) * 1e-9
    return short_period(period, PERIOD_TOLERANCE * period)


def _stops(states, period_s):
    """What is to be said of times that passed between two states beyond their periods; [] where there are none."""
    numbers, stamps = _numbered(states)
    beyond = np.diff(stamps) * 1e-9 - np.diff(numbers) * period_s
    stops = beyond[beyond > STOP * period_s]
    if not len(stops):
        return []
    return [f"{len(stops)} {'stop' if len(stops) == 1 else 'stops'} of the host for more than {STOP} periods, "
            f"{stops.sum():.3g} s in all, which the rows do not show"]
