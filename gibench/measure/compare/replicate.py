"""One process that runs one configuration with one kernel tree, a frame whenever it is told to.

Started as ``python -m gibench.measure.compare.replicate``: the configuration comes as one line of
JSON on standard input (:class:`ReplicateSpec`), then commands, one a line: ``frame N`` runs frame N
and ``keep FILE`` writes what was computed; every answer is one line of JSON. The end of input ends
it. The parent (:mod:`gibench.measure.compare.lockstep`) lets two such processes take turns.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from gibench.errors import BadInput, CannotRun, GibenchError

if TYPE_CHECKING:
    from gibench.measure.plan.configuration import Configuration


@dataclass(frozen=True)
class ReplicateSpec:
    """One configuration, as a fresh process needs it.

    Attributes:
        settings: further settings of the technique, as typed by the user.
        receivers: number to aim for; None leaves it to the scene.
        workgroup_size: None leaves it to the profile.
        kernel_root: folder of the kernel tree; None for the installed one.
        device: number of the OpenCL device; None for the first.
    """

    technique: str
    variant: str
    scene: str
    profile: str
    cache_dir: str
    sh_order: int | None = None
    probes: int | None = None
    receivers: int | None = None
    workgroup_size: int | None = None
    settings: Mapping[str, str] = field(default_factory=dict)
    width: int = 320
    height: int = 180
    camera: str | None = None
    seed: int = 0
    device: int | None = None
    kernel_root: str | None = None

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))

    def configuration(self) -> Configuration:
        """The configuration it names.

        Raises:
            GibenchError: it names something that does not exist or fit.
        """
        from gibench.measure.plan.configuration import Request, grid
        from gibench.profiles import load_profile
        from gibench.techniques.registry import find_technique

        def one(value: int | None) -> tuple[int, ...]:
            return () if value is None else (value,)

        request = Request(
            scenes=(self.scene,),
            variants=(self.variant,),
            sh_orders=one(self.sh_order),
            probes=one(self.probes),
            receivers=one(self.receivers),
            workgroup_sizes=one(self.workgroup_size),
            settings={self.technique: self.settings} if self.settings else {},
        )
        spec = find_technique(self.technique)
        (configuration,) = grid([load_profile(self.profile)], [spec], request)
        return configuration


def serve(spec: ReplicateSpec, commands: TextIO, answers: TextIO) -> None:
    """Set ``spec`` up, say so, and answer commands until their end.

    Raises:
        GibenchError: it cannot be set up; a pass of it cannot run.
    """
    import numpy as np

    from gibench.device.device import select_cl_device
    from gibench.measure.runfolder.results import ConfigurationResult
    from gibench.measure.session.enqueue import enqueue_frame, prepare_passes
    from gibench.measure.session.setup import LoopOptions, set_up
    from gibench.measure.session.shared import Shared

    configuration = spec.configuration()
    options = LoopOptions(
        width=spec.width,
        height=spec.height,
        camera=spec.camera,
        seed=spec.seed,
        kernel_root=Path(spec.kernel_root) if spec.kernel_root else None,
    )
    result = ConfigurationResult(configuration, spec.scene)
    shared = Shared(Path(spec.cache_dir), spec.seed)
    _, technique = set_up(result, options, shared, select_cl_device(spec.device))
    prepared = prepare_passes(technique, configuration.workgroup_size)
    for item in prepared:
        if item.problem:
            error = CannotRun if item.status == "skipped" else GibenchError
            raise error(f"{item.name}: {item.problem}")
    _answer(answers, {"ready": [item.name for item in prepared]})
    for line in commands:
        command, _, argument = line.strip().partition(" ")
        if command == "frame":
            times = enqueue_frame(technique, prepared, int(argument))
            _answer(answers, {"wall_ms": times.wall_ms, "pass_ms": times.pass_ms})
        elif command == "keep":
            outputs: dict[str, Any] = {"indirect irradiance": technique.indirect_irradiance()}
            outputs |= {f"image {title}": image for title, image in technique.images().items()}
            np.savez(argument, **outputs)
            _answer(answers, {"kept": argument})
        else:
            raise BadInput(f"no command '{command}'")


def _answer(answers: TextIO, content: Mapping[str, Any]) -> None:
    answers.write(json.dumps(content) + "\n")
    answers.flush()


def main() -> int:
    """Serve standard input; what compilers print must not mix with the answers."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    try:
        serve(ReplicateSpec(**json.loads(sys.stdin.readline())), sys.stdin, answers)
    except GibenchError as error:
        _answer(answers, {"error": str(error), "exit_code": error.exit_code})
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        _answer(answers, {"error": f"{type(error).__name__}: {error}", "exit_code": 1})
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
