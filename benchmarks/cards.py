"""What the cards of the shipped checkpoints say of their training."""

import json
from pathlib import Path

from benchmarks.timing import header, row
from dipcg.model.zoo import CARD, SHIPPED, WORDS


def main() -> None:
    for what, folder in (("pictures", SHIPPED), ("sentences", WORDS)):
        print(f"Checkpoints that read {what}:\n")
        header("checkpoint", "shapes", what, "of them before", "minutes", "machine", "reals", "choices", "MB")
        for path in sorted(folder.glob(f"*/{CARD}")):
            _print(path)
        print()


def _print(path: Path) -> None:
    card = json.loads(path.read_text())
    found, before = card["validation"], card.get("started_from", {}).get("pictures", 0)
    megabytes = sum(file.stat().st_size for file in path.parent.iterdir()) / 1e6
    choices = f"{found['guess_choices']:.3f}" if any(p["kind"] == "choice" for p in card["space"]) else ""
    row(
        *(path.parent.name, f"{card['shapes']:,}", f"{before + card['pictures']:,}", f"{before:,}"),
        *(f"{card['seconds'] / 60:.0f}", card["machine"], f"{found['guess_reals']:.3f}", choices, f"{megabytes:.1f}"),
    )


if __name__ == "__main__":
    main()
