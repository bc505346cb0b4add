# Blender's module fills itself in when it starts, so its own files say nothing of what is in it.
from typing import Any

def __getattr__(name: str) -> Any: ...
