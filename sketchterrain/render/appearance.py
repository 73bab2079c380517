"""Textures of what vectors paint on the terrain, drawn by tiles for a moving camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import moderngl
import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, Int64Array
from sketchterrain.host.library import host_function
from sketchterrain.render.programs import Textures, clamped
from sketchterrain.render.quality import UNLIMITED, Quality, TimeBudget, WorkRate
from sketchterrain.render.scene import PaintedTerrain, TileSource
from sketchterrain.terrain.appearance import Appearance
from sketchterrain.terrain.painted_land import PaintedLand
from sketchterrain.tiles.appearance import PAGES, TEXELS, AppearanceTiles
from sketchterrain.tiles.lod import CameraView
from sketchterrain.tiles.quadtree import decode
from sketchterrain.tiles.tile_pool import TilePool

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes

TILE_SECONDS: Final = 0.003  # s of drawing a tile, before any measurement
BATCH: Final = 32  # tiles at once
AHEAD: Final = 0.8  # s ahead of the camera whose tiles are drawn when none is missing now
DRAPED_TILES: Final = 384
"""Slots of tiles with draped layers, half of them if they filter: 57 MB of 101 MB for layers altogether."""
JUMP_BUDGET: Final = 0.25  # s for the first frame and the frame of a jump


class _Cache(NamedTuple):
    source: Appearance
    tiles: AppearanceTiles
    pages: moderngl.TextureArray
    texels: moderngl.TextureArray
    filters: moderngl.TextureArray | None


class AppearanceTextures:
    """Colour of roads, land use and draped layers: tiles in a texture array, and a table of their places.

    True if anything is painted. `drawn` counts tiles. Roads and land use may be left out.
    """

    def __init__(
        self, context: moderngl.Context, terrain: TileSource, quality: Quality, *, over_land: bool = True
    ) -> None:
        self._context, self._quality, self._terrain = context, quality, terrain
        self._over_land = over_land
        self._drapes: Drapes | None = None
        self._rate = WorkRate(TILE_SECONDS)
        self._cache: _Cache | None = None
        self._state: tuple[object, ...] = ()  # of the page table
        self._centre = np.zeros((1, 2), np.int64)
        self._looks_ahead = False
        self.drawn = 0
        self.set_terrain(terrain, ())

    def __bool__(self) -> bool:
        return self._cache is not None

    @property
    def defines(self) -> dict[str, int | str]:
        """Macros of shaders: levels, and most samples along a footprint, 0 if nothing is painted."""
        if self._cache is None:
            return {"APPEARANCE": 0}
        return {
            "APPEARANCE": self._quality.appearance_taps,
            "APPEARANCE_LEVELS": self._cache.tiles.finest + 1,
            "APPEARANCE_FILTER": int(self._cache.filters is not None),
        }

    @property
    def textures(self) -> dict[str, Textures]:
        """Textures by sampler name."""
        if (cache := self._cache) is None:
            return {}
        filters = {} if cache.filters is None else {"appearance_filters": cache.filters}
        return {"appearance_pages": cache.pages, "appearance_texels": cache.texels, **filters}

    @property
    def nbytes(self) -> int:
        """Bytes of textures, and of what draped layers keep in memory for them."""
        if (cache := self._cache) is None:
            return 0
        texels = 4 * cache.tiles.slots * TEXELS**2 * (1 + (cache.filters is not None))
        pages = 8 * PAGES**2 * (cache.tiles.finest + 1)
        return int(texels + pages) + cache.source.nbytes

    @property
    def converged(self) -> bool:
        """Whether all tiles of the last view are drawn."""
        return self._cache is None or self._cache.tiles.converged

    def set_terrain(self, terrain: TileSource, areas: Sequence[Bounds]) -> None:
        """Replace the terrain, which differs inside areas (m) only; tiles stay until new ones are drawn."""
        self._terrain = terrain
        self._set_source(areas)

    def set_drapes(self, drapes: Drapes | None) -> None:
        """Replace the draped layers; tiles that they change stay until new ones are drawn."""
        if drapes is not self._drapes:
            self._drapes = drapes
            self._set_source(())

    def _set_source(self, areas: Sequence[Bounds]) -> None:
        cache, source = self._cache, self._source()
        if source.is_empty:
            self._cache = None
            return
        filters, slots = source.filters, self._quality.appearance_tiles
        if source.layers is not None:
            slots = min(slots, DRAPED_TILES >> filters)
        if cache is not None and cache.tiles.slots == slots and (cache.filters is not None) == filters:
            own = source.changed_areas(cache.source)
            cache.tiles.invalidate([*areas, *map(tuple, own.tolist())], texels=source.reach(cache.source))
            self._cache = cache._replace(source=source)
            return
        tiles = AppearanceTiles(source.extent, slots=slots)
        pages = self._context.texture_array((PAGES, PAGES, tiles.finest + 1), 2, dtype="u4")
        pages.filter = (moderngl.NEAREST, moderngl.NEAREST)
        size = TEXELS, TEXELS, slots
        arrays = [clamped(self._context.texture_array(size, 4)) for _ in range(1 + filters)]
        self._cache = _Cache(source, tiles, pages, arrays[0], arrays[1] if filters else None)

    def _source(self) -> Appearance:
        """Return what is painted on the terrain: its own appearance under draped layers."""
        terrain = self._terrain
        own = terrain.appearance if self._over_land and isinstance(terrain, PaintedTerrain) else None
        own = own or Appearance(PaintedLand.bare(terrain.extent, terrain.context))
        if self._drapes is None or self._drapes.is_empty:
            return own
        return own.with_drapes(self._drapes, self._cache and self._cache.source)

    def update(self, view: CameraView, pool: TilePool, budget: TimeBudget = UNLIMITED) -> bool:
        """Draw tiles of a view within a budget, but at least one; return whether that is all of them.

        `pool` has the ground's tiles.
        In motion frames take turns: every second one draws tiles ahead of the camera if none is missing.
        """
        if (cache := self._cache) is None:
            return True
        self._looks_ahead = any(view.velocity) and not self._looks_ahead
        if not self._looks_ahead:
            cache.tiles.select(view, pool, cache.source.occupied)
        codes = cache.tiles.pending()
        if self._looks_ahead and not codes.size:
            ahead = cache.tiles.needed(view.extrapolated(AHEAD), pool, cache.source.occupied)
            codes = cache.tiles.pending(ahead)
        if codes.size:
            codes, before = codes[: max(self._rate.steps_within(budget, BATCH), 1)], budget.spent
            self._draw(cache, codes)
            self._rate.record(len(codes), budget.spent - before)
        return self.converged

    def uniforms(self, eye: tuple[float, float, float]) -> dict[str, object]:
        """Return the uniforms of appearance.glsl for an eye (m), and write its page table."""
        if (cache := self._cache) is None:
            return {}
        state = (cache.tiles, cache.tiles.changes)
        if state != self._state or not cache.tiles.shows(self._centre, eye):
            table, self._centre = cache.tiles.page_table(eye)
            cache.pages.write(table.tobytes())
            self._state = state
        tile, place = ([tuple(row) for row in each.tolist()] for each in cache.tiles.tiles_at(eye))
        uniforms: dict[str, object] = {"appearance_tile": tile, "appearance_place": place}
        return {**uniforms, "appearance_width": cache.tiles.extent}

    def _draw(self, cache: _Cache, codes: Int64Array) -> None:
        found = cache.source.tiles(np.stack(decode(codes), axis=-1))
        drawn = premultiplied(found[..., :4])
        words = drawn.view(np.uint32).reshape(len(codes), -1)
        is_uniform = np.asarray((words == words[:, :1]).all(axis=1))
        arrays = [(cache.texels, drawn)]
        if cache.filters is not None:
            arrays.append((cache.filters, np.ascontiguousarray(found[..., 4:])))
            hidden = found[..., 3:4].astype(np.int16) + found[..., 4:7]
            is_uniform &= (np.abs(hidden - 255) <= 1).all(axis=(1, 2, 3))
            is_uniform &= (found[..., 7] == 255).all(axis=(1, 2))
        slots = cache.tiles.store(codes, is_uniform, words[:, 0])
        for array, tiles in arrays:
            for tile, slot in zip(tiles, slots.tolist(), strict=True):
                if slot >= 0:
                    array.write(tile.tobytes(), viewport=(0, 0, slot, TEXELS, TEXELS, 1))
        self.drawn += len(codes)


def premultiplied(tiles: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return tiles (…, 4) with √albedo times the share, so that filters mix what is painted only."""
    result = np.empty(tiles.shape, np.uint8)
    host_function("premultiply")(np.ascontiguousarray(tiles).reshape(-1, 4), result.reshape(-1, 4))
    return result
