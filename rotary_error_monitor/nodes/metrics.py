"""What `/diagnostics` says, as metrics for Prometheus: levels and figures of every node, on an address of your choice.

ros2 run rotary_error_monitor metrics --ros-args -p port:=9464
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.diagnostics import Condition, Level
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import program

PREFIX = "rotary_error_monitor"
_STALE_AFTER = 5.0
"""s after which a status is left out: five reports that did not come. Absence is what Prometheus alarms on."""


@dataclass(frozen=True)
class _Status:
    """A status as it was heard: when (s, of a clock that never steps), its level, its figures that are numbers."""

    heard: float
    level: int
    hardware: str
    figures: dict[str, float]


class Statuses:
    """The latest statuses by name, as a collector of metrics (`prometheus_client`, "Custom Collectors")."""

    def __init__(self, library: ModuleType, now: Callable[[], float] = time.monotonic) -> None:
        """Collector for the library's metrics module, `prometheus_client.core`."""
        self._library = library
        self._now = now
        self._latest: dict[str, _Status] = {}

    def note(self, message: DiagnosticArray) -> None:
        """Take note of a message of `/diagnostics`."""
        latest = {}
        for status in message.status:
            told = {each.key: number(each.value) for each in status.values}
            figures = {key: value for key, value in told.items() if value is not None}
            latest[status.name] = _Status(self._now(), status.level[0], status.hardware_id, figures)
        self._latest = dict(self._fresh()) | latest  # a new one: the server's threads read meanwhile

    def __len__(self) -> int:
        """How many statuses are no older than they may be."""
        return sum(1 for _ in self._fresh())

    def collect(self) -> Iterator[Any]:
        """Families of metrics: level of each status, and its figures."""
        family = self._library.GaugeMetricFamily
        levels = family(f"{PREFIX}_level", "0 well, 1 warning, 2 error, 3 stale", labels=("node", "part", "hardware"))
        figures = family(f"{PREFIX}_figure", "Figures of a status, unit in the name", labels=("node", "part", "figure"))
        for name, status in self._fresh():
            node, _, part = name.partition(": ")
            levels.add_metric((node, part, status.hardware), status.level)
            for key, value in status.figures.items():
                figures.add_metric((node, part, key), value)
        yield from (levels, figures)

    def _fresh(self) -> Iterator[tuple[str, _Status]]:
        oldest = self._now() - _STALE_AFTER
        return ((name, status) for name, status in sorted(self._latest.items()) if status.heard >= oldest)


def number(text: str) -> float | None:
    """The number that a figure's text is; True and False are 1 and 0. None where it is none."""
    if text in ("True", "False", "true", "false"):
        return float(text in ("True", "true"))
    try:
        return float(text)
    except ValueError:
        return None


class Metrics(ManagedNode):
    """Serves what it hears on `/diagnostics`, of every node in the domain, over HTTP."""

    settings = (
        Setting("address", "127.0.0.1", "address of this computer on which metrics are served; 0.0.0.0 for all of its"),
        Setting("port", 9464, "port on which metrics are served", (1024, 65535)),
    )

    def open(self) -> None:
        """Listen to the diagnostics and serve what they say."""
        try:
            import prometheus_client
            from prometheus_client import core
        except ImportError:
            raise InputError(
                "metrics need the package prometheus-client: pip install 'rotary_error_monitor[metrics]'"
            ) from None
        self._statuses = Statuses(core)
        registry = prometheus_client.CollectorRegistry(auto_describe=False)
        registry.register(self._statuses)
        address, port = self.setting("address"), self.setting("port")
        try:
            self._server, self._thread = prometheus_client.start_http_server(port, address, registry)
        except OSError as error:
            raise InputError(
                f"{self.get_fully_qualified_name()}: nothing can be served on {address}:{port} ({error}); "
                "another program has the port, or the address is none of this computer's: set port or address"
            ) from error
        self.listen_to(self.wire.topic("diagnostics"), self._statuses.note)
        self.get_logger().info(f"metrics on http://{address}:{port}/metrics")

    def release(self) -> None:
        """Serve no longer."""
        server = self.__dict__.pop("_server", None)
        if server is not None:
            server.shutdown()
            server.server_close()
            self._thread.join()

    def conditions(self, now_ns: int) -> list[Condition]:
        """What is served."""
        figures = {"address": self.setting("address"), "port": self.setting("port"), "statuses": len(self._statuses)}
        return [Condition("server", Level.OK, "serving", figures)]


main = program(Metrics, "metrics")

if __name__ == "__main__":
    raise SystemExit(main())
