"""LBP16: datagrams of commands to a Mesa Ethernet card, and the exchange that notices every lost or stale one.

A command is a little-endian u16: bit 15 write, 14 an address (u16) follows, 13 information, 12 to 10 space, 9 and 8
size of an element (8, 16, 32, 64 bit), 7 the address rises, 6 to 0 count. The data of all reads of a datagram come back
in one, bare. Source: Mesa manuals 7I92, 7I95T, 7I97T, chapter LBP16.
"""

import select
import socket
import struct
import time

from microstage_ros.hardware.protocol import HardwareError

PORT = 27181
WRITE, ADDRESS, RISES = 0x8000, 0x4000, 0x0080
HOSTMOT2, TIMERS, STATUS, INFORMATION = 0, 4, 6, 7
SIZES = {8: 0, 16: 1, 32: 2, 64: 3}
SCRATCH = 0x10  # of the timers' space: read counter, then write counter (u32 each)
RX_FRAMES = 0x08
LARGEST = 1400  # bytes of a datagram


def command(space, size, address, count, write=False):
    """The four bytes of one command: ``count`` elements [1] of ``size`` [bit] from ``address`` [byte] on.

    ``space``: number of the memory space [1], such as `HOSTMOT2`.
    Raises `ValueError` for a count outside 1 to 127.
    """
    if not 1 <= count <= 127:
        raise ValueError(f"a count of {count}, expected 1 to 127")
    word = (WRITE if write else 0) | ADDRESS | space << 10 | SIZES[size] << 8 | (RISES if count > 1 else 0) | count
    return struct.pack("<HH", word, address)


def read32(address, count=1):
    """Command that reads ``count`` [1] registers of hostmot2 from ``address`` [byte] on."""
    return command(HOSTMOT2, 32, address, count)


def write32(address, *values):
    """Command with data, in bytes, that writes ``values``, u32 (n,), to hostmot2 from ``address`` [byte] on."""
    return command(HOSTMOT2, 32, address, len(values), True) + struct.pack(
        f"<{len(values)}I", *(v & 0xFFFFFFFF for v in values)
    )


class Link:
    """The socket to one card.

    Parameters
    ----------
    host, port : of the card. patience : seconds to wait for an answer while the card is set up.

    Attributes
    ----------
    lost, stale, repeated : answers that did not come, that were of an earlier question, writes that were sent again.
    """

    def __init__(self, host, port=PORT, patience=0.2):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.connect((host, port))
        except OSError as error:
            self._socket.close()
            raise HardwareError(f"Mesa card at {host}: {error}") from None
        self._socket.setblocking(False)
        self._where, self._patience = f"{host}:{port}", patience
        self._reads = self._writes = 0
        self._last_write = b""
        self.lost = self.stale = self.repeated = 0

    def close(self):
        """Close the socket."""
        self._socket.close()

    def send(self, *commands):
        """Send commands that answer nothing; `HardwareError` if the socket refuses them."""
        try:
            self._socket.send(b"".join(commands))
        except OSError as error:
            raise HardwareError(f"Mesa card at {self._where}: {error}") from None

    def write(self, *commands):
        """Send writes with a number that the next `read` gives back, so that a lost one is noticed."""
        self._writes = (self._writes + 1) & 0xFFFFFFFF
        self._last_write = (
            b"".join(commands) + command(TIMERS, 32, SCRATCH + 4, 1, True) + struct.pack("<I", self._writes)
        )
        self.send(self._last_write)

    def repeat_write(self):
        """Send the last writes once more; they carry the same number."""
        if self._last_write:
            self.repeated += 1
            self.send(self._last_write)

    def read(self, commands, length, seconds):
        """Ask once and wait for the answer to this very question.

        Parameters
        ----------
        commands : read commands (bytes). length : size of their data [byte]. seconds : to wait at most [s].

        Returns
        -------
        (data, written) : the bytes, and whether the last `write` has arrived; None where no answer came in time.
        """
        self._reads = (self._reads + 1) & 0xFFFFFFFF
        self.send(
            commands,
            command(TIMERS, 32, SCRATCH, 1, True),
            struct.pack("<I", self._reads),
            command(TIMERS, 32, SCRATCH, 2),
        )
        until = time.perf_counter() + seconds
        while True:
            answer = self._receive(until)
            if answer is None:
                self.lost += 1
                return None
            if len(answer) == length + 8:
                reads, writes = struct.unpack_from("<II", answer, length)
                if reads == self._reads:
                    return answer[:length], not self._writes or writes == self._writes
            self.stale += 1  # late, duplicated, cut off: of another question

    def _receive(self, until):
        """The next datagram from the card; None when the time is over."""
        while True:
            rest = until - time.perf_counter()
            # select keeps time better than poll and socket timeouts where the kernel rounds those up to milliseconds
            if rest <= 0.0 or not select.select([self._socket], [], [], rest)[0]:
                return None
            try:
                return self._socket.recv(2048)
            except BlockingIOError:
                continue
            except OSError as error:
                raise HardwareError(f"Mesa card at {self._where}: {error}") from None

    def ask(self, commands, length, tries=5):
        """Data of read commands while the card is set up. Raises `HardwareError` if it never answers.

        ``length``: size of the data [byte]; ``tries`` [1].
        """
        for _ in range(tries):
            found = self.read(commands, length, self._patience)
            if found is not None:
                return found[0]
        raise HardwareError(f"Mesa card at {self._where} does not answer (cable, address, firewall, power)")

    def ask32(self, address, count=1):
        """``count`` [1] registers of hostmot2 from ``address`` [byte] on, as a tuple of int, shape (count,)."""
        return struct.unpack(f"<{count}I", self.ask(read32(address, count), 4 * count))
