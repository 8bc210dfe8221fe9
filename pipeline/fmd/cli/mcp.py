"""``fmd mcp``: scenes as tools of an assistant, by the Model Context Protocol."""

import contextlib
import os
import sys
from collections.abc import Iterator
from functools import wraps
from pathlib import Path
from typing import Any

from fmd.core.errors import AccuracyError, InputError
from fmd.core.version import __version__

_INSTRUCTIONS = (
    "fmd computes flexible parts in mechanisms: scenes in TOML, from mesh to stress in motion. Begin with scenes or "
    "load; check before run; change writes a new scene file. Quantities have units in their text: '300 mm'."
)


def mcp(folder: Path = Path()) -> None:
    """Serve scenes to an assistant over standard input and output; needs the extra 'mcp'.

    Parameters
    ----------
    folder
        Folder that scene files are taken from and written to, that of the call by default; they may name files
        elsewhere.
    """
    if not folder.is_dir():
        raise InputError("FOLDER", "", str(folder), "is no folder")
    server = make_server(folder)
    with _own_output():
        server.run("stdio")


@contextlib.contextmanager
def _own_output() -> Iterator[None]:
    """Keep standard output for the protocol: what libraries and children write there goes to standard error.

    The SDK takes ``sys.stdout``, which is a copy of the descriptor here.
    """
    given = sys.stdout
    given.flush()
    own = os.dup(given.fileno())
    os.dup2(sys.stderr.fileno(), given.fileno())
    try:
        with os.fdopen(own, "w", encoding="utf-8", closefd=False) as sys.stdout:
            yield
    finally:
        os.dup2(own, given.fileno())
        os.close(own)
        sys.stdout = given


def make_server(folder: Path) -> Any:
    """Return a server of the official SDK that has the tools of `fmd.cli.mcp_tools` on a folder.

    Raises
    ------
    InputError
        The SDK isn't installed.
    """
    try:
        from mcp.server.mcpserver import Image, MCPServer
    except ModuleNotFoundError:
        raise InputError("fmd mcp", "", None, "needs the SDK: install this package's extra 'mcp'") from None
    from mcp.server.mcpserver.exceptions import ToolError

    from fmd.cli.mcp_tools import TOOLS, SceneTools

    tools = SceneTools(folder.resolve())
    server = MCPServer("fmd", instructions=_INSTRUCTIONS, version=__version__)

    def serve(function: Any) -> None:
        @wraps(function)
        async def tool(**given: Any) -> Any:  # in this thread: a mesher can't run in another one
            try:
                found = function(**given)
            except (InputError, AccuracyError) as error:
                raise ToolError(str(error)) from error
            return Image(data=found, format="png") if isinstance(found, bytes) else found

        server.tool(structured_output=False)(tool)

    for name in TOOLS:
        serve(getattr(tools, name))
    return server
