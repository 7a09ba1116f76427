"""``receivers.npz``: receivers, reference and results, for others to read."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gibench.arrays import Doubles
from gibench.errors import BadInput
from gibench.measure.runfolder.folder import write_atomically
from gibench.scene.lightmap import Lightmap

NAME = "receivers.npz"


@dataclass(frozen=True)
class StoredReference:
    """A reference from a file.

    Attributes:
        value: (n, 3) irradiance, W/m2.
        stderr: (n, 3) its standard error.
        paths: per receiver; 0 where the file does not say.
    """

    value: Doubles = field(repr=False)
    stderr: Doubles = field(repr=False)
    paths: int


def write_receivers(
    path: Path,
    lightmap: Lightmap,
    reference: Doubles,
    stderr: Doubles,
    results: Mapping[str, Doubles],
    made_of: Mapping[str, Any],
) -> None:
    """Write the file: whole or not at all.

    Args:
        path: of the file.
        lightmap: whose receivers.
        reference: (n, 3) W/m2.
        stderr: (n, 3).
        results: (n, 3) by name.
        made_of: scene, lights, bounces, paths; kept as JSON under ``about``.

    Raises:
        GibenchError: the disk refuses.
    """
    receivers = lightmap.receivers
    arrays: dict[str, Any] = {
        "position": receivers.position,
        "normal": receivers.normal,
        "albedo": receivers.albedo,
        "area": receivers.area,
        "reference": reference.astype(np.float32),
        "reference_stderr": stderr.astype(np.float32),
        **{name: values.astype(np.float32) for name, values in results.items()},
        "about": np.array(json.dumps(dict(made_of), sort_keys=True)),
    }
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    write_atomically(path, content.getvalue())


def read_reference(path: Path, lightmap: Lightmap, made_of: Mapping[str, Any]) -> StoredReference:
    """The reference that an earlier ``receivers.npz`` holds for these receivers.

    Args:
        path: the file.
        lightmap: the receivers now.
        made_of: what scene, lights and bounces must be.

    Raises:
        BadInput: no such file, not of this kind, or of another scene, light, bounce count or
            other receivers.
    """
    mend = "leave --reference out, and it is path-traced (and kept in the cache)"
    try:
        with np.load(path, allow_pickle=False) as held:
            arrays = {name: held[name] for name in ("position", "reference", "reference_stderr")}
            about = json.loads(str(held["about"]))
    except FileNotFoundError:
        raise BadInput("no such file", where=path, mend=mend) from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise BadInput("not a receivers file of gibench quality", where=path, mend=mend) from error
    for name, now in made_of.items():
        if name in ("scene", "light", "bounces") and about.get(name) != now:
            raise BadInput(f"the receivers are of another {name}", where=path, mend=mend)
    position = lightmap.receivers.position
    if arrays["position"].shape != position.shape or not np.array_equal(
        arrays["position"], position
    ):
        raise BadInput(
            f"it holds {len(arrays['position']):,} other receivers than the scene's "
            f"{len(position):,}",
            where=path,
            mend=mend,
        )
    value, stderr = (arrays[n].astype(np.float64) for n in ("reference", "reference_stderr"))
    return StoredReference(value, stderr, int(about.get("paths", 0)))
