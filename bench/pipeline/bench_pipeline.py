"""The standard blocks: whole runs as numbers, beside COLMAP where asked."""
import pathlib
import shutil
import tempfile

from bench_orient import colmap_wall_s
from blocks import Runs
from standard_blocks import REAL, SIMULATED, measure_block, reference_loop_s


def photographs(images):
    return sorted(path for path in images.iterdir() if path.suffix.lower() in (".jpg", ".jpeg", ".png", ".tif", ".tiff"))


def colmap(images, calibration):
    """Wall seconds of COLMAP's three commands on the same photographs, or why there are none."""
    if not shutil.which("colmap"):
        return "colmap is not installed (scripts/setup --peers)"
    if calibration.name == "calibration.toml":
        calibration = calibration.parent / "truth" / "cameras.txt"
    with tempfile.TemporaryDirectory(prefix="rilievo-colmap-") as folder:
        folder = pathlib.Path(folder)
        (folder / "images").mkdir()
        for path in photographs(images):
            (folder / "images" / path.name).symlink_to(path)
        return colmap_wall_s(folder / "images", calibration, folder) or "colmap failed"




def cases(runs, data, full):
    """(name, images, calibration, scene, options) of every block that is there."""
    for name, options in SIMULATED.items():
        if name != "simulated-300" or full:
            block = runs.block(name, *options)
            yield name, block.images, block.calibration, block.scene, ("--network", "guided") if "simulated-300" == name else ()
    for name, (images, calibration) in REAL.items():
        folder = data / name
        if (folder / images).is_dir() and photographs(folder / images):
            yield name, folder / images, folder / calibration, None, ()


def measure(figures, binaries, data, full):
    runs = Runs(binaries)
    blocks = {}
    try:
        loop_s = reference_loop_s(binaries / "reference_loop")
        for name, images, calibration, scene, options in cases(runs, data, full):
            rows = [(f"{name}: time", "s", "reported"), (f"{name}: images oriented", "", "all")]

            def part():
                workspace = runs.scratch / name.replace("/", "-")
                block = measure_block(runs.rilievo, images, calibration, workspace, runs.scratch / "trace.json", scene, options)
                if figures.options.with_colmap:
                    block["colmap_wall_s"] = colmap(images, calibration)
                blocks[name] = block
                figures.add(rows[0][0], block["wall_s"], "s", "reported", True)
                figures.add(rows[1][0], block["accuracy"]["oriented"], "", "all", block["accuracy"]["oriented"] == block["images"])
                print(f"  {block['cpu_s']:.1f} s CPU, {block['peak_bytes'] / 2**30:.2f} GiB, {block['pairs']} pairs, accuracy {block['accuracy']}"
                      + (f", COLMAP {block['colmap_wall_s']}" if "colmap_wall_s" in block else ""), flush=True)
                runs.drop(workspace)

            figures.measure(rows, part)
    finally:
        runs.close()
    return {"reference_loop_s": loop_s, "blocks": blocks}
