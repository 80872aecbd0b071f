"""The private calls, the fall-back without them, and the fixed-layout messages."""

import _ctypes
import os
from pathlib import Path

import numpy as np
import pytest
from microstage_msgs import msg
from rclpy.serialization import deserialize_message, serialize_message
from ros_support import spin_until

from microstage_ros.ros.transport.codec import Codec, stamp_ns, stamps_ns
from microstage_ros.ros.transport.servo_path import (
    FastServoPath,
    PlainServoPath,
    make_servo_path,
    missing_private_calls,
    reader_qos,
)

KINDS = ("AxisState", "VoltageCommand", "ControllerState", "FrictionState", "InterferometerReading", "SimulationTruth")


def test_this_rclpy_has_the_private_calls():
    """Fails when rclpy changes them: then `servo_path.PRIVATE` and `FastServoPath` have to follow."""
    assert missing_private_calls() == []


def test_missing_calls_are_named():
    class Changed:
        Subscription = type("Subscription", (), {"pointer": None})
        Publisher = type("Publisher", (), {"pointer": None})

    assert missing_private_calls(Changed) == ["Subscription.take_message"]
    assert missing_private_calls(None) == ["rclpy.impl.implementation_singleton"]
    assert "no_such_call" in missing_private_calls(c_calls={None: ("no_such_call",)})
    assert "no_such_library.so" in missing_private_calls(c_calls={"no_such_library.so": ("x",)})


@pytest.mark.parametrize("plain", [False, True])
def test_both_ways_carry_the_same_bytes(node, plain):
    path = make_servo_path(node, plain=plain)
    assert isinstance(path, PlainServoPath if plain else FastServoPath)
    reader = path.reader(msg.VoltageCommand, f"command_{plain}", reader_qos(100, reliable=True))
    publisher = node.create_publisher(msg.VoltageCommand, f"command_{plain}", 100)
    send, codec = path.writer(publisher), Codec("VoltageCommand")
    spin_until(node, lambda: publisher.get_subscription_count() == 1 and reader.publishers == 1)
    sent = [codec.pack(10**9 * k + 7, k, 0.1 * k, 1e-6 * k, 0.0, 1) for k in range(20)]
    for raw in sent:
        send(raw)
    heard = []
    for _ in range(1000):
        path.wait((reader,), 0.1)
        while (raw := reader.take()) is not None:
            heard.append(bytes(raw))
        if len(heard) == len(sent):
            break
    assert [raw[:len(sent[0])] for raw in heard] == sent
    path.wait((reader,), 0.01)
    assert reader.take() is None


def test_sending_releases_the_interpreters_lock(node, monkeypatch):
    """rclpy's own call holds it: a send that waited for a reader that was killed stopped every service of the process."""
    send = make_servo_path(node).writer(node.create_publisher(msg.VoltageCommand, "command_late", 10))
    assert not send.__self__._publish._flags_ & _ctypes.FUNCFLAG_PYTHONAPI
    assert send(Codec("VoltageCommand").pack(7, 1, 0.1, 1e-6, 0.0, 1)) is True
    monkeypatch.setattr(send.__self__, "_publish", lambda *_: 1)
    assert send(b"12345678") is False


def filled(kind):
    """A message with a different value in every field."""
    message = getattr(msg, kind)()
    message.header.stamp.sec, message.header.stamp.nanosec = 3, 4
    values = iter(range(1, 100))
    for name, written in message.get_fields_and_field_types().items():
        if name == "header":
            continue
        if "[" in written:
            kind_, count = written.rstrip("]").split("[")
            setattr(message, name, [bool(next(values) % 2) if kind_ == "boolean" else float(next(values))
                                    for _ in range(int(count))])
        else:
            value = next(values)
            setattr(message, name, bool(value % 2) if written == "boolean" else
                    float(value) + 0.5 if written == "double" else value)
    return message


@pytest.mark.parametrize("kind", KINDS)
def test_codec_is_the_serialisation_of_ros(kind):
    message = filled(kind)
    raw, codec = serialize_message(message), Codec(kind)
    values = codec.unpack(raw)
    flat = [value for name in codec.names for value in np.atleast_1d(getattr(message, name)).tolist()]
    assert list(values) == flat and stamp_ns(raw) == 3_000_000_004
    packed = codec.pack(3_000_000_004, *values)
    assert deserialize_message(packed, getattr(msg, kind)) == message
    assert codec.pack_as(raw, *values) == packed
    assert codec.size == len(packed) <= len(raw) < len(packed) + 8  # bytes between fields: ROS leaves them unset
    found = codec.array(np.frombuffer(raw, np.uint8).reshape(1, -1))
    assert stamps_ns(found).tolist() == [3_000_000_004]
    assert [value for name in codec.names for value in np.atleast_1d(found[name][0]).tolist()] == flat


def test_messages_cross_as_shared_memory(node):
    """A type that Fast DDS does not hold for bounded would cost twice the time; nobody else would notice."""
    from microstage_msgs.msg import MessageBlock

    if not os.environ.get("FASTDDS_DEFAULT_PROFILES_FILE") or not Path("/dev/shm").is_dir():
        pytest.skip("needs the Fast DDS profile, which ./microstage applies, and /dev/shm")
    for kind in (*(getattr(msg, name) for name in KINDS), MessageBlock):
        before = set(Path("/dev/shm").glob("fast_datasharing_*"))
        publisher = node.create_publisher(kind, f"shared_{kind.__name__}".lower(), 10)
        assert set(Path("/dev/shm").glob("fast_datasharing_*")) - before, kind
        node.destroy_publisher(publisher)
