"""Reading and writing files safely: hostile text, whole files or none, printable text."""
