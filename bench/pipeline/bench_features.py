"""The figures of "Features at the limit"."""
import json
import os
import pathlib
import random
import re
import shutil
import sqlite3
import sys
import tempfile

from program import run

PHOTOGRAPH = pathlib.Path("strecha/fountain-P11/images/0005.jpg")  # 6.3 Mpx
SCALING_PHOTOGRAPHS = [pathlib.Path(f"strecha/fountain-P11/images/{name}.jpg") for name in ("0000", "0005", "0010")]
GIB = 2**30


def last_line(text):
    return text.strip().splitlines()[-1] if text.strip() else "no message"


def processor_has(flag):
    return flag in next((line for line in open("/proc/cpuinfo") if line.startswith("flags")), "").split()


class Bench:
    def __init__(self, figures, binaries, data):
        self.figures, self.binaries, self.data = figures, binaries, data
        self.rilievo = binaries / "rilievo"
        self.scratch = pathlib.Path(tempfile.mkdtemp(prefix="rilievo-bench-"))
        self.speeds = {}
        self.obeys = None

    def evaluate(self, *arguments, kernels=None):
        """What features_eval prints; RuntimeError with its own words when it fails."""
        environment = {k: v for k, v in os.environ.items() if k != "RILIEVO_KERNELS"}
        if kernels:
            environment["RILIEVO_KERNELS"] = kernels
        done = run([self.binaries / "features_eval", *arguments], env=environment)
        if done.code != 0:
            raise RuntimeError(f"features_eval {arguments[0]} ended with {done.code}: {last_line(done.err)}")
        return json.loads(done.out)

    def require_kernels_obeyed(self, image):
        """A stage that ignores RILIEVO_KERNELS would make every comparison of kernels hold: it must refuse an unknown name."""
        if self.obeys is None:
            try:
                self.evaluate("speed", image, "1", kernels="no-such-kernel")
                self.obeys = False
            except RuntimeError as error:
                # Only a refusal that names the variable counts, not any other failure.
                self.obeys = "RILIEVO_KERNELS" in str(error)
        if not self.obeys:
            raise RuntimeError("the features stage does not obey RILIEVO_KERNELS")

    def speed(self, image, kernels=None):
        if kernels not in self.speeds:
            if kernels:
                self.require_kernels_obeyed(image)
            self.speeds[kernels] = self.evaluate("speed", image, "7", kernels=kernels)
        return self.speeds[kernels]

    def skip_rows(self, rows, reason):
        for name, unit, bar in rows:
            self.figures.skip(name, unit, bar, reason)


def photograph(bench, rows):
    """The 6.3 Mpx photograph, or none with its rows skipped."""
    path = bench.data / PHOTOGRAPH
    if path.is_file():
        return path
    bench.skip_rows(rows, f"{PHOTOGRAPH} is absent")
    return None


SIFT_ROWS = [("SIFT 6.3 Mpx: OpenCV CPU / ours, no fewer features", "x", ">= 4")]


def sift_speed(bench):
    image = photograph(bench, SIFT_ROWS)
    if image is None:
        return
    speed = bench.speed(image)
    ours, peer = speed["ours"], speed["opencv"]
    for name, entry in (("ours", ours), ("OpenCV", peer), ("OpenCV detect", speed["opencv_detect"])):
        print(f"  {name}: {1000 * entry['cpu_s_per_mpx']:.1f} ms/Mpx, {entry['features']} features, slowest / fastest {entry['slowest_over_fastest']:.2f}")
    if ours["features"] < peer["features"]:
        raise RuntimeError(f"ours finds {ours['features']} features, OpenCV {peer['features']}")
    bench.figures.at_least(SIFT_ROWS[0][0], peer["cpu_s"] / ours["cpu_s"], "x", 4)


def extrema_rows(label, least):
    return [(f"scale space + extrema: OpenCV detect / ours, {label}", "x", f">= {least:g}")]


