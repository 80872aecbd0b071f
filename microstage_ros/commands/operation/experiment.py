"""``experiment``: a run file's closed-loop program on a cell, its own or one that runs, recorded to a bag that
`identify` reads."""

import signal
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from microstage_ros.commands import answer, units
from microstage_ros.commands.__main__ import which_ros
from microstage_ros.commands.axis import read_axis
from microstage_ros.commands.backend import add_backend, chosen_backend
from microstage_ros.commands.parser import Parser
from microstage_ros.commands.run_on_cell import law_of, with_run
from microstage_ros.control.runs.run_file import load_run
from microstage_ros.files import complete_folder, keep_earlier
from microstage_ros.places import config_file
from microstage_ros.quantities.errors import InputError

LEAD_IN = 0.05  # rest before the program [s]
ANSWER = 20.0  # longest wait for the controller's answer [s]
SOUGHT = 3.0  # longest wait for any sign of a cell of that name [s]
DRAIN = 2.0  # beside a cell that goes on: what was under way when the program ended [s]
STALLED = 30.0  # no state for so long: the cell has stopped [s]
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
STOP_ANSWER = 2.0  # longest wait for the answer to a stop, where the program does not end by itself [s]
STOP_AGAIN = 0.2  # a stop that is not answered is asked for again after so long [s]
LOOK = 0.1  # from one look into a bag that grows to the next [s]
OTHERS = 5.0  # longest wait for a topic that a record can do without, whose publisher may be silent [s]
SAME = 1e-9  # m, between the reference that a state tells and the one that was sent
LONGEST = 120.0  # seconds of program: one request carries all its positions


def main(argv=None):
    """Run the command. Returns 0, 1 if a process failed; raises InputError for bad input."""
    parser = Parser(
        prog="microstage experiment",
        description=(
            "Starts the nodes of an axis, or with --running joins those that are there, plays the reference of a run"
            " file (moves, scans, sines) through the controller's service follow_reference, and records everything; the"
            " bag is a record for identify and diagnose. A cell of its own has the controller of the run file,"
            " and if its axis is simulated effects, noise and start, too; what is not named is as in the axis file."
        ),
    )
    parser.add_argument(
        "--run", required=True, metavar="FILE", help="run file with a closed-loop program, up to two minutes"
    )
    parser.add_argument("--axis", metavar="FILE", help="axis file (default: the shipped config/axis.yaml)")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the bag and the nodes' logs")
    add_backend(parser)
    parser.add_argument("--mode", choices=("lockstep", "paced"),
                        help="simulated time (default where the backend is simulated), or wall clock")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of a simulated axis (default 1)")
    parser.add_argument(
        "--running",
        action="store_true",
        help="on the cell that runs already, lockstep or paced; --axis is its axis file",
    )
    parser.add_argument(
        "--namespace", type=units.namespace, default="/axis", metavar="NS", help="of the axis (default /axis)"
    )
    parser.add_force()
    arguments = parser.parse_args(argv)
    axis = read_axis(arguments.axis or config_file("axis.yaml"))
    out = Path(arguments.out)
    keep_earlier("--out", [out / "bag"], arguments.force)
    run = load_run(arguments.run)
    reference = reference_of(run, axis)
    backend = None if arguments.running else chosen_backend(arguments, axis)
    law = law_of(run, axis)
    backend = with_run(backend, run, axis)
    if backend:
        arguments.mode = backend.mode_or(arguments.mode)
    with complete_folder(out) as folder:
        status = (
            _run(arguments, out, folder, reference, axis, backend, law)
            if backend
            else _join(arguments, out, folder, reference, axis)
        )
    return status or _said(out, reference)


def reference_of(run, axis):
    """Positions [m], one per control period, of a run's program. Raises InputError for a program that has none."""
    period = axis.value("period")
    if run.period_s is not None and abs(run.period_s / period - 1.0) > 1e-6:
        raise InputError(f"{run.place}: period_s", run.period_s, f"{period:g} s, the control period of the axis")
    tables = run.tables(period)
    if np.any(tables["open_loop"]) or np.any(tables["disturbance"]):
        raise InputError(
            f"{run.place}: program", "voltages", "moves, scans, sines or a reference_file: the cell is in closed loop"
        )
    reference = tables["reference"]
    if len(reference) * period > LONGEST:
        raise InputError(
            f"{run.place}: program", f"{len(reference) * period:.0f} s", f"at most {LONGEST:g} s in one experiment"
        )
    low, high = axis.value("travel.minimum"), axis.value("travel.maximum")
    if reference.min() < low or reference.max() > high:
        raise InputError(
            f"{run.place}: program",
            f"{reference.min():g} … {reference.max():g} m",
            f"places within {low:g} … {high:g} m",
        )
    return reference


