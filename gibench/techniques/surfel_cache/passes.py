"""The passes of a frame (Jendersie et al. 2016, figure 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gibench.device import (
    SIMT,
    Argument,
    Buffer,
    Define,
    Device,
    Launch,
    ProgramSpec,
    count_rays,
    integer,
    local,
    reads,
    scalar,
    updates,
    writes,
)
from gibench.device.build import unsigned_literal
from gibench.techniques.parts.camera_pass import (
    Application,
    camera_pass,
    lookup_defines,
    pixels_per_item,
)
from gibench.techniques.parts.frame_scene import FrameScene
from gibench.techniques.parts.gbuffer import HitBuffer
from gibench.techniques.parts.macros import (
    GBUFFER_FLOATS,
    SHOW_DIRECT,
    SHOW_INDIRECT,
    tiled_pixels,
)
from gibench.techniques.surfel_cache.bake.data import LINK_SCALE, SurfelBake
from gibench.techniques.surfel_cache.pack import MARK_MACROS, NO_PLACE, Sizes
from gibench.techniques.surfel_cache.settings import SurfelCacheSettings
from gibench.techniques.surfel_cache.shared_exponent import SHARED_MACROS
from gibench.techniques.technique import Pass, Work

FORWARD_RENDER = "forward_render"

# At a pixel, for each coefficient: of four caches three channels weighed and added, the basis, its
# band; and the surface's shape.
_SHAPE_FLOPS = 75.0
_FLOPS_PER_COEFFICIENT = 4 * 3 * 2 + 6
# Work-items of a cache's group in the layout simt: a wave, so that each sums many links.
_LEAST_GROUP = 32


@dataclass(frozen=True)
class FramePasses:
    """A frame's launches.

    Attributes:
        scene: on the device.
        bake: what was baked.
        settings: of the technique.
        sizes: of what is held.
        held: the buffers by name.
        hits: what the camera's rays hit.
        flux_scale: by which sums of radiosity are stored.
        packets: whether the camera pass traces packets.
        workgroup_size: work-items per group.
    """

    scene: FrameScene
    bake: SurfelBake
    settings: SurfelCacheSettings
    sizes: Sizes
    held: dict[str, Buffer]
    hits: HitBuffer
    flux_scale: float
    packets: bool
    workgroup_size: int

    @property
    def simt(self) -> bool:
        """Whether kernels are tuned for work-items in lockstep."""
        return self.sizes.tuned and self.device.layout == SIMT

    @property
    def device(self) -> Device:
        """Where they run."""
        return self.scene.device

    def passes(self) -> list[Pass]:
        """In order."""
        s, on_map = self.sizes, self.bake.caches.on_map
        in_grid = self.bake.caches.in_grid
        nodes = s.surfels - 1
        lit = Work(bytes_read=s.surfels * 32.0, bytes_written=s.surfels * 4.0)

        def lighting(size: int) -> Work:
            (launch,) = self._surfel_lighting()
            return replace(lit, rays=count_rays(self.device, launch, size).occluded)

        border = s.border
        return [
            Pass("surfel_lighting", self._surfel_lighting, lit, lighting),
            Pass(
                "pull",
                self._pull,
                # Two children are decoded, added and encoded: three channels, each four times.
                Work(
                    flops=nodes * 3.0 * 4,
                    bytes_read=(2 * s.surfels - 1) * 8.0,
                    bytes_written=nodes * 4.0,
                ),
            ),
            Pass(
                "cache_lighting_map",
                lambda: self._cache_lighting("cache_map", 0, on_map),
                self._lit_work(on_map),
            ),
            Pass(
                "cache_lighting_grid",
                lambda: self._cache_lighting("cache_grid", on_map, in_grid),
                self._lit_work(in_grid),
            ),
            Pass(
                "dilation",
                self._dilation,
                Work(
                    flops=border * s.coefficients * 3.0,
                    bytes_read=border * s.coefficients * 6.0,
                    bytes_written=border * s.coefficients * 6.0,
                ),
            ),
            *self.application.passes(),
        ]

    @property
    def application(self) -> ForwardRender:
        """The caches' light at the pixels."""
        s, surfaces = self.settings, self.scene.surfaces
        lobes = 2 if s.exponent > 0 else 1
        return ForwardRender(
            scene=self.scene,
            hits=self.hits,
            program=self._render_program(),
            args=(
                *surfaces.shape_args,
                *self.cache_args,
                reads("cache_uvs", self.held["cache_uvs"]),
                scalar("exponent", np.float32(s.exponent)),
                scalar("gloss", np.float32(s.gloss)),
            ),
            flops=_SHAPE_FLOPS + lobes * self.sizes.coefficients * _FLOPS_PER_COEFFICIENT,
            packets=self.packets,
        )

    @property
    def cache_args(self) -> tuple[Argument, ...]:
        """CACHE_PARAMS of kernels_cl/surfel_cache/caches.cl."""
        atlas = self.bake.caches.atlas
        return (
            reads("cache_map", self.held["cache_map"]),
            integer("cache_width", atlas.width),
            integer("cache_height", atlas.height),
            reads("cache_grid", self.held["cache_grid"]),
            reads("grid", self.held["grid"]),
        )

    def receivers(
        self, place: Buffer, position: Buffer, normal: Buffer, irradiance: Buffer
    ) -> Launch:
        """The launch that looks up irradiance (n, 3) at points (n, 3) with normals (n, 3), which
        have a place (n, 2) in the map or none.
        """
        count = position.shape[0]
        args: tuple[Argument, ...] = (
            *self.cache_args,
            reads("place", place),
            reads("position", position),
            reads("normal", normal),
            integer("count", count),
            writes("irradiance", irradiance),
        )
        return Launch(self._render_program(), "receiver_irradiance", args, items=count)

    # -- programs and launches ----------------------------------------------------------------

    @property
    def _cache_defines(self) -> dict[str, Define]:
        x, y, z = self.bake.caches.volume.counts
        bands = self.settings.sh_bands
        return {"BANDS": bands, "GRID_X": x, "GRID_Y": y, "GRID_Z": z, "VEC": 1, **MARK_MACROS}

    def _render_program(self) -> ProgramSpec:
        defines = {**self._cache_defines, **lookup_defines(self.device)}
        return self.scene.program("surfel_cache/forward_render.cl", defines)

    def _surfel_lighting(self) -> Sequence[Launch]:
        defines = {
            **self._cache_defines,
            **SHARED_MACROS,
            "NO_PLACE": unsigned_literal(NO_PLACE),
        }
        program = self.scene.program("surfel_cache/surfel_lighting.cl", defines)
        held = self.held
        args: tuple[Argument, ...] = (
            *self.scene.bvh_args,
            *self.scene.light_args,
            *self.cache_args,
            reads("surfel_place", held["surfel_place"]),
            reads("surfel_normal", held["surfel_normal"]),
            reads("surfel_albedo", held["surfel_albedo"]),
            reads("surfel_emission", held["surfel_emission"]),
            reads("surfel_uv", held["surfel_uv"]),
            integer("count", self.sizes.surfels),
            integer("bounces", self.settings.bounces),
            scalar("flux_scale", np.float32(self.flux_scale)),
            updates("node_flux", held["node_flux"]),
        )
        return [Launch(program, "surfel_lighting", args, items=self.sizes.surfels)]

    def _pull(self) -> Sequence[Launch]:
        program, held = ProgramSpec("surfel_cache/pull.cl", SHARED_MACROS), self.held
        child, flux = reads("node_child", held["node_child"]), held["node_flux"]
        # Level by level neighbours are nodes side by side, and so are their children.
        if self.sizes.tuned and not self.simt:
            order = (
                reads("pull_order", held["pull_order"]),
                reads("pull_starts", held["pull_starts"]),
            )
            return [
                Launch(
                    program,
                    "pull_subtrees",
                    (
                        child,
                        *order,
                        integer("first", first),
                        integer("count", count),
                        updates("node_flux", flux),
                    ),
                    items=count,
                )
                for first, count in ((0, self.sizes.subtrees), (self.sizes.subtrees, 1))
            ]
        level = self.bake.hierarchy.level
        return [
            Launch(
                program,
                "pull",
                (
                    child,
                    integer("first", int(level[k])),
                    integer("count", int(level[k + 1] - level[k])),
                    updates("node_flux", flux),
                ),
                items=int(level[k + 1] - level[k]),
            )
            for k in reversed(range(len(level) - 2))
        ]

    def _cache_lighting(self, target: str, first: int, count: int) -> Sequence[Launch]:
        s, held = self.sizes, self.held
        width = self.device.vector_width if s.tuned else 1
        vectors = s.links // width
        defines: dict[str, Define] = {
            "BANDS": self.settings.sh_bands,
            "PROJECTION": f"PROJECTION_{'STORED' if s.stored else 'RUNTIME'}",
            "ENVIRONMENT": int(s.environment),
            "LINKS": s.links,
            "VEC": width,
            **SHARED_MACROS,
            **MARK_MACROS,
        }
        profile, row = self.device.profile, 12 * s.coefficients
        size = min(self.workgroup_size, max(_LEAST_GROUP, profile.simd_width))
        while size > 1 and row * size > profile.local_memory_bytes:
            size //= 2
        if self.simt:
            defines["TEAM"] = size
        elif s.tuned:
            defines["UNROLL"] = next(n for n in (4, 2, 1) if vectors % n == 0)
        shape = "simt" if self.simt else "tuned" if s.tuned else "published"
        program = ProgramSpec(f"surfel_cache/{shape}_cache_lighting.cl", defines)
        names = ("link_light",) if s.stored else ("link_direction", "link_weight")
        sky = [reads("environment", held["cache_environment"])] if s.environment else []
        args: tuple[Argument, ...] = (
            reads("node_flux", held["node_flux"]),
            reads("link_node", held["link_node"]),
            *(reads(name, held[name]) for name in names),
            *sky,
            reads("cache_place", held["cache_place"]),
            integer("first", first),
            integer("count", count),
            scalar("unscale", np.float32(1 / (LINK_SCALE * self.flux_scale))),
            updates("caches", held[target]),
        )
        if not self.simt:
            return [Launch(program, "cache_lighting", args, items=count)]
        sums = local("partial", row * size)
        kernel = "cache_lighting"
        return [Launch(program, kernel, (*args, sums), groups=count, workgroup_size=size)]

    def _lit_work(self, caches: int) -> Work:
        s = self.sizes
        per_link = 4 + (2 * s.coefficients if s.stored else 8)
        sky = 6 * s.coefficients if s.environment else 0
        # Of each link and coefficient three channels weighed and added; at run time the basis, too.
        basis = 0 if s.stored else 4 * s.coefficients
        return Work(
            flops=float(caches * s.links * (s.coefficients * 6 + basis)),
            bytes_read=float(caches * (s.links * per_link + 4 + sky)),
            bytes_written=float(caches * s.coefficients * 8),
        )

    def _dilation(self) -> Sequence[Launch]:
        atlas = self.bake.caches.atlas
        program = ProgramSpec(
            "surfel_cache/dilation.cl", {"BANDS": self.settings.sh_bands, **MARK_MACROS}
        )
        args = (
            updates("cache_map", self.held["cache_map"]),
            integer("width", atlas.width),
            integer("height", atlas.height),
        )
        if not self.sizes.tuned:
            return [Launch(program, "dilation", args, items=self.sizes.texels)]
        count = self.sizes.border
        border = (reads("cache_border", self.held["cache_border"]), integer("count", count))
        return [Launch(program, "dilation_border", (*args, *border), items=count)]


