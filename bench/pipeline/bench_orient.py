"""The figures of "Orient real photographs end to end"."""
import json
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile

from program import artifacts_of, files_of, run

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "accuracy"))
from poses import centre_errors, read_colmap_images, read_strecha_centres  # noqa: E402

MEMORY_BYTES = 4 << 30


class Bench:
    def __init__(self, figures, binaries, data):
        self.figures, self.binaries, self.data = figures, binaries, data
        self.rilievo = binaries / "rilievo"
        self.scratch = pathlib.Path(tempfile.mkdtemp(prefix="rilievo-bench-"))
        self.peaks = {}

    def orient(self, name, images, calibration, *options, workspace=None):
        workspace = workspace or self.scratch / name
        done = run([self.rilievo, "orient", images, *(["--calibration", calibration] if calibration else []), "--workspace", workspace,
                    "--memory", "4GiB", "--progress", "plain", *options])
        self.peaks[name] = max(self.peaks.get(name, 0), done.peak_bytes)
        if done.code != 0:
            print(f"  {name}: exit code {done.code}: {done.err.strip().splitlines()[-1] if done.err.strip() else ''}", file=sys.stderr)
        return workspace, done

    def export(self, workspace, name):
        output = self.scratch / f"{name}-export"
        shutil.rmtree(output, ignore_errors=True)
        run([self.rilievo, "export", workspace, "--format", "colmap-text", "--output", output])
        return output

    def report(self, workspace, *options):
        done = run([self.rilievo, "report", workspace, "--json", *options])
        return json.loads(done.out) if done.code == 0 else None

    def oriented_in_one(self, workspace):
        """Images in the largest component: images scattered over several are not one orientation."""
        report = self.report(workspace)
        return len(report["models"][0]["images"]) if report and report["models"] else 0


def strecha(bench):
    for name, count, limit_mm in (("fountain-P11", 11, 2.7), ("entry-P10", 10, 6.5)):
        folder = bench.data / "strecha" / name
        if not (folder / "images").is_dir():
            bench.figures.skip(f"{name}: images oriented", "", f">= {count}", f"{folder.name} is absent")
            bench.figures.skip(f"{name}: mean centre error", "mm", f"<= {limit_mm}", f"{folder.name} is absent")
            continue
        workspace, done = bench.orient(name, folder / "images", folder / "images" / "K.txt")
        bench.figures.at_least(f"{name}: images oriented", bench.oriented_in_one(workspace), "", count)
        images = bench.export(workspace, name) / "images.txt"
        value = None
        if images.exists():
            estimated = {n: c for n, (_, c) in read_colmap_images(images).items()}
            errors = centre_errors(estimated, read_strecha_centres(folder / "gt_dense_cameras"))
            value = 1000 * sum(errors.values()) / len(errors) if len(errors) == count else None
        bench.figures.at_most(f"{name}: mean centre error", value, "mm", limit_mm)
        report = bench.report(workspace)
        camera = report["cameras"][0] if report else {"fx_px": 0, "fy_px": 0}
        bench.figures.add(f"{name}: fx - fy as calibrated", camera["fx_px"] - camera["fy_px"], "px", "!= 0", camera["fx_px"] != camera["fy_px"])
        print(f"  {name}: {done.wall_s:.1f} s wall, {done.cpu_s:.1f} s CPU, peak {done.peak_bytes / 2**30:.2f} GiB")


def other_sets(bench):
    for name, subfolder, calibration, least, order in (("saharov32", ".", "cameras.txt", 32, None), ("temple47", ".", "K.txt", 45, "ordered_filenames.txt"),
                                                       ("cyprus10", "images", "cameras.txt", 10, None)):
        folder = bench.data / name
        for network in ("sparse", "sequence"):
            row = f"{name}: images oriented, {network}"
            if not any((folder / subfolder).glob("*.[jpJP][pnPN][gG]")):
                bench.figures.skip(row, "", f">= {least}", "its images are absent")
                continue
            options = ["--network", network] + (["--order", folder / order] if order and network == "sequence" else [])
            workspace, done = bench.orient(f"{name}-{network}", folder / subfolder, folder / calibration, *options)
            bench.figures.at_least(row, bench.oriented_in_one(workspace), "", least)
            print(f"  {name} {network}: {done.wall_s:.1f} s wall, peak {done.peak_bytes / 2**30:.2f} GiB")


