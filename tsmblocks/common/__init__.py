"""What every other package may use: errors, units, tables, frames, views. Nothing here knows blocks or data."""