def _run(arguments, out, folder, reference, axis, backend, law):
    import rclpy

    from microstage_ros.ros.launching.cell_processes import NODES, CellFailure, CellProcesses

    file = {"axis_file": str(Path(arguments.axis).resolve())} if arguments.axis else {}
    parameters = {
        "axis_driver": {"mode": arguments.mode, "seed": arguments.seed, **file, **backend.driver_parameters},
        "str_controller": {**file, **law},
        "gms_observer": file,
        "bag_recorder": {
            "directory": str((folder / "bag").resolve()),
            "run": Path(arguments.run).read_text(encoding="utf-8"),
            "log_time": "stamp" if arguments.mode == "lockstep" else "arrival",
            **backend.recorder_parameters,
        },
    }
    print(f"{which_ros()}\n{backend.words(axis.name, arguments.seed)}", file=sys.stderr)
    out.mkdir(parents=True, exist_ok=True)
    rclpy.init()
    node = rclpy.create_node("experiment", namespace=arguments.namespace)
    try:
        with CellProcesses(
            arguments.namespace, backend.nodes(n for n in NODES if n != "move_server"), parameters, out / "logs"
        ) as cell:
            player = _Player(node, cell, axis.value("period"))
            cell.activate(node)
            player.play(reference)
            cell.deactivate(node)
    except CellFailure as failure:
        return _failed(f"{failure}; what the nodes said is in {out / 'logs'}")
    finally:
        rclpy.try_shutdown()
    return 0


def _failed(says):
    answer.state(error={"place": "experiment", "says": says})
    print(says, file=sys.stderr)
    return 1


def _said(out, reference):
    answer.state(bag=str(out / "bag"), periods=len(reference))
    print(f"{out / 'bag'}: the record ({len(reference)} control periods of program)")
    return 0


def _join(arguments, out, folder, reference, axis):
    """On the cell that runs."""
    from microstage_ros.ros.launching.cell_processes import CellFailure

    out.mkdir(parents=True, exist_ok=True)
    text = Path(arguments.run).read_text(encoding="utf-8")
    try:
        recorded_beside(arguments.namespace, text, out, folder, axis.value("period"), lambda place: reference)
    except CellFailure as failure:
        return _failed(str(failure))
    return 0


def recorded_beside(namespace, text, out, folder, period, made):
    """Play a reference on the cell that runs, with a recorder beside it: nothing is started or stopped but that.

    Parameters
    ----------
    namespace : of the cell. text : of the run file, kept in the bag. out : folder of the logs. folder : of the ``bag``.
    period : of control [s]. made : the place [m] where the reference stands -> positions [m], one per period.

    Returns
    -------
    Number of periods of the programme. Raises CellFailure.
    """
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from microstage_ros.ros.launching.cell_processes import CellProcesses

    recorder = {
        "directory": str((folder / "bag").resolve()), "run": text, "log_time": "stamp", "longest_drain_s": DRAIN,
    }
    parameters = {"bag_recorder": recorder}
    print(f"{which_ros()}\nThe cell that runs in {namespace}.", file=sys.stderr)
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # rclpy's would end its context before the stop
    try:
        with _signals_kept() as came:
            beside = CellProcesses(namespace, ("bag_recorder",), parameters, out / "logs", beside="experiment")
            player = _Player(rclpy.create_node("experiment", namespace=namespace), beside, period, came)
            player.meet(namespace)  # before the recorder begins a bag
            with beside:
                _until_recorded(player, folder / "bag")
                reference = made(player.place)
                player.play(reference)
    finally:
        rclpy.try_shutdown()
    return len(reference)


@contextmanager
def _signals_kept():
    """Gives a list of the numbers of the `STOPPING` signals that came; raises KeyboardInterrupt at the end for them."""
    came = []
    heeded = [number for number in STOPPING if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in heeded}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)
    if came:
        raise KeyboardInterrupt


def _until_recorded(player, folder):
    """Wait until the bag ``folder`` holds a message of every topic of the servo path that has a publisher. What is sent
    before the recorder has found its publisher is not in the bag: it may hear the axis long before the controller."""
    from microstage_ros.ros.launching.cell_processes import CellFailure

    began = look = time.monotonic()
    while True:
        player.turn()
        if time.monotonic() < look:
            continue
        needed, others = player.published()
        held = _recorded(folder)
        waited, look = time.monotonic() - began, time.monotonic() + LOOK
        if needed <= held and (others <= held or waited > OTHERS):
            return
        if waited > STALLED:
            missing = ", ".join(sorted(needed - held))
            raise CellFailure(f"the recorder heard nothing of {missing} for {STALLED:g} s")


def _recorded(folder):
    """Names of the topics of which a bag that grows holds a message."""
    from microstage_ros.records.bags.bag_reader import Bag

    try:
        return Bag(folder).recorded
    except InputError:  # there is no file yet, or one that has only begun
        return set()


