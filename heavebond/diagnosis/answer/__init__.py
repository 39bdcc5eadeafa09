"""The verdict of a diagnosis, its sentences, tables and files."""
