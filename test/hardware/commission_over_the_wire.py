"""Commissioning of machines behind an emulated Mesa card, over UDP on the loopback: how many are ready, and what the card saw.

    PYTHONPATH=test/commissioning:test/hardware python test/hardware/commission_over_the_wire.py --machines 8 --first 2301

The card gives no current, so an encoder-only law is what can be reached. With ``--faults`` it loses and repeats packets.
"""

import argparse
import json
import tempfile
from pathlib import Path

import yaml
from campaign import interval
from machines import random_axis
from test_mesa import AXIS, Emulated

from microstage_ros.commands.operation import commission


def one(seed, faults, folder):
    """Commission the machine of a seed over the wire. Returns a row: verdict, law, moves, what became of the card."""
    truth = random_axis(AXIS, seed)
    AXIS.save(folder / "sketch.yaml")
    truth.save(folder / "truth.yaml")
    card = Emulated(axis=folder / "truth.yaml", clock=AXIS.value("period"), seed=seed, faults=faults)
    options = {"host": "127.0.0.1", "port": card.port, "watchdog_s": 0.5, "wait_share": 200.0, "patience_s": 10.0}
    (folder / "options.yaml").write_text(yaml.safe_dump(options))
    status = commission.main(["--axis", str(folder / "sketch.yaml"), "--backend", "mesa", "--backend-options", str(folder / "options.yaml"),
                              "--out", str(folder / "out"), "--seed", str(seed), "--yes"])
    report = json.loads((folder / "out" / "report.json").read_text())
    return {"seed": seed, "status": status, "report": report, "card": card.end()}


def main():
    """Run so many machines and print the rates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=8)
    parser.add_argument("--first", type=int, default=2301)
    parser.add_argument("--faults", type=json.loads, default={}, help='of the emulator, for example {"drop_reply": 0.001}')
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    rows = []
    for seed in range(arguments.first, arguments.first + arguments.machines):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(one(seed, arguments.faults, Path(folder)))
        row = rows[-1]
        print(seed, row["status"], row["report"]["controller"], row["card"], flush=True)
        if arguments.out:
            arguments.out.write_text(json.dumps(rows))
    print("ready:", interval(sum(row["status"] == 0 for row in rows), len(rows)))


if __name__ == "__main__":
    main()
