"""SRP's light on what the camera sees."""

from __future__ import annotations

from gibench.device import Argument, reads
from gibench.device.build import Define
from gibench.techniques.parts.camera_pass import Application, lookup_defines
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.gloss_table import GlossTable
from gibench.techniques.parts.lightmap_lookup import LOOKUP_FLOPS, lightmap_application
from gibench.techniques.parts.normal_map_table import NormalMapTable
from gibench.techniques.parts.receiver_signal import ReceiverSignal
from gibench.techniques.parts.split_sum import GLOSS_MACROS

SOURCE = "srp/application.cl"


def srp_application(
    scene: FrameScene,
    hits: HitBuffer,
    signal: ReceiverSignal,
    packets: bool,
    normal_maps: NormalMapTable,
    gloss: GlossTable | None = None,
) -> Application:
    """The light of the receivers, of order 1 where normal maps or gloss ask for it.

    Its declared work is that of irradiance alone, the least that any pixel takes.

    Args:
        scene: the scene on the device.
        hits: what the camera pass keeps.
        signal: dilated.
        packets: whether the camera pass traces packets.
        normal_maps: that surfaces are shaded with; none where the light is of order 0.
        gloss: images of roughness and metalness, for glossy reflection; None for none.
    """
    if normal_maps.words is None and gloss is None:
        return lightmap_application(scene, hits, signal, packets)
    defines: dict[str, Define] = {
        **lookup_defines(scene.device),
        **signal.macros,
        **normal_maps.defines,
    }
    material: tuple[Argument, ...] = ()
    if gloss is not None:
        defines |= {"GLOSS": 1, **GLOSS_MACROS, **gloss.defines}
        surfaces = scene.surfaces
        material = (
            reads("material_ids", surfaces.material_ids),
            reads("materials", surfaces.materials),
            *gloss.args,
        )
    shape = scene.surfaces.shape_args
    return Application(
        scene=scene,
        hits=hits,
        program=scene.program(SOURCE, defines),
        args=(*signal.lookup_args, *shape, *normal_maps.args, *material),
        flops=LOOKUP_FLOPS,
        packets=packets,
        normal_maps=normal_maps,
    )
