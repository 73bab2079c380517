"""Compilation of loops and kernels, and textures, before the tests: ``python tests/warm_up.py``.

Two workers would otherwise both compile all of it.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
CACHES: Final = ROOT / "build" / "test-cache"
SOURCES: Final = {".py", ".cl", ".clh", ".glsl", ".c", ".h", ".json", ".txt"}
WARM: Final = "warm"
# Tests that compile most of what runs of the program leave out.
GROUND: Final = (
    " tests/terrain/test_base_layer.py::test_samples_are_kept"
    " tests/terrain/test_landuse_layer.py::test_all_devices_compute_the_same_bits"
    " tests/terrain/test_kernels.py::test_double_kernel_equals_host_evaluation"
    " tests/terrain/test_kernels.py::test_normals_are_within_a_tenth_of_a_degree"
    " tests/terrain/test_drainage.py::test_domain_has_the_same_bits_in_any_rectangle"
    " tests/terrain/test_mesh.py::test_edges_are_monotone_in_valleys_and_rise_to_one_pass_elsewhere"
    " tests/hydrology/test_real_relief.py::test_rivers_never_rise"
    " tests/world/test_serial.py::test_replacement_device_gives_equal_bytes"
    " tests/export/targets/test_qgis_target.py::test_projects_are_relative_complete_and_deterministic"
    " tests/export/targets/test_engines.py::test_bare_terrain_exports_are_deterministic_and_without_plants"
)
VIEWS: Final = (
    " tests/render/test_texture_maker.py"
    " tests/render/test_appearance.py::test_no_border_of_a_tile_or_level_shows_at_any_height"
    " tests/render/test_frame.py::test_visible_tiles_hold_the_new_terrain_when_set_terrain_returns"
    " tests/render/test_frame.py::test_no_frame_spends_more_than_its_budget_on_light_and_plants"
    " tests/render/test_ground_cover.py::test_roots_are_on_the_displayed_ground"
    " tests/render/test_sky.py::test_a_cloud_dome_shows_the_clouds_of_the_picture_after_eye_and_wind_moved"
    " tests/render/test_built.py"
    " tests/terrain/test_materials.py"
    " tests/compute/test_context.py::test_every_kernel_builds_on_every_device"
    " tests/drape/test_screen.py"
    " tests/document/test_own_materials.py"
)
# Modules and arguments, one after the other; the collection compiles the tests themselves.
CHAINS: Final = (
    (
        "sketchterrain generate mountain_pass --size 65 --no-preview -o OUT/files",
        "pytest -n 0 -q --collect-only",
        f"pytest -n 0 -q {GROUND}",
    ),
    ("sketchterrain render valley_river --size 320x180 -o OUT/view.png", f"pytest -n 0 -q {VIEWS}"),
)


def cache_of_sources() -> Path | None:
    """Return the cache folder of this state of the sources; None where the checkout cannot be written."""
    digest = sha256()
    for folder in ("sketchterrain", "kernels", "ui", "benchmarks", ".ci"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in SOURCES:
                digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    folder = CACHES / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (
            "pyopencl",
            "pocl",
            "mesa_shader_cache",
            "mesa_shader_cache_db",
        ):  # keyed by source themselves
            (CACHES / name).mkdir(exist_ok=True)
            if not (folder / name).exists():
                (folder / name).symlink_to(CACHES / name)
        folder.touch()
    except OSError:
        return None
    for stale in sorted(CACHES.glob("[0-9a-f]*[0-9a-f]"), key=lambda path: path.stat().st_mtime)[:-3]:
        shutil.rmtree(stale, ignore_errors=True)
    return folder


def warm_up(cache: Path) -> None:
    """Run `CHAINS` side by side, unless that was done with these sources."""
    if (cache / WARM).exists():
        return
    sys.stderr.write("Compiling loops and kernels for the tests: one or two minutes\n")
    environment, quiet = os.environ | {"XDG_CACHE_HOME": str(cache)}, subprocess.DEVNULL

    def succeeds(run: str) -> bool:
        command = [sys.executable, "-m", *run.replace("OUT", folder).split()]
        return not subprocess.run(command, cwd=ROOT, env=environment, stdout=quiet, stderr=quiet).returncode

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(len(CHAINS)) as pool:
        if all(
            pool.map(lambda chain: all(succeeds(run) for run in chain), CHAINS)
        ):  # else the tests tell why
            (cache / WARM).touch()


if __name__ == "__main__" and (found := cache_of_sources()):
    warm_up(found)
