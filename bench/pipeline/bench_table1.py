"""The paper's Table I, k-d tree against m2, rerun beside its own figures; and what wins for more features than it had."""
import json
import os
import pathlib

from program import run

# Image size, features of the two images, matches and seconds of the k-d tree, matches and seconds of m2. Row 4 of the
# ten is left out: its m2 time is damaged in print (SPEC 1.3).
PAPER = [((640, 480), (1391, 1405), (262, 1.69), (328, 2.78)), ((720, 576), (342, 314), (28, 1.33), (25, 1.38)),
         ((1500, 1004), (5636, 5017), (349, 5.74), (419, 19.09)), ((2560, 1920), (18329, 16816), (741, 36.55), (1135, 442.3)),
         ((2816, 2112), (23080, 22806), (1204, 39.22), (1690, 465.4)), ((3072, 2304), (21343, 20691), (2018, 59.11), (2936, 698)),
         ((3872, 2592), (43211, 40858), (1716, 64.28), (2385, 1633)), ((4500, 3000), (83729, 87471), (19336, 161.6), (27772, 7900)),
         ((5616, 3744), (94208, 127359), (25968, 338.5), (34230, 22580))]
CHECKS = 256
MOST_EXACT = 6000  # an exact search in 128 dimensions compares nearly all, slowly
STRECHA = pathlib.Path("strecha")
# First and second images of pairs; more of them are pooled for more features: 100,000 is what one image of 6.3 Mpx has.
PAIRS = [("fountain-P11/images/0005.jpg", "fountain-P11/images/0006.jpg"), ("entry-P10/images/0004.jpg", "entry-P10/images/0005.jpg"),
         ("fountain-P11/images/0000.jpg", "fountain-P11/images/0001.jpg"), ("entry-P10/images/0008.jpg", "entry-P10/images/0009.jpg")]
LARGE = [(40_000, 1, 1.5), (100_000, 1, 3), (200_000, 2, 5), (400_000, 4, 8)]
VISITS = "12"  # the option's default
KD_RECALL = 0.98


def avx512():
    flags = next((line for line in open("/proc/cpuinfo") if line.startswith("flags")), "")
    return "avx512_vnni" in flags.split()


class Bench:
    def __init__(self, figures, binaries, data):
        self.figures, self.data, self.program = figures, data, binaries / "matching_eval"

    def evaluate(self, *arguments):
        """What matching_eval prints; RuntimeError with its own words when it fails."""
        environment = {k: v for k, v in os.environ.items() if k != "RILIEVO_KERNELS"}
        done = run([self.program, *arguments], env=environment)
        if done.code != 0:
            raise RuntimeError(f"matching_eval {arguments[0]} ended with {done.code}: {' '.join(done.err.split())}")
        return json.loads(done.out)

    def inform(self, name, value, unit, bar):
        """A figure that is worth knowing and has no bar: it holds once it is measured."""
        self.figures.add(name, value, unit, bar, True)


def table_rows(row):
    (width, height), (features_a, features_b), (kd_matches, kd_s), (m2_matches, m2_s) = row
    label = f"{width}x{height}"
    rows = [(f"{label}: kd-tree matches among m2's / m2's", "", ">= 0.9"), (f"{label}: m2 matches / kd-tree matches", "x", f">= 1 (paper {m2_matches / kd_matches:.2f})"),
            (f"{label}: kd-tree CPU / m2 CPU", "x", f"> 1 (paper {kd_s / m2_s:.2f})" if avx512() else f"none (paper {kd_s / m2_s:.2f})"),
            (f"{label}: kd-tree", "s", f"none (paper {kd_s:g})"), (f"{label}: m2", "s", f"none (paper {m2_s:g})")]
    if max(features_a, features_b) <= MOST_EXACT:
        rows.append((f"{label}: exact kd-tree, matches that differ from m2's", "", "0"))
    return rows