def extrema_speed(bench, label, kernels, flag, least):
    """OpenCV's detect computes orientations too; a count of extrema has none, so its number is not compared."""
    rows = extrema_rows(label, least)
    if not processor_has(flag):
        return bench.skip_rows(rows, f"this processor has no {label}")
    image = photograph(bench, rows)
    if image is None:
        return
    speed = bench.speed(image, kernels)
    if speed["ours_extrema"] is None:
        raise RuntimeError("the stage has no entry for its scale space and extrema alone")
    if speed["ours_extrema"]["features"] < 0.5 * speed["opencv_detect"]["features"]:
        raise RuntimeError("ours finds less than half as many extrema as OpenCV keypoints")
    print(f"  {label}: {1000 * speed['ours_extrema']['cpu_s_per_mpx']:.1f} ms/Mpx, {speed['ours_extrema']['features']} extrema; "
          f"OpenCV detect {1000 * speed['opencv_detect']['cpu_s_per_mpx']:.1f} ms/Mpx, {speed['opencv_detect']['features']} keypoints")
    bench.figures.at_least(rows[0][0], speed["opencv_detect"]["cpu_s"] / speed["ours_extrema"]["cpu_s"], "x", least)


SURF_ROWS = [("SURF-128 6.3 Mpx: our SIFT CPU / SURF CPU, no fewer features", "x", ">= 2")]


def surf_speed(bench):
    image = photograph(bench, SURF_ROWS)
    if image is None:
        return
    speed = bench.speed(image)
    if speed["ours_surf128"] is None:
        raise RuntimeError("the stage has no SURF-128")
    sift, surf = speed["ours"], speed["ours_surf128"]
    print(f"  SURF-128: {1000 * surf['cpu_s_per_mpx']:.1f} ms/Mpx, {surf['features']} features")
    if surf["features"] < sift["features"]:
        raise RuntimeError(f"SURF finds {surf['features']} features, SIFT {sift['features']}")
    bench.figures.at_least(SURF_ROWS[0][0], sift["cpu_s"] / surf["cpu_s"], "x", 2)


def colmap_extraction(bench, name, image, peak_threshold):
    """(CPU seconds, features) of one image, first octave -1, one thread."""
    folder, database = bench.scratch / f"colmap-{name}", bench.scratch / f"colmap-{name}.db"
    shutil.rmtree(folder, ignore_errors=True)
    database.unlink(missing_ok=True)
    folder.mkdir()
    (folder / image.name).symlink_to(image)
    done = run(["colmap", "feature_extractor", "--database_path", database, "--image_path", folder, "--SiftExtraction.use_gpu", "0", "--SiftExtraction.num_threads", "1",
                "--SiftExtraction.first_octave", "-1", "--SiftExtraction.max_image_size", "100000", "--SiftExtraction.max_num_features", "1000000",
                "--SiftExtraction.peak_threshold", peak_threshold],
               env=dict(os.environ, QT_QPA_PLATFORM="offscreen"))
    if done.code != 0:
        raise RuntimeError(f"colmap ended with {done.code}: {last_line(done.err)}")
    connection = sqlite3.connect(database)
    try:
        [(count,)] = connection.execute("SELECT SUM(rows) FROM keypoints").fetchall()
    finally:
        connection.close()
    return done.cpu_s, count or 0


COLMAP_ROWS = [("SIFT 6.3 Mpx: COLMAP 3.8 CPU / ours, no fewer features", "x", ">= 15")]


