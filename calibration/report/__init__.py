"""Pages for people: one HTML file each that opens from disk, offline, and prints."""
