"""Changes of bytes, and of the words of a text, drawn from a seeded generator."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

NASTY = [
    b"nan", b"inf", b"-1", b"1e400", b"\x00", b"\xff\xfe", b",", b"\n", b'"', b";", b"\x1b[31m", b"9" * 400, b"\xe9",
    "é".encode(), b"-9223372036854775808", b"{", b"[", b"]", b"\r", b"'", b"$", b"..", b"/", b"->", b"=", b"#",
]  # fmt: skip
"""Pieces that readers stumble over."""
WORDS = [
    "nan", "inf", "-inf", "1e400", "-1", "0", "1e-320", "9" * 40, "true", "[]", "[[]]", "{}", "''", '"\\u0000"',
    "1979-05-27", "$k", "$", "->", "format = 1", "blocks", "wires", "type", "use", "..", "__class__", "x" * 300, "é",
    "(", ")", "*", "/", "^", "**", "rad", "deg", "[deg]", ",", ".", "=", "\n", "\t", "\x1b[31m",
]  # fmt: skip
"""Words that stand in for others in a text."""
LARGE = [b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\0\0\0\x80"]
"""Whole numbers at the ends of their ranges."""


def mutated(rng: random.Random, content: bytes) -> bytes:
    """The content with one to eight changes, more of them near its beginning, where headers are."""
    made = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 8])):
        if not made:
            break
        at = rng.randrange(min(len(made), 300) if rng.random() < 0.4 else len(made))
        rng.choice(CHANGES)(rng, made, at)
    return bytes(made)


def _other_byte(rng: random.Random, made: bytearray, at: int) -> None:
    made[at] = rng.randrange(256)


def _other_bit(rng: random.Random, made: bytearray, at: int) -> None:
    made[at] ^= 1 << rng.randrange(8)


def _left_out(rng: random.Random, made: bytearray, at: int) -> None:
    del made[at : at + rng.choice([1, 2, 4, 8, 50, 500])]


def _cut(_rng: random.Random, made: bytearray, at: int) -> None:
    del made[at:]


def _put_in(rng: random.Random, made: bytearray, at: int) -> None:
    made[at:at] = rng.choice(NASTY)


def _other_number(rng: random.Random, made: bytearray, at: int) -> None:
    made[at : at + 4] = rng.choice([*LARGE, rng.randbytes(4)])


def _copied(rng: random.Random, made: bytearray, at: int) -> None:
    start, size = rng.randrange(len(made)), rng.choice([1, 4, 16, 100])
    made[at : at + size] = made[start : start + size]


def _repeated(rng: random.Random, made: bytearray, at: int) -> None:
    made[at : at + 1] = bytes([made[at]]) * rng.choice([2, 3, 50])


CHANGES: list[Callable[[random.Random, bytearray, int], None]] = [
    _other_byte, _other_bit, _left_out, _cut, _put_in, _other_number, _copied, _repeated,
]  # fmt: skip


def reworded(rng: random.Random, text: str, words: Sequence[str] = WORDS) -> str:
    """The text with some words changed, left out, repeated or exchanged: it stays much like one that is meant."""
    parts = re.findall(r"\w+|\s+|.", text)
    for _ in range(rng.choice([1, 1, 2, 4])):
        if not parts:
            break
        at, kind = rng.randrange(len(parts)), rng.randrange(4)
        if kind == 0:
            parts[at] = rng.choice(words)
        elif kind == 1:
            del parts[at : at + rng.choice([1, 1, 5, 30])]
        elif kind == 2:
            parts[at:at] = parts[at : at + rng.choice([1, 3, 20])]
        else:
            other = rng.randrange(len(parts))
            parts[at], parts[other] = parts[other], parts[at]
    return "".join(parts)
