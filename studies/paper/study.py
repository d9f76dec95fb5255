"""The protocol of section 2.3 on a simulated robot, and the estimator against the model on sweeps held out.

    48 sweeps -> 36 to learn from, 12 held out whole -> Gaussian process | constant stiffness (Eq. 1, 20-21)

The worn robot has what the nominal one leaves out and no model below knows: friction in the sheaths and creep of the
wires. The same is done on the nominal robot, to see how much of the model's error those two make.
"""

from dataclasses import dataclass

import numpy as np

from exodrake.core.errors import InputError
from exodrake.estimator.dataset import Sweeps, sweeps_from_logs
from exodrake.estimator.gp import condition, learn
from exodrake.estimator.validate import Score, fit_ridge, score, validate
from exodrake.model.robot import Robot
from exodrake.physics.finger_statics import follow, posture, read_parameters
from exodrake.physics.tendon_finger import Parameters
from exodrake.simulation.protocols import sweeps as protocol
from exodrake.simulation.simulate import record, simulate, write_log
from studies.paper.claim import Effort
from studies.paper.stiffness import Stiffness, fit_stiffness, linear

MU_PHI = 0.15  # capstan friction, wrap times coefficient; [A] within `physics.md` 4.B
CREEP_STIFFNESS, CREEP_TIME = 8000.0, 10.0  # N/m, s; the initial values of the effect library
HELD_OUT = 12  # sweeps of the 48
FEW = 12  # sweeps up and down that are compared with all training sweeps while loading
FAST = 99.9  # percentile of the joint rates that counts as fastest
DATA, MODEL = "Gaussian process", "constant stiffness"


@dataclass(frozen=True)
class Comparison:
    """Errors on held-out sweeps."""

    rmse: dict[str, np.ndarray]  # (joints,) [rad] by method
    stiffness: Stiffness  # the fitted constant one
    solved: float  # fraction of rows in which that model has an equilibrium; its RMSE is over those rows


def compare(training: Sweeps, held_out: Sweeps, n: Parameters, estimate: np.ndarray) -> Comparison:
    """Fit every model on training sweeps, and compare an estimate and the models on held-out sweeps.

    Methods: Gaussian process, with its estimate (rows, 3) [rad]; quadratic ridge; constant stiffness (fitted, no end
    stops, Eq. 20-21: the paper's model-based estimate); end stops (fitted stiffness, known stops); nominal (nothing
    fitted). The models see tension only. InputError if wires or joints are not three, or differ between the two.
    """
    for sweeps in (training, held_out):
        if len(sweeps.wires) != 3 or len(sweeps.joints) != 3:
            raise InputError(
                f"the finger's statics have 3 wires and 3 joints, not {len(sweeps.wires)} and {len(sweeps.joints)}"
            )
    if (training.wires, training.joints) != (held_out.wires, held_out.joints):
        raise InputError("training and held-out sweeps differ in wires or joints")
    constant = fit_stiffness(training.tension, training.angle, linear(n), posture)
    stopped = fit_stiffness(training.tension, training.angle, n)
    guesses = {
        "Gaussian process": estimate,
        "quadratic ridge": fit_ridge(training)(held_out)[0],
        "constant stiffness": posture(held_out.tension, constant.parameters(linear(n))),
        "end stops": follow(held_out.tension, stopped.parameters(n)),
        "nominal": follow(held_out.tension, n),
    }
    solved = np.isfinite(guesses["constant stiffness"]).all(axis=1)
    rmse = {name: np.sqrt(np.nanmean((guess - held_out.angle) ** 2, axis=0)) for name, guess in guesses.items()}
    return Comparison(rmse, constant, float(np.mean(solved)))


