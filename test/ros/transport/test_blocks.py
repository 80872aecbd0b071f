"""Blocks: every message once and in order, however late the sending; and senders that make no blocks."""

import time

import numpy as np
import pytest
from microstage_msgs.msg import VoltageCommand
from ros_support import spin_until

from microstage_ros.ros.transport.block_buffer import SLOTS, close, crowded, keep, new_ring
from microstage_ros.ros.transport.blocks import Outlet, Refusals, Sender, Stream, periods_per_block
from microstage_ros.ros.transport.codec import Codec
from microstage_ros.ros.transport.servo_path import RCLError, Semaphore, make_servo_path, never_raising

CODEC = Codec("VoltageCommand")


def command(n):
    return CODEC.pack(1000 * n, n, 0.5 * n, 0.0, 0.0, 1)


def heard(stream, servo, count, seconds=120.0):
    """Sequence numbers of ``count`` messages."""
    found, end = [], time.monotonic() + seconds
    while len(found) < count and time.monotonic() < end:
        servo.wait(stream.readers, 0.1)
        while (rows := stream.take_all()) is not None:
            messages = CODEC.array(rows)
            assert np.array_equal(messages["voltage"], 0.5 * messages["sequence"])
            found += messages["sequence"].tolist()
    return found


@pytest.mark.parametrize("period, periods", [(1e-4, 100), (1e-3, 20), (1e-2, 2), (1.0, 1), (1e-6, 100)])
def test_a_block_is_short(period, periods):
    assert periods_per_block(period) == periods


def test_a_ring_keeps_what_it_has_when_it_is_full():
    ring, row = new_ring(3, 4), np.arange(4, dtype=np.uint8)
    kept = sum(keep(ring, row, n) for n in range(1000))
    assert kept == SLOTS * 3 and crowded(ring) and not close(ring)
    assert ring[1][:, 1].tolist() == list(range(0, SLOTS * 3, 3))
    ring[2][1] += 1  # one was sent
    assert keep(ring, row, 1000) and ring[1][0].tolist() == [1, 1000]


def test_what_the_middleware_refuses_ends_nobody_and_is_counted(node):
    """It refuses every message once its memory is taken by readers that were killed: a new publisher has memory of its own."""
    servo = make_servo_path(node)
    outlet, stream = Outlet(node, servo, VoltageCommand, "command"), Stream(node, servo, VoltageCommand, "command")
    spin_until(node, lambda: outlet.followers == 1 and stream.publishers == 1)
    refused = []

    def refuse(raw):
        refused.append(raw)
        raise RCLError("Failed to publish: cannot publish data")

    for n in range(4):  # every second block is refused, and goes through a new publisher
        if n % 2:
            outlet._send_block = never_raising(refuse)
        outlet.send(n, command(n))
        outlet.flush()
        assert heard(stream, servo, 1) == [n]
    assert len(refused) == 2 and outlet.unsent == 0
    writer, outlet._writer = outlet._writer, lambda publisher: never_raising(refuse)
    outlet._send_block = never_raising(refuse)
    outlet.send(4, command(4))
    outlet.flush()
    assert outlet.unsent == 1
    outlet._writer = writer
    outlet.send(5, command(5))
    outlet.flush()
    assert heard(stream, servo, 1) == [5]


def test_single_messages_that_are_refused_go_through_a_new_publisher(node):
    """In Python at once; compiled code is given the new publisher's address by the sender's thread."""
    servo = make_servo_path(node)
    outlet = Outlet(node, servo, VoltageCommand, "command", always=True)
    before = outlet.address
    outlet._write_single = never_raising(_refusal)
    outlet.send_single(command(0))
    assert outlet.address != before and outlet._write_single(command(1))
    counts, links = np.zeros(1, [("refused", "i8")]), np.zeros(1, [("commands", "u8")])
    refusals = Refusals(outlet)
    refusals.look(counts, links, "commands")
    assert links["commands"][0] == 0
    for _ in range(4):
        counts["refused"] += 3
        refusals.look(counts, links, "commands")
        refusals.look(counts, links, "commands")
        assert links["commands"][0] == outlet.address
    assert sum(publisher.topic_name == "/axis/command" for publisher in node.publishers) == 3


