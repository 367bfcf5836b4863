"""The figures of "Orient real photographs end to end"."""
import json
import os
import pathlib
import random
import re
import shutil
import signal
import sys
import tempfile

from program import artifacts_of, files_of, run

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "accuracy"))
from poses import centre_errors, read_colmap_images, read_strecha_centres  # noqa: E402


def last_line(text):
    return text.strip().splitlines()[-1] if text.strip() else ""


class Bench:
    def __init__(self, figures, binaries, data):
        self.figures, self.binaries, self.data = figures, binaries, data
        self.rilievo = binaries / "rilievo"
        self.scratch = pathlib.Path(tempfile.mkdtemp(prefix="rilievo-bench-"))
        self.peaks = {}

    def orient(self, name, images, calibration, *options, kill_after_s=None):
        """Runs in the workspace of that name (again, when it is there); returns (workspace, run)."""
        workspace = self.scratch / name
        done = run([self.rilievo, "orient", images, "--calibration", calibration, "--workspace", workspace, "--memory", "4GiB", "--progress", "plain", *options],
                   kill_after_s=kill_after_s)
        self.peaks[name] = max(self.peaks.get(name, 0), done.peak_bytes)
        if done.code != 0 and kill_after_s is None:
            print(f"  {name}: exit code {done.code}: {last_line(done.err)}", file=sys.stderr)
        return workspace, done

    def simulate(self, output, *options):
        done = run([self.rilievo, "simulate", *options, "--output", output])
        if done.code != 0:
            raise RuntimeError(f"simulate ended with {done.code}: {last_line(done.err)}")
        return done

    def skip_rows(self, rows, reason):
        for name, unit, bar in rows:
            self.figures.skip(name, unit, bar, reason)

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


def strecha(bench, name, count, limit_mm):
    folder = bench.data / "strecha" / name
    if not (folder / "images").is_dir():
        return bench.skip_rows(strecha_rows(name, count, limit_mm), f"{name} is absent")
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


def strecha_rows(name, count, limit_mm):
    return [(f"{name}: images oriented", "", f">= {count}"), (f"{name}: mean centre error", "mm", f"<= {limit_mm:g}"),
            (f"{name}: fx - fy as calibrated", "px", "!= 0")]


def real_set(bench, name, subfolder, calibration, least, order, network):
    folder = bench.data / name
    if not any((folder / subfolder).glob("*.[jpJP][pnPN][gG]")):
        return bench.skip_rows(real_set_rows(name, network, least), "its images are absent")
    options = ["--network", network] + (["--order", folder / order] if order and network == "sequence" else [])
    workspace, done = bench.orient(f"{name}-{network}", folder / subfolder, folder / calibration, *options)
    bench.figures.at_least(f"{name}: images oriented, {network}", bench.oriented_in_one(workspace), "", least)
    print(f"  {name} {network}: {done.wall_s:.1f} s wall, peak {done.peak_bytes / 2**30:.2f} GiB")


def real_set_rows(name, network, least):
    return [(f"{name}: images oriented, {network}", "", f">= {least}")]


def simulated(bench):
    block = bench.scratch / "simulated"
    made = bench.simulate(block, "--images", "12", "--width-px", "4000", "--height-px", "3000", "--noise", "0.005")
    rendered_s = made.cpu_s / 12
    print(f"  12 images of 12 Mpx rendered in {made.wall_s:.1f} s wall, {rendered_s:.1f} CPU s an image")
    workspace, done = bench.orient("simulated-12", block / "images", block / "calibration.toml")
    report = bench.report(workspace, "--truth", block / "scene.json")
    truth = report["truth"] if report else None
    bench.figures.at_least("simulated 12 x 12 Mpx: images oriented", bench.oriented_in_one(workspace), "", 12)
    bench.figures.at_least("simulated 12 x 12 Mpx: distance : mean centre error", truth and 1 / truth["mean_centre_error_relative"], "1:N", 20000)
    points = sum(model["points"] for model in report["models"]) if report else 0
    with_error, without = (truth["points_m"]["count"], truth["points_without_truth"]) if truth else (None, None)
    bench.figures.add("simulated 12 x 12 Mpx: points with reported error", with_error, "", "all",
                      truth is not None and points > 0 and with_error + without == points)
    bench.figures.at_most("simulated 12 x 12 Mpx: points without truth", 100 * without / points if truth and points else None, "%", 1)
    if truth:
        print("  " + json.dumps({k: v for k, v in truth.items() if not isinstance(v, (list, dict))}))
    print(f"  orientation {done.wall_s:.1f} s wall, peak {done.peak_bytes / 2**30:.2f} GiB")