def table_row(bench, row):
    (width, height), (features_a, features_b), (paper_kd, paper_kd_s), (paper_m2, paper_m2_s) = row
    exact = max(features_a, features_b) <= MOST_EXACT
    result = bench.evaluate("row", width, height, features_a, features_b, CHECKS, *(["exact"] if exact else []))
    kd, m2, auto = result["kd_tree"], result["m2"], result["auto"]
    print(f"  {width}x{height}: features {result['features_a']} {result['features_b']} (paper {features_a} {features_b}); "
          f"kd-tree {kd['matches']} matches, recall {100 * kd['recall']:.1f} %, {100 * kd['extra']:.2f} % not in m2, {kd['cpu_s']:.4g} s (paper {paper_kd}, "
          f"{100 * paper_kd / paper_m2:.0f} %, {paper_kd_s:g} s); m2 {m2['matches']} matches, {m2['cpu_s']:.4g} s (paper {paper_m2}, {paper_m2_s:g} s); "
          f"auto recall {100 * auto['recall']:.2f} %, {auto['cpu_s']:.4g} s")
    if min(result["features_a"] / features_a, result["features_b"] / features_b) < 0.9:
        raise RuntimeError(f"the images have {result['features_a']} and {result['features_b']} features only")
    rows, slower = table_rows(row), kd["cpu_s"] / m2["cpu_s"]
    bench.figures.at_least(rows[0][0], kd["recall"], "", 0.9)
    more = m2["matches"] / max(1, kd["matches"])
    bench.figures.add(*row_of(rows[1], more), more >= 1)
    bench.figures.add(*row_of(rows[2], slower), slower > 1 or not avx512())
    bench.inform(*row_of(rows[3], kd["cpu_s"]))
    bench.inform(*row_of(rows[4], m2["cpu_s"]))
    if exact:
        both = result["kd_tree_exact"]
        differ = m2["matches"] - round(both["recall"] * m2["matches"]) + round(both["extra"] * m2["matches"])
        bench.figures.add(rows[5][0], differ, "", "0", differ == 0)


def row_of(row, value):
    name, unit, bar = row
    return name, value, unit, bar


def large_rows(count, least):
    label = f"{count // 1000}k x {count // 1000}k"
    return [(f"{label}: cells' matches among m2's / m2's", "", ">= 0.98"), (f"{label}: cells' matches that m2 has not / m2's", "", "<= 0.01"),
            (f"{label}: m2 CPU / cells CPU", "x", f">= {least:g}"), (f"{label}: m2 CPU / kd-tree CPU where it finds {KD_RECALL:g}", "x", "none"),
            (f"{label}: m2", "s", "none"), (f"{label}: cells", "s", "none")]


def large(bench, count, pairs, least):
    rows = large_rows(count, least)
    images = [bench.data / STRECHA / image for pair in PAIRS[:pairs] for image in pair]
    if not all(image.is_file() for image in images):
        for name, unit, bar in rows:
            bench.figures.skip(name, unit, bar, f"{STRECHA} is absent")
        return
    result = bench.evaluate("large", count, *images)
    m2, cells = result["m2"], result["cells"][VISITS]
    print(f"  features {result['features_a']} {result['features_b']}, {pairs} pairs of photographs pooled; m2 {m2['matches']} matches, {m2['cpu_s']:.3f} s")
    for name, way, entry in [(name, way, entry) for name in ("cells", "kd_tree") for way, entry in sorted(result[name].items(), key=lambda item: int(item[0]))]:
        print(f"    {name} {way:>4}: recall {100 * entry['recall']:.2f} %, not in m2 {100 * entry['extra']:.2f} %, {entry['cpu_s']:.3f} s, m2 / it {m2['cpu_s'] / entry['cpu_s']:.2f}")
    if min(result["features_a"], result["features_b"]) < 0.9 * count:
        raise RuntimeError(f"the photographs have {result['features_a']} and {result['features_b']} features only")
    bench.figures.at_least(rows[0][0], cells["recall"], "", 0.98)
    bench.figures.at_most(rows[1][0], cells["extra"], "", 0.01)
    bench.figures.at_least(rows[2][0], m2["cpu_s"] / cells["cpu_s"], "x", least)
    good = [entry for entry in result["kd_tree"].values() if entry["recall"] >= KD_RECALL]
    bench.inform(rows[3][0], max(m2["cpu_s"] / entry["cpu_s"] for entry in good) if good else None, "x", "none" if good else "none: not with the checks tried")
    bench.inform(*row_of(rows[4], m2["cpu_s"]))
    bench.inform(*row_of(rows[5], cells["cpu_s"]))


def measure(figures, binaries, data, full):
    del full  # a quarter of an hour in all
    bench = Bench(figures, binaries, data)
    for row in PAPER:
        figures.measure(table_rows(row), lambda: table_row(bench, row))
    for count, pairs, least in LARGE:
        figures.measure(large_rows(count, least), lambda: large(bench, count, pairs, least))
