"""Measuring estimates: the protocol of the tables in docs/results.md, baselines, and meshes of other tools.

Every mesh is centred on its bounding box and scaled to a longest side of 1. A failed build counts as the worst
value and is never left out. The points of the true surface are the same in every row, so that rows can be compared
picture by picture. Differences from the estimate have paired bootstrap intervals. Meshes of other tools are aligned
first (24 rotations, then iterative closest points), because these tools do not agree on axes and size. Our own
estimates are not aligned.
"""
