"""The diagnosis for people: one HTML page, and sentences for a night assistant."""
