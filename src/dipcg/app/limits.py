"""How much strangers may send, ask for and leave here; docs/security.md says what each limit is for."""

from __future__ import annotations

# Requests. A picture is read from a stream; every other body is JSON.
MOST_PICTURE_BYTES = 25 * 2**20
MOST_JSON_BYTES = 2**18
# A generator's file that is learned, where the server was started with --learn.
MOST_SOURCE_BYTES = 100 * 2**20
# An OpenSCAD file among them: the search of a longer one would keep everybody waiting for seconds.
MOST_SCAD_BYTES = 4 * 2**20
# The TOML file before it. Python's reader takes minutes for one long line with a hundred thousand dots.
MOST_TOML_BYTES, MOST_TOML_LINE = 2**17, 2000
# A longer body is read and forgotten, so that its client sees the error; a body of more than this is not read.
MOST_DRAINED_BYTES = 100 * 2**20
# Seconds in which the headers of a request must come, and the slowest upload after that.
HEADERS_S, BODY_S, BODY_BYTES_PER_S = 10.0, 20.0, 100_000
# Seconds after which a client that reads no answer is given up.
UNREAD_S = 30.0
# Connections at once. When there are more, the one that has waited longest for its request is closed.
MOST_CONNECTIONS = 400
# Bytes of pictures that are being uploaded at once.
MOST_UPLOADING_BYTES = 20 * MOST_PICTURE_BYTES

# What a request may ask for.
MOST_CANDIDATES, MOST_LETTERS, MOST_TEXTURE, MOST_FACES = 32, 500, 2048, 2_000_000
# Jobs, and previews and cut-outs, that wait or are made, above which a request is turned away.
MOST_JOBS, MOST_PREVIEWS = 100, 50
# Seconds after which a build is stopped, and after which it keeps no others waiting.
BUILD_S, PATIENCE_S = 30.0, 2.0

# What stays here: seconds since it was last used, bytes in all, and bytes of one address.
KEPT_S = 3600.0
PICTURES_BYTES, PICTURES_OF_ONE = 256 * 2**20, 64 * 2**20
FILES_BYTES, FILES_OF_ONE = 2 * 2**30, 2**29
# Jobs are counted instead.
JOBS, JOBS_OF_ONE = 4000, 1000

# Generators that are learned: how many are kept, and the longest that may be asked for.
MOST_TRAININGS, MOST_SHAPES, MOST_MINUTES = 50, 50_000, 7 * 24 * 60
