"""Figures of pair selection: a guided ring beside all pairs, and a large block matched in little memory."""
import pathlib
import sys

from program import run

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "accuracy"))
from poses import centre_errors, read_colmap_images  # noqa: E402

RING, LARGE = "guided, ring of 300", "300 images x 20k features, --memory 1GiB"
ROWS = [
    (f"{RING}: pairs matched in full / true pairs", "x", "<= 1.3"),
    (f"{RING}: true edges lost", "edges", "<= 0"),
    (f"{RING}: |sigma0 - sigma0 of all pairs| / its sigma", "x", "<= 1"),
    (f"{RING}: largest difference of a centre / mean error", "x", "<= 1"),
    (f"{LARGE}: mean features", "", ">= 20000"),
    (f"{LARGE}: pairs matched", "", ">= 1000"),
    (f"{LARGE}: peak resident memory", "GiB", "<= 1"),
]


def true_edges(report):
    """Pairs that were verified with 30 inliers or more."""
    return {(p["first"], p["second"]) for p in report["pair_list"] if p["model"] != "rejected" and p["inliers"] >= 30}


def centres(bench, workspace, name):
    return {image: centre for image, (_, centre) in read_colmap_images(bench.export(workspace, name) / "images.txt").items()}


def guided_ring(bench):
    """Close to a sphere, so that an image overlaps its 20 neighbours on either side and no others. True edges are those of a run with
    all pairs; a projection centre's sigma is its mean error against the exact truth."""
    block = bench.scratch / "ring-300"
    bench.simulate(block, "--network", "ring", "--surface", "sphere", "--images", "300", "--width-px", "600", "--height-px", "600",
                   "--focal-px", "1050", "--distance-m", "1.7")
    workspaces, reports = {}, {}
    for network in ("guided", "sparse"):
        workspaces[network], done = bench.orient(f"ring-300-{network}", block / "images", block / "calibration.toml", "--network", network)
        reports[network] = bench.report(workspaces[network])
        if reports[network] is None:
            raise RuntimeError(f"{network}: not oriented")
        print(f"  ring of 300, {network}: {done.wall_s:.1f} s wall, {done.cpu_s:.1f} s CPU, {len(reports[network]['pair_list'])} pairs, "
              f"{len(true_edges(reports[network]))} true, {reports[network]['oriented']} images oriented")
    true = true_edges(reports["sparse"])
    bench.figures.at_most(ROWS[0][0], len(reports["guided"]["pair_list"]) / len(true), "x", 1.3)
    bench.figures.at_most(ROWS[1][0], len(true - true_edges(reports["guided"])), "edges", 0)
    guided, full = (reports[network]["models"][0] for network in ("guided", "sparse"))
    sigma = full["sigma0_px"] / (2 * full["redundancy"]) ** 0.5
    bench.figures.at_most(ROWS[2][0], abs(guided["sigma0_px"] - full["sigma0_px"]) / sigma, "x", 1)
    truth = {image: centre for image, (_, centre) in read_colmap_images(block / "truth" / "poses.txt").items()}
    all_pairs, few_pairs = (centres(bench, workspaces[network], f"ring-300-{network}") for network in ("sparse", "guided"))
    errors = centre_errors(all_pairs, truth).values()
    # In metres: the block of all pairs has been aligned with the truth by the same similarity.
    scale = distance_ratio(truth, all_pairs)
    differences = centre_errors(few_pairs, all_pairs).values()
    if len(differences) < len(truth):
        raise RuntimeError(f"only {len(differences)} of {len(truth)} images oriented in both")
    bench.figures.at_most(ROWS[3][0], max(differences) * scale / (sum(errors) / len(errors)), "x", 1)


def distance_ratio(first, second):
    """How many units of `first` one of `second` is, from the spread of their points."""
    def spread(points):
        mean = [sum(p[k] for p in points) / len(points) for k in range(3)]
        return (sum((p[k] - mean[k]) ** 2 for p in points for k in range(3)) / len(points)) ** 0.5

    names = sorted(set(first) & set(second))
    return spread([first[n] for n in names]) / spread([second[n] for n in names])


def large_block(bench):
    """Matched only: --until pairs. A strip, guided, so that a small share of the 44,850 pairs is compared; what a task holds is the same."""
    block = bench.scratch / "strip-300"
    bench.simulate(block, "--network", "strip", "--images", "300", *LARGE_OPTIONS)
    done = run([bench.rilievo, "orient", block / "images", "--calibration", block / "calibration.toml", "--workspace", bench.scratch / "strip-300-pairs",
                "--network", "guided", "--until", "pairs", "--max-features", "20000", "--memory", "1GiB", "--progress", "plain"])
    if done.code != 0:
        raise RuntimeError(f"matching ended with {done.code}: {done.err.strip().splitlines()[-1:]}")
    line = next(text for text in done.out.splitlines() if "pairs compared" in text)
    print(f"  {line}; {done.wall_s:.1f} s wall, {done.cpu_s:.1f} s CPU")
    bench.figures.at_least(ROWS[4][0], mean_features(bench, block), "", 20000)
    bench.figures.at_least(ROWS[5][0], int(line.split()[0]), "", 1000)
    bench.figures.at_most(ROWS[6][0], done.peak_bytes / 2**30, "GiB", 1)


LARGE_OPTIONS = ("--width-px", "1500", "--height-px", "1000")


def mean_features(bench, block):
    """Of every 30th image: the features are not in a report before the orientation."""
    counts = []
    for image in sorted((block / "images").iterdir())[::30]:
        done = run([bench.rilievo, "features", image, "--max-features", "20000"])
        counts.append(int(next(line.split()[1] for line in done.out.splitlines() if line.startswith("features"))))
    return sum(counts) / len(counts)


def measure(bench):
    bench.figures.measure(ROWS[:4], lambda: guided_ring(bench))
    bench.figures.measure(ROWS[4:], lambda: large_block(bench))
