"""Rewrites what the harness adds to shapes (displacement, motion, textures) into what Mitsuba understands."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from harness.reference.displaced import become_mesh
from harness.reference.lights import needs_even_sampling, properties
from harness.reference.motion import moving_id
from harness.scene import Scene, Shape
from harness.scene.frame import frame_of, framed
from harness.scene.motion import moving, screw
from harness.scene.procedural import KINDS


def expand_shapes(mi: Any, state: Any, scene: Scene) -> None:
    """Edit the parser state of `scene`'s file in place, before Mitsuba transforms and instantiates it.

    Shapes that move while the shutter is open rest, under an id by which `MovingShapes` finds them; those of which it
    sees a single moment are put where they are then.
    """
    opens, _ = scene.camera.shutter
    moves = moving(scene)
    for number, (index, shape) in enumerate(zip(list(_shape_nodes(mi, state)), scene.shapes, strict=True)):
        props = state.nodes[index].props
        if "motion" in props:
            del props["motion"]
        if shape.displacement is not None:
            become_mesh(mi, props, shape)
        to_object = np.linalg.inv(shape.matrix)
        if number in moves:
            props.set_id(moving_id(number))
        elif shape.motion is not None:
            pose = screw(shape.motion).pose(opens)
            _carry(mi, props, pose)
            to_object = to_object @ np.linalg.inv(pose)
        _place_textures(mi, state, index, to_object, moves=number in moves)
        if needs_even_sampling(shape):
            _wrap_light(mi, state, index, shape, to_object, moves=number in moves)


def move_to_frame(mi: Any, state: Any, scene: Scene) -> None:
    """Edit the parser state of `scene`'s file in place: shapes and sensor go into its frame (`harness.scene.frame`)."""
    frame = frame_of(scene)
    if frame.is_own:
        return
    for index in _shape_nodes(mi, state):
        _carry(mi, state.nodes[index].props, frame.matrix)
    camera = framed(scene).camera
    distances = {"near_clip": camera.near_clip, "far_clip": camera.far_clip, "aperture_radius": camera.aperture_radius,
                 "focus_distance": camera.focus_distance}
    for node in state.nodes:
        if node.type == mi.ObjectType.Sensor:
            taken = ("near_clip", "far_clip") if camera.aperture_radius == 0 else tuple(distances)
            for name, value in {"to_world": mi.ScalarAffineTransform4d(camera.matrix),
                                **{name: distances[name] for name in taken}}.items():
                if name in node.props:
                    del node.props[name]
                node.props[name] = value


def _shape_nodes(mi: Any, state: Any) -> Iterator[int]:
    """Indices of the scene's shapes in file order, which is the order of `Scene.shapes`."""
    for _, index in _nested(mi, state, 0):
        if state.nodes[index].type == mi.ObjectType.Shape:
            yield index


def _carry(mi: Any, props: Any, pose: np.ndarray) -> None:
    """Apply a transform of the world to a shape after the file's own."""
    to_world = props.get("to_world")
    before = np.eye(4) if to_world is None else np.array(to_world.matrix, dtype=np.float64)
    if to_world is not None:
        del props["to_world"]
    props["to_world"] = mi.ScalarAffineTransform4d(pose @ before)


def _wrap_light(mi: Any, state: Any, index: int, shape: Shape, to_object: np.ndarray, *, moves: bool) -> None:
    """Put `surface_light` between a shape's area emitter and the texture of its radiance."""
    for _, emitter in _nested(mi, state, index):
        if state.nodes[emitter].type == mi.ObjectType.Emitter:
            texture = dict(_nested(mi, state, emitter))["radiance"]
            node = mi.parser.SceneNode(state.nodes[texture])
            props = properties(mi, shape, mi.Properties.ResolvedReference(texture), to_object, moves=moves)
            props.set_id(f"light {len(state.nodes)}")
            node.props = props
            state.nodes.append(node)
            del state.nodes[emitter].props["radiance"]
            state.nodes[emitter].props["radiance"] = mi.Properties.ResolvedReference(len(state.nodes) - 1)


def _nested(mi: Any, state: Any, index: int) -> list[tuple[str, int]]:
    """The objects that a node nests or refers to, as (property, index of their node)."""
    props = state.nodes[index].props
    found = []
    for key in props.keys():
        value = props[key]
        if isinstance(value, mi.Properties.ResolvedReference):
            found.append((key, value.index()))
        elif isinstance(value, mi.Properties.Reference):
            found.append((key, state.id_to_index[value.id()]))
    return found


def _place_textures(mi: Any, state: Any, index: int, to_object: np.ndarray, *, moves: bool) -> None:
    """Give a node its own copy of every nested object that leads to an object-space texture, and tell that where it is.

    A BSDF may be shared by many shapes, but its texture lies differently on each. The plugins of such textures take
    `to_object`, world to canonical object space.
    """
    for key, nested in _nested(mi, state, index):
        if _has_object_space_texture(mi, state, nested):
            copy = _copy(mi, state, nested, to_object, moves)
            del state.nodes[index].props[key]
            state.nodes[index].props[key] = mi.Properties.ResolvedReference(copy)


def _has_object_space_texture(mi: Any, state: Any, index: int) -> bool:
    if state.nodes[index].props.plugin_name() in KINDS:
        return True
    return any(_has_object_space_texture(mi, state, nested) for _, nested in _nested(mi, state, index))


def _copy(mi: Any, state: Any, index: int, to_object: np.ndarray, moves: bool) -> int:
    """Append a copy of the node and of all that it nests; the index of the copy."""
    node = mi.parser.SceneNode(state.nodes[index])
    props = mi.Properties(node.props)
    for key, nested in _nested(mi, state, index):
        del props[key]
        props[key] = mi.Properties.ResolvedReference(_copy(mi, state, nested, to_object, moves))
    if props.plugin_name() in KINDS:
        props["to_object"] = mi.ScalarAffineTransform4d(to_object)
        props["moves"] = moves
    props.set_id(f"{props.id()} of copy {len(state.nodes)}")  # ids are unique
    node.props = props
    state.nodes.append(node)
    return len(state.nodes) - 1
