"""scripts/bench compare A.json B.json: ratios B / A of what two runs of the benches measured."""
import argparse
import json
import pathlib


def rows_of(measured):
    """{name: number} of a bench's JSON: figures, and the numbers of its blocks."""
    rows = {entry["name"]: entry["value"] for entry in measured["figures"]}
    loop_s = measured.get("reference_loop_s")
    if loop_s:
        rows["reference loop [s]"] = loop_s
    for name, block in measured.get("blocks", {}).items():
        flat = {"wall [s]": block["wall_s"], "CPU [s]": block["cpu_s"], "peak [bytes]": block["peak_bytes"], "pairs": block["pairs"], **block["accuracy"]}
        if loop_s:
            flat["CPU / reference loop"] = block["cpu_s"] / loop_s
        for stage, counters in block["counters"].items():
            flat.update({f"{stage}: {counter}": value for counter, value in counters.items()})
        rows.update({f"{name}: {key}": value for key, value in flat.items()})
    return {name: value for name, value in rows.items() if isinstance(value, (int, float)) and not isinstance(value, bool)}


def main(arguments):
    parser = argparse.ArgumentParser(prog="scripts/bench compare", description="Prints B / A of everything that both files have.")
    parser.add_argument("a", metavar="A.json")
    parser.add_argument("b", metavar="B.json")
    options = parser.parse_args(arguments)
    a, b = (json.loads(pathlib.Path(path).read_text()) for path in (options.a, options.b))
    for name, measured in (("A", a), ("B", b)):
        print(f"{name}: commit {measured['commit']}, {measured['machine']['cpu']}, {measured['machine']['cores']} cores")
    if a["machine"] != b["machine"]:
        print("The machines differ: compare ratios to the reference loop, not times.")
    rows_a, rows_b = rows_of(a), rows_of(b)
    print(f"{'':<62} {'A':>13} {'B':>13} {'B / A':>8}")
    for name in rows_a:
        if name in rows_b:
            ratio = f"{rows_b[name] / rows_a[name]:8.3f}" if rows_a[name] else "       -"
            print(f"{name:<62} {rows_a[name]:>13.6g} {rows_b[name]:>13.6g} {ratio}")
    for which, only in (("A", rows_a.keys() - rows_b.keys()), ("B", rows_b.keys() - rows_a.keys())):
        if only:
            print(f"only in {which}: {', '.join(sorted(only))}")
    return 0
