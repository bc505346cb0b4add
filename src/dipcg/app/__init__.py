"""The web app: an HTTP API in FastAPI, and a static page over it.

The server keeps no session. What is open on the page, what was changed and what is fixed live in the page, so that
nothing of a visitor is lost with the server, and no visitor takes another's place. The server keeps uploaded pictures,
jobs and finished files, each under an id that cannot be guessed, for a limited time and in a limited amount.

`guard.py` and `protocol.py` are what every request passes first, `limits.py` has all limits, and docs/security.md says
what they are for. `estimating.py` and `making.py` do the work, in threads that never wait for another visitor's build.
"""