SIMULATED_ROWS = [("simulated 12 x 12 Mpx: images oriented", "", ">= 12"), ("simulated 12 x 12 Mpx: distance : mean centre error", "1:N", ">= 20000"),
                  ("simulated 12 x 12 Mpx: points with reported error", "", "all"), ("simulated 12 x 12 Mpx: points without truth", "%", "<= 1")]


def small_block(bench):
    block = bench.scratch / "small"
    if not (block / "calibration.toml").exists():
        bench.simulate(block, "--images", "8", "--width-px", "1500", "--height-px", "1000")
    return block / "images", block / "calibration.toml"


def fountain_images(bench):
    images = bench.data / "strecha" / "fountain-P11" / "images"
    return images, images / "K.txt"


def reproducible(bench, name, block_of):
    """Byte-identical exports of fresh workspaces with 1 and 2 threads."""
    images, calibration = block_of(bench)
    if not images.is_dir():
        return bench.skip_rows(reproducible_rows(name), f"{name} is absent")
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
    [(row, unit, bar)] = reproducible_rows(name)
    bench.figures.add(row, differ, unit, bar, differ == 0 and len(exports[0]) >= 4)


def reproducible_rows(name):
    return [(f"{name}: export files that differ, threads 1 and 2", "files", "0 of >= 4")]


KILLED_ROWS = [("kill -9 at 10 random moments: runs that were interrupted", "runs", ">= 8"), ("kill -9 at 10 random moments: exports that differ", "runs", "<= 0"),
               ("kill -9 at 10 random moments: finished artifacts recomputed", "files", "<= 0")]


def killed(bench):
    """kill -9 at 10 random moments of a run, then the same command: identical exports, nothing finished made again."""
    images, calibration = small_block(bench)
    workspace, done = bench.orient("kill-reference", images, calibration)
    reference = files_of(bench.export(workspace, "kill-reference"))
    if not reference:
        raise RuntimeError("the run that is not killed gives no export")
    draw = random.Random(20101)
    differ = recomputed = interrupted = 0
    for trial in range(10):
        name = f"kill-{trial}"
        workspace, first = bench.orient(name, images, calibration, kill_after_s=draw.uniform(0.02, 0.95) * done.wall_s)
        interrupted += first.code == -signal.SIGKILL
        before = artifacts_of(workspace)
        bench.orient(name, images, calibration)
        after = artifacts_of(workspace)
        recomputed += sum(1 for artifact, state in before.items() if after.get(artifact) != state)
        differ += files_of(bench.export(workspace, name)) != reference
    bench.figures.at_least(KILLED_ROWS[0][0], interrupted, "runs", 8)
    bench.figures.at_most(KILLED_ROWS[1][0], differ, "runs", 0)
    bench.figures.at_most(KILLED_ROWS[2][0], recomputed, "files", 0)


PEAK_ROWS = [("peak resident memory of all orientations, --memory 4GiB", "GiB", "<= 4")]


def peaks(bench):
    worst = max(bench.peaks, key=bench.peaks.get)
    print(f"  highest peak: {worst}")
    bench.figures.at_most(PEAK_ROWS[0][0], bench.peaks[worst] / 2**30, "GiB", 4)


def colmap_camera(calibration):
    """(COLMAP's model, its parameters) of a K.txt, or of the first camera of a cameras.txt."""
    if calibration.name == "cameras.txt":
        _, model, _, _, *params = next(line for line in calibration.read_text().splitlines() if line and not line.startswith("#")).split()
        return model, ",".join(params)
    k = [float(x) for x in calibration.read_text().split()]
    return "PINHOLE", f"{k[0]},{k[4]},{k[2]},{k[5]}"