@dataclass(frozen=True, eq=False)
class Study:
    """Results on the worn robot, and the comparison on the clean one."""

    held: Sweeps  # rows of the held-out sweeps
    mean: np.ndarray  # (n, 3) angles predicted by the estimator [rad]
    std: np.ndarray  # their standard deviations
    model: np.ndarray  # (n, 3) angles predicted by constant stiffness [rad]
    worn: Comparison
    clean: Comparison
    scores: tuple[Score, ...]  # of all methods
    recorded: tuple[Score, ...]  # of the estimator by the sweeps that it was trained on
    rate: float  # fastest one of a joint [rad/s]
    seconds: float  # of the protocol [s]
    sweeps: int
    points: int  # of training

    def error(self, method: str) -> float:
        """RMSE [rad] on held-out sweeps, mean over the joints, worn robot."""
        return float(self.worn.rmse[method].mean())

    @property
    def ratio(self) -> float:
        """Ratio of the model's error to the estimator's."""
        return self.error(MODEL) / self.error(DATA)

    @property
    def clean_ratio(self) -> float:
        """Ratio of the model's error to the estimator's, on the robot without friction and creep."""
        return float(self.clean.rmse[MODEL].mean() / self.clean.rmse[DATA].mean())

    def split(self, name: str, method: str = DATA) -> Score:
        """Score of a method under a split (`validate.RANDOM`, `validate.HELD_OUT`)."""
        return next(score for score in self.scores if (score.split, score.method) == (name, method))


def thinned(sweeps: Sweeps, every: int) -> Sweeps:
    """One in so many rows."""
    return sweeps.rows(np.arange(0, len(sweeps), every))


def parted(sweeps: Sweeps, seed: int) -> tuple[Sweeps, Sweeps]:
    """Sweeps to learn from and whole sweeps held out, dealt by seed."""
    held = np.random.default_rng(seed).permutation(np.unique(sweeps.sweep))[:HELD_OUT]
    chosen = np.isin(sweeps.sweep, held)
    return sweeps.rows(~chosen), sweeps.rows(chosen)


def study(robot: Robot, effort: Effort, seed: int) -> Study:
    """Simulate, learn, judge. robot: the nominal one."""
    parameters, reference = read_parameters(robot), protocol(robot)
    worn_robot = robot.splice("tendon.capstan_friction", {"mu_phi": MU_PHI})
    worn_robot = worn_robot.splice("tendon.creep", {"stiffness": CREEP_STIFFNESS, "time_constant": CREEP_TIME})
    recording = record(worn_robot, reference, seed)
    rows = thinned(sweeps_from_logs([write_log(recording)]), effort.every)
    training, held = parted(rows, seed)
    prior = learn(training, effort.points)
    mean, std, _ = condition(prior, training, effort.points).predict(held.tension, held.stroke)
    labels = np.unique(training.sweep)
    choices = {
        f"{len(labels)} up and down": training,
        f"{FEW} up and down": training.rows(np.isin(training.sweep, labels[:: len(labels) // FEW][:FEW])),
        f"{len(labels)} loading only": training.rows(loading(training)),
    }
    recorded = []
    for name, part in choices.items():
        found = condition(learn(part, effort.clean_points), part, effort.clean_points)
        recorded.append(score(name, "held-out sweeps", held.angle, *found.predict(held.tension, held.stroke)[:2]))
    worn = compare(training, held, parameters, mean)
    return Study(
        held, mean, std, posture(held.tension, worn.stiffness.parameters(linear(parameters))), worn,
        clean_comparison(robot, reference, effort, seed), validate(prior, rows, effort.points, seed),
        tuple(recorded),
        float(np.percentile(np.abs(recording.signals["rate"]), FAST)), float(recording.time[-1] + robot.machine.frame),
        rows.count, effort.points,
    )  # fmt: skip


def loading(sweeps: Sweeps) -> np.ndarray:
    """Mask (rows,) of the rows up to the largest tension of the wire that is swept."""
    mask = np.zeros(len(sweeps), dtype=bool)
    for label in np.unique(sweeps.sweep):
        rows = np.flatnonzero(sweeps.sweep == label)
        tension = sweeps.tension[rows]
        wire = int(np.argmax(np.ptp(tension, axis=0)))
        mask[rows[: int(np.argmax(tension[:, wire])) + 1]] = True
    return mask


def clean_comparison(robot: Robot, reference, effort: Effort, seed: int) -> Comparison:
    """Comparison on the same sweeps with the same split, without friction and creep."""
    rows = thinned(sweeps_from_logs([simulate(robot, reference, seed)]), effort.every)
    training, held = parted(rows, seed)
    process = condition(learn(training, effort.clean_points), training, effort.clean_points)
    estimate = process.predict(held.tension, held.stroke)[0]
    return compare(training, held, read_parameters(robot), estimate)
