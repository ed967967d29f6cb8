"""The zero of the encoders: from Polaris or stars, and what it follows."""
