"""One read head of the rotary encoder.

ros2 run rotary_error_monitor encoder_head --ros-args -r __node:=encoder_head_b -p source:=mock
ros2 run rotary_error_monitor encoder_head --ros-args -p head:=a -p source:=joint_state
"""

from __future__ import annotations

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.sensor import SensorNode

NAME = "encoder_head"


class EncoderHead(SensorNode):
    """Publishes the readings of one head as sample blocks, and as a joint state for people."""

    kind = NAME
    settings = (
        Setting(
            "head",
            "",
            "letter of the head in the stage description; empty takes it from the node's name, encoder_head_a",
        ),
    )

    def topics(self) -> tuple[Topic, Topic]:
        """Those of this head."""
        head = self.head()
        return self.wire.topic("head_samples", head), self.wire.topic("head_joint_states", head)

    def head(self) -> str:
        """Letter of this head, by its parameter or by the name of the node.

        Raises:
            InputError: the stage has no such head, or no encoder at all.
        """
        if self.stage.encoder is None:
            raise InputError(f"{self.setting('stage') or 'stage.yaml'}: the stage has no section 'encoder'")
        head = str(self.setting("head") or self.get_name().removeprefix(f"{NAME}_"))
        if head not in self.stage.azimuths:
            raise InputError(
                f"{self.get_fully_qualified_name()}: parameter 'head' is {head!r}; the stage has the heads "
                f"{', '.join(self.stage.azimuths)} (or name the node {NAME}_<head>)"
            )
        return head


main = program(EncoderHead, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