def beside_colmap(bench):
    """COLMAP's process less what it takes for a tiny image (its start, its database); ours with decoding."""
    image = photograph(bench, COLMAP_ROWS)
    if image is None:
        return
    if not shutil.which("colmap"):
        return bench.skip_rows(COLMAP_ROWS, "colmap is not installed (scripts/setup --peers)")
    ours = bench.speed(image)
    tiny = bench.scratch / "tiny.pgm"
    tiny.write_bytes(b"P5 64 64 255\n" + random.Random(1).randbytes(64 * 64))
    peak = 0.02 / 3  # COLMAP's own, the same contrast as ours; raised until it finds no more
    start_s = min(colmap_extraction(bench, "tiny", tiny, peak)[0] for _ in range(2))
    theirs_s, count = colmap_extraction(bench, "photograph", image, peak)
    while count > ours["ours"]["features"] and peak < 0.02:
        peak *= 1.1
        theirs_s, count = colmap_extraction(bench, "photograph", image, peak)
    theirs_s = min(theirs_s, colmap_extraction(bench, "photograph", image, peak)[0])
    ours_s = ours["ours"]["cpu_s"] + ours["decode_cpu_s"]
    print(f"  COLMAP: {theirs_s:.2f} CPU s, {count} features (peak threshold {peak:.5f}), of it {start_s:.2f} s for a tiny image; ours with decoding {ours_s:.2f} s")
    if not 0 < count <= ours["ours"]["features"]:
        raise RuntimeError(f"COLMAP finds {count} features, ours {ours['ours']['features']}")
    bench.figures.at_least(COLMAP_ROWS[0][0], (theirs_s - start_s) / ours_s, "x", 15)


SCALING_ROWS = [("two threads: scaling / that of an FMA loop", "x", ">= 0.95")]


def scaling(bench):
    images = [bench.data / path for path in SCALING_PHOTOGRAPHS]
    if not all(path.is_file() for path in images):
        return bench.skip_rows(SCALING_ROWS, "fountain-P11 is absent")
    if len(os.sched_getaffinity(0)) < 2:
        return bench.skip_rows(SCALING_ROWS, "this machine has one core")
    if not processor_has("fma"):
        return bench.skip_rows(SCALING_ROWS, "this processor has no FMA")
    result = bench.evaluate("scaling", *images)
    for name in ("ours", "fma"):
        print(f"  {name}: {result[name]['scaling']:.3f} times one thread (by CPU time {result[name]['scaling_by_cpu_time']:.3f})")
    # A machine that others use gives the loop less than two cores: then nothing can be said of ours.
    if result["fma"]["scaling"] < 1.5:
        raise RuntimeError(f"the FMA loop itself scales {result['fma']['scaling']:.2f} times: the second core is busy")
    bench.figures.at_least(SCALING_ROWS[0][0], result["ours"]["scaling"] / result["fma"]["scaling"], "x", 0.95)


MEMORY_ROWS = [("peak memory, one 100 Mpx image, --memory 1GiB", "GiB", "<= 1")]


def memory(bench):
    block = bench.scratch / "large"
    made = run([bench.rilievo, "simulate", "--images", "1", "--width-px", "11600", "--height-px", "8700", "--output", block])
    images = sorted((block / "images").glob("*.jpg"))
    if made.code != 0 or len(images) != 1:
        raise RuntimeError(f"simulate ended with {made.code}: {last_line(made.err)}")
    done = run([bench.rilievo, "features", images[0], "--memory", "1GiB", "--json"], cwd=bench.scratch)
    if done.code != 0:
        raise RuntimeError(f"rilievo features ended with {done.code}: {last_line(done.err)}")
    count = json.loads(done.out)["features"]
    if count < 1000:
        raise RuntimeError(f"rilievo features names {count} features")
    print(f"  {count} features, {done.cpu_s:.1f} CPU s, peak {done.peak_bytes / GIB:.3f} GiB; the image was made in {made.wall_s:.0f} s")
    bench.figures.at_most(MEMORY_ROWS[0][0], done.peak_bytes / GIB, "GiB", 1)


FEW = 100


def ratio_of_pair(ours, peer):
    """Of fewer than 100 one more or less is a per cent already: such a pair counts as equal while it is within a percentage point."""
    if peer["count"] < FEW and ours["share"] >= peer["share"] - 0.01:
        return 1.0
    return ours["share"] / peer["share"]


def oxford_rows(name):
    return [(f"{name}: repeatability / OpenCV's, worst of 5 pairs", "x", ">= 0.99"), (f"{name}: repeatability / OpenCV's, mean of 5 pairs", "x", "> 1"),
            (f"{name}: matching score / OpenCV's, worst of 5 pairs", "x", ">= 0.99"), (f"{name}: matching score / OpenCV's, mean of 5 pairs", "x", "> 1")]


