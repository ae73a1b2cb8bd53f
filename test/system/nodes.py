"""Real nodes as processes, and a listener in the test's own process, on a ROS domain of their own."""

from __future__ import annotations

import atexit
import contextlib
import fcntl
import functools
import itertools
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
import rclpy
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.client import Client
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger

from mbd_sim import Simulation
from mbd_sim.files.load import load_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.ros.events_executor import EventsExecutor
from mbd_sim.ros.node.sim_parameters import PARAMETERS
from mbd_sim.simulation.model.live_values import names_with_matches
from test.system.forked_programs import ForkedProcess
from test.waiting import PATIENCE, wait_until

_counter = itertools.count()
LOST = 5.0  # s after which an answer that has not come may be lost
BLOCK, BLOCKS = 5, 20  # domain ids from 1 to 100: all that Linux has ports for


@functools.cache
def _own_block() -> tuple[int, IO[str] | None]:
    """A block of domain ids that no other process on this machine tests with, and the locked file that says so."""
    for block in range(BLOCKS):
        file = (Path(tempfile.gettempdir()) / f"mbd_sim_test_domains_{block}").open("w")
        with contextlib.suppress(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            atexit.register(file.close)
            _remove_shared_memory(range(1 + block * BLOCK, 1 + (block + 1) * BLOCK))
            return block, file
        file.close()
    return os.getpid() % BLOCKS, None  # more processes than blocks


def _remove_shared_memory(domains: range) -> None:
    """Remove what killed processes left behind: Fast DDS waits forever for a half-initialized segment of its port."""
    ports = range(7400 + 250 * domains.start, 7400 + 250 * domains.stop)
    for path in sorted(Path("/dev/shm").glob("*fastrtps_port*")):
        if int(re.sub(r"\D", "", path.name)) in ports:
            path.unlink(missing_ok=True)


def new_domain() -> int:
    """A domain id that no other test uses at the same time."""
    return 1 + _own_block()[0] * BLOCK + next(_counter) % BLOCK


class SimNodeProcess:
    """`sim_node` in a process of its own, with its output."""

    program = "mbd_sim.ros.node.sim_node"
    defaults = (("record", False),)

    def __init__(
        self,
        domain: int,
        folder: Path,
        parameters: dict[str, Any],
        remaps: Sequence[str] = (),
        wrapper: Sequence[str] = (),
        variables: Mapping[str, str] | None = None,
    ) -> None:
        environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        environment |= variables or {}
        arguments = ["--ros-args"]
        for name, value in (dict(self.defaults) | parameters).items():
            arguments += ["-p", f"{name}:={str(value).lower() if isinstance(value, bool) else value}"]
        for remap in remaps:
            arguments += ["-r", remap]
        self.log = folder / f"node_{next(_counter)}.log"
        self.process: ForkedProcess | subprocess.Popen[bytes]
        if not wrapper:
            self.process = ForkedProcess(self.program, arguments, folder, environment, self.log)
            return
        command = [*wrapper, sys.executable, "-m", self.program, *arguments]
        with self.log.open("wb") as stream:
            self.process = subprocess.Popen(
                command, cwd=folder, env=environment, stdout=stream, stderr=subprocess.STDOUT,
                start_new_session=True,
            )  # fmt: skip

    @property
    def text(self) -> str:
        return self.log.read_text(encoding="utf-8")

    def end(self, *signals: signal.Signals) -> int:
        """Send signals and wait for the exit code."""
        for number in signals or (signal.SIGINT,):
            self.process.send_signal(number)
        return self.exit_code()

    def exit_code(self) -> int:
        """Wait until it ends by itself."""
        return self.process.wait(PATIENCE)

    @property
    def has_ended(self) -> bool:
        return self.process.poll() is not None

    def kill(self) -> None:
        if not self.has_ended:
            self.process.kill()
            self.process.wait()


def refusal(folder: Path, parameters: dict[str, Any]) -> str:
    """What a node prints that ends at once, with an error and no traceback."""
    process = SimNodeProcess(new_domain(), folder, parameters)
    try:
        assert process.exit_code() == 1 and "Traceback" not in process.text
        return process.text
    finally:
        process.kill()


class Listener:
    """Subscribes to what a `sim_node` publishes, and calls its services."""

    server = "sim_node"
    process: SimNodeProcess | None = None  # where one is given, waiting ends with it

    def __init__(self, domain: int, namespace: str = "") -> None:
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("listener", context=self.context, namespace=namespace or None)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._clients: dict[tuple[str, str], Client] = {}
        self.states: list[JointState] = []
        self.arrivals: list[float] = []  # of the states, in s of the steady clock
        self.events: list[str] = []
        self.descriptions: list[str] = []
        self.applied: list[list[float]] = []
        latched = rclpy.qos.QoSProfile(depth=100, durability=rclpy.qos.QoSDurabilityPolicy.TRANSIENT_LOCAL)
        subscribe = self.node.create_subscription
        subscribe(JointState, "joint_states", self._take_state, 1000)
        subscribe(String, "sim_node/events", lambda message: self.events.append(message.data), latched)
        subscribe(String, "robot_description", lambda message: self.descriptions.append(message.data), latched)
        subscribe(Float64MultiArray, "sim_node/applied_efforts", lambda m: self.applied.append(list(m.data)), 1000)
        self.by_order = self.node.create_publisher(Float64MultiArray, "sim_node/commands", 10)
        self.by_name = self.node.create_publisher(JointState, "joint_commands", 10)

    def _take_state(self, message: JointState) -> None:
        self.states.append(message)
        self.arrivals.append(time.monotonic())

    # Few tests look at what follows; each message takes this process and the node some 0.5 ms.

    @functools.cached_property
    def energies(self) -> list[Float64MultiArray]:
        """The messages from the first use on."""
        found: list[Float64MultiArray] = []
        self.node.create_subscription(Float64MultiArray, "energies", found.append, 1000)
        return found

    @functools.cached_property
    def clocks(self) -> list[int]:
        """The times on /clock in ns from the first use on."""
        found: list[int] = []
        self.node.create_subscription(Clock, "/clock", lambda m: found.append(nanoseconds(m.clock)), 1000)
        return found

    def next_energies(self) -> list[float]:
        """Wait for a message of energies: its values."""
        seen = len(self.energies)
        self.until(lambda: len(self.energies) > seen, "energies")
        return list(self.energies[-1].data)

    @property
    def stall(self) -> float:
        """For how long, in s, this machine left the node or this process waiting at most: a gap between states."""
        gaps = np.diff(self.arrivals)
        return float(np.max(gaps) - np.median(gaps))

    def until(self, condition: Callable[[], Any], what: str) -> None:
        """Spin until a condition holds; fail where it does not within `PATIENCE`, or the process has ended."""
        wait_until(
            condition,
            what,
            meanwhile=lambda: self.executor.spin_once(timeout_sec=0.05),
            gone=lambda: self.process is not None and self.process.has_ended,
            report=lambda: self.process.text if self.process else "",
        )

    def repeats(self) -> bool:
        """Whether the last states are of one time.

        Two are not enough: a reset publishes the start state at the time of the last state.
        """
        stamps = [nanoseconds(state.header.stamp) for state in self.states[-3:]]
        return len(stamps) == 3 and len(set(stamps)) == 1

    def until_paused(self) -> int:
        """Wait until no more states are on their way: a paused node repeats its last one. Returns its time in ns."""
        self.until(self.repeats, "the pause")
        return nanoseconds(self.states[-1].header.stamp)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def ask(self, kind: type, name: str, **fields: Any) -> Any:
        """Call a service; returns the future of its answer, which is lost where the node ends too soon."""
        return self._client(kind, name).call_async(kind.Request(**fields))

    def call(self, kind: type, name: str, **fields: Any) -> Any:
        future = self.ask(kind, name, **fields)
        self.until(future.done, f"answer of {name}")
        return future.result()

    def _client(self, kind: type, name: str) -> Client:
        """A client that is kept, and that the node knows: before, it could not send an answer."""
        if (self.server, name) not in self._clients:
            self._clients[self.server, name] = self.node.create_client(kind, f"{self.server}/{name}")
            Listener.all_matched(self)
        client = self._clients[self.server, name]
        self.until(client.service_is_ready, f"service {name}")
        return client

    def reset(self) -> Any:
        return self.call(Trigger, "reset")

    def pause(self, paused: bool) -> Any:
        return self.call(SetBool, "pause", data=paused)

    def step(self) -> Any:
        return self.call(Trigger, "step")

    def set_parameter(self, name: str, value: Any) -> Any:
        message = Parameter(name=name, value=rclpy.parameter.get_parameter_value(str(value).lower()))
        return self.call(SetParameters, "set_parameters", parameters=[message]).results[0]

    def parameter(self, name: str) -> Any:
        return parameter_value_to_python(self.call(GetParameters, "get_parameters", names=[name]).values[0])

    def descriptor(self, name: str) -> Any:
        return self.call(DescribeParameters, "describe_parameters", names=[name]).descriptors[0]

    def all_matched(self) -> None:
        """Wait until the node knows all subscriptions and clients: discovery keeps their order, and this client is new.

        On a busy machine it may be asked before it knows the client: the answer is lost, and it is asked again.
        """
        client = self.node.create_client(ListParameters, f"{self.server}/list_parameters")
        self.until(client.service_is_ready, "service list_parameters")
        futures, asked = [client.call_async(ListParameters.Request())], time.monotonic()

        def answered() -> bool:
            if time.monotonic() > asked + LOST * len(futures):
                futures.append(client.call_async(ListParameters.Request()))
            return any(future.done() for future in futures)

        self.until(answered, "answer of list_parameters")
        self.node.destroy_client(client)

    def ready_to_command(self) -> None:
        """Wait until both command topics and the answer topics are matched."""
        self.until(lambda: self.by_order.get_subscription_count() and self.by_name.get_subscription_count(), "matching")
        self.all_matched()
        self.until(lambda: self.states, "joint states")

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


def as_in_the_node(mechanism: str | Path | Mechanism) -> Simulation:
    """The simulation that a node with default parameters runs, bit for bit."""
    loaded = mechanism if isinstance(mechanism, Mechanism) else load_mechanism(mechanism)
    live = next(declared.default for declared in PARAMETERS if declared.name == "live")
    names = names_with_matches(loaded, [name.strip() for name in live.split(",")])
    return Simulation(loaded, wrenches=tuple(loaded.parts), live=names)


def nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


@contextlib.contextmanager
def running(
    folder: Path,
    remaps: Sequence[str] = (),
    wrapper: Sequence[str] = (),
    variables: Mapping[str, str] | None = None,
    **parameters: Any,
) -> Iterator[tuple[SimNodeProcess, Listener]]:
    """A node, started by a wrapper that becomes it, with variables in its environment; and a listener to it."""
    domain = new_domain()
    process = SimNodeProcess(domain, folder, parameters, remaps, wrapper, variables)
    listener = Listener(domain)
    listener.process = process
    try:
        listener.until(lambda: listener.states, "the first joint state")
        yield process, listener
    finally:
        listener.close()
        process.kill()
