"""Power of detection: from which size on effects of a stage are named, beside what is possible at all (`power.py`).

Figures are printed, none is a bound. `make bench` tries the effects of `BENCH_EFFECTS` (separated by commas) on
`BENCH_TRIALS` recordings a size, each of which takes some seconds. In pieces, put together in one file:

    python test/benchmark/bench_power.py --effect unbalance --effect disc_scale -o power.json
    python test/benchmark/bench_power.py --effect unbalance --first 4 --trials 8 -o power.json
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from power import Setting, Trial, ideal_size, search_sizes, size_reaching, try_size

from rotary_error_monitor.cases.draws import stage_faults
from rotary_error_monitor.gap.options import FALSE_ALARMS

USUAL = "unbalance"
SHARES = (0.5, 0.95)
HEAD = ("effect", "Fisher std", "trials", "seen in half", "named in half", "in 95 %", "ideal: half", "95 %")


def measure(effect, setting_seed, seeds, false_alarms, earlier=()):
    """What is known of an effect: its Fisher bound, and trials with those of earlier runs."""
    setting = Setting.of(effect, setting_seed)
    known = {(trial["size"], trial["seed"]): Trial(**trial) for trial in earlier}

    def try_all(size):
        fresh = [seed for seed in seeds if (size, seed) not in known]
        known.update({(size, seed): try_size(setting, size, seed, false_alarms) for seed in fresh})
        return [known[size, seed] for seed in seeds]

    search_sizes(try_all)
    return {
        "effect": " ".join(setting.key).strip(),
        "setting": setting_seed,
        "false_alarms": false_alarms,
        "amplitudes": len(setting.linear),
        "std": setting.std_in_units,
        "trials": [dataclasses.asdict(trial) for _, trial in sorted(known.items())],
    }


def format_rows(rows):
    lines = [HEAD, *(cells_of(row) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)


def cells_of(row):
    trials = row["trials"]
    sizes = [trial["size"] for trial in trials]
    seen, named = ([trial[what] for trial in trials] for what in ("seen", "named"))
    reached = [size_reaching(0.5, sizes, seen), *(size_reaching(share, sizes, named) for share in SHARES)]
    ideal = [ideal_size(share, row["amplitudes"], row["false_alarms"]) for share in SHARES]
    std = " and ".join(f"{size:.2g} {unit}" for size, unit in row["std"])
    beyond = f"> {max(sizes):g}"
    cells = [beyond if size > max(sizes) else f"{size:.1f}" for size in reached]
    return (row["effect"], std, str(len(trials)), *cells, *(f"{size:.1f}" for size in ideal))


def run(effects, setting_seed, seeds, false_alarms, output):
    """Measure effect after effect; the file is written after each, and keeps what it had."""
    found = {}
    if output is not None and output.exists():
        found = json.loads(output.read_text(encoding="utf-8"))
    for effect in effects:
        key = f"{effect}, setting {setting_seed}, false alarms {false_alarms:g}"
        found[key] = measure(effect, setting_seed, seeds, false_alarms, found.get(key, {}).get("trials", ()))
        if output is not None:
            output.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        print(format_rows([found[key]]), flush=True)
    return found


def test_power_beside_what_is_possible():
    effects = os.environ.get("BENCH_EFFECTS", USUAL).split(",")
    found = run(effects, 1, range(int(os.environ.get("BENCH_TRIALS", "2"))), FALSE_ALARMS, None)
    print("\n" + format_rows(found.values()))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--effect", choices=stage_faults(), action="append", help="may be given again (default: all)")
    parser.add_argument("--setting", type=int, default=1, help="seed of stage, place and direction (default: 1)")
    parser.add_argument("--first", type=int, default=0, help="seed of the noise of the first recording (default: 0)")
    parser.add_argument("--trials", type=int, default=4, help="recordings a size (default: 4)")
    parser.add_argument("--false-alarms", type=float, default=FALSE_ALARMS)
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.json", help="joins what the file has")
    chosen = parser.parse_args(arguments)
    seeds = range(chosen.first, chosen.first + chosen.trials)
    effects = chosen.effect or stage_faults()
    found = run(effects, chosen.setting, seeds, chosen.false_alarms, chosen.output)
    print("\n" + format_rows(found.values()))


if __name__ == "__main__":
    main()
