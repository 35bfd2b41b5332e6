"""The true world of mocks and benchmarks: exact geometry that shares no formula with twin and estimator."""

from rotary_error_monitor.plant.clocks import Clock, stage_clocks
from rotary_error_monitor.plant.environment import Forces, Push, TemperatureCourse, intermittent_forces
from rotary_error_monitor.plant.motion import Motion, MotionSegment, motion_in_use, random_motion, reversing_motion
from rotary_error_monitor.plant.scene import Fault, Scene
from rotary_error_monitor.plant.stage import StagePlant

__all__ = [
    "Clock",
    "Fault",
    "Forces",
    "Motion",
    "MotionSegment",
    "Push",
    "Scene",
    "StagePlant",
    "TemperatureCourse",
    "intermittent_forces",
    "motion_in_use",
    "random_motion",
    "reversing_motion",
    "stage_clocks",
]
