"""Messages that are none: random bytes, blocks of the wrong size, numbers out of range, from a stranger to every
topic."""

import random
import struct

from microstage_msgs.msg import (
    AxisState,
    ControllerState,
    Credit,
    InterferometerReading,
    MessageBlock,
    VoltageCommand,
)

from microstage_ros.ros.transport import topics
from microstage_ros.ros.transport.codec import ENCAPSULATION

KINDS = {
    topics.STATE: AxisState,
    topics.COMMAND: VoltageCommand,
    topics.CONTROLLER_STATE: ControllerState,
    topics.INTERFEROMETER: InterferometerReading,
    topics.CREDIT: Credit,
}
BLOCKED = (topics.STATE, topics.COMMAND, topics.CONTROLLER_STATE, topics.INTERFEROMETER, topics.SIMULATION)
NODES = ("axis_driver", "str_controller", "gms_observer", "move_server")
NUMBERS = (0, 1, 2**31, 2**62, 2**63, 2**63 + 5, 2**64 - 1)
VALUES = (0.0, 6.0, -6.0, float("nan"), float("inf"), 5e-324, 1e308)


class Stranger:
    """Publishes what nobody should.

    Parameters
    ----------
    node : rclpy node in the namespace of the axis. seed : of the bytes.

    Attributes
    ----------
    sent : messages so far. refused : by the middleware. commands : of them on the topic ``command``.
    """

    def __init__(self, node, seed):
        self._chance = random.Random(seed)
        self._single = {topic: node.create_publisher(kind, topic, 10) for topic, kind in KINDS.items()}
        self._blocks = {topic: node.create_publisher(MessageBlock, topics.BLOCKS + topic, 10) for topic in BLOCKED}
        self.sent = self.refused = self.commands = 0

    def send(self):
        """One message. Some cannot even be sent: the middleware refuses what is longer than its type."""
        chance = self._chance
        choice = chance.randrange(4)
        try:
            if choice == 0:
                publisher = chance.choice([*self._single.values(), *self._blocks.values()])
                self.commands += publisher is self._single[topics.COMMAND]
                publisher.publish(ENCAPSULATION[: chance.randrange(5)] + chance.randbytes(chance.randrange(120)))
            elif choice == 1:
                length = chance.randrange(200)
                raw = chance.randbytes(length)
                head = struct.pack(
                    "<4sQII", ENCAPSULATION, chance.choice(NUMBERS), chance.choice((0, 7, length, 2**32 - 1)), length
                )
                chance.choice(list(self._blocks.values())).publish(head + raw)
            elif choice == 2:
                self._number(chance)
            else:
                self._single[topics.CREDIT].publish(
                    Credit(follower=chance.choice((*NODES, "x", "")), until=chance.choice(NUMBERS))
                )
        except Exception:  # noqa: BLE001 - rclpy's own error has no public class
            self.refused += 1
        self.sent += 1

    def _number(self, chance):
        number, value = chance.choice(NUMBERS), chance.choice(VALUES)
        if chance.random() < 0.5:
            self._single[topics.STATE].publish(AxisState(sequence=number, position=value))
        else:
            self.commands += 1
            self._single[topics.COMMAND].publish(VoltageCommand(sequence=number, voltage=value, sender=1))


def flood(node, count, seed, spin=lambda: None, every=50):
    """Send ``count`` messages [1]; a `Stranger` that tells how many went out.

    ``seed``: of the messages [1]; ``spin`` is called after ``every`` [1] of them.
    """
    stranger = Stranger(node, seed)
    for k in range(count):
        stranger.send()
        if k % every == 0:
            spin()
    return stranger
