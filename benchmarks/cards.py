"""What the cards of the shipped checkpoints say of their training."""

import json

from benchmarks.timing import header, row
from dipcg.weights import CARD, SHIPPED


def main() -> None:
    header("checkpoint", "shapes", "pictures or sentences", "minutes", "machine", "reals", "choices", "MB")
    for path in sorted(SHIPPED.glob(f"*/{CARD}")):
        card = json.loads(path.read_text())
        found = card["validation"]
        megabytes = sum(file.stat().st_size for file in path.parent.iterdir()) / 1e6
        row(
            *(path.parent.name, f"{card['shapes']:,}", f"{card['pictures']:,}", f"{card['seconds'] / 60:.0f}"),
            *(card["machine"], f"{found['guess_reals']:.3f}", f"{found['guess_choices']:.3f}", f"{megabytes:.1f}"),
        )


if __name__ == "__main__":
    main()
