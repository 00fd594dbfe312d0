"""Presents results: identification.json, HTML pages, pictures, tables, exported models."""
