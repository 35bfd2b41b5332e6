"""Sends a running LinuxCNC to positions and tells its motor positions; a program for the system's Python.

Reads one JSON list of positions of joint 0 (mm) from standard input, moves there one after the other, and prints for
each the commanded position of the joint and that of the motor, as JSON. Used by the tests beside it.
"""

import json
import sys
import time

import hal
import linuxcnc

PATIENCE = 20.0


def main():
    component = hal.component("motor_reader")
    component.ready()
    command, status = linuxcnc.command(), linuxcnc.stat()
    try:
        command.state(linuxcnc.STATE_ESTOP_RESET)
        command.wait_complete(PATIENCE)
        command.state(linuxcnc.STATE_ON)
        command.wait_complete(PATIENCE)
        for joint in range(5):
            command.home(joint)
            wait(lambda joint=joint: status_of(status).joint[joint]["homed"], f"joint {joint} to be homed")
        command.mode(linuxcnc.MODE_MDI)
        command.wait_complete(PATIENCE)
        rows = [reading(command, status, target) for target in json.loads(sys.stdin.read())]
    finally:
        component.exit()
    print(json.dumps(rows))


def reading(command, status, target):
    command.mdi(f"G53 G0 X{target:.9f}")
    command.wait_complete(PATIENCE)

    def arrived():
        return status_of(status).inpos and abs(hal.get_value("joint.0.pos-cmd") - target) < 1e-7

    wait(arrived, f"X {target}")
    # Compensation follows the joint with its own acceleration: take the motor's position when it stands.
    previous, same = None, 0
    end = time.monotonic() + PATIENCE
    while same < 20 and time.monotonic() < end:
        motor = hal.get_value("joint.0.motor-pos-cmd")
        same = same + 1 if motor == previous else 0
        previous = motor
        time.sleep(0.003)
    return [hal.get_value("joint.0.pos-cmd"), previous]


def status_of(status):
    status.poll()
    return status


def wait(condition, what):
    end = time.monotonic() + PATIENCE
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"LinuxCNC took too long for {what}")
        time.sleep(0.002)


if __name__ == "__main__":
    main()
