"""Bags of this project to records and back, joined by the number of the control period."""

import dataclasses

import numpy as np
import pytest
from bag_help import WORDS

from microstage_ros.quantities.errors import InputError
from microstage_ros.records import Record, read_record, write_record
from microstage_ros.records.bags.bag import Bag, BagWriter
from microstage_ros.records.bags.bag_record import own_definition
from microstage_ros.records.bags.definition import installed_definition
from microstage_ros.records.bags.layout import layout_of_type
from microstage_ros.records.checks import Bounds, check_record
from microstage_ros.records.columns import RECORD_COLUMNS

STATE, COMMAND = own_definition("AxisState"), own_definition("VoltageCommand")


def full_record(rows=12_000):
    """A record with all the columns that a bag carries."""
    generator = np.random.default_rng(3)
    names = [name for name in RECORD_COLUMNS if name not in ("t_s", "force_N")] + ["stage_m", "guideway_friction_N"]
    columns = {name: generator.normal(size=rows) for name in names}
    columns["interferometer_m"][5:9] = np.nan
    return Record(1e-4, columns, metadata={"seed": 4, "axis": "name: paper axis\nformat: 1\n"})


@pytest.mark.parametrize("name", ["run", "run.mcap"])
def test_a_record_survives_as_a_bag_to_the_last_bit(tmp_path, name):
    record = full_record()
    write_record(record, tmp_path / name)
    back = read_record(tmp_path / name)
    assert back.period_s == 1e-4
    assert set(back.columns) == set(record.columns)
    for column in record.columns:
        np.testing.assert_array_equal(back[column], record[column], err_msg=column)
    assert back.metadata["seed"] == 4 and back.metadata["axis"] == record.metadata["axis"]
    assert (tmp_path / name).is_dir() == (name == "run")


def test_same_record_same_bytes(tmp_path):
    for name in ("a.mcap", "b.mcap"):
        write_record(full_record(500), tmp_path / name)
    one, other = (list(Bag(tmp_path / name).raw_messages()) for name in ("a.mcap", "b.mcap"))
    assert one == other


def write_cell(path, states, commands, namespace="/axis"):
    """A bag from lists of (sequence, value): encoder positions and voltages."""
    with BagWriter(path) as bag:
        add_axis(bag, states, commands, namespace)


def add_axis(bag, states, commands, namespace):
    for topic, definition, entries, field in (("state", STATE, states, "position"), ("command", COMMAND, commands, "voltage")):
        channel = bag.add_channel(f"{namespace}/{topic}", definition)
        layout = layout_of_type(definition)
        for number, (sequence, value) in enumerate(entries):
            raw = layout.blank(sequence=sequence, header__stamp__nanosec=sequence * 100_000)
            seen = np.frombuffer(raw, layout.dtype, 1)
            seen[field] = value
            if topic == "state":
                seen["applied_voltage"], seen["motor_angle"] = np.nan, np.nan
            bag.write(channel, 1000 * number, bytes(raw))


def test_lost_and_reordered_messages_go_to_their_rows(tmp_path):
    write_cell(tmp_path / "bag", [(7, 1.0), (9, 3.0), (8, 2.0), (11, 5.0)], [(7, 0.1), (9, 0.3), (6, 9.0), (10, 0.4)])
    record = read_record(tmp_path / "bag")
    np.testing.assert_array_equal(record["encoder_m"], [1, 2, 3, np.nan, 5])
    np.testing.assert_array_equal(record["voltage_V"], [0.1, np.nan, 0.3, 0.4, np.nan])
    np.testing.assert_allclose(record["t_s"], np.arange(5) * 1e-4)
    assert "motor_angle_rad" not in record.columns


@pytest.mark.parametrize("lead, lag", [(0, 0), (1, 0), (4, 3), (40, 200)])
def test_a_recorder_that_joined_a_cell_leaves_rows_that_all_have_a_reference(tmp_path, lead, lag):
    """Its first and last blocks of states and of commands need not begin and end at the same period."""
    states = [(n, float(n)) for n in range(5000, 5600)]
    write_cell(tmp_path / "bag", states, states[lead : 600 - lag])
    record = read_record(tmp_path / "bag")
    assert np.isfinite(record["reference_m"]).all()
    np.testing.assert_array_equal(record["encoder_m"], np.arange(5000.0 + lead, 5600.0 - lag))


def test_the_first_rows_of_a_cell_that_starts_are_kept(tmp_path):
    states = [(n, float(n)) for n in range(600)]
    write_cell(tmp_path / "bag", states, states[3:598])
    record = read_record(tmp_path / "bag")
    assert len(record) == 600 and np.isnan(record["reference_m"]).sum() == 5


def test_readings_without_a_number_go_by_their_stamp(tmp_path):
    reading = own_definition("InterferometerReading")
    layout = layout_of_type(reading)
    with BagWriter(tmp_path / "bag") as bag:
        add_axis(bag, [(n, float(n)) for n in range(40, 60)], [], "/axis")
        channel = bag.add_channel("/axis/interferometer", reading)
        for sequence in (42, 50):
            bag.write(channel, 5, bytes(layout.blank(position=sequence,
                                                     header__stamp__nanosec=sequence * 100_000 + 30_000)))
    read = read_record(tmp_path / "bag")["interferometer_m"]
    assert np.flatnonzero(~np.isnan(read)).tolist() == [2, 10] and read[10] == 50


