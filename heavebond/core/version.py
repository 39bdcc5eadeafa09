"""The version of heavebond, as written into exported models, reports and resume files."""

VERSION = "0.1.0"