class _Player:
    """Plays positions to the controller and waits until they have been driven; stops the axis if it cannot go on.

    Parameters
    ----------
    node : rclpy node that nobody spins. cell : processes that must go on. period : of control [s].
    came : numbers of the signals that came; with one of them `turn` raises KeyboardInterrupt.
    """

    def __init__(self, node, cell, period, came=()):
        from microstage_msgs.msg import ControllerState
        from microstage_msgs.srv import FollowReference

        from microstage_ros.ros.transport import topics

        self._node, self._cell, self._period, self._request = node, cell, period, FollowReference.Request
        self._service = node.create_client(FollowReference, topics.FOLLOW_REFERENCE)
        self._state, self._heard = None, time.monotonic()
        self._came, self._sent = came, False
        self._watch = node.create_subscription(ControllerState, topics.CONTROLLER_STATE, self._hear, 10)

    def _hear(self, state):
        self._state, self._heard = state, time.monotonic()

    def turn(self):
        """A moment for the node; raises CellFailure where a process has ended or nothing is heard, KeyboardInterrupt
        where a signal came."""
        import rclpy

        from microstage_ros.ros.launching.cell_processes import CellFailure

        if self._came:
            raise KeyboardInterrupt
        self._cell.check()
        rclpy.spin_once(self._node, timeout_sec=0.02)
        if time.monotonic() - self._heard > STALLED:
            raise CellFailure(f"no state of the controller for {STALLED:g} s")

    def meet(self, namespace):
        """Wait for the controller of a cell that runs. Raises CellFailure where there is none."""
        from microstage_ros.ros.launching.cell_processes import CellFailure

        began = time.monotonic()
        while self._state is None or not self._service.service_is_ready():
            self.turn()
            seen = self._state is not None or self._node.count_publishers(self._watch.topic_name)
            if time.monotonic() > began + (ANSWER if seen else SOUGHT):
                stopped = "takes no reference: after a stop or a fault ./microstage reset lets it go on"
                raise CellFailure(f"the axis in {namespace} {stopped}" if seen
                                  else f"no axis runs in {namespace}: start one with ./microstage cell")

    def published(self):
        """Two sets of names: the topics of the servo path that a record needs, and the others that have a publisher."""
        from microstage_ros.ros.transport import topics

        names = {topic: self._node.resolve_topic_name(topic) for topic in topics.SENDERS}
        needed = {names[topic] for topic in (topics.STATE, topics.COMMAND)}
        return needed, {name for name in names.values() if self._node.count_publishers(name)} - needed

    @property
    def place(self):
        """Where the reference stands [m]; waits for the controller's first state."""
        while self._state is None:
            self.turn()
        return float(self._state.reference)

    def _ask(self, positions):
        from microstage_ros.ros.launching.cell_processes import CellFailure

        request, self._sent = self._request(positions=positions.tolist()), True
        answer, end = self._service.call_async(request), time.monotonic() + ANSWER
        while not answer.done():
            self.turn()
            if time.monotonic() > end:
                raise CellFailure(f"the controller gave no answer within {ANSWER:g} s")
        if not answer.result().accepted:
            self._sent = False  # what plays, if anything, is another's
            raise CellFailure(f"the controller refused the reference: {answer.result().message}")
        return answer.result()

    def _drive(self, positions):
        """Have ``positions`` [m] played, and wait until they have been. Raises CellFailure where somebody else's
        reference, or a hold, takes their place."""
        from microstage_ros.ros.launching.cell_processes import CellFailure

        plan = self._ask(positions)
        while (state := self._state) is None or state.sequence < plan.rest_sequence:
            n = -1 if state is None else state.sequence - plan.start_sequence
            if state is not None and 0 <= n < len(positions) and abs(state.reference - positions[n]) > SAME:
                self._sent = False  # what plays now, if anything, is another's
                raise CellFailure(f"the program was ended by another (a hold, a move, a stop): the reference is at "
                                  f"{state.reference:g} m where the program has {positions[n]:g} m")
            self.turn()

    def play(self, reference):
        """From where the reference stands to the program's first place, rest, then the program [m]."""
        from microstage_ros.control.trajectories.profiles import jerk_limited_move

        while self._state is None or not self._service.service_is_ready():
            self.turn()
        first = float(reference[0])
        rest = np.full(int(LEAD_IN / self._period), first)
        try:
            self._drive(jerk_limited_move(self._state.reference, first, self._period))
            self._drive(np.concatenate([rest, reference]))
        except BaseException:
            if self._sent:
                self._stop()
            raise

    def _stop(self):
        """Ask the controller to bring the reference to rest, and wait `STOP_ANSWER` [s] at most for its answer."""
        import rclpy

        if not rclpy.ok():  # interrupted in a cell of its own, whose end takes the voltage away
            return
        asked, end, again = [], time.monotonic() + STOP_ANSWER, 0.0
        with suppress(Exception):
            while not any(answer.done() for answer in asked) and time.monotonic() < end:
                if time.monotonic() > again:
                    asked.append(self._service.call_async(self._request()))
                    again = time.monotonic() + STOP_AGAIN
                rclpy.spin_once(self._node, timeout_sec=0.02)
        if any(answer.done() and answer.result() and answer.result().accepted for answer in asked):
            print("the axis stops and holds", file=sys.stderr)
        else:
            print("the controller has not answered the stop: ./microstage stop takes the voltage away", file=sys.stderr)
