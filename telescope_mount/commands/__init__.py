"""The commands of `telescope-mount`, a file each: its options, what it does, what it prints."""
