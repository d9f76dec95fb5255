"""Arms from URDF files that several tests share, and machine folders made of them."""

from pathlib import Path

import numpy as np
from command_line import run

import exodrake as exo
from exodrake.cli.new_machine import ARM_SCAFFOLD

CABLE = ARM_SCAFFOLD / "cable_arm.urdf"
LINK = '<link name="{0}"><inertial>{1}<mass value="{2}"/><inertia {3}/></inertial></link>'
TENSOR = 'ixx="{}" ixy="0.001" ixz="-0.002" iyy="{}" iyz="0.0015" izz="{}"'
# all kinds of joints, a plate that is welded on, tilted frames, an axis that is no unit vector
MIXED = "".join([
    '<robot name="mixed"><link name="base"/>',
    LINK.format("a", '<origin xyz="0.1 0.02 -0.2" rpy="0.3 0.2 -0.5"/>', 2.0, TENSOR.format(0.03, 0.025, 0.02)),
    LINK.format("plate", '<origin xyz="0 0.1 0" rpy="1 0 0"/>', 0.7, TENSOR.format(0.013, 0.014, 0.015)),
    LINK.format("b", '<origin xyz="0 0 -0.15"/>', 1.0, TENSOR.format(0.02, 0.03, 0.02)),
    LINK.format("c", '<origin xyz="0.02 0.03 -0.15"/>', 0.5, TENSOR.format(0.02, 0.02, 0.01)),
    '<joint name="turn-table" type="continuous"><parent link="base"/><child link="a"/>'
    '<origin xyz="0.1 0 0.3" rpy="0.1 -0.4 0.9"/><axis xyz="1 2 3"/></joint>',
    '<joint name="weld" type="fixed"><parent link="a"/><child link="plate"/>'
    '<origin xyz="0.2 0.1 -0.1" rpy="0.5 1.2 0.3"/></joint>',
    '<joint name="lift_2" type="prismatic"><parent link="plate"/><child link="b"/><origin xyz="0 0 -0.4"/>'
    '<axis xyz="0 0.6 0.8"/><limit lower="-0.1" upper="0.4" effort="100" velocity="1"/></joint>',
    '<joint name="3" type="revolute"><parent link="b"/><child link="c"/>'
    '<origin xyz="0.1 0 0" rpy="0 1.5707963267949 0"/>'
    '<axis xyz="0 0 -1"/><limit lower="-1" upper="2" effort="100" velocity="1"/></joint><link name="tool"/>',
    '<joint name="grip" type="fixed"><parent link="c"/><child link="tool"/><origin xyz="0.1 0 -0.3"/></joint></robot>',
])  # fmt: skip

# a bob of 1 kg on a rod [m], with its inertia about its centre [kg m2]
PENDULUM = """<robot name="p"><link name="base"/>
<link name="bob"><inertial><origin xyz="0 0 -{0}"/><mass value="1"/><inertia ixx="{1}" iyy="{1}" izz="{1}"/>
</inertial></link>
<joint name="pin" type="revolute"><axis xyz="0 1 0"/><parent link="base"/><child link="bob"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def made(folder: Path, name: str, *options: str) -> exo.Robot:
    """The robot of a machine that the command makes."""
    result = run("new-machine", folder / name, *options)
    assert result.exit_code == 0, result.output
    exo.add_plugin(folder / name)
    return exo.load_robot(name)


def plant_of(path, payload=0.0, tip="tool"):
    """The arm as Drake's parser reads it, with a point mass welded to its tip [kg]."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import SpatialInertia, UnitInertia, default_model_instance

    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(path))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    if payload:
        point = SpatialInertia(payload, np.zeros(3), UnitInertia(1e-12, 1e-12, 1e-12))
        body = plant.AddRigidBody("payload", default_model_instance(), point)
        plant.WeldFrames(plant.GetFrameByName(tip), body.body_frame())
    plant.Finalize()
    return plant
