"""exodrake: simulate a tendon-driven robot and explain how far, where and why it differs from the real one.

`import exodrake as exo` stays light: every public name is looked up, and its module imported, at first use.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# public name -> module that defines it
PUBLIC = {
    "InputError": "exodrake.errors",
    "Log": "exodrake.log",
    "read_log": "exodrake.log",
    "write_log": "exodrake.log",
    "regularise": "exodrake.clock",
    "Case": "exodrake.case",
    "CaseLog": "exodrake.case",
    "read_case": "exodrake.case",
    "write_case": "exodrake.case",
    "Robot": "exodrake.diagrams.robot",
    "load_robot": "exodrake.diagrams.robot_file",
    "write_robot": "exodrake.diagrams.robot_file",
    "Reference": "exodrake.diagrams.simulate",
    "Recording": "exodrake.diagrams.simulate",
    "record": "exodrake.diagrams.simulate",
    "simulate": "exodrake.diagrams.simulate",
    "analyse": "exodrake.analysis.closed_loop",
    "ClosedLoop": "exodrake.analysis.closed_loop",
    "diagnose": "exodrake.diagnosis.pipeline",
    "Diagnosis": "exodrake.diagnosis.result",
    "grasp": "exodrake.identification.protocols",
    "sweeps": "exodrake.identification.protocols",
    "short_sweeps": "exodrake.identification.protocols",
    "chirp": "exodrake.identification.protocols",
    "holds": "exodrake.identification.protocols",
    "steps": "exodrake.identification.protocols",
    "multisine": "exodrake.identification.protocols",
    "random_motion": "exodrake.identification.protocols",
    "plan_grasp": "exodrake.grasping.plan",
    "protocol": "exodrake.identification.asked",
    "from_log": "exodrake.identification.asked",
    "build_diagram": "exodrake.diagrams.drake",
    "TendonFinger": "exodrake.diagrams.drake_parts",
    "MotorDynamics": "exodrake.diagrams.drake_parts",
    "TensionSensor": "exodrake.diagrams.drake_parts",
    "Encoder": "exodrake.diagrams.drake_parts",
    "MotionCapture": "exodrake.diagrams.drake_parts",
    "AdmittanceController": "exodrake.diagrams.drake_parts",
    "MotorBus": "exodrake.diagrams.drake_parts",
    "GPEstimator": "exodrake.diagrams.drake_estimator",
    "wiring_svg": "exodrake.diagrams.draw",
}


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'exodrake' has no attribute {name!r}")
    value = getattr(import_module(PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(PUBLIC))
