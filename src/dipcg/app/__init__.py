"""The web app: a Gradio page and an HTTP API over one set of plain functions.

The service holds what all visitors share: the estimators, the workers, and one thread for the network and OpenGL,
because an OpenGL context belongs to one thread. It stores nothing of a visitor: the state of one visitor is a
frozen value, and plain functions turn it into the next one. The page numbers its requests, because requests
overtake each other: a change with an earlier number is inserted before later ones, which are then applied again,
and a script drops an answer that is older than what it shows. Small scripts replace some Gradio components:
`gr.Model3D` resets its camera whenever the mesh changes, and one Gradio slider for each of 48 parameters would fill
many screens. The scripts fill the page from JSON with `textContent`, fetch nothing, and send one edit at a time, so
that dragging a slider does not flood the server. An upload stays a path until `images.load_image` reads it, which
checks its size before decoding. Addresses are not fetched, and a request body without a length or above the limit
is refused before it is read.
"""
