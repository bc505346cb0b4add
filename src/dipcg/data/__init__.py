"""Data sets: parameters and light meshes in Parquet files, built on one machine or on a Ray cluster.

A data set holds no pictures. A shape takes a few kilobytes, and training renders new pictures of it each time.
Sample `i` depends on the seed and on `i` alone. A killed build therefore continues with the same rows, a larger
count adds rows and changes none, and the split into training, validation and test never moves a shape. A shard of
250 rows is written to a temporary name and then renamed, so it is complete or absent. On a cluster one task builds
one shard and returns the bytes of its file, and only the machine that started the build writes; a shard that is
built twice has the same rows both times. `shapes.py` holds the shapes of a split in memory for training and
evaluation; `store.py` reads and writes the files.
"""
