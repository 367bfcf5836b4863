"""The figures of "Matching, verification and pair scheduling at the limit"."""
import json
import os
import pathlib
import shutil
import sqlite3
import sys

import bench_orient
import matching_guided
import matching_verification
from program import run

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "accuracy"))
from poses import centre_errors, read_colmap_images, read_strecha_centres  # noqa: E402

STRECHA = (("fountain-P11", 11, 2.7), ("entry-P10", 10, 6.5))
KERNELS = (("avx512", "AVX-512 VNNI", "avx512_vnni", 0.8), ("avx2", "AVX2", "avx2", 0.75))
SIZES = ((8192, 12), (40960, 3))
PEERS = (("opencv", "cv::BFMatcher", 8192, {"avx512": 50, "avx2": 14}), ("faiss", "Faiss IndexFlatL2", 8192, {"avx512": 12, "avx2": 3}),
         ("flann", "FLANN, 64 checks", 8192, {"avx512": 10, "avx2": 2.5}), ("flann", "FLANN, 64 checks", 40960, {"avx512": 5}))


def last_line(text):
    return text.strip().splitlines()[-1] if text.strip() else "no message"


def processor_has(flag):
    return flag in next((line for line in open("/proc/cpuinfo") if line.startswith("flags")), "").split()


def evaluate(bench, *arguments, **environment):
    """What m2_eval prints; RuntimeError with its own words when it fails. One thread in every library."""
    done = run([bench.binaries / "m2_eval", *arguments], env=dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", **environment))
    if done.code != 0:
        raise RuntimeError(f"m2_eval {arguments[0]} ended with {done.code}: {last_line(done.err)}")
    return json.loads(done.out)


def photographs(bench, names=("fountain-P11",)):
    return [path for name in names for path in sorted((bench.data / "strecha" / name / "images").glob("*.jpg"))]


# ---- exact matching ---------------------------------------------------------------------------------------------------


def peak_row(label, size, least):
    return (f"m2 {size} x {size}, {label}: share of the instruction's peak", "%", f">= {100 * least:g}")


def peer_row(label, peer, size, least):
    return (f"m2 {size} x {size}, {label}: {peer} CPU / ours", "x", f">= {least:g}")


def differ_row(label, size):
    return (f"m2 {size} x {size}, {label}: matches by sketches that differ from those of the whole tables", "", "<= 0")


def m2_rows():
    rows = [differ_row(label, size) for size, _ in SIZES for _, label, _, _ in KERNELS]
    rows += [peak_row(label, size, least) for size, _ in SIZES for _, label, _, least in KERNELS]
    return rows + [peer_row(label, title, size, bars[kernel]) for _, title, size, bars in PEERS for kernel, label, _, _ in KERNELS if kernel in bars]


def m2(bench):
    """Real descriptors: features of neighbouring photographs on either side, pooled. Images are packed once (the time is printed), indices of the
    peers are built outside of their time. The share of the peak is that of the sweep that finds all neighbours both ways; beside the libraries
    stands the program's way to the same matches, which rules most of them out by sketches (decision 0014)."""
    images = photographs(bench)
    if not images:
        return bench.skip_rows(m2_rows(), "fountain-P11 is absent")
    measured = {size: evaluate(bench, "speed", str(size), str(repeats), *images)["kernels"] for size, repeats in SIZES}
    for size, _ in SIZES:
        for kernel, label, flag, least in KERNELS:
            row, differ = peak_row(label, size, least), differ_row(label, size)
            if not processor_has(flag):
                bench.skip_rows([row, differ], f"this processor has no {label}")
                continue
            entry = measured[size][kernel]
            print(f"  {label} {size}: tables of all neighbours {1000 * entry['cpu_s']:.1f} ms, {entry['gmacs_per_s']:.0f} of {entry['peak_gmacs_per_s']:.0f} GMAC/s; "
                  f"matches by sketches {1000 * entry['mutual_cpu_s']:.1f} ms, {entry['full_rows']} rows and {entry['full_columns']} columns in full; "
                  f"preparing {1000 * entry['pack_s_an_image']:.2f} ms an image")
            bench.figures.at_least(row[0], 100 * entry["share_of_peak"], "%", 100 * least)
            bench.figures.at_most(differ[0], entry["differ"], "", 0)
    for peer, title, size, bars in PEERS:
        rows = {kernel: peer_row(label, title, size, bars[kernel]) for kernel, label, _, _ in KERNELS if kernel in bars}
        bench.figures.measure(rows.values(), lambda: beside_peer(bench, peer, size, bars, rows, measured[size], images))


def beside_peer(bench, peer, size, bars, rows, ours, images):
    """The best of what the peer can be set to: bytes or floats for OpenCV, the core type of its BLAS for Faiss."""
    ways = {"opencv": [("opencv", {}), ("opencv-bytes", {})], "faiss": [("faiss", {}), ("faiss", {"OPENBLAS_CORETYPE": "SkylakeX"})], "flann": [("flann", {})]}[peer]
    results = []
    for name, environment in ways:
        try:
            results.append(evaluate(bench, "peer", name, str(size), "2", *images, **environment))
        except RuntimeError as error:
            if "no such peer" not in str(error):
                raise
            return bench.skip_rows(rows.values(), f"{peer} is not installed (scripts/setup --peers)")
    best = min(results, key=lambda result: result["cpu_s"])
    print(f"  {peer} {size}: {1000 * best['cpu_s']:.0f} ms both ways, {100 * best['recall']:.2f} % of our matches")
    for kernel, (row, unit, _) in rows.items():
        if kernel in ours:
            print(f"  beside the tables of all neighbours alone: {best['cpu_s'] / ours[kernel]['cpu_s']:.2f} x")
            bench.figures.at_least(row, best["cpu_s"] / ours[kernel]["mutual_cpu_s"], unit, bars[kernel])
        else:
            bench.figures.skip(row, unit, f">= {bars[kernel]:g}", "this processor has no such kernel")


SCALING_ROWS = [("pairs matched and verified, two threads: scaling / that of an FMA loop", "x", ">= 0.95")]


def scaling(bench):
    images = photographs(bench)[:6]
    if not images:
        return bench.skip_rows(SCALING_ROWS, "fountain-P11 is absent")
    if len(os.sched_getaffinity(0)) < 2 or not processor_has("fma"):
        return bench.skip_rows(SCALING_ROWS, "this machine has one core, or no FMA")
    result = evaluate(bench, "scaling", *images)
    for name in ("ours", "fma"):
        print(f"  {name}: {result[name]['scaling']:.3f} times one thread (by CPU time {result[name]['scaling_by_cpu_time']:.3f})")
    if result["fma"]["scaling"] < 1.5:
        raise RuntimeError(f"the FMA loop itself scales {result['fma']['scaling']:.2f} times: the second core is busy")
    bench.figures.at_least(SCALING_ROWS[0][0], result["ours"]["scaling"] / result["fma"]["scaling"], "x", 0.95)


# ---- beside COLMAP ------------------------------------------------------------------------------------------------------

FEATURES = "11000"
COLMAP_KEYPOINTS = "7700"  # its cap counts keypoints before further orientations: this many give some 11,000 features
COLMAP_ENV = dict(os.environ, QT_QPA_PLATFORM="offscreen")


def colmap(*arguments):
    done = run(["colmap", *arguments], env=COLMAP_ENV)
    if done.code != 0:
        raise RuntimeError(f"colmap {arguments[0]} ended with {done.code}: {last_line(done.err)}")
    return done


def folder_of(bench, name, images):
    """COLMAP takes every file of its image folder for an image: the photographs alone."""
    folder = bench.scratch / name
    folder.mkdir()
    for i, path in enumerate(images):
        (folder / f"{i:03}{path.suffix}").symlink_to(path)
    return folder


def colmap_features(folder, database, k_file, count):
    k = [float(x) for x in k_file.read_text().split()]
    return colmap("feature_extractor", "--database_path", database, "--image_path", folder, "--ImageReader.single_camera", "1", "--ImageReader.camera_model", "PINHOLE",
                  "--ImageReader.camera_params", f"{k[0]},{k[4]},{k[2]},{k[5]}", "--SiftExtraction.use_gpu", "0", "--SiftExtraction.max_image_size", "100000",
                  "--SiftExtraction.max_num_features", count, "--SiftExtraction.num_threads", "2")


def features_in(database):
    connection = sqlite3.connect(database)
    try:
        return connection.execute("SELECT SUM(rows), COUNT(rows) FROM keypoints").fetchone()
    finally:
        connection.close()


PAIRS_ROWS = [("25 images of 6.3 Mpx, 300 pairs: COLMAP 3.8 matcher CPU / ours", "x", ">= 25")]


def pairs_of_block(bench):
    """The photographs of both sets, filled up with rendered ones to 25; ours is the CPU time of all tasks of a run that load, match and verify,
    from its trace. Both have about 11,000 features an image."""
    images = photographs(bench, ("fountain-P11", "entry-P10"))
    if not images:
        return bench.skip_rows(PAIRS_ROWS, "fountain-P11 and entry-P10 are absent")
    if not shutil.which("colmap"):
        return bench.skip_rows(PAIRS_ROWS, "colmap is not installed (scripts/setup --peers)")
    block = bench.scratch / "rendered"
    bench.simulate(block, "--images", str(25 - len(images)), "--width-px", "3072", "--height-px", "2048")
    folder = folder_of(bench, "twenty-five", images + sorted((block / "images").glob("*.jpg")))
    k_file = images[0].parent / "K.txt"
    trace, workspace = bench.scratch / "pairs-trace.json", bench.scratch / "twenty-five-ours"
    done = run([bench.rilievo, "orient", folder, "--calibration", k_file, "--workspace", workspace, "--max-features", FEATURES, "--until", "pairs", "--trace", trace,
                "--progress", "plain"])
    if done.code != 0:
        raise RuntimeError(f"our matching ended with {done.code}: {last_line(done.err)}")
    spans = [event for event in json.loads(trace.read_text())["traceEvents"] if event.get("ph") == "X" and event["cat"] in ("pairs", "blocks")]
    ours_s = sum(event["args"]["cpu_s"] for event in spans)
    database = bench.scratch / "twenty-five.db"
    colmap_features(folder, database, k_file, COLMAP_KEYPOINTS)
    rows, count = features_in(database)
    if rows > 1.05 * int(FEATURES) * count:
        raise RuntimeError(f"COLMAP has {rows / count:.0f} features an image, ours {FEATURES}")
    theirs = colmap("exhaustive_matcher", "--database_path", database, "--SiftMatching.use_gpu", "0", "--SiftMatching.num_threads", "2")
    print(f"  300 pairs: ours {ours_s:.2f} CPU s in {len(spans)} tasks, COLMAP {theirs.cpu_s:.1f} CPU s ({rows / count:.0f} features an image)")
    bench.figures.at_least(PAIRS_ROWS[0][0], theirs.cpu_s / ours_s, "x", 25)


def whole_rows(name, count, limit_mm):
    return [(f"{name}, {FEATURES} features: COLMAP 3.8 wall / ours, two cores", "x", ">= 14"), (f"{name}, {FEATURES} features: images oriented", "", f">= {count}"),
            (f"{name}, {FEATURES} features: mean centre error", "mm", f"<= {limit_mm:g}")]


def whole(bench, name, count, limit_mm):
    """Whole orientations, both from the photographs in fresh workspaces, one after the other."""
    rows = whole_rows(name, count, limit_mm)
    images = photographs(bench, (name,))
    if not images:
        return bench.skip_rows(rows, f"{name} is absent")
    k_file = images[0].parent / "K.txt"
    workspace, ours = bench.orient(f"{name}-whole", images[0].parent, k_file, "--threads", "2", "--max-features", FEATURES)
    report = bench.report(workspace)
    fewest = min(image["features"] for image in report["image_list"]) if report else 0
    bench.figures.at_least(rows[1][0], bench.oriented_in_one(workspace), "", count)
    text = bench.export(workspace, f"{name}-whole") / "images.txt"
    errors = centre_errors({n: c for n, (_, c) in read_colmap_images(text).items()}, read_strecha_centres(images[0].parent.parent / "gt_dense_cameras"))
    bench.figures.at_most(rows[2][0], 1000 * sum(errors.values()) / len(errors) if len(errors) == count else None, "mm", limit_mm)
    if fewest < 10000:
        raise RuntimeError(f"an image has {fewest} features only")
    if not shutil.which("colmap"):
        return bench.skip_rows(rows[:1], "colmap is not installed (scripts/setup --peers)")
    folder = folder_of(bench, f"{name}-colmap", images)
    scratch = bench.scratch / f"{name}-colmap-run"
    scratch.mkdir()
    theirs_s = bench_orient.colmap_wall_s(folder, k_file, scratch)
    if theirs_s is None:
        raise RuntimeError("colmap failed")
    print(f"  {name}: ours {ours.wall_s:.2f} s wall ({ours.cpu_s:.1f} CPU s), at least {fewest} features an image; COLMAP {theirs_s:.1f} s")
    bench.figures.at_least(rows[0][0], theirs_s / ours.wall_s, "x", 14)


def parts():
    """(what measures, its arguments, its rows of the table) in the order of measuring."""
    return [(m2, (), m2_rows()), (scaling, (), SCALING_ROWS), (matching_verification.measure, (), matching_verification.ROWS), (pairs_of_block, (), PAIRS_ROWS),
            *[(whole, case, whole_rows(*case)) for case in STRECHA], (matching_guided.measure, (), matching_guided.ROWS)]


def measure(figures, binaries, data, full):
    del full  # every figure of this issue is quick enough
    bench = bench_orient.Bench(figures, binaries, data)
    try:
        for part, arguments, rows in parts():
            figures.measure(rows, lambda: part(bench, *arguments))
            sys.stdout.flush()
    finally:
        shutil.rmtree(bench.scratch, ignore_errors=True)
