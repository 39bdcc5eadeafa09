"""The verdict, its sentences, tables and files."""
