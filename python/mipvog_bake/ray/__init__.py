"""Bakes many scenes on a Ray cluster: `python -m mipvog_bake.ray MANIFEST.jsonl --output URI`.

1. `manifest`: one line per scene. All lines are checked before any scene is baked.
2. `driver`: keeps a bounded number of tasks in flight and writes a line of the report as each
   ends. Ray handles scheduling, retries of lost workers and placement.
3. `task`: on a worker, fetches the inputs to its disk, runs the program `mipvog-bake` in its own
   process, and uploads the output to the store.
4. `store`: local paths, and all stores that fsspec supports.
5. `program`: finds and runs the program, which forecasts, bakes and summarizes.
"""

try:
    from .driver import Options, bake_all
    from .manifest import Scene, read
except ModuleNotFoundError as error:
    if error.name not in ("ray", "fsspec"):
        raise
    message = f"found no module {error.name}; install it: pip install 'mipvog-bake[ray]'"
    raise ModuleNotFoundError(message, name=error.name) from None

__all__ = ["Options", "Scene", "bake_all", "read"]
