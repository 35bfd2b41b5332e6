"""LinuxCNC as the machine's controller: its kinematics, external offsets, the link to it, a headless instance of it.

This room needs nothing but the standard library, because the link runs under the system's Python, for which LinuxCNC's
own modules are built.
"""