def oxford(bench, name):
    """Each figure is the least over the ways of measuring it (README): none of them may be worse."""
    rows = oxford_rows(name)
    folder = bench.data / "oxford" / name
    if not (folder / "H1to6p").is_file():
        return bench.skip_rows(rows, f"oxford/{name} is absent")
    pairs = bench.evaluate("repeatability", folder)["pairs"]
    if len(pairs) != 5:
        raise RuntimeError(f"{len(pairs)} pairs instead of 5")
    for part, first_row in (("repeatability", 0), ("matching", 2)):
        worst, mean = [], []
        for way in pairs[0]["ours"][part]:
            ours, peer = ([pair[who][part][way] for pair in pairs] for who in ("ours", "opencv"))
            print(f"  {name} {part} ({way}), %: " + "; ".join(f"{pair['pair']} {100 * a['share']:.2f} / {100 * b['share']:.2f}" for pair, a, b in zip(pairs, ours, peer)))
            if sum(b["count"] >= FEW for b in peer) < 2:
                raise RuntimeError(f"{part} ({way}): OpenCV has {FEW} in fewer than two pairs")
            worst.append(min(ratio_of_pair(a, b) for a, b in zip(ours, peer)))
            mean.append(sum(a["share"] for a in ours) / sum(b["share"] for b in peer))
        bench.figures.at_least(rows[first_row][0], min(worst), "x", 0.99)
        bench.figures.add(rows[first_row + 1][0], min(mean), "x", "> 1", min(mean) > 1)


LOCALISATION_ROWS = [("localisation: RMS epipolar error / OpenCV's", "x", "<= 0.95"),
                     ("localisation: the same at equal numbers of matches", "x", "<= 0.95")]


def localisation(bench):
    result = bench.evaluate("localisation")
    for block in ("relief", "statue", "all"):
        for which in ("correct", "equal_number", "in_both"):
            ours, peer = result[block][which]["ours"], result[block][which]["opencv"]
            print(f"  {block}, {which}: ours {ours['epipolar_rms_px']:.4f} px ({ours['matches']} matches), "
                  f"OpenCV {peer['epipolar_rms_px']:.4f} px ({peer['matches']})")
    correct = result["all"]["correct"]
    if correct["opencv"]["matches"] < 1000:
        raise RuntimeError(f"OpenCV has {correct['opencv']['matches']} correct matches only")
    # Few matches would be accurate ones: as many, or the figure says nothing.
    if correct["ours"]["matches"] < 0.95 * correct["opencv"]["matches"]:
        raise RuntimeError(f"{correct['ours']['matches']} correct matches, OpenCV {correct['opencv']['matches']}")
    for (name, unit, _), which in zip(LOCALISATION_ROWS, ("correct", "equal_number")):
        both = result["all"][which]
        bench.figures.at_most(name, both["ours"]["epipolar_rms_px"] / both["opencv"]["epipolar_rms_px"], unit, 0.95)


TILE_WIDTHS = ("512", "1024", "4096", "whole")
IDENTITY_ROWS = [("identity: tiles 512, 1024, 4096, whole x threads 1, 2", "differ", "0 of 18"), ("identity: scalar, AVX2 x all of these", "differ", "0 of 40"),
                 ("identity: AVX2, AVX-512 x all of these", "differ", "0 of 40"), ("identity: features of all these that differ", "%", "<= 0.1")]


def wide_image(bench):
    """Wider than the widest tile."""
    made = run([bench.rilievo, "simulate", "--images", "1", "--width-px", "4800", "--height-px", "1300", "--format", "png", "--output", bench.scratch / "wide"])
    images = sorted((bench.scratch / "wide" / "images").glob("*.png"))
    if made.code != 0 or len(images) != 1:
        raise RuntimeError(f"simulate ended with {made.code}: {last_line(made.err)}")
    return images[0]


def identity_images(bench):
    """Twice the wide image where the photograph is absent: rendered scenes of two heights would tell no more."""
    path = bench.data / PHOTOGRAPH
    return [("photograph", path), ("wide", wide_image(bench))] if path.is_file() else [("wide", wide_image(bench))]


