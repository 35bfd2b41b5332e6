"""Asks a running LinuxCNC for its own kinematics; a program for the system's Python, used by the tests beside it.

Reads poses from standard input, one JSON list of joint positions (mm, deg) a line. The joints' feedback is set to each
while the machine is off, and LinuxCNC's forward kinematics say where that puts the tool.
"""

import json
import sys
import time

import hal
import linuxcnc

LETTERS = (0, 1, 2, 3, 5)  # X Y Z A C among the nine axes


def main() -> None:
    component = hal.component("oracle")
    component.ready()
    status = linuxcnc.stat()
    try:
        for line in sys.stdin:
            joints = json.loads(line)
            for index, position in enumerate(joints):
                hal.set_p(f"joint.{index}.motor-pos-fb", repr(position))
            print(json.dumps(tool_position(status, joints)), flush=True)
    finally:
        component.exit()


def tool_position(status, joints):
    """Where LinuxCNC says the tool is, once it has seen all joints at `joints` and computed twice from them."""
    previous = None
    deadline = time.monotonic() + 5.0
    while time.monotonic() < deadline:
        status.poll()
        seen = list(status.joint_actual_position[: len(joints)])
        tool = [status.actual_position[letter] for letter in LETTERS]
        if all(abs(a - b) < 1e-12 for a, b in zip(seen, joints, strict=True)) and tool == previous:
            return tool
        previous = tool
        time.sleep(0.0015)
    raise TimeoutError(f"LinuxCNC does not see its joints at {joints}; it sees {seen}")


if __name__ == "__main__":
    main()
