"""Bodies that grow: cells thicken where they carry, and thin where they do not."""
