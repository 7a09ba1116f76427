"""The folder of small scenes after public reports (its CASES.md): each file at two revisions.

Each file is loaded, and where its kind is about light the truth is traced at its receivers; the
same by another revision's code, in a process of its own. Prints a Markdown table: case, the right
value, the value before and the value now. Evidence for docs/accuracy.md, not a test.

Usage: python cases_table.py CASES [REVISION], folders of the cases and of the other checkout.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
KINDS = (".obj", ".glb", ".gltf", ".toml")
RECEIVERS = 400
# Folders whose kind is about light: E, the mean indirect irradiance over the receivers, by area.
LIGHT = (
    "gi-", "gltf-window", "gltf-alpha-leaves", "gltf-emissive-strength", "gltf-lights",
)  # fmt: skip
# A closed room of area A and albedo 0.7 around a lamp of 4 pi x 5 W: 4 pi 5 x 0.7 / 0.3 / A.
ROOM = "6.109"
RIGHT = {
    **dict.fromkeys(("gi-far/off0.glb", "gi-far/off100km.glb", "gi-far/off450km.glb"), ROOM),
    "gi-leak/doublesided-flag.glb": "4.581",
    "gi-leak/no-flag.glb": "1.418 +- 0.028 (Mitsuba 3)",
    "gi-leak/single-sided.glb": "5.236",
    "gi-misc/env-only.toml": "3.142",
    "gi-misc/sun-hdr.toml": "461.7 on open ground, less the plate's shadow",
    "gi-scale/tiny.glb": "as metre",
    "gi-scale/millimetre.glb": "as metre",
    "gi-scale/centimetre.glb": "as metre",
    "gi-scale/fivekm.glb": "as metre",
    "gltf-alpha-leaves/opaque.glb": "0: all stopped",
    "gltf-alpha-leaves/mask.glb": "more than 0",
    "gltf-alpha-leaves/blend.glb": "0: left out, nothing else reflects",
    "obj-mapke-only/q.obj": "glows",
    "gltf-window/none.glb": "1.419",
    "gltf-window/transmission.glb": "1.419, as without",
    "gltf-window/blend.glb": "1.419, as without",
    "gltf-emissive-strength/s10.glb": "10 x s1",
    "obj-concave/l.obj": "area 5",
    "obj-concave/chevron.obj": "area 3",
    "obj-img/g16_png.obj": "albedo 0.051",
    "obj-img/f32_tiff.obj": "albedo 0.250",
    "gltf-img/grey16.glb": "albedo 0.051",
    "gltf-specgloss/room.glb": "albedo 0.200 0.100 0.050",
    "gltf-specgloss/room-texture.glb": "albedo 0.188 0.045 0.013",
}  # fmt: skip


def facts(path: Path) -> str:
    """What this process' gibench makes of a file: in one line."""
    import numpy as np

    from gibench.errors import GibenchError
    from gibench.reference.path_tracer import reference_irradiance
    from gibench.scene.load import load_scene

    try:
        from gibench.scene.lightmap.atlas import unwrap
    except ImportError:
        from gibench.scene.atlas import unwrap  # type: ignore[import-not-found,no-redef]
    try:
        scene = load_scene(str(path))
        corners = scene.corners.astype(np.float64)
        sides = corners[:, 1:] - corners[:, :1]
        area = float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)
        found = []
        for number in dict.fromkeys(scene.material_ids.tolist()):
            material = scene.materials[number]
            image = np.ones(3)
            if material.texture >= 0:
                image = scene.textures[material.texture].pixels.reshape(-1, 3).mean(axis=0)
            found.append(" ".join(f"{x:.3f}" for x in np.multiply(material.base_color, image)))
        line = f"area {area:.4g}, albedo {'; '.join(dict.fromkeys(found))}"
        if any(max(scene.materials[i].emission) > 0 for i in np.unique(scene.material_ids)):
            line += ", glows"
        if any(str(path.relative_to(path.parents[1])).startswith(kind) for kind in LIGHT):
            lightmap = unwrap(scene, RECEIVERS)
            truth = reference_irradiance(scene, lightmap, paths=1024)
            weights = lightmap.receivers.area[:, None] / lightmap.receivers.area.sum()
            mean = (truth.value * weights).sum(axis=0)
            error = float(np.sqrt(((truth.stderr * weights) ** 2).sum(axis=0)).max())
            kinds = {f"{x:.4g}" for x in mean}
            shown = kinds.pop() if len(kinds) == 1 else " ".join(f"{x:.4g}" for x in mean)
            line = f"E {shown} +- {error:.2g}"
        said = len([w for w in scene.warnings if "without normals" not in w])
        return line + (f" ({said} said)" if said else "")
    except GibenchError as error:
        return "refused: " + str(error).split(": ", 1)[-1][:70]
    except Exception as error:  # what a user would have met
        return f"{type(error).__name__}: {error}"[:70]


def by(checkout: Path, folder: Path, cases: list[str]) -> dict[str, str]:
    """The facts of ``cases`` by the gibench in ``checkout``."""
    env = {**os.environ, "PYTHONPATH": str(checkout)}
    command = [sys.executable, "-W", "ignore", __file__, "--facts", str(folder), *cases]
    done = subprocess.run(command, env=env, capture_output=True, text=True, cwd="/")
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if not lines:
        raise SystemExit(done.stderr)
    held: dict[str, str] = json.loads(lines[-1])
    return held


def main(arguments: list[str]) -> None:
    """Print the table."""
    folder = Path(arguments[0])
    cases = sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.suffix in KINDS)
    columns: list[Any] = []
    if len(arguments) > 1:
        columns.append(by(Path(arguments[1]), folder, cases))
    columns.append(by(ROOT, folder, cases))
    heads = ["case", "right", *(["before"] if len(columns) > 1 else []), "now"]
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for case in cases:
        cells = [case, RIGHT.get(case, ""), *(column[case] for column in columns)]
        print("| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |")


if __name__ == "__main__":
    if sys.argv[1] == "--facts":
        root = Path(sys.argv[2])
        print(json.dumps({case: facts(root / case) for case in sys.argv[3:]}))
    else:
        main(sys.argv[1:])
