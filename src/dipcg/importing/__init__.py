"""Sources that others made, turned into a TOML file that is a generator: `dipcg generators add SOURCE`.

One file for each kind of source; `cli/generators.py` chooses among them. Each proposes the parameters and their
ranges, tries them with builds in worker processes, and returns an `Imported` for the table that the command prints.

Which parameters change the mesh, and under which options, is found by one search for all sources and for the
contracts: `starts` chooses values, `search` moves parameters from them, and `effects` holds what was seen and what
follows from it.
"""
