"""Indirect light that is looked up in a lightmap."""

from __future__ import annotations

from gibench.techniques.parts.camera_pass import Application, lookup_defines
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.normal_map_table import NO_NORMAL_MAPS, NormalMapTable
from gibench.techniques.parts.receiver_signal import ReceiverSignal

SOURCE = "parts/application_lightmap.cl"

# A point's place in the atlas, two coordinates of three corners, of which the first weight is two
# differences; its texel and the place in it; three blends of three channels.
LOOKUP_FLOPS = 2 + 2 * 5 + 2 * 3 + 3 * 3 * 3


def lightmap_application(
    scene: FrameScene,
    hits: HitBuffer,
    signal: ReceiverSignal,
    packets: bool,
    normal_maps: NormalMapTable = NO_NORMAL_MAPS,
) -> Application:
    """The light of a map of irradiance on what the camera sees.

    Args:
        scene: the scene on the device.
        hits: what the camera pass keeps.
        signal: dilated.
        packets: whether the camera pass traces packets.
        normal_maps: that the camera pass shades with.
    """
    return Application(
        scene=scene,
        hits=hits,
        program=scene.program(SOURCE, {**lookup_defines(scene.device), **signal.macros}),
        args=signal.lookup_args,
        flops=LOOKUP_FLOPS,
        packets=packets,
        normal_maps=normal_maps,
    )
