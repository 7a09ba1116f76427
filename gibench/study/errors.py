"""Every error of one result against one reference, over all receivers and in each region."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from gibench.arrays import Bools, Doubles
from gibench.errors import CannotRun
from gibench.reference import metrics
from gibench.reference.metrics import Measure
from gibench.study.regions import WHOLE
from gibench.study.through_camera import View

METRICS = ("bias", "rel_l2", "rel_mse", "lab_l_mse", "flip", "ssim")
_UNKNOWN = Measure(float("nan"), float("nan"))


@dataclass(frozen=True)
class Truth:
    """A reference, ready to compare with.

    Attributes:
        value: (n, 3) irradiance, W/m2.
        stderr: (n, 3) its standard error.
        area: (n,) of the receivers, m2.
        view: the camera's.
        exposure: of everything perceptual.
        seen: (h, w, 3) the reference through the camera.
        seen_stderr: (h, w, 3).
    """

    value: Doubles = field(repr=False)
    stderr: Doubles = field(repr=False)
    area: npt.NDArray[Any] = field(repr=False)
    view: View = field(repr=False)
    exposure: float
    seen: Doubles = field(repr=False)
    seen_stderr: Doubles = field(repr=False)

    @staticmethod
    def of(value: Doubles, stderr: Doubles, area: npt.NDArray[Any], view: View) -> Truth:
        """The truth with its image."""
        seen = view.of(value)
        bright = seen[view.seen] if view.seen.any() else value
        exposure = metrics.default_exposure(bright)
        return Truth(value, stderr, area, view, exposure, seen, view.error_of(stderr))

    @cached_property
    def flip_of_noise(self) -> Doubles:
        """FLIP (h, w) of the image against itself with its noise drawn once more.

        Raises:
            CannotRun: flip-evaluator is not installed.
        """
        draw = np.random.default_rng(1).normal(size=self.seen.shape)
        noisy = np.maximum(self.seen + self.seen_stderr * draw, 0.0)
        return metrics.flip_map(noisy, self.seen, self.view.seen)

    @property
    def relative_error(self) -> float:
        """Mean standard error over mean value."""
        mean = float(self.value.mean())
        return float(self.stderr.mean()) / mean if mean > 0 else 0.0


def errors(
    truth: Truth, result: Doubles, regions: Mapping[str, Bools], *, with_flip: bool = True
) -> dict[str, dict[str, Any]]:
    """The metrics by region, :data:`~gibench.study.regions.WHOLE` first.

    Over the whole, bias and relative errors are those of the receivers, weighted by area, whether
    the camera sees them or not; L*, FLIP and SSIM are the image's. In a region all are the image's.
    Pixels in which the camera sees no receiver do not count. A region (or camera) without any pixel
    that does has no figures.

    Args:
        truth: the reference.
        result: (n, 3).
        regions: masks (h, w) by name.
        with_flip: whether to take FLIP, which takes longer than all the others together.

    Raises:
        BadInput: the result is of other receivers, or not finite.
    """
    image = truth.view.of(result)
    maps = _flip_maps(truth, image) if with_flip else None
    found = {WHOLE: _of_image(truth, image, truth.view.seen, maps)}
    found[WHOLE] |= _relative(result, truth.value, truth.stderr, truth.area)
    for name, mask in regions.items():
        found[name] = _of_image(truth, image, mask & truth.view.seen, maps)
    return found


def errors_among(truth: Truth, result: Doubles, chosen: Bools) -> dict[str, Measure]:
    """Bias and relative errors over the ``chosen`` receivers (n,) alone, weighted by area."""
    if not chosen.any():
        return dict.fromkeys(("bias", "rel_l2", "rel_mse"), _UNKNOWN)
    value, stderr, area = truth.value[chosen], truth.stderr[chosen], truth.area[chosen]
    return _relative(result[chosen], value, stderr, area)


def _relative(x: Doubles, y: Doubles, s: Doubles, weights: Any = None) -> dict[str, Measure]:
    return {
        "bias": metrics.bias(x, y, s, weights),
        "rel_l2": metrics.relative_l2(x, y, s, weights),
        "rel_mse": metrics.relative_mse(x, y, s, weights),
    }


def _of_image(
    truth: Truth, image: Doubles, mask: Bools, maps: tuple[Doubles, Doubles] | None
) -> dict[str, Measure]:
    if not mask.any():
        return dict.fromkeys(METRICS, _UNKNOWN)
    x, y, s = image[mask], truth.seen[mask], truth.seen_stderr[mask]
    found = _relative(x, y, s)
    found["lab_l_mse"] = metrics.lab_l_mse(x, y, s, exposure=truth.exposure)
    found["flip"] = (
        _UNKNOWN if maps is None else Measure(*(float(one[mask].mean()) for one in maps))
    )
    try:
        found["ssim"] = metrics.ssim(
            image, truth.seen, truth.seen_stderr, mask, exposure=truth.exposure
        )
    except CannotRun:
        found["ssim"] = _UNKNOWN
    return found


def _flip_maps(truth: Truth, image: Doubles) -> tuple[Doubles, Doubles] | None:
    """FLIP of every pixel, of the result and of the reference's own noise.

    None where the package is missing or the reference is black.
    """
    if not truth.seen[truth.view.seen].any():
        return None
    try:
        return metrics.flip_map(image, truth.seen, truth.view.seen), truth.flip_of_noise
    except CannotRun:
        return None
