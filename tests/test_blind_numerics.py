"""The reference simulator's integrator against scipy's Radau."""

import numpy as np

from exodrake.reference.dynamics import INPUT_SIZE, STATE_SIZE, derivative
from exodrake.reference.robot import InjectedFault, RobotSpec
from exodrake.reference.simulator import TOLERANCE, advance, assemble, initial_state


def test_integrator_agrees_with_radau():
    from scipy.integrate import solve_ivp

    effects = (
        InjectedFault("tendon.capstan_friction", parameters={"mu_phi": 0.3}),
        InjectedFault("tendon.creep", parameters={"stiffness": 6000.0, "time_constant": 5.0}),
        InjectedFault("tendon.compliance", parameters={"stiffness": 2000.0}),
        InjectedFault("finger.viscoelasticity", parameters={"fraction": 0.3, "time_constant": 2.0}),
    )
    build = assemble(RobotSpec(effects=effects, noisy=False), 10, None)
    command = np.array([0.05, 0.02, 0.01])
    y = initial_state(build.record)
    scratch = np.zeros(INPUT_SIZE), np.zeros(3), np.zeros((3, 3))

    def slope(time, state):
        rate = np.zeros(STATE_SIZE)
        derivative(time, state, rate, build.record, command, build.inputs, *scratch)
        return rate

    wanted = solve_ivp(slope, (0.0, 0.1), y, method="Radau", rtol=1e-7, atol=1e-9).y[:, -1]
    work = np.zeros((6, STATE_SIZE)), *scratch
    assert advance(0.0, 0.1, y, 1e-4, build.record, command, build.inputs, TOLERANCE, work) > 0
    assert np.all(np.abs(y - wanted) < 10 * (TOLERANCE + 1e-3 * np.abs(wanted)))
