"""The reference as pages of HTML: generated from blocks, diagrams, effects and docstrings, with pages on concepts.

Only ``site`` needs Sphinx.
"""
