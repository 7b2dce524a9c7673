"""The fixed-step engine. It receives equations and numbers; it has never heard of blocks."""
