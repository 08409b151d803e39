#!/usr/bin/env python3
"""Where the rules of the judge and the one evidence disagree, by question and by whether the effect asked of is a hidden one.

Usage: disagreements.py ANSWERS TRUTH [ANSWERS TRUTH ...]

ANSWERS holds CASE.trace of `compass diagnose CASE --trace ANSWERS/CASE.trace`; TRUTH holds CASE.json (what `compass trial`
and `compass score` read) or CASE.toml (hardware: what is expected, optional and forbidden). Prints a table and each disagreement.
"""
import json
import sys
import tomllib
from collections import Counter
from pathlib import Path


def hidden(truth: Path, case: str) -> set[tuple[str, str | None]]:
    """Effects, with their places where these count, that are really there."""
    if (file := truth / f"{case}.json").exists():
        told = json.loads(file.read_text())
        alike = [m for e in told["effects"] for m in (e.get("one_of") or [e])]
        return {(m["effect"], m.get("at")) for m in alike}
    told = tomllib.loads((truth / f"{case}.toml").read_text())
    names = [n for e in told.get("expected", []) for n in e["any_of"]] + told.get("optional", [])
    return {(effect, at or None) for effect, _, at in (n.partition("@") for n in names)}


def main(folders: list[str]) -> None:
    if not folders or len(folders) % 2:
        sys.exit(__doc__)
    counts, cases, differ = Counter(), 0, []
    for answers, truth in zip(map(Path, folders[::2]), map(Path, folders[1::2])):
        for trace in sorted(answers.glob("*.trace")):
            cases += 1
            there = hidden(truth, trace.stem)
            for line in filter(str.strip, trace.read_text().splitlines()):
                one = json.loads(line)
                if "question" not in one:
                    continue
                is_hidden = (one["effect"], one["at"]) in there or (one["effect"], None) in there
                counts[one["question"], is_hidden, one["by_rule"], one["by_evidence"]] += 1
                if one["by_rule"] != one["by_evidence"]:
                    differ.append((trace.stem, is_hidden, one))
    print(f"{cases} cases\n\n| question | effect asked of | both yes | both no | only the rule | only the evidence |")
    print("|---|---|---|---|---|---|")
    for question in ("accept", "exchange", "member"):
        for is_hidden in (True, False):
            row = [counts[question, is_hidden, *by] for by in ((True, True), (False, False), (True, False), (False, True))]
            print(f"| {question} | {'a hidden one' if is_hidden else 'another'} | " + " | ".join(map(str, row)) + " |")
    print()
    for case, is_hidden, one in differ:
        e = one["evidence"]
        print(f"{case:24} {one['question']:8} {one['effect']}@{one['at']} against {one.get('against', '-')}: "
              f"{'hidden' if is_hidden else 'not there'}, {'rule' if one['by_rule'] else 'evidence'} says yes, gain {one['gain']:.0f}, "
              f"evidence {e['fit']:.0f} {e['occam']:.0f} {e['search']:.0f}")


if __name__ == "__main__":
    main(sys.argv[1:])
