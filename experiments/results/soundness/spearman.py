"""Rank correlation of the figures of lint with true errors, over the pairs of anigen-eval.

spearman.py RESULTS: metrics.csv of it has a row per method and asset. Two numbers per figure: Spearman's rank correlation
over all pairs, and how often, of two methods on one asset whose figures differ, the better figure has the smaller error.
"""
import csv, sys
from collections import defaultdict

rows = list(csv.DictReader(open(sys.argv[1])))
figures = [("sound_stretched", 1), ("sound_inverted", 1), ("sound_crossed", 1), ("sound_bleed", 1), ("sound_islands", 1),
           ("sound_dead_joints", 1), ("sound_inside", -1)]


def ranks(values):
    order = sorted(range(len(values)), key=values.__getitem__)
    result = [0.0] * len(values)
    i = 0
    while i < len(order):
        j = i
        while j + 1 < len(order) and values[order[j + 1]] == values[order[i]]: j += 1
        for k in range(i, j + 1): result[order[k]] = (i + j) / 2
        i = j + 1
    return result


def correlation(a, b):
    a, b = ranks(a), ranks(b)
    ma, mb = sum(a) / len(a), sum(b) / len(b)
    sab = sum((x - ma) * (y - mb) for x, y in zip(a, b))
    saa, sbb = sum((x - ma) ** 2 for x in a), sum((y - mb) ** 2 for y in b)
    return sab / (saa * sbb) ** 0.5 if saa > 0 and sbb > 0 else float("nan")


print("| figure | skin l1, ρ | deformation, ρ | right method by l1 | right method by deformation |\n|---|--:|--:|--:|--:|")
for figure, sign in figures:
    cells = []
    for error in ("skin_l1", "deformation_error"):
        pairs = [(sign * float(r[figure]), float(r[error])) for r in rows if r[figure] and r[error]]
        cells.append(f"{correlation([p[0] for p in pairs], [p[1] for p in pairs]):.2f}")
    for error in ("skin_l1", "deformation_error"):
        by_asset = defaultdict(list)
        for r in rows:
            if r[figure] and r[error]: by_asset[r["id"]].append((sign * float(r[figure]), float(r[error])))
        right = wrong = 0
        for methods in by_asset.values():
            for i in range(len(methods)):
                for j in range(i):
                    f, e = methods[i][0] - methods[j][0], methods[i][1] - methods[j][1]
                    if f == 0 or e == 0: continue
                    right, wrong = right + (f * e > 0), wrong + (f * e < 0)
        cells.append(f"{right} of {right + wrong}")
    print(f"| `{figure}` | " + " | ".join(cells) + " |")