def simulated(bench):
    block = bench.scratch / "simulated"
    made = run([bench.rilievo, "simulate", "--images", "12", "--width-px", "4000", "--height-px", "3000", "--noise", "0.005", "--output", block])
    rendered_s = made.cpu_s / 12
    print(f"  12 images of 12 Mpx rendered in {made.wall_s:.1f} s wall, {rendered_s:.1f} CPU s an image")
    workspace, done = bench.orient("simulated-12", block / "images", block / "calibration.toml")
    report = bench.report(workspace, "--truth", block / "scene.json")
    truth = report["truth"] if report else None
    bench.figures.at_least("simulated 12 x 12 Mpx: images oriented", bench.oriented_in_one(workspace), "", 12)
    bench.figures.at_least("simulated 12 x 12 Mpx: distance : mean centre error", truth and 1 / truth["mean_centre_error_relative"], "1:N", 20000)
    bench.figures.add("simulated 12 x 12 Mpx: points with reported error", truth and truth["points"], "", "all",
                      truth is not None and truth["points"] == sum(m["points"] for m in report["models"]))
    if truth:
        print("  " + json.dumps({k: v for k, v in truth.items() if not isinstance(v, (list, dict))}))
    print(f"  orientation {done.wall_s:.1f} s wall, peak {done.peak_bytes / 2**30:.2f} GiB")


def small_block(bench):
    block = bench.scratch / "small"
    run([bench.rilievo, "simulate", "--images", "8", "--width-px", "1500", "--height-px", "1000", "--output", block])
    return block


def reproducible(bench):
    """Byte-identical exports of fresh workspaces with 1 and 2 threads, on every block at hand."""
    blocks = [("simulated", small_block(bench) / "images", bench.scratch / "small" / "calibration.toml")]
    fountain = bench.data / "strecha" / "fountain-P11" / "images"
    if fountain.is_dir():
        blocks.append(("fountain-P11", fountain, fountain / "K.txt"))
    for name, images, calibration in blocks:
        exports = []
        for threads in ("1", "2"):
            workspace, _ = bench.orient(f"threads-{threads}-{name}", images, calibration, "--threads", threads)
            files = {}
            for form in ("colmap-text", "colmap-binary", "bundler", "ply"):
                output = bench.scratch / f"threads-{threads}-{name}-{form}"
                run([bench.rilievo, "export", workspace, "--format", form, "--output", output])
                files.update({f"{form}/{k}": v for k, v in files_of(output).items()})
            exports.append(files)
        differ = sum(1 for k in set(exports[0]) | set(exports[1]) if exports[0].get(k) != exports[1].get(k))
        bench.figures.add(f"{name}: export files that differ, threads 1 and 2", differ, "files", "0 of >= 4", differ == 0 and len(exports[0]) >= 4)


def killed(bench):
    """kill -9 at 10 random moments of a run, then the same command: identical exports, nothing finished made again."""
    block = bench.scratch / "small"
    images, calibration = block / "images", block / "calibration.toml"
    workspace, done = bench.orient("kill-reference", images, calibration)
    reference = files_of(bench.export(workspace, "kill-reference"))
    draw = random.Random(20101)
    differ = recomputed = interrupted = 0
    for trial in range(10):
        workspace = bench.scratch / f"kill-{trial}"
        command = [bench.rilievo, "orient", images, "--calibration", calibration, "--workspace", workspace, "--memory", "4GiB", "--quiet"]
        interrupted += run(command, kill_after_s=draw.uniform(0.02, 0.95) * done.wall_s).code == -9
        before = artifacts_of(workspace)
        run(command)
        after = artifacts_of(workspace)
        recomputed += sum(1 for name, state in before.items() if after.get(name) != state)
        differ += files_of(bench.export(workspace, f"kill-{trial}")) != reference
    bench.figures.add("kill -9 at 10 random moments: runs that were interrupted", interrupted, "runs", ">= 8", interrupted >= 8)
    bench.figures.at_most("kill -9 at 10 random moments: exports that differ", differ, "runs", 0)
    bench.figures.at_most("kill -9 at 10 random moments: finished artifacts recomputed", recomputed, "files", 0)


