"""Shows what the core computed: identification.json, an HTML page, pictures, tables, exported models."""
