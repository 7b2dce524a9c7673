"""Used by every other package: errors, arguments, units, tables, frames, views. Nothing here knows blocks or data."""
