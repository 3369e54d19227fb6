"""`harness store`: what the cache of batches holds, whether it is sound, and making room."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.cli.options import open_store
from harness.cli.output import JsonOption, log, print_json, print_rich, progress
from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.samples.inventory import Series
    from harness.samples.store import Store

# As disks are sold, and as memory is counted.
_BYTES = {"": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9, "tb": 10**12,
          "kib": 2**10, "mib": 2**20, "gib": 2**30, "tib": 2**40}
_SECONDS = {"m": 60, "h": 3600, "d": 86400, "w": 7 * 86400}


def store(
    action: Annotated[Literal["list", "verify", "prune"], typer.Argument(help=(
        "list: what is there, the last used first. verify: read every batch; damaged ones are set aside. prune: remove "
        "what --older or --keep say."))],
    older: Annotated[str | None, typer.Option("--older", metavar="TIME", help=(
        "Of prune: what was not used for so long, such as 12h, 30d, 8w."))] = None,
    keep: Annotated[str | None, typer.Option("--keep", metavar="SIZE", help=(
        "Of prune: then what was unused for longest, until no more is left than this, such as 500MB, 5GB."))] = None,
    json: JsonOption = False,
) -> int:
    """List, verify or prune what was rendered and kept.

    Exit status 1 when `verify` finds a batch that is damaged or misplaced; it is set aside, and rendered again when it
    is needed.

    Example: `harness store list`
    """
    if action != "prune" and (older or keep):
        raise HarnessError(f"--older and --keep are for `harness store prune`, found them with {action}")
    held = open_store(cache=True)
    assert held is not None
    if action == "list":
        _list(held, json=json)
    elif action == "verify":
        return _verify(held, json=json)
    else:
        _prune(held, older, keep, json=json)
    return 0


def _list(held: Store, *, json: bool) -> None:
    from harness.files import cache_dir
    from harness.samples.inventory import inventory, inventory_of_made

    found, made = inventory(held), inventory_of_made(cache_dir())
    if json:
        print_json({"root": held.root, "limit": held.limit, "bytes": sum(one.bytes for one in found), "series": found,
                    "made": made})
        return
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in ("scene", "estimator", "samples", "size", "last use"):
        table.add_column(heading, justify="right" if heading in ("samples", "size") else "left")
    for one in (*found, *made):
        table.add_row(one.scene or "-", one.estimator or "-", str(one.samples or "-"), _size(one.bytes), _when(one))
    if found or made:
        print_rich(table)
    print(f"{held.root}: {_size(sum(one.bytes for one in found))} in {sum(one.batches for one in found)} files of "
          f"{len(found)} series; pruned by itself beyond {_size(held.limit)}")
    if made:
        print(f"{cache_dir()}: {_size(sum(one.bytes for one in made))} besides, made of them and made again where it "
              "is removed")


def _verify(held: Store, *, json: bool) -> int:
    from harness.samples.inventory import verify

    aside, read = [], 0
    total = sum(1 for _ in held.files())
    with progress(total, "batches") as advance:
        for path in verify(held):
            read += 1
            advance(1)
            if path is not None:
                aside.append(path)
    if json:
        print_json({"root": held.root, "read": read, "set_aside": aside})
    else:
        print(f"{held.root}: {read} batches read, {len(aside)} of them damaged or misplaced, and set aside")
    return 1 if aside else 0


def _prune(held: Store, older: str | None, keep: str | None, *, json: bool) -> None:
    from harness.files import cache_dir
    from harness.samples.inventory import inventory_of_made, prune, prune_made

    if not (older or keep):
        raise HarnessError("prune: say what is to go: --older 30d (unused for so long), --keep 5GB (no more than that "
                           "is left), or both")
    room = _parsed(keep, "--keep", _BYTES, "500MB or 5GB") if keep else None
    unused = _parsed(older, "--older", _SECONDS, "12h, 30d or 8w") if older else None
    removed = prune(held, keep=room, older=unused)
    # Batches took longest to draw: what is made of them has the room that they leave.
    removed += prune_made(cache_dir(), keep=None if room is None else max(0, room - held.size()), older=unused)
    left = held.size() + sum(one.bytes for one in inventory_of_made(cache_dir()))
    if json:
        print_json({"root": held.root, "removed": removed, "bytes": left})
    else:
        print(f"{held.root}: {_size(removed)} removed, {_size(left)} left")
    if room is not None and left > room:
        log(f"warning: {held.root}: other processes write to it, or files cannot be removed")


def _parsed(text: str, option: str, units: dict[str, int], example: str) -> int:
    """'5GB' as 5000000000. HarnessError for what is no number with one of the units."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-z]*)", text.strip().lower())
    if not found or found[2] not in units:
        raise HarnessError(f"{option}: expected a number and a unit, such as {example}; found '{text}'")
    return int(float(found[1]) * units[found[2]])


def _size(count: int) -> str:
    """Bytes in three digits, such as '1.26 GB'."""
    for unit in ("GB", "MB", "kB"):
        if count >= (size := _BYTES[unit.lower()]):
            return f"{count / size:.3g} {unit}"
    return f"{count} B"


def _when(one: Series) -> str:
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(one.used))
