"""Public names, for type checkers and for `__init__`, which imports each at first use."""

from exodrake.analysis.closed_loop import ClosedLoop as ClosedLoop, analyse as analyse
from exodrake.analysis.log_response import frequency_response as frequency_response
from exodrake.analysis.sweep import sweep as sweep
from exodrake.analysis.tuning import Requirements as Requirements, Tuning as Tuning, tune as tune
from exodrake.core.errors import InputError as InputError
from exodrake.core.plain import save as save, to_dict as to_dict
from exodrake.core.plugins import add_plugin as add_plugin
from exodrake.data.case import Case as Case, CaseLog as CaseLog, read_case as read_case, write_case as write_case
from exodrake.data.formats import read_log as read_log, write_log as write_log
from exodrake.data.log import Comparison as Comparison, Log as Log, compare as compare, regularise as regularise
from exodrake.diagnosis.pipeline import diagnose as diagnose
from exodrake.diagnosis.result import Diagnosis as Diagnosis
from exodrake.diagrams.block_diagram import wiring_svg as wiring_svg
from exodrake.diagrams.diagram import (
    build_diagram as build_diagram,
    find_parameter as find_parameter,
    logged_signals as logged_signals,
    set_parameters as set_parameters,
)
from exodrake.diagrams.exo_index import add_exo_index as add_exo_index
from exodrake.diagrams.meshcat import FingerView as FingerView
from exodrake.diagrams.multibody import MultibodyFinger as MultibodyFinger
from exodrake.engine.inputs import Reference as Reference
from exodrake.grasping.plan import plan_grasp as plan_grasp, posture_controller as posture_controller
from exodrake.identification.fit import fit as fit
from exodrake.identification.statics import find_maximum_tension as find_maximum_tension
from exodrake.machines.export import export_robot as export_robot
from exodrake.machines.robot_file import load_robot as load_robot, write_robot as write_robot
from exodrake.model.machine import Machine as Machine
from exodrake.model.robot import Robot as Robot
from exodrake.simulation.protocols import (
    chirp as chirp,
    from_log as from_log,
    grasp as grasp,
    holds as holds,
    maximum_tension as maximum_tension,
    multisine as multisine,
    protocol as protocol,
    random_motion as random_motion,
    short_sweeps as short_sweeps,
    steps as steps,
    sweeps as sweeps,
)
from exodrake.simulation.simulate import (
    Recording as Recording,
    diagram_log as diagram_log,
    record as record,
    simulate as simulate,
)
from exodrake.systems.admittance_controller import AdmittanceController as AdmittanceController
from exodrake.systems.bus import Bus as Bus
from exodrake.systems.encoder import Encoder as Encoder
from exodrake.systems.gp_estimator import GPEstimator as GPEstimator
from exodrake.systems.motion_capture import MotionCapture as MotionCapture
from exodrake.systems.motor import MotorDynamics as MotorDynamics
from exodrake.systems.part import MachinePart as MachinePart
from exodrake.systems.posture_controller import PostureController as PostureController
from exodrake.systems.sources import Noise as Noise, Playback as Playback
from exodrake.systems.tendon_finger import TendonFinger as TendonFinger
from exodrake.systems.tension_sensor import TensionSensor as TensionSensor

__version__: str
PUBLIC: dict[str, str]
