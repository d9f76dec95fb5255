"""The finger in Meshcat, shown by the Diagram itself while it runs.

meshcat = Meshcat()
diagram = build_diagram(robot, reference, systems=[FingerView(robot, meshcat)])
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Cylinder,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    MakePhongIllustrationProperties,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Role,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem

from exodrake.core.robot import Robot
from exodrake.core.skeleton import Piece, Skeleton
from exodrake.diagrams.meshcat.scene import along, draw_ground, finger_skeleton, pose, span, turn

BONE, TENDON, ROUTER, SKIN = 0.0018, 0.0008, 0.0012, 0.20  # radii [m] and opacity of the skin
LINKS, OVERLAP = 5, 1.1  # rods that slide over each other make a piece of tendon over a joint, whose length changes
GREY, DARK, STEEL = (0.85, 0.82, 0.76), (0.25, 0.27, 0.30), (0.30, 0.45, 0.65)


class FingerView(Diagram):
    """Finger and tendons in a SceneGraph, shown in Meshcat.

    .. pydrake_system::

        name: FingerView
        input_ports:
        - angle
        output_ports:
        - query

    angle [rad] per joint. Tendons are drawn straight between their routers. `scene_graph` is the SceneGraph.

    Raises:
        InputError: the robot has no finger.
    """

    def __init__(self, robot: Robot, meshcat: Meshcat, rate: float = 32.0) -> None:
        """Takes the robot, a Meshcat, and pictures per simulated second."""
        super().__init__()
        draw_ground(meshcat)
        builder = DiagramBuilder()
        self.scene_graph = SceneGraph()
        poses = FingerPoses(finger_skeleton(robot), self.scene_graph)
        builder.AddNamedSystem("scene_graph", self.scene_graph)
        builder.AddNamedSystem("poses", poses)
        source = self.scene_graph.get_source_pose_port(poses.source)
        builder.Connect(poses.get_output_port(), source)
        parameters = MeshcatVisualizerParams(
            role=Role.kIllustration, publish_period=1.0 / rate, prefix=robot.machine.name
        )
        MeshcatVisualizer.AddToBuilder(builder, self.scene_graph, meshcat, parameters)
        builder.ExportInput(poses.get_input_port(), "angle")
        builder.ExportOutput(self.scene_graph.get_query_output_port(), "query")
        builder.BuildInto(self)
        self.set_name("view")


class FingerPoses(LeafSystem):
    """Poses of phalanges and tendons.

    .. pydrake_system::

        name: FingerPoses
        input_ports:
        - angle
        output_ports:
        - pose
    """

    def __init__(self, bones: Skeleton, scene_graph: SceneGraph) -> None:
        """Takes the geometry, which it registers with the SceneGraph."""
        super().__init__()
        self.bones, self.source = bones, scene_graph.RegisterSource("finger")
        self.frames: list[FrameId] = [self._frame(scene_graph, name) for name in bones.joints]
        self.pieces = [piece for piece in bones.pieces if piece.first != piece.last]
        self.links: list[list[FrameId]] = [self._links(scene_graph, piece) for piece in self.pieces]
        self._draw_bones(scene_graph)
        self.DeclareVectorInputPort("angle", len(bones.joints))
        empty = partial(AbstractValue.Make, FramePoseVector())
        self.DeclareAbstractOutputPort("pose", empty, self._poses, {self.all_input_ports_ticket()})

    def _frame(self, scene_graph: SceneGraph, name: str) -> FrameId:
        """A moving frame of the world."""
        return scene_graph.RegisterFrame(self.source, GeometryFrame(name))

    def _links(self, scene_graph: SceneGraph, piece: Piece) -> list[FrameId]:
        """Rods of a piece of tendon over a joint."""
        found = []
        for k in range(LINKS):
            name = f"{piece.tendon}_{piece.name}_{k}"
            found.append(self._frame(scene_graph, name))
            self._add(scene_graph, found[-1], name, Cylinder(TENDON, self._rod(piece)), RigidTransform(), STEEL)
        return found

    def _rod(self, piece: Piece) -> float:
        """Length of a rod [m]: they overlap a little where the piece is longest, straight or fully flexed."""
        joints = len(self.bones.joints)
        lengths = [along(*span(self.bones, piece, np.full(joints, angle)))[2] for angle in (0.0, 0.5 * np.pi)]
        return OVERLAP * max(lengths) / LINKS

    def _draw_bones(self, scene_graph: SceneGraph) -> None:
        """Hand, phalanges, routers, and the pieces of tendons that stay on one of them."""
        bones = self.bones
        ends = [(bones.base, 0.0), *((0.0, length) for length in bones.lengths)]
        radii = [bones.radii[0], *bones.radii]
        for segment, ((start, stop), radius) in enumerate(zip(ends, radii, strict=True)):
            middle, rotation, length = along(np.array([start, 0.0, 0.0]), np.array([stop, 0.0, 0.0]))
            for name, size, colour, opacity in (("bone", BONE, GREY, 1.0), ("skin", radius, GREY, SKIN)):
                where = pose(middle, rotation)
                self._add(
                    scene_graph, self._on(segment), f"{name}_{segment}", Cylinder(size, length), where, colour, opacity
                )
        for k, (segment, point) in enumerate(bones.guides):
            self._add(scene_graph, self._on(segment), f"router_{k}", Sphere(ROUTER), pose(point), DARK)
        for k, piece in enumerate(piece for piece in bones.pieces if piece.first == piece.last):
            middle, rotation, length = along(piece.start, piece.end)
            name = f"{piece.tendon}_{piece.name}_{k}"
            self._add(scene_graph, self._on(piece.first), name, Cylinder(TENDON, length), pose(middle, rotation), STEEL)

    def _on(self, segment: int) -> FrameId | None:
        """Frame of a segment; None: the hand, which stands still."""
        return self.frames[segment - 1] if segment else None

    def _add(
        self,
        scene_graph: SceneGraph,
        frame: FrameId | None,
        name: str,
        shape: Shape,
        where: RigidTransform,
        colour: tuple[float, float, float],
        opacity: float = 1.0,
    ) -> None:
        """Registers a shape on a frame."""
        instance = GeometryInstance(where, shape, name)
        instance.set_illustration_properties(MakePhongIllustrationProperties(np.array([*colour, opacity])))
        if frame is None:
            scene_graph.RegisterAnchoredGeometry(self.source, instance)
        else:
            scene_graph.RegisterGeometry(self.source, frame, instance)

    def _poses(self, context: Any, value: Any) -> None:
        """Fills the output port."""
        angle = np.array(self.EvalVectorInput(context, 0).value())
        found, segments = FramePoseVector(), [RigidTransform()]
        for i, frame in enumerate(self.frames):
            start = np.array([self.bones.lengths[i - 1] if i else 0.0, 0.0, 0.0])
            segments.append(segments[-1] @ pose(start, turn(angle[i])))
            found.set_value(frame, segments[-1])
        for piece, links in zip(self.pieces, self.links, strict=True):
            start, end = span(self.bones, piece, angle)
            rotation, rod = along(start, end)[1], (end - start) / np.linalg.norm(end - start)
            half = 0.5 * self._rod(piece) * rod
            for k, frame in enumerate(links):
                middle = start + half + k / (LINKS - 1) * (end - start - 2.0 * half)
                found.set_value(frame, segments[piece.first] @ pose(middle, rotation))
        value.set_value(found)
