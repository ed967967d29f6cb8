"""Drivers of a real mount: listened to, and checked against the contract (docs/real_mount.md).

`samples`, `contract` and `nudge` are numerics on what was recorded; `listener` records it.
"""