def colmap_wall_s(images, calibration, scratch):
    model, params = colmap_camera(calibration)
    database, sparse = scratch / "colmap.db", scratch / "colmap"
    sparse.mkdir()
    env = dict(os.environ, QT_QPA_PLATFORM="offscreen")
    wall_s = 0
    for command in (
        ["feature_extractor", "--database_path", database, "--image_path", images, "--ImageReader.single_camera", "1", "--ImageReader.camera_model", model,
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


COLMAP_ROWS = [("fountain-P11: COLMAP 3.8 wall / ours, two cores", "x", ">= 3")]


def beside_colmap(bench):
    """One run of each program, one after the other."""
    images, calibration = fountain_images(bench)
    if not images.is_dir():
        return bench.skip_rows(COLMAP_ROWS, "fountain-P11 is absent")
    if not shutil.which("colmap"):
        return bench.skip_rows(COLMAP_ROWS, "colmap is not installed (scripts/setup --peers)")
    # COLMAP takes every file of its image folder for an image: give it the photographs alone.
    photographs = bench.scratch / "colmap-images"
    photographs.mkdir()
    for path in images.glob("*.jpg"):
        (photographs / path.name).symlink_to(path)
    _, ours = bench.orient("fountain-timed", images, calibration, "--threads", "2")
    if ours.code != 0:
        raise RuntimeError("our orientation failed")
    theirs_s = colmap_wall_s(photographs, calibration, bench.scratch)
    if theirs_s is None:
        return bench.skip_rows(COLMAP_ROWS, "colmap failed")
    print(f"  fountain-P11: ours {ours.wall_s:.1f} s, COLMAP {theirs_s:.1f} s")
    bench.figures.at_least(COLMAP_ROWS[0][0], theirs_s / ours.wall_s, "x", 3)


ENGINE_ROWS = [("engine: 100,000 empty tasks, time / bare tbb::task_group", "x", "< 10")]


def engine_overhead(bench):
    done = run([bench.binaries / "bench_engine", "--benchmark_format=json", "--benchmark_filter=100k", "--benchmark_repetitions=5"])
    if done.code != 0:
        raise RuntimeError(f"bench_engine ended with {done.code}: {last_line(done.err)}")
    times = {entry["run_name"]: entry["real_time"] for entry in json.loads(done.out)["benchmarks"] if entry.get("aggregate_name") == "median"}
    ours = next(v for k, v in times.items() if re.match(r"BM_FlowExecutor100k(/|$)", k))
    bare = next(v for k, v in times.items() if re.match(r"BM_TaskGroup100k(/|$)", k))
    print("  " + json.dumps(times))
    bench.figures.add(ENGINE_ROWS[0][0], ours / bare, "x", "< 10", ours / bare < 10)


def parts():
    """(what measures, its arguments, its rows of the table) in the order of measuring."""
    all_parts = [(strecha, case, strecha_rows(*case)) for case in (("fountain-P11", 11, 2.7), ("entry-P10", 10, 6.5))]
    for name, subfolder, calibration, least, order in (("saharov32", ".", "cameras.txt", 32, None), ("temple47", ".", "K.txt", 45, "ordered_filenames.txt"),
                                                       ("cyprus10", "images", "cameras.txt", 10, None)):
        all_parts += [(real_set, (name, subfolder, calibration, least, order, network), real_set_rows(name, network, least)) for network in ("sparse", "sequence")]
    all_parts.append((simulated, (), SIMULATED_ROWS))
    all_parts += [(reproducible, (name, block_of), reproducible_rows(name)) for name, block_of in (("simulated", small_block), ("fountain-P11", fountain_images))]
    return all_parts + [(killed, (), KILLED_ROWS), (beside_colmap, (), COLMAP_ROWS), (peaks, (), PEAK_ROWS), (engine_overhead, (), ENGINE_ROWS)]


def measure(figures, binaries, data, full):
    del full  # every figure of this issue is quick enough
    bench = Bench(figures, binaries, data)
    try:
        for part, arguments, rows in parts():
            figures.measure(rows, lambda: part(bench, *arguments))
    finally:
        shutil.rmtree(bench.scratch, ignore_errors=True)
