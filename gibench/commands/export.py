"""Our scenes for other people's renderers, from Python."""

from __future__ import annotations

from pathlib import Path

from gibench.commands import asked
from gibench.commands.bounds import within_bounds
from gibench.errors import BadInput
from gibench.measure.plan.view import choose_camera
from gibench.reference.mitsuba_export import write_mitsuba
from gibench.scene.load import load_scene


@within_bounds
def export_mitsuba(
    scene: str,
    out: str | Path,
    resolution: str | tuple[int, int] = "1334x750",
    camera: str | int | None = None,
    light_frame: int = 0,
    bounces: int | None = None,
    samples: int = 64,
) -> Path:
    """Write a scene as Mitsuba 3's path integrator renders it to what our reference is, so that an
    independent renderer can check the truth. Needs no Mitsuba.

    Args:
        scene: built-in scene, or the path of a file.
        out: folder; made when it is not there.
        resolution: of the image, ``WxH`` pixels.
        camera: number or name; the scene's first when None.
        light_frame: the lights are where they are in this frame.
        bounces: of indirect light; None for as many as there are.
        samples: per pixel.

    Returns:
        The path of the XML file.

    Raises:
        BadInput: there is no such scene or camera, the folder cannot be written, or the scene holds
            what Mitsuba has nothing for.
    """
    width, height = asked.image_size(resolution)
    loaded = load_scene(scene)
    which = None if camera is None else str(camera)
    try:
        return write_mitsuba(
            Path(out),
            loaded,
            choose_camera(loaded, which),
            width,
            height,
            frame=light_frame,
            bounces=bounces,
            samples=samples,
        )
    except OSError as error:
        raise BadInput(
            f"the folder cannot be written ({error.strerror or error})",
            where=out,
            mend="give another folder",
        ) from error