def peaks(bench):
    worst = max(bench.peaks, key=bench.peaks.get)
    bench.figures.at_most(f"peak resident memory of all runs, --memory 4GiB ({worst})", bench.peaks[worst] / 2**30, "GiB", 4)


def colmap_wall_s(images, k_file, scratch):
    k = [float(x) for x in k_file.read_text().split()]
    params = f"{k[0]},{k[4]},{k[2]},{k[5]}"
    database, sparse = scratch / "colmap.db", scratch / "colmap"
    sparse.mkdir()
    env = dict(os.environ, QT_QPA_PLATFORM="offscreen")
    wall_s = 0
    for command in (
        ["feature_extractor", "--database_path", database, "--image_path", images, "--ImageReader.single_camera", "1", "--ImageReader.camera_model", "PINHOLE",
         "--ImageReader.camera_params", params, "--SiftExtraction.use_gpu", "0", "--SiftExtraction.max_image_size", "100000", "--SiftExtraction.num_threads", "2"],
        ["exhaustive_matcher", "--database_path", database, "--SiftMatching.use_gpu", "0", "--SiftMatching.num_threads", "2"],
        ["mapper", "--database_path", database, "--image_path", images, "--output_path", sparse, "--Mapper.num_threads", "2",
         "--Mapper.ba_refine_focal_length", "0", "--Mapper.ba_refine_principal_point", "0", "--Mapper.ba_refine_extra_params", "0"],
    ):
        done = run(["colmap", *command], env=env)
        if done.code != 0:
            return None
        wall_s += done.wall_s
    return wall_s


def beside_colmap(bench):
    row, images = "fountain-P11: COLMAP 3.8 wall / ours, two cores", bench.data / "strecha" / "fountain-P11" / "images"
    if not images.is_dir():
        return bench.figures.skip(row, "x", ">= 3", "fountain-P11 is absent")
    if not shutil.which("colmap"):
        return bench.figures.skip(row, "x", ">= 3", "colmap is not installed (scripts/setup --peers)")
    # COLMAP takes every file of its image folder for an image: give it the photographs alone.
    photographs = bench.scratch / "colmap-images"
    photographs.mkdir()
    for path in images.glob("*.jpg"):
        (photographs / path.name).symlink_to(path)
    ours_s = min(bench.orient(f"fountain-timed-{k}", images, images / "K.txt", "--threads", "2")[1].wall_s for k in range(2))
    theirs_s = colmap_wall_s(photographs, images / "K.txt", bench.scratch)
    if theirs_s is None:
        return bench.figures.skip(row, "x", ">= 3", "colmap failed")
    print(f"  fountain-P11: ours {ours_s:.1f} s, COLMAP {theirs_s:.1f} s")
    bench.figures.at_least(row, theirs_s / ours_s, "x", 3)


def engine_overhead(bench):
    done = subprocess.run([bench.binaries / "bench_engine", "--benchmark_format=json", "--benchmark_filter=100k", "--benchmark_repetitions=5"],
                          capture_output=True, text=True, check=True)
    times = {entry["run_name"]: entry["real_time"] for entry in json.loads(done.stdout)["benchmarks"] if entry.get("aggregate_name") == "median"}
    ours = next(v for k, v in times.items() if re.match(r"BM_FlowExecutor100k(/|$)", k))
    bare = next(v for k, v in times.items() if re.match(r"BM_TaskGroup100k(/|$)", k))
    print("  " + json.dumps(times))
    bench.figures.add("engine: 100,000 empty tasks, time / bare tbb::task_group", ours / bare, "x", "< 10", ours / bare < 10)


def measure(figures, binaries, data, full):
    del full  # every figure of this issue is quick enough
    bench = Bench(figures, binaries, data)
    try:
        for part in (strecha, other_sets, simulated, reproducible, killed, beside_colmap, peaks, engine_overhead):
            part(bench)
    finally:
        shutil.rmtree(bench.scratch, ignore_errors=True)
