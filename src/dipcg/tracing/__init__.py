"""Seeded programs as generators: their random draws are recorded, named, and replayed with chosen values.

A program with a seed and no parameters does have parameters: the numbers that it draws. A draw is known by its site,
the calls that lead to it, and by how many draws came from that site before. A build runs the program with one fixed
seed and puts chosen values in place of the draws that are parameters. Every other draw gets a value that depends on its
site and its number alone, so that a draw more or less changes no other.

Prior art: probabilistic programs as recorded draws with addresses (Wingate et al. 2011; pyprob and Etalumis, Baydin et
al. 2019), and the tracer of Infinigen 2's procfunc. docs/seeded.md says how it works and where it fails.
"""