def test_a_stop_of_the_host_is_told_and_changes_neither_period_nor_rows(tmp_path):
    """Stamps of the wall clock with jitter; the host stops for 45 s after 6000 of 14 000 periods of 100 us."""
    reading, generator = own_definition("InterferometerReading"), np.random.default_rng(5)
    numbers = np.arange(14_000)
    stamps = numbers * 100_000 + generator.integers(0, 20_000, len(numbers)) + np.where(numbers > 6000, 45 * 10**9, 0)
    with BagWriter(tmp_path / "bag") as bag:
        for topic, definition, every, behind in (("state", STATE, 1, 0), ("interferometer", reading, 1000, 5000)):
            channel, layout = bag.add_channel(f"/axis/{topic}", definition), layout_of_type(definition)
            for n in numbers[::every].tolist():
                sec, nanosec = divmod(int(stamps[n]) + behind, 10**9)
                number = n if topic == "state" else 0
                raw = layout.blank(sequence=number, header__stamp__sec=sec, header__stamp__nanosec=nanosec)
                np.frombuffer(raw, layout.dtype, 1)["position"] = n
                bag.write(channel, int(stamps[n]) + behind, bytes(raw))
    record = read_record(tmp_path / "bag")
    assert record.period_s == 1e-4 and len(record) == 14_000
    read = record["interferometer_m"]
    assert np.flatnonzero(np.isfinite(read)).tolist() == list(range(0, 14_000, 1000)) and read[9000] == 9000
    (remark,) = record.remarks
    assert "bag: 1 stop of the host for more than 10 periods, 45 s in all" in remark
    encoder = dataclasses.replace(record, columns={"encoder_m": record["encoder_m"]})
    said = check_record(encoder, Bounds(1.0, 1e6, 1.0, period_s=7e-5))
    assert said[:2] == [remark, f"{record.source}: sampled every 0.0001 s, the axis every 7e-05 s"]


def test_voltage_is_what_was_held(tmp_path):
    """A command that came late did not act in its own period: the next state tells what did."""
    record = full_record(10)
    write_record(record, tmp_path / "bag")
    bag = Bag(tmp_path / "bag").read()
    np.testing.assert_array_equal(bag["/axis/state"]["applied_voltage"][1:], record["voltage_V"][:-1])
    np.testing.assert_array_equal(bag["/axis/state"]["sequence"], np.arange(10))


def test_the_longest_activation_is_taken(tmp_path):
    first, second = [(n, float(n)) for n in range(5)], [(n, 100.0 + n) for n in range(9)]
    write_cell(tmp_path / "bag", first + second, first + second)
    record = read_record(tmp_path / "bag")
    np.testing.assert_array_equal(record["encoder_m"], 100.0 + np.arange(9))
    np.testing.assert_array_equal(record["voltage_V"], 100.0 + np.arange(9))


def test_several_axes_need_a_namespace(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        add_axis(bag, [(0, 1.0), (1, 1.0)], [], "/left")
        add_axis(bag, [(0, 2.0), (1, 2.0)], [], "/right")
    with pytest.raises(InputError, match="/left/, /right/"):
        read_record(tmp_path / "bag")
    with pytest.raises(InputError, match="one of /left/, /right/"):
        read_record(tmp_path / "bag", "middle")
    assert read_record(tmp_path / "bag", "right")["encoder_m"][0] == 2.0


def test_other_bags_are_refused(tmp_path):
    with BagWriter(tmp_path / "talk") as bag:
        bag.add_channel("/talk", WORDS)
    with pytest.raises(InputError, match="topics /talk"):
        read_record(tmp_path / "talk")
    write_cell(tmp_path / "one", [(0, 1.0)], [])
    with pytest.raises(InputError, match="at least 2"):
        read_record(tmp_path / "one")
    forces = Record(1e-3, {"encoder_m": [0, 1], "reference_m": [0, 1], "force_N": [0, 1]})
    with pytest.raises(InputError, match="csv"):
        write_record(forces, tmp_path / "forces.mcap")
    with pytest.raises(InputError, match="rosbag2 folder"):
        write_record(forces, tmp_path / "forces.txt")


@pytest.mark.parametrize("name", ["AxisState", "VoltageCommand", "InterferometerReading", "SimulationTruth"])
def test_source_tree_and_installation_define_the_same_messages(name, monkeypatch):
    """The hash computed without ROS is the one that ROS computed."""
    try:
        installed = installed_definition(f"microstage_msgs/msg/{name}")
    except InputError:
        pytest.skip("microstage_msgs is not installed here (AMENT_PREFIX_PATH)")
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    source = own_definition(name)
    assert (source.hash, source.types) == (installed.hash, installed.types)


def test_times_below_zero_lose_no_row(tmp_path):
    """As from a scope with a trigger: their stamps wrapped, and half a second was gone."""
    record = full_record(3000)
    columns = {**record.columns, "t_s": np.arange(3000) * 1e-4 - 0.1}
    write_record(Record(1e-4, columns, metadata=record.metadata), tmp_path / "run.mcap")
    back = read_record(tmp_path / "run.mcap")
    assert len(back) == 3000
    np.testing.assert_array_equal(back["encoder_m"], record["encoder_m"])


@pytest.mark.parametrize("column", ["fine_position_m", "force_N", "torque_Nm"])
def test_a_column_that_a_bag_has_no_message_for_is_refused(tmp_path, column):
    record = full_record(100)
    wider = Record(1e-4, {**record.columns, column: np.zeros(100)})
    with pytest.raises(InputError, match=f"column {column}: got 'in the record', .*write the record into a .csv file"):
        write_record(wider, tmp_path / "run.mcap")
    assert not (tmp_path / "run.mcap").exists()
