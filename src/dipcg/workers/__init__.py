"""Child processes that build meshes and run Blender.

Blender runs only here. A child is `python -m dipcg.workers.child`, connected by a socket, and not a process of
`multiprocessing`: spawned children would import the caller's script again, so that every script would need a `__main__`
guard, and forked children would inherit torch's threads and an OpenGL context. `child.py` is the only program that
children run, for builds and for calls; `process.py` is the parent's side. Each child has a thread of the parent that
waits with a time limit, which counts for the whole of a message. `messages.py` has the format: what a child sends is
data that is checked, since the child may have opened a stranger's file. A shell beside each child waits for the end of
the parent, and then kills the child with all that it has started, so neither Ctrl-C nor a kill leaves a process behind.
(Linux's own signal for this comes when the thread that started the child ends.) A child uses one Blender thread,
because Blender's thread pool costs more processor time than it saves; several workers give the parallelism. A child is
replaced after a number of builds, because Blender slows down as it works. Writing files, baking and drawing use a child
of their own, because they start from an empty scene and a child that builds keeps its node graphs in the scene.
"""
