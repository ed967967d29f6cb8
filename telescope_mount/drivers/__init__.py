"""Drivers of a real mount: listened to, and judged by the contract (docs/real_mount.md).

`samples`, `judgement` and `nudge` are numerics on what was recorded; `listener` records it.
"""
