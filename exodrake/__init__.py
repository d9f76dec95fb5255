"""exodrake: simulate a tendon-driven robot and explain how far, where and why it differs from the real one.

`import exodrake as exo` stays light: every public name is looked up, and its module imported, at first use.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# public name -> module that defines it
PUBLIC = {
    "InputError": "exodrake.core.errors",
    "Log": "exodrake.data.log",
    "read_log": "exodrake.data.log_file",
    "write_log": "exodrake.data.log_file",
    "regularise": "exodrake.data.clock",
    "Case": "exodrake.data.case",
    "CaseLog": "exodrake.data.case",
    "read_case": "exodrake.data.case_folder",
    "write_case": "exodrake.data.case_folder",
    "Robot": "exodrake.core.robot",
    "load_robot": "exodrake.machines.robot_file",
    "write_robot": "exodrake.machines.robot_file",
    "Reference": "exodrake.compiled.inputs",
    "Recording": "exodrake.simulation.simulate",
    "record": "exodrake.simulation.simulate",
    "simulate": "exodrake.simulation.simulate",
    "analyse": "exodrake.analysis.closed_loop",
    "ClosedLoop": "exodrake.analysis.closed_loop",
    "diagnose": "exodrake.diagnosis.pipeline",
    "Diagnosis": "exodrake.diagnosis.result",
    "grasp": "exodrake.simulation.protocols",
    "sweeps": "exodrake.simulation.protocols",
    "short_sweeps": "exodrake.simulation.protocols",
    "chirp": "exodrake.simulation.protocols",
    "holds": "exodrake.simulation.protocols",
    "steps": "exodrake.simulation.protocols",
    "multisine": "exodrake.simulation.protocols",
    "random_motion": "exodrake.simulation.protocols",
    "plan_grasp": "exodrake.grasping.plan",
    "protocol": "exodrake.simulation.references",
    "from_log": "exodrake.simulation.references",
    "build_diagram": "exodrake.diagrams.diagram",
    "TendonFinger": "exodrake.diagrams.parts",
    "MotorDynamics": "exodrake.diagrams.parts",
    "TensionSensor": "exodrake.diagrams.parts",
    "Encoder": "exodrake.diagrams.parts",
    "MotionCapture": "exodrake.diagrams.parts",
    "AdmittanceController": "exodrake.diagrams.parts",
    "MotorBus": "exodrake.diagrams.parts",
    "GPEstimator": "exodrake.diagrams.gp_estimator",
    "wiring_svg": "exodrake.diagrams.block_diagram",
}


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'exodrake' has no attribute {name!r}")
    value = getattr(import_module(PUBLIC[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(PUBLIC))
