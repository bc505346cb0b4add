# Comes with Blender's module and fills itself in when that starts.
from typing import Any

def __getattr__(name: str) -> Any: ...
