"""The report of a diagnosis and of a plan: page, tables, pictures, diagnosis.json."""