class ForwardRender(Application):
    """The caches' light on what the camera sees, the diffuse lobe's and a glossy one's."""

    def launch(self, show: int = SHOW_DIRECT | SHOW_INDIRECT) -> Launch:
        """The launch that applies it to an image of direct light; the sum of ``show`` is left."""
        args: tuple[Argument, ...] = (
            *self.args,
            *self.scene.camera_args,
            reads("gbuffer", self.hits.buffer),
            integer("show", show),
            updates("image", self.scene.image),
        )
        pixels = tiled_pixels(self.scene.width, self.scene.height)
        items = pixels // pixels_per_item(self.scene.device)
        return Launch(self.program, FORWARD_RENDER, args, items=items)

    def passes(self) -> list[Pass]:
        """The camera's pass and the lookup, whose caches are shared between pixels and not counted.

        How many pixels show a surface is known after a frame.
        """
        kept = Work(bytes_read=4 * self.hits.pixels)

        def counted(workgroup_size: int) -> Work:
            surfaces = self.hits.surfaces()
            return Work(
                flops=surfaces * self.flops,
                bytes_read=kept.bytes_read + surfaces * 4 * (GBUFFER_FLOATS - 1 + 3),
                bytes_written=surfaces * 4 * 3,
            )

        return [
            camera_pass(self.scene, self.hits, packets=self.packets),
            Pass(FORWARD_RENDER, lambda: [self.launch()], kept, counted),
        ]
