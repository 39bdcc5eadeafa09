"""The commands of `heavebond`, a module each. A command returns its figures for --json and raises what is wrong."""
