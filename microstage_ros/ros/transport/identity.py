"""Who published a message: known by the DDS identity of its process, never by what the message says.

The middleware tells with every message the 16 bytes (GID) of the endpoint that sent it. The first 12 are the same for
all endpoints of one process, and no other process in the domain has them. `Holder` keeps those of the one process that
may publish on a topic: the endpoint that the graph showed first under the expected name, for as long as it is there. A
second endpoint of that name gets nowhere, whatever it claims to be. Without DDS security a hostile program could still
forge the bytes on the wire (docs/safety.md).
"""

import time

import numpy as np

from microstage_ros.ros.transport.c_calls import GID_AT, HALF

ANYBODY = (0, 0)
NOBODY = (-1, 0)
"""Numbers that no process has."""
UNNAMED, UNKNOWN = "_NODE_NAME_UNKNOWN_", "unknown"
"""What the middleware calls a node of which it knows an endpoint and no name yet, and what is said of it here."""


def process_of(gid):
    """The two numbers of the process to which an endpoint belongs.

    Parameters
    ----------
    gid : its bytes, integers from 0 to 255, shape (16,).

    Returns
    -------
    (int, int) : as `c_calls.known` compares them.
    """
    words = np.frombuffer(bytes(gid[:16]).ljust(16, b"\0"), np.int64)
    return int(words[0]), int(words[1]) & HALF


def process_of_message(info):
    """As `process_of`, from the words ``info`` that `c_calls.take_from` has filled, int64 of shape (n,)."""
    return int(info[GID_AT]), int(info[GID_AT + 1]) & HALF


class Names:
    """Which process belongs to the node of which name, as the graph tells; asked at most every `AGAIN_S`.

    Parameters
    ----------
    node : rclpy node that looks. topic : on which they publish.
    """

    AGAIN_S = 0.1

    def __init__(self, node, topic):
        self._holder, self._found, self._at = Holder(node, topic), {}, -1.0
        self._prefix = f"{node.get_namespace().rstrip('/')}/"

    def __call__(self, name, sender):
        """True if ``sender`` is the process of the node ``name`` of the own namespace; where nobody can tell, too."""
        if sender == ANYBODY:
            return True
        if time.monotonic() - self._at > self.AGAIN_S:
            self._at, self._found = time.monotonic(), self._holder.publishers()
        return self._found.get(sender) == self._prefix + name


class Holder:
    """The one process that may publish on a topic.

    Parameters
    ----------
    node : rclpy node that looks. topic : name. names : nodes of the own namespace that are preferred where several
        publish.

    Attributes
    ----------
    words : int64 (2,), the holder's numbers as compiled code compares them; while there is none, zeros, or `NOBODY` if
        it is strict.
    name : of its node, empty if none, `UNKNOWN` until the graph tells it.
    """

    def __init__(self, node, topic, names=()):
        self._node, self._topic, self._names = node, node.resolve_topic_name(topic), names
        self._none = ANYBODY
        self.words, self.name = np.zeros(2, np.int64), ""

    def be_strict(self):
        """From now on nobody is obeyed while nobody holds the topic; until now anybody is heard."""
        self._none = NOBODY
        if not self.words[0]:
            self.words[:] = NOBODY

    @property
    def found(self):
        """True while somebody holds the topic."""
        return tuple(self.words.tolist()) != self._none

    def publishers(self):
        """Process numbers to full node name, of all that publish on the topic now."""
        found = {}
        for info in self._node.get_publishers_info_by_topic(self._topic):
            name = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            found[process_of(info.endpoint_gid)] = UNKNOWN if info.node_name == UNNAMED else name
        return found

    def look(self):
        """Keep the holder while it is there, else take the next; the numbers that publish beside it, to their names."""
        found = self.publishers()
        mine = tuple(self.words.tolist())
        if mine not in found:
            self.take(found, self._first(found))
            mine = tuple(self.words.tolist())
        self.name = found.get(mine, "")  # the graph may learn it later than the endpoint
        return {numbers: name for numbers, name in found.items() if numbers != mine}

    def learn_name(self):
        """The holder's name from the graph, where it is not known yet; the holder stays."""
        if self.name == UNKNOWN:
            self.name = self.publishers().get(tuple(self.words.tolist()), UNKNOWN)

    def look_beyond(self):
        """As `look`, when the holder has been silent: another of an expected name takes its place, if there is one."""
        found = self.publishers()
        others = {numbers: name for numbers, name in found.items() if numbers != tuple(self.words.tolist())}
        choice = self._first(others, strictly=True)
        if choice != ANYBODY:
            self.take(others, choice)
        return self.look()

    def look_for_expected(self):
        """As `look`; a holder of another name, taken while it was alone, gives way to the one of an expected name."""
        others = self.look()
        own = self._own
        return self.look_beyond() if self.name not in own and own & set(others.values()) else others

    @property
    def _own(self):
        """Full names of the nodes that are preferred."""
        return {f"{self._node.get_namespace().rstrip('/')}/{name}" for name in self._names}

    def _first(self, found, strictly=False):
        """Whom to take of ``found``: the only one with an expected name, or the only one at all where none has it; the
        latter not if ``strictly``."""
        own = self._own
        named = {numbers: name for numbers, name in found.items() if name in own}
        choice = named if strictly and own else named or found
        return next(iter(choice)) if len(choice) == 1 else ANYBODY

    def take(self, found, numbers):
        """Make the process ``numbers``, two of them [1], the holder; `ANYBODY`: nobody. ``found``: {numbers: name}."""
        self.words[:] = self._none if numbers == ANYBODY else numbers
        self.name = found.get(numbers, "")

    def forget(self):
        """Nobody holds the topic."""
        self.take({}, ANYBODY)

    def is_of(self, info):
        """True if the message with these words of information, ``info`` of shape (n,), came from the holder, or
        nobody holds the topic."""
        return self.words[0] == 0 or process_of_message(info) == tuple(self.words.tolist())
