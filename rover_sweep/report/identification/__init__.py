"""The report of an identification: page, tables, pictures, identification.json."""