class Identity:
    """Variants and kernels of all images, each measured once."""

    def __init__(self, bench):
        self.bench, self.images, self.results, self.shares = bench, identity_images(bench), {}, []

    def result(self, label, kernels):
        if (label, kernels) not in self.results:
            image = dict(self.images)[label]
            dump = self.bench.scratch / f"{label}-{kernels}.dump"
            self.results[label, kernels] = (self.bench.evaluate("identity", image, dump, kernels=kernels), dump)
        return self.results[label, kernels]

    def tiles(self):
        differ, compared = 0, 0
        for label, _ in self.images:
            variants = self.result(label, None)[0]["variants"]
            for tiles in ("own",) + TILE_WIDTHS:
                for threads in (1, 2):
                    [variant] = [v for v in variants if (v["tiles"], v["threads"]) == (tiles, threads)]
                    if variant["hash"] is None:
                        raise RuntimeError("the stage cannot be told the width of its tiles")
                    self.add(f"{label} tiles {tiles}, {threads} threads", variant["differing_share"])
                    compared += 1
                    differ += variant["hash"] != variants[0]["hash"]
        compared -= len(self.images)  # the first of each is the reference
        return differ, compared

    def kernels(self, first, second):
        self.bench.require_kernels_obeyed(self.images[0][1])
        hashes = []
        for label, _ in self.images:
            (a, dump_a), (b, dump_b) = self.result(label, first), self.result(label, second)
            of_image = [variant["hash"] for result in (a, b) for variant in result["variants"]]
            if None in of_image:
                raise RuntimeError("the stage cannot be told the width of its tiles")
            hashes += [h == of_image[0] for h in of_image]
            self.add(f"{label} {first} and {second}", self.bench.evaluate("compare", dump_a, dump_b)["differing_share"])
        return hashes.count(False), len(hashes)

    def add(self, what, share):
        self.shares.append(share)
        if share > 0:
            print(f"  {what}: {100 * share:.4f} % of the features differ", flush=True)


def identity(bench):
    rows = IDENTITY_ROWS
    measured = Identity(bench)
    complete = True
    for (name, unit, bar), flag, compare in ((rows[0], None, measured.tiles), (rows[1], "avx2", lambda: measured.kernels("scalar", "avx2")),
                                             (rows[2], "avx512f", lambda: measured.kernels("avx2", "avx512"))):
        if flag and not processor_has(flag):
            bench.figures.skip(name, unit, bar, f"this processor has no {flag}")
            continue
        try:
            differ, compared = compare()
        except RuntimeError as error:
            bench.figures.fail(name, unit, bar, str(error))
            complete = False
            continue
        bar = f"0 of {compared}"
        bench.figures.add(name, differ, unit, bar, differ == 0 and compared > 0)
    if not complete:
        raise RuntimeError("not all variants could be compared")
    bench.figures.at_most(rows[3][0], 100 * max(measured.shares), "%", 0.1)


def parts():
    """(what measures, its arguments, its rows of the table) in the order of measuring."""
    extrema = [(extrema_speed, case, extrema_rows(case[0], case[3])) for case in (("AVX-512", "avx512", "avx512f", 5.5), ("AVX2", "avx2", "avx2", 3))]
    return [(sift_speed, (), SIFT_ROWS), (beside_colmap, (), COLMAP_ROWS), *extrema, (surf_speed, (), SURF_ROWS), (scaling, (), SCALING_ROWS), (memory, (), MEMORY_ROWS),
            *[(oxford, (name,), oxford_rows(name)) for name in ("graf", "boat")], (localisation, (), LOCALISATION_ROWS), (identity, (), IDENTITY_ROWS)]


def measure(figures, binaries, data, full):
    del full  # every figure of this issue is quick enough
    bench = Bench(figures, binaries, data)
    try:
        for part, arguments, rows in parts():
            figures.measure(rows, lambda: part(bench, *arguments))
            sys.stdout.flush()
    finally:
        shutil.rmtree(bench.scratch, ignore_errors=True)