def _refusal(raw):
    raise RCLError("Failed to publish: cannot publish data")


def test_a_loop_does_not_wait_for_another_thread_that_sends(node):
    outlet = Outlet(node, make_servo_path(node), VoltageCommand, "command")
    outlet.send(0, command(0))
    with outlet._sending:
        outlet.closed = lambda: None
        outlet.flush()
        outlet.send_closed(wait=False)
        assert outlet.ring[2].tolist() == [1, 0]
    outlet.send_closed()
    assert outlet.ring[2].tolist() == [1, 1]


@pytest.mark.parametrize("own_thread", [False, True])
def test_every_message_comes_once_and_in_order(node, own_thread):
    servo = make_servo_path(node)
    outlet, stream = Outlet(node, servo, VoltageCommand, "command"), Stream(node, servo, VoltageCommand, "command")
    sender = Sender([outlet], Semaphore()) if own_thread else None
    spin_until(node, lambda: outlet.followers == 1 and stream.publishers == 1)
    for n in range(5000):  # more than fits the ring: the sending is waited for
        outlet.send(n, command(n))
        if n % 100 == 42:
            outlet.flush()
    if sender:
        sender.stop()
    outlet.flush()
    assert heard(stream, servo, 5000) == list(range(5000))


def test_what_is_sent_at_once_comes_after_what_was_sent_before(node):
    servo = make_servo_path(node)
    outlet, stream = Outlet(node, servo, VoltageCommand, "command"), Stream(node, servo, VoltageCommand, "command")
    singly = []
    node.create_subscription(VoltageCommand, "command", singly.append, 1000)
    spin_until(node, lambda: outlet.followers == 1 and outlet.listeners == 1 and stream.publishers == 1)
    outlet.send(0, command(0))
    messages = CODEC.blank(1000 * np.arange(1, 500))
    messages["sequence"] = np.arange(1, 500)
    messages["voltage"], messages["sender"] = 0.5 * messages["sequence"], 1
    assert [bytes(row) for row in messages[:3].view(np.uint8).reshape(3, -1)] == [command(n) for n in (1, 2, 3)]
    outlet.send_all(messages)
    assert heard(stream, servo, 500) == list(range(500))
    spin_until(node, lambda: len(singly) >= 499)
    assert [message.sequence for message in singly[-499:]] == list(range(1, 500))


def test_a_sender_without_blocks_is_followed_singly(node):
    """Anybody may stand in for a node; whoever makes blocks is not read twice."""
    servo = make_servo_path(node)
    stream, other = Stream(node, servo, VoltageCommand, "command"), Stream(node, servo, VoltageCommand, "blocked")
    Outlet(node, servo, VoltageCommand, "blocked")
    publisher = node.create_publisher(VoltageCommand, "command", 100)
    spin_until(node, lambda: stream.look())
    assert not other.look() and not other.look() and not other.look()
    spin_until(node, lambda: publisher.get_subscription_count() == 1 and stream.publishers == 1)
    for n in range(20):
        publisher.publish(VoltageCommand(sequence=n, voltage=0.5 * n))
    assert heard(stream, servo, 20) == list(range(20))


def test_a_stranger_beside_the_sender_of_blocks_is_not_followed(node):
    """Else every message of the expected sender would be read twice: in its block, and singly."""
    import rclpy

    stranger = node.create_publisher(VoltageCommand, "command", 10)
    servo = make_servo_path(node)
    stream = Stream(node, servo, VoltageCommand, "command")
    spin_until(node, lambda: stream.look())
    assert stream.singly  # alone it is somebody
    controller = rclpy.create_node("str_controller", namespace="/axis")
    try:
        outlet = Outlet(controller, make_servo_path(controller), VoltageCommand, "command", always=True)
        spin_until(node, lambda: stream.look())
        assert not stream.singly and len(stream.readers) == 1
        spin_until(node, lambda: outlet.followers == 1 and stream.publishers == 1)
        for n in range(4):
            stranger.publish(VoltageCommand(sequence=2**40))
            outlet.send(n, command(n))
        outlet.flush()
        assert not stream.look() and not stream.look() and heard(stream, servo, 4) == [0, 1, 2, 3]
    finally:
        controller.destroy_node()
